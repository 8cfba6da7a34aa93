/* Derivatives of an explicit run from its nodes, LANES steps at once.

   A part of a step is a kick, p += k(q, e), and a drift, q += d(p, e), e = (parameters, step, time, controls). What their
   derivatives are depends on the node alone: those of LANES steps are taken in the lanes of vectors. From step to step go
   the products with tangents, dp += k_q dq + k_e de, then dq += d_p dp + d_e de, or with adjoints, from the end to the start.
   Defined before this file, by generated source or by sweep_explicit_scene.h: N, NU (controls of a part at CONTROLS a node),
   PARTS with PART numbers each in PART_TABLE, of which DRIFTS says whether a drift follows the kick, C (parameters), E = C + 2
   + NU; whether a step's last kick is SHARED, the same as the first of the next; the places of the nonzeros of k_q (KQ) and
   d_p (DP), column by column: their rows, and where each column begins; and those of k_e (KE) and d_e (DE).
   part_of(q, p, t, u, part, w, k_q, d_p, k_e, d_e, q and p behind the part); density(…, loss, its slopes by (q, p) and by e)
   where LOSS. */
#include "sweep.h"
#include "outside.h"

#define PART_AT 0
#define DENSITY_AT (PART_AT + PART_OF_W)
#define SWEEP_W ((DENSITY_AT + DENSITY_W + LANES - 1) / LANES * LANES) /* vectors begin behind it */
#define KINDS 13
#define LAST (PARTS - 1)

/* Of every part of LANES steps: state, controls, derivatives, the adjoints of drift and kick; of the steps: time. Of a shared
   kick behind them, `known` where the steps there were taken: its derivatives. */
typedef struct {
    V *x, *u, *part, *kq, *dp, *ke, *de, *mu, *of_x, *of_e, *value, *t, *more;
    double *w, *kq_behind, *ke_behind, h;
    int prepared, known;
} Work;

/* With room for `more` vectors. */
static Work *work_space(int64_t more) {
    const int64_t vectors[KINDS] = {(PARTS + 1) * 2 * N, PARTS * NU, PARTS * PART, PARTS * KQ, PARTS * DP, PARTS * KE, PARTS * DE,
                                    PARTS * 2 * N, PARTS * 2 * N, PARTS * E, PARTS, 1, more};
    const int64_t head = (sizeof(Work) + 63) / 64 * 64;
    int64_t all = head + (SWEEP_W + KQ + KE) * sizeof(double);
    for (int i = 0; i < KINDS; i++) all += ROOM(vectors[i]) * sizeof(V);
    all = (all + 63) / 64 * 64;
    char *const at = aligned_alloc(64, all);
    Work *const k = (Work *)at;
    if (!k) return 0;
    memset(at, 0, all);
    V **const places[KINDS] = {&k->x, &k->u, &k->part, &k->kq, &k->dp, &k->ke, &k->de, &k->mu, &k->of_x, &k->of_e, &k->value,
                               &k->t, &k->more};
    k->w = (double *)(at + head); /* first, for functions as data have vectors there */
    V *vector = (V *)(k->w + SWEEP_W);
    for (int i = 0; i < KINDS; i++) *places[i] = vector, vector += ROOM(vectors[i]);
    k->kq_behind = (double *)vector, k->ke_behind = k->kq_behind + KQ;
    for (int i = 0; i < PARTS * PART; i++) k->part[i] = splat(PART_TABLE[i]);
    return k;
}

/* What is the same as long as the steps have one size. */
static void prepare(Work *k, const double *c, double h) {
    double constants[C + 1];
    if (k->prepared && k->h == h) return;
    memcpy(constants, c, C * sizeof(double)), constants[C] = h;
    part_of_prepare(constants, k->w + PART_AT), density_prepare(constants, k->w + DENSITY_AT);
    k->h = h, k->prepared = 1, k->known = 0;
}

/* The derivatives of `count` steps of one size from step s on; lanes beyond them repeat the last. Those of the last kick where
   it is to be `taken`. */
static void linearise(Work *k, const SweepArguments *a, int64_t s, int count, int lossy, int taken) {
    prepare(k, a->c, a->h[s]);
    for (int l = 0; l < LANES; l++) {
        const int64_t step = s + (l < count ? l : count - 1);
        for (int d = 0; d < 2 * N; d++) set_lane_at(&k->x[d], l, STATE_AT(a, step)[d]);
        for (int i = 0; i < PARTS * NU; i++) set_lane_at(&k->u[i], l, a->u[step * PARTS * NU + i]);
        set_lane_at(k->t, l, a->t[step]);
    }
    for (int r = 0; r < PARTS; r++) {
        const V *const q = k->x + r * 2 * N, *const p = q + N, *const u = k->u + r * NU, *const part = k->part + r * PART;
        if (taken || r < LAST)
            part_of(q, p, k->t, u, part, k->w + PART_AT, k->kq + r * KQ, k->dp + r * DP, k->ke + r * KE, k->de + r * DE,
                    k->x + (r + 1) * 2 * N);
        if (lossy) density(q, p, k->t, u, part, k->w + DENSITY_AT, k->value + r, k->of_x + r * 2 * N, k->of_e + r * E);
    }
}

