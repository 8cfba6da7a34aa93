/* A linear scene of few unknowns: its step is q, p -> M (q, p) + o, whose matrices are found once for a step size.

   The equations are A y + B (q, p) + l(t, u) = 0, and what follows is D y + E (q, p) + f(t, u): hence K = -D A^-1,
   M = E + K B and o = f + K l. `slope` gives the entries of A, `affine` B, D and E column by column, `driven` l and f.
   STEADY: these do not depend on t and u. In memory they stand behind the factors of A, M by columns. */
#define BOTH (2 * N) /* q and p, and what they gain */
#define MAP_AT BAND_SIZE
#define FROM_LEFT_AT (MAP_AT + BOTH * BOTH)
#define OFFSET_AT (FROM_LEFT_AT + BOTH * Y)

/* o at this time; `parts` is room for l and f. */
INLINE void offset_now(const double *matrix, double t, const double *u, const double *w, double *parts, double *o) {
    const double *const from_left = matrix + FROM_LEFT_AT;
    driven_of(&t, u, w, parts);
    for (int i = 0; i < BOTH; i++) o[i] = parts[Y + i];
    for (int k = 0; k < Y; k++)
        for (int i = 0; i < BOTH; i++) o[i] = v_fma(from_left[k * BOTH + i], parts[k], o[i]);
}

/* The matrices, once A is factorised: every step repeats their round-off, so that it must be their last digit's. */
LARGE void prepare_map(const double *w, double *matrix, const int *pivots) {
    const int width = BELOW + REACH;
    double jacobian[NONZEROS + 1], parts[2 * BOTH * Y + BOTH * BOTH], a[BAND_SIZE], b[Y + REACH], low[BOTH * Y];
    double *const map = matrix + MAP_AT, *const from_left = matrix + FROM_LEFT_AT;
    slope_of(w, jacobian), affine_of(w, parts);
    ZEROS(a, BAND_SIZE);
    for (int i = 0; i < NONZEROS; i++) a[AT[i]] = jacobian[i];
    const double *const left = parts, *const by_y = left + BOTH * Y, *const by_start = by_y + BOTH * Y;
    for (int i = 0; i < BOTH; i++) {
        double x[Y];
        ZEROS(b, Y + REACH), ZEROS(x, Y);
        for (int k = 0; k < Y; k++) b[k] = by_y[PERM[k] * BOTH + i];
        for (int round = 0;; round++) { /* -x A = D, once more for what is missing */
            substitute_transposed(Y, BELOW, REACH, matrix, pivots, b);
            for (int k = 0; k < Y; k++) {
                const double before = x[k];
                x[k] -= b[k];
                low[PERM[k] * BOTH + i] = (before - x[k]) - b[k];
            }
            if (round) break;
            ZEROS(b, Y + REACH);
            for (int k = 0; k < Y; k++) {
                double high = by_y[PERM[k] * BOTH + i], rest = 0;
                for (int r = 0; r < Y; r++)
                    if (r - k <= BELOW && k - r <= REACH) add_exactly(&high, &rest, x[r], a[r * width + BELOW + k]);
                b[k] = high + rest;
            }
        }
        for (int k = 0; k < Y; k++) from_left[PERM[k] * BOTH + i] = x[k];
    }
    for (int j = 0; j < BOTH; j++)
        for (int i = 0; i < BOTH; i++) {
            double high = by_start[j * BOTH + i], rest = 0;
            for (int k = 0; k < Y; k++) {
                add_exactly(&high, &rest, from_left[k * BOTH + i], left[j * Y + k]);
                rest = v_fma(low[k * BOTH + i], left[j * Y + k], rest);
            }
            map[j * BOTH + i] = high + rest;
        }
    if (STEADY) {
        double l[Y + BOTH];
        offset_now(matrix, 0, 0, w, l, matrix + OFFSET_AT);
    }
}

/* What the step adds to q and p. */
INLINE void mapped(const double *matrix, const double *q, const double *p, double t, const double *u, const double *w,
                   double *increment, double *gain) {
    const double *const map = matrix + MAP_AT;
    double parts[Y + BOTH], o[BOTH];
    if (STEADY) COPY(o, matrix + OFFSET_AT, BOTH);
    else offset_now(matrix, t, u, w, parts, o);
    for (int j = 0; j < BOTH; j++) {
        const double x = j < N ? q[j] : p[j - N];
        for (int i = 0; i < BOTH; i++) o[i] = v_fma(map[j * BOTH + i], x, o[i]);
    }
    COPY(increment, o, N), COPY(gain, o + N, N);
}

/* What remains of the equations at the unknowns that belong to this map. */
LARGE void checked(const double *matrix, const int *pivots, const double *q, const double *p, double t, const double *u,
                   const double *w, double *remains) {
    double parts[2 * BOTH * Y + BOTH * BOTH], l[Y + BOTH], b[Y + REACH], y[Y], increment[N], gain[N];
    affine_of(w, parts), driven_of(&t, u, w, l);
    ZEROS(b, Y + REACH);
    for (int j = 0; j < BOTH; j++)
        for (int k = 0; k < Y; k++) l[k] = v_fma(parts[j * Y + k], j < N ? q[j] : p[j - N], l[k]);
    for (int k = 0; k < Y; k++) b[k] = l[PERM[k]];
    substitute(Y, BELOW, REACH, matrix, pivots, b);
    for (int k = 0; k < Y; k++) y[PERM[k]] = -b[k];
    finished(y, q, p, &t, u, w, increment, gain, remains);
}
