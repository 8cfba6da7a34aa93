/* Steps of a scene with a clock among its coordinates until the clock shows a wanted time, with a last one that ends there,
   in one call. The name ends in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define until WITH_ALL(until, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "until.h"

#define AT_ONCE 64       /* steps before it is seen whether the clock goes on */
#define LOCATED 0x1p-50  /* of the time: the end is there */
#define FINER 1e-3       /* of what iterations leave of a step, by which the clock may be off, too: it is known no better */
#define ENDED 1e-13      /* of the duration: less is round-off of the clock, and the end is that of the duration */
#define REACHED 1e-9     /* of the duration: the end is located */
#define AT_LEVEL 6       /* looks at the clock whose steps are solved no further than others */
#define SAMPLES 32       /* energies that are looked at */
#define BESIDES 4        /* more of them, and the paces of the clock there: where it is slowest, and around the end */
#define GROSS 0.25       /* of the largest p·v: a change of the energy that nothing in the scene can do */
#define RESULTS 5

typedef struct { double iterations, residual; int64_t last; } Work;

/* Nodes until the first one at or behind the end; another status than DONE where there is none. */
static int steps_until(const Until *a, double *carry, RunStats *stats, Work *work) {
    const int64_t n = a->n, width = 3 * n, room = a->room / width;
    const double *const clock = a->nodes + n - 1, sign = a->total > 0 ? 1 : -1;
    carry[0] = 0;
    for (int64_t done = 0; (double)done <= a->patience;) {
        const int64_t count = AT_ONCE < room - 1 - done ? AT_ONCE : room - 1 - done;
        if (count < 1) break;
        const RunArguments asked = {.steps = count, .save_every = 1, .first = done, .most = a->most, .h = a->h, .level = a->level,
                                    .start = a->start, .c = a->c, .rows = a->nodes + width * done, .carry = carry,
                                    .stats = stats, .scene = a->scene, .without_velocities = 1, .end = a->total};
        const int status = a->run(&asked);
        work->iterations += stats->iterations;
        if (stats->residual > work->residual) work->residual = stats->residual;
        if (status != DONE) return status;
        done += (int64_t)stats->steps, work->last = done;
        const double here = clock[done * width], passed = here - clock[(done - 1) * width];
        if (is_behind(here, a->total)) return DONE;
        if (!(passed * sign > 0)) break;
    }
    return NOT_CONVERGED;
}

/* Does time go on, and is the energy where the clock is slowest, of `last` steps, still that of the start? And is the constant
   energy at some of the first nodes that of the start, as far as a run that went astray is concerned? And the paces of the clock
   at the last one of these and behind it. There is room for all nodes that are looked at, by one call. */
static int on_level(const Until *a, int64_t last, int64_t nodes, double *room, int64_t *quiet, double *paces) {
    const int64_t n = a->n, width = 3 * n, apart = (nodes + SAMPLES - 1) / SAMPLES, count = (nodes - 1) / apart + 1;
    const double *const clock = a->nodes + n - 1;
    double least = INFINITY, found[RESULTS][SAMPLES + BESIDES];
    int64_t slowest = 0;
    for (int64_t k = 0; k < last; k++) {
        const double pace = (clock[(k + 1) * width] - clock[k * width]) / a->h;
        if (!(pace > 0)) return 0;
        if (pace < least) least = pace, slowest = k;
    }
    const int64_t besides[BESIDES] = {slowest, slowest + 1, nodes - 1, nodes};
    for (int64_t k = 0; k < count + BESIDES; k++)
        memcpy(room + 2 * n * k, a->nodes + width * (k < count ? k * apart : besides[k - count]), 2 * (size_t)n * sizeof *room);
    const RowsArguments looked = {.count = count + BESIDES, .c = a->c, .scene = a->energies, .arguments = {room, room + n},
                                  .apart = {2 * n, 2 * n}, .results = {found[0], found[1], found[2], found[3], found[4]},
                                  .widths = {1, 1, 1, 1, 1}};
    if (a->rows(&looked) != DONE) return 0;
    const double *const energy = found[0] + count, *const size = found[1] + count, most = a->off * fmax(size[0], size[1]);
    double largest = 0;
    for (int64_t k = 0; k < count; k++) largest = found[3][k] > largest ? found[3][k] : largest;
    *quiet = 1, memcpy(paces, found[4] + count + 2, 2 * sizeof *paces);
    for (int64_t k = 0; k < count; k++) *quiet &= fabs(found[2][k] - found[2][0]) <= GROSS * largest;
    return fabs(energy[0] - a->energy) <= most && fabs(energy[1] - a->energy) <= most;
}

