/* The equations of a step as a loop over the quadrature nodes of the rule: their code is there once, however many there are.

   Defined before this file, besides what newton.c needs: BASIS, SLOPES (nodes x degree), WEIGHTS, POINT_TIMES of the rule,
   COUPLED (nonzeros of the derivatives at a node) with their rows COUPLED_ROW, and the functions node_values(q, v, t, u, w, p,
   f), p = dL/dv and f = dL/dq + F; node_slopes(...), also dp/dq, dp/dv, df/dq, df/dv, or node_turn(q, v, t, u, dq, dv, w, dp,
   df), their change in one direction, which is shorter where they are long; row_units(w, (h, sizes of momenta)) and
   judged(y, q, p, t, w, sizes). With control points Q_j = q + h z_j the row j of the residual is
   sum_i b_i (h l_j(c_i) f_i + l'_j(c_i) p_i), in the last row minus the momentum at the start and the gain sum_i b_i h f_i. */

#if BY_DIRECTIONS
static __attribute__((noinline)) void node_slopes(const double *q, const double *v, const double *t, const double *u,
                                                  const double *w, double *momentum, double *push, double *p_q, double *p_v,
                                                  double *f_q, double *f_v) {
    node_values(q, v, t, u, w, momentum, push);
    double turn[2 * N] = {0}, dp[N], df[N];
    for (int k = 0; k < 2 * N; k++) {
        turn[k] = 1;
        node_turn(q, v, t, u, turn, turn + N, w, dp, df);
        turn[k] = 0;
        for (int e = 0; e < COUPLED; e++)
            if (COUPLED_COLUMN[e] == k % N)
                (k < N ? p_q : p_v)[e] = dp[COUPLED_ROW[e]], (k < N ? f_q : f_v)[e] = df[COUPLED_ROW[e]];
    }
}
#endif

/* Residual, momentum gain and, where there is room for it, the derivative of the residual: block (j, k) of COUPLED numbers
   at (j DEGREE + k) COUPLED. */
static __attribute__((noinline)) void sum_over_nodes(const double *y, const double *q, const double *p, double t, const double *u,
                                                     const double *w, double h, double *left, double *total, double *slope) {
    for (int a = 0; a < N; a++) total[a] = 0;
    for (int r = 0; r < Y; r++) left[r] = 0;
    if (slope) memset(slope, 0, DEGREE * DEGREE * COUPLED * sizeof(double));
    for (int i = 0; i < NODES; i++) {
        const double *const basis = BASIS + i * DEGREE, *const rate = SLOPES + i * DEGREE, b = WEIGHTS[i];
        double at[N], v[N], momentum[N], push[N], d[4][COUPLED], time = t + h * POINT_TIMES[i];
        for (int a = 0; a < N; a++) {
            double path = 0;
            v[a] = 0;
            for (int j = 0; j < DEGREE; j++)
                path = v_fma(basis[j], y[j * N + a], path), v[a] = v_fma(rate[j], y[j * N + a], v[a]);
            at[a] = v_fma(h, path, q[a]);
        }
        if (slope) node_slopes(at, v, &time, u + i * NU, w, momentum, push, d[0], d[1], d[2], d[3]);
        else node_values(at, v, &time, u + i * NU, w, momentum, push);
        for (int a = 0; a < N; a++) total[a] = v_fma(h * b, push[a], total[a]);
        for (int j = 0; j < DEGREE; j++) {
            const double of_push = h * b * (j == DEGREE - 1 ? basis[j] - 1 : basis[j]), of_momentum = b * rate[j];
            for (int a = 0; a < N; a++)
                left[j * N + a] = v_fma(of_push, push[a], v_fma(of_momentum, momentum[a], left[j * N + a]));
            for (int k = 0; slope && k < DEGREE; k++) {
                double *const block = slope + (j * DEGREE + k) * COUPLED;
                const double of_q = h * basis[k], of_v = rate[k];
                for (int e = 0; e < COUPLED; e++)
                    block[e] = v_fma(of_momentum, v_fma(of_q, d[0][e], of_v * d[1][e]),
                                     v_fma(of_push, v_fma(of_q, d[2][e], of_v * d[3][e]), block[e]));
            }
        }
    }
    for (int a = 0; a < N; a++) left[(DEGREE - 1) * N + a] -= p[a];
}

INLINE void equations(const double *y, const double *q, const double *p, const double *t, const double *u, const double *w,
                      double *b, double *jacobian) {
    double units[N + 1], left[Y], total[N];
    row_units(w, units);
    sum_over_nodes(y, q, p, *t, u, w, units[0], left, total, jacobian);
    for (int k = 0; k < Y; k++) b[k] = left[PERM[k]] / units[1 + PERM[k] % N];
    for (int block = 0; block < DEGREE * DEGREE; block++)
        for (int e = 0; e < COUPLED; e++) jacobian[block * COUPLED + e] /= units[1 + COUPLED_ROW[e]];
}

INLINE void finish(const double *y, const double *q, const double *p, const double *t, const double *u, const double *w,
                   double *increment, double *gain, double *remains) {
    double units[N + 1], sizes[N];
    row_units(w, units);
    sum_over_nodes(y, q, p, *t, u, w, units[0], remains, gain, 0);
    judged(y, q, p, t, w, sizes);
    for (int a = 0; a < N; a++) increment[a] = units[0] * y[(DEGREE - 1) * N + a];
    for (int r = 0; r < Y; r++) remains[r] /= sizes[r % N];
}
