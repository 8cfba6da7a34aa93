/* Derivatives of a run by a Gauss rule from its nodes, all stages of a step in the lanes of vectors.

   X_i = x + h sum_j a_ij f(X_j), x' = x + h sum_j b_j f(X_j) with x = (q, p), f = (v, dL/dq + F). Tangents solve
   dX_i = dx + h sum_j a_ij (J_j dX_j + what changes outside), adjoints M_i = mu' + h sum_j (b_j - a_ij) J_j^T M_j, for
   b_j a_ji / b_i = b_j - a_ij: both by the iteration of the run itself, coordinates first, then momenta, with J of the stages
   taken once a step.
   Defined before this file, by generated source or by sweep_gauss_scene.h: STAGES, STRIDE vectors of LANES for them, the
   columns COLUMN_A of a and COLUMN_M of b_j - a_ij, STAGE_B and STAGE_C (lanes beyond the stages repeat the last, with weight
   0), start values from WINDOW nodes (GUESS_Q, GUESS_V for each place of the step among them), CONTINUED, which continues
   adjoints of a step over the one before. slopes(q, p, t, u, w, f, J), NJ nonzeros; their products turn_q(J, x, source, …),
   turn_p, the components of J x + source, and back_q, back_p of its transpose; outside(…, df/de); pull(…, m, w, m^T df/de);
   density(…, loss, its slopes by x and by e), e = (parameters, time, controls); momentum(q, v, t, w, p). */
#include "sweep.h"

#define SLOPES_AT 0
#define OUTSIDE_AT (SLOPES_AT + SLOPES_W)
#define PULL_AT (OUTSIDE_AT + OUTSIDE_W)
#define DENSITY_AT (PULL_AT + PULL_W)
#define MOMENTUM_AT (DENSITY_AT + DENSITY_W)
#define TURN_Q_AT (MOMENTUM_AT + MOMENTUM_W)
#define TURN_P_AT (TURN_Q_AT + TURN_Q_W)
#define BACK_Q_AT (TURN_P_AT + TURN_P_W)
#define BACK_P_AT (BACK_Q_AT + BACK_Q_W)
#define ALL_W ((BACK_P_AT + BACK_P_W + LANES - 1) / LANES * LANES) /* vectors begin behind it */
#define OUT (C + 1 + NU)
#define SETTLED 1e-16 /* of all changes by what they belong to */
#define ALIKE 1e-13   /* changes below this that no longer shrink are round-off */
#define COMPONENTS (2 * N)
#define AT_BLOCK(x, b) ((x) + (b) * COMPONENTS) /* of the stages that vector b holds */

/* Numbers of all stages, (STRIDE, 2 N) vectors: components of x = (q, p), or of its rates. */
typedef V *Stages;

typedef struct {
    Stages x, f, m, k, source;
    V *slope, *fe, *t, *u, *of_e; /* (STRIDE, NJ), (STRIDE, FE), (STRIDE), (STRIDE, NU), (STRIDE, OUT) */
    V *a, *m_of;                  /* h a_ij, h (b_j - a_ij), (STAGES, STRIDE) */
    double *w, *size, *met, h;    /* met: the adjoint where the step at hand begins, before what is added there */
} Work;

INLINE V part(const double *x) { V y; memcpy(&y, x, sizeof y); return y; }

