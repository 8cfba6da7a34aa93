/* Energies of nodes, and the work of what changes them. run.h and rows.h stand before this file.

   varint/integration/work_bound.py says why. */

typedef struct {
    int (*rows)(const RowsArguments *);
    const void *balance; /* (q, p, t), or (q, v, t), and controls to the energy and the power of what changes it */
    const double *c;
    int64_t n, second, controls; /* where p or v begins in a node (q, p, v); controls at a node */
    double missed;               /* times the work that nodes show is what is done at most */
} Balance;

/* Energies of so many nodes, one behind the other, and the powers there of what changes them. */
static int set_energies(const Balance *b, const double *nodes, int64_t count, const double *t, const double *u, double *energy,
                        double *power) {
    const int64_t n = b->n;
    const RowsArguments asked = {.count = count, .c = b->c, .scene = b->balance, .arguments = {nodes, nodes + b->second, t, u},
                                 .apart = {3 * n, 3 * n, 1, b->controls}, .results = {energy, power}, .widths = {1, 1}};
    return b->rows(&asked) == DONE;
}

static double power_of(double x) { return x - x == 0 ? fabs(x) : 0; }

/* What is given in the step before node k at most, by the powers behind each node and before it, which controls part. */
static double work_between(const Balance *b, const double *t, const double *behind, const double *before, int64_t k) {
    const double first = power_of(behind[k - 1]), last = power_of(before[k]);
    return b->missed * (first > last ? first : last) * fabs(t[k] - t[k - 1]);
}

/* The same where powers do not jump. */
static double work_before(const Balance *b, const double *t, const double *power, int64_t k) { return work_between(b, t, power, power, k); }
