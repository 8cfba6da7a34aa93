/* The loop over the steps of a Gauss rule, as gauss.h has it: what depends on the size of a scene alone. */

#include "carry.h"
#define BELOW 0.125 /* of the highest coefficient but one counts */
#define SLOPES_SIZE (IMPROVES ? SLOPES_TOLD + (FORM == 2 ? 2 : 1) * ROWS * ROWS : 0)
#define CARRY_SIZE (int64_t)(sizeof(Carry) / sizeof(double) + 4 * N + ROWS * (2 + 3 * PADDED) + SLOPES_SIZE)
#ifdef SCENE_AS_DATA
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }
#else
const int64_t carry_size = CARRY_SIZE;
#endif

#if HALVES
/* What a change of the unknowns does, h V p and h F h V, as a part of the step's action h V p. In a long chain the momenta
   are sums over all its links, and their round-off moves single links by far more than these links' own. */
APART double work_of(const Step *s, const Unknowns fresh) {
    V moved = splat(0.0), whole = splat(0.0);
    for (int d = 0; d < N; d++)
        for (int k = 0; k < VECTORS; k++) {
            V way = v_fabs(fresh[d][k]), push = v_fabs(s->p[d][k]);
            whole = v_fma(way, push, whole);
            moved = v_fma(v_fabs(fresh[d][k] - s->x[d][k]), push, moved);
            moved = v_fma(v_fabs(fresh[N + d][k] - s->x[N + d][k]), way, moved);
        }
    return lane(in_all_lanes(moved), 0) / (lane(in_all_lanes(whole), 0) + 1e-300);
}
#endif

/* Whether what changes is the last digit of what it is added to, where that is a coordinate: a stiff spring makes of it
   accelerations that may be large beside those of a row that is hardly pushed. Forces that balance are a sum that vanishes;
   they are known where all coordinates are. */
APART int is_unseen(const Step *s, const Unknowns fresh, int r) {
    for (int d = FORM == 2 ? r : 0; d < (FORM == 2 ? r + 1 : N); d++)
        if (!(largest(change_of(fresh[d], s->x[d])) <= EPS * fabs(lane(s->base[d][0], 0)))) return 0;
    return !BY_DEFECT;
}

/* Whether steps with slopes take less than ones of so many plain evaluations: those of many coordinates take many as long. */
APART int repays(const Step *s, double evaluations) {
#ifdef SCENE_APART
    const Scene *const scene = s->scene;
#else
    (void)s;
#endif
    return ROWS <= ALWAYS_REPAYS || RENEWAL / PERIOD + SLOW * DEARER <= evaluations;
}

/* Whether an iteration is near its end, and not over after as many evaluations as a step may take if it contracts as it has so far;
   what still changes is no round-off. */
INLINE int is_too_slow(const Change *c, double now, double level, int64_t left) {
    if (left < 0 || c->checks < TELLING || now <= NOISE || now > AT_HAND) return 0;
    return now * pow(now / c->first, (double)left / c->checks) > level;
}

/* Where the largest change has stopped shrinking: do all rows stagnate near round-off (Hairer, McKenna & Razakarivony
   2008)? For a row of cancelling terms that may lie far above its own size; the next steps need not find out again. What is
   left of a row is told by the size that it is judged by. Of many rows now and then one has a smaller last digit by chance: after
   many looks that tells nothing. */
