/* Two runs with equal steps that prove an error, in one call. The name ends in LEVEL, the instructions that are used. */
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
#include "other_digits.h"
#include "proof.h"
#include "found.h"
#include "look_ahead.h"
#include "held.h"
#include "crossings.h"
#include "sought.h"

#define MOST_RATES 2
#define LAST_DIGIT 0x1p-52 /* of the energy */

/* Rates that steps could follow, so many of them, 0 where they are to be asked for: (q, p) to each of them and to velocities;
   how the motion is followed ahead by each; how large a rate is, over its mean, where that repays. */
typedef struct {
    const void *rates;
    int (*look_ahead)(const LookAhead *);
    const void *looks[MOST_RATES];
    int64_t kinds, steps;
    double angle, astray, worth;
} Rates;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *energy; /* (q, p, t) to the energy and |p v|; (q, v, t) by velocity */
    const Limits *limits;
    const int64_t *body, *turns; /* first coordinate of the same body; is it an angle? */
    const void *pivots;          /* (q, t) to the least pivot of constraint rows; 0: they never come to depend on one another */
    const LeapLimits *leaps;     /* 0: energies cannot leap from node to node */
    int64_t n, carry, order, linear, most, pilot, longest; /* steps of a first piece, and of a run that is short */
    int64_t by_velocity; /* velocities are made by the runs, for they have no formula */
    int64_t exact;       /* all steps are one map, which keeps energies but for round-off */
    int64_t held, folds; /* constraint rows hold the motion; numbers of a node of a note of a fold, 0: none is made */
    BEHIND_THE_COURSE
} TwoRuns;
typedef TwoRuns Case;

typedef struct {
    Seen seen;
    double *rows, *own, iterations, residual;
    int64_t nodes; /* that are there */
    Ended ended;
} Attempt;
#include "two_runs.h"

static void release(Attempt *run) { give_up(run->rows, run->own); }

/* Quantiles of |H - H0| over the middle one of |p v|; infinite where the motion is lost. */
static void energy_errors(const TwoRuns *a, const double *rows, int64_t count, Seen *seen, double *room) {
    const int64_t n = a->n, samples = (int64_t)a->limits->samples, every = count / samples > 1 ? count / samples : 1,
                  many = (count + every - 1) / every;
    double *const energy = room, *const moving = room + many;
    const RowsArguments asked = {.count = many, .c = a->c, .scene = a->energy, .arguments = {rows, rows + (a->by_velocity ? 2 * n : n), &a->t0},
                                 .apart = {3 * n * every, 3 * n * every, 0}, .results = {energy, moving}, .widths = {1, 1}};
    if (a->rows(&asked) != DONE) energy[0] = INFINITY; /* no memory */
    const double whole = LAST_DIGIT * fabs(energy[0]);
    quantiles(energy, moving, many, a->limits->quantiles, seen->swing);
    seen->hidden = whole / moving[many / 2];
}

/* Looks for what is sought along a run. */
static int search(const TwoRuns *a, Attempt *run) {
    const Crossings of = crossings_of(a->search.sought, a->rows, a->c, a->n, a->search.most);
    return search_run(&a->search, of, run->rows, a->t0, a->duration / run->seen.steps, &run->ended);
}

/* A part whose iteration contracts poorly is none, nor is a run that is no longer than the first part of one which is
   watched. Held runs that fail, or may pass over a fold, are looked at elsewhere. */
