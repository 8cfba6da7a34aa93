/* The right-hand side of scenes whose large inertia matrix is full: V from P = M(Q) V + d(Q) by conjugate gradients.

   Defined before this file: N coordinates, NU controls, STAGES, the tableau, and the functions geometry(q, t, w, g, d), what
   the next two need of q, and d; product(q, g, v, t, w, y), y = M v; push(q, g, v, t, u, w, f).
   One factorisation M = L D L^T a step, halfway through it, serves all stages and rounds as preconditioner. A round starts
   from the speeds of the last one and reduces what they miss by REDUCTION, or more where the step asks for it, the iteration of the
   stages does the rest: its fixed point is that of the exact inverse. */

#define PUSH_AT (GEOMETRY_W + PRODUCT_W)
#define BLOCK 8
#define LD ((N + BLOCK - 1) / BLOCK * BLOCK)
#define FACTOR_AT (PUSH_AT + PUSH_W)
#undef RHS_W
#define RHS_W (FACTOR_AT + LD * LD + LD + 2 * BLOCK)
#undef VELOCITY_W
#define VELOCITY_W 0
#define PANEL 4
#define UNROLL _Pragma("GCC unroll 16")
#define REDUCTION (N > 32 ? 100.0 / (N * N) : 0.1)
#define MOST_DIRECTIONS 20

/* Behind what was prepared of the parameters: L by columns, beyond N zero; 1 / D; what is left of a round, times REDUCTION */
INLINE double *columns_in(const double *w) { return (double *)(((size_t)(w + FACTOR_AT) + 63) & ~(size_t)63); }
INLINE double *inverse_in(const double *w) { return columns_in(w) + LD * LD; }
INLINE double *left_in(const double *w) { return inverse_in(w) + LD; }

INLINE V part(const double *x) { V y; memcpy(&y, x, sizeof y); return y; }

/* M from its products with unit vectors, as many at once as there are lanes; by symmetry rows are columns. */
static __attribute__((noinline)) void factorise(const V *q, const V *t, const double *w) {
    double *const l = columns_in(w), *const inverses = inverse_in(w), scaled[LD * PANEL], d[LD];
    V g[GEOMETRY], x[LD], y[N];
    geometry(q, t, w, g, x);
    for (int i = 0; i < LD; i++) x[i] = splat(0.0);
    memset(l + N * LD, 0, (size_t)(LD - N) * LD * sizeof *l);
    for (int first = 0; first < LD; first += LANES) {
        for (int i = first; i < first + LANES && i < N; i++) set_lane(&x[i], i - first, 1.0);
        product(q, g, x, t, w + GEOMETRY_W, y);
        for (int i = first; i < first + LANES; i++) x[i] = splat(0.0);
        for (int i = 0; i < N; i++) memcpy(l + i * LD + first, &y[i], sizeof(V));
    }
    for (int first = 0; first < N; first += PANEL) {
        const int columns = N - first < PANEL ? N - first : PANEL;
        for (int k = 0; k < first; k++)
            for (int c = 0; c < PANEL; c++) scaled[k * PANEL + c] = l[k * LD + first + c] * d[k];
        for (int i = first / LANES * LANES; i < LD; i += LANES) {
            V a[PANEL];
            for (int c = 0; c < PANEL; c++) a[c] = c < columns ? part(l + (first + c) * LD + i) : splat(0.0);
            for (int k = 0; k < first; k++)
                for (int c = 0; c < PANEL; c++) a[c] = v_fnma(part(l + k * LD + i), splat(scaled[k * PANEL + c]), a[c]);
            for (int c = 0; c < columns; c++) memcpy(l + (first + c) * LD + i, &a[c], sizeof(V));
        }
        for (int j = first; j < first + columns; j++) {
            const double inverse = inverses[j] = 1 / (d[j] = l[j * LD + j]);
            double multiple[PANEL];
            for (int c = j - first + 1; c < columns; c++) multiple[c] = l[j * LD + first + c] * inverse;
            for (int i = first / LANES * LANES; i < LD; i += LANES) {
                const V own = part(l + j * LD + i), scaled_own = own * inverse;
                memcpy(l + j * LD + i, &scaled_own, sizeof(V));
                for (int c = j - first + 1; c < columns; c++) {
                    const V other = v_fnma(own, splat(multiple[c]), part(l + (first + c) * LD + i));
                    memcpy(l + (first + c) * LD + i, &other, sizeof(V));
                }
            }
        }
    }
}

/* x := (L D L^T)^-1 x, in place; x has LD rows, beyond N zero. */
static __attribute__((noinline)) void solve_factored(const double *w, V *x) {
    const double *const l = columns_in(w), *const inverses = inverse_in(w);
    for (int first = 0; first < N; first += BLOCK) {
        V a[BLOCK];
        for (int r = 0; r < BLOCK; r++) a[r] = x[first + r];
        for (int k = 0; k < first; k++)
            for (int r = 0; r < BLOCK; r++) a[r] = v_fnma(x[k], splat(l[k * LD + first + r]), a[r]);
        UNROLL for (int r = 0; r < BLOCK; r++) {
            x[first + r] = a[r];
            UNROLL for (int s = r + 1; s < BLOCK; s++) a[s] = v_fnma(a[r], splat(l[(first + r) * LD + first + s]), a[s]);
        }
    }
    for (int i = 0; i < N; i++) x[i] *= inverses[i];
    for (int first = LD - BLOCK; first >= 0; first -= BLOCK) {
        V a[BLOCK];
        for (int r = 0; r < BLOCK; r++) a[r] = x[first + r];
        for (int k = first + BLOCK; k < N; k++)
            for (int r = 0; r < BLOCK; r++) a[r] = v_fnma(x[k], splat(l[(first + r) * LD + k]), a[r]);
        UNROLL for (int r = BLOCK - 1; r >= 0; r--) {
            x[first + r] = a[r];
            UNROLL for (int s = 0; s < r; s++) a[s] = v_fnma(a[r], splat(l[(first + s) * LD + first + r]), a[s]);
        }
    }
}