/* Tangents: rows of `count` vectors; those of parameters, step and start time, and of the time of a step. */
typedef struct { int64_t count; V *q, *p, *along, *dt; } Rows;

/* to += value from */
INLINE void add_row(double value, const V *from, int64_t count, V *to) {
    const V factor = splat(value);
    for (int64_t j = 0; j < count; j++) to[j] = v_fma(factor, from[j], to[j]);
}

/* Rows of m numbers as `count` vectors each, and back. */
INLINE void padded(const double *rows, int64_t number, int64_t m, int64_t count, V *to) {
    for (int64_t i = 0; i < number; i++) memcpy(to + i * count, rows + i * m, m * sizeof(double));
}
INLINE void narrowed(const V *rows, int64_t number, int64_t m, int64_t count, double *to) {
    for (int64_t i = 0; i < number; i++) memcpy(to + i * m, rows + i * count, m * sizeof(double));
}

/* to += J from + J_e de of the part r of a step in lane l, which is the run's step `step` */
INLINE void add_changes(const SweepArguments *a, const Rows *x, int r, int l, int64_t step, const V *slopes, const int *rows,
                        const int *begin, const V *by_outside, const int *e_rows, const int *e_columns,
                        int e_number, const V *from, V *to) {
    for (int d = 0; d < N; d++)
        for (int i = begin[d]; i < begin[d + 1]; i++) add_row(lane_at(&slopes[i], l), from + d * x->count, x->count, to + rows[i] * x->count);
    for (int i = 0; i < e_number; i++) {
        const int column = e_columns[i];
        V *const row = to + e_rows[i] * x->count;
        if (column < C + 2) add_row(lane_at(&by_outside[i], l), column == C + 1 ? x->dt : x->along + column * x->count, x->count, row);
        else if (a->control_column >= 0) {
            const int place = column - (C + 2) + r * NU;
            const int64_t node = a->control_nodes == 1 ? 0 : place / CONTROLS;
            const int64_t j = a->control_column + (step * a->control_nodes + node) * CONTROLS + place % CONTROLS;
            set_lane_at(row, j, lane_at(row, j) + lane_at(&by_outside[i], l));
        }
    }
}

int tangents(const SweepArguments *a) {
    const int64_t m = a->columns, count = (m + LANES - 1) / LANES;
    const int outer = a->outer_moves || a->control_column >= 0;
    BEGIN(a);
    Work *const k = work_space((2 * N + C + 3) * count);
    if (!k) return NO_MEMORY;
    const Rows x = {count, k->more, k->more + N * count, k->more + 2 * N * count, k->more + (2 * N + C + 2) * count};
    double *out = a->out;
    padded(a->tangent, 2 * N, m, count, x.q), padded(a->outer, C + 2, m, count, x.along);
    if (a->every) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    for (int64_t s = 0, some; s < a->steps; s += some) {
        some = alike(a, s, 1);
        linearise(k, a, s, (int)some, 0, 1);
        for (int l = 0; l < some; l++) {
            const int64_t step = a->first + s + l;
            for (int64_t j = 0; j < count; j++) x.dt[j] = v_fma(splat((double)step), x.along[C * count + j], x.along[(C + 1) * count + j]);
            for (int r = 0; r < PARTS; r++) {
                add_changes(a, &x, r, l, step, k->kq + r * KQ, KQ_ROW, KQ_BEGIN, k->ke + r * KE, KE_ROW, KE_COLUMN,
                            outer ? KE : 0, x.q, x.p);
                if (DRIFTS[r])
                    add_changes(a, &x, r, l, step, k->dp + r * DP, DP_ROW, DP_BEGIN, k->de + r * DE, DE_ROW, DE_COLUMN,
                            outer ? DE : 0, x.p, x.q);
            }
            if (a->every && (s + l + 1) % a->every == 0) narrowed(x.q, 2 * N, m, count, out), out += 2 * N * m;
        }
    }
    narrowed(x.q, 2 * N, m, count, a->tangent);
    free(k);
    return SWEPT;
}

/* to += J^T from, J with its numbers `apart`; a column is summed up where it does not wait for memory */
INLINE void add_transposed(const double *slopes, int apart, const int *rows, const int *begin, const double *from, double *to) {
    for (int d = 0; d < N; d++) {
        double sum = to[d];
        for (int i = begin[d]; i < begin[d + 1]; i++) sum = s_fma(slopes[i * apart], from[rows[i]], sum);
        to[d] = sum;
    }
}

