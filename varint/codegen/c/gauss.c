/* Gauss collocation with all stages in vectors, by fixed-point iteration.

   Defined before this file: N coordinates, NU controls, STAGES, FORM, ON_VELOCITY, the tableau, the scene's functions,
   NEEDS_Q, NEEDS_P: whose values at the stages are needed, and AHEAD: is the next step begun while this one is iterated?
   Evaluations of two steps side by side take little longer than of one where they are so short that latency counts.
   FORM 2: unknown L_i = h^2 b_i G_i with accelerations G = g(Q, V, t, u);
           Q_i = q + c_i w + sum_j M_ij L_j,  h V_i = w + sum_j m_ij L_j;  q += w + sum (1 - c_j) L_j, w += sum L_j
           with w = h v, which leaves constants only that need no rounding.
   FORM 1: unknown (h b_i V_i, h b_i F_i) with V, F from (Q, P, t, u); Q_i = q + sum_j m_ij h b_j V_j, P_i alike. Where
           the right-hand side has two halves, V may come from the momenta that the new F make (Gauss-Seidel order).
           BY_DEFECT: V is improved by what its momenta miss, V += A M^-1 A^-1 (P - p(Q, V)), M^-1 at the stage where the
           rate A^-1 (P - p)/h is missed, taken once a step where its first evaluation puts the stages. The iteration contracts as accelerations depend on the motion, h da/dv + h^2 da/dq,
           where V from P contracts as M^-1 dp/dq does, which in long chains of links is hundreds of times more.
   m_ij = a_ij / b_j and M_ij = (A A)_ij / b_j are rounded so that the conditions of symplecticity and symmetry hold without
   rounding error (tableau.py): no drift comes from the coefficients however long the run.

   Where the scene is compiled, this file is so twice. With SCENE_APART defined it is all that depends on the size alone, once
   for every machine; with LOOP_APART, in gauss_scene.c, it is the scene's own: the iteration of a step, which has the scene's
   functions in line. Each has a table of what the other calls, once a step or less often. */

#ifndef SCENE_AS_DATA
#define MOST_N N /* room in arrays */
#define MOST_NU NU
#define VECTORS ((STAGES + LANES - 1) / LANES)
#if VECTORS * LANES != PADDED
#error "the tableau is padded for another vector length"
#endif
#endif
#define UNKNOWNS_EACH (FORM == 2 ? 1 : 2)
#define ROWS (UNKNOWNS_EACH * N)
#define MOST_ROWS (UNKNOWNS_EACH * MOST_N)
#ifndef DENSE /* dense.c */
#define DENSE 0
#endif
#define ALWAYS_LOOK DENSE /* it costs nothing beside an evaluation */
#if !defined(SCENE_AS_DATA) && !defined(BY_DEFECT)
#define BY_DEFECT 0
#endif
#if FORM == 1 && !DENSE
#define HALVES 1
#ifdef SCENE_AS_DATA
#define KICK kick
#elif BY_DEFECT
#define KICK(q, p, t, u, w, f, had, taken) kick(q, p, t, u, w, f, had)
#else
#define KICK(q, p, t, u, w, f, had, taken) kick(q, p, t, u, w, f, taken)
#endif
#ifndef SCENE_APART
#ifndef INERTIA_W
#define INERTIA_W 0
#define inertia(q, t, w, taken) ((void)0)
#define inertia_prepare(c, w) ((void)0)
#endif
#ifndef RHS_W
#define RHS_W (KICK_W + DRIFT_W + INERTIA_W)
#endif
#endif
#else
#define HALVES 0
#endif
#define UNROLL _Pragma("GCC unroll 16")
#define EPS 0x1p-53
#define NEAR 0x1p-44 /* round-off is near: a change that has not halved once is taken for it */
#define WANDERS 1e-12 /* round-off that wanders from row to row of long chains, up to the last iteration */
#define LOOSE (FORM == 1 ? 1e-8 : INFINITY) /* errors of the stages of this size a start of high degree amplifies too much */
#define CAREFUL 200 /* steps that start from a low degree after a start of high degree has failed */
#define DIVERGED 2 /* times the first change: the start was too far off */
#define TRIAL 32 /* steps in either order, after which it is known in which the halves converge sooner */
#define LATELY 8 /* steps that count in a mean that fades */
#define WORSE 1.3 /* times as many evaluations as lately: the other order is not tried to the end */
#define LONGER (AHEAD ? 1.05 : 1.15) /* time of an evaluation of one half after the other, relative to both at once */
#define SMALL_WORK 1e-9 /* of a change that no longer shrinks, beside the action of the step: round-off of large momenta */
#define KEPT_NOISE 0.95 /* from step to step: sooner or later it is looked at again */

#define APART static __attribute__((noinline))
#ifdef SCENE_AS_DATA
#define MANY_COORDINATES 1
#elif N > FEW
#define MANY_COORDINATES 1
#else
#define MANY_COORDINATES 0
#endif
#if MANY_COORDINATES
#define LARGE static __attribute__((noinline, noclone))
#else
#define LARGE INLINE
#endif
#ifdef SCENE_AS_DATA /* how many coordinates there are is not known here */
#define EACH
#define PRODUCT APART
#else
#define EACH UNROLL
#define PRODUCT INLINE
#endif
#define UNKNOWNS_SIZE ((size_t)ROWS * PADDED * sizeof(double))
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof *(from))

typedef double Block[VECTORS * LANES] __attribute__((aligned(64)));
typedef V Unknowns[MOST_ROWS][VECTORS];

#ifndef LOOP_APART
/* What a run needs to go on as if it had not stopped: these numbers, and behind them y and its rest, 2 N each, what the
   scales remember, ROWS each, and the unknowns of the last two steps and of the one that is begun. */
