/* The equations of a step as a loop over the quadrature nodes of the rule: a scene's own code is there once, however many there
   are, and the loop is compiled once for all scenes of a size.

   newton.c is where the names are explained that it needs too. BASIS, SLOPES (nodes x degree), WEIGHTS, POINT_TIMES are those of
   the rule; COUPLED nonzeros of the derivatives at a node stand in the rows COUPLED_ROW and columns COUPLED_COLUMN, those of the
   constraints' slope G, GAP_NONZEROS, in GAP_ROW and GAP_COLUMN. The scene has node_values_of(q, v, t, u, lam, w, p, f, g),
   p = dL/dv, f = dL/dq + F + G' lam and the gaps g; node_slopes_of(...) besides G, dp/dq, dp/dv, df/dq, df/dv, of which those
   that vanish are not asked for (MOMENTUM_BY_Q, PUSH_BY_Q, PUSH_BY_V), or BY_DIRECTIONS node_turn_of(q, v, t, u, lam, dq, dv, w,
   dp, df, dg), their change in one direction, which is shorter where they are long; row_units_of(w, (h, reciprocal sizes of
   momenta and gaps)) and judged_of(y, q, p, t, gain, w, sizes).

   With control points Q_j = q + h z_j the row j of the residual is sum_i b_i (h l_j(c_i) f_i + l'_j(c_i) p_i), in the last row minus
   the momentum at the start and the gain sum_i b_i h f_i. Constraints come with Lobatto's rules, whose nodes are the control
   points: multipliers act at all of them but the last, and all gaps but the first are rows. */

#define BLOCK ((COUPLED + 7) / 8 * 8) /* in whole chunks */
#define BLOCKS (DEGREE * DEGREE * BLOCK)
#define FOUND (SLOPES_AT_NODES ? BLOCKS + (3 * DEGREE - 1) * GAP_NONZEROS : NONZEROS) /* numbers of the derivative, of which some vanish by their form */

LARGE void slopes_by_turns(In q, In v, In t, In u, In lam, In w, double *momentum, double *push, double *gap, double *gap_q,
                           double *p_q, double *p_v, double *f_q, double *f_v) {
    node_values_of(q, v, t, u, lam, w, momentum, push, gap);
    double turn[2 * N], dp[N], df[N], dg[MULTIPLIERS + 1];
    ZEROS(turn, 2 * N);
    for (int k = 0; k < 2 * N; k++) {
        turn[k] = 1;
        node_turn_of(q, v, t, u, lam, turn, turn + N, w, dp, df, dg);
        turn[k] = 0;
        for (int e = 0; e < COUPLED; e++)
            if (COUPLED_COLUMN[e] == k % N)
                (k < N ? p_q : p_v)[e] = dp[COUPLED_ROW[e]], (k < N ? f_q : f_v)[e] = df[COUPLED_ROW[e]];
        for (int e = 0; e < GAP_NONZEROS; e++)
            if (GAP_COLUMN[e] == k) gap_q[e] = dg[GAP_ROW[e]];
    }
}

/* What the sizes of the rows are for one step size: h, reciprocal sizes of momenta and gaps, and the same for each nonzero of the
   derivatives at a node, of G' and of G; behind them the part of the derivative that is always the same. */
#define BY_ROW (1 + N + MULTIPLIERS)
#define PULLED (BY_ROW + COUPLED)
#define BY_GAP (PULLED + GAP_NONZEROS)
#define STEADY_PART (BY_GAP + GAP_NONZEROS)
#define UNITS_SIZE (AT_NODES ? STEADY_PART + (STEADY_INERTIA ? BLOCKS : 8) : 1)

/* y + f x, and f x, of one number for each nonzero of the derivatives at a node, in whole chunks. */
INLINE void add_times(double f, const double *x, double *restrict y) {
    for (int e = 0; e < BLOCK; e += 8) AT_CHUNK(y, e) = chunk_fma(f, AT_CHUNK(x, e), AT_CHUNK(y, e));
}
INLINE void set_times(double f, const double *x, double *restrict y) {
    for (int e = 0; e < BLOCK; e += 8) AT_CHUNK(y, e) = f * AT_CHUNK(x, e);
}
INLINE void scale_rows(const double *by, double *restrict x) {
    for (int e = 0; e < BLOCK; e += 8) AT_CHUNK(x, e) *= AT_CHUNK(by, e);
}

