/* Bodies that fly between impacts: steps of a loop (run.h) as long as every gap certainly stays open, impacts located
   within a step by shorter steps of the same rule, and Newton's law of restitution there.

   The same as varint/integration/events does in general, for rows that are clearly independent: blows that come together are
   dealt one after the other, then it is found what holds. Another set has another loop, which is asked for; the run ends SETTLED
   where there is none, and BESIDE where this is not enough. Gaps along a step are bounded from its two ends (enclosures.py), so that none closes and opens
   again unseen. */

enum Ended { ENDED, FULL, BESIDE, SETTLED };
#define MOST_STEPS 256 /* between two looks at the gaps */
#define FEW_STEPS 16   /* after an impact */
#define TOGETHER 4     /* so many steps or more are looked at together */
#define IN_A_BOX 8     /* so many of them in one box */
#define BOX (2 * N + 2)
#define ROUND_OFF 0x1p-52 /* of what adds up */
#define REGULAR 1e-10  /* pivots of scaled equations: below, rows may depend on each other */
#define NUMBERS (5 * N) /* q, p, v and the rounding errors of q and p */
#define POINT (1 + NUMBERS + 2 * CONTACTS)
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))

/* varint/codegen/contacts.py has the same layouts */
typedef struct {
    int (*run)(const RunArguments *);
    const void *loop;                       /* its scene, where that is data */
    int (*many)(const RowsArguments *);     /* a tape at many points, see rows_core.c */
    int64_t carry_size;                     /* of the loop */
    int64_t last, save_every, most;         /* the last node of the grid; iterations of a step */
    int64_t room, hits, steps;              /* rows and hits that have room; steps after which the call ends */
    int64_t begins;                         /* whether the motion begins at that instant, which becomes a node */
    double t0, h, level;
    int64_t held;                           /* rows that hold: constraints, and contacts that push */
    const int64_t *rows_held;               /* which */
    int64_t *holds;                         /* of each contact whether it is closed for now; where the run is SETTLED, then */
    const double *c, *scale;                /* typical sizes of velocities and momenta */
    double *state;                          /* k, t, impacts in step k, steps of the next look; q, p, v, rests of q and p; carry */
    double *rows;                           /* t, k, q, p, v of every node */
    double *hit;                            /* row, contact, whether it is stopped (1) or lets go (2), when, impulse, energies, q, v and p before,
                                               v and p after */
    double *stats;                          /* rows, hits, iterations, residual; whether an instant was located, before blows
                                               that are not for here, or SETTLED, when, whether its step ends there, q, p, v,
                                               rests of q and p; its hits have the row that would follow */
    const void *scene;
    int (*change)(int64_t row, int64_t k, int64_t last); /* other contacts hold from a row on, in step k of a run of so many: as SETTLED
                                               says it in `holds` and `stats`. Whether there is a loop for them, then in `begun`; none
                                               where it is 0 */
    const int64_t *begun;                   /* its loop, the loop's scene, memory of what it carries, twice, its size, how many
                                               rows hold, which */
    const double *sizes;                    /* velocities then, typical sizes */
    int64_t fewer;                          /* steps of a run that comes first, a whole part of them; none where it is 0 */
    double *apart;                          /* how far it is; infinitely where one of them does not end */
} ContactArguments;

#define STATE_Q 4
#define HIT_HEAD 7
#define HIT_SIZE (HIT_HEAD + 5 * N)
#define ROW_SIZE (2 + 3 * N)

typedef struct {
    const ContactArguments *a;
    int (*run)(const RunArguments *);       /* of what holds just now */
    const void *loop;
    const double *scale;
    const double *w;
    double *carry, *ends, *told, *close;    /* of shorter steps; told: RunStats */
    double *slope, *mass, *force, *bend, *quick, *reach; /* reach: how far each coordinate moves in a step */
    double *factors, *size;                 /* of the equations of motion, and what they are scaled by */
    double *restitution;
    double *boxes, *floors, *clear;         /* of steps: where they lie, floors of the gaps, whether no gap may close */
    int *pivots;
    int64_t *held;                          /* how many rows hold just now, then which: those of constraints first */
    double iterations, residual, energy;
    int looks;
} Work;

