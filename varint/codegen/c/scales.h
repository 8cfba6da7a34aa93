/* What errors of each coordinate are divided by, as varint/integration/error_scale.py says. */
#define RESTS 1e-12
#define HARDLY 1e-3

typedef struct {
    int64_t n, apart;            /* coordinates; numbers of the mass matrix' diagonal are so far apart */
    const int64_t *body, *turns; /* first coordinate of the same body; is it an angle? */
    const double *mass;
} Measures;

/* Of a run's rows, one a step and one at the start, which begin with q and are so many numbers apart. */
static void set_scales(const Measures *a, const double *rows, int64_t width, int64_t steps, double *scales) {
    const int64_t n = a->n;
    double range[n], square[n], moved = 0, some = INFINITY;
    for (int64_t d = 0; d < n; d++) {
        double high = rows[d], low = high;
        for (int64_t k = 1; k <= steps; k++) {
            const double x = rows[width * k + d];
            high = x > high ? x : high, low = x < low ? x : low;
        }
        const double least = RESTS * (fabs(high) > fabs(low) ? fabs(high) : fabs(low));
        range[d] = high - low <= least ? 0 : high - low;
        square[d] = 0;
    }
    for (int64_t d = 0; d < n; d++) square[a->body[d]] += range[d] * range[d];
    for (int64_t d = 0; d < n; d++) {
        int64_t members = 0;
        for (int64_t i = 0; i < n; i++) members += a->body[i] == a->body[d];
        scales[d] = members > 1 ? sqrt(square[a->body[d]]) : range[d];
        if (a->turns[d] && scales[d] > 1) scales[d] = 1;
        const double mass = n > 1 ? fabs(a->mass[a->apart * d]) : 1;
        if (mass > 0 && !(some < INFINITY)) some = mass;
        else if (mass > some) some = mass;
    }
    if (!(some < INFINITY)) some = 1;
    for (int pass = 0; pass < 2; pass++)
        for (int64_t d = 0; d < n; d++) {
            double mass = n > 1 ? fabs(a->mass[a->apart * d]) : 1;
            mass = mass > 0 ? mass : some;
            if (!pass) {
                const double each = mass * (scales[d] * scales[d]);
                moved = each > moved ? each : moved;
                continue;
            }
            const double least = HARDLY * sqrt(moved / mass), here = fabs(rows[d]);
            scales[d] = scales[d] > least ? scales[d] : least;
            if (!scales[d]) scales[d] = here > 1 ? here : 1;
        }
}

/* Every so many of a run's nodes, and the last one; times, or 0 where steps are equal. */
typedef struct {
    int64_t n, width, nodes, each, shared;
    const double *q, *t;
} Shared;

/* How fast a coordinate is at node k, times how long it has been on the way. */
static double weighed_speed(const Shared *a, int64_t d, int64_t k) {
    const int64_t low = k - 1, high = k + 1 < a->nodes ? k + 1 : k;
    const double way = fabs(a->q[a->width * high + d] - a->q[a->width * low + d]);
    if (!a->t) return (double)k * way * (high - low > 1 ? 0.5 : 1);
    return fabs(a->t[k] - a->t[0]) * way / fabs(a->t[high] - a->t[low]);
}

/* How many times larger than at shared nodes, where each coordinate has at most this error, errors may be between them
   (varint/integration/run_distance.py). */
static double beyond_shared(const Shared *a, const double *off) {
    double largest = 0, beyond = 0;
    for (int64_t d = 0; d < a->n; d++) {
        double most = 0, seen = weighed_speed(a, d, a->nodes - 1);
        for (int64_t k = 1; k < a->nodes; k++) {
            const double here = weighed_speed(a, d, k);
            most = here > most ? here : most;
        }
        for (int64_t i = 1; i < a->shared; i++) {
            const double here = weighed_speed(a, d, i * a->each);
            seen = here > seen ? here : seen;
        }
        const double between = seen > 0 ? off[d] * (most / seen) : off[d];
        largest = off[d] > largest ? off[d] : largest, beyond = between > beyond ? between : beyond;
    }
    return beyond > largest && largest > 0 ? beyond / largest : 1;
}

/* The least that the largest difference `so_far`, up to node k, lets expect in the middle: those of regular motions grow with
   the square of time at most (varint/integration/run_distance.py). */
#define EARLIEST 8
static double expected_in_the_middle(double so_far, double rounded, int64_t k, int64_t middle) {
    const double longer = (double)middle / (double)k;
    return (so_far > rounded ? so_far : rounded) * (longer * longer);
}

static int64_t common_divisor(int64_t x, int64_t y) {
    while (y) { const int64_t rest = x % y; x = y, y = rest; }
    return x;
}