INLINE V dot(const V *a, const V *b) {
    V s[4] = {splat(0.0), splat(0.0), splat(0.0), splat(0.0)};
    for (int k = 0; k < LD; k += 4)
        for (int i = 0; i < 4; i++) s[i] = v_fma(a[k + i], b[k + i], s[i]);
    return (s[0] + s[1]) + (s[2] + s[3]);
}

INLINE V ratio(V a, V b) { return choose(MASK(b == 0.0), splat(0.0), a / b); }

/* v, a first guess, becomes the solution of M v = p to REDUCTION; p is lost. */
static __attribute__((noinline)) void improve_speeds_at(const V *q, const V *g, const V *t, const double *w, V *p, V *v) {
    V z[LD], s[LD], y[LD];
    for (int i = N; i < LD; i++) p[i] = y[i] = splat(0.0);
    product(q, g, v, t, w + GEOMETRY_W, y);
    for (int i = 0; i < LD; i++) p[i] -= y[i], s[i] = z[i] = p[i];
    solve_factored(w, z);
    V size = dot(p, z);
    const double first = largest(v_fabs(size)), each = REDUCTION * *left_in(w), enough = each * each;
    for (int i = 0; i < LD; i++) s[i] = z[i];
    double left = 1, expected = 1;
    for (int count = 1;; count++) {
        product(q, g, s, t, w + GEOMETRY_W, y);
        V step = ratio(size, dot(s, y));
        for (int i = 0; i < N; i++) v[i] = v_fma(step, s[i], v[i]);
        if (left * expected <= enough || count == MOST_DIRECTIONS) break;
        for (int i = 0; i < N; i++) z[i] = p[i] = v_fnma(step, y[i], p[i]);
        for (int i = N; i < LD; i++) z[i] = splat(0.0);
        solve_factored(w, z);
        V next = dot(p, z);
        const double before = left;
        left = largest(v_fabs(next)) / first, expected = left / before;
        if (!(left > enough)) break;
        V turn = ratio(next, size);
        size = next;
        for (int i = 0; i < LD; i++) s[i] = v_fma(turn, s[i], z[i]);
    }
}

INLINE void rhs_prepare(const double *c, double *w) {
    geometry_prepare(c, w), product_prepare(c, w + GEOMETRY_W), push_prepare(c, w + PUSH_AT);
}
#ifndef SCENE_AS_DATA
INLINE void velocity_prepare(const double *c, double *w) { (void)c, (void)w; }
#endif

/* As preconditioner M in the middle of the step, where all stages' mean is; so many evaluations from now on begin with it. */
INLINE void renew(const V *q, const V *t, const double *w, int *renewals) {
    if (*renewals <= 0) return;
    --*renewals;
    V mean[N];
    V when = splat(0.0);
    for (int k = 0; k < STRIDE; k++) when = v_fma(t[k], part(STAGE_B + k * LANES), when);
    when = splat(sum(when));
    for (int i = 0; i < N; i++) {
        V weighted = splat(0.0);
        for (int k = 0; k < STRIDE; k++) weighted = v_fma(q[i * STRIDE + k], part(STAGE_B + k * LANES), weighted);
        mean[i] = splat(sum(weighted));
    }
    factorise(mean, &when, w);
}

/* v is the guess before and the result after. */
static __attribute__((noinline)) void rhs(const V *q, const V *p, const V *t, const V *u, const double *w, V *v, V *f) {
    V at[N], g[GEOMETRY], rest[LD], speed[LD], controls[NU + 1], force[N];
    for (int i = 0; i < N; i++) at[i] = q[i * STRIDE], speed[i] = v[i * STRIDE];
    for (int i = 0; i < NU; i++) controls[i] = u[i * STRIDE];
    geometry(at, t, w, g, rest);
    for (int i = 0; i < N; i++) rest[i] = p[i * STRIDE] - rest[i];
    improve_speeds_at(at, g, t, w, rest, speed);
    push(at, g, speed, t, controls, w + PUSH_AT, force);
    for (int i = 0; i < N; i++) v[i * STRIDE] = speed[i], f[i * STRIDE] = force[i];
}

/* The speeds from which the next round starts: those of the last one, x = b V; lanes beyond the stages repeat the last. */
INLINE void guess(const V *x, V b, V *v) {
    const V inverse = choose(MASK(b != 0.0), 1.0 / b, splat(0.0));
    for (int i = 0; i < N * STRIDE; i += STRIDE) {
        v[i] = x[i] * inverse;
        if (STAGES % LANES && lane(b, LANES - 1) == 0)
            v[i] = choose(MASK(b != 0.0), v[i], splat(lane(v[i], (STAGES - 1) % LANES)));
    }
}

/* v at a single point; what this needs was prepared for the right-hand side, which lies before in w. */
static __attribute__((noinline)) void velocity(const V *q, const V *p, const V *t, const double *w, V *v) {
    V g[GEOMETRY], x[LD];
    geometry(q, t, w - RHS_W, g, x);
    for (int i = 0; i < N; i++) x[i] = p[i] - x[i];
    for (int i = N; i < LD; i++) x[i] = splat(0.0);
    factorise(q, t, w - RHS_W);
    solve_factored(w - RHS_W, x);
    for (int i = 0; i < N; i++) v[i] = x[i];
}
