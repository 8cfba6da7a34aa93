/* Steps of a Gauss rule with slopes, as slopes.h has them: what depends on the size of a scene alone. */

/* What multiplies a mode's own part, where unknowns have its real one and where they have the imaginary one, and the other part. */
INLINE void set_parts(Modes x, V *own, V *other) {
#if LANES == 8 && VECTORS == 1 && !defined(__clang__)
    I from;
    V sign;
    for (int i = 0; i < LANES; i++) from[i] = i < PAIRS ? i : i < STAGES ? i - PAIRS : 0, sign[i] = i < PAIRS ? -1 : i < STAGES;
    own[0] = __builtin_shuffle(x, from) * v_fabs(sign), other[0] = __builtin_shuffle(x, from + 4) * sign;
#else
    double parts[8], mine[PADDED], its[PADDED];
    memcpy(parts, &x, sizeof parts);
    for (int i = 0; i < PADDED; i++) {
        mine[i] = i < PAIRS ? parts[i] : i < STAGES ? parts[i - PAIRS] : 0;
        its[i] = i < PAIRS ? -parts[4 + i] : i < STAGES ? parts[4 + i - PAIRS] : 0;
    }
    memcpy(own, mine, sizeof mine), memcpy(other, its, sizeof its);
#endif
}

INLINE Modes both_parts(Pairs re, Pairs im) {
    Modes x;
    memcpy(&x, &re, sizeof re), memcpy((char *)&x + sizeof re, &im, sizeof im);
    return x;
}
INLINE Pairs real_part(Modes x) { Pairs y; memcpy(&y, &x, sizeof y); return y; }
INLINE Pairs imaginary_part(Modes x) { Pairs y; memcpy(&y, (char *)&x + sizeof y, sizeof y); return y; }
/* The same times i. */
INLINE Modes turned_modes(Modes x) { return both_parts(-imaginary_part(x), real_part(x)); }

/* Real parts of modes where the imaginary ones are, and these where they are. */
INLINE void swap_parts(const V *x, V *swapped) {
#if LANES > 1 && VECTORS == 1 && !defined(__clang__)
    I from;
    for (int i = 0; i < LANES; i++) from[i] = i < PAIRS ? i + PAIRS : i < STAGES ? i - PAIRS : i;
    swapped[0] = __builtin_shuffle(x[0], from);
#else
    if (PAIRS % LANES == 0) {
        for (int k = 0; k < VECTORS; k++) swapped[k] = x[k < PAIRS / LANES ? k + PAIRS / LANES : k - PAIRS / LANES];
        return;
    }
    double parts[PADDED], other[PADDED];
    memcpy(parts, x, sizeof parts);
    for (int i = 0; i < PADDED; i++) other[i] = parts[i < PAIRS ? i + PAIRS : i < STAGES ? i - PAIRS : i];
    memcpy(swapped, other, sizeof other);
#endif
}

/* Whether there is room for slopes and their inverse. */
APART int has_room(Run *r) {
    Slopes *const s = &r->slopes;
    if (s->room) return 1;
    const size_t all = (size_t)ROWS * ROWS, vectors = all * sizeof *s->own, between = (all + ROWS) * sizeof *s->modes;
    char *const room = aligned_alloc(64, (2 * vectors + between + 2 * all * sizeof(double) + 63) / 64 * 64);
    if (!room) return 0;
    s->modes = (Modes *)room, s->own = (V (*)[VECTORS])(room + between), s->other = s->own + all;
    s->of_places = (double *)(room + between + 2 * vectors), s->of_speeds = s->of_places + all, s->room = (double *)room;
    memset(s->of_speeds, 0, all * sizeof(double)); /* those that nothing depends on */
    return 1;
}