/* To `slope`, what the momenta at node i add to it. */
INLINE void add_momenta(int i, double h, const double *p_q, const double *p_v, double *restrict slope) {
    const double *const basis = BASIS + i * DEGREE, *const rate = SLOPES + i * DEGREE;
    for (int k = 0; k < DEGREE; k++) {
        double by[BLOCK];
        set_times(rate[k], p_v, by);
        if (MOMENTUM_BY_Q && basis[k] != 0) add_times(h * basis[k], p_q, by);
        for (int j = 0; j < DEGREE; j++) add_times(WEIGHTS[i] * rate[j], by, slope + (j * DEGREE + k) * BLOCK);
    }
}

/* The same of the forces. */
INLINE void add_forces(int i, double h, const double *f_q, const double *f_v, double *restrict slope) {
    const double *const basis = BASIS + i * DEGREE, *const rate = SLOPES + i * DEGREE;
    for (int k = 0; k < DEGREE; k++) {
        const int moves = PUSH_BY_Q && basis[k] != 0;
        if (!PUSH_BY_V && !moves) continue;
        double by[BLOCK];
        set_times(PUSH_BY_V ? rate[k] : h * basis[k], PUSH_BY_V ? f_v : f_q, by);
        if (PUSH_BY_V && moves) add_times(h * basis[k], f_q, by);
        for (int j = 0; j < DEGREE; j++) {
            const double factor = h * WEIGHTS[i] * (j == DEGREE - 1 ? basis[j] - 1 : basis[j]);
            if (factor != 0) add_times(factor, by, slope + (j * DEGREE + k) * BLOCK);
        }
    }
}

LARGE void units_at_nodes(In w, double *units) {
    row_units_of(w, units);
    for (int e = 0; e < COUPLED; e++) units[BY_ROW + e] = units[1 + COUPLED_ROW[e]];
    for (int e = 0; e < GAP_NONZEROS; e++) {
        units[PULLED + e] = units[1 + GAP_COLUMN[e]], units[BY_GAP + e] = units[1 + N + GAP_ROW[e]];
    }
    if (STEADY_INERTIA) {
        double inertia[BLOCK];
        ZEROS(inertia, BLOCK);
        node_inertia_of(w, inertia);
        scale_rows(units + BY_ROW, inertia);
        ZEROS(units + STEADY_PART, BLOCKS);
        for (int i = 0; i < NODES; i++) add_momenta(i, units[0], 0, inertia, units + STEADY_PART);
    }
}

/* The residual by the sizes of its rows, the momentum gain and, where there is room for it, the derivative of the residual: block
   (j, k) of COUPLED numbers at (j DEGREE + k) BLOCK; then for each control point G', as it stands in the last row and in its
   own, and G. */
