/* Derivatives of a run of a linear scene of few unknowns from its nodes, LANES steps at once.

   A step takes x = (q, p) to G_x x + G_y y + g where F_x x + F_y y + f = 0, with matrices that are the same for all steps of a
   size; f, g and what is outside depend on e = (parameters, step, time, controls). With A = -F_y^-1: tangents dx' = (G_x + G_y A
   F_x) dx + G_e de + G_y A F_e de, adjoints mu = (G_x + G_y A F_x)^T mu' from step to step, and eta = A^T (G_y^T mu' + ...) of
   LANES steps in the lanes of vectors. Where nothing outside changes in time, what F_e and G_e pull back is bilinear in (mu', what
   a density adds to y) and (x, 1) with the same coefficients in all steps: the sums of their products over the steps are enough.
   Defined before this file, by generated source or by sweep_linear_scene.h: N, NU (controls at CONTROLS a node), Y (unknowns),
   C (parameters), E = C + 2 + NU, the nonzeros FE of F_e, GE of G_e and S of [F_y F_x; G_y G_x], and their places. matrices(w, the
   last of these); rest(q, p, t, u, w, F at y = 0); outside(y, q, p, t, u, part, w, F_e, G_e); pull(…, mu, eta, w, G_e^T mu +
   F_e^T eta, nothing); density(y, …, w, loss, its slopes by y, x and e) where LOSS. */
#include "sweep.h"
#include "outside.h"

#define MATRICES_AT 0
#define REST_AT (MATRICES_AT + MATRICES_W)
#define OUTSIDE_AT (REST_AT + REST_W)
#define PULL_AT (OUTSIDE_AT + OUTSIDE_W)
#define DENSITY_AT (PULL_AT + PULL_W)
#define SWEEP_W ((DENSITY_AT + DENSITY_W + LANES - 1) / LANES * LANES) /* vectors begin behind it */
#define BOTH (2 * N)
#define ROWS ((BOTH + LANES - 1) / LANES) /* vectors of a column of `map` */
#define PAIRED (BOTH + LOSS * Y) /* what is multiplied by x */
#define KINDS 17

/* Of LANES steps: unknowns, state, controls, time, what the loss adds to eta and mu, adjoints. `map`: (BOTH, ROWS) vectors, its
   rows; `a` (Y, Y), `from_before` = A F_x (Y, BOTH) and `to_after` = G_y A (BOTH, Y), row by row. Over steps: `products`
   the sums of mu' x^T and of_y x^T, rows as those of `map`, `total` of (mu', of_y), `largest` |x| of each number, ROWS vectors. */
typedef struct {
    V *y, *x, *u, *t, *of_y, *of_x, *of_e, *mu, *eta, *fe, *ge, *map, *products, *total, *largest, *pulled, *more;
    double *w, *a, *to_after, *from_before, h;
    int prepared, sound;
} Work;

static Work *work_space(int64_t more) {
    const int64_t vectors[KINDS] = {Y, BOTH, NU, 1, Y, BOTH, E, BOTH, Y, FE, GE, BOTH * ROWS, PAIRED * ROWS, PAIRED, ROWS, E, more};
    const int64_t head = (sizeof(Work) + 63) / 64 * 64;
    int64_t all = head + (SWEEP_W + Y * Y + 2 * BOTH * Y) * sizeof(double);
    for (int i = 0; i < KINDS; i++) all += ROOM(vectors[i]) * sizeof(V);
    all = (all + 63) / 64 * 64;
    char *const at = aligned_alloc(64, all);
    Work *const k = (Work *)at;
    if (!k) return 0;
    memset(at, 0, all);
    V **const places[KINDS] = {&k->y, &k->x, &k->u, &k->t, &k->of_y, &k->of_x, &k->of_e, &k->mu, &k->eta, &k->fe, &k->ge, &k->map,
                               &k->products, &k->total, &k->largest, &k->pulled, &k->more};
    k->w = (double *)(at + head); /* first, for functions as data have vectors there */
    V *vector = (V *)(k->w + SWEEP_W);
    for (int i = 0; i < KINDS; i++) *places[i] = vector, vector += ROOM(vectors[i]);
    k->a = (double *)vector, k->to_after = k->a + Y * Y, k->from_before = k->to_after + BOTH * Y;
    return k;
}

