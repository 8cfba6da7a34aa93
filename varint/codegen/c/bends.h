/* How sharply forces bend along each of many steps: varint/integration/bent_steps.py says why, and looks alike where runs are of
   another kind. run.h and rows.h stand before this file. */

typedef struct {
    int (*rows)(const RowsArguments *);
    const void *push;     /* (q, v, t) to the force and the mass matrix' diagonal */
    const double *c;      /* parameters */
    const double *places; /* parts of a step at which forces are looked at */
    const double *weights; /* what makes of the values there so many numbers that are small where forces are smooth, one after the other */
    int64_t n, looks, numbers;
} Bends;

#define SIDE_BY_SIDE 32 /* steps whose forces are looked at in one call */
#define ROOM_OF_BENDS(n, looks, numbers) (((numbers) * (n) + (4 * (n) + 1) * (looks)) * SIDE_BY_SIDE)

/* Where it is at a part of a step on Hermite's cubic polynomial, and how fast: by q and v of both ends. */
typedef struct { double one, begins, ends, fast, first, last; } Hermite;

static Hermite hermite_at(double x, double h) {
    const double y = 1 - x;
    return (Hermite){x * x * (3 - 2 * x), h * (x * y * y), -h * (x * x * y), 6 * x * y / h, y * (1 - 3 * x), x * (1 - 3 * y)};
}

INLINE void set_place(const Hermite *at, int64_t n, const double *here, double *q, double *v) {
    const double *const next = here + 3 * n;
    for (int64_t d = 0; d < n; d++) {
        const double way = next[d] - here[d], v0 = here[2 * n + d], v1 = next[2 * n + d];
        q[d] = here[d] + at->one * way + (at->begins * v0 + at->ends * v1);
        v[d] = at->fast * way + (at->first * v0 + at->last * v1);
    }
}

/* Places, velocities and times of so many looks at each of so many steps; forces there, and what they make. */
typedef struct { double *seen, *q, *v, *force, *mass, *at; } Looks;

static Looks looks_in(const Bends *a, int64_t steps, double *room) {
    const int64_t all = a->n * steps, many = all * a->looks;
    double *const q = room + a->numbers * all;
    return (Looks){room, q, q + many, q + 2 * many, q + 3 * many, q + 4 * many};
}

/* The largest impulse of these numbers in each of some steps h, by the scales of momenta. */
static int set_impulses(const Bends *a, const Looks *x, int64_t steps, double h, const double *scales, double *sharp) {
    const int64_t n = a->n, looks = a->looks, all = n * steps;
    double *const seen = x->seen, *const force = x->force;
    const RowsArguments asked = {.count = steps * looks, .c = a->c, .scene = a->push, .arguments = {x->q, x->v, x->at}, .apart = {n, n, 1},
                                 .results = {force, x->mass}, .widths = {n, n}};
    if (a->rows(&asked) != DONE) return 0;
    memset(seen, 0, a->numbers * all * sizeof(double));
    for (int64_t m = 0; m < a->numbers; m++)
        for (int64_t i = 0; i < looks; i++) {
            const double one = a->weights[looks * m + i], *const now = force + all * i;
            for (int64_t j = 0; j < all; j++) seen[all * m + j] += one * now[j];
        }
    for (int64_t k = 0; k < steps; k++) {
        sharp[k] = 0;
        for (int64_t d = 0; d < n; d++) {
            double sum = 0;
            for (int64_t m = 0; m < a->numbers; m++) sum += fabs(seen[all * m + n * k + d]);
            const double one = sum * fabs(h) / scales[d];
            if (!(one <= sharp[k]) && sharp[k] == sharp[k]) sharp[k] = one;
        }
    }
    return 1;
}

/* The same of one of so many parts of steps of a run, from t0 on. */
static int set_some(const Bends *a, const double *rows, int64_t steps, int64_t part, int64_t parts, double t0, double h, const double *scales, double *sharp, double *room) {
    const int64_t n = a->n;
    const Looks x = looks_in(a, steps, room);
    for (int64_t i = 0; i < a->looks; i++) {
        const double place = ((double)part + a->places[i]) / (double)parts;
        const Hermite at = hermite_at(place, h);
        for (int64_t k = 0; k < steps; k++) {
            const int64_t to = steps * i + k;
            x.at[to] = t0 + h * (double)k + place * h, set_place(&at, n, rows + 3 * n * k, x.q + n * to, x.v + n * to);
        }
    }
    return set_impulses(a, &x, steps, h / (double)parts, scales, sharp);
}

/* The same of all steps; room for ROOM_OF_BENDS. */
static int set_sharpness(const Bends *a, const double *rows, int64_t steps, double t0, double h, const double *scales, double *sharp, double *room) {
    for (int64_t k = 0; k < steps; k += SIDE_BY_SIDE) {
        const int64_t some = steps - k < SIDE_BY_SIDE ? steps - k : SIDE_BY_SIDE;
        if (!set_some(a, rows + 3 * a->n * k, some, 0, 1, t0 + h * (double)k, h, scales, sharp + k, room)) return 0;
    }
    return 1;
}