/* (I - l h J)^-1, or with FORM 2 (I - l h da/dv - l^2 h^2 da/dq)^-1, for every pair of eigenvalues l. */
APART void invert(Run *r) {
    const Slopes *const s = &r->slopes;
    Modes *const x = s->modes, *const turned = x + ROWS * ROWS, none = {0};
    Pairs l_re = {0}, l_im = {0};
    memcpy(&l_re, MODE_RE, PAIRS * sizeof(double)), memcpy(&l_im, MODE_IM, PAIRS * sizeof(double));
    const Modes l = both_parts(l_re, l_im), squared = both_parts(l_re * l_re - l_im * l_im, 2 * l_re * l_im),
                one = both_parts(real_part(none) + 1, real_part(none));
    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j < ROWS; j++) {
            const int at = i * ROWS + j;
            const Modes slope = FORM == 2 ? squared * s->of_places[at] + l * (BOTH ? s->of_speeds[at] : 0) : l * s->of_places[at];
            x[at] = (i == j ? one : none) - slope;
        }
    for (int k = 0; k < ROWS; k++) {
        Modes *const own = x + k * ROWS;
        const Pairs re = real_part(own[k]), im = imaginary_part(own[k]), size = re * re + im * im;
        const Modes over_re = both_parts(re / size, re / size), over_im = both_parts(-im / size, -im / size);
        own[k] = one;
        for (int j = 0; j < ROWS; j++) own[j] = over_re * own[j] + over_im * turned_modes(own[j]);
        for (int j = 0; j < ROWS; j++) turned[j] = turned_modes(own[j]);
        for (int i = 0; i < ROWS; i++) {
            if (i == k) continue;
            Modes *const its = x + i * ROWS;
            const Modes y_re = both_parts(real_part(its[k]), real_part(its[k])),
                        y_im = both_parts(imaginary_part(its[k]), imaginary_part(its[k]));
            its[k] = none;
            for (int j = 0; j < ROWS; j++) its[j] -= y_re * own[j] + y_im * turned[j];
        }
    }
    for (int at = 0; at < ROWS * ROWS; at++) set_parts(x[at], s->own[at], s->other[at]);
}

/* fresh = x + the inverse of what fresh misses. */
APART void improve(const Run *r, const Unknowns x, Unknowns fresh) {
    V modes[SLOPES_ROOM][VECTORS], swapped[SLOPES_ROOM][VECTORS];
    for (int i = 0; i < ROWS; i++) {
        V missed[VECTORS];
        for (int k = 0; k < VECTORS; k++) missed[k] = fresh[i][k] - x[i][k], modes[i][k] = splat(0.0);
        add_product(STAGE_MODES, missed, modes[i]);
        swap_parts(modes[i], swapped[i]);
    }
    for (int i = 0; i < ROWS; i++) {
        const V(*const by_own)[VECTORS] = (const V(*)[VECTORS])r->slopes.own + i * ROWS,
              (*const by_other)[VECTORS] = (const V(*)[VECTORS])r->slopes.other + i * ROWS;
        V own[VECTORS], other[VECTORS], way[VECTORS];
        for (int k = 0; k < VECTORS; k++) own[k] = other[k] = way[k] = splat(0.0);
        for (int j = 0; j < ROWS; j++)
            for (int k = 0; k < VECTORS; k++) {
                own[k] = v_fma(by_own[j][k], modes[j][k], own[k]);
                other[k] = v_fma(by_other[j][k], swapped[j][k], other[k]);
            }
        for (int k = 0; k < VECTORS; k++) own[k] += other[k];
        add_product(STAGE_OF_MODES, own, way);
        for (int k = 0; k < VECTORS; k++)
            fresh[i][k] = x[i][k] + choose(MASK(r->at.b[k] != 0.0), way[k], splat(0.0));
    }
}

/* The unknowns of the step at hand as the polynomial of the last ones has them, without an evaluation. */
APART void begin_improved(Run *r) {
    Step *const s = &r->now;
    const int low = r->low > 0;
    const double *const m = r->known > 1 ? low ? LOW_M0 : START_M0 : low ? LOW_ONE_M0 : START_ONE_M0;
    for (int i = 0; i < ROWS; i++) {
        for (int k = 0; k < VECTORS; k++) s->x[i][k] = splat(0.0);
        add_product(m, r->last[i], s->x[i]);
        if (r->known > 1) add_product(low ? LOW_OLDER_M0 : START_OLDER_M0, r->older[i], s->x[i]);
        for (int k = 0; k < VECTORS; k++) s->x[i][k] = choose(MASK(r->at.b[k] != 0.0), s->x[i][k], splat(0.0));
    }
    s->count = s->renewals = 1;
}

/* x = h b times the right-hand side at the points that stand where the stages begin. */
INLINE void evaluate_there(Run *r, int64_t k) {
#ifdef SCENE_APART
    const Step *const s = &r->now;
#endif
    const int64_t most = r->most;
    const int seidel = r->seidel;
    r->now.count = 0, r->most = 1, r->seidel = 0;
    iterated(r, k, 0);
    r->most = most, r->seidel = seidel;
}

/* Slopes of the right-hand side at a place and its momenta, or with FORM 2 its speeds, by differences from it, the points in
   the lanes, as far apart as the sizes of what differs say. */