/* The adjoint (of q, of p) behind `count` steps from step s on is carried to where they begin; those of every drift and kick
   are kept, that of a shared kick with the step it opens, or added to `outer` with what is known of it behind the steps. */
static void carry_back(Work *k, const SweepArguments *a, int64_t s, int count, double *of_q, double *outer) {
    double *const of_p = of_q + N;
    for (int l = count - 1; l >= 0; l--) {
        if (SHARED) {
            const int behind = l == count - 1;
            if (behind) for (int i = 0; i < KE; i++) outer[KE_COLUMN[i]] = s_fma(k->ke_behind[i], of_p[KE_ROW[i]], outer[KE_COLUMN[i]]);
            else for (int d = 0; d < N; d++) set_lane_at(&k->mu[N + d], l + 1, lane_at(&k->mu[N + d], l + 1) + of_p[d]);
            add_transposed(behind ? k->kq_behind : (const double *)k->kq + l + 1, behind ? 1 : LANES, KQ_ROW, KQ_BEGIN, of_p, of_q);
            if (LOSS) for (int d = 0; d < 2 * N; d++) of_q[d] += lane_at(&k->of_x[LAST * 2 * N + d], l);
        }
        for (int r = SHARED ? LAST - 1 : LAST; r >= 0; r--) {
            V *const mu = k->mu + r * 2 * N;
            if (DRIFTS[r]) add_transposed((const double *)(k->dp + r * DP) + l, LANES, DP_ROW, DP_BEGIN, of_q, of_p);
            for (int d = 0; d < N; d++) set_lane_at(&mu[d], l, of_q[d]), set_lane_at(&mu[N + d], l, of_p[d]);
            add_transposed((const double *)(k->kq + r * KQ) + l, LANES, KQ_ROW, KQ_BEGIN, of_p, of_q);
            if (LOSS) for (int d = 0; d < 2 * N; d++) of_q[d] += lane_at(&k->of_x[r * 2 * N + d], l);
        }
        if (a->seeds) for (int d = 0; d < 2 * N; d++) of_q[d] += a->seeds[(s + l) * 2 * N + d];
    }
}

/* The derivatives of the kick of part r in lane l are those of the kick behind the steps before. */
static void keep_kick(Work *k, int r, int l) {
    for (int i = 0; i < KQ; i++) k->kq_behind[i] = lane_at(&k->kq[r * KQ + i], l);
    for (int i = 0; i < KE; i++) k->ke_behind[i] = lane_at(&k->ke[r * KE + i], l);
    k->known = 1;
}

int adjoints(const SweepArguments *a) {
    BEGIN(a);
    Work *const k = work_space(C + 3 + E);
    if (!k) return NO_MEMORY;
    V *const outer = k->more, *const loss = outer + C + 2, *const pulled = loss + 1;
    for (int64_t s = a->steps, some; s > 0;) {
        some = alike(a, s - 1, -1), s -= some;
        prepare(k, a->c, a->h[s]);
        linearise(k, a, s, (int)some, LOSS, !(SHARED && k->known));
        if (SHARED && !k->known) keep_kick(k, LAST, (int)some - 1);
        carry_back(k, a, s, (int)some, a->tangent, a->outer);
        if (SHARED) keep_kick(k, 0, 0);
        V there; /* lanes without a step count for nothing */
        for (int l = 0; l < LANES; l++) set_lane(&there, l, l < some);
        for (int r = 0; r < PARTS - (SHARED && !LOSS); r++) {
            const V *const of_q = k->mu + r * 2 * N, *const of_p = of_q + N, *const ke = k->ke + r * KE, *const de = k->de + r * DE;
            if (LOSS) *loss = v_fma(there, k->value[r], *loss);
            for (int i = 0; i < E; i++) pulled[i] = LOSS ? k->of_e[r * E + i] : splat(0.0);
            for (int i = 0; i < KE && !(SHARED && r == LAST); i++) pulled[KE_COLUMN[i]] = v_fma(ke[i], of_p[KE_ROW[i]], pulled[KE_COLUMN[i]]);
            for (int i = 0; i < DE && DRIFTS[r]; i++) pulled[DE_COLUMN[i]] = v_fma(de[i], of_q[DE_ROW[i]], pulled[DE_COLUMN[i]]);
            add_pulled(a, s, (int)some, r, pulled, outer);
        }
    }
    for (int i = 0; i < C + 2; i++) a->outer[i] += sum(outer[i]);
    *a->loss += sum(*loss);
    free(k);
    return SWEPT;
}
