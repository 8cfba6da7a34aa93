/* Graphs arranged by what their operations depend on: products fused with sums, and two halves. The name ends in LEVEL, the
   instructions that are used.

   varint/codegen/dependence.py says what they are. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define fuse WITH_ALL(fuse, LEVEL)
#define halve WITH_ALL(halve, LEVEL)
#define LANES 1
#include "lanes.h"
#include "tape.h"
#include "graph.h"

/* A graph, and one that is made of it, which has not more nodes. */
typedef struct {
    const Node *node;
    const double *number;
    int32_t *wanted; /* the nodes of the outputs; after `fuse` those of the other graph */
    Node *other;
    double *other_number;
    int64_t *told; /* how many nodes it has; of halves also: how many the second takes from the first */
    int64_t nodes, outputs, same; /* same: the argument that is the same all the time */
} Fused;

static int adds(int kind) { return kind == OP_add || kind == OP_sub; }

int fuse(const Fused *x) {
    const int64_t n = x->nodes;
    char *const live = malloc(3 * n + 1), *const uniform = live + n, *const elsewhere = uniform + n; /* is taken not by sums alone */
    int32_t *const place = malloc((n + 1) * sizeof *place);
    if (!live || !place) return free(live), free(place), WITHOUT_MEMORY;
    find_needed(x->node, n, x->wanted, x->outputs, live);
    memset(elsewhere, 0, n);
    for (int64_t i = 0; i < x->outputs; i++) elsewhere[x->wanted[i]] = 1;
    for (int64_t i = 0; i < n; i++) {
        const Node *const o = x->node + i;
        uniform[i] = of_one_alone(o, uniform, x->same);
        if (!live[i] || is_leaf(o) || adds(o->kind)) continue;
        elsewhere[o->a] = 1;
        if (o->b >= 0) elsewhere[o->b] = 1;
    }
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        if (!live[i]) continue;
        Node o = x->node[i];
        if (!is_leaf(&o)) {
            int first = adds(o.kind) && x->node[o.a].kind == OP_mul && !uniform[o.a];
            const int second = adds(o.kind) && x->node[o.b].kind == OP_mul && !uniform[o.b];
            if (first && second) first = elsewhere[o.b] && !elsewhere[o.a];
            if (first || second) {
                const Node product = x->node[first ? o.a : o.b];
                o = (Node){o.kind == OP_add ? FMA : first ? FMS : FNMA, product.a, product.b, first ? o.b : o.a};
            }
            o.a = place[o.a];
            if (o.b >= 0) o.b = place[o.b];
            if (o.c >= 0) o.c = place[o.c];
        }
        x->other[count] = o, x->other_number[count] = x->number[i], place[i] = count++;
    }
    for (int64_t i = 0; i < x->outputs; i++) x->wanted[i] = place[x->wanted[i]];
    x->told[0] = count;
    return free(live), free(place), ARRANGED;
}

/* `wanted` are the outputs of the second half alone. */
typedef struct {
    Fused graph;
    int32_t *taken; /* the nodes of the first half that the second takes */
    int64_t late;   /* the argument that is known to the second half alone */
} Halved;

static void second_half(Memory *m, const Halved *a) {
    const Fused *const x = &a->graph;
    const int64_t n = x->nodes;
    char *const late = room_for(m, 3 * n), *const uniform = late + n, *const wanted = uniform + n;
    int32_t *const place = room_for(m, n * sizeof *place);
    int64_t taken = 0;
    memset(wanted, 0, n);
    for (int64_t i = 0; i < n; i++) {
        const Node *const o = x->node + i;
        uniform[i] = of_one_alone(o, uniform, x->same);
        late[i] = is_leaf(o) ? o->kind == INPUT && o->a == a->late : late[o->a] || (o->b >= 0 && late[o->b]);
    }
    for (int64_t i = 0; i < x->outputs; i++) wanted[x->wanted[i]] = 1;
    for (int64_t i = n - 1; i >= 0; i--) {
        const Node *const o = x->node + i;
        if (!wanted[i] || is_leaf(o) || !(late[i] || uniform[i])) continue;
        wanted[o->a] = 1;
        if (o->b >= 0) wanted[o->b] = 1;
    }
    Graph second = empty_graph(m);
    for (int64_t i = 0; i < n; i++) {
        if (!wanted[i]) continue;
        const Node o = x->node[i];
        if (o.kind == NUMBER) place[i] = number_node(&second, x->number[i]);
        else if (!(late[i] || uniform[i])) place[i] = node_of(&second, INPUT, 1, taken), a->taken[taken++] = i;
        else if (o.kind == INPUT) place[i] = node_of(&second, INPUT, late[i] ? 0 : 2, o.b);
        else place[i] = node_of(&second, o.kind, place[o.a], o.b < 0 ? -1 : place[o.b]);
    }
    memcpy(x->other, second.node, second.count * sizeof *second.node);
    memcpy(x->other_number, second.number, second.count * sizeof *second.number);
    for (int64_t i = 0; i < x->outputs; i++) x->wanted[i] = place[x->wanted[i]];
    x->told[0] = second.count, x->told[1] = taken;
}

static int halved(Memory *m, const Halved *a) {
    if (setjmp(m->out)) return m->answer;
    return second_half(m, a), ARRANGED;
}

int halve(const Halved *a) {
    Memory m = {0};
    const int answer = halved(&m, a);
    return give_all_back(&m), answer;
}
