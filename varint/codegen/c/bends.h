/* How sharply forces bend along each of many steps: varint/integration/bent_steps.py says why, and looks alike where runs are of
   another kind. run.h and rows.h stand before this file. */

typedef struct {
    int (*rows)(const RowsArguments *);
    const void *push;     /* (q, v, t) to the force and the mass matrix' diagonal */
    const double *c;      /* parameters */
    const double *places; /* parts of a step at which forces are looked at */
    const double *highest; /* what makes their two highest Legendre coefficients of the values there, one after the other */
    int64_t n, looks;
} Bends;

#define SIDE_BY_SIDE 32 /* steps whose forces are looked at in one call */
#define ROOM_OF_BENDS(n, looks) ((2 * (n) + (4 * (n) + 1) * (looks)) * SIDE_BY_SIDE)

/* The largest impulse of these coefficients in each of some steps h from t0 on, by the scales of momenta. */
static int set_some(const Bends *a, const double *rows, int64_t steps, double t0, double h, const double *scales, double *sharp, double *room) {
    const int64_t n = a->n, looks = a->looks, all = n * steps, many = all * looks;
    double *const seen = room, *const q = seen + 2 * all, *const v = q + many, *const force = v + many, *const mass = force + many, *const at = mass + many;
    const RowsArguments asked = {.count = steps * looks, .c = a->c, .scene = a->push, .arguments = {q, v, at}, .apart = {n, n, 1},
                                 .results = {force, mass}, .widths = {n, n}};
    for (int64_t i = 0; i < looks; i++) { /* on Hermite's cubic polynomial */
        const double x = a->places[i], y = 1 - x, one = x * x * (3 - 2 * x), begins = h * (x * y * y), ends = -h * (x * x * y), fast = 6 * x * y / h,
                     first = y * (1 - 3 * x), last = x * (1 - 3 * y);
        double *const to_q = q + all * i, *const to_v = v + all * i, *const to_t = at + steps * i;
        for (int64_t k = 0; k < steps; k++) {
            const double *const here = rows + 3 * n * k, *const next = here + 3 * n;
            to_t[k] = t0 + h * (double)k + x * h;
            for (int64_t d = 0; d < n; d++) {
                const double way = next[d] - here[d], v0 = here[2 * n + d], v1 = next[2 * n + d];
                to_q[n * k + d] = here[d] + one * way + (begins * v0 + ends * v1);
                to_v[n * k + d] = fast * way + (first * v0 + last * v1);
            }
        }
    }
    if (a->rows(&asked) != DONE) return 0;
    memset(seen, 0, 2 * all * sizeof(double));
    for (int64_t i = 0; i < looks; i++) {
        const double one = a->highest[i], other = a->highest[looks + i], *const now = force + all * i;
        for (int64_t j = 0; j < all; j++) seen[j] += one * now[j], seen[all + j] += other * now[j];
    }
    for (int64_t k = 0; k < steps; k++) {
        sharp[k] = 0;
        for (int64_t d = 0; d < n; d++) {
            const double one = (fabs(seen[n * k + d]) + fabs(seen[all + n * k + d])) * fabs(h) / scales[d];
            if (!(one <= sharp[k]) && sharp[k] == sharp[k]) sharp[k] = one;
        }
    }
    return 1;
}

/* The same of all steps; room for ROOM_OF_BENDS. */
static int set_sharpness(const Bends *a, const double *rows, int64_t steps, double t0, double h, const double *scales, double *sharp, double *room) {
    for (int64_t k = 0; k < steps; k += SIDE_BY_SIDE) {
        const int64_t some = steps - k < SIDE_BY_SIDE ? steps - k : SIDE_BY_SIDE;
        if (!set_some(a, rows + 3 * a->n * k, some, t0 + h * (double)k, h, scales, sharp + k, room)) return 0;
    }
    return 1;
}
