/* Gauss collocation of many members at once, one in each lane, by fixed-point iteration; see gauss.c for the method.

   Defined before this file: N coordinates, NC parameters, NU controls, STAGES, FORM, ON_VELOCITY, the tableau as matrices and
   the scene's functions, whose parameters are inputs here. All lanes are iterated until the last of them has settled; one
   that has settled is frozen, so that a member's arithmetic does not depend on its neighbours (but see members.c). A lane
   whose iteration does not contract is given up; Newton's method can be tried on that member alone. */

#if FORM == 2
#define ROWS N
#else
#define ROWS (2 * N)
#endif
#define EPS 0x1p-53
#define LEVEL 0x1p-56
#define IDLE 4.0 /* these as in gauss.h */
#define LONG_IDLE 16.0
#define NOISE 1e-10
#define DRIFTS 3.0

typedef V Unknowns[STAGES][ROWS];
typedef struct { double t[STAGES], c[STAGES], b[STAGES]; V u[STAGES][NU + 1]; } Nodes; /* times, h c, h b or h^2 b */
typedef struct { V scale[ROWS], best[ROWS], idle[ROWS], now, rate; Unknowns from; } Change;

INLINE I all_bits(void) { return (I){0} == 0; }
INLINE int any(I mask) { int64_t y = 0; for (int l = 0; l < LANES; l++) y |= mask[l]; return y != 0; }

/* value_i = base_i + sum_j m_ij x_j, stage by stage, for the coordinates from `row` of the unknowns on */
INLINE void add_product(const double m[STAGES][STAGES], const Unknowns x, int row, V value[STAGES][N]) {
    for (int i = 0; i < STAGES; i++)
        for (int d = 0; d < N; d++) {
            V sum = m[i][0] * x[0][row + d];
            for (int j = 1; j < STAGES; j++) sum += m[i][j] * x[j][row + d];
            value[i][d] += sum;
        }
}

typedef const double Matrix[STAGES][STAGES];

/* Where the stages are: base and the unknowns through m2 and m1; `older` adds to x. */
INLINE void stages(const V *y, const V *rest, double h, Matrix m2, Matrix m1, const Unknowns x, Matrix m2_older,
                   Matrix m1_older, const V (*older)[ROWS], V first[STAGES][N], V second[STAGES][N]) {
    for (int i = 0; i < STAGES; i++)
        for (int d = 0; d < N; d++) {
#if FORM == 2
            first[i][d] = y[d] + (STAGE_C[i] * y[N + d] + rest[d]);
#else
            first[i][d] = y[d] + rest[d];
#endif
            second[i][d] = y[N + d] + rest[N + d];
        }
#if FORM == 2
    add_product(m2, x, 0, first);
    if (older) add_product(m2_older, older, 0, first);
#if ON_VELOCITY
    add_product(m1, x, 0, second);
    if (older) add_product(m1_older, older, 0, second);
    for (int i = 0; i < STAGES; i++)
        for (int d = 0; d < N; d++) second[i][d] *= 1 / h;
#endif
#else
    add_product(m1, x, 0, first), add_product(m1, x, N, second);
    if (older) add_product(m1_older, older, 0, first), add_product(m1_older, older, N, second);
#endif
    (void)m1, (void)m2, (void)m1_older, (void)m2_older, (void)h;
}

/* fresh = h b (right-hand side at the stages) */
static __attribute__((noinline)) void evaluate(const V first[STAGES][N], const V second[STAGES][N], const Nodes *at,
                                               const V *c, Unknowns fresh) {
    const double none[1] = {0};
    for (int i = 0; i < STAGES; i++) {
        V t = splat(at->t[i]);
#if FORM == 2
        rhs(first[i], second[i], &t, at->u[i], c, none, fresh[i]);
#else
        rhs(first[i], second[i], &t, at->u[i], c, none, fresh[i], fresh[i] + N);
#endif
        for (int r = 0; r < ROWS; r++) fresh[i][r] *= at->b[i];
    }
}

