/* Slider, rod and crank as three free bodies (x, y, angle each) with eight joint constraints, by hand: RATTLE and lobatto(3),
   by Newton's method for the multipliers.

   Before this file: L1, L2, GRAVITY and MASSES (nine). A body b touches the rows 2b to 2b + 3, so that all matrices are bands. */
#include <math.h>
#define MAX(x, y) ((x) > (y) ? (x) : (y))
#include <string.h>

#define N 9
#define M 8
static const double mass[N] = {MASSES};

/* Rows: bearing and crank, crank and rod, rod and slider, guide of the slider, its turn. */
typedef struct { double g[M], rows[3][4][3], along[2][2]; } Joints;

static void joints(const double *q, Joints *j) {
    const double ax = L1 / 2 * cos(q[2]), ay = L1 / 2 * sin(q[2]), bx = L2 / 2 * cos(q[5]), by = L2 / 2 * sin(q[5]);
    const double g[M] = {q[0] - ax, q[1] - ay, q[0] + ax - q[3] + bx, q[1] + ay - q[4] + by, q[3] + bx - q[6], q[4] + by - q[7], q[7], q[8]};
    const double rows[3][4][3] = {{{1, 0, ay}, {0, 1, -ax}, {1, 0, -ay}, {0, 1, ax}},
                                  {{-1, 0, -by}, {0, -1, bx}, {1, 0, -by}, {0, 1, bx}},
                                  {{-1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, 1}}};
    memcpy(j->g, g, sizeof g), memcpy(j->rows, rows, sizeof rows);
    j->along[0][0] = ax, j->along[0][1] = ay, j->along[1][0] = bx, j->along[1][1] = by;
}

/* f = rows' multipliers */
static void pull(const Joints *j, const double *multipliers, double *f) {
    for (int b = 0; b < 3; b++)
        for (int d = 0; d < 3; d++) {
            double x = 0;
            for (int r = 0; r < 4; r++) x += j->rows[b][r][d] * multipliers[2 * b + r];
            f[3 * b + d] = x;
        }
}

/* y = rows v */
static void along(const Joints *j, const double *v, double *y) {
    memset(y, 0, M * sizeof *y);
    for (int b = 0; b < 3; b++)
        for (int r = 0; r < 4; r++)
            for (int d = 0; d < 3; d++) y[2 * b + r] += j->rows[b][r][d] * v[3 * b + d];
}

/* Solves a x = y, x in place of y, for a band of `wide` diagonals on either side; pivots stay on the diagonal. */
#define SOLVE(name, SIZE, wide)                                                                       \
    static void name(double a[SIZE][SIZE], double *y) {                                               \
        for (int k = 0; k < SIZE; k++) {                                                              \
            const double inverse = 1 / a[k][k];                                                       \
            const int end = k + wide + 1 < SIZE ? k + wide + 1 : SIZE;                                \
            for (int i = k + 1; i < end; i++) {                                                       \
                const double factor = a[i][k] * inverse;                                              \
                for (int j = k + 1; j < end; j++) a[i][j] -= factor * a[k][j];                        \
                y[i] -= factor * y[k];                                                                \
            }                                                                                         \
        }                                                                                             \
        for (int k = SIZE - 1; k >= 0; k--) {                                                         \
            const int end = k + wide + 1 < SIZE ? k + wide + 1 : SIZE;                                \
            for (int j = k + 1; j < end; j++) y[k] -= a[k][j] * y[j];                                 \
            y[k] /= a[k][k];                                                                          \
        }                                                                                             \
    }
SOLVE(solve_8, M, 3)
SOLVE(solve_16, (2 * M), 7)

/* a += factor one M^-1 other', the rows of one body after the other */
static void add_product(double a[M][M], const Joints *one, const Joints *other, double factor) {
    for (int b = 0; b < 3; b++)
        for (int r = 0; r < 4; r++) {
            double x[3];
            for (int d = 0; d < 3; d++) x[d] = factor * one->rows[b][r][d] / mass[3 * b + d];
            for (int s = 0; s < 4; s++)
                for (int d = 0; d < 3; d++) a[2 * b + r][2 * b + s] += x[d] * other->rows[b][s][d];
        }
}

