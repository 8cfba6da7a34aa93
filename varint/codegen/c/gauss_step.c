/* The iteration of a step by a Gauss rule, as gauss.h has it, with the scene's functions in line. */

#if HALVES
INLINE void rhs_prepare(const double *c, double *w) {
    kick_prepare(c, w), drift_prepare(c, w + KICK_W), inertia_prepare(c, w + KICK_W + DRIFT_W);
}
#endif
INLINE void prepare(const double *c, double *w) {
    rhs_prepare(c, w), velocity_prepare(c, w + RHS_W), momentum_prepare(c, w + RHS_W + VELOCITY_W);
}

#if HALVES
/* fresh = h b V for the speeds V that the step's momenta ask for, improved from speeds that had other ones. */
LARGE void improve_speeds(const Step *s, const Nodes *at, double h, const double *w, V had[MOST_N][VECTORS],
                          V (*taken)[VECTORS], V speeds[MOST_N][VECTORS], Unknowns fresh) {
    V rates[MOST_N][VECTORS];
    EACH for (int d = 0; d < N; d++) {
        V missed[VECTORS];
        for (int k = 0; k < VECTORS; k++) missed[k] = s->p[d][k] - had[d][k], rates[d][k] = splat(0.0);
        add_product(STAGE_INVERSE, missed, rates[d]);
    }
    for (int k = 0; k < VECTORS; k++) drift(&rates[0][k], &taken[0][k], w, &fresh[0][k]);
    EACH for (int d = 0; d < N; d++) {
        for (int k = 0; k < VECTORS; k++) fresh[d][k] *= at->b[k] * (1 / h);
        add_product(STAGE_M1, fresh[d], speeds[d]);
        for (int k = 0; k < VECTORS; k++) fresh[d][k] = speeds[d][k] * at->b[k];
    }
}
#endif

/* fresh = h b (right-hand side at the stages), which s->x has made. With FORM 2 another h: the unknowns are lengths. In halves
   the step's momenta are those of s->x and become those of fresh; in Gauss-Seidel order, before the velocities are made of
   them. */
INLINE void respond(Step *s, const Nodes *at, double h, const double *w, V first[MOST_N][VECTORS],
                   V second[MOST_N][VECTORS], int seidel, Unknowns fresh) {
#if HALVES
    V had[MOST_N][VECTORS];
#ifdef LOOP_APART
    V own[BY_DEFECT ? 1 : TAKEN + 1][VECTORS], (*const taken)[VECTORS] = BY_DEFECT ? s->taken : own; /* of an evaluation alone */
#else
    V(*const taken)[VECTORS] = s->taken;
#endif
    if (BY_DEFECT && s->renewals-- > 0)
        for (int k = 0; k < VECTORS; k++) inertia(&first[0][k], &second[0][k], &s->t[k], w + KICK_W + DRIFT_W, &taken[0][k]);
    for (int k = 0; k < VECTORS; k++) {
        KICK(&first[0][k], BY_DEFECT ? &second[0][k] : &s->p[0][k], &s->t[k], &at->u[0][k], w, &fresh[N][k], &had[0][k],
             &taken[0][k]);
        for (int d = 0; d < N; d++) fresh[N + d][k] *= at->b[k];
    }
    if (BY_DEFECT) {
        set_momenta(s, STAGE_M1, fresh, 0, 0);
        improve_speeds(s, at, h, w + KICK_W, had, taken, second, fresh);
        return;
    }
    if (seidel) set_momenta(s, STAGE_M1, fresh, 0, 0);
    for (int k = 0; k < VECTORS; k++) {
        drift(&s->p[0][k], &taken[0][k], w + KICK_W, &fresh[0][k]);
        for (int d = 0; d < N; d++) fresh[d][k] *= at->b[k];
    }
    if (!seidel) set_momenta(s, STAGE_M1, fresh, 0, 0);
#else
#if DENSE
    renew(&first[0][0], &s->t[0], w, &s->renewals), *left_in(w) = s->left;
    for (int k = 0; k < VECTORS; k++) guess(&s->x[0][k], at->b[k], &fresh[0][k]);
#endif
    for (int k = 0; k < VECTORS; k++) {
#if FORM == 2
        rhs(&first[0][k], &second[0][k], &s->t[k], &at->u[0][k], w, &fresh[0][k]);
#else
        rhs(&first[0][k], &second[0][k], &s->t[k], &at->u[0][k], w, &fresh[0][k], &fresh[N][k]);
#endif
        for (int r = 0; r < ROWS; r++) fresh[r][k] *= at->b[k];
    }
#endif
}

