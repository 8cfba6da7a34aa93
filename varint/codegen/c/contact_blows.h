/* Impacts: blows by Newton's law of restitution, one after the other, and what holds behind them: a part of contacts.c. The same
   as varint/integration/events/impacts.py has in general. */

INLINE void take_held(Work *x, const int64_t *held) { memcpy(x->held, held, (size_t)(1 + ROWS) * sizeof(int64_t)); }

INLINE void release(Work *x, int j) {
    for (int64_t k = j; k + 1 < x->held[0]; k++) HELD(k) = HELD(k + 1);
    x->held[0]--;
}

/* Row of a contact among those that hold, in order. */
INLINE void add_held(Work *x, int i) {
    int64_t j = x->held[0]++;
    for (; j > 0 && HELD(j - 1) > FIRST + i; j--) HELD(j) = HELD(j - 1);
    HELD(j) = FIRST + i;
}

INLINE double length_of(const Work *x, int64_t row) { return sqrt(sum_of(x->slope + row * N, x->slope + row * N, N)); }

/* The blow that turns the rate r of a contact to -e r: what holds takes its part of it, elastic contacts hand it on, and
   others let go where they would be pulled, but those that are kept. The same as `_reflect` in impacts.py; `from` is seen. Not where
   the constraints leave no part of it. */
static int reflect(Work *x, const double *from, int struck, double e, const int *kept, double *to, double *impulse) {
    double y[N + x->held[0]], row[N];
    const double length = length_of(x, FIRST + struck), sense = -RATE_OF(from)[struck];
    for (;;) {
        const int held = (int)x->held[0];
        COPY(y, CONTACT_ROW(struck), N);
        for (int j = 0; j < held; j++) y[N + j] = 0;
        if (!factorise(x)) return 0;
        substitute(x, y);
        double most = length, least = 0;
        int pulled = -1, handed = 0;
        for (int j = 0; j < held; j++)
            if (HELD(j) >= FIRST) most = fmax(most, fabs(y[N + j]) * length_of(x, HELD(j)));
        for (int j = 0; j < held; j++) {
            if (HELD(j) < FIRST || kept[HELD(j) - FIRST]) continue;
            const double felt = copysign(1, sense) * y[N + j] * length_of(x, HELD(j)) / most;
            if (felt < least) least = felt, pulled = j;
        }
        for (int j = held - 1; j >= 0; j--)
            if (HELD(j) >= FIRST && !kept[HELD(j) - FIRST] && x->restitution[HELD(j) - FIRST] > 0 && fabs(y[N + j]) * length_of(x, HELD(j)) / most > PULL)
                release(x, j), handed = 1;
        if (handed) continue;
        if (!(least < -PULL)) break;
        release(x, pulled);
    }
    COPY(row, CONTACT_ROW(struck), N);
    for (int j = 0; j < x->held[0]; j++)
        for (int d = 0; d < N; d++) row[d] += y[N + j] * HELD_ROW(j)[d];
    double whole = 0, left = 0;
    for (int d = 0; d < N; d++) {
        const double inertia = fabs(x->mass[d * N + d]), own = CONTACT_ROW(struck)[d];
        if (inertia > 0) whole += own * own / inertia, left += row[d] * row[d] / inertia;
    }
    if (whole > 0 && !(left > DEPENDENT * DEPENDENT * whole)) return 0;
    COPY(to, from, POINT);
    const double unit = sum_of(CONTACT_ROW(struck), y, N);
    double *const p = P_OF(to), *const rest_p = REST_OF(to) + N;
    const double rest = -(1 + e) * sum_of(y, rest_p, N) / unit; /* the rounding error of p is reflected, too */
    *impulse = (1 + e) * sense / unit;
    for (int d = 0; d < N; d++) {
        const double gain = *impulse * row[d], sum = p[d] + gain, part = sum - p[d];
        rest_p[d] += ((p[d] - (sum - part)) + (gain - part)) + rest * row[d];
        p[d] = sum, V_OF(to)[d] += *impulse * y[d];
    }
    return 1;
}

