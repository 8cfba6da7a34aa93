/* A ball of mass 1 on a spring of length 1 from the origin, above a slope that it bounces on, by hand: lobatto(3).

   Before this file: GRAVITY, STIFFNESS, SLOPE, FLOOR (the slope is y = FLOOR + SLOPE x), RESTITUTION. */
#include <math.h>
#define MIN(x, y) ((x) < (y) ? (x) : (y))

typedef struct { double q[2], p[2]; } State;

static void force(const double *q, double *f) {
    const double r = sqrt(q[0] * q[0] + q[1] * q[1]), pull = STIFFNESS * (1 / r - 1);
    f[0] = pull * q[0], f[1] = pull * q[1] - GRAVITY;
}

/* The force and the entries xx, xy, yy of 1 - w dF/dq. */
static void slope(const double *q, double w, double *f, double *m) {
    const double s = q[0] * q[0] + q[1] * q[1], r = sqrt(s), pull = STIFFNESS * (1 / r - 1), bend = STIFFNESS / (r * s);
    f[0] = pull * q[0], f[1] = pull * q[1] - GRAVITY;
    m[0] = 1 - w * (pull - bend * q[0] * q[0]), m[1] = w * bend * q[0] * q[1], m[2] = 1 - w * (pull - bend * q[1] * q[1]);
}

/* Q_m = q + h p/2 + h^2 (F_0/12 + F_m/24) by Newton's method, then q += h p + h^2 (F_0/6 + F_m/3) and
   p += h (F_0 + 4 F_m + F_1)/6. */
static int step(const State *from, const double *f0, double h, State *to, double *f1) {
    const double w = h * h / 24, moved = fabs(h) * (fabs(from->p[0]) + fabs(from->p[1]));
    double m[2], base[2], fm[2], j[3];
    for (int d = 0; d < 2; d++) base[d] = from->q[d] + h * (0.5 * from->p[d] + h * f0[d] / 12), m[d] = base[d] + w * f0[d];
    for (int count = 0; count < 30; count++) {
        slope(m, w, fm, j);
        const double a = m[0] - base[0] - w * fm[0], b = m[1] - base[1] - w * fm[1], det = 1 / (j[0] * j[2] - j[1] * j[1]);
        const double x = (j[2] * a - j[1] * b) * det, y = (j[0] * b - j[1] * a) * det;
        m[0] -= x, m[1] -= y;
        if (fabs(x) + fabs(y) <= 1e-9 * (moved + 1e-2)) { /* applied, what is left is its square */
            force(m, fm);
            for (int d = 0; d < 2; d++) to->q[d] = from->q[d] + h * (from->p[d] + h * (f0[d] + 2 * fm[d]) / 6);
            force(to->q, f1);
            for (int d = 0; d < 2; d++) to->p[d] = from->p[d] + h * (f0[d] + 4 * fm[d] + f1[d]) / 6;
            return 1;
        }
    }
    return 0;
}

static double gap(const State *s) { return s->q[1] - FLOOR - SLOPE * s->q[0]; }
static double rate(const State *s) { return s->p[1] - SLOPE * s->p[0]; }

/* Can the gap close between two states, h apart? The cubic through gaps and rates at both ends: below the smallest of
   Bezier's four numbers it does not go. */
static int may_close(const State *a, const State *b, double h) {
    const double x = gap(a), y = gap(b);
    return MIN(x + h * rate(a) / 3, y - h * rate(b) / 3) < 0 || y < 0;
}

/* The impacts of a run of so many steps; each is located by whole steps of the rule, by Newton's method held in a bracket. */
long run(double *state, double h, long steps) {
    State now = {{state[0], state[1]}, {state[2], state[3]}}, end;
    double f[2], f1[2];
    long hits = 0;
    force(now.q, f);
    for (long k = 0; k < steps; k++) {
        double left = h;
        for (;;) {
            if (!step(&now, f, left, &end, f1)) return -1;
            if (!may_close(&now, &end, left)) break;
            double lower = 0, upper = left, at = left;
            if (gap(&end) >= 0) { /* the middle tells whether it dips below */
                double lowest = INFINITY;
                for (int i = 1; i < 16; i++) {
                    if (!step(&now, f, left * i / 16, &end, f1)) return -1;
                    if (gap(&end) < lowest) lowest = gap(&end), upper = at = left * i / 16;
                }
                if (lowest >= 0) {
                    step(&now, f, left, &end, f1);
                    break;
                }
            }
            if (rate(&now) > 0) lower = 1e-12 * left; /* it has just bounced */
            for (int count = 0; count < 100; count++) {
                if (!step(&now, f, at, &end, f1)) return -1;
                const double g = gap(&end), r = rate(&end);
                if (fabs(g) <= fabs(r) * 1e-14 * left) break;
                if (g < 0) upper = at;
                else lower = at;
                at -= g / r;
                if (!(at > lower && at < upper)) at = 0.5 * (lower + upper);
                if (upper - lower <= 1e-15 * left) break;
            }
            const double blow = (1 + RESTITUTION) * rate(&end) / (1 + SLOPE * SLOPE);
            end.p[1] -= blow, end.p[0] += SLOPE * blow;
            now = end, left -= at, f[0] = f1[0], f[1] = f1[1], hits++;
        }
        now = end, f[0] = f1[0], f[1] = f1[1];
    }
    for (int d = 0; d < 2; d++) state[d] = now.q[d], state[2 + d] = now.p[d];
    return hits;
}