/* p -= rows' m such that rows M^-1 p = 0 */
static void project(const Joints *j, double *p) {
    double a[M][M] = {{0}}, v[N], m[M], f[N];
    for (int d = 0; d < N; d++) v[d] = p[d] / mass[d];
    along(j, v, m), add_product(a, j, j, 1), solve_8(a, m), pull(j, m, f);
    for (int d = 0; d < N; d++) p[d] -= f[d];
}

static const double weight[N] = {0, -GRAVITY, 0, 0, -GRAVITY, 0, 0, -GRAVITY, 0};

/* Unknowns continued by the parabola through those of the last three steps, as many as there are. */
static void guess(double (*x)[25], int count, int known) {
    double next[25];
    for (int i = 0; i < count; i++)
        next[i] = known > 2 ? 3 * (x[0][i] - x[1][i]) + x[2][i] : known > 1 ? 2 * x[0][i] - x[1][i] : x[0][i];
    memcpy(x[2], x[1], sizeof x[0]), memcpy(x[1], x[0], sizeof x[0]), memcpy(x[0], next, sizeof next);
}

/* Iterations of a run of RATTLE, -1 where one does not converge. */
long rattle(double *q, double *p, double h, long steps) {
    Joints now, end;
    double x[3][25] = {{0}}, f[N], q1[N];
    long iterations = 0;
    joints(q, &now);
    for (long k = 0; k < steps; k++) {
        double *const y = x[0];
        guess(x, M, k < 3 ? (int)k : 3);
        for (int count = 0;; count++) {
            double a[M][M] = {{0}}, b[M], worst = 0, size = 0;
            if (count == 30) return -1;
            pull(&now, y, f);
            for (int d = 0; d < N; d++) q1[d] = q[d] + h * (p[d] + h / 2 * (mass[d] * weight[d] + f[d])) / mass[d];
            joints(q1, &end), memcpy(b, end.g, sizeof b);
            add_product(a, &end, &now, h * h / 2), solve_8(a, b), iterations++;
            for (int i = 0; i < M; i++) y[i] -= b[i], worst = MAX(worst, fabs(b[i])), size = MAX(size, fabs(y[i]));
            if (worst <= 1e-9 * size) break;
        }
        pull(&now, y, f);
        for (int d = 0; d < N; d++) {
            const double kicked = p[d] + h / 2 * (mass[d] * weight[d] + f[d]);
            q[d] += h * kicked / mass[d], p[d] = kicked + h / 2 * mass[d] * weight[d];
        }
        joints(q, &now), project(&now, p);
    }
    return iterations;
}

