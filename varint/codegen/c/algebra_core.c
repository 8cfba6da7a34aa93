/* The operations of an SX function rearranged for speed. The name ends in LEVEL, the instructions that are used.

   Equal operations appear once; numerical factors and powers move to the outside of products, where those of equal bases merge
   and cancel; whole, half and quarter powers become multiplications and square roots, and divisions by powers of one expression
   share one reciprocal. Each rewriting is exact or costs one rounding. varint/codegen/algebra.py reads CasADi's operations and
   takes the graph. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define rearrange WITH_ALL(rearrange, LEVEL)
#define take_graph WITH_ALL(take_graph, LEVEL)
#define LANES 1
#include "lanes.h"
#include "tape.h"
#include "graph.h"
#include "powers.h"
#include "raw_graph.h"

#define FEW_TERMS 8     /* of a sum that is looked into, since some may cancel where it is used */
#define MOST_FACTOR 1e100 /* and one over it: numbers that products gather */
#define LONGEST_CHAIN 6 /* terms of a sum added one after the other; longer sums are split, for latency */

typedef struct { double c; int32_t a, powers; } Term; /* factor, node and powers of a product */
typedef struct { Term *term; int64_t many; } Sum;
typedef struct { double size; Sum terms; int32_t common; } Part; /* a short sum is all its terms over size and powers */
typedef struct { const Part *part; char base, constant; } About;

/* What becomes of a raw graph, node by node. */
typedef struct {
    Memory *memory;
    const Graph *raw;
    const char *bases, *uniform; /* of raw nodes: whose powers are gathered, and how; which are the same all the time */
    Graph graph;
    Lists lists;
    Arena lasting, passing; /* memory until the end, and while one node is rewritten */
    Sum *sum;               /* of the raw nodes, as long as they are used */
    About *about;           /* of the new nodes */
    int64_t told_about;
} Rewriting;

static About *about(Rewriting *r, int32_t node) {
    if (node >= r->told_about) {
        const int64_t before = r->told_about;
        r->told_about = r->graph.room;
        r->about = resized(r->memory, r->about, r->told_about * sizeof *r->about);
        memset(r->about + before, 0, (r->told_about - before) * sizeof *r->about);
    }
    return r->about + node;
}

static void set_base(Rewriting *r, int32_t node, int kind) {
    if (about(r, node)->base == NO_BASE) about(r, node)->base = kind;
}

static Sum room_of(Arena *arena, int64_t many) { return (Sum){from(arena, many * sizeof(Term)), many}; }

static Sum single(Rewriting *r, double c, int32_t a, int32_t powers) {
    const Sum x = room_of(&r->passing, 1);
    return x.term[0] = (Term){c, a, powers}, x;
}

/* The powers of a product, of its inverse where `sign` is -1. */
static int32_t joined_with(Rewriting *r, int32_t powers, int32_t more, int sign) {
    if (!more) return powers;
    const int64_t m = length_of(&r->lists, powers), n = length_of(&r->lists, more);
    Power *const found = from(&r->passing, (m + n) * sizeof *found);
    const Power *const x = powers_of(&r->lists, powers), *const y = powers_of(&r->lists, more);
    int64_t many = 0;
    for (int64_t i = 0, j = 0; i < m || j < n;) {
        const int32_t base = j == n || (i < m && x[i].base < y[j].base) ? x[i].base : y[j].base;
        int64_t e = 0;
        if (i < m && x[i].base == base) e += x[i++].e;
        if (j < n && y[j].base == base) e += sign * y[j++].e;
        if (e > MOST_EXPONENT || e < -MOST_EXPONENT) leave_with(r->memory, TOO_MANY);
        if (e) found[many++] = (Power){base, e};
    }
    return list_of(&r->lists, found, many);
}

static int32_t joined(Rewriting *r, int32_t powers, int32_t more) { return powers ? joined_with(r, powers, more, 1) : more; }
static int32_t over(Rewriting *r, int32_t powers, int32_t below) { return joined_with(r, powers, below, -1); }
static int32_t power_list(Rewriting *r, int32_t base, int64_t e) { return list_of(&r->lists, &(Power){base, e}, 1); }

