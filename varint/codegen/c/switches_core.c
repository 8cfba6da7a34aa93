/* A motion from switch to switch in one call: the steps of a smooth piece, the first margin in them that falls to zero, the instant
   of that, and the branch on which the motion goes on. The name ends in LEVEL, the instructions that are used.

   The same as varint/integration/switches has it for one piece after the other: piece.py, crossing.py and next_branch.py, operation
   by operation. What needs a closer look, more than one switch at an instant or a branch that is not in the table, ends the call. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define switches WITH_ALL(switches, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"

/* At the end of the time; the last piece ends at a switch behind which the caller decides; the next piece is the caller's; no room. */
enum Followed { ARRIVED, UNDECIDED, BESIDE, NO_ROOM };
/* numbers of a piece: branch, step, steps, first row, nodes, iterations, residual, margin, nodes behind the first and before the last one
   that are of no even step */
#define PIECE_HEAD 10
#define BRANCH_HEAD 4 /* and of a branch: mode, unit of time, the unit at first, how often steps that begin or end at its switches are halved */
#define BEYOND 8      /* doublings of a last step, until it leads over the switch */
#define LOOKS 9      /* instants at which a cubic is looked at */
#define NEARER 4     /* instants soon after the last switch */

/* What moves while the same switch holds the motion, or none; varint/codegen/switches.py has the same layouts. */
typedef struct {
    int (*run)(const RunArguments *);
    int (*parts)(const PartsArguments *);
    const void *scene, *margins, *ahead; /* (q, v, t) to margins and rates; to what switches and its rate */
    const double *watched;               /* of each margin: switch, and what its number is beyond */
    int64_t carry_size, count, held;     /* margins; the switch that holds, or -1 */
    int64_t told, notes;                 /* numbers that the loop must be told besides, and of what it notes; 0: none */
} Mode;

typedef struct {
    int (*rows)(const RowsArguments *);
    const Mode *modes;
    int (*tell)(int64_t branch);         /* what the loop of a branch must be told at `asked` goes to `told`; not 0 where it does */
    double *asked, *told;                /* t, h, q, p */
    double *branches;                    /* (branches, BRANCH_HEAD): units change */
    const double *c;                     /* (branches, parameters): the last of them are the numbers behind the switches */
    const void *lagrangian;              /* (q, v, t) to L, where it may jump; else 0 */
    const int64_t *kinds;                /* of every switch: a sum of the Kinds */
    double *start;                       /* t, q, p, v */
    double *pieces, *t, *states;         /* (most, PIECE_HEAD); (room), (room, 3 n): q, p, v at their nodes */
    int64_t *found;                      /* pieces, and nodes */
    const double *among;                 /* LOOKS instants in a step */
    int64_t n, known, parameters, switches, place, most, room; /* place: of the first branch */
    int64_t parts, iterations, first, most_in_block, roots, turns, surely;
    double until, total, most_nodes;
    double located, close, dip, inside[NEARER];
    double least_unit, longer, edge, border, crowded, at_zero, no_jump;
} SwitchArguments;

#define ROUNDED (64 * 0x1p-52) /* of the other side's push: none */
enum Kinds { COUNTS = 1, SLIDABLE = 2, STRAIGHT = 4, CLOCK = 8 };