/* Which lanes have come to their end; the criteria of gauss.c in every lane. `checks` counts the looks in this step. */
static __attribute__((noinline)) I settled(const Unknowns fresh, const Unknowns x, Change *c, int checks) {
    V change[ROWS], worst = splat(0.0);
    for (int r = 0; r < ROWS; r++) {
        change[r] = v_fabs(fresh[0][r] - x[0][r]);
        for (int i = 1; i < STAGES; i++) change[r] = v_fmax(change[r], v_fabs(fresh[i][r] - x[i][r]));
        worst = v_fmax(worst, change[r] / (c->scale[r] + 1e-300));
    }
    const V now = worst, before = c->now;
    c->now = now;
    I done = now <= EPS;
    if (!checks) {
        for (int r = 0; r < ROWS; r++) c->best[r] = splat(INFINITY), c->idle[r] = splat(0.0);
        return done | (now * c->rate <= LEVEL);
    }
    done |= now * now <= LEVEL * v_fmin(before, splat(1.0));
    const I stuck = ~done & ~(now < 0.5 * before);
    if (any(stuck)) {
        I all = all_bits();
        for (int r = 0; r < ROWS; r++) {
            const V size = c->scale[r];
            V most = splat(0.0);
            for (int i = r / N * N; i < r / N * N + N; i++) most = v_fmax(most, c->scale[i]);
            const I better = stuck & (change[r] < 0.5 * c->best[r]);
            c->best[r] = choose(better, change[r], c->best[r]);
            c->idle[r] = choose(stuck, choose(better, splat(0.0), c->idle[r] + 1.0), c->idle[r]);
            V moved = splat(0.0);
            for (int i = 0; i < STAGES; i++) {
                c->from[i][r] = choose(better, fresh[i][r], c->from[i][r]);
                moved = v_fmax(moved, v_fabs(fresh[i][r] - c->from[i][r]));
            }
            const V part = choose(c->idle[r] >= LONG_IDLE, splat(NOISE), splat(1e-12));
            const I near = (change[r] <= EPS * size) | (change[r] <= LEVEL * size) | ((c->idle[r] >= 1.0) & (change[r] <= 0x1p-44 * size));
            const I idle = ~near & (c->idle[r] >= IDLE) & ((change[r] <= part * size) | (change[r] <= 1e-13 * most));
            const I drifts = stuck & idle & (moved > DRIFTS * change[r]), shrinks = stuck & idle & (change[r] < c->best[r]);
            c->best[r] = choose(drifts | shrinks, change[r], c->best[r]);
            c->idle[r] = choose(drifts, splat(0.0), c->idle[r]);
            for (int i = 0; i < STAGES; i++) c->from[i][r] = choose(drifts, fresh[i][r], c->from[i][r]);
            all &= near | (idle & ~drifts & ~shrinks);
        }
        done |= stuck & all;
    }
    c->rate = choose(done, v_fmin(v_fmax(now / before, splat(0.1)), splat(1.0)), c->rate);
    return done;
}

INLINE void sizes_of(const Unknowns x, V *size) {
    for (int r = 0; r < ROWS; r++) {
        size[r] = v_fabs(x[0][r]);
        for (int i = 1; i < STAGES; i++) size[r] += v_fabs(x[i][r]);
    }
}

/* Iterate the lanes of `going` from the stages given to their end, in place; returns those that came to one. */
static I iterated(const V *y, const V *rest, const Nodes *at, double h, const V *c, Change *change, I going, I opening,
                  V first[STAGES][N], V second[STAGES][N], Unknowns x, V *counts) {
    Unknowns fresh;
    evaluate(first, second, at, c, fresh);
    for (int i = 0; i < STAGES; i++)
        for (int r = 0; r < ROWS; r++) x[i][r] = choose(going, fresh[i][r], x[i][r]);
    I ended = ~going;
    *counts += real_of(going & bits_of(splat(1.0)));
    for (int count = 1; count < MOST && any(~ended); count++) {
        stages(y, rest, h, STAGE_M2, STAGE_M1, x, STAGE_M2, STAGE_M1, 0, first, second);
        evaluate(first, second, at, c, fresh);
        if (any(opening)) {
            V size[ROWS];
            sizes_of(fresh, size);
            for (int r = 0; r < ROWS; r++) change->scale[r] = choose(opening & ~ended, size[r], change->scale[r]);
        }
        const V rate = change->rate;
        const I done = settled(fresh, x, change, count - 1);
        change->rate = choose(ended, rate, change->rate);
        *counts += real_of(~ended & bits_of(splat(1.0)));
        for (int i = 0; i < STAGES; i++)
            for (int r = 0; r < ROWS; r++) x[i][r] = choose(ended, x[i][r], fresh[i][r]);
        ended |= done;
    }
    return ended & going;
}

/* 1 in the lanes whose numbers are all finite */
INLINE I sound_lanes(const V *y, int count) {
    V zero = splat(0.0);
    for (int d = 0; d < count; d++) zero += y[d] * 0.0;
    return zero == 0.0;
}

