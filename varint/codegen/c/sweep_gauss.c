/* Derivatives of a run by a Gauss rule from its nodes, all stages of a step in the lanes of vectors.

   X_i = x + h sum_j a_ij f(X_j), x' = x + h sum_j b_j f(X_j) with x = (q, p), f = (v, dL/dq + F). Tangents solve
   dX_i = dx + h sum_j a_ij (J_j dX_j + what changes outside), adjoints M_i = mu' + h sum_j (b_j - a_ij) J_j^T M_j, for
   b_j a_ji / b_i = b_j - a_ij: both by the iteration of the run itself, coordinates first, then momenta, with J of the stages
   taken once a step.
   Defined before this file, by generated source or by sweep_gauss_scene.h: STAGES, STRIDE vectors of LANES for them, the
   columns COLUMN_A of a and COLUMN_M of b_j - a_ij, STAGE_B and STAGE_C (lanes beyond the stages repeat the last, with weight
   0), start values from WINDOW nodes (GUESS_Q, GUESS_V for each place of the step among them), CONTINUED and ONWARDS, which
   continue adjoints of a step over the one before and tangents over the one behind, and AHEAD, the first of them with MORE nodes. slopes(q, p, t, u, w, f, J), NJ nonzeros;
   their products turn_q(J, x, source, …), turn_p, the components of J x + source, and back_q, back_p of its transpose;
   outside(…, df/de); pull(…, m, w, m^T df/de); density(…, loss, its slopes by x and by e), e = (parameters, time, controls);
   momentum(q, v, t, w, p). */
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
#define IN_TURN 1e-3  /* of the square of what was left before: less than Newton's method leaves of it */
#define ALIKE 1e-13   /* changes below this that no longer shrink are round-off */
#define COMPONENTS (2 * N)
#define ABREAST 4 /* columns that are iterated side by side */
#define AT_BLOCK(x, b) ((x) + (b) * COMPONENTS) /* of the stages that vector b holds */

/* Numbers of all stages, (STRIDE, 2 N) vectors: components of x = (q, p), or of its rates. */
typedef V *Stages;

typedef struct {
    Stages x, f, m, k, source;
    V *slope, *fe, *t, *u, *of_e; /* (STRIDE, NJ), (STRIDE, FE), (STRIDE), (STRIDE, NU), (STRIDE, OUT) */
    V *a, *m_of;                  /* h a_ij, h (b_j - a_ij), (STAGES, STRIDE) */
    double *w, *size, *met, *older, h; /* met: the adjoint where the step at hand begins, before what is added there; older: at
                                          MORE nodes behind that step, the nearest first */
} Work;

INLINE V part(const double *x) { V y; memcpy(&y, x, sizeof y); return y; }

/* Component d of stage j: one number from memory goes into all lanes at once, which from a register takes a detour. */
INLINE double at_stage(const V *k, int j, int d) { return ((const double *)k)[(j / LANES * COMPONENTS + d) * LANES + j % LANES]; }

/* out := base + sum_j column_j k_j, for the components from `first` to `end`. */
INLINE void mix(const V *columns, const V *k, const double *base, int first, int end, Stages out) {
    for (int d = first; d < end; d++)
        for (int b = 0; b < STRIDE; b++) {
            V s = splat(base ? base[d] : 0.0);
            for (int j = 0; j < STAGES; j++) s = v_fma(columns[j * STRIDE + b], splat(at_stage(k, j, d)), s);
            AT_BLOCK(out, b)[d] = s;
        }
}

/* Columns that are iterated side by side, because each waits for itself: their bases (count, 2 N) or none, x and rates (count,
   STRIDE, 2 N), sources `apart` from each other; which are still open; the largest change and x of the turn at hand, in units
   of their sizes, and what is no number if there is any. */
typedef struct {
    const double *base;
    Stages x, rates, sources;
    int64_t apart;
    int count, open[ABREAST];
    V moved[ABREAST], size[ABREAST], lost[ABREAST];
} Columns;

/* One half of x, coordinates or momenta, of every open column. */
INLINE void turn(const Work *k, int transposed, int half, const double *unit, Columns *c) {
    const int first = half * N, end = first + N;
    for (int j = 0; j < c->count; j++) {
        if (!c->open[j]) continue;
        V next[STRIDE * COMPONENTS];
        V *const x = c->x + j * STRIDE * COMPONENTS, *const rates = c->rates + j * STRIDE * COMPONENTS;
        for (int b = 0; b < STRIDE; b++) {
            const V *const slope = k->slope + b * NJ, *const at = AT_BLOCK(x, b), *const source = AT_BLOCK(c->sources + j * c->apart, b) + first;
            V *const rate = AT_BLOCK(rates, b) + first;
            if (transposed && half) back_p(slope, at, source, k->w + BACK_P_AT, rate);
            else if (transposed) back_q(slope, at, source, k->w + BACK_Q_AT, rate);
            else if (half) turn_p(slope, at, source, k->w + TURN_P_AT, rate);
            else turn_q(slope, at, source, k->w + TURN_Q_AT, rate);
        }
        mix(transposed ? k->m_of : k->a, rates, c->base ? c->base + j * COMPONENTS : 0, first, end, next);
        V moved = splat(0.0), size = splat(0.0), lost = splat(0.0);
        if (half) moved = c->moved[j], size = c->size[j], lost = c->lost[j];
        for (int d = first; d < end; d++)
            for (int b = 0; b < STRIDE; b++) {
                const V now = AT_BLOCK(next, b)[d], by = splat(unit[d]);
                moved = v_fmax(moved, v_fabs(now - AT_BLOCK(x, b)[d]) * by), size = v_fmax(size, v_fabs(now) * by);
                lost += now;
                AT_BLOCK(x, b)[d] = now;
            }
        c->moved[j] = moved, c->size[j] = size, c->lost[j] = lost;
    }
}

