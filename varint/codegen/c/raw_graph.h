/* CasADi's operations as a graph, one by one, and which of its nodes are bases of powers.

   graph.h and powers.h stand before this file. */
#define MOST_PRODUCTS 64 /* largest whole power written as products */

/* CasADi's operations that have other names in graphs: their places stand for them, or fewer kinds of operations. */
enum Read { OUTPUT = -11, SAME_VALUE, SQUARE, TWICE, INVERSE };

/* Operations as CasADi numbers them: their kinds, and how many places they take values from. Of an input its argument and
   component are taken, of a number nothing. */
typedef struct {
    const int32_t *code, *kind, *takes, *taken; /* of the operations; of the codes; one after the other */
    const int32_t *place, *end;                 /* where values go, null: to a new one each; where outputs are wanted */
    const double *number;
    int32_t *wanted; /* the nodes of the outputs */
    int64_t *told;   /* the graph, to be taken with `take_graph`, which frees it; its nodes */
    /* same: the argument that is the same all the time; whether roots stay roots, for x / sqrt(x) is none of zero */
    int64_t operations, places, outputs, same, roots;
} Rearranged;

/* How powers of a base are written: by a division each, by 1/sqrt(base), by 1/base. */
enum Kind_of_base { NO_BASE, DIVIDED, ROOT, RECIPROCAL };

/* One of CasADi's other kinds of operations in terms of fewer; powers by multiplication. */
static int32_t plain_power(Graph *g, int32_t base, double exponent) {
    if (exponent < 0) {
        const int32_t unit = one(g);
        return node_of(g, OP_div, unit, plain_power(g, base, -exponent));
    }
    const int32_t root = exponent == floor(exponent) ? one(g) : node_of(g, OP_sqrt, base, -1);
    return times(g, root, whole_power(g, base, (int64_t)exponent));
}

static int32_t plain(Graph *g, int kind, int32_t a, int32_t b) {
    switch (kind) {
        case SAME_VALUE: return a;
        case SQUARE: return node_of(g, OP_mul, a, a);
        case TWICE: return node_of(g, OP_mul, number_node(g, 2.0), a);
        case INVERSE: return node_of(g, OP_div, number_node(g, 1.0), a);
        case OP_pow: {
            const double exponent = g->number[b];
            if (g->node[b].kind == NUMBER && fabs(exponent) <= MOST_PRODUCTS && 2 * exponent == floor(2 * exponent))
                return plain_power(g, a, exponent);
        }
    }
    return node_of(g, kind, a, b);
}

/* The operations as a graph, one by one. */
static Graph raw_graph(Memory *m, const Rearranged *x) {
    Graph g = empty_graph(m);
    int32_t *const at = room_for(m, x->places * sizeof *at);
    const int32_t zero = number_node(&g, 0.0);
    memset(at, 0, x->places * sizeof *at);
    for (int64_t i = 0; i < x->outputs; i++) x->wanted[i] = zero;
    const int32_t *taken = x->taken;
    for (int64_t k = 0, values = 0, numbers = 0, ends = 0; k < x->operations; k++) {
        const int32_t kind = x->kind[x->code[k]], takes = x->takes[x->code[k]], *const from = taken;
        taken += takes;
        if (kind == OUTPUT) {
            x->wanted[x->end[ends++]] = at[from[0]];
            continue;
        }
        const int32_t place = x->place ? x->place[values] : values;
        values++;
        if (kind == NUMBER) at[place] = number_node(&g, x->number[numbers++]);
        else if (kind == INPUT) at[place] = node_of(&g, INPUT, from[0], from[1]);
        else at[place] = plain(&g, kind, at[from[0]], takes < 2 ? -1 : at[from[1]]);
    }
    return g;
}

/* A node as factor and base^e (base -1: a number), but for factors that are the same all the time. */
typedef struct { double c; int32_t base; int64_t e; } Monomial;

static Monomial monomial_of(const Monomial *known, const char *uniform, const Graph *g, int32_t i) {
    const Node n = g->node[i];
    const Monomial atom = {1.0, i, 4};
    if (n.kind == NUMBER) return (Monomial){g->number[i], -1, 0};
    if (n.kind != OP_neg && n.kind != OP_sqrt && n.kind != OP_mul) return atom;
    const Monomial x = known[n.a];
    if (n.kind == OP_neg) return (Monomial){-x.c, x.base, x.e};
    if (n.kind == OP_sqrt) return x.base >= 0 && x.c == 1.0 && has_root(x.e) ? (Monomial){1.0, x.base, x.e / 2} : atom;
    const Monomial y = known[n.b];
    if (x.e + y.e > MOST_EXPONENT) return atom;
    if (x.base < 0 || y.base < 0 || x.base == y.base) return (Monomial){x.c * y.c, x.base < 0 ? y.base : x.base, x.e + y.e};
    if (uniform[n.a] != uniform[n.b]) return uniform[n.a] ? (Monomial){y.c, y.base, y.e} : (Monomial){x.c, x.base, x.e};
    return atom;
}

/* Which nodes are bases whose powers are gathered: those below a root or a division, and how their powers are written. */
static char *bases_of(Memory *m, const Graph *g, const char *live, const char *uniform, int64_t roots) {
    char *const asked = room_for(m, 2 * g->count), *const bases = asked + g->count;
    char *const seen = room_for(m, g->count); /* divisions by a base: by how many, and by roots of it */
    enum { ONCE = 1, OFTEN = 2, BY_ROOTS = 4 };
    memset(asked, 0, 2 * g->count), memset(seen, 0, g->count);
    Monomial *const known = room_for(m, g->count * sizeof *known);
    for (int64_t i = 0; i < g->count; i++) {
        const Node n = g->node[i];
        if (live[i] && n.kind == OP_div) asked[n.b] = 1;
        if (live[i] && n.kind == OP_sqrt) asked[n.a] = 1;
    }
    for (int64_t i = g->count - 1; i >= 0; i--) {
        const Node n = g->node[i];
        if (!live[i] || !asked[i] || (n.kind != OP_neg && n.kind != OP_sqrt && n.kind != OP_mul)) continue;
        asked[n.a] = 1;
        if (n.b >= 0) asked[n.b] = 1;
    }
    for (int64_t i = 0; i < g->count; i++)
        if (asked[i]) known[i] = monomial_of(known, uniform, g, i);
    for (int64_t i = 0; i < g->count; i++) {
        const Node n = g->node[i];
        if (!live[i] || (n.kind != OP_div && n.kind != OP_sqrt)) continue;
        const Monomial x = known[n.kind == OP_div ? n.b : n.a];
        if (x.base < 0) continue;
        if (bases[x.base] == NO_BASE) bases[x.base] = DIVIDED;
        if (n.kind == OP_div && x.e > 0) seen[x.base] |= (seen[x.base] & ONCE ? OFTEN : ONCE) | (x.e % 4 ? BY_ROOTS : 0);
    }
    for (int64_t i = 0; i < g->count; i++) {
        if (seen[i] & BY_ROOTS && roots) continue;
        if (seen[i] & BY_ROOTS) bases[i] = ROOT;
        else if (seen[i] & OFTEN || (seen[i] && uniform[i])) bases[i] = RECIPROCAL;
    }
    return bases;
}
