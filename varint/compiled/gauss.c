/* Gauss collocation with all stages in vectors, by fixed-point iteration.

   Defined before this file: N coordinates, NU controls, STAGES, FORM, ON_VELOCITY, the tableau and the scene's functions.
   FORM 2: unknown L_i = h b_i G_i with accelerations G = g(Q, V, t, u);
           Q_i = q + c_i h v + h sum_j M_ij L_j,  V_i = v + sum_j m_ij L_j;  q += h (v + sum (1 - c_j) L_j), v += sum L_j.
   FORM 1: unknown (h b_i V_i, h b_i F_i) with V, F from (Q, P, t, u); Q_i = q + sum_j m_ij h b_j V_j, P_i alike.
   m_ij = a_ij / b_j and M_ij = (A A)_ij / b_j are rounded so that the conditions of symplecticity and symmetry hold without
   rounding error (tableau.py): no drift comes from the coefficients however long the run. */

#define VECTORS ((STAGES + LANES - 1) / LANES)
#if VECTORS * LANES != PADDED
#error "the tableau is padded for another vector length"
#endif
#if FORM == 2
#define ROWS N
#else
#define ROWS (2 * N)
#endif
#define UNROLL _Pragma("GCC unroll 16")
#define EPS 0x1p-53

typedef struct {
    int64_t steps, save_every, first, most; /* steps to take; index of the first; largest number of iterations a step */
    double t0, h, level;                    /* level: wanted relative error of the stages, 0 for round-off */
    const double *start, *c, *u;            /* q and p at a fresh start; parameters; controls of every step's nodes */
    double *rows, *carry, *stats;           /* (q, p, v) of every saved node; carry[0] = 0: a fresh start */
} Args;

typedef double Block[VECTORS * LANES] __attribute__((aligned(64)));
typedef V Unknowns[ROWS][VECTORS];

/* What a run needs to go on as if it had not stopped. */
typedef struct {
    double steps_known, expected, h, reserved[5];
    double y[2 * N], rest[2 * N], scale[ROWS], rate[ROWS];
    double x[2][ROWS][PADDED];
} Carry;
const int64_t carry_size = sizeof(Carry) / sizeof(double);

INLINE V column(const double *m, int j, int k) { V y; memcpy(&y, m + j * PADDED + k * LANES, sizeof y); return y; }

/* y_i += sum_j m_ij x_j, with the columns of m one after the other */
INLINE void add_product(const double *m, const V *x, V *y) {
    V odd[VECTORS];
    for (int k = 0; k < VECTORS; k++) odd[k] = splat(0.0);
    UNROLL for (int j = 0; j < STAGES; j++) {
        V xj = SPREAD(x[j / LANES], j % LANES);
        for (int k = 0; k < VECTORS; k++) {
            if (j & 1) odd[k] += column(m, j, k) * xj;
            else y[k] += column(m, j, k) * xj;
        }
    }
    for (int k = 0; k < VECTORS; k++) y[k] += odd[k];
}

INLINE double total(const V *x) {
    V s = x[0];
    for (int k = 1; k < VECTORS; k++) s += x[k];
    return sum(s);
}

/* value += increment, with the rounding error kept in rest */
INLINE void compensated(double *value, double *rest, double increment) {
    double y = increment + *rest, old = *value, s = old + y, part = s - old;
    *rest = (old - (s - part)) + (y - part);
    *value = s;
}

typedef struct { V t[VECTORS], u[NU + 1][VECTORS], c[VECTORS], b[VECTORS]; } Nodes; /* times, controls, h c, h b */
typedef struct { double now[ROWS], best[ROWS], scale[ROWS], rate[ROWS], worst; int idle[ROWS], checks; } Change;

/* fresh = h b (right-hand side at the stages), the stages made of x by the columns m2 and m1; older adds to x. */
INLINE void evaluate(const double *y, const double *rest, const Nodes *at, double h, const double *w, const double *m2,
                     const double *m1, const Unknowns x, const double *m2_older, const double *m1_older,
                     const Unknowns older, Unknowns fresh) {
    V first[N][VECTORS], second[N][VECTORS];
    for (int d = 0; d < N; d++) {
        V f[VECTORS], s[VECTORS];
#if FORM == 2
        for (int k = 0; k < VECTORS; k++) f[k] = splat(0.0), s[k] = splat(rest[N + d]);
        add_product(m2, x[d], f);
        if (older) add_product(m2_older, older[d], f);
        for (int k = 0; k < VECTORS; k++) f[k] = y[d] + (h * f[k] + (at->c[k] * y[N + d] + rest[d]));
#if ON_VELOCITY
        add_product(m1, x[d], s);
        if (older) add_product(m1_older, older[d], s);
#endif
#else
        for (int k = 0; k < VECTORS; k++) f[k] = splat(rest[d]), s[k] = splat(rest[N + d]);
        add_product(m1, x[d], f), add_product(m1, x[N + d], s);
        if (older) add_product(m1_older, older[d], f), add_product(m1_older, older[N + d], s);
        for (int k = 0; k < VECTORS; k++) f[k] += y[d];
#endif
        for (int k = 0; k < VECTORS; k++) first[d][k] = f[k], second[d][k] = s[k] + y[N + d];
    }
    for (int k = 0; k < VECTORS; k++) {
#if FORM == 2
        rhs(&first[0][k], &second[0][k], &at->t[k], &at->u[0][k], w, &fresh[0][k]);
#else
        rhs(&first[0][k], &second[0][k], &at->t[k], &at->u[0][k], w, &fresh[0][k], &fresh[N][k]);
#endif
        for (int r = 0; r < ROWS; r++) fresh[r][k] *= at->b[k];
    }
}