/* x = base + h A (J x + source), from the x at hand, or the adjoint's; the rates are J x + source at the end. `enough`, in units
   of the sizes of x, is a change that does not matter. */
static int iterate(Work *k, int transposed, double enough, Columns *c) {
    double before[ABREAST], unit[COMPONENTS];
    int left = c->count;
    for (int j = 0; j < left; j++) before[j] = INFINITY, c->open[j] = 1;
    for (int d = 0; d < COMPONENTS; d++) unit[d] = transposed ? k->size[d] : 1 / k->size[d];
    for (int count = 0; count < MOST_ITERATIONS; count++) {
        turn(k, transposed, 0, unit, c);
        turn(k, transposed, 1, unit, c);
        for (int j = 0; j < c->count; j++) {
            if (!c->open[j]) continue;
            const double change = largest(c->moved[j] + (c->lost[j] - c->lost[j])), all = largest(c->size[j]), last = before[j];
            if (!(change < INFINITY)) return NOT_SOLVED;
            /* or the next one will be: they shrink by the same ratio again */
            const double next_change = last < INFINITY ? change * (change / last) : change;
            const int settled = change <= SETTLED * all || next_change <= SETTLED * all || next_change <= enough;
            before[j] = change, c->open[j] = !settled && !(change <= ALIKE * all && change >= 0.5 * last);
            left -= !c->open[j];
        }
        if (!left) return SWEPT;
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
    const double *const x0 = STATE_AT(a, s), *const x1 = STATE_AT(a, s + 1);
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
            V path = splat(x0[d]), rise = splat(0.0), of_v = splat(0.0), rise_of_v = splat(0.0);
            for (int i = 0; i < count; i++) { /* from q at the start on, so that differences lose no digits */
                const double q = STATE_AT(a, from + i)[d] - x0[d], v = h * SPEED_AT(a, from + i)[d];
                const int at = (2 * i * STRIDE + b) * LANES, behind = at + STRIDE * LANES;
                path = v_fma(part(tq + at), splat(q), path), of_v = v_fma(part(tq + behind), splat(v), of_v);
                rise = v_fma(part(tv + at), splat(q), rise), rise_of_v = v_fma(part(tv + behind), splat(v), rise_of_v);
            }
            AT_BLOCK(k->x, b)[d] = path + of_v, speed[d] = (rise + rise_of_v) / h;
        }
        momentum(AT_BLOCK(k->x, b), speed, k->t + b, k->w + MOMENTUM_AT, AT_BLOCK(k->x, b) + N);
        for (int i = 0; i < LANES; i++) {
            const int stage = b * LANES + i < STAGES ? b * LANES + i : STAGES - 1;
            for (int d = 0; d < NU; d++) set_lane(&k->u[b * NU + d], i, a->u[(s * STAGES + stage) * NU + d]);
        }
    }
    for (int d = 0; d < 2 * N; d++) {
        k->size[d] = fmax(fabs(x0[d]), fabs(x1[d]));
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
        const int status = iterate(k, 0, fmax(SETTLED, IN_TURN * worst * worst), &(Columns){0, rest, k->k, k->source, 0, 1});
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
    const int64_t stages = STRIDE * COMPONENTS, columns = a->columns > 1 ? a->columns : 1, abreast = columns < ABREAST ? columns : ABREAST;
    const int64_t vectors[] = {stages, stages, columns * stages, abreast * stages, abreast * stages, STRIDE * NJ + 1, STRIDE * FE + 1,
                                                             STRIDE, STRIDE * NU + 1, STRIDE * OUT, STAGES * STRIDE, STAGES * STRIDE};
    const int64_t head = (sizeof(Work) + 63) / 64 * 64;
    int64_t all = head + (ALL_W + (4 + 2 * MORE) * N) * sizeof(double);
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
    k->size = (double *)vector, k->met = k->size + 2 * N, k->older = k->met + 2 * N;
    slopes_prepare(a->c, k->w + SLOPES_AT), outside_prepare(a->c, k->w + OUTSIDE_AT), pull_prepare(a->c, k->w + PULL_AT);
    momentum_prepare(a->c, k->w + MOMENTUM_AT), density_prepare(a->c, k->w + DENSITY_AT);
    turn_q_prepare(a->c, k->w + TURN_Q_AT), turn_p_prepare(a->c, k->w + TURN_P_AT);
    back_q_prepare(a->c, k->w + BACK_Q_AT), back_p_prepare(a->c, k->w + BACK_P_AT);
    return k;
}

