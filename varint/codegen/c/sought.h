/* Zeros of expressions along the nodes of a run, and the run until the first zero of one of them. run.h, rows.h and crossings.h
   stand before this file. */
#define AHEAD 32 /* steps that are searched for an end at first, then GROWTH times as many as there were before (first_crossing.py) */
#define GROWTH 8
#define ROUNDING (8 * 0x1p-52) /* of times (dense_output.py) */
#define ZERO_SIZE(n) (5 + 3 * (n)) /* numbers of a zero: node before it, which expression, then a point: time, value, rate, q, v and p */

/* (q, v, t) to value and rate, bounds; +1: where it rises, -1: where it falls, 0: both */
typedef struct { const void *values, *bounds; int64_t direction; } Watched;

/* varint/codegen/sought.py has the same layouts */
typedef struct {
    int (*search)(const Crossings *);
    int (*parts)(const PartsArguments *);
    const void *scene; /* of that loop */
    int64_t watches, stops, samples; /* expressions; whether the run ends where the first of them does */
    int64_t halvings, deepest, most_pieces, iterations, secants, newton;
    double located, pole, shallow;
    const double *places;   /* in [0, 1]: nodes that are looked at, so many samples */
    const Watched *watched;
} Sought;

/* How a loop that must be told typical sizes is told them, for there are such: of so many nodes, whose times, coordinates and
   momenta are written, the largest ones behind them; whether they are there. */
#define SEEN 8 /* nodes: a look takes as long as to locate a zero (crossings.py) */
typedef struct { int (*sizes)(int64_t count); double *nodes; } Typical;

/* Nodes of a run, and the zeros that were found. */
typedef struct {
    const double *t, *q, *v, *p;
    double *zeros;
    int64_t nodes, room, found;
    Typical typical;
} Course;

/* What the loop must be told at the nodes that steps in question begin at; 0 where it cannot be. */
static int tell(const Course *x, int64_t n, int64_t begin, int64_t end, const char *steps, double *opening) {
    double *const t = x->typical.nodes, *const q = t + SEEN, *const p = q + n * SEEN, *const sizes = p + n * SEEN;
    int64_t some = 0, seen = 0, i = 0;
    for (int64_t k = begin; k < end; k++) some += steps[k] == WANTED;
    const int64_t every = (some + SEEN - 1) / SEEN;
    for (int64_t k = begin; k < end; k++) {
        if (steps[k] != WANTED || i++ % every) continue;
        t[seen] = x->t[k], memcpy(q + n * seen, x->q + n * k, n * sizeof(double)), memcpy(p + n * seen, x->p + n * k, n * sizeof(double));
        seen++;
    }
    if (!x->typical.sizes(seen)) return 0;
    for (int64_t k = begin; k < end; k++) {
        if (steps[k] != WANTED) continue;
        memcpy(opening + 3 * n * k, sizes, 2 * n * sizeof(double)), memcpy(opening + 3 * n * k + 2 * n, x->v + n * k, n * sizeof(double));
    }
    return 1;
}