/* An instant of the motion: how far ahead, then q, p and v, rounding errors of q and p, gaps, rates. */
#define Q_OF(x) ((x) + 1)
#define P_OF(x) ((x) + 1 + N)
#define V_OF(x) ((x) + 1 + 2 * N)
#define REST_OF(x) ((x) + 1 + 3 * N)
#define GAP_OF(x) ((x) + 1 + NUMBERS)
#define RATE_OF(x) ((x) + 1 + NUMBERS + CONTACTS)
#define HELD(j) x->held[1 + (j)]
#define HELD_ROW(j) (x->slope + HELD(j) * N)
#define FIRST (ROWS - CONTACTS) /* row of the first contact */
#define CONTACT_ROW(i) (x->slope + (FIRST + (i)) * N)

INLINE double sum_of(const double *x, const double *y, int count) {
    double s = 0;
    for (int d = 0; d < count; d++) s += x[d] * y[d];
    return s;
}

#define LEAST(x, y) ((x) < (y) ? (x) : (y))
#define MOST(x, y) ((x) > (y) ? (x) : (y))

INLINE double clipped(double x) { return x > 0 ? x < 1 ? x : 1 : x == x ? 0 : 0.5; }

INLINE void look(const Work *x, double *point, double t) {
    gaps(Q_OF(point), V_OF(point), &t, x->w + GAPS_AT, GAP_OF(point), RATE_OF(point));
}

INLINE int is_finite_point(const double *point) { return unsound(point, POINT) == 0; }

static void begin_afresh(const Work *x, double *carry, const double *v) {
    carry[0] = 0;
    COPY(carry + 1, x->scale, 2 * N), COPY(carry + 1 + 2 * N, v, N);
}

/* The instant so much later, by one step of that size; 0 where it cannot be solved. */
static int ahead_by(Work *x, const double *from, double t, double ahead, double *to) {
    const ContactArguments *a = x->a;
    if (++x->looks > MOST_LOOKS) return 0;
    begin_afresh(x, x->carry, V_OF(from));
    double rests[4 * N];
    COPY(rests, REST_OF(from), 2 * N);
    const RunArguments one = {1, 1, 0, a->most, t, ahead, a->level, from + 1, a->c, 0, x->ends, x->carry, (RunStats *)x->told,
                              x->loop, 0, rests};
    const int status = x->run(&one);
    to[0] = ahead;
    COPY(to + 1, x->ends + 3 * N, 3 * N), COPY(REST_OF(to), rests + 2 * N, 2 * N);
    if (status != DONE || !(((RunStats *)x->told)->residual <= RESIDUAL_LIMIT)) return 0;
    look(x, to, t + ahead);
    return is_finite_point(to);
}

INLINE void count_step(Work *x) {
    const RunStats *s = (RunStats *)x->told;
    x->iterations += s->iterations, x->residual = fmax(x->residual, s->residual);
}

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

/* Where gap i closes, open at one instant and closed at a later one, which becomes the instant of the impact; 0 where that
   is not found. */