typedef struct {
    double steps_known, expected, h, rate, work, low, count, tried, counts[3]; /* of the steps tried in either order */
    double numbers[];
} Carry;
#define CARRY_SIZE (int64_t)(sizeof(Carry) / sizeof(double) + 4 * N + ROWS * (2 + 3 * PADDED))
#ifdef SCENE_AS_DATA
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }
#else
const int64_t carry_size = CARRY_SIZE;
#endif
#endif

INLINE V entry(const double *m, int index) { V y; memcpy(&y, m + index * LANES, sizeof y); return y; }

/* y_i += sum_j m_ij x_j. By diagonals, m holds for every turn r of the lanes what multiplies x turned by r: no lane need
   be spread over a register. By columns, m holds its columns one after the other. */
PRODUCT void add_product(const double *m, const V *x, V *y) {
    V parts[VECTORS][4];
    for (int k = 0; k < VECTORS; k++) parts[k][0] = y[k], parts[k][1] = parts[k][2] = parts[k][3] = splat(0.0);
    if (DIAGONALS) {
        for (int l = 0; l < VECTORS; l++) {
            V turned[LANES];
            turned_lanes(x[l], turned);
            UNROLL for (int r = 0; r < LANES; r++)
                for (int k = 0; k < VECTORS; k++)
                    parts[k][r & 3] = v_fma(entry(m, (l * LANES + r) * VECTORS + k), turned[r], parts[k][r & 3]);
        }
    } else {
        UNROLL for (int j = 0; j < PADDED; j++) {
            if (j == STAGES) break;
#if MANY_COORDINATES
            V xj = splat(((const double *)x)[j]);
#else
            V xj = SPREAD(x[j / LANES], j % LANES);
#endif
            for (int k = 0; k < VECTORS; k++) parts[k][j & 1] = v_fma(entry(m, j * VECTORS + k), xj, parts[k][j & 1]);
        }
    }
    for (int k = 0; k < VECTORS; k++) y[k] = (parts[k][0] + parts[k][1]) + (parts[k][2] + parts[k][3]);
}

INLINE V folded(const V *x) {
    V s = x[0];
    for (int k = 1; k < VECTORS; k++) s += x[k];
    return s;
}

INLINE V size_of(const V *x) {
    V s = v_fabs(x[0]);
    for (int k = 1; k < VECTORS; k++) s += v_fabs(x[k]);
    return s;
}

typedef struct { V u[MOST_NU + 1][VECTORS], c[VECTORS], b[VECTORS]; } Nodes; /* controls, h c, h b or h^2 b */

/* A step on its way: times of the stages, where they are when all unknowns are zero and where they are first, the unknowns
   after so many evaluations, and the momenta that these make; room for what the first half of the right-hand side leaves to the second,
   or for the inertias of the stages, which so many evaluations from now on renew. */
typedef struct {
    V t[VECTORS], base[2 * MOST_N][VECTORS], start[2 * MOST_N][VECTORS], p[MOST_N][VECTORS];
    Unknowns x;
    int64_t count;
    V (*taken)[VECTORS];
    int renewals;
#ifndef SCENE_AS_DATA
    const struct Scene *scene;
    const struct Loop *loop;
#endif
} Step;

/* The largest relative change of an iteration; row by row only where it no longer shrinks. */
typedef struct {
    double scale[MOST_ROWS], inverse[MOST_ROWS], noise[MOST_ROWS], now, left, first, rate, lowest, work, best[MOST_ROWS];
    int checks, stalled, idle[MOST_ROWS];
} Change;

struct Run;
#ifndef SCENE_AS_DATA
/* What the loop calls of the scene, whose prepared numbers are so many, and so many what one half of the right-hand side
   leaves to the other. */
typedef struct Scene {
    int64_t numbers, taken;
    const char *needs_q, *needs_p;
    void (*prepare)(const double *c, double *w);
    void (*velocity)(const V *q, const V *p, const V *t, const double *w, V *v);
    void (*momentum)(const V *q, const V *v, const V *t, const double *w, V *p);
    int (*iterated)(struct Run *r, int64_t k, int begun);
} Scene;

/* What the iteration of a step calls of the loop. */
typedef struct Loop {
    int (*stagnates)(const Step *s, const Unknowns fresh, Change *c, double level);
    double (*work_of)(const Step *s, const Unknowns fresh);
    void (*set_first_scale)(struct Run *r, const Unknowns x);
    void (*place_start)(const struct Run *r, Step *s, int64_t known, const Unknowns last, const Unknowns older);
} Loop;
#endif
#ifdef SCENE_APART /* of the step s */
#define RHS_W 0 /* the scene knows where its numbers begin */
#define VELOCITY_W 0
#define NEEDS_Q s->scene->needs_q
#define NEEDS_P s->scene->needs_p
#define prepare(c, w) s->scene->prepare(c, w)
#define velocity(q, p, t, w, v) s->scene->velocity(q, p, t, w, v)
#define momentum(q, v, t, w, p) s->scene->momentum(q, v, t, w, p)
#define iterated(r, k, begun) s->scene->iterated(r, k, begun)
#endif
#ifdef LOOP_APART
/* of a copy of the unknowns, so that they themselves can stay in registers */
#define OF_COPY(call, x) ({ Unknowns copied; copy_unknowns(copied, x); call; })
#define stagnates(s, fresh, c, level) OF_COPY((s)->loop->stagnates(s, copied, c, level), fresh)
#if HALVES
#define work_of(s, fresh) OF_COPY((s)->loop->work_of(s, copied), fresh)
#endif
#define set_first_scale(r, x) OF_COPY((r)->now.loop->set_first_scale(r, copied), x)
#if AHEAD
#define START INLINE
#else
#define place_start(r, s, known, last, older) (s)->loop->place_start(r, s, known, last, older)
#endif
#else
#define START APART
APART int stagnates(const Step *s, const Unknowns fresh, Change *c, double level);
#if HALVES
APART double work_of(const Step *s, const Unknowns fresh);
#endif
APART void set_first_scale(struct Run *r, const Unknowns x);
APART void place_start(const struct Run *r, Step *s, int64_t known, const Unknowns last, const Unknowns older);
#endif
#if !HALVES
#define work_of(s, fresh) INFINITY
#endif

