/* What the loops that carry derivatives over steps have of what is outside: parameters, step, time and controls. */

/* What changes outside, times its nonzeros, which stand `apart`, added to the rows of `target`. */
static void add_outside(const SweepArguments *a, int64_t step, int r, const double *dt, const double *nonzeros, int apart,
                        const int *rows, const int *columns, int count, double *target) {
    const int64_t m = a->columns;
    for (int i = 0; i < count; i++) {
        double *const row = target + rows[i] * m, value = nonzeros[i * apart];
        if (columns[i] < C + 2) {
            const double *const along = columns[i] == C + 1 ? dt : a->outer + columns[i] * m;
            for (int64_t j = 0; j < m; j++) row[j] = s_fma(value, along[j], row[j]);
        } else if (a->control_column >= 0) {
            const int place = columns[i] - (C + 2) + r * NU;
            const int64_t node = a->control_nodes == 1 ? 0 : place / CONTROLS;
            row[a->control_column + ((a->first + step) * a->control_nodes + node) * CONTROLS + place % CONTROLS] += value;
        }
    }
}

/* target += J x, m columns */
INLINE void add_product(const double *nonzeros, const int *rows, const int *columns, int count, const double *x, int64_t m,
                        double *target) {
    for (int i = 0; i < count; i++) {
        const double *const from = x + columns[i] * m, value = nonzeros[i];
        double *const to = target + rows[i] * m;
        for (int64_t j = 0; j < m; j++) to[j] = s_fma(value, from[j], to[j]);
    }
}

/* What part r of `count` steps from step s on, one a lane, pulls back: of parameters and step, summed up lane by lane in
   `outer`, and of their controls. Lanes without a step count for nothing. */
INLINE void add_pulled(const SweepArguments *a, int64_t s, int count, int r, const V *pulled, V *outer) {
    V there, step;
    for (int l = 0; l < LANES; l++) set_lane(&there, l, l < count), set_lane(&step, l, (double)(a->first + s + l));
    for (int i = 0; i < C + 2; i++) outer[i] = v_fma(there, pulled[i], outer[i]);
    outer[C] = v_fma(there * step, pulled[C + 1], outer[C]);
    for (int i = 0; i < NU; i++) {
        const int place = i + r * NU;
        const int64_t node = a->control_nodes == 1 ? 0 : place / CONTROLS;
        for (int64_t l = 0; l < count; l++)
            a->out[((s + l) * a->control_nodes + node) * CONTROLS + place % CONTROLS] += ((const double *)&pulled[C + 2 + i])[l];
    }
}

/* So many steps of one size from step s on, or back from it, LANES at most. */
INLINE int alike(const SweepArguments *a, int64_t s, int towards) {
    int count = 1;
    for (int64_t i = s + towards; count < LANES && i >= 0 && i < a->steps && a->h[i] == a->h[s]; i += towards) count++;
    return count;
}

/* A lane of a vector in memory, without loading the whole vector. */
INLINE double lane_at(const V *x, int64_t l) { return ((const double *)x)[l]; }
INLINE void set_lane_at(V *x, int64_t l, double y) { ((double *)x)[l] = y; }