/* Time until a contact that just bounced closes again with accelerations that stay; `point` is seen. */
static double flight(Work *x, const double *point, int i) {
    double acceleration[N + x->held[0]];
    if (!factorise(x)) return 0;
    accelerate(x, acceleration);
    const double towards = -(x->bend[FIRST + i] + sum_of(CONTACT_ROW(i), acceleration, N));
    return towards > 0 ? 2 * fabs(RATE_OF(point)[i]) / towards : INFINITY;
}

INLINE int see(Work *x, double *point, double t) {
    look(x, point, t);
    if (!is_finite_point(point)) return 0;
    view(x, point, t);
    return 1;
}

/* Whether a contact holds just now. */
INLINE int is_held(const Work *x, int i) {
    for (int64_t j = 0; j < x->held[0]; j++)
        if (HELD(j) == FIRST + i) return 1;
    return 0;
}

/* One impact as `_impact` in impacts.py has it: the instant before becomes that after it; flights that become too short end at
   once, and what is `still` stays closed where it would open for such a one. What it was goes to `hit`. 0 where rows may depend on
   each other. */
static int strike(Work *x, double *point, double t, int struck, const int *still, double *hit) {
    const double shortest = ZENO * fabs(x->a->h);
    double to[POINT], e = x->restitution[struck], impulse, wait = 0, *told = hit + HIT_HEAD;
    int64_t before[1 + ROWS];
    int kept[CONTACTS], opened = 0;
    memcpy(before, x->held, sizeof before), memset(kept, 0, sizeof kept);
    if (!(length_of(x, FIRST + struck) > FLAT)) return 0;
    hit[1] = struck, hit[5] = x->energy;
    COPY(told, Q_OF(point), N), COPY(told + N, V_OF(point), N), COPY(told + 2 * N, P_OF(point), N);
    for (;;) {
        if (!reflect(x, point, struck, e, kept, to, &impulse) || !see(x, to, t)) return 0;
        opened = 0;
        for (int i = 0; i < CONTACTS; i++) {
            if (!still[i] || is_held(x, i) || !(RATE_OF(to)[i] > 0) || !(flight(x, to, i) <= shortest)) continue;
            kept[i] = opened = 1;
        }
        const double next = !opened && e > 0 ? flight(x, to, struck) : INFINITY;
        if (next <= shortest) wait = e < 1 ? next / (1 - e) : 0, e = 0;
        else if (!opened) break;
        take_held(x, before), view(x, point, t);
        for (int i = 0; i < CONTACTS; i++)
            if (kept[i] && !is_held(x, i)) add_held(x, i);
    }
    hit[2] = !(e > 0), hit[3] = t + wait, hit[4] = impulse, hit[6] = x->energy;
    COPY(told + 3 * N, V_OF(to), N), COPY(told + 4 * N, P_OF(to), N);
    COPY(point, to, POINT);
    return 1;
}

/* Of the contacts at rest, those that must push to stay closed; see `_holding` in impacts.py. */
static int hold(Work *x) {
    while (x->held[0] && HELD(x->held[0] - 1) >= FIRST) {
        const int held = (int)x->held[0];
        double acceleration[N + held], least = INFINITY;
        int pulled = -1;
        if (!factorise(x)) return 0;
        accelerate(x, acceleration);
        double most = hardly(x, acceleration);
        for (int j = 0; j < held; j++) {
            const double push = acceleration[N + j] * length_of(x, HELD(j));
            most = fmax(most, fabs(push));
            if (HELD(j) >= FIRST && push < least) least = push, pulled = j;
        }
        if (least >= -PULL * most) return 1;
        if (pulled < 0) return 0;
        release(x, pulled);
    }
    return 1;
}

/* All gaps that hold to zero, as the steps to come will have them; what else touches stays where it is. See `landed` in
   held.py. */