static int try_run(const TwoRuns *a, int64_t steps, double wanted, int64_t part, int64_t watched, Attempt *to) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, all = steps / part > 1 ? steps / part : 1,
                  count = ends_early(&a->search) ? steps_until(a->found->ends, a->t0, a->duration / steps, all) : all;
    if (count > a->longest || (a->held && part > 1)) return 0;
    const int64_t looked = 2 * (int64_t)l->samples, samples = 2 * (count < looked ? count + 1 : looked) + 8,
                  told = 3 * n + sizeof(RunStats) / sizeof(double);
    to->rows = memory_for(3 * n * (count + 1) + samples + a->carry + told + room_of_notes(a->folds), to->rows, to->own);
    if (!to->rows) return 0;
    double *const room = to->rows + 3 * n * (count + 1), *const carry = room + samples, *const notes = carry + a->carry + told;
    RunStats *const stats = (RunStats *)(carry + a->carry);
    carry[0] = 0;
    if (a->opens && !a->open(a->duration / steps)) return 0;
    memcpy(carry + 1, a->opening, a->opens * sizeof(double));
    to->seen.steps = steps, to->nodes = 1, to->seen.lost = 0, to->iterations = to->residual = 0;
    const int64_t seen = watched > 1 && !ends_early(&a->search) ? steps / watched : 0, first = a->pilot < count ? a->pilot : count;
    int status = DONE, early = 0, slow = 0;
    for (int64_t k = 0, end; k < count && status == DONE && !early && !slow; k = end) {
        end = count;
        if (k < seen) end = seen;
        if (k < a->pilot && a->pilot < end) end = a->pilot;
        status = a->run(&(RunArguments){
            .steps = end - k, .save_every = 1, .first = k, .most = a->most, .t0 = a->t0, .h = a->duration / steps,
            .level = level_for(a, wanted, steps), .start = a->start, .c = a->c,
            .rows = to->rows + 3 * n * k, .carry = carry, .stats = stats, .scene = a->scene, .notes = a->folds ? notes : 0,
            .without_velocities = !a->by_velocity && !a->search.sought});
        to->iterations += stats->iterations, to->nodes = k + (int64_t)stats->steps + 1;
        if (a->pilot && end == first && to->iterations > l->poor * end) {
            if (part == 1 && end > seen && count >= l->first_part * l->fewest) return 0;
            slow = 1;
        }
        if ((end == seen || (part > 1 && end == count)) && to->iterations > l->slow * end) slow = 1;
        if (stats->residual > to->residual) to->residual = stats->residual;
        if (end != seen || status != DONE || slow) continue;
        energy_errors(a, to->rows, seen + 1, &to->seen, room);
        early = !(expected_of(a, &to->seen) <= l->lost);
    }
    if (a->held) {
        const FoldNotes folds = {a->rows, a->pivots, a->c, carry + a->carry - LATELY * a->folds, a->folds, count, a->t0, a->duration / steps};
        if (status != DONE || (a->folds && !is_unfolded(&folds, stats))) return 0;
        memcpy(to->rows + 2 * n, a->opening + 2 * n, n * sizeof(double)); /* a run in pieces has no other velocity there */
    }
    to->seen.lost = status != DONE || slow, to->ended = ended_after(count, a->t0, a->duration / steps);
    if (ends_early(&a->search) && count > a->search.longest) return 0;
    if (ends_early(&a->search) && !to->seen.lost) {
        to->seen.lost = !search(a, to), a->found->ends = is_cut(&to->ended) ? to->ended.end : INFINITY;
        if (count < all && !is_cut(&to->ended)) return try_run(a, steps, wanted, part, watched, to);
    }
    a->found->runs++;
    if (a->exact) memset(to->seen.swing, 0, sizeof to->seen.swing), to->seen.hidden = 0;
    else if (!to->seen.lost && !early) energy_errors(a, to->rows, to->ended.last + 1, &to->seen, room);
    if (a->held) to->seen.hidden = 0; /* as in other held runs (two_runs.py: energy_errors) */
    return 1;
}

static int is_short(const Case *a, double steps) { return steps <= (double)a->longest; }

static double apart_from(const Case *a, const Attempt *one, const Attempt *other, double *early, double *beyond) {
    const int64_t n = a->n, unit = common_divisor(one->seen.steps, other->seen.steps), few = one->seen.steps / unit,
                  many = other->seen.steps / unit;
    const int64_t mine = one->ended.whole / few, its = other->ended.whole / many, parts = mine < its ? mine : its, last = other->ended.last;
    const int64_t middle = (parts + 1) / 2, first = (parts + 1) / EARLIEST > 1 ? (parts + 1) / EARLIEST : 1;
    double scales[n], most[n], largest = 0, zero = 0, least = INFINITY;
    memset(most, 0, n * sizeof(double));
    set_scales(&(Measures){n, a->apart, a->body, a->turns, a->mass}, other->rows, 3 * n, last, scales);
    for (int64_t k = 0; k <= parts; k++) {
        for (int64_t d = 0; d < n; d++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]) / scales[d];
            zero += off * 0, largest = off > largest ? off : largest, most[d] = off > most[d] ? off : most[d];
        }
        if (first <= k && k <= middle) {
            const double expected = expected_in_the_middle(largest, a->limits->rounded, k, middle);
            least = expected < least ? expected : least;
        }
    }
    const int timed = a->held || ends_early(&a->search);
    double times[timed ? last + 1 : 1];
    if (timed) set_times(times, &other->ended, a->t0, a->duration / other->seen.steps);
    *early = middle ? least : largest;
    *beyond = last < 2 ? 1 : beyond_shared(&(Shared){n, 3 * n, last + 1, many, parts + 1, other->rows, timed ? times : 0}, most);
    if (ends_early(&a->search)) {
        const double ends = ends_apart(n, one->rows, &one->ended, other->rows, &other->ended, scales);
        largest = largest > ends ? largest : ends;
    }
    return zero == 0 ? largest : NO_NUMBER;
}

/* From runs whose starts have other last digits; what their loops are told at the start is the same. */
static double by_round_off(const Case *a, const Attempt *run, const Doubt *of) {
    const int64_t n = a->n;
    double start[2 * n], most = 0;
    Attempt other = {0};
    TwoRuns parted = *a;
    double zeros[ends_early(&a->search) ? a->search.room * ZERO_SIZE(n) : 1];
    parted.start = start, parted.search.zeros = zeros;
    for (int64_t way = 0; way < (int64_t)a->limits->ways; way++) {
        set_other_digits(n, a->start, way, start);
        double early, beyond, apart = INFINITY;
        if (!try_run(&parted, run->seen.steps, of->wanted, 1, 1, &other)) most = INFINITY; /* no memory */
        if (!(most < INFINITY)) break;
        if (!other.seen.lost) apart = a->limits->parted * apart_from(a, run, &other, &early, &beyond);
        most = !(apart <= most) ? apart : most;
        if (most < a->limits->far_below * of->estimate || (a->tol < most && most <= of->estimate)) break;
    }
    release(&other);
    return most == most ? most : INFINITY;
}

