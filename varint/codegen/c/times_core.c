/* A motion at times between its nodes, which lie less than a step behind each of them: a shorter step of the same rule. The
   names end in LEVEL, the instructions that are used.

   varint/results/dense_output.py does the same for all other motions. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define at_times WITH_ALL(at_times, LEVEL)
#define go_ahead WITH_ALL(go_ahead, LEVEL)
#define arrive WITH_ALL(arrive, LEVEL)
#define at_clock WITH_ALL(at_clock, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "times.h"

#define ROUNDING (8 * 0x1p-52) /* of times */
#define LOCATED 0x1p-50        /* of the time that a clock shows, which is known no better */
#define CLOCK_ITERATIONS 60
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))

/* How many shorter steps there are, and for each of them q and p where it starts, its time, its length and the number of the time
   where it ends; where they end, and whether they are solved. */
typedef struct {
    int64_t *going;
    double *start, *begin, *ahead;
    int64_t *which;
    double *rows;
    int64_t *good, *node, *reached; /* the node before it; whether the step that holds it has been looked at as a whole */
} Ahead;

static Ahead ahead_in(const Times *a) {
    const int64_t n = a->n, count = a->count;
    double *const start = a->room + 1, *const begin = start + 2 * n * count, *const rows = begin + 3 * count;
    int64_t *const good = (int64_t *)(rows + 3 * n * count);
    return (Ahead){(int64_t *)a->room, start, begin, begin + count, (int64_t *)(begin + 2 * count), rows, good, good + count, good + 2 * count};
}

static double time_of(const Times *a, int64_t node) { return a->t ? a->t[node] : a->h * (double)node + a->t0; }

/* The last node that is not behind a time but for round-off, of those from `node` on; times are in order. */
static int64_t node_before(const Times *a, int64_t node, double time, double slack) {
    const double sign = a->h > 0 ? 1 : -1;
    while (node + 1 < a->nodes && sign * time_of(a, node + 1) <= sign * time + slack) node++;
    return node;
}

/* Times that share a step with many others are found there all at once; shorter steps are left for the rest. */
static void look_within(const Times *a) {
    const Ahead to = ahead_in(a);
    const int64_t n = a->n, going = *to.going;
    const WithinArguments asked = {.going = going, .nodes = a->nodes, .most = a->most, .order = a->order, .q = a->q, .p = a->p, .t = a->t,
                                   .h = a->h, .t0 = a->t0, .sizes = a->sizes, .k = a->k, .node = to.node, .which = to.which, .begin = to.begin, .ahead = to.ahead, .c = a->c,
                                   .tables = a->tables, .fewest = a->fewest, .found_q = a->found_q, .found_p = a->found_p, .reached = to.reached,
                                   .scene = a->within_scene};
    if (a->within(&asked) != DONE) return;
    int64_t left = 0;
    for (int64_t i = 0; i < going; i++) {
        if (to.reached[i]) continue;
        if (left < i) {
            COPY(to.start + 2 * n * left, to.start + 2 * n * i, 2 * n);
            to.begin[left] = to.begin[i], to.ahead[left] = to.ahead[i], to.which[left] = to.which[i];
        }
        left++;
    }
    *to.going = left;
}

/* The states at nodes, and the shorter steps that go ahead from there; NOT_CONVERGED where another way is to be taken. */
int go_ahead(const Times *a) {
    const int64_t n = a->n, count = a->count;
    const double first = time_of(a, 0), last = time_of(a, a->nodes - 1), size = fabs(a->h),
                 close = ROUNDING * fmax(fmax(fabs(first), fabs(last)), size) / size, slack = close * size,
                 low = fmin(first, last), high = fmax(first, last);
    const Ahead to = ahead_in(a);
    int64_t going = 0, node = 0;
    for (int64_t i = 0; i < count; i++) {
        const double time = a->times[i];
        node = node_before(a, node, time, slack);
        const double begin = time_of(a, node), left = time - begin,
                     part = left / (a->sizes && node + 1 < a->nodes ? a->sizes[a->k[node]] : a->h);
        if (!(time >= low - slack && time <= high + slack && part > -1 && part <= 1 - close)) return NOT_CONVERGED;
        if (i && !((time - a->times[i - 1]) * a->h >= 0)) return NOT_CONVERGED;
        COPY(a->found_q + n * i, a->q + n * node, n), COPY(a->found_p + n * i, a->p + n * node, n);
        a->found_k[i] = a->k ? a->k[node] : node;
        if (!(part > close)) continue;
        COPY(to.start + 2 * n * going, a->q + n * node, n), COPY(to.start + 2 * n * going + n, a->p + n * node, n);
        to.begin[going] = begin, to.ahead[going] = left, to.node[going] = node, to.which[going++] = i;
    }
    *to.going = going;
    if (a->within) look_within(a);
    return DONE;
}

/* Where these steps end. */
int arrive(const Times *a) {
    const Ahead from = ahead_in(a);
    const int64_t n = a->n, going = *from.going;
    const PartsArguments asked = {.count = going, .told = a->told, .most = a->most, .start = from.start, .t = from.begin, .h = from.ahead,
                                  .c = a->c, .opening = a->opening, .rows = from.rows, .good = from.good, .scene = a->scene};
    if (going && a->parts(&asked) != DONE) return NOT_CONVERGED;
    for (int64_t i = 0; i < going; i++) {
        if (!from.good[i]) return NOT_CONVERGED;
        COPY(a->found_q + n * from.which[i], from.rows + 3 * n * i, n), COPY(a->found_p + n * from.which[i], from.rows + 3 * n * i + n, n);
    }
    return DONE;
}