static void take_slopes(Run *r, int64_t k, const double *q, const double *z, double t, const double *size) {
    Slopes *const to = &r->slopes;
    Step *const s = &r->now;
    const int columns = BOTH ? 2 * N : N, each = STAGES - 1;
    V(*const second)[VECTORS] = HALVES ? s->p : s->start + N, controls[MOST_NU + 1][VECTORS];
    copy_step(&r->next, s); /* nothing is begun there */
    memcpy(controls, r->at.u, sizeof controls);
    for (int m = 0; m < NU; m++)
        for (int l = 0; l < VECTORS; l++) r->at.u[m][l] = splat(lane(controls[m][0], 0));
    for (int l = 0; l < VECTORS; l++) s->t[l] = splat(t);
    s->renewals = DENSE, s->left = EXACTLY;
    for (int first = 0; first < columns; first += each) {
        const int count = columns - first < each ? columns - first : each;
        double off[STAGES];
        for (int d = 0; d < N; d++)
            for (int l = 0; l < VECTORS; l++) s->start[d][l] = splat(q[d]), second[d][l] = splat(z[d]);
        for (int j = 1; j <= count; j++) {
            const int c = first + j - 1, d = c % N;
            const double here = c < N ? q[d] : z[d], there = here + APART_BY * size[c];
            off[j] = there - here;
            set_lane(&(c < N ? s->start : second)[d][j / LANES], j % LANES, there);
        }
        evaluate_there(r, k);
        for (int j = 1; j <= count; j++) {
            const int c = first + j - 1, by_speed = FORM == 2 && c >= N;
            for (int i = 0; i < ROWS; i++) {
                const double rise = lane(s->x[i][j / LANES], j % LANES) / STAGE_B[j] - lane(s->x[i][0], 0) / STAGE_B[0];
                if (by_speed) to->of_speeds[i * ROWS + c - N] = rise / (r->h * off[j]);
                else to->of_places[i * ROWS + c] = rise / off[j];
            }
        }
    }
    copy_step(s, &r->next), s->left = CLOSELY;
    memcpy(r->at.u, controls, sizeof controls);
    r->next.count = 0;
}

/* Sizes of a place and of its momenta or speeds, by which slopes are taken: of a number and of how far it moves in a step. */
INLINE void sizes_there(Run *r, const double *q, const double *z, double *size) {
    const double *const scale = r->change.scale;
    double most = 0, *const largest = r->slopes.sizes;
    for (int d = 0; d < N; d++) most = fabs(q[d]) > most ? fabs(q[d]) : most;
    for (int c = 0; c < 2 * N; c++) {
        size[c] = c < N ? fabs(q[c]) + scale[c] : fabs(z[c - N]) + (FORM == 2 ? scale[c - N] / fabs(r->h) : scale[c]);
        if (!(size[c] > 0)) size[c] = most > 0 ? most : 1;
        if (r->known && size[c] > largest[c]) largest[c] = size[c]; /* of a fresh start by a guess */
        const double least = RESTS * largest[c];
        size[c] = least > size[c] ? least : size[c];
    }
}

/* Whether a size is by far too small, and is made what the number moves where all others move by theirs: sums that cancel
   leave round-off, by whose size differences of all the rest are nothing but theirs. */
INLINE int outgrown(const Run *r, double *size) {
    const Slopes *const s = &r->slopes;
    const double *const scale = r->change.scale;
    int any = 0;
    for (int c = 0; c < ROWS; c++) {
        double moved = 0;
        for (int j = 0; j < ROWS; j++) moved += fabs(s->of_places[c * ROWS + j]) * scale[j];
        if (FORM == 2 && BOTH)
            for (int j = 0; j < ROWS; j++) moved += fabs(s->of_speeds[c * ROWS + j]) * scale[j];
        if (moved > OUTGROWN * size[c]) any = 1, size[c] = moved;
        if (FORM == 2 && moved > OUTGROWN * fabs(r->h) * size[N + c]) any = 1, size[N + c] = moved / fabs(r->h);
    }
    return any;
}

/* What last digits of coordinates make of forces or accelerations, and these of coordinates: the most of each kind. */
INLINE void set_faint(Slopes *s, const double *q) {
    double of_coordinates = 0, most = 0;
    for (int i = N * (UNKNOWNS_EACH - 1); i < ROWS; i++) {
        double sum = 0;
        for (int d = 0; d < N; d++) sum += fabs(s->of_places[i * ROWS + d] * q[d]);
        most = EPS * sum > most ? EPS * sum : most;
    }
    for (int i = 0; i < N; i++) {
        double sum = 0;
        for (int j = N; j < ROWS; j++) sum += fabs(s->of_places[i * ROWS + j]);
        sum = EPS * fabs(q[i]) + sum * most;
        of_coordinates = sum > of_coordinates ? sum : of_coordinates;
    }
    for (int i = 0; i < ROWS; i++) FAINT(s)[i] = UNKNOWNS_EACH > 1 && i < N ? of_coordinates : most;
}