/* One by one: what memcpy copies cannot stay in registers. */
INLINE void copy_unknowns(Unknowns to, const Unknowns from) {
    EACH for (int r = 0; r < ROWS; r++)
        for (int k = 0; k < VECTORS; k++) to[r][k] = from[r][k];
}

INLINE void copy_step(Step *to, const Step *from) {
    memcpy(to->t, from->t, sizeof to->t);
    COPY(to->base, from->base, 2 * N), COPY(to->p, from->p, N), COPY(to->x, from->x, ROWS);
    to->count = from->count;
}

INLINE void set_base(Step *s, const double *y, const double *rest, double t, const Nodes *at) {
    for (int k = 0; k < VECTORS; k++) s->t[k] = t + at->c[k];
    for (int d = 0; d < N; d++)
        for (int k = 0; k < VECTORS; k++) {
#if FORM == 2
            s->base[d][k] = y[d] + v_fma(entry(STAGE_C, k), splat(y[N + d]), splat(rest[d]));
#else
            s->base[d][k] = splat(y[d] + rest[d]);
#endif
            s->base[N + d][k] = splat(y[N + d] + rest[N + d]);
        }
}

/* The same for the step after `now`, from where its unknowns are at present. */
INLINE void set_base_after(Step *s, const Step *now, double t, const Nodes *at) {
    for (int k = 0; k < VECTORS; k++) s->t[k] = t + at->c[k];
    for (int d = 0; d < N; d++) {
#if FORM == 2
        V moved[VECTORS];
        for (int k = 0; k < VECTORS; k++) moved[k] = entry(STAGE_BETA, k) * now->x[d][k];
        V faster = in_all_lanes(folded(now->x[d])), further = in_all_lanes(folded(moved)) + now->base[N + d][0];
        for (int k = 0; k < VECTORS; k++) {
            s->base[d][k] = now->base[d][k] + v_fma(entry(STAGE_C, k), faster, further);
            s->base[N + d][k] = now->base[N + d][k] + faster;
        }
#else
        for (int r = d; r < 2 * N; r += N) {
            V moved = in_all_lanes(folded(now->x[r]));
            for (int k = 0; k < VECTORS; k++) s->base[r][k] = now->base[r][k] + moved;
        }
#endif
    }
}

#ifndef SCENE_APART
#if HALVES
INLINE void rhs_prepare(const double *c, double *w) {
    kick_prepare(c, w), drift_prepare(c, w + KICK_W), inertia_prepare(c, w + KICK_W + DRIFT_W);
}
#endif
INLINE void prepare(const double *c, double *w) {
    rhs_prepare(c, w), velocity_prepare(c, w + RHS_W), momentum_prepare(c, w + RHS_W + VELOCITY_W);
}
#endif

/* The momenta at the stages, made of x by the columns m; older adds to x. Constant ones stay what they are at the start. */
LARGE void set_momenta(Step *s, const double *m, const Unknowns x, const double *m_older, const Unknowns older) {
#if HALVES
    EACH for (int d = 0; d < N; d++) {
        for (int k = 0; k < VECTORS; k++) s->p[d][k] = s->base[N + d][k];
        if (NEEDS_P[d]) {
            add_product(m, x[N + d], s->p[d]);
            if (older) add_product(m_older, older[N + d], s->p[d]);
        }
    }
#endif
}

#if HALVES
/* The speeds at the stages that unknowns stand for, by the columns m; older adds to x. Beyond the stages they are zero. */
LARGE void set_speeds(const Nodes *at, const double *m, const Unknowns x, const double *m_older, const Unknowns older,
                      V speeds[MOST_N][VECTORS]) {
    EACH for (int d = 0; d < N; d++) {
        for (int k = 0; k < VECTORS; k++) speeds[d][k] = m ? splat(0.0) : x[d][k];
        if (m) add_product(m, x[d], speeds[d]);
        if (older) add_product(m_older, older[d], speeds[d]);
        for (int k = 0; k < VECTORS; k++)
            speeds[d][k] = choose(MASK(at->b[k] != 0.0), speeds[d][k] / at->b[k], splat(0.0));
    }
}

#ifndef SCENE_APART
/* fresh = h b V for the speeds V that the step's momenta ask for, improved from speeds that had other ones. */
LARGE void improve_speeds(const Step *s, const Nodes *at, double h, const double *w, V had[MOST_N][VECTORS],
                          V (*taken)[VECTORS], V speeds[MOST_N][VECTORS], Unknowns fresh) {
    V rates[MOST_N][VECTORS];
    EACH for (int d = 0; d < N; d++) {
        V missed[VECTORS];
        for (int k = 0; k < VECTORS; k++) missed[k] = s->p[d][k] - had[d][k], rates[d][k] = splat(0.0);
        add_product(STAGE_INVERSE, missed, rates[d]);
    }
    for (int k = 0; k < VECTORS; k++) drift(&rates[0][k], &taken[0][k], w, &fresh[0][k]);
    EACH for (int d = 0; d < N; d++) {
        for (int k = 0; k < VECTORS; k++) fresh[d][k] *= at->b[k] * (1 / h);
        add_product(STAGE_M1, fresh[d], speeds[d]);
        for (int k = 0; k < VECTORS; k++) fresh[d][k] = speeds[d][k] * at->b[k];
    }
}
#endif
#endif