static int closing(Work *x, const double *from, double t, int i, const double *left, double *right) {
    double a = left[0], fa = GAP_OF(left)[i], ra = RATE_OF(left)[i], b = right[0], fb = GAP_OF(right)[i], rb = RATE_OF(right)[i];
    if (fa <= x->close[i]) { /* it has just bounced: the other zero is wanted */
        if (!(ra > 0)) {
            COPY(right, left, POINT);
            return 1;
        }
        fa = 0;
    }
    const double tolerance = LOCATED * fmax(fabs(a), fabs(b));
    double f = fb;
    for (int k = 0; k < GAP_ITERATIONS; k++) {
        const double at = a + (b - a) * cubic_root(fa, fb, ra * (b - a), rb * (b - a), NEWTON, LOCATED);
        if (!ahead_by(x, from, t, at, right)) return 0;
        f = GAP_OF(right)[i];
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

/* The equations M y - W' m = b, W y = c of all that holds, factorised; scaled as `_saddle` in impacts.py. 0 where they
   are not regular. */
static int factorise(Work *x) {
    const int held = (int)x->held[0], all = N + held;
    double *const f = x->factors, *const size = x->size, largest = 0;
    for (int d = 0; d < N; d++) size[d] = sqrt(fabs(x->mass[d * N + d])), largest = fmax(largest, size[d]);
    for (int d = 0; d < N; d++) size[d] = size[d] > 0 ? size[d] : largest;
    memset(f, 0, (size_t)(all * all) * sizeof(double));
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) f[i * all + j] = x->mass[j * N + i] / (size[i] * size[j]);
    for (int j = 0; j < held; j++) {
        const double *const row = HELD_ROW(j);
        double square = 0;
        for (int d = 0; d < N; d++) square += row[d] / size[d] * (row[d] / size[d]);
        size[N + j] = square > 0 ? sqrt(square) : 1;
        for (int d = 0; d < N; d++) f[(N + j) * all + d] = row[d] / size[d] / size[N + j], f[d * all + N + j] = -f[(N + j) * all + d];
    }
    for (int c = 0; c < all; c++) {
        int best = c;
        for (int r = c + 1; r < all; r++)
            if (fabs(f[r * all + c]) > fabs(f[best * all + c])) best = r;
        x->pivots[c] = best;
        if (!(fabs(f[best * all + c]) > REGULAR)) return 0;
        for (int j = c; j < all && best != c; j++) { /* factors stay in their rows: `substitute` swaps as it goes */
            const double y = f[c * all + j];
            f[c * all + j] = f[best * all + j], f[best * all + j] = y;
        }
        for (int r = c + 1; r < all; r++) {
            const double y = f[r * all + c] /= f[c * all + c];
            for (int j = c + 1; j < all && y != 0; j++) f[r * all + j] -= y * f[c * all + j];
        }
    }
    return 1;
}

static void substitute(const Work *x, double *b) {
    const int all = N + (int)x->held[0];
    const double *const f = x->factors;
    for (int i = 0; i < all; i++) b[i] /= x->size[i];
    for (int i = 0; i < all; i++) {
        const double y = b[x->pivots[i]];
        b[x->pivots[i]] = b[i], b[i] = y;
        for (int r = i + 1; r < all; r++) b[r] -= f[r * all + i] * y;
    }
    for (int i = all - 1; i >= 0; i--) {
        for (int j = i + 1; j < all; j++) b[i] -= f[i * all + j] * b[j];
        b[i] /= f[i * all + i];
    }
    for (int i = 0; i < all; i++) b[i] /= x->size[i];
}

/* Accelerations, and behind them the multipliers of what holds; after `view` and `factorise`. */
static void accelerate(const Work *x, double *b) {
    COPY(b, x->force, N);
    for (int j = 0; j < x->held[0]; j++) b[N + j] = -x->bend[HELD(j)];
    substitute(x, b);
}

/* Forces that move other bodies: a push that is little beside them is none. */
static double hardly(const Work *x, const double *acceleration) {
    double most = 0;
    for (int d = 0; d < N; d++) {
        double force = 0;
        for (int k = 0; k < N; k++) force += x->mass[k * N + d] * acceleration[k];
        most = fmax(most, NEAR * fabs(force));
    }
    return most;
}

/* Whether a contact that holds would pull at an instant. */
static int lets_go(Work *x, const double *point, double t) {
    const int64_t held = x->held[0];
    double acceleration[N + held], least = 0;
    if (!held || HELD(held - 1) < FIRST) return 0;
    view(x, point, t);
    if (!factorise(x)) return 1;
    accelerate(x, acceleration);
    double most = hardly(x, acceleration);
    for (int j = 0; j < held; j++) {
        const double push = acceleration[N + j];
        most = fmax(most, fabs(push));
        if (HELD(j) >= FIRST) least = fmin(least, push);
    }
    return !(least >= -PULL * most);
}

/* Multiplier of the row that holds as number j at an instant, and what is nothing beside other forces; no number where the rows
   are not regular. */
static double push_of(Work *x, const double *point, double t, int j, double *nothing) {
    double acceleration[N + x->held[0]];
    view(x, point, t);
    if (!factorise(x)) return 0 * INFINITY;
    accelerate(x, acceleration);
    *nothing = PULL * hardly(x, acceleration);
    return acceleration[N + j];
}

/* When the contact that holds as number j begins to pull; see `release_time` in gaps.py and `find_root` in roots.py. */
static int release_time(Work *x, const double *from, double t, const double *end, int j, double *at) {
    double nothing, a = 0, b = end[0], fb = push_of(x, end, t + b, j, &nothing), fa;
    if (!(fb < -nothing)) return NONE;
    fa = push_of(x, from, t, j, &nothing), x->looks = 0;
    if (fa != fa) return DOUBT;
    COPY(at, from, POINT), at[0] = 0;
    if (!(fa > 0)) return LEAVES;
    const double tolerance = LOCATED * fabs(b);
    for (int k = 0; k < ROOT_ITERATIONS; k++) {
        double c = b - fb * (b - a) / (fb - fa);
        if (!(fmin(a, b) < c && c < fmax(a, b))) c = (a + b) / 2;
        if (!ahead_by(x, from, t, c, at)) return DOUBT;
        const double fc = push_of(x, at, t + c, j, &nothing);
        if (fc != fc) return DOUBT;
        if (fc == 0 || fabs(b - a) <= tolerance) break;
        if (fc * fb < 0) a = b, fa = fb;
        else fa /= 2;
        b = c, fb = fc;
        if (fabs(b - a) <= tolerance) break;
    }
    return LEAVES;
}

/* The first of the contacts that hold to let go in a step, as its number there, and the instant. */
static int first_release(Work *x, const double *from, double t, const double *end, double *at, int *first) {
    double instant[POINT];
    int found = NONE;
    for (int j = 0; j < x->held[0]; j++) {
        if (HELD(j) < FIRST) continue;
        const int lets = release_time(x, from, t, end, j, instant);
        if (lets == DOUBT) return DOUBT;
        if (lets == LEAVES && (!found || instant[0] < at[0])) COPY(at, instant, POINT), found = LEAVES, *first = j;
    }
    return found ? found : DOUBT;
}

INLINE void take_held(Work *x, const int64_t *held) { memcpy(x->held, held, (size_t)(1 + ROWS) * sizeof(int64_t)); }

INLINE void release(Work *x, int j) {
    for (int64_t k = j; k + 1 < x->held[0]; k++) HELD(k) = HELD(k + 1);
    x->held[0]--;
}

INLINE double length_of(const Work *x, int64_t row) { return sqrt(sum_of(x->slope + row * N, x->slope + row * N, N)); }

/* The blow that turns the rate r of a contact to -e r: what holds takes its part of it, elastic contacts hand it on, and
   others let go where they would be pulled, unless all stay closed. The same as `_reflect` in impacts.py; `from` is seen. */
static int reflect(Work *x, const double *from, int struck, double e, int sticks, double *to, double *impulse) {
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
            if (HELD(j) < FIRST) continue;
            const double felt = copysign(1, sense) * y[N + j] * length_of(x, HELD(j)) / most;
            if (felt < least) least = felt, pulled = j;
        }
        for (int j = held - 1; j >= 0; j--)
            if (HELD(j) >= FIRST && x->restitution[HELD(j) - FIRST] > 0 && fabs(y[N + j]) * length_of(x, HELD(j)) / most > PULL)
                release(x, j), handed = 1;
        if (handed) continue;
        if (sticks || !(least < -PULL)) break;
        release(x, pulled);
    }
    COPY(row, CONTACT_ROW(struck), N);
    for (int j = 0; j < x->held[0]; j++)
        for (int d = 0; d < N; d++) row[d] += y[N + j] * HELD_ROW(j)[d];
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

