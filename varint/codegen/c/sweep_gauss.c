/* Derivatives of a run by a Gauss rule from its nodes, all stages of a step in the lanes of vectors.

   X_i = x + h sum_j a_ij f(X_j), x' = x + h sum_j b_j f(X_j) with x = (q, p), f = (v, dL/dq + F). Tangents solve
   dX_i = dx + h sum_j a_ij (J_j dX_j + what changes outside), adjoints M_i = mu' + h sum_j (b_j - a_ij) J_j^T M_j, for
   b_j a_ji / b_i = b_j - a_ij: both by the iteration of the run itself, coordinates first, then momenta, with J of the stages
   taken once a step.
   Defined before this file, besides what sweep.h needs: STAGES, STRIDE vectors of LANES for them, the columns COLUMN_A of a
   and COLUMN_M of b_j - a_ij, STAGE_B and STAGE_C (lanes beyond the stages repeat the last, with weight 0), start values
   from WINDOW nodes (GUESS_Q, GUESS_V for each place of the step among them), CONTINUED, which continues adjoints of a step
   over the one before. slopes(q, p, t, u, w, f, J), NJ
   nonzeros; their products turn_q(J, x, source, …), turn_p, the components of J x + source, and back_q, back_p of its transpose;
  
   outside(…, df/de); pull(…, m, w, m^T df/de); density(…, loss, its slopes by x and by e), e = (parameters, time, controls); momentum(q, v, t, w, p). */
#include "sweep.h"

#define SLOPES_AT 0
#define OUTSIDE_AT (SLOPES_AT + SLOPES_W)
#define PULL_AT (OUTSIDE_AT + OUTSIDE_W)
#define DENSITY_AT (PULL_AT + PULL_W)
#define MOMENTUM_AT (DENSITY_AT + DENSITY_W)
#define ALL_W (MOMENTUM_AT + MOMENTUM_W + 1)
#define NO_W ((const double *)0) /* of functions without parameters */
#define OUT (C + 1 + NU)
#define SETTLED 1e-16 /* of all changes by what they belong to */
#define ALIKE 1e-13   /* changes below this that no longer shrink are round-off */

typedef V Stages[STRIDE][2 * N], Columns[STAGES][STRIDE];

typedef struct {
    Stages x, f, m, k, source;
    V slope[STRIDE][ROOM(NJ)], fe[STRIDE][ROOM(FE)], t[STRIDE], u[STRIDE][ROOM(NU)];
    V of_e[STRIDE][OUT];
    Columns a, m_of; /* h a_ij, h (b_j - a_ij) */
    double w[ALL_W], size[2 * N], met[2 * N], h; /* met: the adjoint where the step at hand begins, before what is added there */
} Work;

INLINE V part(const double *x) { V y; memcpy(&y, x, sizeof y); return y; }

/* out := base + sum_j column_j k_j, for the components from `first` to `end`. */
INLINE void mix(const Columns columns, Stages k, const double *base, int first, int end, Stages out) {
    for (int d = first; d < end; d++)
        for (int b = 0; b < STRIDE; b++) {
            V s = splat(base ? base[d] : 0.0);
            for (int j = 0; j < STAGES; j++) s += columns[j][b] * splat(lane(k[j / LANES][d], j % LANES));
            out[b][d] = s;
        }
}

/* x = base + h A (J x + source), from the x at hand, or the adjoint's; k holds J x + source at the end. `enough`, in units
   of the sizes of x, is a change that does not matter. */