static int64_t run_group(const MembersArguments *a, const Group *g) {
    const double h = a->h, t0 = a->t0, none[1] = {0};
    V y[2 * N], rest[2 * N], c[NC + 1], counts = splat(0.0);
    Unknowns x, older;
    Change change;
    Nodes at;
    load(a->q0, N, g, y), load(a->p0, N, g, y + N), load(a->c, NC, g, c);
    for (int i = 0; i < STAGES; i++) at.c[i] = h * STAGE_C[i], at.b[i] = (FORM == 2 ? h * h : h) * STAGE_B[i];
#if FORM == 2
    V begin = splat(t0), speed[N];
    velocity(y, y + N, &begin, c, none, speed);
    for (int d = 0; d < N; d++) y[N + d] = h * speed[d];
#endif
    for (int d = 0; d < 2 * N; d++) rest[d] = splat(0.0);
    for (int r = 0; r < ROWS; r++) change.scale[r] = splat(0.0);
    for (int i = 0; i < STAGES; i++)
        for (int r = 0; r < ROWS; r++) x[i][r] = older[i][r] = splat(0.0);
    change.rate = splat(1.0), change.now = splat(0.0);
    V known = splat(0.0); /* steps before this one that the start values may use: 0, 1 or 2 */
    I alive = all_bits();
    int64_t row = 1, unsaved = 0;
    for (int64_t k = 0; k < a->steps && any(alive); k++) {
        const double t = t0 + h * (double)k;
        for (int i = 0; i < STAGES; i++) at.t[i] = t + at.c[i];
#if NU
        for (int l = 0; l < LANES; l++) {
            const double *u = a->u + g->at[l] * a->apart + k * STAGES * NU;
            for (int i = 0; i < STAGES; i++)
                for (int m = 0; m < NU; m++) set_lane(&at.u[i][m], l, u[i * NU + m]);
        }
#endif
        V first[STAGES][N], second[STAGES][N];
        Unknowns kept;
        memcpy(kept, x, sizeof x);
        stages(y, rest, h, START_M2, START_M1, x, START_OLDER_M2, START_OLDER_M1, older, first, second);
        const I fresh_start = known == 0.0, one = known == 1.0;
        if (any(fresh_start | one)) {
            V q[STAGES][N], p[STAGES][N];
            Unknowns zero;
            memset(zero, 0, sizeof zero);
            stages(y, rest, h, START_ONE_M2, START_ONE_M1, x, STAGE_M2, STAGE_M1, 0, q, p);
            for (int i = 0; i < STAGES; i++)
                for (int d = 0; d < N; d++)
                    first[i][d] = choose(one, q[i][d], first[i][d]), second[i][d] = choose(one, p[i][d], second[i][d]);
            stages(y, rest, h, STAGE_M2, STAGE_M1, zero, STAGE_M2, STAGE_M1, 0, q, p);
            for (int i = 0; i < STAGES; i++)
                for (int d = 0; d < N; d++)
                    first[i][d] = choose(fresh_start, q[i][d], first[i][d]), second[i][d] = choose(fresh_start, p[i][d], second[i][d]);
        }
        I solved = iterated(y, rest, &at, h, c, &change, alive, fresh_start, first, second, x, &counts);
        const I again = alive & ~solved & ~fresh_start; /* once more from a constant right-hand side */
        if (any(again)) {
            Unknowns zero;
            memset(zero, 0, sizeof zero);
            stages(y, rest, h, STAGE_M2, STAGE_M1, zero, STAGE_M2, STAGE_M1, 0, first, second);
            solved |= iterated(y, rest, &at, h, c, &change, again, again, first, second, x, &counts);
            known = choose(again, splat(0.0), known);
        }
        if (k + 1 == PILOT) solved &= ~(counts > POOR * (double)PILOT);
        V old[2 * N], lost[2 * N], size[ROWS];
        memcpy(old, y, sizeof y), memcpy(lost, rest, sizeof rest);
        sizes_of(x, size);
#if FORM == 2
        for (int d = 0; d < N; d++) {
            V moved = (1.0 - STAGE_C[0]) * x[0][d], pushed = x[0][d];
            for (int i = 1; i < STAGES; i++) moved += (1.0 - STAGE_C[i]) * x[i][d], pushed += x[i][d];
            v_compensated(&y[d], &rest[d], y[N + d] + (moved + rest[N + d]));
            v_compensated(&y[N + d], &rest[N + d], pushed);
            size[d] = v_fmax(size[d], v_fabs(y[N + d]));
        }
#else
        for (int r = 0; r < ROWS; r++) {
            V moved = x[0][r];
            for (int i = 1; i < STAGES; i++) moved += x[i][r];
            v_compensated(&y[r], &rest[r], moved);
        }
#endif
        solved &= sound_lanes(y, 2 * N);
        for (int d = 0; d < 2 * N; d++) y[d] = choose(solved, y[d], old[d]), rest[d] = choose(solved, rest[d], lost[d]);
        for (int r = 0; r < ROWS; r++) change.scale[r] = choose(solved, v_fmax(size[r], 0.9 * change.scale[r]), change.scale[r]);
        for (int i = 0; i < STAGES; i++)
            for (int r = 0; r < ROWS; r++)
                older[i][r] = choose(solved, kept[i][r], splat(0.0)), x[i][r] = choose(solved, x[i][r], splat(0.0));
        known = choose(solved, v_fmin(known + 1.0, splat(2.0)), splat(0.0));
        alive &= solved;
        if (++unsaved < a->save_every && k + 1 < a->steps) continue;
        unsaved = 0;
        V node[N];
#if FORM == 2
        V time = splat(t0 + h * (double)(k + 1)), v[N];
        for (int d = 0; d < N; d++) v[d] = y[N + d] / h;
        momentum(y, v, &time, c, none, node);
#else
        for (int d = 0; d < N; d++) node[d] = y[N + d];
#endif
        const I sound = alive & sound_lanes(node, N);
        for (int l = 0; l < g->count; l++)
            if (sound[l]) save(a, g->at[l], l, row, y, node);
        alive &= sound;
        row++;
    }
    int64_t failed = 0;
    for (int l = 0; l < g->count; l++) failed += !alive[l];
    return failed;
}
