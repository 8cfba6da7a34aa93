/* The right-hand side of scenes whose large inertia matrix is full: factorised in loops, not written out.

   Defined before this file: N coordinates, NU controls, STRIDE between the components of an argument, and the functions
   inertia(q, t, w, m, d), the rows of the lower triangle of M and the part d of p = M v + d, and push(q, v, t, u, w, f). */

#define RHS_W (INERTIA_W + PUSH_W)
#define VELOCITY_W 0
#define TRIANGLE (N * (N + 1) / 2)

INLINE V dot(const V *a, const V *b, int n) {
    V s[4] = {splat(0.0), splat(0.0), splat(0.0), splat(0.0)};
    int k = 0;
    for (; k + 4 <= n; k += 4)
        for (int i = 0; i < 4; i++) s[i] += a[(k + i) * STRIDE] * b[(k + i) * STRIDE];
    for (; k < n; k++) s[k & 3] += a[k * STRIDE] * b[k * STRIDE];
    return (s[0] + s[1]) + (s[2] + s[3]);
}

#define ROW(m, i) ((m) + (i) * ((i) + 1) / 2 * STRIDE)
#define BLOCK 4

/* x := M^-1 x by M = L D L^T, in place. Four rows at a time, so that the rows above are read a quarter as often. */
static __attribute__((noinline)) void solve(V *m, V *x) {
    V inverse[N];
    for (int first = 0; first < N; first += BLOCK) {
        const int rows = N - first < BLOCK ? N - first : BLOCK;
        V *a[BLOCK];
        for (int r = 0; r < BLOCK; r++) a[r] = ROW(m, first + (r < rows ? r : 0));
        for (int j = 0; j < first; j++) { /* a_ij = l_ij d_j */
            const V *above = ROW(m, j);
            V s[BLOCK] = {a[0][j * STRIDE], a[1][j * STRIDE], a[2][j * STRIDE], a[3][j * STRIDE]};
            for (int k = 0; k < j; k++)
                for (int r = 0; r < BLOCK; r++) s[r] -= a[r][k * STRIDE] * above[k * STRIDE];
            for (int r = 0; r < rows; r++) a[r][j * STRIDE] = s[r];
        }
        for (int r = 0; r < rows; r++) {
            const int i = first + r;
            for (int j = first; j < i; j++) a[r][j * STRIDE] -= dot(a[r], ROW(m, j), j);
            V d = a[r][i * STRIDE];
            for (int k = 0; k < i; k++) {
                V l = a[r][k * STRIDE] * inverse[k];
                d -= a[r][k * STRIDE] * l, a[r][k * STRIDE] = l;
            }
            inverse[i] = 1.0 / d;
            x[i * STRIDE] -= dot(a[r], x, i);
        }
    }
    for (int i = 0; i < N; i++) x[i * STRIDE] *= inverse[i];
    for (int i = N - 1; i > 0; i--)
        for (int k = 0; k < i; k++) x[k * STRIDE] -= ROW(m, i)[k * STRIDE] * x[i * STRIDE];
}

INLINE void rhs_prepare(const double *c, double *w) { inertia_prepare(c, w), push_prepare(c, w + INERTIA_W); }
INLINE void velocity_prepare(const double *c, double *w) { (void)c, (void)w; }

/* v from q and p, with the stride */
INLINE void speeds(const V *q, const V *p, const V *t, const double *w, V *v) {
    V m[TRIANGLE * STRIDE], d[N * STRIDE];
    inertia(q, t, w, m, d);
    for (int i = 0; i < N; i++) v[i * STRIDE] = p[i * STRIDE] - d[i * STRIDE];
    solve(m, v);
}

static __attribute__((noinline)) void rhs(const V *q, const V *p, const V *t, const V *u, const double *w, V *v, V *f) {
    speeds(q, p, t, w, v);
    push(q, v, t, u, w + INERTIA_W, f);
}

/* v at a single point; what inertia needs was prepared for the right-hand side, which lies before in w. */
static __attribute__((noinline)) void velocity(const V *q, const V *p, const V *t, const double *w, V *v) {
    V q_spread[N * STRIDE], p_spread[N * STRIDE], v_spread[N * STRIDE];
    for (int i = 0; i < N; i++) q_spread[i * STRIDE] = q[i], p_spread[i * STRIDE] = p[i];
    speeds(q_spread, p_spread, t, w - RHS_W, v_spread);
    for (int i = 0; i < N; i++) v[i] = v_spread[i * STRIDE];
}