/* base^(exponent / 4), by products, roots, and the reciprocal that the kind says. */
static int32_t power_of(Rewriting *r, int32_t base, int64_t exponent, int kind) {
    Graph *const g = &r->graph;
    if (exponent == 4) return base;
    if (exponent < 0 && kind != ROOT) return power_of(r, node_of(g, OP_div, one(g), base), -exponent, DIVIDED);
    const int64_t quarters = exponent < 0 ? -exponent : exponent;
    int32_t parts[3], many = 0;
    if (quarters & 1) parts[many++] = node_of(g, OP_sqrt, node_of(g, OP_sqrt, base, -1), -1); /* two roots side by side */
    const int32_t inverse_root = kind == ROOT && (quarters & 2 || exponent < 0) ? node_of(g, OP_rsqrt, base, -1) : -1;
    if (exponent < 0) parts[many++] = whole_power(g, inverse_root, (quarters + (quarters & 1)) / 2); /* x^-1/4 = x^1/4 x^-1/2 */
    else {
        if (quarters & 2) parts[many++] = inverse_root < 0 ? node_of(g, OP_sqrt, base, -1) : node_of(g, OP_mul, base, inverse_root);
        parts[many++] = whole_power(g, base, quarters / 4);
    }
    int32_t result = one(g);
    for (int i = 0; i < many; i++) result = times(g, result, parts[i]);
    return result;
}

/* a and powers as a node; the powers come first, so that several nodes can share them. */
static int32_t with_powers(Rewriting *r, int32_t a, int32_t powers) {
    Graph *const g = &r->graph;
    int32_t same = one(g), varying = same;
    if (!powers) return a;
    for (int64_t i = 0, many = length_of(&r->lists, powers); i < many; i++) {
        const Power x = powers_of(&r->lists, powers)[i];
        const int32_t power = power_of(r, x.base, x.e, about(r, x.base)->base);
        if (about(r, x.base)->constant) same = times(g, same, power);
        else varying = times(g, varying, power);
    }
    const int32_t whole = times(g, same, varying);
    if (varying == g->unit) about(r, whole)->constant = 1;
    return times(g, a, whole);
}

static int32_t with_factor(Rewriting *r, double c, int32_t a) {
    Graph *const g = &r->graph;
    if (c == 1.0 && a != g->unit) return a;
    if (a == g->unit || c == 0.0) return number_node(g, c);
    return c == -1.0 ? node_of(g, OP_neg, a, -1) : node_of(g, OP_mul, number_node(g, c), a);
}

/* Of a term among others: 1, -1, other positive factors, negative ones. */
static int turn_of(double c) { return c == 1.0 ? 0 : c == -1.0 ? 1 : c < 0 ? 3 : 2; }

/* The sum of factors and nodes as a node: terms without a factor first, so that each further one is a fused multiply-add. */
static int32_t added(Rewriting *r, Sum x) {
    Graph *const g = &r->graph;
    if (x.many > LONGEST_CHAIN) {
        const int64_t half = x.many / 2;
        const int32_t first = added(r, (Sum){x.term, half});
        return node_of(g, OP_add, first, added(r, (Sum){x.term + half, x.many - half}));
    }
    int32_t total = -1;
    for (int turn = 0; turn < 4; turn++)
        for (int64_t i = 0; i < x.many; i++) {
            const Term t = x.term[i];
            if (turn_of(t.c) != turn) continue;
            if (total < 0) total = with_factor(r, t.c, t.a);
            else total = node_of(g, t.c < 0 ? OP_sub : OP_add, total, with_factor(r, fabs(t.c), t.a));
        }
    return total;
}

/* The sum of factors and nodes; a factor common to all stays outside. */
static Term factored(Rewriting *r, Sum x) {
    if (x.many == 1) return x.term[0];
    Graph *const g = &r->graph;
    double size = fabs(x.term[0].c);
    int alike = size != 1.0 && size != 0.0;
    for (int64_t i = 0; alike && i < x.many; i++) alike = fabs(x.term[i].c) == size && x.term[i].a != g->unit;
    if (!alike) size = 1.0;
    const Sum terms = room_of(&r->passing, x.many);
    int64_t same = 0, many = 0;
    for (int once = 1; once >= 0; once--) { /* what is not waited for first */
        for (int64_t i = 0; i < x.many; i++) {
            const Term t = x.term[i];
            if ((t.a == g->unit || about(r, t.a)->constant) == once) terms.term[many++] = (Term){t.c / size, t.a, 0};
        }
        if (once) same = many;
    }
    if (same < 2 || same == x.many) return (Term){size, added(r, terms), 0};
    terms.term[same - 1] = (Term){1.0, added(r, (Sum){terms.term, same}), 0}; /* added up once */
    about(r, terms.term[same - 1].a)->constant = 1;
    return (Term){size, added(r, (Sum){terms.term + same - 1, x.many - same + 1}), 0};
}

