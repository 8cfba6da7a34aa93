/* Derivatives of a run from its nodes: tangents forwards, adjoints backwards, step by step.

   A step, or each of its PARTS, takes x = (q, p) to G(x, y, e) where F(x, y, e) = 0, e = (parameters, step, time, controls).
   Defined before this file, by generated source or by sweep_scene.h: N, NU (controls of a part at CONTROLS a node), PARTS
   with PART numbers each in PART_TABLE, Y (unknowns), the first N POINTS of them mean velocities with start values from
   HERMITE, the last ENDS those of the end of the step, its velocity first; C (parameters), E = C + 2 + NU; the band of F_y
   (PERM, AT, BELOW, REACH, BAND_SIZE) and the places of the nonzeros of the derivatives (FY_ROW, FY_COLUMN, …).
   blocks(y, q, p, t, u, part, w, F, F_y, F_x, G_y, G_x); outside(…, F_e, G_e); pull(…, mu, eta, w, G_e^T mu + F_e^T eta, and
   without unknowns G_x^T mu, shorter than G_x); after(…, G) where there are parts; density(…, loss, its slopes) where LOSS. */
#include "band.h"
#include "sweep.h"
#include "outside.h"

#define BLOCKS_AT 0
#define OUTSIDE_AT (BLOCKS_AT + BLOCKS_W)
#define PULL_AT (OUTSIDE_AT + OUTSIDE_W)
#define AFTER_AT (PULL_AT + PULL_W)
#define DENSITY_AT (AFTER_AT + AFTER_W)
#define SWEEP_W (DENSITY_AT + DENSITY_W)
#define SHRINKS 0.1 /* corrections by kept factors do by at least so much; near round-off none does */

/* Work space: the unknowns, derivatives of a part, the factors of F_y, where every part begins. */
typedef struct {
    double *y, *f, *fy, *fx, *gy, *gx, *fe, *ge, *row, *b, *matrix, *x, *w, h;
    double *factored; /* the F_y that the factors are of */
    int *pivots, prepared, sound;
} Work;

/* Room for `w` numbers of the functions; it is freed as it is. */
static Work *work_space(int64_t w) {
    const int64_t sizes[] = {ROOM(Y), ROOM(Y), ROOM(FY), ROOM(FX), ROOM(GY), ROOM(GX), ROOM(FE), ROOM(GE), ROOM(Y),
                             Y + REACH + 1, BAND_SIZE + 1, PARTS * 2 * N, w + 1, ROOM(FY)};
    int64_t all = ROOM(Y) + sizeof(Work) / sizeof(double) + 1;
    for (int i = 0; i < 14; i++) all += sizes[i];
    double *at = calloc(all, sizeof(double));
    Work *const k = (Work *)at;
    if (!k) return 0;
    double **const places[] = {&k->y, &k->f, &k->fy, &k->fx, &k->gy, &k->gx, &k->fe, &k->ge, &k->row, &k->b, &k->matrix,
                               &k->x, &k->w, &k->factored};
    at += sizeof(Work) / sizeof(double) + 1;
    for (int i = 0; i < 14; i++) *places[i] = at, at += sizes[i];
    k->pivots = (int *)at;
    return k;
}

/* Whether what is the same as long as the step has one size had to be computed; `constants` are it. */
static int prepare(Work *k, const double *c, double h, double *constants) {
    if (k->prepared && k->h == h) return 0;
    memcpy(constants, c, C * sizeof(double)), constants[C] = h;
    blocks_prepare(constants, k->w + BLOCKS_AT), outside_prepare(constants, k->w + OUTSIDE_AT);
    pull_prepare(constants, k->w + PULL_AT), after_prepare(constants, k->w + AFTER_AT);
    density_prepare(constants, k->w + DENSITY_AT);
    k->h = h, k->prepared = 1;
    return 1;
}

/* Those of a linear scene stay as they are from step to step. */
static int factors(Work *k) {
    if (k->sound && !memcmp(k->fy, k->factored, FY * sizeof(double))) return 1;
    for (int i = 0; i < Y; i++) k->row[i] = 0;
    for (int i = 0; i < FY; i++) k->row[FY_ROW[i]] = fmax(k->row[FY_ROW[i]], fabs(k->fy[i]));
    for (int i = 0; i < Y; i++) k->row[i] = 1 / k->row[i];
    memset(k->matrix, 0, BAND_SIZE * sizeof(double));
    for (int i = 0; i < FY; i++) k->matrix[AT[i]] = k->fy[i] * k->row[FY_ROW[i]];
    factorise(Y, BELOW, REACH, k->matrix, k->pivots);
    memcpy(k->factored, k->fy, FY * sizeof(double));
    return k->sound = !unsound(k->matrix, BAND_SIZE);
}

/* f := F_y^-1 f */
static void solve(Work *k, double *f) {
    for (int i = 0; i < Y; i++) k->b[i] = f[PERM[i]] * k->row[PERM[i]];
    for (int i = Y; i < Y + REACH; i++) k->b[i] = 0;
    substitute(Y, BELOW, REACH, k->matrix, k->pivots, k->b);
    for (int i = 0; i < Y; i++) f[PERM[i]] = k->b[i];
}

