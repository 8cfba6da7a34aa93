/* A coarse run, the run itself, their energies and their difference: the error of a motion in one call. The name ends in
   LEVEL, the instructions that are used.

   varint/integration/two_runs.py says why, and decides alike where runs are of another kind; its numbers are `limits`. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define two_runs WITH_ALL(two_runs, LEVEL)
#define take_run WITH_ALL(take_run, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "scales.h"
#include "order.h"

double nextafter(double, double);
#define NO_NUMBER (0 * INFINITY)
#define MIDDLE 2 /* of the quantiles */
enum Proof { PROVED, NOT_PROVED, NOT_SHORT };

typedef struct {
    double rough, half, floor, lost, gain, margin, safety, spread, evidence, rounded, no_shrinkage, not_worse, rounding,
        stalled, part_close, caution, least, good, most, far, clear, secular_growth, left,
        uneven, chance, grows, ways, parted, far_below, magnified;
    double samples, most_without_a_part, parts, attempts, watched, first_part, fewest, seen_parts, slow, poor, secular, level;
    double quantiles[QUANTILES];
} Limits;

/* What was found; `run` is to be taken with `take_run`, which frees it. */
typedef struct {
    int64_t steps, runs;
    double estimate, iterations, residual;
    double *run;
} Proved;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *energy; /* (q, p, t) to the energy and |p v|; (q, v, t) by velocity */
    const Limits *limits;
    const int64_t *body, *turns; /* first coordinate of the same body; is it an angle? */
    int64_t n, carry, order, linear, most, pilot, longest; /* steps of a first piece, and of a run that is short */
    int64_t by_velocity; /* velocities are made by the runs, for they have no formula */
    const double *start, *c; /* q and p; parameters */
    Proved *found;
    const double *mass; /* the mass matrix' diagonal, its numbers so far apart */
    int64_t apart, first;
    double t0, duration, radians, tol;
} TwoRuns;

typedef struct {
    double *rows, swing[QUANTILES], iterations, residual;
    int64_t steps;
    int lost;
} Attempt;

/* Quantiles of |H - H0| over the middle one of |p v|; infinite where the motion is lost. */
static void energy_errors(const TwoRuns *a, const double *rows, int64_t count, double *swing, double *room) {
    const int64_t n = a->n, samples = (int64_t)a->limits->samples, every = count / samples > 1 ? count / samples : 1,
                  many = (count + every - 1) / every;
    double *const energy = room, *const moving = room + many;
    const RowsArguments asked = {.count = many, .c = a->c, .scene = a->energy, .arguments = {rows, rows + (a->by_velocity ? 2 * n : n), &a->t0},
                                 .apart = {3 * n * every, 3 * n * every, 0}, .results = {energy, moving}, .widths = {1, 1}};
    if (a->rows(&asked) != DONE) energy[0] = INFINITY; /* no memory */
    quantiles(energy, moving, many, a->limits->quantiles, swing);
}

/* Where iterations may stop, so that what they leave adds up to less than what is wanted. */
static double level_for(const TwoRuns *a, double wanted, int64_t steps) {
    const double often = a->limits->secular / ((double)steps * (double)steps);
    return wanted * (a->limits->level < often ? a->limits->level : often);
}

static double expected_of(const TwoRuns *a, const Attempt *run) {
    return run->lost ? INFINITY : a->limits->gain * run->swing[QUANTILES - 1] * (a->radians > 1 ? a->radians : 1);
}

/* Parts of a coarse run, the first of which is looked at while it is made; 1 where it is too short for that. */
static int64_t watched_parts(const TwoRuns *a, int64_t steps) {
    const int64_t each = steps / (int64_t)a->limits->first_part, most = (int64_t)a->limits->watched,
                  parts = each < most ? each : most;
    return steps <= a->limits->most_without_a_part && parts >= a->limits->fewest ? parts : 1;
}

/* A run of one of so many parts of the steps; `rows` are 0 where there was no memory. One of `watched` parts, more than one,
   ends with the first of them where that is none. A part whose iteration contracts poorly is none, either, nor is a run that
   is no longer than the first part of one which is watched. */