/* The powers that are factors of all, but for what is the same all the time, where it is not all of them: other sums may share
   it with the factors beside it. */
static int32_t common_powers(Rewriting *r, Sum x) {
    const int32_t first = x.term[0].powers;
    int alike = 1;
    for (int64_t i = 0; i < x.many; i++) {
        if (!x.term[i].powers) return 0;
        alike &= x.term[i].powers == first;
    }
    if (alike) return first;
    int64_t many = 0, length = length_of(&r->lists, first);
    Power *const found = from(&r->passing, length * sizeof *found);
    for (int64_t k = 0; k < length; k++) {
        const Power p = powers_of(&r->lists, first)[k];
        int64_t least = p.e, most = p.e;
        for (int64_t i = 1; i < x.many && (least > 0 || most < 0); i++) {
            const Power *const other = powers_of(&r->lists, x.term[i].powers);
            int64_t e = 0;
            for (int64_t j = 0, n = length_of(&r->lists, x.term[i].powers); j < n && other[j].base <= p.base; j++)
                if (other[j].base == p.base) e = other[j].e;
            if (e < least) least = e;
            if (e > most) most = e;
        }
        if (!about(r, p.base)->constant && (least > 0 || most < 0)) found[many++] = (Power){p.base, least > 0 ? least : most};
    }
    return list_of(&r->lists, found, many);
}

/* The base that most of the terms' powers multiply or divide by, and which of it; of several the last; no base below two. */
typedef struct { int32_t base; int up; } Shared;

static Shared most_shared(Rewriting *r, const int32_t *powers, int64_t many) {
    int64_t all = 0, best = 1;
    for (int64_t i = 0; i < many; i++) all += length_of(&r->lists, powers[i]);
    Keys which = no_keys(&r->passing, all);
    int64_t *const counts = from(&r->passing, all * sizeof *counts);
    uint64_t found = 0;
    memset(counts, 0, all * sizeof *counts);
    for (int64_t i = 0; i < many; i++)
        for (int64_t j = 0, n = length_of(&r->lists, powers[i]); j < n; j++) {
            const Power p = powers_of(&r->lists, powers[i])[j];
            if (!about(r, p.base)->constant) counts[place_among(&which, 2 * (uint64_t)p.base + (p.e > 0))]++;
        }
    for (int64_t k = 0; k < which.many; k++)
        if (counts[k] > best || (counts[k] == best && best > 1 && which.key[k] > found)) best = counts[k], found = which.key[k];
    return best > 1 ? (Shared){found / 2, found % 2} : (Shared){-1, 0};
}

static int holds(const Rewriting *r, int32_t powers, Shared x) {
    const Power *const p = powers_of(&r->lists, powers);
    for (int64_t j = 0, n = length_of(&r->lists, powers); j < n; j++)
        if (p[j].base == x.base && (p[j].e > 0) == x.up) return 1;
    return 0;
}

static Term term_of(Rewriting *r, Sum x);

/* The terms over the powers that they have in common, those that share a factor added up before they are multiplied by it, so
   that it is not waited for. */
