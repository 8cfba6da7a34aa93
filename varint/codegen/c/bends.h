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

#if defined(__clang__)
#define MANY_AT_ONCE
#else
#define MANY_AT_ONCE __attribute__((optimize("O3"))) /* numbers side by side in vectors, however many they are */
#endif
#define SIDE_BY_SIDE 32 /* steps whose forces are looked at in one call */
#define ROOM_OF_BENDS(n, looks, numbers) (((numbers) * (n) + (4 * (n) + 1) * (looks) + 4 * (n)) * SIDE_BY_SIDE)

/* Where it is at a part of a step on Hermite's cubic polynomial, and how fast: by q and v of both ends. */
typedef struct { double one, begins, ends, fast, first, last; } Hermite;

static Hermite hermite_at(double x, double h) {
    const double y = 1 - x;
    return (Hermite){x * x * (3 - 2 * x), h * (x * y * y), -h * (x * x * y), 6 * x * y / h, y * (1 - 3 * x), x * (1 - 3 * y)};
}

/* Of so many numbers side by side: where each begins, the way it goes, and its speeds at both ends. */
INLINE void set_places(const Hermite *at, int64_t many, const double *begin, const double *way, const double *v0, const double *v1,
                       double *restrict q, double *restrict v) {
    for (int64_t j = 0; j < many; j++) {
        q[j] = begin[j] + at->one * way[j] + (at->begins * v0[j] + at->ends * v1[j]);
        v[j] = at->fast * way[j] + (at->first * v0[j] + at->last * v1[j]);
    }
}

INLINE void set_place(const Hermite *at, int64_t n, const double *here, double *q, double *v) {
    const double *const next = here + 3 * n;
    for (int64_t d = 0; d < n; d++) {
        const double way = next[d] - here[d];
        set_places(at, 1, here + d, &way, here + 2 * n + d, next + 2 * n + d, q + d, v + d);
    }
}

/* Places, velocities and times of so many looks at each of so many steps; forces there, and what they make. */
typedef struct { double *seen, *q, *v, *force, *mass, *at; } Looks;

static Looks looks_in(const Bends *a, int64_t steps, double *room) {
    const int64_t all = a->n * steps, many = all * a->looks;
    double *const q = room + a->numbers * all;
    return (Looks){room, q, q + many, q + 2 * many, q + 3 * many, q + 4 * many};
}

/* What the weights make of forces at some looks, of so many numbers side by side at each. */
MANY_AT_ONCE static void weigh(int64_t all, int64_t looks, const double *weights, const double *force, double *restrict seen) {
    memset(seen, 0, all * sizeof(double));
    for (int64_t i = 0; i < looks; i++)
        for (int64_t j = 0; j < all; j++) seen[j] += weights[i] * force[all * i + j];
}

/* The largest impulse of these numbers in each of some steps h, by the scales of momenta. */
static int set_impulses(const Bends *a, const Looks *x, int64_t steps, double h, const double *scales, double *sharp) {
    const int64_t n = a->n, looks = a->looks, all = n * steps;
    double *const seen = x->seen, *const force = x->force;
    const RowsArguments asked = {.count = steps * looks, .c = a->c, .scene = a->push, .arguments = {x->q, x->v, x->at}, .apart = {n, n, 1},
                                 .results = {force, x->mass}, .widths = {n, n}};
    if (a->rows(&asked) != DONE) return 0;
    for (int64_t m = 0; m < a->numbers; m++) weigh(all, looks, a->weights + looks * m, force, seen + all * m);
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

/* The same of one of so many parts of steps of a run, at most SIDE_BY_SIDE, from t0 on. */
MANY_AT_ONCE static int set_some(const Bends *a, const double *rows, int64_t steps, int64_t part, int64_t parts, double t0, double h, const double *scales, double *sharp, double *room) {
    const int64_t n = a->n;
    const Looks x = looks_in(a, steps, room);
    double *const begin = x.at + steps * a->looks, *const way = begin + n * steps, *const v0 = way + n * steps, *const v1 = v0 + n * steps;
    for (int64_t k = 0; k < steps; k++)
        for (int64_t d = 0; d < n; d++) {
            const double *const here = rows + 3 * n * k + d, *const next = here + 3 * n;
            begin[n * k + d] = here[0], way[n * k + d] = next[0] - here[0], v0[n * k + d] = here[2 * n], v1[n * k + d] = next[2 * n];
        }
    for (int64_t i = 0; i < a->looks; i++) {
        const double place = ((double)part + a->places[i]) / (double)parts;
        const Hermite at = hermite_at(place, h);
        set_places(&at, n * steps, begin, way, v0, v1, x.q + n * steps * i, x.v + n * steps * i);
        for (int64_t k = 0; k < steps; k++) x.at[steps * i + k] = t0 + h * (double)k + place * h;
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
