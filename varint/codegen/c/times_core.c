/* A motion at times between its nodes, which lie less than a step behind each of them: a shorter step of the same rule. The name
   ends in LEVEL, the instructions that are used.

   varint/results/dense_output.py does the same for all other motions. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define at_times WITH_ALL(at_times, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"

#define ROUNDING (8 * 0x1p-52) /* of times */
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))

/* varint/codegen/times.py has the same layout */
typedef struct {
    int (*parts)(const PartsArguments *);
    const void *scene;
    int64_t n, most, nodes, count; /* coordinates; iterations of a step; of the motion; times */
    const double *t, *q, *p;
    const int64_t *k; /* whole steps before each node */
    const double *c, *times;
    double *found_q, *found_p;
    int64_t *found_k;
    double h;
} Times;

/* The last node that is not behind a time but for round-off, of those from `node` on; times are in order. */
static int64_t node_before(const Times *a, int64_t node, double time, double slack) {
    const double sign = a->h > 0 ? 1 : -1;
    while (node + 1 < a->nodes && sign * a->t[node + 1] <= sign * time + slack) node++;
    return node;
}

/* NOT_CONVERGED where another way is to be taken. */
int at_times(const Times *a) {
    const int64_t n = a->n, count = a->count;
    const double first = a->t[0], last = a->t[a->nodes - 1], size = fabs(a->h),
                 close = ROUNDING * fmax(fmax(fabs(first), fabs(last)), size) / size, slack = close * size,
                 low = fmin(first, last), high = fmax(first, last);
    double *const start = malloc((size_t)count * ((5 * n + 2) * sizeof(double) + 2 * sizeof(int64_t)));
    if (!start) return NOT_CONVERGED;
    double *const rows = start + 2 * n * count, *const begin = rows + 3 * n * count, *const ahead = begin + count;
    int64_t *const good = (int64_t *)(ahead + count), *const which = good + count, going = 0, node = 0;
    int status = DONE;
    for (int64_t i = 0; i < count && status == DONE; i++) {
        const double time = a->times[i];
        node = node_before(a, node, time, slack);
        const double left = time - a->t[node], part = left / a->h;
        if (!(time >= low - slack && time <= high + slack && part > -1 && part <= 1 - close)) status = NOT_CONVERGED;
        if (i && !((time - a->times[i - 1]) * a->h >= 0)) status = NOT_CONVERGED;
        COPY(a->found_q + n * i, a->q + n * node, n), COPY(a->found_p + n * i, a->p + n * node, n), a->found_k[i] = a->k[node];
        if (!(part > close)) continue;
        COPY(start + 2 * n * going, a->q + n * node, n), COPY(start + 2 * n * going + n, a->p + n * node, n);
        begin[going] = a->t[node], ahead[going] = left, which[going++] = i;
    }
    if (status == DONE && going) {
        const PartsArguments asked = {.count = going, .most = a->most, .start = start, .t = begin, .h = ahead, .c = a->c, .rows = rows,
                                      .good = good, .scene = a->scene};
        status = a->parts(&asked);
    }
    for (int64_t i = 0; i < going && status == DONE; i++) {
        if (!good[i]) status = NOT_CONVERGED;
        COPY(a->found_q + n * which[i], rows + 3 * n * i, n), COPY(a->found_p + n * which[i], rows + 3 * n * i + n, n);
    }
    free(start);
    return status;
}