static Sum by_powers(Rewriting *r, Sum x, int32_t common) {
    const int64_t n = x.many;
    int32_t *const group = from(&r->passing, 2 * n * sizeof *group), *const powers = group + n; /* of each term; of each group */
    Keys groups = no_keys(&r->passing, n);
    for (int64_t i = 0; i < n; i++) {
        const int32_t rest = over(r, x.term[i].powers, common);
        group[i] = place_among(&groups, rest), powers[group[i]] = rest;
    }
    int64_t found = 0, open = groups.many;
    const int64_t many = open;
    int32_t *const first = from(&r->passing, (2 * many + 1) * sizeof *first), *const at = first + many + 1;
    memset(first, 0, (many + 1) * sizeof *first);
    for (int64_t i = 0; i < n; i++) first[group[i] + 1]++;
    for (int64_t k = 0; k < many; k++) at[k] = first[k], first[k + 1] += first[k];
    Sum sorted = room_of(&r->passing, n), result = room_of(&r->passing, many);
    for (int64_t i = 0; i < n; i++) sorted.term[at[group[i]]++] = (Term){x.term[i].c, x.term[i].a, 0};
    int32_t *const left = at; /* the groups that are open */
    for (int64_t k = 0; k < many; k++) left[k] = k;
    int32_t *const of = from(&r->passing, many * sizeof *of);
    for (;;) {
        for (int64_t k = 0; k < open; k++) of[k] = powers[left[k]];
        const Shared shared = most_shared(r, of, open);
        if (shared.base < 0) break;
        Sum parts = room_of(&r->passing, n);
        int64_t still = 0;
        int below = 1;
        parts.many = 0;
        for (int64_t k = 0; k < open; k++) {
            const int32_t j = left[k];
            if (!holds(r, powers[j], shared)) {
                left[still++] = j;
                continue;
            }
            for (int32_t i = first[j]; i < first[j + 1]; i++) {
                below &= sorted.term[i].c < 0;
                parts.term[parts.many++] = (Term){sorted.term[i].c, sorted.term[i].a, powers[j]};
            }
        }
        open = still;
        const double sign = below ? -1.0 : 1.0;
        for (int64_t i = 0; i < parts.many; i++) parts.term[i].c *= sign;
        const Term t = term_of(r, parts);
        result.term[found++] = (Term){sign * t.c, with_powers(r, t.a, t.powers), 0};
    }
    for (int64_t k = 0; k < open; k++) {
        const int32_t j = left[k];
        const Term t = factored(r, (Sum){sorted.term + first[j], first[j + 1] - first[j]});
        result.term[found++] = (Term){t.c, with_powers(r, t.a, powers[j]), 0};
    }
    return result.many = found, result;
}

/* A sum as factor, node and powers; what all terms have in common stays outside, also of some of them. */
static Term term_of(Rewriting *r, Sum x) {
    if (x.many == 1) return x.term[0];
    const int32_t common = common_powers(r, x);
    const Term whole = factored(r, by_powers(r, x, common));
    if (x.many <= FEW_TERMS) {
        Part *const part = from(&r->lasting, sizeof *part);
        *part = (Part){whole.c, room_of(&r->lasting, x.many), common};
        memcpy(part->terms.term, x.term, x.many * sizeof *x.term);
        about(r, whole.a)->part = part;
    }
    return (Term){whole.c, whole.a, common};
}

static int32_t sum_node(Rewriting *r, Sum x) {
    const Term t = term_of(r, x);
    return with_factor(r, t.c, t.c != 0.0 ? with_powers(r, t.a, t.powers) : t.a);
}

static Sum scaled(Rewriting *r, Sum x, double factor) {
    const Sum y = room_of(&r->passing, x.many);
    for (int64_t i = 0; i < x.many; i++) y.term[i] = x.term[i], y.term[i].c = factor * x.term[i].c;
    return y;
}

static Sum both(Rewriting *r, Sum x, Sum y, double sign) {
    const Sum all = room_of(&r->passing, x.many + y.many);
    memcpy(all.term, x.term, x.many * sizeof *x.term);
    for (int64_t i = 0; i < y.many; i++) all.term[x.many + i] = y.term[i], all.term[x.many + i].c *= sign;
    return all;
}

/* Like terms added up. */
static Sum merged(Rewriting *r, Sum x) {
    const Term *const t = x.term;
    if (x.many == 2 && (t[0].a != t[1].a || t[0].powers != t[1].powers) && t[0].c != 0.0 && t[1].c != 0.0) return x;
    Keys places = no_keys(&r->passing, x.many);
    Sum y = room_of(&r->passing, x.many);
    for (int64_t i = 0; i < x.many; i++) {
        const int64_t before = places.many, k = place_among(&places, (uint32_t)t[i].a | (uint64_t)t[i].powers << 32);
        if (k == before) y.term[k] = (Term){0.0, t[i].a, t[i].powers};
        y.term[k].c += t[i].c;
    }
    int64_t kept = 0, zeros = 0;
    const int64_t many = places.many;
    for (int64_t i = 0; i < many; i++) zeros += y.term[i].c == 0.0;
    if (many == x.many && !zeros) return x;
    for (int64_t i = 0; i < many; i++)
        if (y.term[i].c != 0.0) y.term[kept++] = y.term[i];
    return kept ? (Sum){y.term, kept} : single(r, 0.0, t[0].a, t[0].powers);
}