APART int stagnates(const Step *s, const Unknowns fresh, Change *c, double level) {
    const V(*const x)[VECTORS] = s->x;
    const int long_since = !LEGENDRE_ITERATIONS && c->checks >= MANY_LOOKS;
    int all = 1;
    double worst = 0;
    c->left = 0;
    for (int r = 0; r < ROWS; r++) {
        double now = largest(change_of(fresh[r], x[r])), size = c->scale[r], most = 0;
        for (int i = r / N * N; i < r / N * N + N; i++) most = c->scale[i] > most ? c->scale[i] : most;
        const int rests = long_since && ((c->faint && now <= c->faint[r]) || (DENSE && now <= 1e-13 * most)); /* of all by full inertia */
        if (now < 0.5 * c->best[r]) {
            c->best[r] = now, c->idle[r] = now > NEAR * size && !rests ? 0 : c->idle[r];
            memcpy(c->from[r], fresh[r], sizeof c->from[r]);
        } else c->idle[r] += 1;
        int settled = now <= EPS * size || now <= level * size || (c->idle[r] >= 1 && now <= NEAR * size);
        double left = now / (size + 1e-300);
        if (!settled && c->idle[r] >= IDLE) { /* neither shrinks nor goes on in one direction */
            const double far = LEGENDRE_ITERATIONS ? 1e-13 : c->idle[r] >= LONG_IDLE ? NOISE : 1e-12; /* inertia may be far off */
            const int by_size = now <= far * size, by_most = now <= 1e-13 * most;
            settled = by_size || by_most || rests || is_unseen(s, fresh, r);
            if (settled) left = by_most ? now / most : by_size ? left : EPS;
            if (settled && !rests && largest(change_of(fresh[r], c->from[r])) > DRIFTS * now) {
                c->best[r] = now, settled = c->idle[r] = 0;
                memcpy(c->from[r], fresh[r], sizeof c->from[r]);
            } else if (settled && !rests && now < c->best[r]) c->best[r] = now, settled = 0;
        }
        c->left = left > c->left ? left : c->left;
        worst = now * c->inverse[r] > worst ? now * c->inverse[r] : worst;
        all &= settled;
    }
    if (BY_DEFECT && !LEGENDRE_ITERATIONS && !all && c->stalled > 1) {
        const double work = work_of(s, fresh);
        if (work <= SMALL_WORK) all = 1, c->left = work, c->work = work > c->work ? work : c->work;
    }
    if (all)
        for (int r = 0; r < ROWS; r++) {
            double last = largest(change_of(fresh[r], x[r]));
            if (last > EPS * c->scale[r] && last > level * c->scale[r] && last > c->noise[r]) c->noise[r] = last;
        }
    else if (IMPROVES && is_too_slow(c, worst, level, c->most - s->count) && repays(s, (double)c->most)) c->off = INFINITY;
    return all;
}

/* Never a denormal number, which would be slow for the rest of the run. */
INLINE double fading(double x, double fade) { return x > 1e-290 ? x * fade : 0; }

INLINE void set_scale(Change *c, const double *size, double fade) {
    for (int r = 0; r < ROWS; r++) { /* an oscillating row keeps its size where it passes zero */
        double faded = fading(c->scale[r], fade);
        c->scale[r] = size[r] > faded ? size[r] : faded;
        double least = c->noise[r] * (2 / EPS); /* a change of twice the noise counts as one at round-off */
        c->inverse[r] = 1 / ((c->scale[r] > least ? c->scale[r] : least) + 1e-300);
    }
}

/* Sizes of rows by the unknowns of a step before which none are known, and whether these have gone off. */
APART void set_first_scale(Run *r, const Unknowns x) {
    Change *const c = &r->change;
    V sizes[MOST_ROWS];
    double size[MOST_ROWS];
    for (int i = 0; i < ROWS; i++) sizes[i] = size_of(x[i]);
    row_sums(sizes, ROWS, size), set_scale(c, size, 0);
    for (int kind = 0; kind < UNKNOWNS_EACH; kind++) {
        double all = 0;
        for (int d = 0; d < N; d++) all += size[kind * N + d];
        if (!c->checks) c->begun[kind] = all;
        else if (r->level > LEAST_LEVEL && c->begun[kind] > 0 && all > GONE * c->begun[kind]) c->off = INFINITY;
    }
}

APART void save(const Run *r, double *row, double t, int64_t without_velocities) {
    const Step *const s = &r->now;
    const double *const y = r->y, *const w = r->w, h = r->h;
    V q[MOST_N], z[MOST_N], out[MOST_N], time = splat(t);
    for (int d = 0; d < N; d++) q[d] = splat(y[d]), z[d] = splat(FORM == 2 ? y[N + d] / h : y[N + d]);
#if FORM == 2
    momentum(q, z, &time, w + RHS_W + VELOCITY_W, out);
    for (int d = 0; d < N; d++) row[d] = y[d], row[N + d] = lane(out[d], 0), row[2 * N + d] = lane(z[d], 0);
#else
    COPY(row, y, 2 * N);
    if (without_velocities) return;
    last_speeds(r, out), velocity(q, z, &time, w + RHS_W, out);
    for (int d = 0; d < N; d++) row[2 * N + d] = lane(out[d], 0);
#endif
}