/* g := F_y^-T g */
static void solve_transposed(Work *k, double *g) {
    for (int i = 0; i < Y; i++) k->b[i] = g[PERM[i]];
    substitute_transposed(Y, BELOW, REACH, k->matrix, k->pivots, k->b);
    for (int i = 0; i < Y; i++) g[PERM[i]] = k->b[i] * k->row[PERM[i]];
}

/* The derivatives of a part at its solution, F_y factorised. The unknowns are found from both ends of the step by Newton's
   method, those that the ends do not tell from the neighbouring step's. Factors are kept while they make corrections shrink;
   `blocks` comes once more at the solution, where the derivatives are to be taken. */
static int linearise(Work *k, const double *x, const double *x1, const double *v, const double *v1, const double *t,
                     const double *u, const double *part) {
    if (!Y) { /* for tangents alone */
        blocks(k->y, x, x + N, t, u, part, k->w + BLOCKS_AT, k->f, k->fy, k->fx, k->gy, k->gx);
        return SWEPT;
    }
    double size[ROOM(N)], most = 0, far = 0, before = INFINITY;
    for (int i = 0; i < N; i++) {
        const double mean = (x1[i] - x[i]) / k->h;
        size[i] = fabs(mean) + fabs(v[i]) + fabs(v1[i]), most = fmax(most, size[i]), far = fmax(far, fabs(x[i]));
        for (int j = 0; j < POINTS; j++)
            k->y[j * N + i] = v_fma(HERMITE[3 * j], mean, v_fma(HERMITE[3 * j + 1], v[i], HERMITE[3 * j + 2] * v1[i]));
    }
    far *= ROUNDABLE / fabs(k->h); /* the speed that no step can tell from rest, many times over */
    for (int i = 0; i < N; i++) size[i] = fmax(size[i], LEAST_SPEED * most) + far + 1e-300;
    if (ENDS) memcpy(k->y + Y - ENDS, v1, N * sizeof(double));
    for (int count = 0, fresh = 0; count < MOST_ITERATIONS; count++) {
        blocks(k->y, x, x + N, t, u, part, k->w + BLOCKS_AT, k->f, k->fy, k->fx, k->gy, k->gx);
        if (unsound(k->fy, FY) || unsound(k->f, Y)) return NO_NUMBERS;
        if (!fresh && !factors(k)) return NOT_REGULAR;
        if (!count) { /* what forces alone would make of a body at rest, which may be held */
            double kick = 0;
            for (int i = 0; i < N * POINTS; i++) kick = fmax(kick, fabs(k->f[i]) * k->row[i]);
            for (int i = 0; i < N; i++) size[i] = 1 / (size[i] + kick);
        }
        double worst = 0;
        solve(k, k->f);
        for (int i = 0; i < N * POINTS; i++) {
            const double change = fabs(k->f[i]) * size[i % N];
            worst = change > worst || change != change ? change : worst;
        }
        if (!(worst < INFINITY)) return NOT_SOLVED;
        const int settled = before <= LAST_CORRECTION && worst > SHRINKS * before;
        const int told = count > 0 || Y == N * POINTS; /* the ends tell velocities, not multipliers */
        if (told && (worst <= ROUNDED || settled)) return !fresh || factors(k) ? SWEPT : NOT_REGULAR;
        for (int i = 0; i < Y; i++) k->y[i] -= k->f[i];
        fresh = worst < SHRINKS * before, before = worst;
    }
    return NOT_SOLVED;
}

/* The columns of `right` (Y, m) := -F_y^-1 right */
static void solve_columns(Work *k, int64_t m, double *right) {
    for (int64_t j = 0; j < m; j++) {
        for (int i = 0; i < Y; i++) k->f[i] = -right[i * m + j];
        solve(k, k->f);
        for (int i = 0; i < Y; i++) right[i * m + j] = k->f[i];
    }
}

/* Where every part of step s begins. */
static void begin_parts(Work *k, const SweepArguments *a, int64_t s) {
    memcpy(k->x, STATE_AT(a, s), 2 * N * sizeof(double));
    for (int r = 0; r < PARTS - 1; r++) {
        const double *const x = k->x + r * 2 * N;
        after(k->y, x, x + N, a->t + s, a->u + (s * PARTS + r) * NU, PART_TABLE + r * PART, k->w + AFTER_AT, k->x + (r + 1) * 2 * N);
    }
}

/* eta = -F_y^-T (G_y^T mu + eta) and `before` = G_x^T mu + F_x^T eta */
static void pull_back(Work *k, const double *mu, double *eta, double *before) {
    memset(before, 0, 2 * N * sizeof(double));
    for (int i = 0; i < GY; i++) eta[GY_COLUMN[i]] = v_fma(k->gy[i], mu[GY_ROW[i]], eta[GY_COLUMN[i]]);
    solve_transposed(k, eta);
    for (int i = 0; i < Y; i++) eta[i] = -eta[i];
    for (int i = 0; i < FX; i++) before[FX_COLUMN[i]] = v_fma(k->fx[i], eta[FX_ROW[i]], before[FX_COLUMN[i]]);
    for (int i = 0; i < GX; i++) before[GX_COLUMN[i]] = v_fma(k->gx[i], mu[GX_ROW[i]], before[GX_COLUMN[i]]);
}

