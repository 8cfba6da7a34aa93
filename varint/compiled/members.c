/* Kick-drift compositions of many members at once, one in each lane; see explicit.c for the method.

   Defined before this file: N, NC, NU, KICKS, the weights KICK, DRIFT and times NODE of the kicks, and the scene's functions,
   whose parameters are inputs here: they differ from lane to lane. A member's arithmetic does not depend on its
   neighbours, but for functions outside their range (an angle above a million turns takes all lanes to the C library);
   groups begin at the same members whatever the chunks are, so that even this does not show. */

typedef struct {
    int64_t members, steps, save_every, nodes; /* nodes: rows of a member, its start included */
    int64_t apart;                             /* numbers between the controls of two members: 0 where all have the same */
    double t0, h;
    const double *q0, *p0, *c, *u; /* (members, N), (members, N), (members, NC), (members or 1, steps, KICKS, NU) */
    double *q, *p;             /* (members, nodes, N); row 0 is not written */
    int64_t *good;             /* (members): rows that are finite, the start included */
} Args;
const int64_t lanes = LANES;

/* Controls of every lane at the kicks of step k */
INLINE void controls(const Args *a, const int64_t *at, int64_t k, V u[KICKS][NU + 1]) {
    (void)a, (void)at, (void)k;
    for (int l = 0; l < LANES; l++)
        for (int i = 0; i < KICKS; i++)
            for (int m = 0; m < NU; m++) set_lane(&u[i][m], l, a->u[at[l] * a->apart + (k * KICKS + i) * NU + m]);
}

static int64_t group(const Args *a, int64_t first) {
    V q[N], p[N], rest_q[N], rest_p[N], force[N], c[NC + 1];
    double none[1] = {0};
    int64_t at[LANES], alive = 0;
    for (int l = 0; l < LANES; l++) {
        at[l] = first + l < a->members ? first + l : a->members - 1;
        for (int d = 0; d < N; d++) set_lane(&q[d], l, a->q0[at[l] * N + d]), set_lane(&p[d], l, a->p0[at[l] * N + d]);
        for (int d = 0; d < NC; d++) set_lane(&c[d], l, a->c[at[l] * NC + d]);
    }
    for (int d = 0; d < N; d++) rest_q[d] = rest_p[d] = splat(0.0);
    const int count = a->members - first < LANES ? (int)(a->members - first) : LANES;
    int going[LANES];
    for (int l = 0; l < count; l++) going[l] = 1, a->good[first + l] = 1;
    alive = count;
    const double h = a->h;
    double hk[KICKS], hd[KICKS], pending = 0;
    for (int i = 0; i < KICKS; i++) hk[i] = h * KICK[i], hd[i] = i < KICKS - 1 ? h * DRIFT[i] : 0;
    V t = splat(a->t0), u[KICKS][NU + 1];
    controls(a, at, 0, u);
    rhs(q, &t, u[0], c, none, force);
    int64_t row = 1, unsaved = 0;
    for (int64_t k = 0; k < a->steps && alive; k++) {
        const double now = a->t0 + h * (double)k;
#if NU
        controls(a, at, k, u);
        V opening[N], begin = splat(now);
        rhs(q, &begin, u[0], c, none, opening);
        for (int d = 0; d < N; d++) v_compensated(&p[d], &rest_p[d], pending * force[d] + hk[0] * opening[d]);
#else
        for (int d = 0; d < N; d++) v_compensated(&p[d], &rest_p[d], (pending + hk[0]) * force[d]);
#endif
        for (int i = 1; i < KICKS; i++) {
            V v[N], moment = splat(now + h * NODE[i]);
            velocity(q, p, &moment, c, none, v);
            for (int d = 0; d < N; d++) v_compensated(&q[d], &rest_q[d], hd[i - 1] * v[d]);
            rhs(q, &moment, u[i], c, none, force);
            if (i < KICKS - 1)
                for (int d = 0; d < N; d++) v_compensated(&p[d], &rest_p[d], hk[i] * force[d]);
        }
        pending = hk[KICKS - 1];
        if (++unsaved < a->save_every && k + 1 < a->steps) continue;
        unsaved = 0;
        V node[N], size = splat(0.0);
        for (int d = 0; d < N; d++) {
            node[d] = p[d] + (rest_p[d] + pending * force[d]);
            size += q[d] * 0.0 + node[d] * 0.0; /* not zero as soon as one of them is not finite */
        }
        for (int l = 0; l < count; l++) {
            if (!going[l]) continue;
            if (lane(size, l) != 0) { going[l] = 0, alive--; continue; }
            double *to_q = a->q + (at[l] * a->nodes + row) * N, *to_p = a->p + (at[l] * a->nodes + row) * N;
            for (int d = 0; d < N; d++) to_q[d] = lane(q[d], l), to_p[d] = lane(node[d], l);
            a->good[at[l]] = row + 1;
        }
        row++;
    }
    return count - alive;
}

int run(const Args *a) {
    int64_t failed = 0;
    for (int64_t first = 0; first < a->members; first += LANES) failed += group(a, first);
    return failed > 0;
}
