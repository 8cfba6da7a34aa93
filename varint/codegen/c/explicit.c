/* Kick-drift compositions: p += h kick F(q, t, u), q += h drift M^-1 (p - d), with compensated sums.

   Defined before this file: N, NU, KICKS, the weights KICK, DRIFT and times NODE of the kicks, and the scene's functions.
   The last kick of a step and the first of the next are one addition; the momentum at a node is p plus the last kick. */

#ifdef SCENE_AS_DATA
#define UNROLL_SEQUENCE
#else
#define UNROLL_SEQUENCE _Pragma(UNROLLED)
#endif

/* What a run needs to go on as if it had not stopped: whether there is something, h, then q, p, their rests and the last
   force; p lacks the last kick of the step before, h pending force. */
#define CARRY_SIZE ((int64_t)(2 + 5 * N))
#ifdef SCENE_AS_DATA
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }
#else
const int64_t carry_size = CARRY_SIZE;
#endif
#if LONG_FORCE
static __attribute__((noinline)) void force_at(const double *q, const double *t, const double *u, const double *w, double *force) {
    rhs(q, t, u, w, force);
}
#else
#define force_at rhs
#endif
#define COPY(to, from) memcpy(to, from, (size_t)N * sizeof(double))

/* q, p, v of a node; not in line, so that a node is rounded alike wherever it is saved */
static __attribute__((noinline)) void save(double *row, const double *q, const double *p, const double *rest_p, double pending,
                                           const double *force, double t, const double *w) {
    double v[N];
    for (int d = 0; d < N; d++) row[d] = q[d], row[N + d] = p[d] + v_fma(pending, force[d], rest_p[d]);
    velocity(q, row + N, &t, w, v);
    for (int d = 0; d < N; d++) row[2 * N + d] = v[d];
}

int run(const RunArguments *a) {
#ifdef SCENE_AS_DATA
    scene = a->scene;
#endif
    const int64_t steps = a->steps, first = a->first;
    const double t0 = a->t0, h = a->h;
    const double *u = a->u;
    double *rows = a->rows, w[RHS_W + VELOCITY_W + 1], pending = 0, hk[KICKS], hd[KICKS];
    double q[N], p[N], rest_q[N], rest_p[N], force[N], *const carry = a->carry;
    rhs_prepare(a->c, w), velocity_prepare(a->c, w + RHS_W);
    const double *const node = w + RHS_W;
    for (int i = 0; i < KICKS; i++) hk[i] = h * KICK[i], hd[i] = i < KICKS - 1 ? h * DRIFT[i] : 0;
    if (carry[0] == 1 && carry[1] == h) {
        COPY(q, carry + 2), COPY(p, carry + 2 + N), COPY(rest_q, carry + 2 + 2 * N), COPY(rest_p, carry + 2 + 3 * N);
        COPY(force, carry + 2 + 4 * N);
        pending = hk[KICKS - 1];
    } else {
        double t = t0 + h * (double)first;
        COPY(q, a->start), COPY(p, a->start + N);
        for (int d = 0; d < N; d++) rest_q[d] = rest_p[d] = 0;
        force_at(q, &t, u, w, force);
    }
    save(rows, q, p, rest_p, pending, force, t0 + h * (double)first, node), rows += 3 * N;
    int status = DONE, ended = 0;
    int64_t done = 0, unsaved = 0;
    double last_q[N], last_p[N], last_f[N];
    while (done < steps && !ended) {
        const double t = t0 + h * (double)(first + done);
        for (int d = 0; d < N; d++) last_q[d] = q[d], last_p[d] = p[d], last_f[d] = force[d];
        if (NU) {
            double opening[N];
            force_at(q, &t, u, w, opening);
            for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], v_fma(pending, force[d], hk[0] * opening[d]));
        } else
            for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], (pending + hk[0]) * force[d]);
        UNROLL_SEQUENCE for (int i = 1; i < KICKS; i++) {
            double v[N], at = t + h * NODE[i];
            velocity(q, p, &at, node, v);
            for (int d = 0; d < N; d++) compensated(&q[d], &rest_q[d], hd[i - 1] * v[d]);
            force_at(q, &at, u + i * NU, w, force);
            if (i < KICKS - 1)
                for (int d = 0; d < N; d++) compensated(&p[d], &rest_p[d], hk[i] * force[d]);
        }
        u += KICKS * NU;
        double size = 0; /* not finite as soon as one of them is not */
        for (int d = 0; d < N; d++) size += q[d] * 0.0 + v_fma(hk[KICKS - 1], force[d], p[d]) * 0.0;
        if (!(size == 0)) { status = NOT_FINITE; break; }
        pending = hk[KICKS - 1];
        done++, ended = is_behind(q[N - 1], a->end);
        if (++unsaved == a->save_every) {
            unsaved = 0;
            save(rows, q, p, rest_p, pending, force, t0 + h * (double)(first + done), node), rows += 3 * N;
        }
    }
    if (status) COPY(q, last_q), COPY(p, last_p), COPY(force, last_f);
    save(a->stats->last, q, p, rest_p, pending, force, t0 + h * (double)(first + done), node);
    carry[0] = status ? 0 : 1, carry[1] = h;
    COPY(carry + 2, q), COPY(carry + 2 + N, p), COPY(carry + 2 + 2 * N, rest_q), COPY(carry + 2 + 3 * N, rest_p);
    COPY(carry + 2 + 4 * N, force);
    a->stats->status = status, a->stats->steps = (double)done;
    a->stats->iterations = a->stats->most_iterations = a->stats->residual = a->stats->failed = a->stats->contraction = 0;
    a->stats->noted = 0;
    return status;
}
