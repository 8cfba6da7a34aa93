/* Second derivatives of a run: sum_k Z_k^T S_k'' Z_k of its steps, adjoints carried backwards along with it.

   S = mu . G(x, y, e) + eta . F(x, y, e) with eta = -F_y^-T G_y^T mu, Z = [dy; dx; de] of the tangents, dy = -F_y^-1 (F_x dx + F_e de)
   (forward over reverse: Griewank & Walther 2008, section 5.3).
   Defined before this file, besides what sweep.c needs: curved(y, q, p, t, u, part, mu, eta, w, S''), SS nonzeros of its upper
   triangle at SS_ROW, SS_COLUMN among (y, x, e). */
#include "sweep.c"

#define CURVED_AT SWEEP_W
#define ALL (Y + 2 * N + E) /* of y, x and e */

/* The tangents of (y, x, e) of a part, (ALL, m), from those of x that are there, and of what is outside. */
static void vary(Work *k, const SweepArguments *a, int64_t s, int r, double *z) {
    const int64_t m = a->columns;
    double *const of_e = z + (Y + 2 * N) * m;
    memcpy(of_e, a->outer, (C + 2) * m * sizeof(double));
    for (int64_t j = 0; j < m; j++) of_e[(C + 1) * m + j] += (double)(a->first + s) * a->outer[C * m + j];
    memset(of_e + (C + 2) * m, 0, NU * m * sizeof(double));
    for (int i = 0; i < NU && a->control_column >= 0; i++) {
        const int place = i + r * NU;
        const int64_t node = a->control_nodes == 1 ? 0 : place / CONTROLS;
        const int64_t at = a->control_column + ((a->first + s) * a->control_nodes + node) * CONTROLS + place % CONTROLS;
        of_e[(C + 2 + i) * m + at] = 1;
    }
    memset(z, 0, Y * m * sizeof(double));
    if (!Y) return;
    add_product(k->fx, FX_ROW, FX_COLUMN, FX, z + Y * m, m, z);
    add_product(k->fe, FE_ROW, FE_COLUMN, FE, of_e, m, z);
    solve_columns(k, m, z);
}

/* hessian += Z^T S'' Z, its lower triangle */
static void add_curvature(const double *curved, int64_t m, const double *z, double *turned, double *hessian) {
    memset(turned, 0, ALL * m * sizeof(double));
    for (int i = 0; i < SS; i++) {
        const int a = SS_ROW[i], b = SS_COLUMN[i];
        for (int64_t j = 0; j < m; j++) turned[a * m + j] = v_fma(curved[i], z[b * m + j], turned[a * m + j]);
        if (a != b)
            for (int64_t j = 0; j < m; j++) turned[b * m + j] = v_fma(curved[i], z[a * m + j], turned[b * m + j]);
    }
    for (int i = 0; i < ALL; i++)
        for (int64_t a = 0; a < m; a++) {
            const double x = z[i * m + a];
            if (x == 0) continue;
            for (int64_t b = 0; b <= a; b++) hessian[a * m + b] = v_fma(x, turned[i * m + b], hessian[a * m + b]);
        }
}

int curvatures(const SweepArguments *a) {
    BEGIN(a);
    const int64_t m = a->columns;
    Work *k = work_space(SWEEP_W + CURVED_W);
    double *const z = malloc((PARTS + 1) * ALL * m * sizeof(double)), *const turned = z + PARTS * ALL * m, *const mu = a->tangent;
    int status = k && z ? SWEPT : NO_MEMORY;
    for (int64_t s = a->steps - 1; s >= 0 && !status; s--) {
        double constants[C + 1];
        if (prepare(k, a->c, a->h[s], constants)) curved_prepare(constants, k->w + CURVED_AT);
        begin_parts(k, a, s);
        memcpy(z + Y * m, a->along + s * 2 * N * m, 2 * N * m * sizeof(double));
        for (int r = 0; r < PARTS; r++) {
            const double *const x = k->x + r * 2 * N, *const u = a->u + (s * PARTS + r) * NU, *const part = PART_TABLE + r * PART;
            double *const here = z + r * ALL * m, *const next = here + (ALL + Y) * m;
            if ((status = linearise(k, x, STATE_AT(a, s + 1), SPEED_AT(a, s), SPEED_AT(a, s + 1), a->t + s, u, part))) break;
            outside(k->y, x, x + N, a->t + s, u, part, k->w + OUTSIDE_AT, k->fe, k->ge);
            vary(k, a, s, r, here);
            if (r == PARTS - 1) break;
            memset(next, 0, 2 * N * m * sizeof(double));
            add_product(k->gx, GX_ROW, GX_COLUMN, GX, here + Y * m, m, next);
            add_product(k->ge, GE_ROW, GE_COLUMN, GE, here + (Y + 2 * N) * m, m, next);
            if (Y) add_product(k->gy, GY_ROW, GY_COLUMN, GY, here, m, next);
        }
        for (int r = PARTS - 1; r >= 0 && !status; r--) { /* factors are those of the last part: only one has any */
            const double *const x = k->x + r * 2 * N, *const u = a->u + (s * PARTS + r) * NU, *const part = PART_TABLE + r * PART;
            double eta[ROOM(Y)], before[2 * N], outer[E], curves[ROOM(SS)];
            memset(eta, 0, sizeof eta);
            if (Y) pull_back(k, mu, eta, before);
            else pull(k->y, x, x + N, a->t + s, u, part, mu, eta, k->w + PULL_AT, outer, before);
            curved(k->y, x, x + N, a->t + s, u, part, mu, eta, k->w + CURVED_AT, curves);
            add_curvature(curves, m, z + r * ALL * m, turned, a->hessian);
            memcpy(mu, before, sizeof before);
        }
        if (status) *a->failed = (double)s;
        else if (a->seeds) for (int i = 0; i < 2 * N; i++) mu[i] += a->seeds[s * 2 * N + i];
    }
    free(z), free(k);
    return status;
}