static int try_run(const TwoRuns *a, int64_t steps, double wanted, int64_t part, int64_t watched, Attempt *to, Proved *found) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, count = steps / part > 1 ? steps / part : 1;
    if (count > a->longest) return 0;
    free(to->rows);
    const int64_t samples = 4 * (int64_t)l->samples + 8;
    to->rows = malloc((3 * n * (count + 1) + samples + a->carry + 3 * n + sizeof(RunStats) / sizeof(double)) * sizeof(double));
    if (!to->rows) return 0;
    double *const room = to->rows + 3 * n * (count + 1), *const carry = room + samples;
    RunStats *const stats = (RunStats *)(carry + a->carry);
    carry[0] = 0;
    to->steps = steps, to->lost = 0, to->iterations = to->residual = 0;
    const int64_t seen = watched > 1 ? steps / watched : 0, first = a->pilot < count ? a->pilot : count;
    int status = DONE, early = 0, slow = 0;
    for (int64_t k = 0, end; k < count && status == DONE && !early && !slow; k = end) {
        end = count;
        if (k < seen) end = seen;
        if (k < a->pilot && a->pilot < end) end = a->pilot;
        status = a->run(&(RunArguments){
            .steps = end - k, .save_every = 1, .first = k, .most = a->most, .t0 = a->t0, .h = a->duration / steps,
            .level = level_for(a, wanted, steps), .start = a->start, .c = a->c,
            .rows = to->rows + 3 * n * k, .carry = carry, .stats = stats, .scene = a->scene, .without_velocities = !a->by_velocity});
        to->iterations += stats->iterations;
        if (a->pilot && end == first && to->iterations > l->poor * end) {
            if (part == 1 && end > seen && count >= l->first_part * l->fewest) return 0;
            slow = 1;
        }
        if ((end == seen || (part > 1 && end == count)) && to->iterations > l->slow * end) slow = 1;
        if (stats->residual > to->residual) to->residual = stats->residual;
        if (end != seen || status != DONE || slow) continue;
        energy_errors(a, to->rows, seen + 1, to->swing, room);
        early = !(expected_of(a, to) <= l->lost);
    }
    found->runs++;
    to->lost = status != DONE || slow;
    if (!to->lost && !early) energy_errors(a, to->rows, count + 1, to->swing, room);
    return 1;
}

/* The largest difference of two runs at the nodes that they share, no number where one of them is none, and the least that an
   early one lets expect in the middle: those of regular motions grow with the square of time at most. */
static double apart_from(const TwoRuns *a, const Attempt *one, const Attempt *other, double *early) {
    const int64_t n = a->n, unit = common_divisor(one->steps, other->steps), few = one->steps / unit, many = other->steps / unit;
    const int64_t middle = (unit + 1) / 2, first = (unit + 1) / EARLIEST > 1 ? (unit + 1) / EARLIEST : 1;
    double scales[n], largest = 0, zero = 0, least = INFINITY;
    set_scales(&(Measures){n, a->apart, a->body, a->turns, a->mass}, other->rows, 3 * n, other->steps, scales);
    for (int64_t k = 0; k <= unit; k++) {
        for (int64_t d = 0; d < n; d++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]) / scales[d];
            zero += off * 0, largest = off > largest ? off : largest;
        }
        if (first <= k && k <= middle) {
            const double expected = expected_in_the_middle(largest, a->limits->rounded, k, middle);
            least = expected < least ? expected : least;
        }
    }
    *early = least;
    return zero == 0 ? largest : NO_NUMBER;
}

/* What round-off grows to, the start's included, with which all runs begin alike: from runs whose starts have other last
   digits; less than none where another loop should look. */