/* out := base + sum_j column_j k_j, for the components from `first` to `end`. */
INLINE void mix(const V *columns, const V *k, const double *base, int first, int end, Stages out) {
    for (int d = first; d < end; d++)
        for (int b = 0; b < STRIDE; b++) {
            V s = splat(base ? base[d] : 0.0);
            for (int j = 0; j < STAGES; j++) s = v_fma(columns[j * STRIDE + b], splat(lane(AT_BLOCK(k, j / LANES)[d], j % LANES)), s);
            AT_BLOCK(out, b)[d] = s;
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
            V next[STRIDE * COMPONENTS];
            for (int b = 0; b < STRIDE; b++) {
                const V *const slope = k->slope + b * NJ, *const at = AT_BLOCK(x, b), *const source = AT_BLOCK(k->source, b) + first;
                V *const rate = AT_BLOCK(k->k, b) + first;
                if (transposed && half) back_p(slope, at, source, k->w + BACK_P_AT, rate);
                else if (transposed) back_q(slope, at, source, k->w + BACK_Q_AT, rate);
                else if (half) turn_p(slope, at, source, k->w + TURN_P_AT, rate);
                else turn_q(slope, at, source, k->w + TURN_Q_AT, rate);
            }
            mix(transposed ? k->m_of : k->a, k->k, base, first, end, next);
            for (int d = first; d < end; d++) {
                const double unit = transposed ? k->size[d] : 1 / k->size[d];
                V most = splat(0.0), largest_x = splat(0.0);
                for (int b = 0; b < STRIDE; b++) {
                    const V now = AT_BLOCK(next, b)[d];
                    most = v_fmax(most, v_fabs(now - AT_BLOCK(x, b)[d])), largest_x = v_fmax(largest_x, v_fabs(now));
                    AT_BLOCK(x, b)[d] = now;
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
            k->a[j * STRIDE + b] = h * part(COLUMN_A + (j * STRIDE + b) * LANES);
            k->m_of[j * STRIDE + b] = h * part(COLUMN_M + (j * STRIDE + b) * LANES);
        }
    k->h = h;
    double most[2] = {0, 0}, before = INFINITY;
    for (int b = 0; b < STRIDE; b++) {
        V speed[N];
        k->t[b] = v_fma(splat(h), part(STAGE_C + b * LANES), splat(a->t[s]));
        for (int d = 0; d < N; d++) {
            V path = splat(x0[d]), rise = splat(0.0);
            for (int i = 0; i < count; i++) { /* from q at the start on, so that differences lose no digits */
                const double q = a->x[(from + i) * 2 * N + d] - x0[d], v = h * a->v[(from + i) * N + d];
                const int at = (2 * i * STRIDE + b) * LANES, behind = at + STRIDE * LANES;
                path = v_fma(part(tq + at), splat(q), v_fma(part(tq + behind), splat(v), path));
                rise = v_fma(part(tv + at), splat(q), v_fma(part(tv + behind), splat(v), rise));
            }
            AT_BLOCK(k->x, b)[d] = path, speed[d] = rise / h;
        }
        momentum(AT_BLOCK(k->x, b), speed, k->t + b, k->w + MOMENTUM_AT, AT_BLOCK(k->x, b) + N);
        for (int i = 0; i < LANES; i++) {
            const int stage = b * LANES + i < STAGES ? b * LANES + i : STAGES - 1;
            for (int d = 0; d < NU; d++) set_lane(&k->u[b * NU + d], i, a->u[(s * STAGES + stage) * NU + d]);
        }
    }
    for (int d = 0; d < 2 * N; d++) {
        k->size[d] = fmax(fabs(x0[d]), fabs(x0[2 * N + d]));
        most[d / N] = fmax(most[d / N], k->size[d]);
    }
    for (int d = 0; d < 2 * N; d++) k->size[d] = most[d / N] > 0 ? fmax(k->size[d], LEAST_SPEED * most[d / N]) : 1.0;
    for (int count = 0; count < MOST_ITERATIONS; count++) {
        V left[STRIDE * COMPONENTS], rest[STRIDE * COMPONENTS], none[N];
        double worst = 0;
        for (int b = 0; b < STRIDE; b++) {
            const V *const x = AT_BLOCK(k->x, b);
            slopes(x, x + N, k->t + b, k->u + b * NU, k->w + SLOPES_AT, AT_BLOCK(k->f, b), k->slope + b * NJ);
        }
        mix(k->a, k->f, x0, 0, 2 * N, left);
        for (int d = 0; d < 2 * N; d++) {
            V r = splat(0.0);
            for (int b = 0; b < STRIDE; b++) {
                AT_BLOCK(left, b)[d] -= AT_BLOCK(k->x, b)[d];
                r = v_fmax(r, v_fabs(AT_BLOCK(left, b)[d]));
            }
            const double size = largest(r) / k->size[d];
            worst = size > worst || size != size ? size : worst;
        }
        if (!(worst < INFINITY)) return NOT_SOLVED;
        if (worst <= ROUNDED || (worst <= ALIKE && worst >= 0.5 * before)) return SWEPT; /* slopes and rates are the solution's */
        before = worst;
        /* the correction d = r + h A J d is r and e = h A (J r + J e) */
        memset(rest, 0, sizeof rest), memset(none, 0, sizeof none);
        for (int b = 0; b < STRIDE; b++) {
            turn_q(k->slope + b * NJ, AT_BLOCK(left, b), none, k->w + TURN_Q_AT, AT_BLOCK(k->source, b));
            turn_p(k->slope + b * NJ, AT_BLOCK(left, b), none, k->w + TURN_P_AT, AT_BLOCK(k->source, b) + N);
        }
        const int status = iterate(k, 0, SETTLED, 0, rest);
        if (status) return status;
        for (int i = 0; i < STRIDE * COMPONENTS; i++) k->x[i] += left[i] + rest[i];
    }
    return NOT_SOLVED;
}

/* base + h sum_j b_j k_j */
INLINE void finish(double h, const V *k, double *base) {
    for (int d = 0; d < 2 * N; d++) {
        V s = splat(0.0);
        for (int b = 0; b < STRIDE; b++) s = v_fma(part(STAGE_B + b * LANES), AT_BLOCK(k, b)[d], s);
        base[d] += h * sum(s);
    }
}

static Work *work_space(const SweepArguments *a) {
    const int64_t stages = STRIDE * COMPONENTS, vectors[] = {stages, stages, stages, stages, stages, STRIDE * NJ + 1, STRIDE * FE + 1,
                                                             STRIDE, STRIDE * NU + 1, STRIDE * OUT, STAGES * STRIDE, STAGES * STRIDE};
    const int64_t head = (sizeof(Work) + 63) / 64 * 64;
    int64_t all = head + (ALL_W + 4 * N) * sizeof(double);
    for (int i = 0; i < 12; i++) all += vectors[i] * sizeof(V);
    all = (all + 63) / 64 * 64;
    char *const at = aligned_alloc(64, all);
    Work *const k = (Work *)at;
    if (!k) return 0;
    memset(at, 0, all);
    V **const places[] = {&k->x, &k->f, &k->m, &k->k, &k->source, &k->slope, &k->fe, &k->t, &k->u, &k->of_e, &k->a, &k->m_of};
    k->w = (double *)(at + head); /* first, for functions as data have vectors there */
    V *vector = (V *)(k->w + ALL_W);
    for (int i = 0; i < 12; i++) *places[i] = vector, vector += vectors[i];
    k->size = (double *)vector, k->met = k->size + 2 * N;
    slopes_prepare(a->c, k->w + SLOPES_AT), outside_prepare(a->c, k->w + OUTSIDE_AT), pull_prepare(a->c, k->w + PULL_AT);
    momentum_prepare(a->c, k->w + MOMENTUM_AT), density_prepare(a->c, k->w + DENSITY_AT);
    turn_q_prepare(a->c, k->w + TURN_Q_AT), turn_p_prepare(a->c, k->w + TURN_P_AT);
    back_q_prepare(a->c, k->w + BACK_Q_AT), back_p_prepare(a->c, k->w + BACK_P_AT);
    return k;
}

int tangents(const SweepArguments *a) {
    const int64_t m = a->columns;
    const int outer = a->outer_moves || a->control_column >= 0;
    BEGIN(a);
    Work *k = work_space(a);
    double *out = a->out;
    int status = k ? SWEPT : NO_MEMORY;
    if (!status && a->every) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    for (int64_t s = 0; s < a->steps && !status; s++) {
        const double h = a->h[s];
        if ((status = linearise(k, a, s, h))) { *a->failed = (double)s; break; }
        for (int b = 0; b < STRIDE && outer; b++) {
            const V *const x = AT_BLOCK(k->x, b);
            outside(x, x + N, k->t + b, k->u + b * NU, k->w + OUTSIDE_AT, k->fe + b * FE);
        }
        memset(k->source, 0, STRIDE * COMPONENTS * sizeof(V));
        for (int64_t j = 0; j < m && !status; j++) {
            double base[2 * N];
            for (int d = 0; d < 2 * N; d++) base[d] = a->tangent[d * m + j];
            if (outer) {
                const double of_h = a->outer[C * m + j], of_t = a->outer[(C + 1) * m + j] + (double)(a->first + s) * of_h;
                for (int b = 0; b < STRIDE; b++) {
                    V *const source = AT_BLOCK(k->source, b);
                    for (int d = 0; d < 2 * N; d++) source[d] = AT_BLOCK(k->f, b)[d] * (of_h / h);
                    const V time = v_fma(splat(of_h), part(STAGE_C + b * LANES), splat(of_t));
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
                        source[FE_ROW[e]] = v_fma(k->fe[b * FE + e], along, source[FE_ROW[e]]);
                    }
                }
            }
            for (int b = 0; b < STRIDE; b++)
                for (int d = 0; d < 2 * N; d++) AT_BLOCK(k->m, b)[d] = splat(base[d]);
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
    V next[STRIDE * COMPONENTS];
    for (int b = 0; b < STRIDE; b++)
        for (int d = 0; d < 2 * N; d++) {
            V s = splat(mu[d]);
            for (int j = 0; j < STAGES && known; j++)
                s = v_fma(part(CONTINUED + (j * STRIDE + b) * LANES), splat(lane(AT_BLOCK(k->m, j / LANES)[d], j % LANES) - k->met[d]), s);
            AT_BLOCK(next, b)[d] = s;
        }
    memcpy(k->m, next, sizeof next);
}

int adjoints(const SweepArguments *a) {
    BEGIN(a);
    int known = 0;
    Work *k = work_space(a);
    double *const mu = a->tangent;
    int status = k ? SWEPT : NO_MEMORY;
    for (int64_t s = a->steps - 1; s >= 0 && !status; s--) {
        const double h = a->h[s];
        double of_h = 0, of_t = 0;
        if ((status = linearise(k, a, s, h))) { *a->failed = (double)s; break; }
        memset(k->source, 0, STRIDE * COMPONENTS * sizeof(V));
        for (int b = 0; b < STRIDE && LOSS; b++) {
            V value;
            const V *const x = AT_BLOCK(k->x, b);
            density(x, x + N, k->t + b, k->u + b * NU, k->w + DENSITY_AT, &value, AT_BLOCK(k->source, b), k->of_e + b * OUT);
            const double loss = sum(part(STAGE_B + b * LANES) * value);
            *a->loss += h * loss, of_h += loss;
        }
        begin(k, mu, known++ && h == a->h[s + 1]);
        if ((status = iterate(k, 1, 0, mu, k->m))) { *a->failed = (double)s; break; }
        finish(h, k->k, mu);
        memcpy(k->met, mu, 2 * N * sizeof(double));
        for (int b = 0; b < STRIDE; b++) {
            const V weight = part(STAGE_B + b * LANES);
            const V *const x = AT_BLOCK(k->x, b), *const m = AT_BLOCK(k->m, b);
            V along = splat(0.0), pulled[OUT];
            for (int d = 0; d < 2 * N; d++) along = v_fma(m[d], AT_BLOCK(k->f, b)[d], along);
            of_h += sum(weight * along);
            pull(x, x + N, k->t + b, k->u + b * NU, m, k->w + PULL_AT, pulled);
            for (int e = 0; e < OUT; e++) {
                if (LOSS) pulled[e] += k->of_e[b * OUT + e];
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