static int iterate(Work *k, int transposed, double enough, const double *base, Stages x) {
    double before = INFINITY;
    for (int count = 0; count < MOST_ITERATIONS; count++) {
        double change = 0, all = 0;
        for (int half = 0; half < 2; half++) {
            const int first = half * N, end = first + N;
            Stages next;
            for (int b = 0; b < STRIDE; b++)
                if (transposed) (half ? back_p : back_q)(k->slope[b], x[b], k->source[b] + first, NO_W, k->k[b] + first);
                else (half ? turn_p : turn_q)(k->slope[b], x[b], k->source[b] + first, NO_W, k->k[b] + first);
            mix(transposed ? k->m_of : k->a, k->k, base, first, end, next);
            for (int d = first; d < end; d++) {
                const double unit = transposed ? k->size[d] : 1 / k->size[d];
                V most = splat(0.0), largest_x = splat(0.0);
                for (int b = 0; b < STRIDE; b++) {
                    most = v_fmax(most, v_fabs(next[b][d] - x[b][d])), largest_x = v_fmax(largest_x, v_fabs(next[b][d]));
                    x[b][d] = next[b][d];
                }
                const double moved = largest(most) * unit, size = largest(largest_x) * unit;
                change = moved > change || moved != moved ? moved : change, all = size > all ? size : all;
            }
        }
        if (!(change < INFINITY)) return NOT_SOLVED;
        /* or the next one will be: they shrink by the same ratio again */
        const double next_change = before < INFINITY ? change * (change / before) : change;
        if (change <= SETTLED * all || next_change <= SETTLED * all || next_change <= enough) return SWEPT;
        if (change <= ALIKE * all && change >= 0.5 * before) return SWEPT;
        before = change;
    }
    return NOT_SOLVED;
}

/* Stages of a step whose ends are known, and J there: Newton's method from the path through the nodes around. */
static int linearise(Work *k, const SweepArguments *a, int64_t s, double h) {
    const int wide = a->smooth && a->steps >= WINDOW - 1;
    const int count = wide ? WINDOW : 2;
    int64_t from = wide ? s - (WINDOW / 2 - 1) : s;
    if (wide) from = from < 0 ? 0 : from > a->steps + 1 - WINDOW ? a->steps + 1 - WINDOW : from;
    const int place = wide ? (int)(s - from) : WINDOW - 1; /* the last tables are those of two nodes */
    const double *const tq = GUESS_Q + place * 2 * WINDOW * STRIDE * LANES, *const tv = GUESS_V + place * 2 * WINDOW * STRIDE * LANES;
    const double *const x0 = a->x + s * 2 * N;
    for (int j = 0; j < STAGES && k->h != h; j++)
        for (int b = 0; b < STRIDE; b++) {
            k->a[j][b] = h * part(COLUMN_A + (j * STRIDE + b) * LANES);
            k->m_of[j][b] = h * part(COLUMN_M + (j * STRIDE + b) * LANES);
        }
    k->h = h;
    double most[2] = {0, 0}, before = INFINITY;
    for (int b = 0; b < STRIDE; b++) {
        V speed[N];
        k->t[b] = splat(a->t[s]) + h * part(STAGE_C + b * LANES);
        for (int d = 0; d < N; d++) {
            V path = splat(x0[d]), rise = splat(0.0);
            for (int i = 0; i < count; i++) { /* from q at the start on, so that differences lose no digits */
                const double q = a->x[(from + i) * 2 * N + d] - x0[d], v = h * a->v[(from + i) * N + d];
                const int at = (2 * i * STRIDE + b) * LANES, behind = at + STRIDE * LANES;
                path += part(tq + at) * q + part(tq + behind) * v, rise += part(tv + at) * q + part(tv + behind) * v;
            }
            k->x[b][d] = path, speed[d] = rise / h;
        }
        momentum(k->x[b], speed, &k->t[b], k->w + MOMENTUM_AT, k->x[b] + N);
        for (int i = 0; i < LANES; i++) {
            const int stage = b * LANES + i < STAGES ? b * LANES + i : STAGES - 1;
            for (int d = 0; d < NU; d++) set_lane(&k->u[b][d], i, a->u[(s * STAGES + stage) * NU + d]);
        }
    }
    for (int d = 0; d < 2 * N; d++) {
        k->size[d] = fmax(fabs(x0[d]), fabs(x0[2 * N + d]));
        most[d / N] = fmax(most[d / N], k->size[d]);
    }
    for (int d = 0; d < 2 * N; d++) k->size[d] = most[d / N] > 0 ? fmax(k->size[d], LEAST_SPEED * most[d / N]) : 1.0;
    for (int count = 0; count < MOST_ITERATIONS; count++) {
        Stages left, rest;
        double worst = 0;
        for (int b = 0; b < STRIDE; b++)
            slopes(k->x[b], k->x[b] + N, &k->t[b], k->u[b], k->w + SLOPES_AT, k->f[b], k->slope[b]);
        mix(k->a, k->f, x0, 0, 2 * N, left);
        for (int d = 0; d < 2 * N; d++) {
            V r = splat(0.0);
            for (int b = 0; b < STRIDE; b++) left[b][d] -= k->x[b][d], r = v_fmax(r, v_fabs(left[b][d]));
            const double size = largest(r) / k->size[d];
            worst = size > worst || size != size ? size : worst;
        }
        if (!(worst < INFINITY)) return NOT_SOLVED;
        if (worst <= ROUNDED || (worst <= ALIKE && worst >= 0.5 * before)) return SWEPT; /* slopes and rates are the solution's */
        before = worst;
        /* the correction d = r + h A J d is r and e = h A (J r + J e) */
        const V none[N] = {splat(0.0)};
        memset(rest, 0, sizeof rest);
        for (int b = 0; b < STRIDE; b++) {
            turn_q(k->slope[b], left[b], none, NO_W, k->source[b]);
            turn_p(k->slope[b], left[b], none, NO_W, k->source[b] + N);
        }
        const int status = iterate(k, 0, SETTLED, 0, rest);
        if (status) return status;
        for (int b = 0; b < STRIDE; b++)
            for (int d = 0; d < 2 * N; d++) k->x[b][d] += left[b][d] + rest[b][d];
    }
    return NOT_SOLVED;
}