static double by_round_off(const TwoRuns *a, const Attempt *run, double wanted, double known, Proved *found) {
    const int64_t n = a->n;
    double start[2 * n], most = 0;
    int64_t begin = 0; /* momenta, or coordinates at rest */
    for (int64_t d = 0; d < 2 * n; d++) {
        start[d] = a->start[d];
        if (d >= n && start[d] != 0) begin = n;
    }
    Attempt other = {0};
    TwoRuns parted = *a;
    parted.start = start;
    for (int64_t way = 0; way < (int64_t)a->limits->ways; way++) {
        for (int64_t i = 0; i < n; i++) {
            const double x = a->start[begin + i];
            start[begin + i] = x == 0 ? x : nextafter(x, (way ? i + 1 : i / 2) % 2 ? -INFINITY : INFINITY);
        }
        double early, apart = INFINITY;
        if (!try_run(&parted, run->steps, wanted, 1, 1, &other, found)) most = -1;
        if (most < 0) break;
        if (!other.lost) apart = a->limits->parted * apart_from(a, run, &other, &early);
        most = !(apart <= most) ? apart : most;
        if (most < a->limits->far_below * known || (a->tol < most && most <= known)) break;
    }
    free(other.rows);
    return most == most ? most : INFINITY;
}

static double ratio_for(const TwoRuns *a, double error, double wanted, double most) {
    if (!(error - error == 0)) return most;
    double x = pow(error / wanted, 1 / (double)a->order);
    x = x > a->limits->least ? x : a->limits->least;
    return x < most ? x : most;
}

static int64_t shared(double steps) {
    const int64_t parts = steps > 256 ? 16 : steps > 96 ? 8 : 4; /* SHARED */
    const double each = ceil(steps / parts);
    return parts * (each > 2 ? (int64_t)each : 2);
}

/* Part of the coarse run's error that the finer one has left; no number where it does not shrink. */
static double shrinkage(const TwoRuns *a, const Attempt *before, const Attempt *after, double ratio) {
    const Limits *const l = a->limits;
    const double sure = pow(ratio, -l->caution * a->order);
    double left = -1;
    for (int i = 0; i < QUANTILES; i++)
        if (before->swing[i] > l->evidence * l->rounded) {
            const double rest = (after->swing[i] > l->rounded ? after->swing[i] : l->rounded) / before->swing[i];
            left = rest > left ? rest : left;
        }
    if (left < 0) return a->linear ? sure : 0.5;
    if (left > l->no_shrinkage) return left < 1 ? l->not_worse : NO_NUMBER;
    left = l->safety * left < 0.5 ? l->safety * left : 0.5;
    return left > sure ? left : sure;
}