#define BOTH (FORM == 1 || ON_VELOCITY) /* are velocities or momenta needed at the stages, besides places? */

/* The stages made of x by the columns m2 and m1; older adds to x. Cyclic coordinates are not needed there, nor are momenta
   that stay the same. */
INLINE void place(const Step *s, const Nodes *at, double h, const double *m2, const double *m1, const double *m0,
                  const Unknowns x, const double *m2_older, const double *m1_older, const double *m0_older,
                  const Unknowns older, V first[MOST_N][VECTORS], V second[MOST_N][VECTORS]) {
    EACH for (int d = 0; d < N; d++) {
        for (int k = 0; k < VECTORS; k++) {
            first[d][k] = s->base[d][k];
            if (BOTH) second[d][k] = s->base[N + d][k];
        }
#if FORM == 2
        if (NEEDS_Q[d]) {
            add_product(m2, x[d], first[d]);
            if (older) add_product(m2_older, older[d], first[d]);
        }
        if (ON_VELOCITY) {
            add_product(m1, x[d], second[d]);
            if (older) add_product(m1_older, older[d], second[d]);
            for (int k = 0; k < VECTORS; k++) second[d][k] *= 1 / h;
        }
#else
        if (NEEDS_Q[d]) {
            add_product(m1, x[d], first[d]);
            if (older) add_product(m1_older, older[d], first[d]);
        }
#if !HALVES
        if (NEEDS_P[d]) {
            add_product(m1, x[N + d], second[d]);
            if (older) add_product(m1_older, older[N + d], second[d]);
        }
#endif
#endif
    }
#if HALVES
    if (BY_DEFECT) set_speeds(at, m0, x, m0_older, older, second);
#endif
}

#ifndef SCENE_APART
/* fresh = h b (right-hand side at the stages), which s->x has made. With FORM 2 another h: the unknowns are lengths. In halves
   the step's momenta are those of s->x and become those of fresh; in Gauss-Seidel order, before the velocities are made of
   them. */
INLINE void respond(Step *s, const Nodes *at, double h, const double *w, V first[MOST_N][VECTORS],
                   V second[MOST_N][VECTORS], int seidel, Unknowns fresh) {
#if HALVES
    V had[MOST_N][VECTORS];
#ifdef LOOP_APART
    V own[BY_DEFECT ? 1 : TAKEN + 1][VECTORS], (*const taken)[VECTORS] = BY_DEFECT ? s->taken : own; /* of an evaluation alone */
#else
    V(*const taken)[VECTORS] = s->taken;
#endif
    if (BY_DEFECT && s->renewals-- > 0)
        for (int k = 0; k < VECTORS; k++) inertia(&first[0][k], &s->t[k], w + KICK_W + DRIFT_W, &taken[0][k]);
    for (int k = 0; k < VECTORS; k++) {
        KICK(&first[0][k], BY_DEFECT ? &second[0][k] : &s->p[0][k], &s->t[k], &at->u[0][k], w, &fresh[N][k], &had[0][k],
             &taken[0][k]);
        for (int d = 0; d < N; d++) fresh[N + d][k] *= at->b[k];
    }
    if (BY_DEFECT) {
        set_momenta(s, STAGE_M1, fresh, 0, 0);
        improve_speeds(s, at, h, w + KICK_W, had, taken, second, fresh);
        return;
    }
    if (seidel) set_momenta(s, STAGE_M1, fresh, 0, 0);
    for (int k = 0; k < VECTORS; k++) {
        drift(&s->p[0][k], &taken[0][k], w + KICK_W, &fresh[0][k]);
        for (int d = 0; d < N; d++) fresh[d][k] *= at->b[k];
    }
    if (!seidel) set_momenta(s, STAGE_M1, fresh, 0, 0);
#else
#if DENSE
    renew(&first[0][0], &s->t[0], w, &s->renewals);
    for (int k = 0; k < VECTORS; k++) guess(&s->x[0][k], at->b[k], &fresh[0][k]);
#endif
    for (int k = 0; k < VECTORS; k++) {
#if FORM == 2
        rhs(&first[0][k], &second[0][k], &s->t[k], &at->u[0][k], w, &fresh[0][k]);
#else
        rhs(&first[0][k], &second[0][k], &s->t[k], &at->u[0][k], w, &fresh[0][k], &fresh[N][k]);
#endif
        for (int r = 0; r < ROWS; r++) fresh[r][k] *= at->b[k];
    }
#endif
}

/* fresh: one more evaluation, the first one from where the stages have been placed. */
LARGE void evaluate(Step *s, const Nodes *at, double h, const double *w, int seidel, int is_first, Unknowns fresh) {
    V first[MOST_N][VECTORS], second[MOST_N][VECTORS];
    if (!is_first) place(s, at, h, STAGE_M2, STAGE_M1, 0, s->x, 0, 0, 0, 0, first, second);
    else
        EACH for (int d = 0; d < N; d++)
            for (int k = 0; k < VECTORS; k++) {
                first[d][k] = s->start[d][k];
                if (BOTH) second[d][k] = s->start[N + d][k];
            }
    respond(s, at, h, w, first, second, seidel, fresh);
    s->count++;
}
#endif

INLINE V change_of(const V *fresh, const V *x) {
    V d = v_fabs(fresh[0] - x[0]);
    for (int k = 1; k < VECTORS; k++) d = v_fmax(d, v_fabs(fresh[k] - x[k]));
    return d;
}

