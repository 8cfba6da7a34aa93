/* Graphs of operations: nodes in the order of evaluation, equal ones once.

   tape.h stands before this file. varint/codegen/graph.py has the same layouts and kinds. */
#include <setjmp.h>
typedef __UINT32_TYPE__ uint32_t;
typedef __UINT64_TYPE__ uint64_t;
void *realloc(void *, size_t);

/* Kinds of nodes besides the operations of tape.h: numbers, inputs, what rounds once (a b + c, a b - c, c - a b). */
enum Kind { NUMBER = -5, INPUT, FMA, FMS, FNMA };
enum Answer { ARRANGED, WITHOUT_MEMORY, TOO_MANY };

/* What a node is, and the nodes that it takes, -1 where it takes none; of an input its argument and component. */
typedef struct { int32_t kind, a, b, c; } Node;

static int is_leaf(const Node *x) { return x->kind == NUMBER || x->kind == INPUT; }
static int of_one_alone(const Node *x, const char *uniform, int64_t same) { /* does it depend on this input alone, or on nothing? */
    if (is_leaf(x)) return x->kind == NUMBER || x->a == same;
    return uniform[x->a] && (x->b < 0 || uniform[x->b]) && (x->c < 0 || uniform[x->c]);
}

/* Memory that goes all at once, also where there is no more of it. */
typedef struct Block { struct Block *before, *after; } Block;
typedef struct { Block ends; jmp_buf out; int answer; } Memory;

static void leave_with(Memory *m, int answer) { m->answer = answer, longjmp(m->out, 1); }

static void *resized(Memory *m, void *old, int64_t size) {
    Block *block = old ? (Block *)old - 1 : 0;
    const Block links = block ? *block : (Block){&m->ends, m->ends.after};
    block = realloc(block, sizeof(Block) + size);
    if (!block) leave_with(m, WITHOUT_MEMORY);
    *block = links, links.before->after = block;
    if (links.after) links.after->before = block;
    return block + 1;
}

static void *room_for(Memory *m, int64_t size) { return resized(m, 0, size); }

static void give_back(void *old) {
    Block *const block = (Block *)old - 1;
    block->before->after = block->after;
    if (block->after) block->after->before = block->before;
    free(block);
}

static void give_all_back(Memory *m) { while (m->ends.after) give_back(m->ends.after + 1); }

/* Nodes, the values of those that are numbers, and where each is found; `unit` is the number 1, -1 until it is there. */
typedef struct {
    Memory *memory;
    Node *node;
    double *number;
    int32_t *slot;
    int64_t count, room;
    int32_t unit;
} Graph;

#define FEW_NODES 64 /* to begin with; twice as many slots as room, both powers of two */

static uint64_t mixed(uint64_t x) { return x *= 0x9E3779B97F4A7C15u, x ^= x >> 32, x *= 0xD6E8FEB86659FD93u, x ^ x >> 32; }

static int64_t place_of(const Graph *g, const Node *x, double number) {
    uint64_t key = (uint32_t)x->a | (uint64_t)(uint32_t)x->b << 32;
    if (x->kind == NUMBER) number += 0.0, memcpy(&key, &number, sizeof key); /* -0 is found where 0 is */
    const uint64_t last = 2 * g->room - 1;
    uint64_t k = mixed(key + mixed((uint32_t)x->kind | (uint64_t)(uint32_t)x->c << 32)) & last;
    for (;; k = (k + 1) & last) {
        const int32_t i = g->slot[k];
        if (i < 0) return k;
        const Node *const y = g->node + i;
        if (y->kind != x->kind) continue;
        if (x->kind == NUMBER ? g->number[i] == number || !memcmp(g->number + i, &number, sizeof number)
                              : y->a == x->a && y->b == x->b && y->c == x->c) return k;
    }
}

static void make_room(Graph *g, int64_t room) {
    if (room > __INT32_MAX__ / 2) leave_with(g->memory, TOO_MANY);
    g->room = room;
    g->node = resized(g->memory, g->node, room * sizeof *g->node);
    g->number = resized(g->memory, g->number, room * sizeof *g->number);
    g->slot = resized(g->memory, g->slot, 2 * room * sizeof *g->slot);
    memset(g->slot, -1, 2 * room * sizeof *g->slot);
    for (int64_t i = 0; i < g->count; i++) g->slot[place_of(g, g->node + i, g->number[i])] = i;
}

static Graph empty_graph(Memory *m) {
    Graph g = {.memory = m, .unit = -1};
    make_room(&g, FEW_NODES);
    return g;
}

static int commutes(int kind) {
    switch (kind) {
        case OP_add: case OP_mul: case OP_fmin: case OP_fmax: case OP_hypot: case OP_eq: case OP_ne: case OP_and: case OP_or: return 1;
        default: return 0;
    }
}

static int32_t as_node(Graph *g, Node x, double number) {
    if (commutes(x.kind) && x.a > x.b) x = (Node){x.kind, x.b, x.a, x.c};
    int64_t k = place_of(g, &x, number);
    if (g->slot[k] >= 0) return g->slot[k];
    if (g->count == g->room) make_room(g, 2 * g->room), k = place_of(g, &x, number);
    g->node[g->count] = x, g->number[g->count] = number;
    if (x.kind == NUMBER && number == 1.0) g->unit = g->count;
    return g->slot[k] = g->count++;
}

static int32_t number_node(Graph *g, double x) { return as_node(g, (Node){NUMBER, -1, -1, -1}, x); }
static int32_t node_of(Graph *g, int kind, int32_t a, int32_t b) { return as_node(g, (Node){kind, a, b, -1}, 0.0); }
static int32_t one(Graph *g) { return g->unit < 0 ? number_node(g, 1.0) : g->unit; }

/* a b, where one of them may be the number 1. */
static int32_t times(Graph *g, int32_t a, int32_t b) {
    if (a == g->unit) return b;
    return b == g->unit ? a : node_of(g, OP_mul, a, b);
}

/* base^exponent by repeated squaring. */
static int32_t whole_power(Graph *g, int32_t base, int64_t exponent) {
    int32_t result = one(g);
    for (int32_t square = base; exponent;) {
        if (exponent & 1) result = times(g, result, square);
        exponent >>= 1;
        if (exponent) square = node_of(g, OP_mul, square, square);
    }
    return result;
}

/* Which nodes the wanted ones depend on. */
static void find_needed(const Node *node, int64_t count, const int32_t *wanted, int64_t many, char *live) {
    memset(live, 0, count);
    for (int64_t i = 0; i < many; i++) live[wanted[i]] = 1;
    for (int64_t i = count - 1; i >= 0; i--) {
        if (!live[i] || is_leaf(node + i)) continue;
        live[node[i].a] = 1;
        if (node[i].b >= 0) live[node[i].b] = 1;
        if (node[i].c >= 0) live[node[i].c] = 1;
    }
}