/* base + h sum_j b_j k_j */
INLINE void finish(double h, Stages k, double *base) {
    for (int d = 0; d < 2 * N; d++) {
        V s = splat(0.0);
        for (int b = 0; b < STRIDE; b++) s += part(STAGE_B + b * LANES) * k[b][d];
        base[d] += h * sum(s);
    }
}

static Work *work_space(const SweepArguments *a) {
    Work *k = 0;
    if (posix_memalign((void **)&k, 64, sizeof(Work))) return 0;
    memset(k, 0, sizeof(Work));
    slopes_prepare(a->c, k->w + SLOPES_AT), outside_prepare(a->c, k->w + OUTSIDE_AT), pull_prepare(a->c, k->w + PULL_AT);
    momentum_prepare(a->c, k->w + MOMENTUM_AT);
#if LOSS
    density_prepare(a->c, k->w + DENSITY_AT);
#endif
    return k;
}

int tangents(const SweepArguments *a) {
    const int64_t m = a->columns;
    const int outer = a->outer_moves || a->control_column >= 0;
    Work *k = work_space(a);
    double *out = a->out;
    int status = k ? SWEPT : NO_MEMORY;
    if (!status && a->every) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    for (int64_t s = 0; s < a->steps && !status; s++) {
        const double h = a->h[s];
        if ((status = linearise(k, a, s, h))) { *a->failed = (double)s; break; }
        for (int b = 0; b < STRIDE && outer; b++)
            outside(k->x[b], k->x[b] + N, &k->t[b], k->u[b], k->w + OUTSIDE_AT, k->fe[b]);
        memset(k->source, 0, sizeof k->source);
        for (int64_t j = 0; j < m && !status; j++) {
            double base[2 * N];
            for (int d = 0; d < 2 * N; d++) base[d] = a->tangent[d * m + j];
            if (outer) {
                const double of_h = a->outer[C * m + j], of_t = a->outer[(C + 1) * m + j] + (double)(a->first + s) * of_h;
                for (int b = 0; b < STRIDE; b++) {
                    for (int d = 0; d < 2 * N; d++) k->source[b][d] = k->f[b][d] * (of_h / h);
                    const V time = splat(of_t) + of_h * part(STAGE_C + b * LANES);
                    for (int e = 0; e < FE; e++) {
                        V along = splat(0.0);
                        const int column = FE_COLUMN[e];
                        if (column < C) along = splat(a->outer[column * m + j]);
                        else if (column == C) along = time;
                        else if (a->control_column >= 0)
                            for (int i = 0; i < LANES; i++) {
                                const int64_t node = a->control_nodes == 1 ? 0 : b * LANES + i;
                                const int64_t at = a->control_column + ((a->first + s) * a->control_nodes + node) * NU + column - C - 1;
                                if (b * LANES + i < STAGES && at == j) set_lane(&along, i, 1.0);
                            }
                        k->source[b][FE_ROW[e]] += k->fe[b][e] * along;
                    }
                }
            }
            for (int b = 0; b < STRIDE; b++)
                for (int d = 0; d < 2 * N; d++) k->m[b][d] = splat(base[d]);
            if ((status = iterate(k, 0, 0, base, k->m))) { *a->failed = (double)s; break; }
            finish(h, k->k, base);
            for (int d = 0; d < 2 * N; d++) a->tangent[d * m + j] = base[d];
        }
        if (!status && a->every && (s + 1) % a->every == 0)
            memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    }
    free(k);
    return status;
}