/* a := -m^-1, both (Y, Y) row by row, by Gauss and Jordan with row exchanges; m is lost. */
static void negative_inverse(double *m, double *a) {
    for (int i = 0; i < Y * Y; i++) a[i] = i % (Y + 1) ? 0 : -1;
    for (int c = 0; c < Y; c++) {
        int best = c;
        for (int r = c + 1; r < Y; r++)
            if (fabs(m[r * Y + c]) > fabs(m[best * Y + c])) best = r;
        for (int j = 0; j < Y; j++) {
            const double x = m[c * Y + j], y = a[c * Y + j];
            m[c * Y + j] = m[best * Y + j], m[best * Y + j] = x, a[c * Y + j] = a[best * Y + j], a[best * Y + j] = y;
        }
        const double inverse = 1 / m[c * Y + c];
        for (int j = 0; j < Y; j++) m[c * Y + j] *= inverse, a[c * Y + j] *= inverse;
        for (int r = 0; r < Y; r++) {
            const double factor = m[r * Y + c];
            if (r == c || factor == 0) continue;
            for (int j = 0; j < Y; j++)
                m[r * Y + j] = s_fma(-factor, m[c * Y + j], m[r * Y + j]), a[r * Y + j] = s_fma(-factor, a[c * Y + j], a[r * Y + j]);
        }
    }
}

/* The matrices of a step size, their last digits right, for every step repeats what they lack. 0: no memory. */
static int prepare(Work *k, const double *c, double h) {
    const int all = Y + BOTH;
    double constants[C + 1], *const x = k->from_before;
    if (k->prepared && k->h == h) return 1;
    V *const nonzeros = aligned_alloc(64, ROOM(S) * sizeof(V));
    double *const slopes = calloc(ROOM(all * all + Y * Y + 2 * Y), sizeof(double)); /* column by column */
    if (!nonzeros || !slopes) {
        free(nonzeros), free(slopes);
        return 0;
    }
    double *const m = slopes + all * all, *const row = m + Y * Y, *const left = row + Y;
    const double *const fy = slopes, *const gy = slopes + Y, *const fx = slopes + Y * all, *const gx = fx + Y;
    memcpy(constants, c, C * sizeof(double)), constants[C] = h;
    matrices_prepare(constants, k->w + MATRICES_AT), rest_prepare(constants, k->w + REST_AT);
    outside_prepare(constants, k->w + OUTSIDE_AT), pull_prepare(constants, k->w + PULL_AT);
    density_prepare(constants, k->w + DENSITY_AT);
    matrices(k->w + MATRICES_AT, nonzeros);
    for (int i = 0; i < S; i++) slopes[S_COLUMN[i] * all + S_ROW[i]] = lane_at(&nonzeros[i], 0);
    for (int i = 0; i < Y; i++) { /* rows in units of their largest number */
        for (int j = 0; j < Y; j++) row[i] = fmax(row[i], fabs(fy[j * all + i]));
        for (int j = 0; j < Y; j++) m[i * Y + j] = fy[j * all + i] / row[i];
    }
    negative_inverse(m, k->a);
    for (int i = 0; i < Y * Y; i++) k->a[i] /= row[i % Y];
    memset(x, 0, Y * BOTH * sizeof(double));
    for (int round = 0; round < 3; round++) /* x = A F_x, and what is missing */
        for (int j = 0; j < BOTH; j++) {
            for (int i = 0; i < Y; i++) {
                double high = fx[j * all + i], low = 0;
                for (int l = 0; l < Y; l++) add_exactly(&high, &low, fy[l * all + i], x[l * BOTH + j]);
                left[i] = high + low;
            }
            for (int i = 0; i < Y; i++)
                for (int l = 0; l < Y; l++) x[i * BOTH + j] = s_fma(k->a[i * Y + l], left[l], x[i * BOTH + j]);
        }
    for (int i = 0; i < BOTH; i++)
        for (int j = 0; j < BOTH; j++) {
            double high = gx[j * all + i], low = 0;
            for (int l = 0; l < Y; l++) add_exactly(&high, &low, gy[l * all + i], x[l * BOTH + j]);
            ((double *)(k->map + i * ROWS))[j] = high + low;
        }
    for (int i = 0; i < BOTH; i++)
        for (int j = 0; j < Y; j++) {
            double sum = 0;
            for (int l = 0; l < Y; l++) sum = s_fma(gy[l * all + i], k->a[l * Y + j], sum);
            k->to_after[i * Y + j] = sum;
        }
    k->h = h, k->prepared = 1;
    k->sound = !unsound(k->a, Y * Y) && !unsound((double *)k->map, BOTH * ROWS * LANES);
    free(nonzeros), free(slopes);
    return 1;
}

/* The unknowns of the steps in the lanes. */
static void solve(Work *k) {
    V left[ROOM(Y)];
    rest(k->x, k->x + N, k->t, k->u, k->w + REST_AT, left);
    for (int i = 0; i < Y; i++) {
        k->y[i] = splat(0.0);
        for (int j = 0; j < Y; j++) k->y[i] = v_fma(splat(k->a[i * Y + j]), left[j], k->y[i]);
    }
}