LARGE void sum_over_nodes(In y, In q, In p, double t, In u, In w, In units, double *restrict left, double *restrict total,
                          double *restrict slope) {
    double none[MULTIPLIERS + 1], gap_q[GAP_NONZEROS + 1], unused[MULTIPLIERS + 1], *reaction = slope ? slope + BLOCKS : 0;
    double p_q[BLOCK + 1], p_v[BLOCK + 1], f_q[BLOCK + 1], f_v[BLOCK + 1];
    const double h = units[0], *const size = units + 1, *const by_row = units + BY_ROW;
    ZEROS(total, N), ZEROS(left, DEGREE * N), ZEROS(none, MULTIPLIERS + 1);
    if (slope && STEADY_INERTIA) COPY(slope, units + STEADY_PART, BLOCKS);
    else if (slope) ZEROS(slope, BLOCKS);
    for (int e = COUPLED; e < BLOCK; e++) p_q[e] = p_v[e] = f_q[e] = f_v[e] = 0;
    for (int i = 0; i < NODES; i++) {
        const double *const basis = BASIS + i * DEGREE, *const rate = SLOPES + i * DEGREE, b = WEIGHTS[i];
        const double *const lam = i < DEGREE ? y + DEGREE * N + i * MULTIPLIERS : none;
        double at[N], v[N], momentum[N], push[N], *const gap = i ? left + DEGREE * N + (i - 1) * MULTIPLIERS : unused;
        const double time = t + h * POINT_TIMES[i];
        for (int a = 0; a < N; a++) at[a] = q[a], v[a] = rate[0] * y[a];
        for (int j = 1; j < DEGREE; j++)
            for (int a = 0; a < N; a++) v[a] = v_fma(rate[j], y[j * N + a], v[a]);
        for (int j = 0; j < DEGREE; j++)
            for (int a = 0; basis[j] != 0 && a < N; a++) at[a] = v_fma(h * basis[j], y[j * N + a], at[a]);
        const double *const held = u + i * NU;
        if (!slope) node_values_of(at, v, &time, held, lam, w, momentum, push, gap);
        else if (BY_DIRECTIONS) slopes_by_turns(at, v, &time, held, lam, w, momentum, push, gap, gap_q, p_q, p_v, f_q, f_v);
        else node_slopes_of(at, v, &time, held, lam, w, momentum, push, gap, gap_q, p_q, p_v, f_q, f_v);
        for (int a = 0; a < N; a++) total[a] = v_fma(h * b, push[a], total[a]), push[a] *= size[a], momentum[a] *= size[a];
        for (int j = 0; j < DEGREE; j++) {
            const double of_push = h * b * (j == DEGREE - 1 ? basis[j] - 1 : basis[j]), of_momentum = b * rate[j];
            double *const row = left + j * N;
            for (int a = 0; a < N; a++) row[a] = v_fma(of_push, push[a], v_fma(of_momentum, momentum[a], row[a]));
        }
        for (int g = 0; i && g < MULTIPLIERS; g++) gap[g] *= size[N + g];
        if (!slope) continue;
        if (STEADY_INERTIA && PUSH_BY_Q) scale_rows(by_row, f_q);
        if (STEADY_INERTIA && PUSH_BY_V) scale_rows(by_row, f_v);
        if (!STEADY_INERTIA) add_momenta(i, h, p_q, p_v, slope);
        if (PUSH_BY_Q || PUSH_BY_V) add_forces(i, h, f_q, f_v, slope);
        for (int e = 0; i < DEGREE && e < GAP_NONZEROS; e++) *reaction++ = -h * b * units[PULLED + e] * gap_q[e];
        for (int e = 0; i && i < DEGREE && e < GAP_NONZEROS; e++) *reaction++ = h * b * units[PULLED + e] * gap_q[e];
        for (int e = 0; i && e < GAP_NONZEROS; e++) *reaction++ = h * units[BY_GAP + e] * gap_q[e];
    }
    for (int block = 0; slope && !STEADY_INERTIA && block < DEGREE * DEGREE; block++) scale_rows(by_row, slope + block * BLOCK);
    for (int a = 0; a < N; a++) left[(DEGREE - 1) * N + a] = v_fnma(p[a], size[a], left[(DEGREE - 1) * N + a]);
}

/* The residual in the order of the band and, where there is room for it, its derivative. */
INLINE void equations_at_nodes(In y, In q, In p, In t, In u, In w, In units, double *b, double *jacobian) {
    double left[Y], total[N];
    sum_over_nodes(y, q, p, *t, u, w, units, left, total, jacobian);
    for (int k = 0; k < Y; k++) { ONE_BY_ONE; b[k] = left[PERM[k]]; }
}

INLINE void finish_at_nodes(In y, In q, In p, In t, In u, In w, In units, double *increment, double *gain, double *remains) {
    double sizes[N + MULTIPLIERS];
    sum_over_nodes(y, q, p, *t, u, w, units, remains, gain, 0);
    judged_of(y, q, p, t, gain, w, sizes);
    for (int a = 0; a < N; a++) increment[a] = units[0] * y[(DEGREE - 1) * N + a];
    for (int a = 0; a < N + MULTIPLIERS; a++) sizes[a] = 1 / (sizes[a] * units[1 + a]);
    for (int j = 0; j < DEGREE; j++)
        for (int a = 0; a < N; a++) remains[j * N + a] *= sizes[a];
    for (int j = 0; j < DEGREE; j++)
        for (int g = 0; g < MULTIPLIERS; g++) remains[DEGREE * N + j * MULTIPLIERS + g] *= sizes[N + g];
}