/* Stages to begin with: those of the step before, or behind, continued by the table from x, the value between, in which `met`
   is that of their own step; with `more` nodes behind that one. */
INLINE void begin(const double *table, const double *x, const double *met, const double *older, int more, Stages stages) {
    V next[STRIDE * COMPONENTS];
    for (int b = 0; b < STRIDE; b++)
        for (int d = 0; d < COMPONENTS; d++) {
            V s = splat(x[d]);
            for (int j = 0; j < STAGES && met; j++)
                s = v_fma(part(table + (j * STRIDE + b) * LANES), splat(at_stage(stages, j, d) - met[d]), s);
            for (int j = 0; j < more; j++)
                s = v_fma(part(table + ((STAGES + j) * STRIDE + b) * LANES), splat(older[j * COMPONENTS + d] - met[d]), s);
            AT_BLOCK(next, b)[d] = s;
        }
    memcpy(stages, next, sizeof next);
}

/* What a step of size h is told of column j from outside, added to the rates of its stages. */
INLINE void told(const Work *k, const SweepArguments *a, int64_t s, int64_t j, Stages sources) {
    const int64_t m = a->columns;
    const double of_h = a->outer[C * m + j], of_t = a->outer[(C + 1) * m + j] + (double)(a->first + s) * of_h;
    for (int b = 0; b < STRIDE; b++) {
        V *const source = AT_BLOCK(sources, b);
        for (int d = 0; d < COMPONENTS; d++) source[d] = AT_BLOCK(k->f, b)[d] * (of_h / k->h);
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

int tangents(const SweepArguments *a) {
    BEGIN(a);
    const int64_t m = a->columns, each = STRIDE * COMPONENTS;
    const int outer = a->outer_moves || a->control_column >= 0;
    Work *k = work_space(a);
    double *out = a->out;
    int status = k ? SWEPT : NO_MEMORY;
    if (!status && a->every) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    for (int64_t s = 0; s < a->steps && !status; s++) {
        const double h = a->h[s];
        const int known = s && h == a->h[s - 1];
        if ((status = linearise(k, a, s, h))) { *a->failed = (double)s; break; }
        for (int b = 0; b < STRIDE && outer; b++) {
            const V *const x = AT_BLOCK(k->x, b);
            outside(x, x + N, k->t + b, k->u + b * NU, k->w + OUTSIDE_AT, k->fe + b * FE);
        }
        memset(k->source, 0, each * sizeof(V));
        for (int64_t j = 0; j < m; j += ABREAST) {
            const int count = m - j < ABREAST ? (int)(m - j) : ABREAST;
            double base[ABREAST * COMPONENTS];
            const Stages stages = k->m + j * each;
            for (int i = 0; i < count; i++) {
                double *const of = base + i * COMPONENTS;
                for (int d = 0; d < COMPONENTS; d++) of[d] = a->tangent[d * m + j + i];
                begin(ONWARDS, of, known ? of : 0, 0, 0, stages + i * each);
                if (outer) told(k, a, s, j + i, k->source + i * each);
            }
            if ((status = iterate(k, 0, 0, &(Columns){base, stages, k->k, k->source, outer ? each : 0, count}))) { *a->failed = (double)s; break; }
            for (int i = 0; i < count; i++) {
                double *const of = base + i * COMPONENTS;
                finish(h, k->k + i * each, of);
                for (int d = 0; d < COMPONENTS; d++) a->tangent[d * m + j + i] = of[d];
            }
        }
        if (!status && a->every && (s + 1) % a->every == 0)
            memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    }
    free(k);
    return status;
}

int adjoints(const SweepArguments *a) {
    BEGIN(a);
    int64_t alike = 0; /* steps of the size of that at hand behind it */
    Work *k = work_space(a);
    double *const mu = a->tangent;
    int status = k ? SWEPT : NO_MEMORY;
    if (!status) memcpy(k->met, mu, 2 * N * sizeof(double));
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
        if (alike && h != a->h[s + 1]) alike = 0;
        const int more = alike >= MORE && !a->seeds ? MORE : 0;
        begin(more ? AHEAD : CONTINUED, mu, alike++ ? k->met : 0, k->older, more, k->m);
        if ((status = iterate(k, 1, 0, &(Columns){mu, k->m, k->k, k->source, 0, 1}))) { *a->failed = (double)s; break; }
        finish(h, k->k, mu);
        memmove(k->older + 2 * N, k->older, (MORE - 1) * 2 * N * sizeof(double));
        memcpy(k->older, k->met, 2 * N * sizeof(double)), memcpy(k->met, mu, 2 * N * sizeof(double));
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