/* `count` steps from step s on; lanes beyond them repeat the last. */
static void solve_steps(Work *k, const SweepArguments *a, int64_t s, int count) {
    for (int l = 0; l < LANES; l++) {
        const int64_t step = s + (l < count ? l : count - 1);
        for (int d = 0; d < BOTH; d++) set_lane_at(&k->x[d], l, STATE_AT(a, step)[d]);
        for (int i = 0; i < NU; i++) set_lane_at(&k->u[i], l, a->u[step * NU + i]);
        set_lane_at(k->t, l, a->t[step]);
    }
    solve(k);
}

int tangents(const SweepArguments *a) {
    BEGIN(a);
    const int64_t m = a->columns;
    const int outer = a->outer_moves || a->control_column >= 0;
    Work *const k = work_space(((BOTH + Y + 1) * m + LANES - 1) / LANES);
    if (!k) return NO_MEMORY;
    double *const next = (double *)k->more, *const df = next + BOTH * m, *const dt = df + Y * m, *out = a->out;
    int status = SWEPT;
    if (a->every) memcpy(out, a->tangent, BOTH * m * sizeof(double)), out += BOTH * m;
    for (int64_t s = 0, some; s < a->steps && !status; s += some) {
        some = alike(a, s, 1);
        if (!prepare(k, a->c, a->h[s])) { status = NO_MEMORY; break; }
        if (!k->sound) { *a->failed = (double)s, status = NOT_REGULAR; break; }
        if (outer) solve_steps(k, a, s, (int)some), outside(k->y, k->x, k->x + N, k->t, k->u, k->x, k->w + OUTSIDE_AT, k->fe, k->ge);
        for (int l = 0; l < some; l++) {
            memset(next, 0, (BOTH + Y) * m * sizeof(double));
            for (int i = 0; i < BOTH; i++)
                for (int d = 0; d < BOTH; d++) {
                    const double slope = ((const double *)(k->map + i * ROWS))[d];
                    for (int64_t j = 0; j < m; j++) next[i * m + j] = s_fma(slope, a->tangent[d * m + j], next[i * m + j]);
                }
            if (outer) {
                for (int64_t j = 0; j < m; j++) dt[j] = a->outer[(C + 1) * m + j] + (double)(a->first + s + l) * a->outer[C * m + j];
                add_outside(a, s + l, 0, dt, (const double *)k->fe + l, LANES, FE_ROW, FE_COLUMN, FE, df);
                add_outside(a, s + l, 0, dt, (const double *)k->ge + l, LANES, GE_ROW, GE_COLUMN, GE, next);
                for (int i = 0; i < BOTH; i++)
                    for (int d = 0; d < Y; d++)
                        for (int64_t j = 0; j < m; j++) next[i * m + j] = s_fma(k->to_after[i * Y + d], df[d * m + j], next[i * m + j]);
            }
            memcpy(a->tangent, next, BOTH * m * sizeof(double));
            if (a->every && (s + l + 1) % a->every == 0) memcpy(out, a->tangent, BOTH * m * sizeof(double)), out += BOTH * m;
        }
    }
    free(k);
    return status;
}

/* The adjoint behind `count` steps from step s on is carried to where they begin; that behind each of them is kept. */
static void carry_back(Work *k, const SweepArguments *a, int64_t s, int count, double *mu) {
    for (int l = count - 1; l >= 0; l--) {
        V before[ROWS];
        for (int b = 0; b < ROWS; b++) before[b] = splat(0.0);
        for (int i = 0; i < BOTH; i++) {
            const V factor = splat(mu[i]);
            for (int b = 0; b < ROWS; b++) before[b] = v_fma(factor, k->map[i * ROWS + b], before[b]);
            set_lane_at(&k->mu[i], l, mu[i]);
        }
        memcpy(mu, before, BOTH * sizeof(double));
        if (LOSS) for (int d = 0; d < BOTH; d++) mu[d] += lane_at(&k->of_x[d], l);
        if (a->seeds) for (int d = 0; d < BOTH; d++) mu[d] += a->seeds[(s + l) * BOTH + d];
    }
}

/* The products of `count` steps from step s on are added up. */
static void add_products(Work *k, const SweepArguments *a, int64_t s, int count) {
    V x[LANES * ROWS];
    for (int64_t l = 0; l < count; l++) {
        V *const at = x + l * ROWS;
        at[ROWS - 1] = splat(0.0), memcpy(at, STATE_AT(a, s + l), BOTH * sizeof(double));
        for (int b = 0; b < ROWS; b++) k->largest[b] = v_fmax(v_fabs(at[b]), k->largest[b]);
    }
    for (int i = 0; i < PAIRED; i++) {
        const double *const by = (const double *)(i < BOTH ? &k->mu[i] : &k->of_y[i - BOTH]);
        for (int b = 0; b < ROWS; b++) {
            V sum = k->products[i * ROWS + b];
            for (int l = 0; l < count; l++) sum = v_fma(splat(by[l]), x[l * ROWS + b], sum);
            k->products[i * ROWS + b] = sum;
        }
        for (int l = 0; l < count; l++) ((double *)k->total)[i] += by[l];
    }
}

