/* Where an expression crosses zero within the steps of a motion, between which it may jump. The name ends in LEVEL, the instructions that are
   used.

   The same as varint/integration/events/isolation.py and roots.py do for all steps at once: steps are halved until bounds along
   them tell how many zeros each piece has, then every zero is located by shorter steps of the same rule. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define crossings WITH_ALL(crossings, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "cubic_root.h"
#include "crossings.h"

#define AT_ONCE 128 /* steps whose bounds are evaluated together */
#define BOUNDS 6    /* value, rate and curvature: low, high */

/* A point of the motion: time, value, rate, then q, v and p. */
#define T_OF(x) ((x)[0])
#define F_OF(x) ((x)[1])
#define RATE(x) ((x)[2])
#define HEAD 3
#define POINT (HEAD + 3 * n)
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))
#define APART 1e-7 /* of a piece: instants nearer to each other do not tell slopes */

INLINE int is_finite_number(double x) { return x - x == 0; }
INLINE double sign_of(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

static int look(const Crossings *a, double *point) {
    const int64_t n = a->n;
    const RowsArguments one = {.count = 1, .c = a->c, .scene = a->values, .arguments = {point + HEAD, point + HEAD + n, point},
                               .results = {point + 1}, .widths = {2}};
    return a->rows(&one) == DONE;
}

static void take_node(const Crossings *a, int64_t node, double *point) {
    const int64_t n = a->n;
    T_OF(point) = a->t[node];
    COPY(point + HEAD, a->q + node * n, n), COPY(point + HEAD + n, a->v + node * n, n);
    COPY(point + HEAD + 2 * n, a->p + node * n, n);
}

INLINE int jumps_at(const Crossings *a, int64_t node) { return a->jumps && a->jumps[node] >= 0; }

/* A node as the motion comes to it. */
static void take_end(const Crossings *a, int64_t node, double *point) {
    const int64_t n = a->n;
    take_node(a, node, point);
    if (jumps_at(a, node)) COPY(point + HEAD + n, a->before + a->jumps[node] * 2 * n, 2 * n);
}

/* The motion at a time within the step after a node; 0 where that step cannot be solved. */
static int at_time(const Crossings *a, int64_t node, double t, double *point) {
    const int64_t n = a->n;
    double start[2 * n], rows[3 * n];
    const double begin = a->t[node], size = t - begin;
    int64_t good = 0;
    take_node(a, node, point);
    if (fabs(size) > a->close) {
        COPY(start, a->q + node * n, n), COPY(start + n, a->p + node * n, n);
        const PartsArguments one = {1, a->told, a->used, a->most, start, &begin, &size, a->c, a->u + node * a->used, a->opening + node * a->told, rows, &good,
                                    a->scene};
        if (a->parts(&one) != DONE || !good) return 0;
        COPY(point + HEAD, rows, n), COPY(point + HEAD + n, rows + 2 * n, n), COPY(point + HEAD + 2 * n, rows + n, n);
    }
    T_OF(point) = t;
    return look(a, point);
}

/* Least value in [0, far] of value + slope s + bend s^2/2; no number where one of them is none. */
INLINE double lowest(double value, double slope, double bend, double far) {
    double turn = far;
    if (bend > 0) {
        turn = -slope / bend;
        turn = turn < 0 ? 0 : turn > far ? far : turn;
    }
    const double there = value + turn * (slope + turn * bend / 2);
    return there >= value ? value : there;
}

INLINE double clipped(double x) { return x > 0 ? x < 1 ? x : 1 : x == x ? 0 : 0.5; }

/* Whether the expression stays above zero between the ends of a piece; see `lower_bound` in enclosures.py. */
static int stays_above(double f0, double f1, double r0, double r1, double w, double low, double rate_low, double rate_high, double bend) {
    if (!(f0 > 0 && f1 >= 0)) return 0;
    const double down = w > 0 ? rate_low * w : rate_high * w, up = w > 0 ? rate_high * w : rate_low * w;
    const double cone = down >= 0 ? f0 : up <= 0 ? f1 : f0 + down * clipped((f1 - up - f0) / (down - up));
    const double ra = r0 * w, rb = r1 * w, c = bend * w * w, s = clipped((f1 + c / 2 - rb - f0) / (ra - rb + c));
    const double left = lowest(f0, ra, c, s), right = lowest(f1, -rb, c, 1 - s);
    return low >= 0 || cone >= 0 || (left >= 0 && right >= 0);
}

/* Whether a piece may have more zeros than the signs at its ends tell, and change by more than what is small. */
static int in_doubt(double f0, double f1, double r0, double r1, double w, const double *e, double small) {
    if (w == 0 || e[2] >= 0 || e[3] <= 0 || (fabs(e[2] * w) <= small && fabs(e[3] * w) <= small)) return 0;
    return !(stays_above(f0, f1, r0, r1, w, e[0], e[2], e[3], e[4]) ||
             stays_above(-f0, -f1, -r0, -r1, w, -e[1], -e[3], -e[2], -e[5]));
}

static int piece_in_doubt(const Crossings *a, const double *left, const double *right, double small) {
    const int64_t n = a->n;
    const double w = T_OF(right) - T_OF(left);
    double e[BOUNDS];
    const RowsArguments one = {.count = 1, .c = a->c, .scene = a->bounds,
                               .arguments = {left + HEAD, left + HEAD + n, right + HEAD, right + HEAD + n, left, &w},
                               .results = {e}, .widths = {BOUNDS}};
    if (a->rows(&one) != DONE) return 1;
    return in_doubt(F_OF(left), F_OF(right), RATE(left), RATE(right), w, e, small);
}

INLINE int changes(double f0, double f1) { return f0 * f1 < 0 && is_finite_number(f0 + f1); }

/* Slope at `x` of the parabola through three instants, of the line through two where the third is one of them. */
static double slope_through(const double *x, const double *y, const double *z) {
    const double one = (F_OF(x) - F_OF(y)) / (T_OF(x) - T_OF(y));
    const double other = (F_OF(y) - F_OF(z)) / (T_OF(y) - T_OF(z));
    const double slope = one + (T_OF(x) - T_OF(y)) * (one - other) / (T_OF(x) - T_OF(z));
    return is_finite_number(slope) ? slope : one;
}

enum Root { POLE, ZERO, LOST };

/* The zero in a piece with values of different sign at its ends. */
static int locate(const Crossings *a, int64_t node, const double *left, const double *right, double *zero) {
    const int64_t n = a->n;
    double begin = T_OF(left), end = T_OF(right), f0 = F_OF(left), f1 = F_OF(right);
    const double w = end - begin, largest = fmax(fabs(f0), fabs(f1)), up = sign_of(f0);
    const double tolerance = a->located * fmax(fmax(fabs(begin), fabs(end)), fabs(w));
    const double rise = up * RATE(left) * w, fall = up * RATE(right) * w;
    double t = begin + w * (is_finite_number(rise + fall) ? cubic_root(up * f0, up * f1, rise, fall, a->newton, a->located) : f0 / (f0 - f1));
    double slope = (f1 - f0) / w, last[3], before[3];
    COPY(last, right, 3), COPY(before, left, 3);
    for (int64_t i = 0; i < a->iterations; i++) {
        if (!at_time(a, node, t, zero)) return LOST;
        const double f = F_OF(zero);
        if (f * f0 > 0) begin = t, f0 = f;
        else end = t, f1 = f;
        if (i == 0 && is_finite_number(RATE(zero))) slope = RATE(zero);
        else if (fabs(t - T_OF(last)) > APART * fabs(w)) slope = slope_through(zero, last, before);
        const double ahead = t - f / slope;
        const int on_line = (ahead - begin) * (end - ahead) > 0 && i < a->secants;
        if (f == 0 || fabs(end - begin) <= tolerance || (fabs(ahead - t) <= tolerance && i < a->secants)) break;
        COPY(before, last, 3), COPY(last, zero, 3);
        t = on_line ? ahead : (begin + end) / 2;
    }
    const int narrow = fabs(end - begin) <= tolerance;
    return narrow && fmin(fabs(f0), fabs(f1)) > a->pole * largest && F_OF(zero) != 0 ? POLE : ZERO;
}

/* Room for one more zero of which the node and the sign before it are known; 0 where there is none. */
static double *next_zero(const Crossings *a, int64_t node, double side) {
    const int64_t n = a->n;
    if (a->found[0] >= a->room) return 0;
    double *const zero = a->zeros + a->found[0] * (2 + POINT);
    zero[0] = (double)node, zero[1] = side;
    return zero + 2;
}

/* The zero of a piece as one more of them. */
static int add_root(const Crossings *a, int64_t node, const double *left, const double *right) {
    double *const zero = next_zero(a, node, sign_of(F_OF(left)));
    if (!zero) return NO_ROOM;
    const int root = locate(a, node, left, right, zero);
    a->found[0] += root == ZERO;
    return root == LOST ? NOT_SOLVED : SEARCHED;
}

/* The zeros of a step in doubt: halves, and halves of these, breadth first. `room` has points. */
static int search_step(const Crossings *a, int64_t node, double *room, int32_t *piece, int32_t *roots) {
    const int64_t n = a->n, most = a->most_pieces;
    const double small = a->shallow * fmax(fabs(F_OF(room)), fabs(F_OF(room + POINT)));
    int32_t points = 2, count = 1, bracketed = 0;
    piece[0] = 0, piece[1] = 1;
    for (int64_t halving = 0; count; halving++) {
        int32_t doubtful = 0;
        for (int32_t i = 0; i < count; i++) {
            const int32_t l = piece[2 * i], r = piece[2 * i + 1];
            const double *const left = room + l * POINT, *const right = room + r * POINT;
            const int certain = halving && (halving == a->deepest || !piece_in_doubt(a, left, right, halving < a->halvings ? 0 : small));
            if (!certain) piece[2 * doubtful] = l, piece[2 * doubtful++ + 1] = r;
            else if (changes(F_OF(left), F_OF(right))) roots[2 * bracketed] = l, roots[2 * bracketed++ + 1] = r;
        }
        if (doubtful > most) { /* zero up to round-off */
            bracketed = 0, doubtful = 0;
            if (changes(F_OF(room), F_OF(room + POINT))) roots[0] = 0, roots[1] = 1, bracketed = 1;
        }
        for (int32_t i = 0; i < doubtful; i++) { /* from behind: what is not halved yet stays */
            const int32_t j = doubtful - 1 - i, l = piece[2 * j], r = piece[2 * j + 1];
            double *const left = room + l * POINT, *const right = room + r * POINT, *const middle = room + points * POINT;
            if (!at_time(a, node, (T_OF(left) + T_OF(right)) / 2, middle)) return NOT_SOLVED;
            if (F_OF(middle) == 0) {
                double *const zero = next_zero(a, node, sign_of(F_OF(left)));
                if (!zero) return NO_ROOM;
                COPY(zero, middle, POINT), a->found[0]++;
            }
            piece[4 * j] = l, piece[4 * j + 1] = points, piece[4 * j + 2] = points, piece[4 * j + 3] = r, points++;
        }
        count = 2 * doubtful;
    }
    for (int32_t i = 0; i < bracketed; i++) {
        const int status = add_root(a, node, room + roots[2 * i] * POINT, room + roots[2 * i + 1] * POINT);
        if (status != SEARCHED) return status;
    }
    return SEARCHED;
}

int crossings(const Crossings *a) {
    const int64_t n = a->n, steps = a->nodes - 1, most = a->most_pieces;
    const int64_t points = 2 + a->deepest * most, brackets = 2 * most * (a->deepest + 1);
    double *const values = malloc(((2 + BOUNDS) * (AT_ONCE + 1) + AT_ONCE + points * POINT) * sizeof(double));
    int32_t *const piece = malloc((size_t)(4 * most + 4 + 2 * brackets) * sizeof(int32_t));
    int status = values && piece ? SEARCHED : NOT_SOLVED;
    double *const bounds = values + 2 * (AT_ONCE + 1), *const w = bounds + BOUNDS * (AT_ONCE + 1), *const room = w + AT_ONCE;
    int64_t k = a->found[1];
    for (;;) {
        while (k < steps && a->steps[k] != WANTED) k++;
        if (status != SEARCHED || k == steps) break;
        int64_t count = 1;
        while (k + count < steps && count < AT_ONCE && a->steps[k + count] == WANTED) count++;
        const int64_t begin = k;
        const double *const q = a->q + k * n, *const v = a->v + k * n, *const t = a->t + k;
        for (int64_t i = 0; i < count; i++) w[i] = t[i + 1] - t[i];
        const RowsArguments nodes = {.count = count + 1, .c = a->c, .scene = a->values, .arguments = {q, v, t}, .apart = {n, n, 1},
                                     .results = {values}, .widths = {2}};
        const RowsArguments pieces = {.count = count, .c = a->c, .scene = a->bounds, .arguments = {q, v, q + n, v + n, t, w},
                                      .apart = {n, n, n, n, 1, 1}, .results = {bounds}, .widths = {BOUNDS}};
        if (a->rows(&nodes) != DONE || a->rows(&pieces) != DONE) status = NOT_SOLVED;
        for (; status == SEARCHED && k < begin + count; k++) {
            const double *const here = values + 2 * (k - begin), *next = here + 2;
            int doubt;
            room[1] = here[0], room[2] = here[1];
            if (jumps_at(a, k + 1)) {
                take_node(a, k, room), take_end(a, k + 1, room + POINT), next = room + POINT + 1;
                if (!look(a, room + POINT)) { status = NOT_SOLVED; break; }
                doubt = piece_in_doubt(a, room, room + POINT, 0);
            } else doubt = in_doubt(here[0], next[0], here[1], next[1], w[k - begin], bounds + BOUNDS * (k - begin), 0);
            const int64_t known = a->found[0], ends = next[0] == 0 && here[0] != 0, needed = doubt || changes(here[0], next[0]);
            if (a->marking) {
                if (!needed && !ends) a->steps[k] = QUIET;
                continue;
            }
            if (ends) {
                double *const zero = next_zero(a, k, sign_of(here[0]));
                if (!zero) { status = NO_ROOM; break; }
                take_end(a, k + 1, zero), zero[1] = next[0], zero[2] = next[1], a->found[0]++;
            }
            if (needed) {
                take_node(a, k, room), take_end(a, k + 1, room + POINT);
                room[POINT + 1] = next[0], room[POINT + 2] = next[1];
                status = doubt ? search_step(a, k, room, piece, piece + 4 * most + 4) : add_root(a, k, room, room + POINT);
            }
            if (status == NO_ROOM) { /* this step once more, with room */
                a->found[0] = known;
                break;
            }
        }
    }
    a->found[1] = k;
    free(values), free(piece);
    return status;
}