#ifndef LOOP_APART
#if HALVES
/* What a change of the unknowns does, h V p and h F h V, as a part of the step's action h V p. In a long chain the momenta
   are sums over all its links, and their round-off moves single links by far more than these links' own. */
APART double work_of(const Step *s, const Unknowns fresh) {
    V moved = splat(0.0), whole = splat(0.0);
    for (int d = 0; d < N; d++)
        for (int k = 0; k < VECTORS; k++) {
            V way = v_fabs(fresh[d][k]), push = v_fabs(s->p[d][k]);
            whole = v_fma(way, push, whole);
            moved = v_fma(v_fabs(fresh[d][k] - s->x[d][k]), push, moved);
            moved = v_fma(v_fabs(fresh[N + d][k] - s->x[N + d][k]), way, moved);
        }
    return lane(in_all_lanes(moved), 0) / (lane(in_all_lanes(whole), 0) + 1e-300);
}
#endif

/* The last digit of what an unknown is added to, where that is a coordinate: a stiff spring makes of it accelerations that
   may be large beside those of a row that is hardly pushed. */
INLINE double unseen(const Step *s, int r) { return FORM == 2 ? EPS * fabs(lane(s->base[r][0], 0)) : 0; }

/* Where the largest change has stopped shrinking: do all rows stagnate near round-off (Hairer, McKenna & Razakarivony
   2008)? For a row of cancelling terms that may lie far above its own size; the next steps need not find out again. */
APART int stagnates(const Step *s, const Unknowns fresh, Change *c, double level) {
    const V(*const x)[VECTORS] = s->x;
    int all = 1;
    for (int r = 0; r < ROWS; r++) {
        double now = largest(change_of(fresh[r], x[r])), size = c->scale[r], most = 0;
        if (now < 0.5 * c->best[r]) c->best[r] = now, c->idle[r] = now > NEAR * size ? 0 : c->idle[r];
        else c->idle[r] += 1;
        for (int i = r / N * N; i < r / N * N + N; i++) most = c->scale[i] > most ? c->scale[i] : most;
        int settled = now <= EPS * size || now <= level * size || (c->idle[r] >= 1 && now <= NEAR * size) ||
                      (c->idle[r] >= 4 && (now <= 1e-9 * size || now <= 1e-13 * most || now <= unseen(s, r)));
        all &= settled;
    }
    if (BY_DEFECT && !all && c->stalled > 1) {
        const double work = work_of(s, fresh);
        if (work <= SMALL_WORK) all = 1, c->work = work > c->work ? work : c->work;
    }
    if (all)
        for (int r = 0; r < ROWS; r++) {
            double last = largest(change_of(fresh[r], x[r]));
            if (last > EPS * c->scale[r] && last > level * c->scale[r] && last > c->noise[r]) c->noise[r] = last;
        }
    return all;
}
#endif

/* Has the iteration come to its end: is the change at round-off, or what contraction at the present rate leaves below the
   level, or is there stagnation? Changes are relative to the size of their row. Where the start of the step has moved, the
   change says nothing about contraction. */
INLINE int settled(const Step *s, const Unknowns fresh, Change *c, double level, int moved) {
    const V(*const x)[VECTORS] = s->x;
    V worst = change_of(fresh[0], x[0]) * c->inverse[0];
    for (int r = 1; r < ROWS; r++) worst = v_fmax(worst, change_of(fresh[r], x[r]) * c->inverse[r]);
    double now = largest(worst), before = c->now;
    int done = now <= EPS || (BY_DEFECT && c->work > 0 && work_of(s, fresh) <= 2 * c->work); /* as round-off was before */
    c->left = now * c->rate;
    if (moved) return done | (now * c->rate <= level);
    if (!c->checks++) {
        c->first = c->lowest = now, c->stalled = 0;
        for (int r = 0; r < ROWS; r++) c->best[r] = INFINITY, c->idle[r] = 0;
        done |= now * c->rate <= level; /* the rate of the last step */
    } else {
        if (now < 0.5 * c->lowest) c->lowest = now, c->stalled = 0;
        else c->stalled += 1;
        done |= now * now <= level * before || (!(now < 0.5 * before) && stagnates(s, fresh, c, level));
        if (done) c->rate = now < 0.1 * before ? 0.1 : now < before ? now / before : 1.0, c->left = now * c->rate;
    }
    c->now = now;
    return done;
}

#ifndef LOOP_APART
/* Never a denormal number, which would be slow for the rest of the run. */
INLINE double fading(double x, double fade) { return x > 1e-290 ? x * fade : 0; }

INLINE void set_scale(Change *c, const double *size, double fade) {
    for (int r = 0; r < ROWS; r++) { /* an oscillating row keeps its size where it passes zero */
        double faded = fading(c->scale[r], fade);
        c->scale[r] = size[r] > faded ? size[r] : faded;
        double least = c->noise[r] * (2 / EPS); /* a change of twice the noise counts as one at round-off */
        c->inverse[r] = 1 / ((c->scale[r] > least ? c->scale[r] : least) + 1e-300);
    }
}
#endif

/* A run on its way. */
typedef struct Run {
    double *w; /* what was prepared of the parameters */
    double t0, h, level;
    int64_t first, most;
    Nodes at;
    double y[2 * MOST_N], rest[2 * MOST_N]; /* the state at the last node, compensated */
    Unknowns last, older;         /* of the last two steps; `known` of them are there */
    Step now, next;               /* the step that is solved; the one after it, begun where that costs little time */
    V (*taken)[VECTORS];          /* of one of them at a time */
    Change change;
    int64_t known, expected, iterations, most_iterations;
    int64_t low;                  /* so many steps start from a low degree */
    double tried, counts[3], slowest, residual; /* counts: in either order; one half after the other, lately */
    int seidel;
} Run;

