/* DOP853 of Hairer, Norsett & Wanner I, II.5, with the step size control of SciPy's implementation (no dense output).

   Before this file: NY, ARGS, RESULTS, INTEGERS, WORK, the tables A (12 x 12), B, E3, E5 (12 each), and the generated right-hand side `rate`. */
#include <math.h>
#include <string.h>

static void slope(const double *y, const double *c, double *out) {
    static long long int integers[INTEGERS + 1];
    static double work[WORK + 1];
    const double *in[ARGS + 2] = {y, c};
    double *result[RESULTS + 1] = {out};
    rate(in, result, integers, work, 0);
}

static double norm(const double *x, const double *scale) {
    double s = 0;
    for (int i = 0; i < NY; i++) s += (x[i] / scale[i]) * (x[i] / scale[i]);
    return sqrt(s / NY);
}

/* integrates y over `duration` with the relative and absolute tolerance tol; the number of steps */
long long run(double *y, const double *c, double duration, double tol) {
    double k[13][NY], fresh[NY], scale[NY], t = 0, h;
    slope(y, c, k[0]);
    for (int i = 0; i < NY; i++) scale[i] = tol + tol * fabs(y[i]);
    double d0 = norm(y, scale), d1 = norm(k[0], scale), h0 = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1;
    for (int i = 0; i < NY; i++) fresh[i] = y[i] + h0 * k[0][i];
    slope(fresh, c, k[1]);
    double change[NY];
    for (int i = 0; i < NY; i++) change[i] = k[1][i] - k[0][i];
    double d2 = norm(change, scale) / h0, most = d1 > d2 ? d1 : d2;
    double h1 = most <= 1e-15 ? fmax(1e-6, 1e-3 * h0) : pow(0.01 / most, 1.0 / 8);
    h = fmin(fmin(100 * h0, h1), duration);
    long long steps = 0;
    int rejected = 0;
    while (t < duration) {
        if (t + h > duration) h = duration - t;
        for (int s = 1; s < 12; s++) {
            for (int i = 0; i < NY; i++) {
                double sum = 0;
                for (int j = 0; j < s; j++) sum += A[12 * s + j] * k[j][i];
                fresh[i] = y[i] + h * sum;
            }
            slope(fresh, c, k[s]);
        }
        double e5[NY], e3[NY];
        for (int i = 0; i < NY; i++) {
            double sum = 0, five = 0, three = 0;
            for (int j = 0; j < 12; j++) sum += B[j] * k[j][i], five += E5[j] * k[j][i], three += E3[j] * k[j][i];
            fresh[i] = y[i] + h * sum, e5[i] = five, e3[i] = three;
            scale[i] = tol + tol * fmax(fabs(y[i]), fabs(fresh[i]));
        }
        double five = 0, three = 0;
        for (int i = 0; i < NY; i++) {
            five += (e5[i] / scale[i]) * (e5[i] / scale[i]), three += (e3[i] / scale[i]) * (e3[i] / scale[i]);
        }
        double error = five == 0 && three == 0 ? 0 : fabs(h) * five / sqrt((five + 0.01 * three) * NY);
        double factor = error == 0 ? 10 : 0.9 * pow(error, -1.0 / 8);
        if (!(error < 1)) {
            h *= fmax(0.2, factor), rejected = 1;
            if (!(h > 1e-14 * duration)) return -1;
            continue;
        }
        t += h, steps++;
        memcpy(y, fresh, sizeof fresh);
        slope(y, c, k[0]);
        factor = fmin(10, factor);
        h *= rejected ? fmin(1, factor) : factor;
        rejected = 0;
    }
    return steps;
}