/* The same of lobatto(3): multipliers at the start and in the middle, where Q_m - q is unknown, too. */
long lobatto(double *q, double *p, double h, long steps) {
    Joints now, middle, end;
    double x[3][25] = {{0}}, f0[N], fm[N], qm[N], q1[N];
    long iterations = 0;
    joints(q, &now);
    for (int d = 0; d < N; d++) x[0][2 * M + d] = h / 2 * p[d] / mass[d];
    for (long k = 0; k < steps; k++) {
        double *const first = x[0], *const second = first + M, *const moved = first + 2 * M;
        guess(x, 2 * M + N, k < 3 ? (int)k : 3);
        for (int count = 0;; count++) {
            double a[2 * M][2 * M] = {{0}}, b[2 * M], left[N], bend[N] = {0}, c[M], e[M], worst = 0, size = 0;
            if (count == 30) return -1;
            for (int d = 0; d < N; d++) qm[d] = q[d] + moved[d];
            joints(qm, &middle), pull(&now, first, f0), pull(&middle, second, fm);
            for (int d = 0; d < N; d++) {
                const double fall = h * h * weight[d], by = h * h / mass[d];
                left[d] = moved[d] - h / 2 * p[d] / mass[d] - fall / 8 - by * (f0[d] / 12 + fm[d] / 24);
                q1[d] = q[d] + h * p[d] / mass[d] + fall / 2 + by * (f0[d] / 6 + fm[d] / 3);
            }
            joints(q1, &end);
            const double *const A = middle.along[0], *const B = middle.along[1], *const m = second;
            bend[2] = h * h / mass[2] * (A[0] * (m[0] - m[2]) + A[1] * (m[1] - m[3]));
            bend[5] = -h * h / mass[5] * (B[0] * (m[2] + m[4]) + B[1] * (m[3] + m[5]));
            /* of Q_m: (1 - bend/24) dQ_m = h^2 M^-1 (G0' d first/12 + Gm' d second/24) - left, put into the rows of both */
            double away[N], later[N];
            for (int d = 0; d < N; d++) away[d] = left[d] / (1 - bend[d] / 24), later[d] = bend[d] / 3 * away[d];
            along(&middle, away, c), along(&end, later, e);
            for (int o = 0; o < 3; o++)
                for (int r = 0; r < 4; r++) {
                    double x0[3], xm[3], y0[3], ym[3];
                    for (int d = 0; d < 3; d++) {
                        const double by = h * h / mass[3 * o + d], in = by / (1 - bend[3 * o + d] / 24);
                        x0[d] = middle.rows[o][r][d] * in / 12, xm[d] = x0[d] / 2;
                        y0[d] = end.rows[o][r][d] * (by / 6 + bend[3 * o + d] / 3 * in / 12);
                        ym[d] = end.rows[o][r][d] * (by / 3 + bend[3 * o + d] / 3 * in / 24);
                    }
                    const int row = 4 * o + 4 * (r / 2) + r % 2;
                    for (int s = 0; s < 4; s++) {
                        const int column = 4 * o + 4 * (s / 2) + s % 2;
                        for (int d = 0; d < 3; d++) {
                            const double g0 = now.rows[o][s][d], gm = middle.rows[o][s][d];
                            a[row][column] += x0[d] * g0, a[row][column + 2] += xm[d] * gm;
                            a[row + 2][column] += y0[d] * g0, a[row + 2][column + 2] += ym[d] * gm;
                        }
                    }
                }
            for (int r = 0; r < M; r++) b[4 * (r / 2) + r % 2] = middle.g[r] - c[r], b[4 * (r / 2) + r % 2 + 2] = end.g[r] - e[r];
            solve_16(a, b), iterations++;
            double d0[M], dm[M], p0[N], pm[N];
            for (int r = 0; r < M; r++) d0[r] = b[4 * (r / 2) + r % 2], dm[r] = b[4 * (r / 2) + r % 2 + 2];
            pull(&now, d0, p0), pull(&middle, dm, pm);
            for (int d = 0; d < N; d++)
                moved[d] -= away[d] + h * h / mass[d] * (p0[d] / 12 + pm[d] / 24) / (1 - bend[d] / 24);
            for (int r = 0; r < M; r++) {
                first[r] -= d0[r], second[r] -= dm[r];
                worst = MAX(worst, MAX(fabs(d0[r]), fabs(dm[r]))), size = MAX(size, MAX(fabs(first[r]), fabs(second[r])));
            }
            if (worst <= 1e-9 * size) break;
        }
        for (int d = 0; d < N; d++) qm[d] = q[d] + moved[d];
        joints(qm, &middle), pull(&now, first, f0), pull(&middle, second, fm);
        for (int d = 0; d < N; d++) {
            const double fall = mass[d] * weight[d];
            q[d] += h * (p[d] + h * (fall / 2 + f0[d] / 6 + fm[d] / 3)) / mass[d];
            p[d] += h * (fall + f0[d] / 6 + 2 * fm[d] / 3);
        }
        joints(q, &now), project(&now, p);
    }
    return iterations;
}