/* Both, of a loop that is told nothing. */
int at_times(const Times *of) {
    Times a = *of;
    a.room = malloc(ROOM_OF_TIMES(a.n, a.count) * sizeof(double));
    const int done = a.room && go_ahead(&a) == DONE && arrive(&a) == DONE;
    free(a.room);
    return done ? DONE : NOT_CONVERGED;
}

/* The state at an own time of a motion, between its nodes `node` and the next one: q, p and the last velocity, the clock's pace. */
static int state_at(const ClockTimes *of, int64_t node, double tau, double *row) {
    const Times *const a = &of->times;
    const int64_t n = a->n;
    double start[2 * n], begin = a->t[node], ahead = tau - begin;
    int64_t good = 0;
    COPY(start, a->q + n * node, n), COPY(start + n, a->p + n * node, n);
    if (!(fabs(ahead) > ROUNDING * fmax(fabs(tau), fabs(a->h)))) {
        COPY(row, start, 2 * n), row[3 * n - 1] = of->paces[node];
        return 1;
    }
    const PartsArguments asked = {.count = 1, .most = a->most, .start = start, .t = &begin, .h = &ahead, .c = a->c, .rows = row, .good = &good, .scene = a->scene};
    return a->parts(&asked) == DONE && good;
}

/* The node before the time that a clock, the last coordinate, shows, of those from `node` on; never the last one. */
static int64_t node_by_clock(const Times *a, int64_t node, double time) {
    const double sign = a->h > 0 ? 1 : -1, *const clock = a->q + a->n - 1;
    while (node + 2 < a->nodes && sign * clock[a->n * (node + 1)] <= sign * time) node++;
    return node;
}

/* How far behind this node that is, nearly: by Hermite's cubic. */
static double nearly_ahead(const ClockTimes *of, int64_t node, double time) {
    const Times *const a = &of->times;
    const double *const clock = a->q + a->n * node + a->n - 1, passed = clock[a->n] - clock[0], x = (time - clock[0]) / passed, y = 1 - x,
                 rise = a->t[node + 1] - a->t[node];
    return x * (x * (3 - 2 * x) * rise + passed * y * (y / of->paces[node] - x / of->paces[node + 1]));
}

/* `look_within` for times that a clock shows, in order: whether each of them was found; 0 where none was looked for. */
static int64_t *look_within_by_clock(const ClockTimes *of) {
    const Times *const a = &of->times;
    const int64_t count = a->count;
    int64_t *const reached = malloc((size_t)count * 5 * sizeof(double)), *const nodes = reached + count, *const which = nodes + count;
    double *const begin = (double *)(which + count), *const ahead = begin + count;
    if (!reached) return 0;
    for (int64_t i = 0, node = 0; i < count; i++) {
        node = node_by_clock(a, node, a->times[i]);
        nodes[i] = node, which[i] = i, begin[i] = a->t[node], ahead[i] = nearly_ahead(of, node, a->times[i]);
    }
    const WithinArguments asked = {.going = count, .nodes = a->nodes, .most = a->most, .order = a->order, .q = a->q, .p = a->p, .t = a->t,
                                   .h = a->h, .t0 = a->t[0], .node = nodes, .which = which, .begin = begin, .ahead = ahead, .c = a->c,
                                   .tables = a->tables, .fewest = a->fewest, .found_q = a->found_q, .found_p = a->found_p,
                                   .reached = reached, .wanted = a->times, .found_t = of->found_t, .scene = a->within_scene};
    if (a->within(&asked) == DONE) return reached;
    free(reached);
    return 0;
}

/* Where the clock of a motion, its last coordinate, shows the times, which are in any order: varint/integration/time_transformation/
   physical_time.py: reach_times. */
static int reach_by_clock(const ClockTimes *of, const int64_t *reached) {
    const Times *const a = &of->times;
    const int64_t n = a->n, clock = n - 1;
    const double sign = a->h > 0 ? 1 : -1;
    double row[3 * n];
    for (int64_t i = 0, node = 0; i < a->count; i++) {
        const double time = a->times[i];
        if (i && !(sign * (time - a->times[i - 1]) >= 0)) node = 0;
        node = node_by_clock(a, node, time);
        const double passed = a->q[n * (node + 1) + clock] - a->q[n * node + clock], begin = a->t[node], end = a->t[node + 1],
                     rise = end - begin, near = LOCATED * fmax(fabs(time), fabs(passed));
        if (a->k[node + 1] - a->k[node] > 1) return NOT_CONVERGED;
        a->found_k[i] = a->k[node];
        if (reached && reached[i]) continue;
        double tau = begin + nearly_ahead(of, node, time), low = begin, high = end;
        int found = 0;
        for (int k = 0; k < CLOCK_ITERATIONS && !found; k++) {
            if (!state_at(of, node, tau, row)) return NOT_CONVERGED;
            const double off = time - row[clock], step = off / row[3 * n - 1];
            found = fabs(off) <= near || fabs(step) <= LOCATED * fmax(fabs(tau), fabs(rise));
            if (found) break;
            if (step * rise > 0) low = tau;
            else high = tau;
            tau += step;
            if ((tau - low) * (high - tau) < 0) tau = (low + high) / 2;
        }
        if (!found) return NOT_CONVERGED;
        COPY(a->found_q + n * i, row, n), COPY(a->found_p + n * i, row + n, n);
        of->found_t[i] = tau;
    }
    return DONE;
}

int at_clock(const ClockTimes *of) {
    const Times *const a = &of->times;
    const double sign = a->h > 0 ? 1 : -1;
    int looked = a->within != 0;
    for (int64_t i = 1; i < a->count && looked; i++) looked = sign * (a->times[i] - a->times[i - 1]) >= 0;
    int64_t *const reached = looked ? look_within_by_clock(of) : 0;
    const int done = reach_by_clock(of, reached);
    free(reached);
    return done;
}