#ifdef START
/* Where the stages of a step are first: on the polynomial of the last two steps or the last one, or of a constant right-hand
   side. */
START void place_start(const Run *r, Step *s, int64_t known, const Unknowns last, const Unknowns older) {
    static const Unknowns none;
    const V(*const x)[VECTORS] = known ? last : none, (*const x_older)[VECTORS] = known > 1 ? older : 0;
    const int low = r->low > 0;
    const double *const m2 = known > 1 ? low ? LOW_M2 : START_M2 : low ? LOW_ONE_M2 : START_ONE_M2;
    const double *const m1 = known > 1 ? low ? LOW_M1 : START_M1 : low ? LOW_ONE_M1 : START_ONE_M1;
    const double *const m0 = known > 1 ? low ? LOW_M0 : START_M0 : low ? LOW_ONE_M0 : START_ONE_M0;
    const double *const m2_older = low ? LOW_OLDER_M2 : START_OLDER_M2, *const m1_older = low ? LOW_OLDER_M1 : START_OLDER_M1;
    const double *const m0_older = low ? LOW_OLDER_M0 : START_OLDER_M0;
    if (!BY_DEFECT) set_momenta(s, m1, x, m1_older, x_older);
    place(s, &r->at, r->h, m2, m1, m0, x, m2_older, m1_older, m0_older, x_older, s->start, s->start + N);
    if (DENSE) memcpy(s->x, x, UNKNOWNS_SIZE); /* the speeds that are improved */
    s->renewals = known > !DENSE ? 1 : 2;
}
#endif

#ifndef LOOP_APART
APART void set_first_scale(Run *r, const Unknowns x) {
    V sizes[MOST_ROWS];
    double size[MOST_ROWS];
    for (int i = 0; i < ROWS; i++) sizes[i] = size_of(x[i]);
    row_sums(sizes, ROWS, size), set_scale(&r->change, size, 0);
}

APART void save(const Run *r, double *row, double t, int64_t without_velocities) {
    const Step *const s = &r->now;
    const double *const y = r->y, *const w = r->w, h = r->h;
    V q[MOST_N], z[MOST_N], out[MOST_N], time = splat(t);
    for (int d = 0; d < N; d++) q[d] = splat(y[d]), z[d] = splat(FORM == 2 ? y[N + d] / h : y[N + d]);
#if FORM == 2
    momentum(q, z, &time, w + RHS_W + VELOCITY_W, out);
    for (int d = 0; d < N; d++) row[d] = y[d], row[N + d] = lane(out[d], 0), row[2 * N + d] = lane(z[d], 0);
#else
    COPY(row, y, 2 * N);
    if (without_velocities) return;
    velocity(q, z, &time, w + RHS_W, out);
    for (int d = 0; d < N; d++) row[2 * N + d] = lane(out[d], 0);
#endif
}

#ifdef SCENE_APART
static const Loop called_back = {
    .stagnates = stagnates, .set_first_scale = set_first_scale, .place_start = place_start,
#if HALVES
    .work_of = work_of,
#endif
};
#endif

/* Where the run stands: as it was left, or at a fresh start. */
APART void restore(Run *r, const RunArguments *a) {
    const double h = r->h = a->h, scale_b = FORM == 2 ? h * h : h;
    const Carry *carry = (const Carry *)a->carry;
    r->t0 = a->t0, r->first = a->first, r->most = a->most, r->level = a->level > 0x1p-56 ? a->level : 0x1p-56;
#ifdef SCENE_APART
    r->now.scene = r->next.scene = a->scene, r->now.loop = r->next.loop = &called_back;
#endif
    const Step *const s = &r->now;
    prepare(a->c, r->w);
    for (int k = 0; k < VECTORS; k++) r->at.c[k] = h * entry(STAGE_C, k), r->at.b[k] = scale_b * entry(STAGE_B, k);
    r->known = r->expected = r->iterations = r->most_iterations = 0, r->change.work = 0;
    r->seidel = 1, r->low = r->level > LOOSE ? INT64_MAX : 0;
    r->tried = HALVES && !BY_DEFECT ? 0 : 2 * TRIAL, r->counts[0] = r->counts[1] = r->counts[2] = r->slowest = r->residual = 0;
    r->now.count = r->next.count = 0;
    r->now.taken = r->next.taken = r->taken;
    if (carry->steps_known > 0 && carry->h == h) {
        r->known = (int64_t)carry->steps_known, r->expected = (int64_t)carry->expected;
        const double *at = carry->numbers, *scales = at + 4 * N, *x = scales + 2 * ROWS;
        COPY(r->y, at, 2 * N), COPY(r->rest, at + 2 * N, 2 * N);
        memcpy(r->last, x, UNKNOWNS_SIZE), memcpy(r->older, x + ROWS * PADDED, UNKNOWNS_SIZE);
        memcpy(r->now.x, x + 2 * ROWS * PADDED, UNKNOWNS_SIZE), r->now.count = (int64_t)carry->count;
        for (int i = 0; i < ROWS; i++) r->change.scale[i] = 0, r->change.noise[i] = scales[ROWS + i];
        set_scale(&r->change, scales, 0);
        r->change.rate = carry->rate, r->change.work = carry->work, r->low = r->low ? r->low : (int64_t)carry->low;
        r->tried = carry->tried, memcpy(r->counts, carry->counts, sizeof r->counts);
        r->seidel = LONGER * r->counts[1] <= r->counts[0];
    } else {
        for (int d = 0; d < N; d++) r->y[d] = a->start[d], r->y[N + d] = a->start[N + d], r->rest[d] = r->rest[N + d] = 0;
#if FORM == 2
        V q[MOST_N], z[MOST_N], out[MOST_N], time = splat(r->t0 + h * (double)r->first);
        for (int d = 0; d < N; d++) q[d] = splat(r->y[d]), z[d] = splat(r->y[N + d]);
        velocity(q, z, &time, r->w + RHS_W, out);
        for (int d = 0; d < N; d++) r->y[N + d] = h * lane(out[d], 0);
#endif
        for (int i = 0; i < ROWS; i++) r->change.scale[i] = r->change.noise[i] = 0;
        r->change.rate = 1;
        for (int i = 0; i < ROWS; i++)
            for (int k = 0; k < VECTORS; k++) r->last[i][k] = r->older[i][k] = splat(0.0);
    }
}
#endif