/* One impact as `_impact` in impacts.py has it: the instant before becomes that after it; flights that become too short end at
   once. What it was goes to `hit`. 0 where rows may depend on each other. */
static int strike(Work *x, double *point, double t, int struck, double *hit) {
    const double shortest = ZENO * fabs(x->a->h);
    double to[POINT], e = x->restitution[struck], impulse, wait = 0, *told = hit + HIT_HEAD;
    int64_t before[1 + ROWS];
    memcpy(before, x->held, sizeof before);
    if (!(length_of(x, FIRST + struck) > FLAT)) return 0;
    hit[1] = struck, hit[5] = x->energy;
    COPY(told, Q_OF(point), N), COPY(told + N, V_OF(point), N), COPY(told + 2 * N, P_OF(point), N);
    if (!reflect(x, point, struck, e, 0, to, &impulse) || !see(x, to, t)) return 0;
    int rocks = 0; /* and that dies out */
    for (int64_t j = 0, k = 0; j < before[0]; j++) {
        if (k < x->held[0] && HELD(k) == before[1 + j]) {
            k++;
            continue;
        }
        const int i = (int)(before[1 + j] - FIRST);
        rocks |= x->restitution[i] == 0 && RATE_OF(to)[i] > 0 && flight(x, to, i) <= shortest;
    }
    if (rocks) {
        take_held(x, before);
        if (!reflect(x, point, struck, e, 1, to, &impulse) || !see(x, to, t)) return 0;
    }
    if (e > 0) {
        const double next = flight(x, to, struck);
        if (next <= shortest) {
            wait = e < 1 ? next / (1 - e) : 0, e = 0;
            take_held(x, before);
            if (!reflect(x, point, struck, e, 0, to, &impulse) || !see(x, to, t)) return 0;
        }
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

/* Impacts of all that touches and approaches, the fastest first, then what stays closed; see `settle` in impacts.py. The number of
   events; -1 where this is not for here. What held as number `leaves` has just let go; -1: nothing has. */
static int settle(Work *x, double *point, double t, int leaves, double *hit) {
    double close[CONTACTS], quick[CONTACTS];
    int count = 0, closed[CONTACTS], holds[CONTACTS], released = -1;
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
            if (holds[i] || !closed[i] || !(RATE_OF(point)[i] < -RESTING * quick[i])) continue;
            const double comes = RATE_OF(point)[i] / quick[i];
            if (comes < fastest) fastest = comes, struck = i;
        }
        if (struck < 0) break;
        if (count == MOST_IMPACTS || !strike(x, point, t, struck, hit + count * HIT_SIZE)) return -1;
    }
    int64_t fixed = 0;
    while (fixed < x->held[0] && HELD(fixed) < FIRST) fixed++;
    x->held[0] = fixed;
    for (int i = 0; i < CONTACTS; i++)
        if (i != released && (holds[i] || (closed[i] && fabs(RATE_OF(point)[i]) <= RESTING * quick[i]))) HELD(x->held[0]) = FIRST + i, x->held[0]++;
    if (!hold(x)) return -1;
    for (int i = 0; i < CONTACTS; i++) holds[i] = 0;
    for (int64_t j = fixed; j < x->held[0]; j++) holds[HELD(j) - FIRST] = 1;
    for (int k = 0; k < count; k++) { /* what bounces on is not stopped */
        double *const told = hit + k * HIT_SIZE;
        if (told[2] == 1 && !holds[(int)told[1]]) told[2] = 0;
    }
    return count;
}

