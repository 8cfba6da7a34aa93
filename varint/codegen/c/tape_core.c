/* The operations of a graph as a tape: which are done once, in which turns the others are, and which registers they take.
   The name ends in LEVEL, the instructions that are used.

   varint/codegen/tape.py says what a tape is, and has the same layouts. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define arrange WITH_ALL(arrange, LEVEL)
#define LANES 1
#include "lanes.h"
#include "tape.h"
#include "graph.h"

#define MOST 65535 /* registers: operands are numbers of 16 bits */
/* Operations between one and another that takes its value, where there are others to do: so long it takes until a value that
   was written can be read. */
#define APART 8
#define RESERVED 2 /* registers: ONE and NOTHING */

typedef struct {
    const Node *node;
    const int32_t *output; /* the nodes that are wanted */
    Instruction *once, *often;
    Moved *input;
    int32_t *number, *place; /* nodes of the constants; registers of the outputs */
    int64_t *told;           /* uniforms, numbers, registers; how many once, often, inputs, constants; operations, roots */
    int64_t nodes, outputs, same; /* same: the argument that is the same all the time */
} Arranged;

/* An operation that waits for its turn, before those that are behind it. */
typedef struct { int64_t known, hanging, unit; } Waiting;
typedef struct { Waiting *first; int64_t count; } Queue;

static int before(const Waiting *x, const Waiting *y) {
    if (x->known != y->known) return x->known < y->known;
    return x->hanging != y->hanging ? x->hanging > y->hanging : x->unit < y->unit;
}

static void join(Queue *queue, Waiting x) {
    int64_t k = queue->count++;
    for (; k && before(&x, queue->first + (k - 1) / 2); k = (k - 1) / 2) queue->first[k] = queue->first[(k - 1) / 2];
    queue->first[k] = x;
}

static int64_t leave(Queue *queue) {
    const int64_t unit = queue->first->unit, many = --queue->count;
    const Waiting x = queue->first[many];
    int64_t k = 0;
    for (int64_t next; (next = 2 * k + 1) < many; k = next) {
        if (next + 1 < many && before(queue->first + next + 1, queue->first + next)) next++;
        if (!before(queue->first + next, &x)) break;
        queue->first[k] = queue->first[next];
    }
    queue->first[k] = x;
    return unit;
}

static int is_sum(int kind) {
    return kind == OP_add || kind == OP_sub || kind == OP_mul || kind == OP_neg || (kind >= FMA && kind <= FNMA);
}
static int code(int kind) { return is_sum(kind) ? OP_sum : kind == OP_rsqrt ? OP_rsqrt_exact : kind == INPUT ? OP_end : kind; }

/* Operations to do until a value can be read. */
static int64_t takes_time(int kind) {
    switch (kind) {
        case OP_div: return 2 * APART;
        case OP_sqrt: case OP_rsqrt: return 3 * APART;
        case OP_sin: case OP_cos: return 6 * APART;
        case OP_exp: return 5 * APART;
        case OP_pow: return 15 * APART;
        default: return APART;
    }
}

/* +-a b +- c, with ONE and NOTHING where one of them is missing. */
static Instruction as_sum(int kind, int result, int a, int b, int c) {
    switch (kind) {
        case OP_add: return (Instruction){OP_sum, result, a, ONE, b, 0};
        case OP_sub: return (Instruction){OP_sum, result, b, ONE, a, 1};
        case OP_mul: return (Instruction){OP_sum, result, a, b, NOTHING, 0};
        case OP_neg: return (Instruction){OP_sum, result, a, ONE, NOTHING, 1};
        default: return (Instruction){OP_sum, result, a, b, c, kind == FMS ? 2 : kind == FNMA ? 1 : 0};
    }
}

/* What varies among the nodes that one takes, each once. */
static int taken(const Node *x, const char *uniform, int32_t *found) {
    if (is_leaf(x)) return 0;
    int many = 0;
    const int32_t all[] = {x->a, x->b, x->c};
    for (int k = 0; k < 3; k++) {
        int known = all[k] < 0 || uniform[all[k]];
        for (int i = 0; i < many; i++) known |= found[i] == all[k];
        if (!known) found[many++] = all[k];
    }
    return many;
}

