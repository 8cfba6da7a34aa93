/* Gaps along a step: bounds that show that they stay open, and the instant at which one closes: a part of contacts.c. They are
   bounded from the two ends of a step, as in varint/integration/events/enclosures.py. */

/* Least value in [0, far] of value + slope s + bend s^2/2. */
INLINE double lowest(double value, double slope, double bend, double far) {
    double turn = far;
    if (bend > 0) {
        turn = -slope / bend;
        turn = turn < 0 ? 0 : turn > far ? far : turn;
    }
    return fmin(value, value + turn * (slope + turn * bend / 2));
}

/* Lower bounds of every gap between two instants; see `lower_bound` in enclosures.py. */
static void least_gaps(const Work *x, const double *left, const double *right, double t, double *least) {
    double low[CONTACTS], rate_low[CONTACTS], rate_high[CONTACTS], bends[CONTACTS];
    const double w = right[0] - left[0], begin = t + left[0];
    bounds(Q_OF(left), V_OF(left), Q_OF(right), V_OF(right), &begin, &w, x->w + BOUNDS_AT, low, rate_low, rate_high, bends);
    for (int i = 0; i < CONTACTS; i++) {
        const double a = GAP_OF(left)[i], b = GAP_OF(right)[i], ra = RATE_OF(left)[i] * w, rb = RATE_OF(right)[i] * w;
        const double one = rate_low[i] * w, other = rate_high[i] * w, down = fmin(one, other), up = fmax(one, other);
        const double cone = down >= 0 ? a : up <= 0 ? b : a + down * clipped((b - up - a) / (down - up));
        const double bend = bends[i] * w * w, s = clipped((b + bend / 2 - rb - a) / (ra - rb + bend));
        const double parabola = fmin(lowest(a, ra, bend, s), lowest(b, -rb, bend, 1 - s));
        least[i] = fmax(fmax(low[i], cone), parabola);
    }
}

/* Gradients, masses, forces and energy at an instant, and what the velocities, and typical ones, contribute to each
   rate. */
static void view(Work *x, const double *point, double t) {
    double typical = 0;
    for (int d = 0; d < N; d++) typical = fmax(typical, x->scale[d]);
    blow(Q_OF(point), V_OF(point), &t, x->w + BLOW_AT, x->slope, x->mass, x->force, x->bend, &x->energy, x->restitution);
    for (int i = 0; i < CONTACTS; i++) {
        double along = 0, size = 0, lengths = 0;
        for (int d = 0; d < N; d++) {
            const double part = CONTACT_ROW(i)[d] * V_OF(point)[d];
            along += part, size += fabs(part), lengths += fabs(CONTACT_ROW(i)[d]);
        }
        x->quick[i] = fmax(size + fabs(RATE_OF(point)[i] - along), NEAR * typical * lengths);
    }
}

/* How small a gap is closed: where the coordinates are, and how far they move. */
static void closeness(const Work *x, const double *q, const double *moved, double *close) {
    double far = 0;
    for (int d = 0; d < N; d++) far = fmax(far, fmax(fabs(q[d]), moved[d]));
    for (int i = 0; i < CONTACTS; i++) {
        close[i] = 0;
        for (int d = 0; d < N; d++)
            close[i] += TOUCH * fabs(CONTACT_ROW(i)[d]) * fmax(fmax(fabs(q[d]), NEAR * far), moved[d]);
    }
}

INLINE int is_closed(const double *point, int i, double close) {
    const double gap = GAP_OF(point)[i];
    return gap < -close || (gap < 0 && RATE_OF(point)[i] < 0);
}

/* Round-off of gap i: below it a gap is zero. */
static double rounding(const Work *x, const double *point, int i) {
    double sum = 0;
    for (int d = 0; d < N; d++) sum += fabs(CONTACT_ROW(i)[d] * Q_OF(point)[d]);
    return ROUND_OFF * sum;
}

/* Where a gap closes again that rises from a at the rate ra: at zero, or where it began below; see `level_of` in gaps.py. */
INLINE double level_of(double a, double b, double ra, double rb) {
    const double low = fmin(a, 0), bend = 3 * (b - a) - 2 * ra - rb;
    return ra * ra <= 8 * low * bend ? low : 0;
}