/* The sum with the terms of the sums in it: some may cancel. */
static Sum expanded(Rewriting *r, Sum x) {
    int64_t many = 0;
    for (int64_t i = 0; i < x.many; i++) {
        const Part *const part = about(r, x.term[i].a)->part;
        many += part ? part->terms.many : 1;
    }
    Sum y = room_of(&r->passing, many);
    y.many = 0;
    for (int64_t i = 0; i < x.many; i++) {
        const Term t = x.term[i];
        const Part *const part = about(r, t.a)->part;
        if (!part) {
            y.term[y.many++] = t;
            continue;
        }
        const int32_t rest = over(r, t.powers, part->common);
        for (int64_t k = 0; k < part->terms.many; k++) {
            const Term d = part->terms.term[k];
            y.term[y.many++] = (Term){t.c * (d.c / part->size), d.a, joined(r, rest, d.powers)};
        }
    }
    return y;
}

/* Whether all terms are what is given, as places are, or numbers: their differences have no round-off where they are alike. */
static int is_given(const Rewriting *r, Sum x) {
    for (int64_t i = 0; i < x.many; i++) {
        const Term t = x.term[i];
        if (t.powers || (t.a != r->graph.unit && r->graph.node[t.a].kind != INPUT)) return 0;
    }
    return x.many > 1;
}

/* Like terms added up, also those of the sums in it where some of them cancel. */
static Sum added_up(Rewriting *r, Sum x) {
    const Sum brief = merged(r, x);
    int64_t least = INT64_MAX;
    for (int64_t i = 0; i < x.many; i++) {
        const Part *const part = about(r, x.term[i].a)->part;
        if (!part) continue;
        const int64_t most = brief.many - is_given(r, part->terms);
        if (most < least) least = most;
    }
    if (least == INT64_MAX) return brief;
    const Sum looked_into = merged(r, expanded(r, x));
    return looked_into.many <= least ? looked_into : brief;
}

static int is_number(const Rewriting *r, Sum x) { return x.many == 1 && x.term[0].a == r->graph.unit && !x.term[0].powers; }

/* A number of times a sum; a sum of what is given stays together: K x - K y, or (K + k) x - K y where k x is added to it, would
   err by last digits of K x where x - y has none, and on one side of a stiff spring by others than on the other. */
static Sum so_many_times(Rewriting *r, Sum x, double factor) {
    if (fabs(factor) == 1.0 || factor == 0.0 || !is_given(r, x)) return scaled(r, x, factor);
    const Term t = term_of(r, x);
    return single(r, factor * t.c, t.a, t.powers);
}

/* Whether factors can be gathered in one: far outside of what numbers have room for they make powers of lengths overflow, where
   these are a millionth of the unit, that together are of usual size. */
static int is_usual(double c, Term s, Term t) {
    return s.c == 0.0 || t.c == 0.0 || !(s.powers || t.powers) || (fabs(c) >= 1 / MOST_FACTOR && fabs(c) <= MOST_FACTOR);
}

static Term by_itself(Rewriting *r, Term t) { return (Term){1.0, with_factor(r, t.c, with_powers(r, t.a, t.powers)), 0}; }

static Sum product(Rewriting *r, Sum x, Sum y) {
    if (is_number(r, x)) return so_many_times(r, y, x.term[0].c);
    if (is_number(r, y)) return so_many_times(r, x, y.term[0].c);
    Term s = term_of(r, x), t = term_of(r, y);
    if (!is_usual(s.c * t.c, s, t)) s = by_itself(r, s), t = by_itself(r, t);
    return single(r, s.c * t.c, times(&r->graph, s.a, t.a), joined(r, s.powers, t.powers));
}

static Sum quotient(Rewriting *r, Sum x, Sum y) {
    Graph *const g = &r->graph;
    Term below = term_of(r, y);
    if (below.c != 0.0 && below.a == g->unit && !below.powers) return so_many_times(r, x, 1.0 / below.c);
    Term above = term_of(r, x);
    if (!is_usual(above.c / below.c, above, below)) above = by_itself(r, above), below = by_itself(r, below);
    if (below.c == 0.0) {
        const int32_t a = sum_node(r, x);
        return single(r, 1.0, node_of(g, OP_div, a, sum_node(r, y)), 0);
    }
    const int32_t powers = over(r, above.powers, below.powers);
    const int64_t many = length_of(&r->lists, powers);
    Power *const alone = from(&r->passing, 2 * many * sizeof *alone), *const others = alone + many;
    int64_t divisions = 0, rest = 0;
    for (int64_t i = 0; i < many; i++) {
        const Power p = powers_of(&r->lists, powers)[i];
        if (p.e < 0 && about(r, p.base)->base <= DIVIDED) alone[divisions++] = (Power){p.base, -p.e}; /* one division for all its users */
        else others[rest++] = p;
    }
    const int32_t left = list_of(&r->lists, others, rest);
    const int32_t bottom = with_powers(r, below.a, list_of(&r->lists, alone, divisions));
    return single(r, above.c / below.c, bottom == g->unit ? above.a : node_of(g, OP_div, above.a, bottom), left);
}

