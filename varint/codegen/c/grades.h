/* Steps of more than one size: longer ones where a motion settles. varint/integration/graded_steps.py says why; its numbers are
   `limits`. Nodes are counted, and shared by runs, as those of equal steps: every stretch has its steps times the same ratio. */
#define PIECE 4   /* steps from one look to the next, or a multiple: a number that ratios of steps divide */
#define GROWING 16 /* stretches of steps that grow at most */

/* Where a stretch begins: its first node, the time of that, and the size of its steps. */
typedef struct { int64_t first; double t, h; } Begin;

typedef struct {
    int64_t count, all, room; /* stretches, 0: steps are equal; steps of the run that has found them; stretches that there is room for */
    double duration;
    Begin *at, own[GROWING];
} Grades;

/* One stretch. */
static void begin_grades(Grades *g, int64_t steps, double t0, double duration) {
    g->count = 1, g->all = steps, g->room = GROWING, g->duration = duration, g->at = g->own;
    g->own[0] = (Begin){0, t0, duration / steps};
}

/* Steps of one size: from which node on, until which, the time of the first and the size. */
typedef struct { int64_t first, end; double t, h; } Stretch;

/* That of the step behind node k of a run of so many steps. */
static Stretch stretch_of(const Grades *g, double t0, double duration, int64_t steps, int64_t k) {
    if (!g->count) return (Stretch){0, steps, t0, duration / steps};
    int64_t i = 0, behind = g->count;
    while (behind - i > 1) {
        const int64_t middle = (i + behind) / 2;
        if (k * g->all >= g->at[middle].first * steps) i = middle;
        else behind = middle;
    }
    const Begin *const x = g->at + i;
    const int64_t end = i + 1 < g->count ? x[1].first * steps / g->all : steps;
    return (Stretch){x->first * steps / g->all, end, x->t, x->h * ((double)g->all / (double)steps) * (duration / g->duration)};
}

/* Whether a run of so many steps has nodes where their size changes, and one of `ratio` times as many. */
static int is_divided(const Grades *g, int64_t steps, double ratio) {
    for (int64_t i = 0; i < g->count; i++) {
        const double node = (double)(g->at[i].first * steps / g->all) * ratio;
        if (node != rint(node)) return 0;
    }
    return 1;
}

/* The next steps are twice as long, or somewhat less, so that they come to the end and are no longer than `longest`; whether that
   makes them fewer. `done`: steps that are there. */
static int grow(Grades *g, double longest, double end, int64_t done) {
    Begin *const last = g->at + g->count - 1;
    const double h = fabs(2 * last->h) < longest ? fabs(2 * last->h) : longest, now = last->t + last->h * (double)(done - last->first),
                 left = end - now, many = ceil(fabs(left) / h / PIECE) * PIECE;
    if (g->count == GROWING || !(many >= 1) || done + (int64_t)many + PIECE > g->all) return 0;
    last[1] = (Begin){done, now, left / many}, g->all = done + (int64_t)many, g->count++;
    return 1;
}

/* Node of the next look: the longer steps are of one size, the later. */
static int64_t next_look(const Grades *g, int64_t done) {
    const int64_t many = (done - g->at[g->count - 1].first) / 2 / PIECE * PIECE, next = done + (many > PIECE ? many : PIECE);
    return next < g->all ? next : g->all;
}

/* What a look at a motion tells: whether the steps at hand show it, it does little of what it has done, and steps twice as long
   would show it. */
typedef struct { int shown, quiet, smooth; } Seen;

typedef struct {
    const double *heights; /* what makes the two highest Legendre coefficients of what its stages have, and so many of these */
    int64_t n, unknowns, stages, padded;
    double quiet, wanted, begun, usual; /* begun: size of the first steps; usual: so many times as long are those of what lasts */
    double *largest, *farthest; /* unknowns so far, and ways of coordinates in a first step, at their speeds */
} Looked;

/* How far it goes in so many steps whose rows these are: steps that pass more of a place than usual ones have before might miss what
   is there. */
static Seen ways_of(const Looked *a, const double *rows, int64_t steps, double h) {
    const double longer = fabs(h / a->begun);
    Seen found = {1, 1, 1};
    for (int64_t d = 0; d < a->n; d++) {
        double far = 0;
        for (int64_t k = 0; k < steps; k++) {
            const double way = fabs(rows[3 * a->n * (k + 1) + d] - rows[3 * a->n * k + d]);
            far = way > far ? way : far;
        }
        if (a->usual > 1 && far / longer > a->farthest[d]) a->farthest[d] = far / longer; /* what lasts may have begun since */
        found.shown &= far <= a->usual * a->farthest[d] || longer <= 1, found.smooth &= 2 * far <= a->usual * a->farthest[d];
        if (far > a->farthest[d] && !(a->usual > 1)) a->farthest[d] = far;
    }
    return found;
}

/* By the unknowns of the last step and the largest ones so far, which are brought up to date. */
static Seen unknowns_of(const Looked *a, const double *carried, double h) {
    const Carry *const carry = (const Carry *)carried;
    const double unit = fabs(a->unknowns == a->n ? h * h : h), *const scales = carry->numbers + 4 * a->n, *const x = scales + 2 * a->unknowns,
                 twice = ldexp(1, (int)a->stages - 1);
    Seen found = {1, 1, 1};
    for (int64_t r = 0; r < a->unknowns; r++) {
        const double *const own = x + a->padded * r, most = scales[r] / unit;
        double size = 0, high = 0, next = 0;
        for (int64_t j = 0; j < a->stages; j++)
            size += fabs(own[j]), high += a->heights[a->padded + j] * own[j], next += a->heights[j] * own[j];
        size /= unit, high = (fabs(high) + fabs(next) / 8) / unit;
        const double largest = most > a->largest[r] ? most : a->largest[r], least = a->wanted * largest, longer = twice * high;
        a->largest[r] = largest;
        found.shown &= high * (high < size ? high / size : 1) <= least, found.quiet &= size <= a->quiet * largest;
        found.smooth &= longer * (longer < size ? longer / size : 1) <= least;
    }
    return found;
}

/* Both. */
static Seen look_at(const Looked *a, const double *carried, double h, const double *rows, int64_t steps) {
    const Seen one = unknowns_of(a, carried, h), other = ways_of(a, rows, steps, h);
    return (Seen){one.shown & other.shown, one.quiet, one.smooth & other.smooth};
}