#include "slopes.c"

#ifdef SCENE_APART
static const Loop called_back = {
    .stagnates = stagnates, .set_first_scale = set_first_scale, .place_start = place_start,
#if HALVES
    .work_of = work_of,
#endif
};
#endif

/* The step that is begun where the last one began, of another size: on the polynomial through that one's stages. */
APART void begin_resized(Run *r, const Carry *carry) {
    Step *const s = &r->now;
    Change *const c = &r->change;
    const double ratio = r->h / carry->h, smaller = FORM == 2 ? ratio * ratio : ratio, *const scales = carry->numbers + 4 * N;
    double size[MOST_ROWS];
    Unknowns x;
    memcpy(x, scales + 2 * ROWS, UNKNOWNS_SIZE);
    for (int i = 0; i < ROWS; i++)
        for (int k = 0; k < VECTORS; k++) s->x[i][k] = splat(0.0);
    for (int j = 0; j < STAGES; j++) {
        double below = STAGE_B[j];
        V part[VECTORS];
        for (int k = 0; k < VECTORS; k++) part[k] = smaller * entry(STAGE_B, k);
        for (int m = 0; m < STAGES; m++) {
            if (m == j) continue;
            below *= STAGE_C[j] - STAGE_C[m];
            for (int k = 0; k < VECTORS; k++) part[k] *= v_fma(entry(STAGE_C, k), splat(ratio), splat(-STAGE_C[m]));
        }
        for (int i = 0; i < ROWS; i++) {
            const V known = splat(lane(x[i][j / LANES], j % LANES) / below);
            for (int k = 0; k < VECTORS; k++) s->x[i][k] = v_fma(part[k], known, s->x[i][k]);
        }
    }
    for (int i = 0; i < ROWS; i++) size[i] = fabs(smaller) * scales[i], c->noise[i] = scales[ROWS + i];
    set_scale(c, size, 0);
    s->count = 1, s->renewals = 2, s->left = 1, r->known = 1, c->rate = carry->rate;
}

/* Steps of another size are improved from the first on: they are the longer ones of a motion that settles, whose slopes
   hardly change. */
APART void go_on_with_slopes(Run *r, const Carry *carry) {
    if (!IMPROVES) return;
    Slopes *const s = &r->slopes;
    memcpy(s, carry->numbers + 4 * N + ROWS * (2 + 3 * PADDED), SLOPES_TOLD * sizeof(double));
    if (!(s->left > 0)) {
        s->period = s->period > REST ? s->period : REST;
        begin_slopes(r, FAILED + carry->expected);
    } else if (!has_room(r)) s->left = 0;
    s->renew = 1, s->there = 0;
}

/* The run stands at q and p, as if these were not rounded. */
APART void stand_at(Run *r, const double *start) {
    for (int d = 0; d < N; d++) r->y[d] = start[d], r->y[N + d] = start[N + d], r->rest[d] = r->rest[N + d] = 0;
#if FORM == 2
    const Step *const s = &r->now;
    V q[MOST_N], z[MOST_N], out[MOST_N], time = splat(r->t0 + r->h * (double)r->first);
    for (int d = 0; d < N; d++) q[d] = splat(r->y[d]), z[d] = splat(r->y[N + d]);
    velocity(q, z, &time, r->w + RHS_W, out);
    for (int d = 0; d < N; d++) r->y[N + d] = r->h * lane(out[d], 0);
    (void)s;
#endif
}

/* Steps are of this size. */
INLINE void set_size(Run *r, double h) {
    r->h = h;
    for (int k = 0; k < VECTORS; k++) r->at.c[k] = h * entry(STAGE_C, k), r->at.b[k] = (FORM == 2 ? h * h : h) * entry(STAGE_B, k);
}

