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
           rate A^-1 (P - p)/h is missed, taken once a step where its first evaluation puts the stages. The iteration contracts
           as accelerations depend on the motion, h da/dv + h^2 da/dq, where V from P contracts as M^-1 dp/dq does, which in long
           chains of links is hundreds of times more. It needs no inverse of p(q, v), which may depend on v in any way: M is its
           slope dp/dv, and LEGENDRE_ITERATIONS of Newton's method find velocities at single points from a first guess.
   m_ij = a_ij / b_j and M_ij = (A A)_ij / b_j are rounded so that the conditions of symplecticity and symmetry hold without
   rounding error (tableau.py): no drift comes from the coefficients however long the run.

   gauss_step.c is what has the scene's functions in line, the iteration of a step; gauss_loop.c all that depends on the size
   alone. For scenes as data (core.c) they are one; of scenes that are compiled the loop is so apart, with SCENE_APART, once for
   every machine, and the step with LOOP_APART, by gauss_scene.c. Each has a table of what the other calls, once a step or less
   often. */

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
#ifndef SCENE_AS_DATA
#ifndef BY_DEFECT
#define BY_DEFECT 0
#endif
#if LEGENDRE_ITERATIONS && !defined(SCENE_APART) /* else 0, or not defined */
#include "legendre.h"
#define VELOCITY_W LEGENDRE_W
#define velocity_prepare legendre_prepare
INLINE void velocity(const V *q, const V *p, const V *t, const double *w, V *v) { inverted(q, p, t, w, v); }
#endif
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
#define inertia(q, v, t, w, taken) ((void)0)
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
/* Round-off is near: a change that has not halved once is taken for it. Where the inertia vanishes as the motion is fast, it
   magnifies round-off of momenta, which adds up from step to step; Newton's method does better. */
#define NEAR (LEGENDRE_ITERATIONS ? 0x1p-49 : 0x1p-44)
#define WANDERS 1e-12 /* round-off that wanders from row to row of long chains, up to the last iteration */
#define LOOSE (FORM == 1 ? 1e-8 : INFINITY) /* errors of the stages of this size a start of high degree amplifies too much */
#define CAREFUL 200 /* steps that start from a low degree after a start of high degree has failed */
#define ALWAYS 0x7fffffff
#define DIVERGED 2 /* times the first change: the start was too far off */
#define BEYOND 1e3 /* how far off nothing brings an iteration back: the start was too far off */
#define LEAST_LEVEL 0x1p-56
#define GONE 1e6 /* times as large as they first were: runs that others are compared with do not wait for unknowns to come back */
#define GLANCE 4 /* iterations of a loose step between looks at that: sines of huge numbers take hundreds of nanoseconds */
#define TELLING 7 /* looks at changes that tell how fast they shrink */
#define AT_HAND 1e-2 /* changes of an iteration that is near its end: from farther off slopes may lead to another one */
#define TRIAL 32 /* steps in either order, after which it is known in which the halves converge sooner */
#define LATELY 8 /* steps that count in a mean that fades */
#define WORSE 1.3 /* times as many evaluations as lately: the other order is not tried to the end */
#define LONGER (AHEAD ? 1.05 : 1.15) /* time of an evaluation of one half after the other, relative to both at once */
#define IDLE 4   /* looks that find no change half as large as the best: larger ones may be round-off of what cancels */
#define LONG_IDLE 16 /* where they are much larger: slow contraction, too, now and then takes a few looks without one */
#define MANY_LOOKS 8 /* after which last digits need not stop shrinking in all rows at once */
#define NOISE 1e-10 /* of a row: what is larger is none (RESIDUAL_LIMIT of varint/discrete/tolerances.py) */
#define DRIFTS 3 /* changes since then that add up to so many: no round-off, which goes to and fro, but slow contraction */
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
   or for the inertias of the stages, which so many evaluations from now on renew; what is left of what speeds miss, times that of plain
   iterations. */
typedef struct {
    V t[VECTORS], base[2 * MOST_N][VECTORS], start[2 * MOST_N][VECTORS], p[MOST_N][VECTORS];
    Unknowns x;
    int64_t count;
    V (*taken)[VECTORS];
    int renewals;
    double left;
#ifndef SCENE_AS_DATA
    const struct Scene *scene;
    const struct Loop *loop;
#endif
} Step;

/* The largest relative change of an iteration; row by row only where it no longer shrinks. */
typedef struct {
    double scale[MOST_ROWS], inverse[MOST_ROWS], noise[MOST_ROWS], now, left, first, rate, lowest, work, off, best[MOST_ROWS];
    const double *faint; /* what is a last digit, row by row; 0: that is not known */
    int checks, stalled, idle[MOST_ROWS];
    Unknowns from; /* each row where its best change was, or where it was last seen to go on and on */
    int64_t most; /* evaluations that a step takes; 0: it is iterated with patience */
    double begun[2]; /* what unknowns of a fresh start first were, all of a kind */
} Change;

struct Run;
#ifndef SCENE_AS_DATA
/* What the loop calls of the scene, whose prepared numbers are so many, and so many what one half of the right-hand side
   leaves to the other; operations of an evaluation. */
typedef struct Scene {
    int64_t numbers, taken, work;
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
#define WORK scene->work
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
#if AHEAD /* once a step: in line where a step is short */
#if HALVES
#define START APART
#else
#define START INLINE
#endif
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

#include "slopes.h"

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
    int seidel, alone;
    Slopes slopes;
} Run;

/* Those of the last stage of the last step, in all lanes: nearly those where it ends. None yet: zero. */
INLINE void last_speeds(const Run *r, V *v) {
    const int k = (STAGES - 1) / LANES, i = (STAGES - 1) % LANES;
    for (int d = 0; d < N; d++) v[d] = splat(lane(r->last[d][k], i) / lane(r->at.b[k], i));
}

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
#if HALVES
    if (LEGENDRE_ITERATIONS && !known) { /* inertia depends on the velocity, and may not be there at rest */
        V v[MOST_N], q[MOST_N], p[MOST_N], time = splat(lane(s->t[0], 0) - lane(r->at.c[0], 0));
        for (int d = 0; d < N; d++) q[d] = s->base[d][0], p[d] = s->base[N + d][0];
        last_speeds(r, v), velocity(q, p, &time, r->w + RHS_W, v);
        for (int d = 0; d < N; d++)
            for (int k = 0; k < VECTORS; k++) s->start[N + d][k] = v[d];
    }
#endif
    if (DENSE) memcpy(s->x, x, UNKNOWNS_SIZE), s->left = 1; /* the speeds that are improved */
    /* from a velocity that is the same all along the step inertia may be far off where it depends on velocities */
    s->renewals = known > !DENSE ? 1 : LEGENDRE_ITERATIONS && !known ? ALWAYS : 2;
}
#endif

INLINE V change_of(const V *fresh, const V *x) {
    V d = v_fabs(fresh[0] - x[0]);
    for (int k = 1; k < VECTORS; k++) d = v_fmax(d, v_fabs(fresh[k] - x[k]));
    return d;
}

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
        done |= now * now <= level * (before < 1 ? before : 1);
        const int stuck = !done && !(now < 0.5 * before) && stagnates(s, fresh, c, level); /* says itself what is left */
        if (done | stuck) c->rate = now < 0.1 * before ? 0.1 : now < before ? now / before : 1.0;
        if (done) c->left = now < before ? now * (now / before) : now;
        done |= stuck;
    }
    c->now = now;
    return done;
}