/* Steps until a gap closes as it would with accelerations that stay. */
static double steps_ahead(Work *x, const double *point) {
    double acceleration[N + x->held[0]], ahead = INFINITY;
    if (!factorise(x)) return ahead;
    accelerate(x, acceleration);
    for (int i = 0; i < CONTACTS; i++) {
        if (x->a->holds[i]) continue;
        const double gap = fmax(GAP_OF(point)[i], 0), rate = RATE_OF(point)[i];
        const double bend = x->bend[FIRST + i] + sum_of(CONTACT_ROW(i), acceleration, N);
        const double inside = rate * rate - 2 * bend * gap;
        if (!(inside >= 0) || (rate >= 0 && bend >= 0)) continue;
        const double q = sqrt(inside), closes = rate < 0 ? 2 * gap / (q - rate) : -(rate + q) / bend;
        ahead = fmin(ahead, closes / x->a->h);
    }
    return ahead;
}

/* How far each coordinate moves in a step. */
INLINE void reaches(Work *x) {
    for (int d = 0; d < N; d++) x->reach[d] = fabs(x->a->h) * x->scale[d];
}

/* The loop of other contacts that hold, which is there; what it carries along. */
static double *take_begun(Work *x) {
    const int64_t *const begun = x->a->begun;
    x->run = (int (*)(const RunArguments *))(size_t)begun[0], x->loop = (const void *)(size_t)begun[1];
    double *const carry = (double *)(size_t)begun[2];
    x->carry = carry + begun[3];
    x->held[0] = begun[4], memcpy(x->held + 1, begun + 5, (size_t)begun[4] * sizeof(int64_t));
    x->scale = x->a->sizes + N, reaches(x);
    return carry;
}