/* Where the run stands: as it was left, or at a fresh start. */
APART void restore(Run *r, const RunArguments *a) {
    const double h = a->h;
    const Carry *carry = (const Carry *)a->carry;
    r->t0 = a->t0, r->first = a->first, r->most = a->most, r->level = a->level > LEAST_LEVEL ? a->level : LEAST_LEVEL;
#ifdef SCENE_APART
    r->now.scene = r->next.scene = a->scene, r->now.loop = r->next.loop = &called_back;
#endif
    const Step *const s = &r->now;
    prepare(a->c, r->w);
    set_size(r, h);
    r->known = r->expected = r->iterations = r->most_iterations = 0, r->change.work = 0, r->change.faint = 0;
    r->seidel = 1, r->low = r->level > LOOSE ? INT64_MAX : 0;
    r->tried = HALVES && !BY_DEFECT ? 0 : 2 * TRIAL, r->counts[0] = r->counts[1] = r->counts[2] = r->slowest = r->residual = 0;
    r->now.count = r->next.count = 0, r->alone = a->alone != 0;
    r->now.taken = r->next.taken = r->taken;
    memset(&r->slopes, 0, SLOPES_TOLD * sizeof(double)), r->slopes.room = 0;
    if (carry->steps_known > 0 && carry->h == h) {
        r->known = (int64_t)carry->steps_known, r->expected = (int64_t)carry->expected;
        const double *at = carry->numbers, *scales = at + 4 * N, *x = scales + 2 * ROWS;
        COPY(r->y, at, 2 * N), COPY(r->rest, at + 2 * N, 2 * N);
        memcpy(r->last, x, UNKNOWNS_SIZE), memcpy(r->older, x + ROWS * PADDED, UNKNOWNS_SIZE);
        memcpy(r->now.x, x + 2 * ROWS * PADDED, UNKNOWNS_SIZE), r->now.count = (int64_t)carry->count;
        for (int i = 0; i < ROWS; i++) r->change.scale[i] = 0, r->change.noise[i] = scales[ROWS + i];
        set_scale(&r->change, scales, 0);
        r->change.rate = carry->rate, r->change.work = carry->work, r->low = r->low ? r->low : (int64_t)carry->low;
        r->tried = carry->tried, memcpy(r->counts, carry->counts, sizeof r->counts);
        r->seidel = LONGER * r->counts[1] <= r->counts[0];
        if (IMPROVES) {
            const double *const kept = x + 3 * ROWS * PADDED, *const slopes = kept + SLOPES_TOLD;
            memcpy(&r->slopes, kept, SLOPES_TOLD * sizeof(double));
            if (!(r->slopes.left > 0 && has_room(r))) r->slopes.left = 0;
            else if (!(r->slopes.renew > 0)) {
                COPY(r->slopes.of_places, slopes, ROWS * ROWS);
                if (FORM == 2) COPY(r->slopes.of_speeds, slopes + ROWS * ROWS, ROWS * ROWS);
                invert(r);
            }
        }
    } else {
        stand_at(r, a->start);
        for (int i = 0; i < ROWS; i++) r->change.scale[i] = r->change.noise[i] = 0;
        r->change.rate = 1;
        for (int i = 0; i < ROWS; i++)
            for (int k = 0; k < VECTORS; k++) r->last[i][k] = r->older[i][k] = splat(0.0);
        if (carry->steps_known == ANOTHER_SIZE) go_on_with_slopes(r, carry);
        else if (carry->steps_known < 0) begin_resized(r, carry);
    }
}

/* The sizes of rows by what one evaluation at the start makes of them: those of unknowns that have gone off are no lengths to
   take slopes by, which would be those of another place, and an inverse by which all changes are small. */
APART void set_scale_at_start(Run *r, int64_t k) {
    if (!IMPROVES) return;
    r->change.off = 0, r->change.checks = 0;
    place_start(r, &r->now, 0, r->last, r->older);
    evaluate_there(r, k);
    set_first_scale(r, r->now.x);
    r->iterations += 1, r->now.count = 0;
}