#ifndef SCENE_APART
/* Not in line: once a step it costs nothing, and the compiler half of its time. */
APART void begin_next(Run *r) {
    place_start(r, &r->next, 2, r->now.x, r->last);
    evaluate(&r->next, &r->at, r->h, r->w, r->seidel, 1, r->next.x);
}

/* One more evaluation of the step at hand, and where its unknowns are known well enough, of the next one beside it: has
   the iteration come to its end? */
INLINE int improve_step(Run *r, double t_next, int64_t first_count) {
    Unknowns fresh;
    int end = 0;
    evaluate(&r->now, &r->at, r->h, r->w, r->seidel, !r->now.count, fresh);
    if (r->now.count == 1) {
        copy_unknowns(r->now.x, fresh);
        return 0;
    }
    if (AHEAD && r->known && 2 * r->now.count >= r->expected) { /* earlier, x is too far from where it will be */
        set_base_after(&r->next, &r->now, t_next, &r->at);
        if (!r->next.count) begin_next(r);
        else {
            Unknowns after;
            evaluate(&r->next, &r->at, r->h, r->w, r->seidel, 0, after);
            copy_unknowns(r->next.x, after);
        }
    }
    if (r->now.count + 1 >= r->expected || ALWAYS_LOOK) { /* before, the last step needed more: no look at the change */
        if (!r->known) set_first_scale(r, fresh);
        end = settled(&r->now, fresh, &r->change, r->level, r->now.count == first_count);
    }
    copy_unknowns(r->now.x, fresh);
    return end;
}

/* Step k until its end, or until no end is to be expected? */
#ifdef SCENE_AS_DATA
INLINE
#else
static
#endif
int iterated(Run *r, int64_t k, int begun) {
    const Change *const c = &r->change;
    const double t_next = r->t0 + r->h * (double)(k + 1);
    const int64_t first_count = begun ? r->now.count + 1 : 0; /* its change is that of the start of the step, too */
    int end = 0;
    while (r->now.count < r->most && !end && !(r->known && c->checks > 1 && !(c->now <= DIVERGED * c->first)))
        end = improve_step(r, t_next, first_count);
    return end;
}
#endif

#ifndef LOOP_APART
/* The unknowns of step k: from the extrapolated start; where that fails, once more from a constant right-hand side. */
INLINE int solve(Run *r, int64_t k) {
    Change *const c = &r->change;
    const Step *const s = &r->now;
    set_base(&r->now, r->y, r->rest, r->t0 + r->h * (double)k, &r->at);
    const int begun = r->now.count > 0;
    if (r->tried < 2 * TRIAL) {
        r->seidel = r->tried < TRIAL;
        if (r->tried == TRIAL) r->expected = 0, c->rate = 1;
    }
    if (AHEAD && begun) set_momenta(&r->now, STAGE_M1, r->now.x, 0, 0);
    for (;;) {
        if (!r->now.count) place_start(r, &r->now, r->known, r->last, r->older);
        c->checks = 0;
        const int end = iterated(r, k, begun);
        r->iterations += r->now.count;
        if (end) return 1;
        if (!r->known) return BY_DEFECT && c->now <= WANDERS;
        r->known = r->expected = r->now.count = r->next.count = 0, r->low = r->low > CAREFUL ? r->low : CAREFUL;
    }
}

/* How often a step that takes `count` evaluations need not have been looked at, nor evaluated: at the present rate. */
INLINE int64_t spare(const Change *c, double level, int64_t count) {
    int64_t found = 0;
    for (double left = c->left; c->checks == 1 && left <= c->rate * level && 2 * found < count; left /= c->rate) found++;
    return found;
}

/* Counts a step tried in either order; after so many of them, or where the second order is clearly worse than the first
   was lately, it is known in which the halves converge sooner. */
INLINE void count_trial(Run *r) {
    double *const counts = r->counts, count = (double)r->now.count, others = (r->tried += 1) - TRIAL;
    counts[r->seidel] += count;
    if (r->seidel) counts[2] += count - counts[2] / LATELY;
    const int worse = others > 1 && counts[0] * LATELY > WORSE * counts[2] * others;
    if (!worse && r->tried < 2 * TRIAL) return;
    r->seidel = worse || LONGER * counts[1] <= counts[0], r->tried = 2 * TRIAL, r->expected = 0, r->change.rate = 1;
    if (worse) counts[0] = INFINITY;
}

/* The solved step becomes the last one: the state at its end, and what the next one starts from; nothing of it where that
   is not finite. */