/* What the parameters alone decide, which of it the others take, and how it is computed. */
static int do_once(const Arranged *x, const char *uniform, const char *live, int32_t *place) {
    int64_t count = RESERVED, rows = 0, numbers = 0;
    for (int64_t i = 0; i < x->nodes; i++) {
        if (!live[i] || uniform[i] || is_leaf(x->node + i)) continue;
        const int32_t all[] = {x->node[i].a, x->node[i].b, x->node[i].c};
        for (int k = 0; k < 3; k++)
            if (all[k] >= 0 && uniform[all[k]] && place[all[k]] < 0) place[all[k]] = count++;
    }
    for (int64_t i = 0; i < x->outputs; i++)
        if (uniform[x->output[i]] && place[x->output[i]] < 0) place[x->output[i]] = count++;
    x->told[0] = count;
    for (int64_t i = 0; i < x->nodes; i++) {
        if (!live[i] || !uniform[i]) continue;
        const Node *const n = x->node + i;
        if (place[i] < 0) place[i] = count++;
        if (count > MOST || (n->kind == INPUT && n->b > MOST)) return TOO_MANY;
        if (n->kind == NUMBER) {
            x->once[rows++] = (Instruction){OP_constant, place[i], numbers};
            x->number[numbers++] = i;
        } else if (n->kind == INPUT)
            x->once[rows++] = (Instruction){OP_parameter, place[i], n->b};
        else
            x->once[rows++] = (Instruction){n->kind, place[i], place[n->a], n->b < 0 ? 0 : place[n->b]};
    }
    x->once[rows++] = (Instruction){OP_end};
    x->told[1] = count, x->told[3] = rows, x->told[6] = numbers;
    return ARRANGED;
}

/* Sine and cosine of one angle are one operation: the nodes of both, at the first of them; -1 for the second of one node alone. */
typedef struct { int32_t one, other; } Unit;

static int64_t units_of(const Arranged *x, const char *uniform, const char *live, int32_t *angle, Unit *unit) {
    int64_t many = 0;
    for (int64_t i = 0; i < 2 * x->nodes; i++) angle[i] = -1;
    for (int64_t i = 0; i < x->nodes; i++) {
        const Node *const n = x->node + i;
        if (live[i] && !uniform[i] && (n->kind == OP_sin || n->kind == OP_cos)) angle[2 * n->a + (n->kind == OP_cos)] = i;
    }
    for (int64_t i = 0; i < x->nodes; i++) {
        const Node *const n = x->node + i;
        if (!live[i] || uniform[i]) continue;
        x->told[7]++, x->told[8] += n->kind == OP_sqrt || n->kind == OP_rsqrt;
        Unit found = {i, -1};
        if (n->kind == OP_sin || n->kind == OP_cos) {
            const int32_t sine = angle[2 * n->a], cosine = angle[2 * n->a + 1];
            if (sine >= 0 && cosine >= 0 && (i == sine || i == cosine)) {
                if (i > sine || i > cosine) continue;
                found = (Unit){sine, cosine};
            }
        }
        unit[many++] = found;
    }
    return many;
}

/* The operations in an order for speed: the same kind again where there is one whose operands are known; among those, first
   what does not wait for the ones just before, and then what the longest chain of others hangs on. */
static void in_turns(const Arranged *x, const char *uniform, const Unit *unit, int64_t many, int32_t *memory, int64_t *longs,
                     Waiting *waiting, int32_t *order) {
    int32_t *const unit_of = memory, *const head = unit_of + x->nodes, *const missing = head + many, *const next = missing + many,
                   *const user = next + 3 * many, found[3];
    int64_t *const hanging = longs, *const known = longs + many, entries = 0;
    Queue queues[OP_sincos + 1] = {0};
    int appeared[OP_sincos + 1], kinds = 0, now = -1;
    for (int64_t k = 0; k < many; k++) {
        unit_of[unit[k].one] = k;
        if (unit[k].other >= 0) unit_of[unit[k].other] = k;
        queues[code(x->node[unit[k].one].kind)].count++;
        head[k] = -1, known[k] = 0, hanging[k] = takes_time(x->node[unit[k].one].kind);
    }
    for (int i = 0; i <= OP_sincos; i++) queues[i].first = waiting, waiting += queues[i].count, queues[i].count = 0;
    for (int64_t k = 0; k < many; k++) {
        missing[k] = taken(x->node + unit[k].one, uniform, found);
        for (int i = 0; i < missing[k]; i++, entries++)
            user[entries] = k, next[entries] = head[unit_of[found[i]]], head[unit_of[found[i]]] = entries;
    }
    for (int64_t k = many - 1; k >= 0; k--)
        for (int i = taken(x->node + unit[k].one, uniform, found) - 1; i >= 0; i--) {
            const int64_t j = unit_of[found[i]], chain = hanging[k] + takes_time(x->node[unit[j].one].kind);
            if (hanging[j] < chain) hanging[j] = chain;
        }
#define READY(j) do { \
        const int kind = code(x->node[unit[j].one].kind); \
        int i = 0; \
        while (i < kinds && appeared[i] != kind) i++; \
        if (i == kinds) appeared[kinds++] = kind; \
        join(queues + kind, (Waiting){known[j] / APART, hanging[j], j}); \
    } while (0)
    for (int64_t k = 0; k < many; k++)
        if (!missing[k]) READY(k);
    for (int64_t turn = 1; turn <= many; turn++) {
        if (now < 0 || !queues[now].count) {
            now = -1;
            for (int i = 0; i < kinds; i++) {
                const Queue *const queue = queues + appeared[i];
                if (queue->count && (now < 0 || queue->first->hanging > queues[now].first->hanging)) now = appeared[i];
            }
        }
        const int64_t k = leave(queues + now), then = turn + takes_time(x->node[unit[k].one].kind);
        order[turn - 1] = k;
        for (int32_t e = head[k]; e >= 0; e = next[e]) {
            const int64_t j = user[e];
            if (known[j] < then) known[j] = then;
            if (!--missing[j]) READY(j);
        }
    }
}