/* Has the iteration come to its end? Each row's change is compared with the size of that row: the change itself is at
   round-off, or what contraction at the present rate leaves is below the level, or it stagnates near round-off (Hairer,
   McKenna & Razakarivony 2008), which for a row of cancelling terms may lie far above its own size. */
INLINE int settled(const Unknowns fresh, const Unknowns x, Change *c, double level) {
    int done = 1;
    c->worst = 0;
    for (int r = 0; r < ROWS; r++) {
        V d = v_fabs(fresh[r][0] - x[r][0]);
        for (int k = 1; k < VECTORS; k++) d = v_fmax(d, v_fabs(fresh[r][k] - x[r][k]));
        double now = largest(d), size = c->scale[r];
        if (c->checks) c->rate[r] = now < c->now[r] ? now / c->now[r] + 0x1p-10 : 1.0;
        else c->rate[r] = c->rate[r] < 0.1 ? 0.1 : c->rate[r]; /* that of the last step */
        if (!c->checks || now < 0.5 * c->best[r]) c->best[r] = now, c->idle[r] = 0;
        else c->idle[r] += 1;
        c->now[r] = now;
        if (now <= EPS * size || now * c->rate[r] <= level * size) continue;
        if (c->idle[r] >= 1 && now <= 0x1p-44 * size) continue;
        if (c->idle[r] >= 4) {
            double most = 0;
            for (int i = r / N * N; i < r / N * N + N; i++) most = c->scale[i] > most ? c->scale[i] : most;
            if (now <= 1e-9 * size || now <= 1e-13 * most) continue;
        }
        done = 0;
        if (!(now <= c->worst * size)) c->worst = now / size;
    }
    c->checks += 1;
    return done;
}

INLINE void save(double *row, const double *y, double t, const double *w) {
    V q[N], z[N], out[N], time = splat(t);
    for (int d = 0; d < N; d++) q[d] = splat(y[d]), z[d] = splat(y[N + d]);
#if FORM == 2
    momentum(q, z, &time, w + RHS_W + VELOCITY_W, out);
    for (int d = 0; d < N; d++) row[d] = y[d], row[N + d] = lane(out[d], 0), row[2 * N + d] = y[N + d];
#else
    velocity(q, z, &time, w + RHS_W, out);
    for (int d = 0; d < N; d++) row[d] = y[d], row[N + d] = y[N + d], row[2 * N + d] = lane(out[d], 0);
#endif
}

enum { DONE, NOT_CONVERGED, NOT_FINITE };