INLINE int accept(Run *r) {
    Change *const c = &r->change;
    double *const y = r->y, *const rest = r->rest, old[2 * MOST_N], lost[2 * MOST_N], sums[3 * MOST_ROWS];
    /* where already the first look saw nothing but round-off, the next step looks earlier */
    r->expected = c->checks > 1 && c->first <= 4 * c->now ? r->now.count - c->checks : r->now.count - spare(c, r->level, r->now.count);
    r->most_iterations = r->now.count > r->most_iterations ? r->now.count : r->most_iterations;
    if (r->tried < 2 * TRIAL && r->known > 1) count_trial(r);
    memcpy(r->older, r->last, UNKNOWNS_SIZE), memcpy(r->last, r->now.x, UNKNOWNS_SIZE);
    r->known += r->known < 2, r->low -= r->low > 0;
    COPY(old, y, 2 * N), COPY(lost, rest, 2 * N);
    V rows_of[3 * MOST_ROWS];
    for (int i = 0; i < ROWS; i++) rows_of[i] = folded(r->last[i]), rows_of[ROWS + i] = size_of(r->last[i]);
#if FORM == 2
    for (int d = 0; d < N; d++) {
        V moved[VECTORS];
        for (int k = 0; k < VECTORS; k++) moved[k] = entry(STAGE_BETA, k) * r->last[d][k];
        rows_of[2 * N + d] = folded(moved);
    }
    row_sums(rows_of, 3 * N, sums);
    for (int d = 0; d < N; d++) compensated(&y[d], &rest[d], y[N + d] + (sums[2 * N + d] + rest[N + d]));
    for (int d = 0; d < N; d++) compensated(&y[N + d], &rest[N + d], sums[d]);
    for (int d = 0; d < N; d++) {
        double path = fabs(y[N + d]);
        sums[N + d] = path > sums[N + d] ? path : sums[N + d];
    }
#else
    row_sums(rows_of, 2 * ROWS, sums);
    for (int i = 0; i < ROWS; i++) compensated(&y[i], &rest[i], sums[i]);
#endif
    if (!(unsound(y, 2 * N) == 0)) {
        COPY(y, old, 2 * N), COPY(rest, lost, 2 * N);
        return 0;
    }
    for (int i = 0; i < ROWS; i++) c->noise[i] = fading(c->noise[i], KEPT_NOISE);
    c->work = fading(c->work, KEPT_NOISE);
    set_scale(c, sums + ROWS, 0.9);
    r->slowest = c->rate > r->slowest ? c->rate : r->slowest;
    r->residual = c->left > r->residual ? c->left : r->residual;
    r->now.count = 0;
    if (AHEAD && r->next.count) copy_step(&r->now, &r->next);
    r->next.count = 0;
    return 1;
}

/* What the next call needs, and what the caller is told. */
APART void store(const Run *r, const RunArguments *a, int status, int64_t done) {
    Carry *carry = (Carry *)a->carry;
    carry->steps_known = status ? 0 : (double)r->known, carry->expected = (double)r->expected, carry->h = r->h;
    double *at = carry->numbers, *scales = at + 4 * N, *x = scales + 2 * ROWS;
    COPY(at, r->y, 2 * N), COPY(at + 2 * N, r->rest, 2 * N);
    memcpy(x, r->last, UNKNOWNS_SIZE), memcpy(x + ROWS * PADDED, r->older, UNKNOWNS_SIZE);
    memcpy(x + 2 * ROWS * PADDED, r->now.x, UNKNOWNS_SIZE), carry->count = (double)r->now.count;
    carry->tried = r->tried, memcpy(carry->counts, r->counts, sizeof r->counts);
    COPY(scales, r->change.scale, ROWS), COPY(scales + ROWS, r->change.noise, ROWS);
    carry->rate = r->change.rate, carry->work = r->change.work, carry->low = r->low > CAREFUL ? 0 : (double)r->low;
    a->stats->status = status, a->stats->steps = (double)done, a->stats->iterations = (double)r->iterations;
    a->stats->most_iterations = (double)r->most_iterations, a->stats->contraction = r->slowest;
    a->stats->noted = 0;
    a->stats->residual = r->residual, a->stats->failed = status ? r->change.now : 0;
}

int run(const RunArguments *a) {
    Run r;
#ifdef SCENE_APART
    const Scene *const scene = a->scene;
    double prepared[scene->numbers + 1];
    V taken[scene->taken + 1][VECTORS];
    r.w = prepared, r.taken = taken;
#else
    scene = a->scene;
    r.w = registers(), r.taken = 0;
    if (!r.w) return NOT_FINITE;
#if HALVES
    r.taken = (V (*)[VECTORS])taken_room();
    if (!r.taken) {
        free(r.w);
        return NOT_FINITE;
    }
#endif
#endif
    restore(&r, a);
    double *rows = a->rows, t = r.t0 + r.h * (double)r.first;
    save(&r, rows, t, a->without_velocities);
    if (!r.known) memcpy(rows, a->start, 2 * N * sizeof(double));
    const double *u = a->u;
    int status = DONE;
    int64_t done = 0, unsaved = 0;
    for (; done < a->steps; done++) {
        for (int m = 0; m < NU; m++)
            for (int i = 0; i < PADDED; i++) set_lane(&r.at.u[m][i / LANES], i % LANES, u[(i < STAGES ? i : STAGES - 1) * NU + m]);
        u += STAGES * NU;
        status = !solve(&r, r.first + done) ? NOT_CONVERGED : !accept(&r) ? NOT_FINITE : DONE;
        if (status) break;
        t = r.t0 + r.h * (double)(r.first + done + 1);
        if (++unsaved == a->save_every) unsaved = 0, rows += 3 * N, save(&r, rows, t, a->without_velocities);
    }
    (void)u;
    if (done && !unsaved) memcpy(a->stats->last, rows, 3 * N * sizeof(double));
    else save(&r, a->stats->last, t, 0);
    store(&r, a, status, done);
#ifdef SCENE_AS_DATA
    free(r.w), free(r.taken);
#endif
    return status;
}
#endif