/* Adjoints of the stages to begin with: those of the step behind continued, from the adjoint between. */
INLINE void begin(Work *k, const double *mu, int known) {
    Stages next;
    for (int b = 0; b < STRIDE; b++)
        for (int d = 0; d < 2 * N; d++) {
            next[b][d] = splat(mu[d]);
            for (int j = 0; j < STAGES && known; j++)
                next[b][d] += part(CONTINUED + (j * STRIDE + b) * LANES) * splat(lane(k->m[j / LANES][d], j % LANES) - k->met[d]);
        }
    memcpy(k->m, next, sizeof next);
}

int adjoints(const SweepArguments *a) {
    int known = 0;
    Work *k = work_space(a);
    double *const mu = a->tangent;
    int status = k ? SWEPT : NO_MEMORY;
    for (int64_t s = a->steps - 1; s >= 0 && !status; s--) {
        const double h = a->h[s];
        double of_h = 0, of_t = 0;
        if ((status = linearise(k, a, s, h))) { *a->failed = (double)s; break; }
        memset(k->source, 0, sizeof k->source);
#if LOSS
        for (int b = 0; b < STRIDE; b++) {
            V value;
            density(k->x[b], k->x[b] + N, &k->t[b], k->u[b], k->w + DENSITY_AT, &value, k->source[b], k->of_e[b]);
            const double loss = sum(part(STAGE_B + b * LANES) * value);
            *a->loss += h * loss, of_h += loss;
        }
#endif
        begin(k, mu, known++ && h == a->h[s + 1]);
        if ((status = iterate(k, 1, 0, mu, k->m))) { *a->failed = (double)s; break; }
        finish(h, k->k, mu);
        memcpy(k->met, mu, sizeof k->met);
        for (int b = 0; b < STRIDE; b++) {
            const V weight = part(STAGE_B + b * LANES);
            V along = splat(0.0), pulled[OUT];
            for (int d = 0; d < 2 * N; d++) along += k->m[b][d] * k->f[b][d];
            of_h += sum(weight * along);
            pull(k->x[b], k->x[b] + N, &k->t[b], k->u[b], k->m[b], k->w + PULL_AT, pulled);
            for (int e = 0; e < OUT; e++) {
#if LOSS
                pulled[e] += k->of_e[b][e];
#endif
                pulled[e] *= h * weight;
            }
            for (int e = 0; e < C; e++) a->outer[e] += sum(pulled[e]);
            of_t += sum(pulled[C]), of_h += sum(part(STAGE_C + b * LANES) * pulled[C]);
            for (int d = 0; d < NU; d++)
                for (int i = 0; i < LANES && b * LANES + i < STAGES; i++) {
                    const int64_t node = a->control_nodes == 1 ? 0 : b * LANES + i;
                    a->out[(s * a->control_nodes + node) * NU + d] += lane(pulled[C + 1 + d], i);
                }
        }
        a->outer[C] += of_h + (double)(a->first + s) * of_t, a->outer[C + 1] += of_t;
        if (a->seeds) for (int i = 0; i < 2 * N; i++) mu[i] += a->seeds[s * 2 * N + i];
    }
    free(k);
    return status;
}