int two_runs(const TwoRuns *a) {
    const Limits *const l = a->limits;
    Attempt coarse = {0}, fine = {0};
    int result = NOT_SHORT, known = 0, doubted = 0, measured = 0;
    const double p = (double)a->order, full = a->tol * pow(2, p) / l->half, rough = full < l->rough ? full : l->rough;
    double expected = INFINITY, before = INFINITY, clear = l->clear, growth = 1, start_growth = 1;
    int64_t steps = shared((double)a->first);
    a->found->runs = 0;
    for (int looks = 0; steps > l->most_without_a_part && looks < 3; looks++) {
        if (!try_run(a, steps, rough, (int64_t)l->parts, 1, &coarse, a->found)) goto end;
        const double likely = expected_of(a, &coarse);
        if (rough / l->part_close < likely && likely < rough * l->part_close) break;
        double factor = likely - likely == 0 ? pow((likely > 1e-300 ? likely : 1e-300) / rough, 1 / p) : 2;
        factor = factor < 0.5 ? 0.5 : factor > 2 ? 2 : factor;
        steps = shared(steps * factor);
    }
    for (int attempt = 0; attempt < l->attempts; attempt++) {
        if (!known) {
            if (!try_run(a, steps, rough, 1, watched_parts(a, steps), &coarse, a->found)) goto end;
            expected = expected_of(a, &coarse);
            if (coarse.lost || !(expected <= l->lost)) {
                steps = shared(steps * ratio_for(a, expected, rough, 2));
                continue;
            }
            const double wanted = ratio_for(a, l->margin * expected, a->tol, INFINITY);
            if (wanted > (expected <= clear ? l->far : l->most)) {
                steps = shared(steps * wanted / l->good), clear = l->lost;
                continue;
            }
            known = 1;
        }
        const int64_t more = shared(steps * ratio_for(a, l->margin * expected, a->tol, l->far));
        const double wanted = a->tol / growth;
        double early = 0;
        if (!try_run(a, more, wanted, 1, 1, &fine, a->found)) goto end;
        if (fine.lost) break;
        const double apart = apart_from(a, &coarse, &fine, &early), made = coarse.swing[MIDDLE],
                     regular = l->secular_growth * (early > l->rounded ? early : l->rounded),
                     grown = apart / (made > regular ? made : regular), /* growth_of */
                     often = l->magnified * grown, begun = apart / regular < often ? apart / regular : often; /* magnified */
        start_growth = begun > start_growth ? begun : start_growth;
        growth = grown > growth ? grown : growth;
        const double walk = l->rounding * a->radians * sqrt((double)more) * growth,
                     rounded = apart < walk ? apart : walk, left = shrinkage(a, &coarse, &fine, (double)more / (double)steps);
        const int stalls = apart > l->stalled * before;
        if (!(apart - apart == 0) || (stalls && rounded > a->tol)) break;
        const int shrinks = left == left;
        if (!shrinks) {
            expected = expected_of(a, &fine), expected = apart > expected ? apart : expected;
            if (doubted || !(expected <= l->lost)) break;
        }
        const double uneven = start_growth < l->uneven ? start_growth : l->uneven,
                     spread = l->spread * ((double)common_divisor(steps, more) < l->seen_parts ? uneven : sqrt(uneven));
        const int unseen = growth >= l->grows && rounded > a->tol && !measured; /* other runs show what round-off makes */
        double shown = spread * apart * left / (1 - left);
        shown = shown > rounded || unseen ? shown : rounded, shown = shown > l->floor ? shown : l->floor;
        const double iterated = l->left * level_for(a, wanted, more) * sqrt((double)more) * growth;
        double estimate = shown > iterated ? shown : iterated;
        const int near = apart < l->rough * l->evidence;
        if (shrinks && near && estimate <= a->tol) {
            const double turns = a->radians > (double)more ? a->radians : (double)more;
            const double likely = l->chance * l->rounding * turns * sqrt((double)more) * start_growth;
            double rounded_to = start_growth < l->grows ? 0 : likely <= a->tol ? likely : by_round_off(a, &fine, wanted, estimate, a->found);
            if (rounded_to < 0 || (rounded_to > a->tol && !unseen)) goto end;
            if (unseen) rounded_to *= l->chance, measured = 1;
            if (rounded_to <= a->tol) {
                if (rounded_to > estimate) estimate = rounded_to;
                *a->found = (Proved){more, a->found->runs, estimate, fine.iterations, fine.residual, fine.rows};
                fine.rows = 0, result = PROVED;
                goto end;
            }
        }
        const Attempt older = coarse;
        coarse = fine, fine = older, fine.rows = older.rows;
        steps = more;
        if (shrinks) before = apart, expected = near ? shown : apart;
        else doubted = 1;
    }
    if (start_growth < l->grows && !doubted) result = NOT_PROVED; /* elsewhere it may be shown to be out of reach */
end:
    free(coarse.rows), free(fine.rows);
    return result;
}

/* Coordinates and momenta at the nodes of the run that was found, times and numbers of the nodes, and velocities where they
   are there. */
typedef struct {
    double *run, *nodes;
    int64_t n, steps, by_velocity;
    double t0, h;
} Taken;

int take_run(const Taken *a) {
    const int64_t n = a->n, nodes = a->steps + 1;
    double *const q = a->nodes, *const p = q + n * nodes, *const t = p + n * nodes;
    int64_t *const numbers = (int64_t *)(t + nodes);
    double *const v = (double *)(numbers + nodes);
    for (int64_t k = 0; k < nodes; k++) {
        const double *const row = a->run + 3 * n * k;
        if (a->by_velocity) memcpy(v + n * k, row + 2 * n, n * sizeof(double));
        for (int64_t d = 0; d < n; d++) q[n * k + d] = row[d], p[n * k + d] = row[n + d];
        numbers[k] = k, t[k] = a->h * (double)k + a->t0;
    }
    free(a->run);
    return DONE;
}
