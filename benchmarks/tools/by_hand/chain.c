/* A chain of N masses with springs whose force is d + A d^2 + B d^3, fixed at both ends, by hand.

   Before this file: N, A, B. */
#include <math.h>
#include <string.h>

static void force(const double *restrict q, double *restrict f) {
    double pull[N + 1];
    pull[0] = q[0] * (1 + q[0] * (A + B * q[0]));
    for (int i = 1; i < N; i++) {
        const double d = q[i] - q[i - 1];
        pull[i] = d * (1 + d * (A + B * d));
    }
    pull[N] = -q[N - 1] * (1 - q[N - 1] * (A - B * q[N - 1]));
    for (int i = 0; i < N; i++) f[i] = pull[i + 1] - pull[i];
}

/* Kicks and drifts; the last kick of a step and the first of the next are one. */
void composition(double *q, double *p, double h, long steps, long kicks, const double *kick, const double *drift) {
    double f[N];
    force(q, f);
    for (int d = 0; d < N; d++) p[d] += h * kick[0] * f[d];
    for (long k = 0; k < steps; k++)
        for (int i = 1; i < kicks; i++) {
            for (int d = 0; d < N; d++) q[d] += h * drift[i - 1] * p[d];
            force(q, f);
            const double weight = h * (kick[i] + (i == kicks - 1 && k < steps - 1 ? kick[0] : 0));
            for (int d = 0; d < N; d++) p[d] += weight * f[d];
        }
}

/* Gauss's rule of S stages by fixed-point iteration for the accelerations G_i at the stages,
   Q_i = q + c_i h p + h^2 sum_j AA_ij G_j, from those of the last two steps continued; an iteration ends where what contraction
   leaves is round-off, or the change has stopped shrinking there. The number of evaluations of all stages. */
#define S 4
long gauss(double *q, double *p, double h, long steps, const double *c, const double *AA, const double *b, const double *further) {
    double g[S][N] = {{0}}, older[S][N] = {{0}}, next[S][N], stage[N];
    double rate = 1;
    long evaluations = 0;
    for (long k = 0; k < steps; k++) {
        double before = 0;
        for (int i = 0; i < S; i++)
            for (int d = 0; d < N; d++) {
                double x = 0;
                for (int j = 0; j < S; j++) x += further[2 * i * S + j] * older[j][d] + further[(2 * i + 1) * S + j] * g[j][d];
                next[i][d] = x;
            }
        memcpy(older, g, sizeof g), memcpy(g, next, sizeof g);
        for (int most = 0; most < 60; most++) {
            double change = 0, size = 0;
            for (int i = 0; i < S; i++) {
                for (int d = 0; d < N; d++) {
                    double x = q[d] + c[i] * h * p[d];
                    for (int j = 0; j < S; j++) x += h * h * AA[i * S + j] * g[j][d];
                    stage[d] = x;
                }
                force(stage, next[i]);
            }
            for (int i = 0; i < S; i++)
                _Pragma("omp simd reduction(max : change, size)") for (int d = 0; d < N; d++) {
                    const double by = fabs(next[i][d] - g[i][d]), now = fabs(next[i][d]);
                    change = by > change ? by : change, size = now > size ? now : size;
                }
            memcpy(g, next, sizeof g);
            evaluations++;
            change /= size;
            if (before > 0) rate = change < 0.1 * before ? 0.1 : change < before ? change / before : 1;
            if (change * rate <= 0x1p-56 || change * change <= 0x1p-56 * before || (before > 0 && change >= before && change < 1e-14)) break;
            before = change;
        }
        for (int d = 0; d < N; d++) {
            double faster = 0, path = 0;
            for (int i = 0; i < S; i++) faster += b[i] * g[i][d], path += b[i] * (1 - c[i]) * g[i][d];
            q[d] += h * p[d] + h * h * path, p[d] += h * faster;
        }
    }
    return evaluations;
}