static int land(Work *x, double *point, double t, const int *closed) {
    const int64_t holding = x->held[0];
    int64_t kept[1 + ROWS];
    int at_zero = 1;
    for (int64_t j = 0; j < holding; j++)
        if (HELD(j) >= FIRST) at_zero &= fabs(GAP_OF(point)[HELD(j) - FIRST]) <= rounding(x, point, (int)(HELD(j) - FIRST));
    if (at_zero) return 1;
    memcpy(kept, x->held, sizeof kept);
    for (int i = 0; i < CONTACTS; i++)
        if (closed[i] && !is_held(x, i)) HELD(x->held[0]) = FIRST + i, x->held[0]++;
    double way[N + x->held[0]];
    for (int d = 0; d < N; d++) way[d] = 0;
    for (int64_t j = 0; j < x->held[0]; j++) way[N + j] = j < holding && HELD(j) >= FIRST ? -GAP_OF(point)[HELD(j) - FIRST] : 0;
    const int regular = factorise(x);
    if (regular) {
        substitute(x, way);
        for (int d = 0; d < N; d++) Q_OF(point)[d] += way[d];
    }
    take_held(x, kept);
    return regular && see(x, point, t);
}

/* Impacts of all that touches and approaches, the fastest first, then what stays closed; see `settle` in impacts.py. The number of
   events; -1 where this is not for here. What held as number `leaves` has just let go; -1: nothing has. */
static int settle(Work *x, double *point, double t, int leaves, double *hit) {
    double close[CONTACTS], quick[CONTACTS];
    int count = 0, closed[CONTACTS], holds[CONTACTS], still[CONTACTS], released = -1;
    view(x, point, t);
    if (leaves >= 0) {
        double *told = hit + HIT_HEAD;
        released = (int)(HELD(leaves) - FIRST), release(x, leaves), count = 1;
        hit[1] = released, hit[2] = 2, hit[3] = t, hit[4] = 0, hit[5] = hit[6] = x->energy;
        COPY(told, Q_OF(point), N), COPY(told + N, V_OF(point), N), COPY(told + 2 * N, P_OF(point), N);
        COPY(told + 3 * N, V_OF(point), N), COPY(told + 4 * N, P_OF(point), N);
    }
    closeness(x, Q_OF(point), x->reach, close);
    for (int i = 0; i < CONTACTS; i++) closed[i] = GAP_OF(point)[i] <= close[i], quick[i] = 0;
    for (;; count++) {
        int struck = -1;
        double fastest = 0;
        for (int i = 0; i < CONTACTS; i++) holds[i] = 0;
        for (int64_t j = 0; j < x->held[0]; j++)
            if (HELD(j) >= FIRST) holds[HELD(j) - FIRST] = 1;
        for (int i = 0; i < CONTACTS; i++) {
            quick[i] = fmax(quick[i], x->quick[i]);
            still[i] = closed[i] && fabs(RATE_OF(point)[i]) <= RESTING * quick[i];
            if (holds[i] || !closed[i] || !(RATE_OF(point)[i] < -RESTING * quick[i])) continue;
            const double comes = RATE_OF(point)[i] / quick[i];
            if (comes < fastest) fastest = comes, struck = i;
        }
        if (struck < 0) break;
        if (count == MOST_IMPACTS || !strike(x, point, t, struck, still, hit + count * HIT_SIZE)) return -1;
    }
    int64_t fixed = 0;
    while (fixed < x->held[0] && HELD(fixed) < FIRST) fixed++;
    x->held[0] = fixed;
    for (int i = 0; i < CONTACTS; i++)
        if (i != released && (holds[i] || (closed[i] && fabs(RATE_OF(point)[i]) <= RESTING * quick[i]))) HELD(x->held[0]) = FIRST + i, x->held[0]++;
    if (!hold(x) || !land(x, point, t, closed)) return -1;
    for (int i = 0; i < CONTACTS; i++) holds[i] = 0;
    for (int64_t j = fixed; j < x->held[0]; j++) holds[HELD(j) - FIRST] = 1;
    for (int k = 0; k < count; k++) { /* what bounces on is not stopped */
        double *const told = hit + k * HIT_SIZE;
        if (told[2] == 1 && !holds[(int)told[1]]) told[2] = 0, told[3] = t;
        COPY(told + HIT_HEAD, Q_OF(point), N);
    }
    return count;
}