/* Where gap i closes, open at one instant and closed at a later one, which becomes the instant of the impact; 0 where that
   is not found. */
static int closing(Work *x, const double *from, double t, int i, const double *left, double *right) {
    double a = left[0], fa = GAP_OF(left)[i], ra = RATE_OF(left)[i], b = right[0], fb = GAP_OF(right)[i], rb = RATE_OF(right)[i];
    double level = 0;
    if (fa <= x->close[i]) { /* it has just bounced: the other zero is wanted */
        if (!(ra > 0)) {
            COPY(right, left, POINT);
            return 1;
        }
        level = level_of(fa, fb, ra * (b - a), rb * (b - a)), fa = 0;
    }
    fb -= level;
    const double tolerance = LOCATED * fmax(fabs(a), fabs(b));
    double f = fb;
    for (int k = 0; k < GAP_ITERATIONS; k++) {
        const double at = a + (b - a) * cubic_root(fa, fb, ra * (b - a), rb * (b - a), NEWTON, LOCATED);
        if (!ahead_by(x, from, t, at, right)) return 0;
        f = GAP_OF(right)[i] - level;
        const double r = RATE_OF(right)[i];
        if (fabs(f) <= fmax(fabs(r) * tolerance, rounding(x, right, i))) return 1;
        if (fabs(b - a) <= tolerance) break;
        if (f < 0) b = at, fb = f, rb = r;
        else a = at, fa = f, ra = r;
    }
    return fabs(f) <= x->close[i];
}

enum Found { NONE, HIT, LEAVES, DOUBT };

/* Whether gap i closes between two instants, and then the instant where it does first in place of the later one. Where bounds
   leave it in doubt, the halves are looked at. */
static int first_between(Work *x, const double *from, double t, int i, const double *left, double *right, double shortest, int found) {
    double least[CONTACTS], middle[POINT];
    if (!found && is_closed(right, i, x->close[i])) {
        if (!closing(x, from, t, i, left, right)) return DOUBT;
        found = HIT;
    }
    least_gaps(x, left, right, t, least);
    if (least[i] >= -x->close[i] || fabs(right[0] - left[0]) <= shortest) return found;
    if (!ahead_by(x, from, t, (left[0] + right[0]) / 2, middle)) return DOUBT;
    double later[POINT];
    COPY(later, middle, POINT);
    const int earlier = first_between(x, from, t, i, left, middle, shortest, NONE);
    if (earlier) {
        COPY(right, middle, POINT);
        return earlier;
    }
    return first_between(x, from, t, i, later, right, shortest, found);
}

/* Of the instants 2^-k of the way ahead, the first at which a gap at rest is not zero. */
static int leaving(Work *x, const double *from, double t, const double *end, int i, double *open) {
    double earlier[POINT];
    COPY(open, end, POINT);
    for (double part = 0.5; part > SHORTEST; part /= 2) {
        if (!ahead_by(x, from, t, end[0] * part, earlier)) return 0;
        if (fabs(GAP_OF(earlier)[i]) <= x->close[i]) break;
        COPY(open, earlier, POINT);
    }
    return 1;
}

/* The box around so many steps from node k on: least and largest coordinates of the cubics through their ends, see `boxes` in
   enclosures.py, and times. Whether all its numbers are some. */
static int box_around(const ContactArguments *a, int64_t k, int64_t steps, const double *rows, double *box) {
    const double third = a->h / 3;
    double zero = 0;
    for (int d = 0; d < N; d++) {
        const double *x = rows + d;
        double least = x[0], most = x[0], error = 0;
        for (int64_t i = 0; i < steps; i++, x += 3 * N) {
            const double q0 = x[0], q1 = x[3 * N], v0 = x[2 * N], v1 = x[5 * N], left = q0 + third * v0, right = q1 - third * v1;
            const double off = fabs(12 * (q0 - q1) + 6 * a->h * (v0 + v1));
            least = LEAST(LEAST(least, q1), LEAST(left, right)), most = MOST(MOST(most, q1), MOST(left, right));
            error = MOST(error, off), zero += (off + x[4 * N]) * 0.0;
        }
        box[d] = least - PATH_ERROR * error, box[N + d] = most + PATH_ERROR * error;
    }
    box[2 * N] = a->t0 + a->h * (double)k, box[2 * N + 1] = a->t0 + a->h * (double)(k + steps);
    return zero == 0;
}