int run(const Args *a) {
    const int64_t steps = a->steps, first = a->first, most = a->most;
    const double t0 = a->t0, h = a->h, level = a->level > 0x1p-56 ? a->level : 0x1p-56;
    const double *u = a->u;
    double *rows = a->rows, w[RHS_W + VELOCITY_W + MOMENTUM_W + 1], y[2 * N], rest[2 * N];
    rhs_prepare(a->c, w);
    velocity_prepare(a->c, w + RHS_W), momentum_prepare(a->c, w + RHS_W + VELOCITY_W);
    Unknowns x, older;
    Nodes at;
    Change change;
    int64_t known = 0, expected = 0, iterations = 0, largest_count = 0, done = 0, unsaved = 0;
    int status = DONE;
    double slowest = 0;
    for (int k = 0; k < VECTORS; k++) at.c[k] = h * column(STAGE_C, 0, k), at.b[k] = h * column(STAGE_B, 0, k);

    Carry *carry = (Carry *)a->carry;
    if (carry->steps_known > 0 && carry->h == h) {
        known = (int64_t)carry->steps_known, expected = (int64_t)carry->expected;
        memcpy(y, carry->y, sizeof y), memcpy(rest, carry->rest, sizeof rest);
        memcpy(x, carry->x[0], sizeof x), memcpy(older, carry->x[1], sizeof older);
        for (int r = 0; r < ROWS; r++) change.scale[r] = carry->scale[r], change.rate[r] = carry->rate[r];
    } else {
        for (int d = 0; d < N; d++) y[d] = a->start[d], y[N + d] = a->start[N + d], rest[d] = rest[N + d] = 0;
#if FORM == 2
        V q[N], z[N], out[N], time = splat(t0 + h * (double)first);
        for (int d = 0; d < N; d++) q[d] = splat(y[d]), z[d] = splat(y[N + d]);
        velocity(q, z, &time, w + RHS_W, out);
        for (int d = 0; d < N; d++) y[N + d] = lane(out[d], 0);
#endif
        for (int r = 0; r < ROWS; r++) change.scale[r] = 0, change.rate[r] = 1;
        for (int r = 0; r < ROWS; r++)
            for (int k = 0; k < VECTORS; k++) x[r][k] = older[r][k] = splat(0.0);
    }

    save(rows, y, t0 + h * (double)first, w);
    if (!known) memcpy(rows, a->start, 2 * N * sizeof(double));
    rows += 3 * N;

    for (; done < steps; done++) {
        const double t = t0 + h * (double)(first + done);
        for (int k = 0; k < VECTORS; k++) at.t[k] = t + at.c[k];
#if NU
        for (int m = 0; m < NU; m++)
            for (int i = 0; i < PADDED; i++) set_lane(&at.u[m][i / LANES], i % LANES, u[(i < STAGES ? i : STAGES - 1) * NU + m]);
        u += STAGES * NU;
#endif
        Unknowns fresh, kept;
        memcpy(kept, x, sizeof x);
        int64_t count = 0;
        for (;;) { /* from the extrapolated start; where that fails, once more from a constant right-hand side */
            if (known > 1) evaluate(y, rest, &at, h, w, START_M2, START_M1, x, START_OLDER_M2, START_OLDER_M1, older, fresh);
            else if (known) evaluate(y, rest, &at, h, w, START_ONE_M2, START_ONE_M1, x, 0, 0, 0, fresh);
            else {
                for (int r = 0; r < ROWS; r++)
                    for (int k = 0; k < VECTORS; k++) x[r][k] = splat(0.0);
                evaluate(y, rest, &at, h, w, STAGE_M2, STAGE_M1, x, 0, 0, 0, fresh);
            }
            change.checks = 0;
            count = 1;
            int end = 0;
            while (count < most && !end) {
                memcpy(x, fresh, sizeof x);
                evaluate(y, rest, &at, h, w, STAGE_M2, STAGE_M1, x, 0, 0, 0, fresh);
                count++;
                if (count + 1 >= expected) {
                    if (!known)
                        for (int r = 0; r < ROWS; r++) { V s = v_fabs(fresh[r][0]); for (int k = 1; k < VECTORS; k++) s += v_fabs(fresh[r][k]); change.scale[r] = sum(s); }
                    end = settled(fresh, x, &change, level);
                }
            }
            iterations += count;
            if (end) break;
            if (!known) { status = NOT_CONVERGED; break; }
            known = expected = 0;
        }
        if (status) break;
        expected = count;
        largest_count = count > largest_count ? count : largest_count;
        memcpy(older, kept, sizeof x);
        memcpy(x, fresh, sizeof x);
        known += known < 2;
        double old[2 * N], lost[2 * N];
        memcpy(old, y, sizeof y), memcpy(lost, rest, sizeof rest);
        int finite = 1;
        for (int d = 0; d < N; d++) {
#if FORM == 2
            V moved[VECTORS];
            for (int k = 0; k < VECTORS; k++) moved[k] = column(STAGE_BETA, 0, k) * x[d][k];
            compensated(&y[d], &rest[d], h * (y[N + d] + total(moved)));
            compensated(&y[N + d], &rest[N + d], total(x[d]));
#else
            compensated(&y[d], &rest[d], total(x[d]));
            compensated(&y[N + d], &rest[N + d], total(x[N + d]));
#endif
            finite &= fabs(y[d]) < INFINITY && fabs(y[N + d]) < INFINITY;
        }
        if (!finite) { memcpy(y, old, sizeof y), memcpy(rest, lost, sizeof rest), status = NOT_FINITE; break; }
        for (int r = 0; r < ROWS; r++) { /* an oscillating row keeps its size where it passes zero */
            V s = v_fabs(x[r][0]);
            for (int k = 1; k < VECTORS; k++) s += v_fabs(x[r][k]);
            double now = sum(s), faded = 0.9 * change.scale[r];
#if FORM == 2
            now = fabs(y[N + r]) > now ? fabs(y[N + r]) : now;
#endif
            change.scale[r] = now > faded ? now : faded;
            slowest = change.rate[r] > slowest ? change.rate[r] : slowest;
        }
        if (++unsaved == a->save_every)
            unsaved = 0, save(rows, y, t0 + h * (double)(first + done + 1), w), rows += 3 * N;
    }
    save(a->stats + 6, y, t0 + h * (double)(first + done), w);
    carry->steps_known = status ? 0 : (double)known, carry->expected = (double)expected, carry->h = h;
    memcpy(carry->y, y, sizeof y), memcpy(carry->rest, rest, sizeof rest);
    memcpy(carry->x[0], x, sizeof x), memcpy(carry->x[1], older, sizeof older);
    for (int r = 0; r < ROWS; r++) carry->scale[r] = change.scale[r], carry->rate[r] = change.rate[r];
    a->stats[0] = status, a->stats[1] = (double)done, a->stats[2] = (double)iterations, a->stats[3] = (double)largest_count;
    a->stats[4] = status ? change.worst : 0, a->stats[5] = slowest;
    return status;
}