/* fresh: one more evaluation, the first one from where the stages have been placed. */
LARGE void evaluate(Step *s, const Nodes *at, double h, const double *w, int seidel, int is_first, Unknowns fresh) {
    V first[MOST_N][VECTORS], second[MOST_N][VECTORS];
    if (!is_first) place(s, at, h, STAGE_M2, STAGE_M1, 0, s->x, 0, 0, 0, 0, first, second);
    else
        EACH for (int d = 0; d < N; d++)
            for (int k = 0; k < VECTORS; k++) {
                first[d][k] = s->start[d][k];
                if (BOTH) second[d][k] = s->start[N + d][k];
            }
    respond(s, at, h, w, first, second, seidel, fresh);
    s->count++;
}

/* How far off the unknowns are that still change by a good part of what they have become, relative to the size of their row.
   Where a row has just begun to be there, large changes are none. */
INLINE double going_off(const Step *s, const Unknowns fresh, const Change *c) {
    const V none = splat(0.0);
    V off = none;
    for (int r = 0; r < ROWS; r++)
        for (int k = 0; k < VECTORS; k++) /* in this order the maximum of what is no number is none */
            off += v_fmax(none, (v_fabs(fresh[r][k] - s->x[r][k]) - v_fabs(fresh[r][k]) * 0.125) * c->inverse[r]);
    return lane(in_all_lanes(off), 0);
}

/* Not in line: once a step it costs nothing, and the compiler half of its time. Halves are longer: written out but once. */
APART void begin_next(Run *r) {
    place_start(r, &r->next, 2, r->now.x, r->last);
    evaluate(&r->next, &r->at, r->h, r->w, r->seidel, 1, r->next.x);
}

/* One more evaluation of the step at hand, and where its unknowns are known well enough, of the next one beside it: has
   the iteration come to its end? */
INLINE int improve_step(Run *r, double t_next, int64_t first_count) {
    Unknowns fresh;
    int end = 0;
    evaluate(&r->now, &r->at, r->h, r->w, r->seidel, !r->now.count, fresh);
    if (r->now.count == 1) {
        copy_unknowns(r->now.x, fresh);
        return 0;
    }
    if (AHEAD && r->known && 2 * r->now.count >= r->expected) { /* earlier, x is too far from where it will be */
        set_base_after(&r->next, &r->now, t_next, &r->at);
        if (!HALVES && !r->next.count) begin_next(r);
        else {
            Unknowns after;
            if (!r->next.count) place_start(r, &r->next, 2, r->now.x, r->last);
            evaluate(&r->next, &r->at, r->h, r->w, r->seidel, !r->next.count, after);
            copy_unknowns(r->next.x, after);
        }
    }
    if (r->now.count + 1 >= r->expected || ALWAYS_LOOK) { /* before, the last step needed more: no look at the change */
        if (!r->known && !(LEGENDRE_ITERATIONS && r->change.checks)) set_first_scale(r, fresh);
        end = settled(&r->now, fresh, &r->change, r->level, r->now.count == first_count);
    } else if (FORM == 1 && r->known && (r->level > LOOSE || r->expected > 2 * GLANCE) && r->now.count % GLANCE == 0)
        /* coarse ones, and others that take many iterations: else what is off may come back */
        r->change.off = going_off(&r->now, fresh, &r->change);
    copy_unknowns(r->now.x, fresh);
    return end;
}

/* Step k until its end, or until no end is to be expected? What a velocity that is the same all along the step changes shows
   in the forces one evaluation later, where they depend on it. */
#ifdef SCENE_AS_DATA
INLINE
#else
static
#endif
int iterated(Run *r, int64_t k, int begun) {
    const Change *const c = &r->change;
    const double t_next = r->t0 + r->h * (double)(k + 1);
    const int64_t first_count = begun ? r->now.count + 1 : 0; /* its change is that of the start of the step, too */
    const int64_t least = LEGENDRE_ITERATIONS && !r->known ? 2 : 1, judged = r->known || LEGENDRE_ITERATIONS;
    int end = 0;
    while (r->now.count < r->most && !end && c->off <= BEYOND && !(judged && c->checks > least && !(c->now <= DIVERGED * c->first)))
        end = improve_step(r, t_next, first_count);
    return end;
}