/* As far as its energy stays, and ahead from where it was lost: the start does not tell of encounters. */
static int64_t varying_rate(const Case *a, const Attempt *run) {
    const Rates *const r = a->rates;
    const int64_t n = a->n, samples = (int64_t)a->limits->samples, every = run->nodes / samples > 1 ? run->nodes / samples : 1,
                  many = (run->nodes + every - 1) / every;
    if (!r) return -1;
    if (!r->kinds) return 0;
    double *const energy = malloc((many * (2 + MOST_RATES + n) + 2 * n) * sizeof(double)), *const moving = energy + many;
    int64_t found = -1, good = 0;
    if (!energy) return -1;
    RowsArguments asked = {.count = many, .c = a->c, .scene = a->energy, .arguments = {run->rows, run->rows + n, &a->t0},
                           .apart = {3 * n * every, 3 * n * every, 0}, .results = {energy, moving}, .widths = {1, 1}};
    if (a->rows(&asked) != DONE) goto end;
    for (double most = 0; good < many; good++) {
        most = moving[good] > most ? moving[good] : most;
        if (!(fabs(energy[good] - energy[0]) <= r->astray * most)) break;
    }
    if (!good) goto end;
    double *const rates = moving + many, *const v = rates + MOST_RATES * many, *const last = v + n * many;
    asked = (RowsArguments){.count = good, .c = a->c, .scene = r->rates, .arguments = {run->rows, run->rows + n},
                            .apart = {3 * n * every, 3 * n * every}, .widths = {[MOST_RATES] = n}};
    for (int64_t i = 0; i < MOST_RATES; i++) asked.results[i] = rates + many * i, asked.widths[i] = 1;
    asked.results[r->kinds] = v, asked.widths[r->kinds] = n;
    if (a->rows(&asked) != DONE) goto end;
    memcpy(last, run->rows + 3 * n * every * (good - 1), n * sizeof(double)), memcpy(last + n, v + n * (good - 1), n * sizeof(double));
    const double left = fabs(a->duration) * (1 - (double)(every * (good - 1)) / (double)run->seen.steps);
    for (int64_t i = 0; i < r->kinds && found < 0; i++) {
        double sum = 0, most = 0, ahead[4] = {0};
        for (int64_t k = 0; k < good; k++) {
            const double rate = rates[many * i + k];
            sum += rate, most = rate > most ? rate : most;
        }
        if (most * (double)good < r->worth * sum)
            r->look_ahead(&(LookAhead){.scene = r->looks[i], .start = last, .c = a->c, .told = ahead, .n = n, .steps = r->steps,
                                       .angle = r->angle, .sign = a->duration < 0 ? -1 : 1, .total = left, .astray = r->astray});
        most = ahead[1] > most ? ahead[1] : most;
        if (most * (double)good >= r->worth * sum) found = i;
    }
end:
    free(energy);
    return found;
}

static void keep(const Case *a, Attempt *run, double estimate) {
    const int64_t steps = run->seen.steps, last = run->ended.last;
    const int fails = a->search.sought && !a->search.sought->stops && !search(a, run);
    /* held ones are looked at once more */
    double *const rows = a->held ? run->rows : handed_over(run->rows, run->own, a->n, last + 1, 2 + a->by_velocity, &a->room);
    *a->found = (Proved){steps, a->found->runs, estimate, run->iterations, run->residual, rows, last, fails ? -1 : run->ended.found, INFINITY};
    run->rows = 0;
}

/* Whether energies of the nodes that were found leap nowhere. */
static int is_calm(const TwoRuns *a) {
    if (!a->leaps) return 1;
    const Proved *const found = a->found;
    double *const room = malloc((2 + 2 * a->n) * (found->last + 1) * sizeof(double));
    const Energies own = {a->rows, a->energy, a->c, &a->t0, a->n, a->by_velocity};
    const int calm = room && leaps_nowhere(&own, a->leaps, found->run, found->last, found->last, room);
    free(room);
    return calm;
}

int two_runs(const TwoRuns *a) {
    double memory[2][SHORT], *own[2];
    for (int i = 0; i < 2; i++) own[i] = a->held ? 0 : own_memory(memory[i], &a->room);
    a->found->ends = INFINITY;
    const int result = prove(a, (Attempt){.own = own[0]}, (Attempt){.own = own[1]});
    if ((result == PROVED || result == DOUBTED) && a->found->zeros < 0) {
        free(a->found->run);
        return NOT_SHORT;
    }
    return result == PROVED && !is_calm(a) ? DOUBTED : result;
}

/* Nodes of the run that was found, where they were too many for the room. */
typedef struct {
    double *run, *nodes;
    int64_t n, last, parts;
} Taken;

int take_run(const Taken *a) {
    put_nodes(a->run, a->n, a->last + 1, a->parts, a->nodes);
    free(a->run);
    return DONE;
}