/* Wanted zeros of one expression in the steps from `begin` to node `end`, behind those that were found. */
static int search_steps(const Sought *s, const Crossings *of, int64_t which, int64_t begin, int64_t end, double h, Course *x) {
    const int64_t size = ZERO_SIZE(of->n), direction = s->watched[which].direction;
    int64_t found[2] = {0, begin};
    char steps[end + 1];
    for (int64_t k = 0; k < end; k++) steps[k] = x->t[k + 1] != x->t[k] ? WANTED : BROKEN;
    Crossings asked = *of;
    double *const zeros = x->zeros + size * x->found;
    const double far = fmax(fmax(fabs(x->t[begin]), fabs(x->t[end])), fabs(h));
    asked.values = s->watched[which].values, asked.bounds = s->watched[which].bounds, asked.zeros = zeros, asked.found = found;
    asked.nodes = end + 1, asked.room = x->room - x->found, asked.close = ROUNDING * far / fabs(h) * fabs(h), asked.steps = steps;
    double *opening = 0;
    if (x->typical.sizes) { /* few steps need a closer look */
        asked.marking = 1;
        if (s->search(&asked) != SEARCHED) return NOT_SOLVED;
        asked.marking = 0, found[0] = 0, found[1] = begin;
        if (!memchr(steps + begin, WANTED, end - begin)) return SEARCHED;
        opening = malloc((size_t)(3 * of->n * end) * sizeof(double));
        if (!opening || !tell(x, of->n, begin, end, steps, opening)) {
            free(opening);
            return NOT_SOLVED;
        }
        asked.opening = opening, asked.told = 3 * of->n;
    }
    const int status = s->search(&asked);
    free(opening);
    for (int64_t i = 0; i < found[0]; i++) {
        const double side = zeros[size * i + 1];
        if (direction ? side != (double)-direction : side == 0) continue;
        double *const to = x->zeros + size * x->found++;
        if (to != zeros + size * i) memcpy(to, zeros + size * i, size * sizeof(double));
        to[1] = (double)which;
    }
    return status;
}

/* All that are wanted; where the run ends with one of them it is the first, and the step that it is in the last that counts. */
static int search_along(const Sought *s, const Crossings *of, double h, Course *x) {
    const int64_t size = ZERO_SIZE(of->n);
    int64_t last = x->nodes - 1;
    int status = SEARCHED;
    if (s->stops)
        for (int64_t begin = 0, end; begin < last && !x->found && status == SEARCHED; begin = end) {
            end = begin + (GROWTH * begin > AHEAD ? GROWTH * begin : AHEAD);
            end = end < last ? end : last;
            status = search_steps(s, of, 0, begin, end, h, x);
        }
    if (x->found) {
        int64_t first = 0;
        for (int64_t i = 1; i < x->found; i++)
            if ((x->zeros[size * i + 2] - x->zeros[size * first + 2]) * h < 0) first = i;
        if (first) memcpy(x->zeros, x->zeros + size * first, size * sizeof(double));
        x->found = 1, last = (int64_t)x->zeros[0] + 1;
    }
    const int64_t end = x->typical.sizes ? x->nodes - 1 : last; /* typical sizes are those of the whole run */
    for (int64_t i = s->stops; i < s->watches && status == SEARCHED; i++) status = search_steps(s, of, i, 0, end, h, x);
    x->nodes = last + 1;
    return status;
}

/* What is looked for along runs for a wanted accuracy. */
typedef struct {
    const Sought *sought; /* 0: nothing */
    const double *speed;  /* v at the start */
    const void *velocities; /* (q, p, t) to v, where runs have none; else 0 */
    double *zeros;        /* that are found, as many as there is room for */
    int64_t room, longest, most; /* steps of a run that is searched as a whole; iterations of a step within it */
    Typical typical;
} Search;

/* The last node of a run, the last one that whole steps have made, zeros that were found, and the time of the last node. */
typedef struct {
    int64_t last, whole, found;
    double end;
} Ended;

/* Steps that a run ends within if it ends where another one did, at this time. */
static int64_t steps_until(double time, double t0, double h, int64_t steps) {
    const double few = ceil((time - t0) / h) + 1;
    return time - time == 0 && few < (double)steps ? (int64_t)few : steps;
}

static int is_cut(const Ended *run) { return run->whole < run->last; }

static int ends_early(const Search *a) { return a->sought && a->sought->stops; }

static Ended ended_after(int64_t steps, double t0, double h) { return (Ended){steps, steps, 0, h * (double)steps + t0}; }

static void set_times(double *t, const Ended *run, double t0, double h) {
    for (int64_t k = 0; k < run->last; k++) t[k] = h * (double)k + t0;
    t[run->last] = run->end;
}