/* Of so many boxes, whether all gaps that do not hold are certainly open there: 0 where that is not so. */
static int all_open(const Work *x, int64_t count, double *open) {
    const double *const box = x->boxes;
    const RowsArguments those = {count, x->a->c, &scene->floors, {box, box + N, box + 2 * N, box + 2 * N + 1},
                                 {BOX, BOX, BOX, BOX}, {x->floors}, {CONTACTS}};
    if (x->a->many(&those) != DONE) return 0;
    for (int64_t i = 0; i < count; i++)
        for (int j = 0; j < CONTACTS; j++) /* 0: a root cut off */
            if (!(x->a->holds[j] || x->floors[i * CONTACTS + j] > 0)) open[i] = 0;
    return 1;
}

/* Of steps from node k on, whether each certainly leaves all gaps open that do not hold: floors of the gaps, of some steps in
   one box, and of each of these where that is not enough. `first_impact` looks at the others. */
static void clear_steps(const Work *x, int64_t k, int64_t steps, const double *rows) {
    const int64_t row = 3 * N, groups = (steps + IN_A_BOX - 1) / IN_A_BOX;
    double open[MOST_STEPS];
    int64_t asked = 0, which[MOST_STEPS];
    for (int64_t g = 0; g < groups; g++) {
        const int64_t i = g * IN_A_BOX, count = steps - i < IN_A_BOX ? steps - i : IN_A_BOX;
        open[g] = box_around(x->a, k + i, count, rows + row * i, x->boxes + g * BOX);
    }
    if (!all_open(x, groups, open)) memset(open, 0, sizeof open);
    for (int64_t i = 0; i < steps; i++) {
        x->clear[i] = open[i / IN_A_BOX];
        if (x->clear[i]) continue;
        x->clear[i] = box_around(x->a, k + i, 1, rows + row * i, x->boxes + asked * BOX);
        which[asked++] = i;
    }
    for (int64_t i = 0; i < asked; i++) open[i] = x->clear[which[i]];
    if (!asked) return;
    if (!all_open(x, asked, open)) memset(open, 0, sizeof open);
    for (int64_t i = 0; i < asked; i++) x->clear[which[i]] = open[i];
}

/* The first impact in a step from one instant to another, as the instant `at`; gaps within `close` of zero touch. */
static int first_impact(Work *x, const double *from, double t, const double *end, double *at) {
    double least[CONTACTS], instant[POINT], open[POINT];
    int found = NONE, clear = 1;
    least_gaps(x, from, end, t, least);
    for (int i = 0; i < CONTACTS; i++)
        clear &= x->a->holds[i] || (least[i] >= -x->close[i] && !is_closed(end, i, x->close[i]));
    if (clear) return NONE;
    x->looks = 0, view(x, from, t);
    for (int i = 0; i < CONTACTS; i++) {
        if (x->a->holds[i] || (least[i] >= -x->close[i] && !is_closed(end, i, x->close[i]))) continue;
        COPY(open, from, POINT), COPY(instant, end, POINT);
        if (GAP_OF(from)[i] <= x->close[i] && fabs(RATE_OF(from)[i]) <= RESTING * x->quick[i]) {
            if (!leaving(x, from, t, end, i, open) || GAP_OF(open)[i] < -x->close[i]) return DOUBT; /* one that sinks must hold */
        }
        const int closes = first_between(x, from, t, i, open, instant, fabs(end[0]) * SHORTEST, NONE);
        if (closes == DOUBT) return DOUBT;
        if (closes && (!found || instant[0] < at[0])) COPY(at, instant, POINT), found = HIT;
    }
    return found;
}