/* The operations of a call; a register is used again once its value has been taken for the last time. */
static int64_t do_often(const Arranged *x, const char *uniform, const char *end, const Unit *unit, const int32_t *order,
                        int64_t many, int32_t *place, int32_t *last, int32_t *unused) {
    int64_t count = x->told[0], rows = 0, inputs = 0, left = 0;
    int32_t found[3];
    for (int64_t i = 0; i < x->nodes; i++) last[i] = -1;
    for (int64_t k = 0; k < many; k++) {
        const Node *const n = x->node + unit[order[k]].one;
        for (int i = taken(n, uniform, found) - 1; i >= 0; i--) last[found[i]] = k;
        if (n->kind != INPUT) continue;
        if (n->a > MOST || n->b > MOST) return MOST + 1;
        place[unit[order[k]].one] = count;
        x->input[inputs++] = (Moved){n->a, n->b, count++};
    }
    for (int64_t k = 0; k < many; k++) {
        const Unit of = unit[order[k]];
        const Node *const n = x->node + of.one;
        if (n->kind == INPUT) continue;
        const int a = place[n->a], b = n->b < 0 ? 0 : place[n->b], c = n->c < 0 ? 0 : place[n->c];
        const int takes = taken(n, uniform, found);
        for (int i = 0; i < takes; i++)
            if (last[found[i]] == k && !end[found[i]]) unused[left++] = place[found[i]];
        place[of.one] = left ? unused[--left] : count++;
        if (of.other >= 0) place[of.other] = left ? unused[--left] : count++;
        if (of.other >= 0) x->often[rows++] = (Instruction){OP_sincos, place[of.one], a, place[of.other]};
        else if (is_sum(n->kind)) x->often[rows++] = as_sum(n->kind, place[of.one], a, b, c);
        else x->often[rows++] = (Instruction){code(n->kind), place[of.one], a, b};
        if (last[of.one] < 0 && !end[of.one]) unused[left++] = place[of.one];
        if (of.other >= 0 && last[of.other] < 0 && !end[of.other]) unused[left++] = place[of.other];
    }
    x->often[rows++] = (Instruction){OP_end};
    x->told[2] = count, x->told[4] = rows, x->told[5] = inputs;
    return count;
}

int arrange(const Arranged *x) {
    const int64_t n = x->nodes;
    char *const uniform = malloc(3 * n + 1), *const live = uniform + n, *const end = live + n;
    int32_t *const place = malloc((14 * n + 1) * sizeof(int32_t)), *const order = place + n, *const memory = order + n;
    int64_t *const longs = malloc((2 * n + 1) * sizeof(int64_t));
    Waiting *const waiting = malloc((n + 1) * sizeof(Waiting));
    Unit *const unit = malloc((n + 1) * sizeof(Unit));
    int answer = uniform && place && longs && waiting && unit ? ARRANGED : WITHOUT_MEMORY;
    if (answer == ARRANGED) memset(uniform, 0, 3 * n);
    for (int64_t i = 0; answer == ARRANGED && i < n; i++) place[i] = -1, uniform[i] = of_one_alone(x->node + i, uniform, x->same);
    if (answer == ARRANGED) {
        find_needed(x->node, n, x->output, x->outputs, live);
        for (int64_t i = 0; i < x->outputs; i++) end[x->output[i]] = 1;
    }
    if (answer == ARRANGED) answer = do_once(x, uniform, live, place);
    if (answer == ARRANGED) {
        const int64_t many = units_of(x, uniform, live, memory, unit);
        in_turns(x, uniform, unit, many, memory, longs, waiting, order);
        if (do_often(x, uniform, end, unit, order, many, place, memory, memory + n) > MOST) answer = TOO_MANY;
        for (int64_t i = 0; i < x->outputs; i++) x->place[i] = place[x->output[i]];
    }
    free(uniform), free(place), free(longs), free(waiting), free(unit);
    return answer;
}