static Crossings crossings_of(const Sought *s, int (*rows)(const RowsArguments *), const double *c, int64_t n, int64_t most) {
    return (Crossings){.parts = s->parts, .scene = s->scene, .rows = rows, .c = c, .n = n, .most = most, .halvings = s->halvings, .deepest = s->deepest,
                       .most_pieces = s->most_pieces, .iterations = s->iterations, .secants = s->secants, .newton = s->newton,
                       .located = s->located, .pole = s->pole, .shallow = s->shallow};
}

/* Velocities of the nodes of a run, where it has none. */
static int set_velocities(const Search *a, const Crossings *of, double *rows, int64_t nodes, const double *t, double *room) {
    const int64_t n = of->n;
    const RowsArguments asked = {.count = nodes, .c = of->c, .scene = a->velocities, .arguments = {rows, rows + n, t}, .apart = {3 * n, 3 * n, 1},
                                 .results = {room}, .widths = {n}};
    if (a->velocities && of->rows(&asked) != DONE) return 0;
    for (int64_t k = 0; a->velocities && k < nodes; k++) memcpy(rows + 3 * n * k + 2 * n, room + n * k, n * sizeof(double));
    memcpy(rows + 2 * n, a->speed, n * sizeof(double)); /* a run in pieces has no other velocity there */
    return 1;
}

/* What is sought along a run until its last node, whose rows are q, p and v, and the run until there; 0 where it is to be looked
   for elsewhere. */
static int search_run(const Search *a, Crossings of, double *rows, double t0, double h, Ended *to) {
    const Sought *const s = a->sought;
    const int64_t n = of.n, nodes = to->last + 1;
    if (to->last > a->longest) return 0;
    double *const t = malloc((size_t)(nodes * (3 * n + 1)) * sizeof(double)), *const q = t + nodes, *const v = q + n * nodes, *const p = v + n * nodes;
    if (!t) return 0;
    set_times(t, to, t0, h);
    int done = set_velocities(a, &of, rows, nodes, t, v);
    for (int64_t k = 0; k < nodes; k++) {
        const double *const node = rows + 3 * n * k;
        memcpy(q + n * k, node, n * sizeof(double)), memcpy(p + n * k, node + n, n * sizeof(double));
        memcpy(v + n * k, node + 2 * n, n * sizeof(double));
    }
    of.t = t, of.q = q, of.v = v, of.p = p;
    Course x = {t, q, v, p, a->zeros, nodes, a->room, 0, a->typical};
    done = done && search_along(s, &of, h, &x) == SEARCHED;
    free(t);
    to->found = x.found;
    if (!done || !s->stops || !x.found || a->zeros[1] != 0) return done;
    const double *const end = a->zeros + 2;
    double *const node = rows + 3 * n * (x.nodes - 1);
    memcpy(node, end + 3, n * sizeof(double)), memcpy(node + n, end + 3 + 2 * n, n * sizeof(double));
    memcpy(node + 2 * n, end + 3 + n, n * sizeof(double));
    to->last = x.nodes - 1, to->whole = to->last - 1, to->end = end[0];
    return 1;
}

#define TELLING 3 /* nodes of a run whose end tells of the length of its steps (varint/integration/run_distance.py) */

/* How far the ends of two runs are apart by the scales, their times included; infinite where the other one, the finer, ends
   within its first step. */
static double ends_apart(int64_t n, const double *one, const Ended *first, const double *other, const Ended *second, const double *scales) {
    const double *const a = one + 3 * n * first->last, *const b = other + 3 * n * second->last, late = fabs(first->end - second->end);
    double largest = 0;
    if (second->last + 1 < TELLING) return INFINITY;
    for (int64_t d = 0; d < n; d++) {
        const double off = (fabs(a[d] - b[d]) + late * fabs(b[2 * n + d])) / scales[d];
        largest = off <= largest ? largest : off;
    }
    return largest;
}