/* Whether node k is kept; `due` is the first that is, from some node behind it on. */
INLINE int is_kept(const ContactArguments *a, int64_t k, int64_t *due) {
    if (k > *due) *due = (k + a->save_every - 1) / a->save_every * a->save_every;
    return k == *due || k == a->last;
}

INLINE void keep(double *row, double t, int64_t k, const double *state) {
    row[0] = t, row[1] = (double)k;
    COPY(row + 2, state, 3 * N);
}

static int whole_run(const ContactArguments *a) {
    scene = a->scene;
    const int64_t stats_size = (int64_t)(sizeof(RunStats) / sizeof(double)) + 3 * N;
    const int64_t all = N + ROWS;
    const int64_t sizes[] = {a->carry_size, 6 * N, stats_size, CONTACTS, ROWS * N, N * N, N, ROWS, CONTACTS, N, all * all, all,
                             5 * N * (MOST_STEPS + 1), ALL_W, CONTACTS, BOX * MOST_STEPS, CONTACTS * MOST_STEPS, MOST_STEPS};
    double *part[sizeof sizes / sizeof *sizes];
    int64_t total = 0;
    for (int i = 0; i < (int)(sizeof sizes / sizeof *sizes); i++) total += sizes[i];
    double *const memory = malloc((size_t)total * sizeof(double));
    if (!memory) return BESIDE;
    total = 0;
    for (int i = 0; i < (int)(sizeof sizes / sizeof *sizes); i++) part[i] = memory + total, total += sizes[i];
    double *const rows = part[12], *const rests = rows + 3 * N * (MOST_STEPS + 1), *const w = part[13];
    int pivots[all];
    int64_t held[1 + ROWS], known[1 + ROWS];
    Work work = {a, a->run, a->loop, a->scale, w, part[0], part[1], part[2], part[3], part[4], part[5], part[6], part[7], part[8], part[9], part[10], part[11],
                 part[14], part[15], part[16], part[17], pivots, held, 0, 0, 0, 0};
    Work *const x = &work;
    double *const state = a->state, *carry = state + STATE_Q + NUMBERS, *row = a->rows, *hit = a->hit;
    int64_t k = (int64_t)state[0], due = 0, steps = 0;
    double now[POINT], end[POINT], at[POINT], before[POINT], moved[N];
    a->stats[4] = 0;
    memset(held, 0, sizeof held);
    held[0] = a->held, memcpy(held + 1, a->rows_held, (size_t)a->held * sizeof(int64_t)), memcpy(known, held, sizeof held);
    int status = FULL;
    prepare_tape(&scene->gaps, a->c, w + GAPS_AT), prepare_tape(&scene->bounds, a->c, w + BOUNDS_AT);
    prepare_tape(&scene->blow, a->c, w + BLOW_AT);
    double *const t = state + 1, *const impacts = state + 2, *const next = state + 3;
    reaches(x);
    now[0] = 0;
    COPY(now + 1, state + STATE_Q, NUMBERS);
    look(x, now, *t);
    int begins = (int)a->begins;
    while (k < a->last && status == FULL) {
        if ((row - a->rows) / ROW_SIZE + MOST_STEPS + 2 > a->room || (hit - a->hit) / HIT_SIZE + MOST_IMPACTS + 1 > a->hits || steps >= a->steps) break;
        int found = NONE, leaves = -1;
        view(x, now, *t);
        if (begins) { /* what touches and approaches bounces at once, what rests and must push holds */
            found = HIT;
            COPY(at, now, POINT);
        } else if (*t == a->t0 + a->h * (double)k) { /* steps of the grid until something may close */
            const double many = fmin(fmin(*next, (double)(a->last - k)), floor(steps_ahead(x, now)) + 1);
            const int64_t count = many > 1 ? (int64_t)many : 1;
            closeness(x, Q_OF(now), x->reach, x->close);
            if (carry[0] == 0) begin_afresh(x, carry, V_OF(now)), COPY(rests, REST_OF(now), 2 * N);
            const RunArguments some = {count, 1, k, a->most, a->t0, a->h, a->level, now + 1, a->c, 0, rows, carry,
                                       (RunStats *)x->told, x->loop, 0, rests};
            x->run(&some);
            const RunStats *const told = (RunStats *)x->told;
            const int64_t good = (int64_t)told->steps;
            x->iterations += told->iterations, x->residual = fmax(x->residual, told->residual); /* shorter steps tell theirs there */
            const int rests_on = held[0] && held[held[0]] >= FIRST; /* what holds may let go */
            const int together = good >= TOGETHER && !rests_on;
            int64_t passed = 0, looked = 0; /* node whose gaps are known */
            if (together) clear_steps(x, k, good, rows);
            for (; passed < good; passed++) {
                const double *const reached = rows + 3 * N * (passed + 1), *const rest = rests + 2 * N * (passed + 1);
                const double then = a->t0 + a->h * (double)(k + 1);
                if (!together || !x->clear[passed]) {
                    if (looked != passed) COPY(now + 1, reached - 3 * N, 3 * N), COPY(REST_OF(now), rest - 2 * N, 2 * N), look(x, now, *t);
                    end[0] = a->h;
                    COPY(end + 1, reached, 3 * N), COPY(REST_OF(end), rest, 2 * N);
                    look(x, end, then);
                    found = is_finite_point(end) ? first_impact(x, now, *t, end, at) : DOUBT;
                    if (!found && lets_go(x, end, then)) found = first_release(x, now, *t, end, at, &leaves);
                    looked = passed;
                    if (found) break;
                    COPY(now + 1, end + 1, POINT - 1), looked++;
                }
                k++, *t = then, *impacts = 0;
                if (is_kept(a, k, &due)) keep(row, *t, k, reached), row += ROW_SIZE;
            }
            if (looked < passed && !found) {
                COPY(now + 1, rows + 3 * N * passed, 3 * N), COPY(REST_OF(now), rests + 2 * N * passed, 2 * N);
                look(x, now, *t);
            }
            steps += passed + 1;
            if (passed < count) carry[0] = 0;
            else *next = fmin(*next + FEW_STEPS, MOST_STEPS); /* as the root of the flight: what is too much beside what it costs */
            if (found == NONE && good < count) found = DOUBT; /* a step that is not solved */
        } else { /* the rest of a step after an impact */
            carry[0] = 0, steps++, x->looks = 0;
            end[0] = a->t0 + a->h * (double)(k + 1) - *t;
            if (!ahead_by(x, now, *t, end[0], end)) { status = BESIDE; break; }
            count_step(x);
            for (int d = 0; d < N; d++) moved[d] = fmax(x->reach[d], fabs(Q_OF(end)[d] - Q_OF(now)[d]));
            closeness(x, Q_OF(now), moved, x->close);
            found = first_impact(x, now, *t, end, at);
            if (!found && lets_go(x, end, a->t0 + a->h * (double)(k + 1))) found = first_release(x, now, *t, end, at, &leaves);
            if (found == NONE) {
                k++, *t = a->t0 + a->h * (double)k, *impacts = 0;
                COPY(now + 1, end + 1, POINT - 1);
                if (is_kept(a, k, &due)) keep(row, *t, k, now + 1), row += ROW_SIZE;
            }
        }
        if (found == NONE) continue;
        const double stop = a->t0 + a->h * (double)(k + 1);
        double when = *t + at[0];
        const int ends = !begins && (at[0] == end[0] || fabs(stop - when) <= LOCATED * fabs(stop));
        if (ends) when = stop;
        if (found == DOUBT || *impacts >= (found == LEAVES ? RESTLESS : MOST_IMPACTS)) { status = BESIDE; break; }
        if (found == HIT && lets_go(x, at, when)) { status = BESIDE; break; }
        COPY(before, at, POINT);
        const int struck = settle(x, at, when, leaves, hit);
        const int same = held[0] == known[0] && !memcmp(held + 1, known + 1, (size_t)held[0] * sizeof(int64_t));
        for (int i = 0; i < struck; i++) hit[0] = (double)((row - a->rows) / ROW_SIZE), hit += HIT_SIZE;
        if (struck < 0 || !same) {
            a->stats[4] = struck >= 0 || found == HIT, a->stats[5] = when, a->stats[6] = ends;
            COPY(a->stats + 7, (struck < 0 ? before : at) + 1, NUMBERS);
            for (int i = 0; i < CONTACTS && struck >= 0; i++) a->holds[i] = 0;
            for (int64_t j = 0; j < held[0] && struck >= 0; j++)
                if (held[1 + j] >= FIRST) a->holds[held[1 + j] - FIRST] = 1;
            if (struck < 0 || !a->change || !a->change((row - a->rows) / ROW_SIZE, k + ends, a->last)) {
                status = struck < 0 ? BESIDE : SETTLED;
                break;
            }
            a->stats[4] = 0;
            carry = take_begun(x), memcpy(known, held, sizeof known);
            COPY(V_OF(at), a->sizes, N);
            look(x, at, when);
        }
        k += ends, *t = when, *impacts = ends || begins ? 0 : *impacts + 1, *next = FEW_STEPS, begins = 0;
        COPY(now + 1, at + 1, POINT - 1);
        keep(row, *t, k, now + 1), row += ROW_SIZE;
    }
    if (k == a->last) status = ENDED;
    state[0] = (double)k;
    COPY(state + STATE_Q, now + 1, NUMBERS);
    a->stats[0] = (double)((row - a->rows) / ROW_SIZE), a->stats[1] = (double)((hit - a->hit) / HIT_SIZE);
    a->stats[2] = x->iterations, a->stats[3] = x->residual;
    free(memory);
    return status;
}