/* The fictitious time at which the clock shows the end between the nodes `kept` - 1 and `kept`, whose place the state there
   takes: by the inverse of Hermite's cubic, then Newton's method on the clock (physical_time.py: reach_times). The step there
   begins with what is known of the last one, which begins where it does. */
static int end_at(const Until *a, int64_t kept, const double *paces, double *carry, RunStats *stats, double *time) {
    const int64_t n = a->n, width = 3 * n;
    double *const before = a->nodes + width * (kept - 1), *const after = before + width, ends[2 * width];
    const double from = a->h * (double)(kept - 1), to = a->h * (double)kept, rise = to - from;
    const double passed = after[n - 1] - before[n - 1], x = (a->total - before[n - 1]) / passed, y = 1 - x;
    const double least = LOCATED * fmax(fabs(a->total), fabs(passed));
    double tau = from + x * (x * (3 - 2 * x) * rise + passed * y * (y / paces[0] - x / paces[1]));
    double low = from, high = to, off = INFINITY, close = 0;
    for (int i = 0; i < 60; i++) { /* at the level of the run, unless that does not settle */
        const double level = i < AT_LEVEL ? a->level : 0;
        const RunArguments one = {.steps = 1, .save_every = 1, .most = a->most, .t0 = from, .h = tau - from,
                                  .level = level, .start = before, .c = a->c, .rows = ends,
                                  .carry = carry, .stats = stats, .scene = a->scene};
        if (carry[0]) carry[0] = -1;
        const int status = a->run(&one);
        if (status != DONE) return status;
        *time = tau, close = fmax(least, FINER * level * fabs(passed));
        off = a->total - ends[width + n - 1];
        const double step = off / ends[2 * width - 1];
        if (fabs(off) <= close || fabs(step) <= LOCATED * fmax(fabs(tau), fabs(rise))) break;
        if (step * rise > 0) low = tau;
        else high = tau;
        tau += step;
        if ((tau - low) * (high - tau) < 0) tau = (low + high) / 2;
    }
    memcpy(after, ends + width, width * sizeof(double));
    if (fabs(off) <= fmax(close, ENDED * fabs(a->total))) after[n - 1] = a->total;
    return fabs(off) <= REACHED * fabs(a->total) ? DONE : NOT_CONVERGED;
}

/* Of every so many nodes and of the end, which is node `last`: τ, t, whole steps before it, q, p, one behind the other. */
static void keep(const Until *a, int64_t last, int64_t count, double time) {
    const int64_t n = a->n, width = 3 * n;
    double *const tau = a->kept, *const t = tau + count, *const q = t + 2 * count, *const p = q + n * count;
    int64_t *const steps = (int64_t *)(t + count);
    for (int64_t i = 0; i < count; i++) {
        const int64_t k = i < count - 1 ? i * a->every : last;
        const double *const node = a->nodes + width * k;
        tau[i] = k < last ? a->h * (double)k : time, t[i] = a->t0 + node[n - 1], steps[i] = k < last ? k : last - 1;
        for (int64_t j = 0; j < n; j++) q[n * i + j] = node[j], p[n * i + j] = node[n + j];
    }
}

int until(const Until *a) {
    const int64_t n = a->n, width = 3 * n;
    double *const carry = malloc((size_t)(a->carry + 2 * n * (SAMPLES + BESIDES)) * sizeof(double));
    double stats[sizeof(RunStats) / sizeof(double) + width], paces[2], time;
    if (!carry) return NOT_FINITE;
    RunStats *const of = (RunStats *)stats;
    Work work = {0, 0, 0};
    int status = steps_until(a, carry, of, &work);
    if (status == DONE) {
        int64_t kept = work.last, quiet; /* the node before the last one is not behind the end, but may be there */
        while (kept > 1 && fabs(a->nodes[(kept - 1) * width + n - 1]) >= fabs(a->total) * (1 - LOCATED)) kept--;
        if (kept < work.last) carry[0] = 0;
        status = on_level(a, work.last, kept, carry + a->carry, &quiet, paces) ? end_at(a, kept, paces, carry, of, &time) : NOT_CONVERGED;
        if (status == DONE) {
            *a->told = (Told){kept, (kept - 1) / a->every + 2, (int64_t)work.iterations, quiet, work.residual};
            keep(a, kept, a->told->nodes, time);
        }
    }
    free(carry);
    return status;
}