/* What the steps in the lanes pull back through F and G. */
static void pull_back(Work *k) {
    for (int j = 0; j < Y; j++) {
        k->eta[j] = splat(0.0);
        for (int i = 0; i < BOTH; i++) k->eta[j] = v_fma(splat(k->to_after[i * Y + j]), k->mu[i], k->eta[j]);
        for (int i = 0; i < Y && LOSS; i++) k->eta[j] = v_fma(splat(k->a[i * Y + j]), k->of_y[i], k->eta[j]);
    }
    pull(k->y, k->x, k->x + N, k->t, k->u, k->x, k->mu, k->eta, k->w + PULL_AT, k->pulled, k->of_x);
}

/* With P(m, x) what a step pulls back, m = (mu', of_y): the sum over the steps is that over d of P(W_d / X_d, X_d e_d), W_d the sum
   of m x_d and X_d = max |x_d|, and P(what these leave of the sum of m, 0): as many lanes as there are numbers, and one. */
static void pull_products(Work *k, const SweepArguments *a, V *outer) {
    for (int first = 0, count; first <= BOTH; first += count) {
        count = BOTH + 1 - first < LANES ? BOTH + 1 - first : LANES;
        memset(k->x, 0, BOTH * sizeof(V)), memset(k->mu, 0, BOTH * sizeof(V)), memset(k->of_y, 0, Y * sizeof(V));
        for (int l = 0; l < count; l++) {
            const int64_t d = first + l;
            const double size = d < BOTH ? lane_at(k->largest, d) : 0;
            if (d < BOTH) set_lane_at(&k->x[d], l, size);
            for (int i = 0; i < PAIRED; i++) {
                const double part = size > 0 ? lane_at(&k->products[i * ROWS], d) / size : 0;
                V *const to = i < BOTH ? &k->mu[i] : &k->of_y[i - BOTH];
                set_lane_at(to, l, d < BOTH ? part : lane_at(k->total, i));
                ((double *)k->total)[i] -= part;
            }
        }
        *k->t = splat(a->t[0]);
        solve(k), pull_back(k), add_pulled(a, 0, count, 0, k->pulled, outer);
    }
}

/* Whether all steps have the same derivatives by what is outside, and are more than `pull_products` takes. */
static int pull_alike(const SweepArguments *a) {
    int differ = NU || !a->smooth || a->steps <= 2 * BOTH;
    for (int i = 0; i < FE; i++) differ |= FE_COLUMN[i] == C + 1;
    for (int i = 0; i < GE; i++) differ |= GE_COLUMN[i] == C + 1;
    return !differ;
}

int adjoints(const SweepArguments *a) {
    BEGIN(a);
    Work *const k = work_space(C + 2);
    if (!k) return NO_MEMORY;
    V *const outer = k->more;
    const int together = pull_alike(a);
    int status = SWEPT;
    for (int64_t s = a->steps, some; s > 0;) {
        some = alike(a, s - 1, -1), s -= some;
        if (!prepare(k, a->c, a->h[s])) { status = NO_MEMORY; break; }
        if (!k->sound) { *a->failed = (double)s, status = NOT_REGULAR; break; }
        if (LOSS || !together) solve_steps(k, a, s, (int)some);
        if (LOSS) {
            const V *const q = k->x, *const p = q + N;
            V value;
            density(k->y, q, p, k->t, k->u, k->x, k->w + DENSITY_AT, &value, k->of_y, k->of_x, k->of_e);
            for (int l = 0; l < some; l++) *a->loss += lane_at(&value, l);
            for (int d = 0; d < BOTH; d++)
                for (int i = 0; i < Y; i++) k->of_x[d] = v_fma(splat(k->from_before[i * BOTH + d]), k->of_y[i], k->of_x[d]);
            add_pulled(a, s, (int)some, 0, k->of_e, outer);
        }
        carry_back(k, a, s, (int)some, a->tangent);
        if (together) add_products(k, a, s, (int)some);
        else pull_back(k), add_pulled(a, s, (int)some, 0, k->pulled, outer);
    }
    if (together && !status) pull_products(k, a, outer);
    for (int i = 0; i < C + 2; i++) a->outer[i] += sum(outer[i]);
    free(k);
    return status;
}