/* The unknowns of step k: from the extrapolated start; where that fails, once more from a constant right-hand side, and then
   with slopes, or with these at once where it contracts, but too slowly. Where that fails, too, all is done with patience. */
INLINE int solve(Run *r, int64_t k) {
    Change *const c = &r->change;
    const Step *const s = &r->now;
    set_base(&r->now, r->y, r->rest, r->t0 + r->h * (double)k, &r->at);
    const int begun = r->now.count > 0;
    const int64_t known = r->known;
    Slopes *const slopes = &r->slopes;
    if (r->tried < 2 * TRIAL && !(slopes->left > 0)) {
        r->seidel = r->tried < TRIAL;
        if (r->tried == TRIAL) r->expected = 0, c->rate = 1;
    }
    if (!BY_DEFECT && begun) set_momenta(&r->now, STAGE_M1, r->now.x, 0, 0);
    double lost = r->alone ? INFINITY : FAILED;
    c->most = r->most;
    for (int tried[2] = {0}, goes_on = 0;;) {
        const int improved = IMPROVES && slopes->left > 0;
        c->checks = 0, c->off = 0, c->faint = improved ? FAINT(slopes) : 0;
        if (improved && r->now.count > 1) r->iterations += r->now.count - 1, r->now.count = 1; /* begun without slopes */
        if (!r->now.count && improved && r->known) begin_improved(r);
        if (improved && slopes->renew > 0) renew_slopes(r, k);
        if (!r->now.count) place_start(r, &r->now, r->known, r->last, r->older);
        const int end = improved ? iterated_with_slopes(r, k) : iterated(r, k, begun);
        r->iterations += r->now.count - (improved && (r->known || goes_on)); /* that one begins with no evaluation */
        if (end) return 1;
        lost += (double)r->now.count;
        goes_on = IMPROVES && !improved && c->checks >= TELLING && c->now <= AT_HAND;
        if (goes_on && begin_slopes(r, lost)) { /* slowly, but the right way: slopes go on from there */
            r->now.count = 1, r->next.count = 0, tried[0] = !r->known;
            continue;
        }
        if (!r->known) {
            tried[improved] = 1;
            if (IMPROVES && tried[!improved] && c->most > 0) {
                rest_from_slopes(r);
                tried[0] = tried[1] = 0, c->most = 0, r->known = known, r->now.count = r->next.count = 0;
                continue;
            }
            if (!IMPROVES || tried[!improved]) return BY_DEFECT && !LEGENDRE_ITERATIONS && c->now <= WANDERS;
            if (improved) rest_from_slopes(r);
            else if (!begin_slopes(r, c->off > 0 && !r->alone ? SHORTER * pow(GONE, 1.0 / c->checks) : lost)) return 0;
        }
        slopes->renew = 1;
        r->known = r->expected = r->now.count = r->next.count = 0, r->low = r->low > CAREFUL ? r->low : CAREFUL;
        set_scale_at_start(r, k);
    }
}

/* How often a step that takes `count` evaluations need not have been looked at, nor evaluated: at the present rate. */
INLINE int64_t spare(const Change *c, double level, int64_t count) {
    int64_t found = 0;
    for (double left = c->left; c->checks == 1 && left <= c->rate * level && 2 * found < count; left /= c->rate) found++;
    return found;
}

/* Counts a step tried in either order; after so many of them, or where the second order is clearly worse than the first
   was lately, it is known in which the halves converge sooner. */
INLINE void count_trial(Run *r) {
    double *const counts = r->counts, count = (double)r->now.count, others = (r->tried += 1) - TRIAL;
    counts[r->seidel] += count;
    if (r->seidel) counts[2] += count - counts[2] / LATELY;
    const int worse = others > 1 && counts[0] * LATELY > WORSE * counts[2] * others;
    if (!worse && r->tried < 2 * TRIAL) return;
    r->seidel = worse || LONGER * counts[1] <= counts[0], r->tried = 2 * TRIAL, r->expected = 0, r->change.rate = 1;
    if (worse) counts[0] = INFINITY;
}

/* The solved step becomes the last one: the state at its end, and what the next one starts from; nothing of it where that
   is not finite. */