#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))
INLINE int is_finite_number(double x) { return x - x == 0; }
INLINE double sign_of(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

typedef struct {
    const SwitchArguments *a;
    const Mode *mode;
    const double *c;        /* of the branch */
    double *value, *rate;   /* of the margins at one instant, (count) */
    double *state;          /* (q, p, v) there */
    double t, h;            /* of the step that is looked at */
    const double *start;
} Step;

/* What a loop must be told for a step from a state. */
static int tell(const SwitchArguments *a, const Mode *mode, int64_t place, double t, double h, const double *state) {
    if (!mode->told) return 1;
    a->asked[0] = t, a->asked[1] = h;
    memcpy(a->asked + 2, state, (size_t)(2 * a->n) * sizeof(double));
    return a->tell(place);
}

/* A function of (q, v, t) with two results as wide, at many nodes. */
static int at_nodes(const SwitchArguments *a, const void *function, const double *c, int64_t count, const double *states, const double *t,
                    double *value, double *rate, int64_t width) {
    const int64_t n = a->n;
    const RowsArguments some = {.count = count, .c = c, .scene = function, .arguments = {states, states + 2 * n, t}, .apart = {3 * n, 3 * n, 1},
                                .results = {value, rate}, .widths = {width, width}};
    return a->rows(&some) == DONE;
}

/* State, margins and their rates, by this step, after a fraction of it; 0 where that is not solved. */
static int part(Step *x, double s) {
    const int64_t n = x->a->n;
    double rows[3 * n];
    const double size = s * x->h, t = x->t + size;
    int64_t good = 0;
    const PartsArguments one = {1, x->mode->told, 0, x->a->iterations, x->start, &x->t, &size, x->c, 0, x->a->told, rows, &good, x->mode->scene};
    if (x->mode->parts(&one) != DONE || good <= 0) return 0;
    COPY(x->state, rows, 3 * n);
    if (!at_nodes(x->a, x->mode->margins, x->c, 1, rows, &t, x->value, x->rate, x->mode->count)) return 0;
    for (int64_t i = 0; i < x->mode->count; i++) x->rate[i] *= x->h;
    return 1;
}

/* Whether a cubic with these ends, looked at at a few instants, is that low. */
static int dips_below(const double *among, double before, double after, double rate_before, double rate_after, double level) {
    double least = INFINITY;
    for (int i = 0; i < LOOKS; i++) {
        const double s = among[i], rest = 1 - s, rise = s * s * (3 - 2 * s);
        const double value = before + rise * (after - before) + s * rest * (rest * rate_before - s * rate_after);
        if (value != value) return 0;
        if (value < least) least = value;
    }
    return least < level;
}

/* Zero in [0, 1] of the cubic with these ends, the first positive and the last not. */
static double root(double before, double after, double rate_before, double rate_after) {
    double low = 0, high = 1;
    const double bend = 3 * (after - before) - 2 * rate_before - rate_after, twist = rate_before + rate_after - 2 * (after - before);
    double s = before / (before - after);
    for (int i = 0; i < 8; i++) {
        const double value = before + s * (rate_before + s * (bend + s * twist));
        const double slope = rate_before + s * (2 * bend + s * 3 * twist);
        if (value > 0) low = s;
        else high = s;
        s = slope != 0 ? s - value / slope : low;
        if (!(low < s && s < high)) s = (low + high) / 2;
    }
    return s;
}

enum Dipped { STAYS, DIPS, UNSOLVED };

/* An instant at which a margin that falls and rises again is not positive, with its value and rate. */
static int dip(Step *x, int64_t margin, double a, double b, double fa, double fb, double *found) {
    for (int64_t i = 0; i < x->a->turns; i++) {
        const double flat = (a * fb - b * fa) / (fb - fa), left = a + (b - a) / 16, right = b - (b - a) / 16;
        double s = left > flat ? left : flat;
        if (right < s) s = right;
        if (!part(x, s)) return UNSOLVED;
        const double value = x->value[margin], slope = x->rate[margin];
        if (!(value > 0)) {
            found[0] = s, found[1] = value, found[2] = slope;
            return DIPS;
        }
        if (slope < 0) a = s, fa = slope;
        else b = s, fb = slope;
        if (value > fabs(slope) * (b - a)) return STAYS;
    }
    return STAYS;
}

/* Time within the step at which a margin falls to zero, and the state there; `ends`: values and rates. */
static int in_step(Step *x, int64_t margin, const double *ends, int begins, double *when, double *state) {
    const SwitchArguments *const a = x->a;
    double before = ends[0], after = ends[1], rate_before = ends[2], rate_after = ends[3], low = 0, high = 1;
    if (!(before > 0)) {
        int i = 0;
        if (!begins) return UNSOLVED;
        for (; i < NEARER; i++) {
            low = a->inside[i];
            if (!part(x, low)) return UNSOLVED;
            if (x->value[margin] > 0) {
                before = x->value[margin], rate_before = x->rate[margin];
                break;
            }
        }
        if (i == NEARER) return UNSOLVED;
    }
    if (after > 0) {
        double found[3];
        const int seen = dip(x, margin, low, high, rate_before, rate_after, found);
        if (seen != DIPS) return seen;
        high = found[0], after = found[1], rate_after = found[2];
    }
    const double width = high - low, near = a->close * fabs(x->t / x->h), rounded = a->located > near ? a->located : near;
    double s = low + width * root(before, after, rate_before * width, rate_after * width), size = INFINITY;
    for (int64_t i = 0; i < a->roots; i++) {
        if (!part(x, s)) return UNSOLVED;
        COPY(state, x->state, 3 * a->n);
        const double value = x->value[margin], rate = x->rate[margin], last = size;
        if (value > 0) low = s;
        else high = s;
        double ahead = rate < 0 ? s - value / rate : (low + high) / 2;
        if (!(low <= ahead && ahead <= high) || i > a->roots / 2) ahead = (low + high) / 2;
        size = fabs(ahead - s);
        const int stalls = i >= a->surely || (i > 1 && size > last / 2);
        const double close = stalls ? rounded : a->located * s;
        if (value == 0 || size <= close || high - low <= close) break;
        s = ahead;
    }
    *when = s * x->h;
    return DIPS;
}

/* A whole step of this size from a state. */
static int step_from(Step *x, const double *start, double t, double size) {
    const int64_t n = x->a->n;
    x->t = t, x->h = size, x->start = start;
    if (x->mode->told) COPY(x->a->told + x->mode->told - n, start + 2 * n, n); /* the sizes are those of the piece */
    return part(x, 1);
}

/* The rows of a step from a switch, each step of which is as long as all before it, behind the first row; 0 where one is not solved. */
static int halved_begin(Step *x, double t, double h, int halvings, double *times, double *rows) {
    const int64_t n = x->a->n;
    for (int i = 0; i <= halvings; i++) {
        const double ahead = t + ldexp(h, i - halvings);
        if (!step_from(x, rows + 3 * n * i, times[i], ahead - times[i])) return 0;
        COPY(rows + 3 * n * (i + 1), x->state, 3 * n);
        times[i + 1] = ahead;
    }
    return 1;
}

/* The rows from the first one to a margin's zero that is at `end` roughly, the last of which is there, each step half as long as it is far:
   how many behind the first; 0 where they are not solved, or the zero is not there. As varint/integration/switches/halved.py has it. */
static int64_t halved_end(Step *x, int64_t margin, double end, int halvings, double *times, double *rows) {
    const SwitchArguments *const a = x->a;
    const int64_t n = a->n;
    const double least = ldexp(fabs(end - times[0]), -halvings);
    int64_t row = 0;
    if (!at_nodes(a, x->mode->margins, x->c, 1, rows, times, x->value, x->rate, x->mode->count)) return 0;
    double value = x->value[margin], rate = x->rate[margin], t, size;
    for (int i = 0; i < 4 * halvings; i++) {
        t = times[row], size = (end - t) / 2;
        if (!(fabs(size) > least)) break;
        if (!step_from(x, rows + 3 * n * row, t, size)) return 0;
        if (!(x->value[margin] > 0)) {
            end = t + size;
            continue;
        }
        row++, times[row] = t + size, value = x->value[margin], rate = x->rate[margin] / size;
        COPY(rows + 3 * n * row, x->state, 3 * n);
        const double ahead = rate * size < 0 ? -value / rate : size;
        if (fabs(ahead) < 2 * fabs(size)) end = times[row] + ahead;
    }
    if (!(value > 0)) return 0;
    t = times[row], size = 2 * (end - t);
    for (int i = 0; i < BEYOND; i++, size *= 2) {
        if (!step_from(x, rows + 3 * n * row, t, size)) return 0;
        if (x->value[margin] > 0) continue;
        const double ends[] = {value, x->value[margin], rate * size, x->rate[margin]};
        double when;
        if (in_step(x, margin, ends, 0, &when, rows + 3 * n * (row + 1)) != DIPS) return 0;
        times[row + 1] = t + when;
        return row + 1;
    }
    return 0;
}

typedef struct {
    int64_t step, margin; /* -1: none */
    double t;
} Crossing;

/* The first zero of a margin along some nodes; 0 where the motion does not enter the branch, or a step is not solved. */
static int first_crossing(Step *x, const double *t, const double *states, int64_t count, int begins, double *values, double *rates, Crossing *found,
                          double *state) {
    const SwitchArguments *const a = x->a;
    const int64_t m = x->mode->count, n = a->n;
    double at[3 * n];
    found->step = -1;
    if (!m || count < 2) return 1;
    if (!at_nodes(a, x->mode->margins, x->c, count, states, t, values, rates, m)) return 0;
    for (int64_t k = 0; k + 1 < count; k++) {
        const double w = t[k + 1] - t[k];
        x->t = t[k], x->h = w, x->start = states + 3 * n * k;
        for (int64_t i = 0; i < m; i++) {
            const double before = values[k * m + i], after = values[(k + 1) * m + i];
            const double ends[] = {before, after, rates[k * m + i] * w, rates[(k + 1) * m + i] * w};
            int seen = !(after >= 0) || (after == 0 && before > 0);
            if (before > 0 && after > 0 && ends[2] < 0 && ends[3] > 0)
                seen = dips_below(a->among, before, after, ends[2], ends[3], a->dip * (before > after ? before : after));
            if (!seen) continue;
            double when;
            if (x->mode->told) COPY(a->told + x->mode->told - n, x->start + 2 * n, n); /* the sizes are those of the piece */
            const int crosses = in_step(x, i, ends, begins && !k, &when, at);
            if (crosses == UNSOLVED) return 0;
            if (crosses == DIPS && (found->step < 0 || fabs(when) < fabs(found->t - x->t))) {
                found->step = k, found->t = x->t + when, found->margin = i;
                COPY(state, at, 3 * n);
            }
        }
        if (found->step >= 0) return 1;
    }
    return 1;
}

/* The branch in the table with this switch holding (-1: none) and these numbers; -1 where there is none. */
static int64_t branch_of(const SwitchArguments *a, int64_t held, const double *values) {
    const int64_t m = a->switches;
    for (int64_t i = 0; i < a->known; i++)
        if (a->modes[(int64_t)a->branches[i * BRANCH_HEAD]].held == held && !memcmp(a->c + (i + 1) * a->parameters - m, values, (size_t)m * sizeof(double)))
            return i;
    return -1;
}

/* What switches and its rates on a branch with these parameters, `held` as in the table. */
static int look_ahead(const SwitchArguments *a, const void *ahead, const double *c, const double *state, double t, double *sigma, double *rate) {
    return at_nodes(a, ahead, c, 1, state, &t, sigma, rate, a->switches);
}

/* The function of the modes in which nothing holds; 0 where there is none. */
static const void *free_ahead(const SwitchArguments *a) {
    for (int64_t i = 0; i < a->known; i++) {
        const Mode *const mode = a->modes + (int64_t)a->branches[i * BRANCH_HEAD];
        if (mode->held < 0) return mode->ahead;
    }
    return 0;
}

/* The branch on which the motion goes on behind a margin's zero, in the table; -1 where the caller has to decide. */
static int64_t next_branch(const SwitchArguments *a, const Mode *mode, const double *old, int64_t margin, double t, const double *state) {
    const int64_t m = a->switches, crossed = (int64_t)mode->watched[2 * margin];
    const double direction = copysign(1.0, a->total), far = fabs(t) > fabs(a->total) ? fabs(t) : fabs(a->total);
    double c[a->parameters], sigma[m], rate[m];
    double *const values = c + a->parameters - m;
    const void *const ahead = free_ahead(a);
    COPY(c, old, a->parameters);
    if (!ahead || crossed < 0 || (mode->held >= 0 && crossed != mode->held)) return -1;
    const int64_t kind = a->kinds[crossed];
    if (mode->held >= 0) values[crossed] = mode->watched[2 * margin + 1];
    if (mode->held >= 0 || m > 1 || !(kind & SLIDABLE)) {
        if (!look_ahead(a, mode->ahead, c, state, t, sigma, rate)) return -1;
        for (int64_t j = 0; j < m; j++) { /* is another one at zero, too? */
            const double off = a->kinds[j] & COUNTS ? sigma[j] - nearbyint(sigma[j]) : sigma[j];
            if (j != crossed && !(a->kinds[j] & CLOCK) && fabs(off) <= a->at_zero * fabs(rate[j]) * far) return -1;
        }
    }
    if (mode->held >= 0) { /* it gives way */
        if (!look_ahead(a, ahead, c, state, t, sigma, rate)) return -1;
        for (int64_t j = 0; j < m; j++) {
            const double own = a->kinds[j] & COUNTS ? floor(sigma[j]) : sign_of(sigma[j]);
            if (j != crossed && !(a->kinds[j] & CLOCK) && !(own == values[j])) return -1;
        }
        return branch_of(a, -1, values);
    }
    if (kind & STRAIGHT) {
        const double side = copysign(1.0, rate[crossed] * direction);
        if (!(rate[crossed] != 0) || side == values[crossed]) return -1;
        values[crossed] = side;
        return branch_of(a, -1, values);
    }
    if (!(kind & SLIDABLE)) return -1;
    values[crossed] = -1;
    if (!look_ahead(a, ahead, c, state, t, sigma, rate)) return -1;
    const double below = rate[crossed] * direction;
    values[crossed] = 1;
    if (!look_ahead(a, ahead, c, state, t, sigma, rate)) return -1;
    const double above = rate[crossed] * direction, least = ROUNDED * fmax(fabs(below), fabs(above));
    if (fabs(below) <= least || fabs(above) <= least) return -1;
    if (below * above > 0) {
        values[crossed] = above > 0 ? 1 : -1;
        return branch_of(a, -1, values);
    }
    if (!(below > 0 && 0 > above)) return -1;
    values[crossed] = 0;
    return branch_of(a, crossed, values);
}

/* Whether the potential jumps between two branches, as `past_corner` in corner.py tells. */
static int jumps(const SwitchArguments *a, const double *one, const double *other, const double *state, double t) {
    const int64_t n = a->n;
    double before, after, size = 0;
    RowsArguments look = {.count = 1, .c = one, .scene = a->lagrangian, .arguments = {state, state + 2 * n, &t}, .results = {&before}, .widths = {1}};
    if (a->rows(&look) != DONE) return 1;
    look.c = other, look.results[0] = &after;
    if (a->rows(&look) != DONE) return 1;
    for (int64_t d = 0; d < n; d++) size += state[n + d] * state[2 * n + d];
    return !(fabs(after - before) <= a->no_jump * (fabs(size) + fabs(before) + fabs(after)));
}

/* How many of the nodes come before one that is not finite. */
static int64_t finite_nodes(const double *rows, int64_t count, int64_t width) {
    for (int64_t i = 0; i < count * width; i++)
        if (!is_finite_number(rows[i])) return i / width;
    return count;
}

int switches(const SwitchArguments *a) {
    const int64_t n = a->n, stats_size = (int64_t)(sizeof(RunStats) / sizeof(double)) + 3 * n;
    int64_t carry_size = 0, margins = 0, notes = 0;
    for (int64_t i = 0; i < a->known; i++) {
        const Mode *const mode = a->modes + (int64_t)a->branches[i * BRANCH_HEAD];
        if (mode->carry_size > carry_size) carry_size = mode->carry_size;
        if (mode->count > margins) margins = mode->count;
        if (mode->notes > notes) notes = mode->notes;
    }
    const int64_t many = (a->most_in_block + 1) * margins;
    double *const memory = malloc((size_t)(carry_size + stats_size + 2 * many + 2 * margins + 15 * n + notes) * sizeof(double));
    double *const carry = memory, *const stats = carry + carry_size, *const values = stats + stats_size, *const rates = values + many;
    double *const value = rates + many, *const rate = value + margins, *const state = rate + margins, *const at = state + 3 * n;
    double *const kept = at + 3 * n, *const begin = kept + 3 * n, *const noted = begin + 3 * n;
    int64_t place = a->place, row = 0, pieces = 0;
    double t = a->start[0];
    int status = memory ? NO_ROOM : BESIDE;
    if (memory) COPY(begin, a->start + 1, 3 * n);
    while (status == NO_ROOM && pieces < a->most) {
        double *const branch = a->branches + place * BRANCH_HEAD;
        const Mode *const mode = a->modes + (int64_t)branch[0];
        const double *const c = a->c + place * a->parameters, span = a->until - t, unit = branch[1];
        if (!(fabs(span) / unit * (double)a->parts < a->most_nodes)) { status = BESIDE; break; }
        const double units = ceil(fabs(span) / unit - a->border);
        const int64_t steps = a->parts * (units > 1 ? (int64_t)units : 1);
        const double h = span / (double)steps;
        double *const rows = a->states + row * 3 * n, *const times = a->t + row, iterations = 0, residual = 0;
        const int halvings = (int)branch[3];
        const int64_t beside = 5 * halvings + 2; /* rows of no even steps at most */
        int64_t k = 0, size = a->first < a->parts + 1 ? a->first : a->parts + 1, lead = 0, trail = 0;
        Step step = {a, mode, c, value, rate, state, 0, 0, 0};
        Crossing found = {-1, -1, 0};
        carry[0] = 0;
        if (row + beside + 2 > a->room) break;
        if (!tell(a, mode, place, t, h, begin)) { status = BESIDE; break; }
        if (mode->told) COPY(carry + 1, a->told, mode->told);
        if (halvings) {
            COPY(rows, begin, 3 * n), times[0] = t;
            status = BESIDE;
            if (!halved_begin(&step, t, h, halvings, times, rows)) break;
            if (steps == 1) times[halvings + 1] = a->until;
            if (!first_crossing(&step, times, rows, halvings + 2, 1, values, rates, &found, at)) break;
            status = NO_ROOM, k = 1, lead = halvings;
            COPY(begin, rows + 3 * n * (lead + 1), 3 * n);
        }
        while (k < steps && found.step < 0) {
            const int64_t some = size < steps - k ? size : steps - k;
            double *const first = rows + (k + lead) * 3 * n;
            if (row + k + some + 1 + beside > a->room) goto ends;
            if (k) COPY(kept, first, 3 * n);
            const RunArguments run = {some, 1, k, a->iterations, t, h, 0, begin, c, 0, first, carry, (RunStats *)stats, mode->scene, mode->notes ? noted : 0, 0};
            mode->run(&run);
            const RunStats *const told = (RunStats *)stats;
            const int64_t solved = finite_nodes(first, (int64_t)told->steps + 1, 3 * n); /* beyond its end a branch may be no scene */
            for (int64_t i = k > 0; i <= some; i++) times[k + i + lead] = t + h * (double)(k + i);
            if (k + some == steps) times[steps + lead] = a->until;
            if (!first_crossing(&step, times + k + lead, first, solved, !k, values, rates, &found, at) || (found.step < 0 && solved <= some)) {
                status = BESIDE;
                goto ends;
            }
            if (k) COPY(first, kept, 3 * n);
            iterations += told->iterations;
            if (told->residual > residual) residual = told->residual;
            if (found.step >= 0) found.step += k + lead;
            k += some, size = 4 * size < a->most_in_block ? 4 * size : a->most_in_block;
        }
        int64_t last = found.step >= 0 ? found.step + 1 : steps + lead;
        if (halvings && found.step > 0) {
            int64_t from = found.step;
            if (fabs(found.t - times[from]) < fabs(times[from] - times[from - 1]) / 2) from--;
            const int64_t more = halved_end(&step, found.margin, found.t, halvings, times + from, rows + 3 * n * from);
            if (!more) { status = BESIDE; break; }
            last = from + more, trail = more - 1, found.t = times[last];
            if (from < lead) lead = from;
            COPY(at, rows + last * 3 * n, 3 * n);
        } else if (halvings && !found.step) lead = 0;
        const double told[PIECE_HEAD] = {(double)place, h, (double)steps, (double)row, (double)(last + 1), iterations, residual,
                                         found.step >= 0 ? (double)found.margin : -1, (double)lead, (double)trail};
        COPY(a->pieces + pieces++ * PIECE_HEAD, told, PIECE_HEAD);
        row += last + 1;
        if (found.step < 0) { status = ARRIVED; break; }
        times[last] = found.t;
        COPY(rows + last * 3 * n, at, 3 * n);
        const double length = fabs(found.t - t), end = fabs(a->until) > fabs(a->total) ? fabs(a->until) : fabs(a->total);
        if (branch[2] == unit || length > a->longer * unit) {
            const double least = branch[2] * a->least_unit, longest = length > least ? length : least;
            branch[1] = longest < branch[2] ? longest : branch[2];
        }
        status = UNDECIDED;
        if (fabs(a->until - found.t) <= a->edge * end || length < a->crowded * fabs(a->total)) break;
        const int64_t next = next_branch(a, mode, c, found.margin, found.t, at);
        if (next < 0 || (a->lagrangian && jumps(a, c, a->c + next * a->parameters, at, found.t))) break;
        place = next, t = found.t, status = NO_ROOM;
        COPY(begin, at, 3 * n);
    }
ends:
    a->found[0] = pieces, a->found[1] = row;
    free(memory);
    return status;
}
