/* Kick-drift compositions of many members at once, one in each lane; see explicit.c for the method.

   Defined before this file: N, NC, NU, KICKS, the weights KICK, DRIFT and times NODE of the kicks, and the scene's functions,
   whose parameters are inputs here: they differ from lane to lane. A member's arithmetic does not depend on its
   neighbours, but for functions outside their range (an angle above a million turns takes all lanes to the C library);
   groups begin at the same members whatever the chunks are, so that even this does not show. */

/* Controls of every lane at the kicks of step k */
INLINE void controls(const MembersArguments *a, const Group *g, int64_t k, V u[KICKS][NU + 1]) {
    (void)a, (void)g, (void)k;
    for (int l = 0; l < LANES; l++)
        for (int i = 0; i < KICKS; i++)
            for (int m = 0; m < NU; m++) set_lane(&u[i][m], l, a->u[g->at[l] * a->apart + (k * KICKS + i) * NU + m]);
}

static int64_t run_group(const MembersArguments *a, const Group *g) {
    V q[N], p[N], rest_q[N], rest_p[N], force[N], c[NC + 1];
    double none[1] = {0};
    load(a->q0, N, g, q), load(a->p0, N, g, p), load(a->c, NC, g, c);
    for (int d = 0; d < N; d++) rest_q[d] = rest_p[d] = splat(0.0);
    int going[LANES], alive = g->count;
    for (int l = 0; l < LANES; l++) going[l] = l < g->count;
    const double h = a->h;
    double hk[KICKS], hd[KICKS], pending = 0;
    for (int i = 0; i < KICKS; i++) hk[i] = h * KICK[i], hd[i] = i < KICKS - 1 ? h * DRIFT[i] : 0;
    V t = splat(a->t0), u[KICKS][NU + 1];
    controls(a, g, 0, u);
    rhs(q, &t, u[0], c, none, force);
    int64_t row = 1, unsaved = 0;
    for (int64_t k = 0; k < a->steps && alive; k++) {
        const double now = a->t0 + h * (double)k;
#if NU
        controls(a, g, k, u);
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
        for (int l = 0; l < g->count; l++) {
            if (!going[l]) continue;
            if (lane(size, l) == 0) save(a, g->at[l], l, row, q, node);
            else going[l] = 0, alive--;
        }
        row++;
    }
    return g->count - alive;
}