INLINE int accept(Run *r) {
    Change *const c = &r->change;
    double *const y = r->y, *const rest = r->rest, old[2 * MOST_N], lost[2 * MOST_N], sums[3 * MOST_ROWS];
    /* where already the first look saw nothing but round-off, the next step looks earlier */
    r->expected = c->checks > 1 && c->first <= 4 * c->now ? r->now.count - c->checks : r->now.count - spare(c, r->level, r->now.count);
    if (IMPROVES && r->slopes.left > 0 && c->checks == 1 && r->now.count > 2 * GROWN_OLD) r->expected = r->now.count / 2; /* nobody has looked sooner */
    r->most_iterations = r->now.count > r->most_iterations ? r->now.count : r->most_iterations;
    if (r->tried < 2 * TRIAL && r->known > 1 && !(r->slopes.left > 0)) count_trial(r);
    if (IMPROVES) plan_slopes(r);
    memcpy(r->older, r->last, UNKNOWNS_SIZE), memcpy(r->last, r->now.x, UNKNOWNS_SIZE);
    r->known += r->known < 2, r->low -= r->low > 0;
    COPY(old, y, 2 * N), COPY(lost, rest, 2 * N);
    V rows_of[3 * MOST_ROWS];
    for (int i = 0; i < ROWS; i++) rows_of[i] = folded(r->last[i]), rows_of[ROWS + i] = size_of(r->last[i]);
#if FORM == 2
    for (int d = 0; d < N; d++) {
        V moved[VECTORS];
        for (int k = 0; k < VECTORS; k++) moved[k] = entry(STAGE_BETA, k) * r->last[d][k];
        rows_of[2 * N + d] = folded(moved);
    }
    row_sums(rows_of, 3 * N, sums);
    for (int d = 0; d < N; d++) compensated(&y[d], &rest[d], y[N + d] + (sums[2 * N + d] + rest[N + d]));
    for (int d = 0; d < N; d++) compensated(&y[N + d], &rest[N + d], sums[d]);
    for (int d = 0; d < N; d++) {
        double path = fabs(y[N + d]);
        sums[N + d] = path > sums[N + d] ? path : sums[N + d];
    }
#else
    row_sums(rows_of, 2 * ROWS, sums);
    for (int i = 0; i < ROWS; i++) compensated(&y[i], &rest[i], sums[i]);
#endif
    if (!(unsound(y, 2 * N) == 0)) {
        COPY(y, old, 2 * N), COPY(rest, lost, 2 * N);
        return 0;
    }
    for (int i = 0; i < ROWS; i++) c->noise[i] = fading(c->noise[i], KEPT_NOISE);
    c->work = fading(c->work, KEPT_NOISE);
    set_scale(c, sums + ROWS, 0.9);
    r->slowest = c->rate > r->slowest ? c->rate : r->slowest;
    r->residual = c->left > r->residual ? c->left : r->residual;
    r->now.count = 0;
    if (AHEAD && r->next.count) copy_step(&r->now, &r->next);
    r->next.count = 0;
    return 1;
}

/* How large the two highest coefficients of the last step's unknowns are, row by row, and the sizes of rows. */
APART void see(const Run *r, const double *heights, double *seen) {
    V parts[2 * MOST_ROWS];
    double sums[2 * MOST_ROWS];
    for (int i = 0; i < ROWS; i++)
        for (int m = 0; m < 2; m++) {
            V one[VECTORS];
            for (int k = 0; k < VECTORS; k++) one[k] = entry(heights + PADDED * m, k) * r->last[i][k];
            parts[2 * i + m] = folded(one);
        }
    row_sums(parts, 2 * ROWS, sums);
    for (int i = 0; i < ROWS; i++) seen[i] = fabs(sums[2 * i + 1]) + fabs(sums[2 * i]) * BELOW;
    COPY(seen + ROWS, r->change.scale, ROWS);
}