int tangents(const SweepArguments *a) {
    const int64_t m = a->columns;
    const int outer = a->outer_moves || a->control_column >= 0;
    BEGIN(a);
    Work *k = work_space(SWEEP_W);
    double constants[C + 1], *const next = malloc((2 * N + ROOM(Y)) * m * sizeof(double)), *const dt = malloc(m * sizeof(double));
    double *const dy = next + 2 * N * m, *out = a->out;
    int status = k && next && dt ? SWEPT : NO_MEMORY;
    if (!status && a->every) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    for (int64_t s = 0; s < a->steps && !status; s++) {
        prepare(k, a->c, a->h[s], constants);
        memcpy(k->x, STATE_AT(a, s), 2 * N * sizeof(double));
        for (int64_t j = 0; j < m; j++) dt[j] = a->outer[(C + 1) * m + j] + (double)(a->first + s) * a->outer[C * m + j];
        for (int r = 0; r < PARTS; r++) {
            const double *const x = k->x + r * 2 * N, *const u = a->u + (s * PARTS + r) * NU, *const part = PART_TABLE + r * PART;
            if ((status = linearise(k, x, STATE_AT(a, s + 1), SPEED_AT(a, s), SPEED_AT(a, s + 1), a->t + s, u, part))) break;
            memset(next, 0, (2 * N + ROOM(Y)) * m * sizeof(double));
            if (outer) {
                outside(k->y, x, x + N, a->t + s, u, part, k->w + OUTSIDE_AT, k->fe, k->ge);
                add_outside(a, s, r, dt, k->fe, 1, FE_ROW, FE_COLUMN, FE, dy);
                add_outside(a, s, r, dt, k->ge, 1, GE_ROW, GE_COLUMN, GE, next);
            }
            if (Y) {
                add_product(k->fx, FX_ROW, FX_COLUMN, FX, a->tangent, m, dy);
                solve_columns(k, m, dy);
                add_product(k->gy, GY_ROW, GY_COLUMN, GY, dy, m, next);
            }
            add_product(k->gx, GX_ROW, GX_COLUMN, GX, a->tangent, m, next);
            memcpy(a->tangent, next, 2 * N * m * sizeof(double));
            if (r < PARTS - 1) after(k->y, x, x + N, a->t + s, u, part, k->w + AFTER_AT, k->x + (r + 1) * 2 * N);
        }
        if (status) *a->failed = (double)s;
        else if (a->every && (s + 1) % a->every == 0) memcpy(out, a->tangent, 2 * N * m * sizeof(double)), out += 2 * N * m;
    }
    free(dt), free(next), free(k);
    return status;
}

int adjoints(const SweepArguments *a) {
    BEGIN(a);
    Work *k = work_space(SWEEP_W);
    double *const mu = a->tangent;
    int status = k ? SWEPT : NO_MEMORY;
    for (int64_t s = a->steps - 1; s >= 0 && !status; s--) {
        double constants[C + 1];
        prepare(k, a->c, a->h[s], constants);
        begin_parts(k, a, s);
        for (int r = PARTS - 1; r >= 0; r--) {
            const double *const x = k->x + r * 2 * N, *const u = a->u + (s * PARTS + r) * NU, *const part = PART_TABLE + r * PART;
            double eta[ROOM(Y)], before[2 * N], outer[E], value, of_x[2 * N], of_e[E];
            memset(eta, 0, sizeof eta);
            if (Y && (status = linearise(k, x, STATE_AT(a, s + 1), SPEED_AT(a, s), SPEED_AT(a, s + 1), a->t + s, u, part))) break;
            if (LOSS) density(k->y, x, x + N, a->t + s, u, part, k->w + DENSITY_AT, &value, eta, of_x, of_e), *a->loss += value;
            if (Y) pull_back(k, mu, eta, before);
            pull(k->y, x, x + N, a->t + s, u, part, mu, eta, k->w + PULL_AT, outer, before);
            if (LOSS) {
                for (int i = 0; i < 2 * N; i++) before[i] += of_x[i];
                for (int i = 0; i < E; i++) outer[i] += of_e[i];
            }
            for (int i = 0; i < C + 2; i++) a->outer[i] += outer[i];
            a->outer[C] += (double)(a->first + s) * outer[C + 1];
            for (int i = 0; i < NU; i++) {
                const int place = i + r * NU;
                const int64_t node = a->control_nodes == 1 ? 0 : place / CONTROLS;
                a->out[(s * a->control_nodes + node) * CONTROLS + place % CONTROLS] += outer[C + 2 + i];
            }
            memcpy(mu, before, sizeof before);
        }
        if (status) *a->failed = (double)s;
        else if (a->seeds) for (int i = 0; i < 2 * N; i++) mu[i] += a->seeds[s * 2 * N + i];
    }
    free(k);
    return status;
}