/* How far the run is, at the nodes of both, from one in fewer steps that has ended clean: coordinate by coordinate. Nodes of impacts
   come behind that of the grid before them. */
static int from_fewer(const ContactArguments *a, const double *few, int64_t nodes) {
    const double *many = a->rows, *const end = a->rows + ROW_SIZE * (int64_t)a->stats[0];
    const double ratio = (double)(a->last / a->fewer);
    for (int d = 0; d < N; d++) a->apart[d] = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const double *const node = few + ROW_SIZE * i;
        if (i && node[1] == node[1 - ROW_SIZE]) continue;
        while (many < end && many[1] != ratio * node[1]) many += ROW_SIZE;
        if (many == end) return 0;
        for (int d = 0; d < N; d++) a->apart[d] = fmax(a->apart[d], fabs(many[2 + d] - node[2 + d]));
    }
    return 1;
}

int contacts(const ContactArguments *a) {
    scene = a->scene;
    if (!a->fewer) return whole_run(a);
    const int64_t size = STATE_Q + NUMBERS + a->carry_size;
    double *const memory = malloc((size_t)(size + ROW_SIZE * a->room + HIT_SIZE * a->hits) * sizeof(double));
    int64_t holds[CONTACTS], nodes = 0;
    for (int d = 0; d < N; d++) a->apart[d] = INFINITY;
    if (memory) {
        ContactArguments few = *a;
        few.last = a->fewer, few.h = a->h * (double)(a->last / a->fewer);
        few.state = memory, few.rows = memory + size, few.hit = few.rows + ROW_SIZE * a->room;
        COPY(few.state, a->state, size), memcpy(holds, a->holds, sizeof holds);
        if (whole_run(&few) == ENDED) nodes = (int64_t)a->stats[0];
        memcpy(a->holds, holds, sizeof holds);
    }
    const int status = whole_run(a);
    if (status == ENDED && nodes && !from_fewer(a, memory + size, nodes)) for (int d = 0; d < N; d++) a->apart[d] = INFINITY;
    free(memory);
    return status;
}