/* What the next call needs, and what the caller is told. */
APART void store(const Run *r, const RunArguments *a, int status, int64_t done) {
    Carry *carry = (Carry *)a->carry;
    carry->steps_known = status ? 0 : (double)r->known, carry->expected = (double)r->expected, carry->h = r->h;
    double *at = carry->numbers, *scales = at + 4 * N, *x = scales + 2 * ROWS;
    COPY(at, r->y, 2 * N), COPY(at + 2 * N, r->rest, 2 * N);
    memcpy(x, r->last, UNKNOWNS_SIZE), memcpy(x + ROWS * PADDED, r->older, UNKNOWNS_SIZE);
    memcpy(x + 2 * ROWS * PADDED, r->now.x, UNKNOWNS_SIZE), carry->count = (double)r->now.count;
    if (IMPROVES) {
        double *const kept = x + 3 * ROWS * PADDED, *const slopes = kept + SLOPES_TOLD;
        memcpy(kept, &r->slopes, SLOPES_TOLD * sizeof(double));
        if (!(r->slopes.left > 0)) memset(slopes, 0, (size_t)(SLOPES_SIZE - SLOPES_TOLD) * sizeof(double));
        else {
            COPY(slopes, r->slopes.of_places, ROWS * ROWS);
            if (FORM == 2) COPY(slopes + ROWS * ROWS, r->slopes.of_speeds, ROWS * ROWS);
        }
    }
    carry->tried = r->tried, memcpy(carry->counts, r->counts, sizeof r->counts);
    COPY(scales, r->change.scale, ROWS), COPY(scales + ROWS, r->change.noise, ROWS);
    carry->rate = r->change.rate, carry->work = r->change.work, carry->low = r->low > CAREFUL ? 0 : (double)r->low;
    a->stats->status = status, a->stats->steps = (double)done, a->stats->iterations = (double)r->iterations;
    a->stats->most_iterations = (double)r->most_iterations, a->stats->contraction = r->slowest;
    a->stats->noted = 0;
    a->stats->residual = r->residual, a->stats->failed = status ? r->change.now : 0;
}

/* Room for what is prepared of the parameters, and for what one half of the right-hand side leaves to the other. */
#ifdef SCENE_APART
#define ROOM_FOR(r, of) \
    const Scene *const scene = of; \
    double prepared[scene->numbers + 1]; \
    V taken[scene->taken + 1][VECTORS]; \
    r.w = prepared, r.taken = taken
#define FREE_ROOM(r) ((void)0)
#else
#define FREE_ROOM(r) (free(r.w), free(r.taken))
#define ROOM_FOR(r, of) \
    scene = of, r.w = registers(), r.taken = HALVES ? (V (*)[VECTORS])taken_room() : 0; \
    if (!r.w || (HALVES && !r.taken)) { \
        FREE_ROOM(r); \
        return NOT_FINITE; \
    }
#endif

int run(const RunArguments *a) {
    Run r;
    ROOM_FOR(r, a->scene);
    restore(&r, a);
    double *rows = a->rows, t = r.t0 + r.h * (double)r.first;
    save(&r, rows, t, a->without_velocities);
    if (!r.known) memcpy(rows, a->start, 2 * N * sizeof(double));
    const double *u = a->u;
    int status = DONE, ended = 0;
    int64_t done = 0, unsaved = 0;
    while (done < a->steps && !ended) {
        for (int m = 0; m < NU; m++)
            for (int i = 0; i < PADDED; i++) set_lane(&r.at.u[m][i / LANES], i % LANES, u[(i < STAGES ? i : STAGES - 1) * NU + m]);
        u += STAGES * NU;
        status = !solve(&r, r.first + done) ? NOT_CONVERGED : !accept(&r) ? NOT_FINITE : DONE;
        if (status) break;
        if (a->seen) see(&r, a->heights, a->seen + 2 * ROWS * done);
        t = r.t0 + r.h * (double)(r.first + ++done), ended = is_behind(r.y[N - 1], a->end);
        if (++unsaved == a->save_every) unsaved = 0, rows += 3 * N, save(&r, rows, t, a->without_velocities);
    }
    (void)u;
    if (done && !unsaved) memcpy(a->stats->last, rows, 3 * N * sizeof(double));
    else save(&r, a->stats->last, t, 0);
    store(&r, a, status, done);
    free(r.slopes.room);
    FREE_ROOM(r);
    return status;
}
