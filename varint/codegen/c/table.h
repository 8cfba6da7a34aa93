/* Controls that steps take from a table, whose rows follow one another over the duration: as many steps in each of them. Nodes of
   a run lie where rows change.

   varint/integration/table_trials.py has the same for runs of another kind (controls_of_steps). */

/* `each` row has one value of so many controls, or one at each of the rule's `places`: parts of a row. 0 rows: there are no controls. */
typedef struct {
    const double *values, *places;
    int64_t rows, each, controls, stages;
} Table;

/* Numbers for the controls of so many steps, at all stages, and what makes them. */
static int64_t room_of_controls(const Table *a, int64_t steps, int64_t count) {
    if (!a->rows) return 0;
    return count * a->stages * a->controls + (a->each > 1 ? steps / a->rows * a->stages * a->stages : 0);
}

/* What makes the controls at a part x of a row of those at its places: Lagrange's polynomials. */
static void set_weights(const Table *a, double x, double *weights) {
    for (int64_t j = 0; j < a->each; j++) {
        weights[j] = 1;
        for (int64_t l = 0; l < a->each; l++)
            if (l != j) weights[j] *= (x - a->places[l]) / (a->places[j] - a->places[l]);
    }
}

/* Controls of a row, by those weights where they change along it. */
static void set_value(const Table *a, const double *row, const double *weights, double *to) {
    const int64_t m = a->controls;
    if (a->each == 1) {
        memcpy(to, row, m * sizeof(double));
        return;
    }
    for (int64_t d = 0; d < m; d++) {
        double sum = 0;
        for (int64_t j = 0; j < a->each; j++) sum += weights[j] * row[m * j + d];
        to[d] = sum;
    }
}

/* Controls at the stages of the steps from step `from` on of a run of so many: as the loop takes them. */
static void set_controls(const Table *a, int64_t steps, int64_t from, int64_t count, double *u) {
    if (!a->rows) return;
    const int64_t s = a->stages, m = a->controls, parts = steps / a->rows;
    double *const weights = u + count * s * m;
    for (int64_t k = 0; k < parts && a->each > 1; k++)
        for (int64_t i = 0; i < s; i++) set_weights(a, ((double)k + a->places[i]) / (double)parts, weights + s * (s * k + i));
    for (int64_t k = 0; k < count; k++) {
        const double *const row = a->values + a->each * m * ((from + k) / parts), *const own = weights + s * s * ((from + k) % parts);
        for (int64_t i = 0; i < s; i++) set_value(a, row, own + s * i, u + m * (s * k + i));
    }
}

/* Controls at so many nodes of a run of so many steps: those with which the step behind each of them begins, or that before it ends. */
static void set_at_nodes(const Table *a, int64_t steps, int64_t nodes, int64_t before, double *u) {
    const int64_t m = a->controls, parts = steps / a->rows;
    double weights[a->each];
    for (int64_t i = 0; i < nodes; i++) {
        int64_t k = i - before;
        k = k < 0 ? 0 : k >= steps ? steps - 1 : k;
        if (a->each > 1) set_weights(a, (double)(i - k / parts * parts) / (double)parts, weights);
        set_value(a, a->values + a->each * m * (k / parts), weights, u + m * i);
    }
}
