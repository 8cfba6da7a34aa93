/* A motion at times between its nodes, which lie less than a step behind each of them: a shorter step of the same rule. The
   names end in LEVEL, the instructions that are used.

   varint/results/dense_output.py does the same for all other motions. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define at_times WITH_ALL(at_times, LEVEL)
#define go_ahead WITH_ALL(go_ahead, LEVEL)
#define arrive WITH_ALL(arrive, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "times.h"

#define ROUNDING (8 * 0x1p-52) /* of times */
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))

/* How many shorter steps there are, and for each of them q and p where it starts, its time, its length and the number of the time
   where it ends; where they end, and whether they are solved. */
typedef struct {
    int64_t *going;
    double *start, *begin, *ahead;
    int64_t *which;
    double *rows;
    int64_t *good;
} Ahead;

static Ahead ahead_in(const Times *a) {
    const int64_t n = a->n, count = a->count;
    double *const start = a->room + 1, *const begin = start + 2 * n * count, *const rows = begin + 3 * count;
    return (Ahead){(int64_t *)a->room, start, begin, begin + count, (int64_t *)(begin + 2 * count), rows, (int64_t *)(rows + 3 * n * count)};
}

static double time_of(const Times *a, int64_t node) { return a->t ? a->t[node] : a->h * (double)node + a->t0; }

/* The last node that is not behind a time but for round-off, of those from `node` on; times are in order. */
static int64_t node_before(const Times *a, int64_t node, double time, double slack) {
    const double sign = a->h > 0 ? 1 : -1;
    while (node + 1 < a->nodes && sign * time_of(a, node + 1) <= sign * time + slack) node++;
    return node;
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
        const double begin = time_of(a, node), left = time - begin, part = left / a->h;
        if (!(time >= low - slack && time <= high + slack && part > -1 && part <= 1 - close)) return NOT_CONVERGED;
        if (i && !((time - a->times[i - 1]) * a->h >= 0)) return NOT_CONVERGED;
        COPY(a->found_q + n * i, a->q + n * node, n), COPY(a->found_p + n * i, a->p + n * node, n);
        a->found_k[i] = a->k ? a->k[node] : node;
        if (!(part > close)) continue;
        COPY(to.start + 2 * n * going, a->q + n * node, n), COPY(to.start + 2 * n * going + n, a->p + n * node, n);
        to.begin[going] = begin, to.ahead[going] = left, to.which[going++] = i;
    }
    *to.going = going;
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
