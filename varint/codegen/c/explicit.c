/* Kick-drift compositions: p += h kick F(q, t, u), q += h drift M^-1 (p - d), with compensated sums.

   Defined before this file: N, NU, KICKS, the weights KICK, DRIFT and times NODE of the kicks, and the scene's functions.
   The last kick of a step and the first of the next are one addition; the momentum at a node is p plus the last kick. */

#define UNROLL_SEQUENCE _Pragma(UNROLLED)

/* What a run needs to go on as if it had not stopped: p lacks the last kick of the step before, h pending force. */
typedef struct { double started, h, q[N], p[N], rest_q[N], rest_p[N], force[N]; } Carry;
#define CARRY_SIZE (int64_t)(sizeof(Carry) / sizeof(double))
const int64_t carry_size = CARRY_SIZE;

/* q, p, v of a node; not in line, so that a node is rounded alike wherever it is saved */
static __attribute__((noinline)) void save(double *row, const double *q, const double *p, const double *rest_p, double pending,
                                           const double *force, double t, const double *w) {
    double v[N];
    for (int d = 0; d < N; d++) row[d] = q[d], row[N + d] = p[d] + (rest_p[d] + pending * force[d]);
    velocity(q, row + N, &t, w, v);
    for (int d = 0; d < N; d++) row[2 * N + d] = v[d];
}

int run(const RunArguments *a) {
    const int64_t steps = a->steps, first = a->first;
    const double t0 = a->t0, h = a->h;
    const double *u = a->u;
    double *rows = a->rows, w[RHS_W + VELOCITY_W + 1];
    double q[N], p[N], rest_q[N], rest_p[N], force[N], pending = 0, hk[KICKS], hd[KICKS];
    rhs_prepare(a->c, w), velocity_prepare(a->c, w + RHS_W);
    const double *const node = w + RHS_W;
    for (int i = 0; i < KICKS; i++) hk[i] = h * KICK[i], hd[i] = i < KICKS - 1 ? h * DRIFT[i] : 0;
    Carry *carry = (Carry *)a->carry;
    if (carry->started == 1 && carry->h == h) {
        memcpy(q, carry->q, sizeof q), memcpy(p, carry->p, sizeof p), memcpy(force, carry->force, sizeof force);
        memcpy(rest_q, carry->rest_q, sizeof q), memcpy(rest_p, carry->rest_p, sizeof p);
        pending = hk[KICKS - 1];
    } else {
        double t = t0 + h * (double)first;
        memcpy(q, a->start, sizeof q), memcpy(p, a->start + N, sizeof p);
        for (int d = 0; d < N; d++) rest_q[d] = rest_p[d] = 0;
        rhs(q, &t, u, w, force);
    }
    save(rows, q, p, rest_p, pending, force, t0 + h * (double)first, node), rows += 3 * N;
    int status = DONE;
    int64_t done = 0, unsaved = 0;
    double last_q[N], last_p[N], last_f[N];
    for (; done < steps; done++) {
        const double t = t0 + h * (double)(first + done);
        for (int d = 0; d < N; d++) last_q[d] = q[d], last_p[d] = p[d], last_f[d] = force[d];
#if NU
        double opening[N];
        rhs(q, &t, u, w, opening);
        for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], pending * force[d] + hk[0] * opening[d]);
#else
        for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], (pending + hk[0]) * force[d]);
#endif
        UNROLL_SEQUENCE for (int i = 1; i < KICKS; i++) {
            double v[N], at = t + h * NODE[i];
            velocity(q, p, &at, node, v);
            for (int d = 0; d < N; d++) compensated(&q[d], &rest_q[d], hd[i - 1] * v[d]);
            rhs(q, &at, u + i * NU, w, force);
            if (i < KICKS - 1)
                for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], hk[i] * force[d]);
        }
        u += KICKS * NU;
        double size = 0; /* not finite as soon as one of them is not */
        for (int d = 0; d < N; d++) size += q[d] * 0.0 + force[d] * 0.0;
        if (!(size == 0)) { status = NOT_FINITE; break; }
        pending = hk[KICKS - 1];
        if (++unsaved == a->save_every) {
            unsaved = 0;
            save(rows, q, p, rest_p, pending, force, t0 + h * (double)(first + done + 1), node), rows += 3 * N;
        }
    }
    if (status) memcpy(q, last_q, sizeof q), memcpy(p, last_p, sizeof p), memcpy(force, last_f, sizeof force);
    save(a->stats->last, q, p, rest_p, pending, force, t0 + h * (double)(first + done), node);
    carry->started = status ? 0 : 1, carry->h = h;
    memcpy(carry->q, q, sizeof q), memcpy(carry->p, p, sizeof p), memcpy(carry->force, force, sizeof force);
    memcpy(carry->rest_q, rest_q, sizeof q), memcpy(carry->rest_p, rest_p, sizeof p);
    a->stats->status = status, a->stats->steps = (double)done;
    a->stats->iterations = a->stats->most_iterations = a->stats->residual = a->stats->failed = a->stats->contraction = 0;
    a->stats->nearest = a->stats->farthest = a->stats->shrunk = 0;
    return status;
}