/* Slopes in the middle of the step k, where its unknowns put it; of a fresh start, where it begins. */
APART void renew_slopes(Run *r, int64_t k) {
    const Step *const s = &r->now;
    const int j = STAGES / 2;
    double q[MOST_N], z[MOST_N];
    V first[MOST_N][VECTORS], second[MOST_N][VECTORS];
    if (s->count) set_momenta(&r->now, STAGE_M1, s->x, 0, 0), place(s, &r->at, r->h, STAGE_M2, STAGE_M1, 0, s->x, 0, 0, 0, 0, first, second);
    for (int d = 0; d < N; d++) {
        const V *const place = s->count ? first[d] : s->base[d], *const other = HALVES ? s->count ? s->p[d] : s->base[N + d] : second[d];
        q[d] = lane(place[j / LANES], j % LANES);
        z[d] = HALVES || (s->count && BOTH) ? lane(other[j / LANES], j % LANES) : r->y[N + d] / (FORM == 2 ? r->h : 1);
    }
    const double t_there = lane(s->t[j / LANES], j % LANES);
    double size[2 * MOST_N];
    sizes_there(r, q, z, size);
    take_slopes(r, k, q, z, t_there, size);
    if (outgrown(r, size)) take_slopes(r, k, q, z, t_there, size);
    set_faint(&r->slopes, q), invert(r);
    r->slopes.renew = 0, r->slopes.there = 1;
}

/* Step k until its end, or until no end is to be expected: `iterated` with what evaluations miss taken through the inverse. */
APART int iterated_with_slopes(Run *r, int64_t k) {
    Change *const c = &r->change;
    Step *const s = &r->now;
    Unknowns x, fresh;
    int end = 0;
    if (!s->count) evaluate_there(r, k);
    while (s->count < r->most && !end && !(r->known && c->checks > 1 && !(c->now <= DIVERGED * c->first)) && c->off <= BEYOND) {
        const int64_t count = s->count;
        copy_unknowns(x, s->x);
        set_momenta(s, STAGE_M1, x, 0, 0);
        place(s, &r->at, r->h, STAGE_M2, STAGE_M1, 0, x, 0, 0, 0, 0, s->start, s->start + N);
        s->left = CLOSELY;
        evaluate_there(r, k);
        copy_unknowns(fresh, s->x), copy_unknowns(s->x, x);
        improve(r, x, fresh);
        s->count = count + 1;
        if (s->count + 1 >= r->expected) {
            if (!r->known) set_first_scale(r, fresh);
            end = settled(s, fresh, c, r->level, 0);
        }
        copy_unknowns(s->x, fresh);
    }
    return end;
}

/* The steps to come are improved, since one took so many evaluations: each time longer, until that is not the shorter way. Whether
   they are: this may be no shorter way, and there may be no memory. */
INLINE int begin_slopes(Run *r, double evaluations) {
    Slopes *const s = &r->slopes;
    if (!repays(&r->now, evaluations) || !has_room(r)) return 0;
    s->period = s->period > 0 ? s->period < LASTING ? 4 * s->period : LASTING : PERIOD;
    s->left = s->period, s->renew = 1, s->was = evaluations, s->spent = s->made = 0;
    r->expected = 0, r->change.rate = 1;
    return 1;
}

/* Plain steps follow, each time more of them. */
INLINE void rest_from_slopes(Run *r) {
    Slopes *const s = &r->slopes;
    s->plain = s->rest = s->rest > 0 ? s->rest < LASTING ? 4 * s->rest : LASTING : REST;
    s->period = s->left = 0, r->expected = 0, r->change.rate = 1;
}

/* After a step: whether the next ones are improved, and by new slopes. Where that is the longer way, plain ones are taken, each
   time longer, while they can be. */
INLINE void plan_slopes(Run *r) {
    Slopes *const s = &r->slopes;
#ifdef SCENE_APART
    const Scene *const scene = r->now.scene;
#endif
    const double count = (double)r->now.count;
    if (!(s->left > 0)) {
        s->plain -= s->plain > 0;
        if (count > SLOW * DEARER && r->known > 1 && !(s->plain > 0)) begin_slopes(r, count);
        return;
    }
    s->spent += DEARER * (count - 1) + RENEWAL * s->there, s->there = 0, s->made += 1, s->left -= 1;
    if (count > GROWN_OLD) s->renew = 1;
    const double first = ROWS > ALWAYS_REPAYS ? RENEWAL : 0; /* those of many coordinates are to last for longer */
    const int longer = s->spent > first + s->was * (s->made < TRIED ? TRIED : s->made);
    if (longer) rest_from_slopes(r);
    else if (!(s->left > 0)) r->expected = 0, r->change.rate = 1;
}