/* |x| or the sign of x, of a product factor by factor: even powers and roots have none, and that of what is the same all the
   time is found once. */
static Sum factor_by_factor(Rewriting *r, int kind, Sum x) {
    Graph *const g = &r->graph;
    const Term t = term_of(r, x);
    const int64_t many = length_of(&r->lists, t.powers);
    Power *const sorted = from(&r->passing, 3 * many * sizeof *sorted); /* positive, the same all the time, varying */
    int64_t count[3] = {0};
    for (int64_t i = 0; i < many; i++) {
        const Power p = powers_of(&r->lists, t.powers)[i];
        int which = about(r, p.base)->constant ? 1 : 2;
        if ((p.e & 7) != 4 && (p.e < 0 || kind == OP_fabs)) which = 0; /* no zero, whose sign is 0 */
        sorted[which * many + count[which]++] = p;
    }
    int32_t found = kind == OP_fabs ? list_of(&r->lists, sorted, count[0]) : 0;
    if (count[1]) {
        const int32_t unit = one(g), same = with_powers(r, unit, list_of(&r->lists, sorted + many, count[1]));
        const int32_t once = node_of(g, kind, same, -1);
        about(r, once)->constant = 1, set_base(r, once, RECIPROCAL);
        found = joined(r, found, power_list(r, once, 4));
    }
    const int32_t whole = with_powers(r, t.a, list_of(&r->lists, sorted + 2 * many, count[2]));
    const double size = kind == OP_fabs ? fabs(t.c) : (t.c > 0) - (t.c < 0);
    return single(r, size, whole == g->unit ? whole : node_of(g, kind, whole, -1), found);
}

/* Node i of the raw graph as a sum of terms. */
static Sum rewritten(Rewriting *r, int32_t i) {
    Graph *const g = &r->graph;
    const Node n = r->raw->node[i];
    if (n.kind == NUMBER) return single(r, r->raw->number[i], one(g), 0);
    if (n.kind == INPUT) return single(r, 1.0, as_node(g, n, 0.0), 0);
    const Sum x = r->sum[n.a], y = n.b < 0 ? x : r->sum[n.b];
    switch (n.kind) {
        case OP_mul: return product(r, x, y);
        case OP_add: return added_up(r, both(r, x, y, 1.0));
        case OP_sub: return added_up(r, both(r, x, y, -1.0));
        case OP_neg: return scaled(r, x, -1.0);
        case OP_div: return quotient(r, x, y);
        case OP_fabs: case OP_sign: return factor_by_factor(r, n.kind, x);
        case OP_sqrt: {
            const Term t = term_of(r, x);
            if (t.c != 1.0 || t.a != g->unit || length_of(&r->lists, t.powers) != 1) break;
            const Power p = powers_of(&r->lists, t.powers)[0];
            if (has_root(p.e)) return single(r, 1.0, t.a, power_list(r, p.base, p.e / 2));
        }
    }
    const int32_t a = sum_node(r, x);
    return single(r, 1.0, node_of(g, n.kind, a, n.b < 0 ? -1 : sum_node(r, y)), 0);
}

/* What the users of node i see, a base or what is the same all the time: its power. */
static Sum as_power(Rewriting *r, int32_t i, Sum x) {
    const Term t = term_of(r, x);
    if (t.a == r->graph.unit) return single(r, t.c, t.a, t.powers);
    if (r->uniform[i]) about(r, t.a)->constant = 1;
    set_base(r, t.a, r->uniform[i] ? RECIPROCAL : r->bases[i]);
    return single(r, t.c, one(&r->graph), joined(r, t.powers, power_list(r, t.a, 4)));
}

/* What the users of a sum see that are many. */
static Sum for_many(Rewriting *r, Sum x) {
    const Term t = term_of(r, x);
    int64_t many = length_of(&r->lists, t.powers), count = 0;
    Power *const kept = from(&r->passing, many * sizeof *kept);
    for (int64_t i = 0; i < many; i++) {
        const Power p = powers_of(&r->lists, t.powers)[i];
        if (about(r, p.base)->base == ROOT || about(r, p.base)->constant) kept[count++] = p;
    }
    if (t.a == r->graph.unit || count == many) return single(r, t.c, t.a, t.powers);
    /* each of the users would multiply by the other powers again */
    const int32_t lasting = list_of(&r->lists, kept, count);
    return single(r, t.c, with_powers(r, t.a, over(r, t.powers, lasting)), lasting);
}

static void give_back_unless_used(Rewriting *r, int32_t *uses, int32_t i) { if (!--uses[i]) give_back(r->sum[i].term); }

static Graph rewrite(Memory *m, const Rearranged *x, const Graph *raw) {
    char *const live = room_for(m, 2 * raw->count), *const uniform = live + raw->count;
    int32_t *const uses = room_for(m, raw->count * sizeof *uses);
    find_needed(raw->node, raw->count, x->wanted, x->outputs, live);
    for (int64_t i = 0; i < raw->count; i++) uniform[i] = of_one_alone(raw->node + i, uniform, x->same), uses[i] = 0;
    for (int64_t i = 0; i < raw->count; i++) {
        const Node n = raw->node[i];
        if (!live[i] || is_leaf(&n)) continue;
        uses[n.a]++;
        if (n.b >= 0) uses[n.b]++;
    }
    for (int64_t i = 0; i < x->outputs; i++) uses[x->wanted[i]]++;
    Rewriting r = {m, raw, bases_of(m, raw, live, uniform, x->roots), uniform, empty_graph(m), no_lists(m), {m}, {m}};
    r.sum = room_for(m, raw->count * sizeof *r.sum);
    int32_t *const left = room_for(m, raw->count * sizeof *left);
    memcpy(left, uses, raw->count * sizeof *left);
    for (int64_t i = 0; i < raw->count; i++) {
        if (!live[i]) continue;
        Sum found = rewritten(&r, i);
        if (uniform[i] || r.bases[i]) found = as_power(&r, i, found);
        else if (uses[i] > 1 && (found.many > 1 || found.term[0].powers)) found = for_many(&r, found);
        r.sum[i] = (Sum){room_for(m, found.many * sizeof *found.term), found.many};
        memcpy(r.sum[i].term, found.term, found.many * sizeof *found.term);
        r.passing.used = 0;
        const Node n = raw->node[i];
        if (is_leaf(&n)) continue;
        give_back_unless_used(&r, left, n.a); /* long sums are not kept */
        if (n.b >= 0) give_back_unless_used(&r, left, n.b);
    }
    for (int64_t i = 0; i < x->outputs; i++) x->wanted[i] = sum_node(&r, r.sum[x->wanted[i]]), r.passing.used = 0;
    return r.graph;
}

static int kept_graph(Memory *m, const Rearranged *x) {
    if (setjmp(m->out)) return m->answer;
    const Graph raw = raw_graph(m, x), found = rewrite(m, x, &raw);
    Graph *const kept = malloc(sizeof *kept);
    Node *const node = malloc((found.count + 1) * sizeof *node);
    double *const number = malloc((found.count + 1) * sizeof *number);
    if (!kept || !node || !number) return free(kept), free(node), free(number), WITHOUT_MEMORY;
    memcpy(node, found.node, found.count * sizeof *node), memcpy(number, found.number, found.count * sizeof *number);
    *kept = (Graph){.node = node, .number = number, .count = found.count};
    return x->told[0] = (int64_t)kept, x->told[1] = found.count, ARRANGED;
}

int rearrange(const Rearranged *x) {
    Memory m = {0};
    const int answer = kept_graph(&m, x);
    return give_all_back(&m), answer;
}

typedef struct { Graph *graph; Node *node; double *number; } Taken;

int take_graph(const Taken *x) {
    memcpy(x->node, x->graph->node, x->graph->count * sizeof *x->node);
    memcpy(x->number, x->graph->number, x->graph->count * sizeof *x->number);
    return free(x->graph->node), free(x->graph->number), free(x->graph), ARRANGED;
}
