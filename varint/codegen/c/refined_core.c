/* Runs with more and more steps until they prove an error, of scenes with forces or explicit time, in one call. The name
   ends in LEVEL, the instructions that are used.

   varint/integration/short_refinement.py says why, and decides alike where runs are of another kind; its numbers are
   `limits`. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define refined WITH_ALL(refined, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "balance.h"
#include "scales.h"
#include "order.h"
#include "found.h"
#include "other_digits.h"
#include "held.h"
#include "crossings.h"
#include "sought.h"
#include "bends.h"

#define CUT_SHARED 3 /* nodes that runs which end early share at least: those of the whole duration have gone on, and show what was missed */

/* PROVED by all but a closer look at the energy, or at forces that act for less than a step: DOUBTED */
enum Proof { PROVED, NOT_PROVED, NOT_SHORT, DOUBTED };

typedef struct {
    double caution, less, least_order, tells, shared, stalled, patience, floor, no_digits, near, far, runs,
        transient_steps, transient_parts, rounding, secular, level, poor, given, missed, bends, nothing, left,
        at_once, part_of_it, narrow_parts, uncertain, coarser, rounded, secular_growth, grows, chance, uneven, passed, ways, parted, far_below,
        close, bent, sure, repeated;
} Limits;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *balance;       /* (q, p, t), (q, v, t) of held motions, to the energy and the power of forces and explicit time */
    const void *push, *bounds, *bounds_of_many; /* those of varint/integration/force_bounds.py; 0: closer looks are taken elsewhere */
    const Limits *limits;
    const int64_t *body, *turns; /* first coordinate of the same body; is it an angle? */
    const double *looks;         /* parts of a step at which forces are looked at, a few of them first */
    const double *bends;         /* parts of a step at which forces are looked at that bend with velocities, and what makes their two highest
                                    coefficients of the values there; 0: none do */
    const void *pivots;          /* (q, t) to the least pivot of constraint rows; 0: they never come to depend on one another */
    int64_t n, carry, order, timed, looked, few, groups, sampled, pilot, longest; /* whether forces depend on time; steps of a first piece, and of a run that is short */
    int64_t bend_looks;      /* so many */
    int64_t held, folds;     /* constraint rows hold the motion; numbers of a node of a note of a fold, 0: none is made */
    const double *start, *c; /* q and p; parameters */
    Proved *found;
    const double *mass; /* the mass matrix' diagonal, its numbers so far apart */
    int64_t apart;
    Room room;
    int64_t first;
    double t0, duration, radians, tol;
    const void *rates;
    int (*open)(double h); /* writes what the loop is told at a fresh start, so many numbers, for steps h; whether it is there */
    const double *opening;
    int64_t opens;
    Search search;
} Refined;

typedef struct {
    double *rows, *own, iterations, residual;
    int64_t steps; /* of the whole duration */
    Ended ended;   /* of those that were made */
    int lost;
} Attempt;

/* Where iterations may stop, so that what they leave adds up to less than what is wanted. */
static double level_for(const Refined *a, double wanted, int64_t steps) {
    const double often = a->limits->secular / ((double)steps * (double)steps);
    return wanted * (a->limits->level < often ? a->limits->level : often);
}

/* The first `count` of so many steps from a start, held ones with its velocity, by so many times coarser iterations, which are over so much sooner, or
   hardly contract; false where there was no memory, they are too many, or a held motion may pass over a fold. */
static int try_from(const Refined *a, const double *start, const double *speed, double t0, double wanted, int64_t steps, int64_t count,
                    double coarser, Attempt *to) {
    const Limits *const l = a->limits;
    const int64_t n = a->n;
    const double level = level_for(a, wanted, count), most = coarser > 1 ? floor(l->poor * log(level * coarser) / log(level)) : l->poor;
    if (count > a->longest) return 0;
    const int64_t told = 3 * n + sizeof(RunStats) / sizeof(double);
    to->rows = memory_for(3 * n * (count + 1) + a->carry + told + room_of_notes(a->folds), to->rows, to->own);
    if (!to->rows) return 0;
    double *const carry = to->rows + 3 * n * (count + 1), *const notes = carry + a->carry + told;
    RunStats *const stats = (RunStats *)(carry + a->carry);
    carry[0] = 0;
    if (a->opens && !a->open(a->duration / steps)) return 0;
    memcpy(carry + 1, a->opening, a->opens * sizeof(double));
    if (a->held) memcpy(carry + 1 + 2 * n, speed, n * sizeof(double));
    to->steps = steps, to->ended = ended_after(count, t0, a->duration / steps), to->lost = 0, to->iterations = to->residual = 0;
    for (int64_t k = 0, end; k < count && !to->lost; k = end) {
        end = k < a->pilot && a->pilot < count ? a->pilot : count;
        const int status = a->run(&(RunArguments){
            .steps = end - k, .save_every = 1, .first = k, .most = (int64_t)most, .t0 = t0, .h = a->duration / steps,
            .level = level * coarser, .start = start, .c = a->c,
            .rows = to->rows + 3 * n * k, .carry = carry, .stats = stats, .scene = a->scene, .notes = a->folds ? notes : 0,
            .without_velocities = !a->held && !a->search.sought && !a->bends});
        to->iterations += stats->iterations;
        if (stats->residual > to->residual) to->residual = stats->residual;
        to->lost = status != DONE || (!k && a->pilot && to->iterations > most * end);
    }
    if (a->held) {
        const FoldNotes folds = {a->rows, a->pivots, a->c, carry + a->carry - LATELY * a->folds, a->folds, count, t0, a->duration / steps};
        if (a->folds && !to->lost && !is_unfolded(&folds, stats)) return 0;
        memcpy(to->rows + 2 * n, speed, n * sizeof(double)); /* a run in pieces has no other velocity there */
    }
    if (!to->lost) to->lost = unsound(to->rows + 3 * n * count, n) != 0;
    return 1;
}

/* Looks for what is sought along a run. */
static int search(const Refined *a, Attempt *run) {
    const Crossings of = crossings_of(a->search.sought, a->rows, a->c, a->n, a->search.most);
    return search_run(&a->search, of, run->rows, a->t0, a->duration / run->steps, &run->ended);
}

static int try_run(const Refined *a, double wanted, int64_t steps, int64_t count, double coarser, Attempt *to) {
    return try_from(a, a->start, a->opening + 2 * a->n, a->t0, wanted, steps, count, coarser, to);
}

/* Parts between the nodes that two runs of the whole duration share. */
static int64_t shared_parts(const Attempt *one, const Attempt *other) {
    const int64_t unit = common_divisor(one->steps, other->steps), mine = one->ended.whole / (one->steps / unit),
                  its = other->ended.whole / (other->steps / unit);
    return mine < its ? mine : its;
}

/* A run of the whole duration, or until what is sought, which another one has found at this time. */
static int try_whole(const Refined *a, double wanted, int64_t steps, double ends, double coarser, Attempt *to) {
    int64_t count = steps;
    if (!ends_early(&a->search)) return try_run(a, wanted, steps, steps, coarser, to);
    if (steps > a->search.longest) return 0;
    count = steps_until(ends, a->t0, a->duration / steps, steps);
    if (!try_run(a, wanted, steps, count, coarser, to)) return 0;
    if (!to->lost) to->lost = !search(a, to);
    return to->lost || count == steps || is_cut(&to->ended) || try_whole(a, wanted, steps, INFINITY, coarser, to);
}

/* The largest difference of every so many nodes of two runs by the scales; no number where one of them is none. */
static double apart_from(const Refined *a, const Attempt *one, int64_t few, const Attempt *other, int64_t many,
                         const double *scales) {
    const int64_t n = a->n;
    double largest = 0, zero = 0;
    for (int64_t d = 0; d < n; d++) {
        double most = 0;
        for (int64_t k = 0; few * k <= one->ended.whole && many * k <= other->ended.whole; k++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]);
            zero += off * 0, most = off > most ? off : most;
        }
        most /= scales[d], zero += most * 0, largest = most > largest ? most : largest;
    }
    return zero == 0 ? largest : zero;
}

/* The same with their ends, if they may end early. */
static double seen_apart(const Refined *a, const Attempt *one, int64_t few, const Attempt *other, int64_t many, const double *scales) {
    const double apart = apart_from(a, one, few, other, many, scales);
    const double ends = ends_early(&a->search) ? ends_apart(a->n, one->rows, &one->ended, other->rows, &other->ended, scales) : 0;
    return apart == apart && ends > apart ? ends : apart;
}

/* How errors of two runs of the whole duration are spread, the `other` one the finer: the least that an early difference lets
   expect in the middle, and how many times larger they are between the nodes that both share. */
typedef struct { double early, beyond; } Spread;
static Spread spread_of(const Refined *a, const Attempt *one, const Attempt *other, int64_t unit, const double *scales) {
    const int64_t n = a->n, few = one->steps / unit, many = other->steps / unit, parts = shared_parts(one, other), last = other->ended.last,
                  middle = (parts + 1) / 2, first = (parts + 1) / EARLIEST > 1 ? (parts + 1) / EARLIEST : 1;
    double most[n], largest = 0, least = INFINITY;
    memset(most, 0, n * sizeof(double));
    for (int64_t k = 0; k <= parts; k++) {
        for (int64_t d = 0; d < n; d++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]) / scales[d];
            largest = off > largest ? off : largest, most[d] = off > most[d] ? off : most[d];
        }
        if (first <= k && k <= middle) {
            const double expected = expected_in_the_middle(largest, a->limits->rounded, k, middle);
            least = expected < least ? expected : least;
        }
    }
    const int timed = ends_early(&a->search);
    double times[timed ? last + 1 : 1];
    if (timed) set_times(times, &other->ended, a->t0, a->duration / other->steps);
    const Shared shared = {n, 3 * n, last + 1, many, parts + 1, other->rows, timed ? times : 0};
    return (Spread){middle ? least : largest, last < 2 ? 1 : beyond_shared(&shared, most)};
}

/* What passages make of last digits where they magnify them by so much, whole where that is below what is wanted. */
static double passed_by(const Refined *a, double passed, double apart, double beyond) {
    const double seen = a->limits->chance * apart;
    return beyond * (beyond * passed <= a->tol || passed < seen ? passed : seen);
}

/* What iterations leave where errors grow by as much: no more than two runs show, which leave about as much each. */
static double iterated_by(const Refined *a, double each, double apart, double growth, double beyond) {
    const double seen = a->limits->chance * apart, most = a->limits->uneven, uneven = growth < most ? growth : most,
                 grown = each * growth * uneven, made = beyond * (grown < seen ? grown : seen);
    return each > made ? each : made;
}

/* What round-off grows to, the start's included, with which all runs begin alike: by runs whose starts have other last digits,
   and times. */
static double by_round_off(const Refined *a, const Attempt *run, double wanted, double estimate, const double *scales) {
    const Limits *const l = a->limits;
    double start[2 * a->n], most = 0;
    Refined late = *a;
    double zeros[ends_early(&a->search) ? a->search.room * ZERO_SIZE(a->n) : 1];
    late.search.zeros = zeros;
    Attempt other = {0};
    for (int64_t way = 0; way < (int64_t)l->ways; way++) {
        set_other_digits(a->n, a->start, way, start), late.duration = nextafter(a->duration, way ? -INFINITY : INFINITY);
        if (!try_from(&late, start, a->opening + 2 * a->n, a->t0, wanted, run->steps, run->steps, 1, &other) || other.lost) most = INFINITY;
        if (most < INFINITY && ends_early(&a->search) && !search(&late, &other)) most = INFINITY;
        if (!(most < INFINITY)) break;
        const double apart = l->parted * seen_apart(a, run, 1, &other, 1, scales);
        most = !(apart <= most) ? apart : most;
        if (most < l->far_below * estimate || (a->tol < most && most <= estimate)) break;
    }
    free(other.rows);
    return most == most ? most : INFINITY;
}

/* Error of the finer one of two runs that are so far apart. */
static double left_of(const Refined *a, double apart, double ratio, double order) {
    const double sure = order * (order / (double)a->order), least = a->limits->least_order,
                 counted = pow(ratio, -(ratio >= a->limits->far ? a->limits->caution : a->limits->less) * (sure > least ? sure : least));
    return apart * counted / (1 - counted);
}

/* The largest difference of two nodes by the scales of coordinates and momenta. */
static double parted_by(int64_t n, const double *one, const double *other, const double *scales) {
    double largest = 0;
    for (int64_t d = 0; d < 2 * n; d++) {
        const double off = fabs(one[d] - other[d]) / scales[d];
        largest = off > largest ? off : largest;
    }
    return largest;
}

/* Scales of coordinates, which are known, and of momenta: the largest ones of a run. */
static void set_both_scales(const Refined *a, const Attempt *run, const double *of_coordinates, double *scales) {
    const int64_t n = a->n;
    for (int64_t d = 0; d < n; d++) {
        scales[d] = of_coordinates[d], scales[n + d] = 0;
        for (int64_t k = 0; k <= run->ended.last; k++) {
            const double p = fabs(run->rows[3 * n * k + n + d]);
            scales[n + d] = p > scales[n + d] ? p : scales[n + d];
        }
        if (!(scales[n + d] > 0)) scales[n + d] = INFINITY;
    }
}

/* Error of a run whose steps err at once where the scene is narrow: by what they make there when done in parts, over what the
   coarser run is off by at that place; 0 where errors grow bit by bit, infinite where the parts fail.
   varint/integration/narrow_places.py says why. */
static double made_at_once(const Refined *a, const Attempt *before, const Attempt *now, double wanted, double off,
                           const double *of_coordinates) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, unit = common_divisor(before->steps, now->steps), few = 3 * n * (before->steps / unit),
                  each = now->steps / unit, many = 3 * n * each, parts = (int64_t)l->narrow_parts,
                  all = shared_parts(before, now);
    double scales[2 * n], largest = 0, last = 0, here = 0, made = 0;
    set_both_scales(a, now, of_coordinates, scales);
    for (int64_t k = 1; k <= all; k++) {
        const double apart = parted_by(n, before->rows + few * k, now->rows + many * k, scales);
        largest = apart > largest ? apart : largest;
    }
    int64_t k = 0;
    if (!all) return 0;
    do last = here, k++, here = parted_by(n, before->rows + few * k, now->rows + many * k, scales);
    while (k < all && here < l->part_of_it * largest);
    if (!(here > l->at_once * last)) return 0;
    const int64_t end = k < all ? k + 1 : k, over = end - k + 1; /* it may end in the next part */
    Attempt fine = {0};
    const double t0 = a->duration / now->steps * (double)(each * (k - 1)) + a->t0;
    const double *const node = now->rows + many * (k - 1);
    if (!try_from(a, node, node + 2 * n, t0, wanted, parts * now->steps, parts * each * over, 1, &fine) || fine.lost)
        made = INFINITY;
    else
        made = l->uncertain * off * parted_by(n, fine.rows + parts * many * over, now->rows + many * end, scales) / here;
    free(fine.rows);
    return made;
}

/* What steps err by in which forces bend sharply with velocities, by what they make when done in parts, or more than what is
   wanted; infinite where the parts fail. varint/integration/bent_steps.py says why. */
static double made_by_bends(const Refined *a, const Attempt *run, double wanted, const double *of_coordinates) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, steps = run->ended.whole, parts = (int64_t)l->narrow_parts;
    const double h = a->duration / run->steps;
    const Bends of = {a->rows, a->push, a->c, a->bends, a->bends + a->bend_looks, n, a->bend_looks};
    double few[SHORT], *const sharp = memory_for(steps + ROOM_OF_BENDS(n, a->bend_looks), few, few), scales[2 * n], made = 0;
    set_both_scales(a, run, of_coordinates, scales);
    if (!sharp || !set_sharpness(&of, run->rows, steps, a->t0, h, scales + n, sharp, sharp + steps)) made = INFINITY;
    Attempt fine = {0};
    for (int64_t k = 0, end; k < steps && made <= wanted; k = end) {
        for (end = k; end < steps && !(sharp[end] * (double)steps <= l->bent * wanted);) end++;
        if (end++ == k) continue;
        const double *const node = run->rows + 3 * n * k;
        double most = 0;
        if (!try_from(a, node, node + 2 * n, h * (double)k + a->t0, wanted, parts * run->steps, parts * (end - 1 - k), 1, &fine) || fine.lost)
            most = INFINITY;
        for (int64_t i = 0; i < end - k && most < INFINITY; i++) {
            const double off = parted_by(n, fine.rows + 3 * n * parts * i, node + 3 * n * i, scales);
            most = off > most ? off : most;
        }
        made += l->sure * most;
    }
    free(fine.rows), give_up(sharp, few);
    return made;
}

/* The largest coordinate over its scale, one at least. */
static double extent_of(const Refined *a, const Attempt *run, const double *scales) {
    const int64_t n = a->n;
    double size = 1;
    for (int64_t d = 0; d < n; d++) {
        double most = 0;
        for (int64_t k = 0; k <= run->ended.last; k++) {
            const double x = fabs(run->rows[3 * n * k + d]);
            most = x > most ? x : most;
        }
        size = most / scales[d] > size ? most / scales[d] : size;
    }
    return size;
}

/* Whether the energy is clearly that of the start and the work of forces, which `fine` shows too where motions begin: so many
   parts of the first steps. `t`, `room`: times of both, and twice as many numbers. */
static int balanced(const Refined *a, const Attempt *run, const Attempt *fine, int64_t parts, const double *t, double *room) {
    const int64_t nodes = run->ended.last + 1, more = fine->ended.last + 1;
    const Balance b = {a->rows, a->balance, a->c, a->n, a->held ? 2 * a->n : a->n, 0, a->limits->missed};
    double *const energy = room, *const power = energy + nodes + more, largest = 0, given = 0;
    if (!set_energies(&b, fine->rows, more, t + nodes, 0, energy + nodes, power + nodes)) return 0;
    if (!set_energies(&b, run->rows, nodes, t, 0, energy, power)) return 0;
    for (int64_t k = 0; k < nodes; k++) largest = fabs(energy[k]) > largest ? fabs(energy[k]) : largest;
    for (int64_t k = 0; k < nodes; k++) {
        if (k) {
            double early = 0;
            for (int64_t i = parts * (k - 1) + 1; i <= parts * k && i < more; i++) early += work_before(&b, t + nodes, power + nodes, i);
            const double rough = work_before(&b, t, power, k);
            given += early > rough ? early : rough;
        }
        if (!(fabs(energy[k] - energy[0]) <= given + a->limits->given * largest)) return 0;
    }
    return 1;
}

/* Largest forces in so many of the steps, on the straight line between their nodes, at more of the places of the rule:
   `largest`. */
static int look_at_forces(const Refined *a, const Attempt *run, const double *t, int64_t steps, int64_t first, int64_t last,
                          double *largest, double *room) {
    const int64_t n = a->n;
    double *const q = room, *const v = q + n * steps, *const at = v + n * steps, *const force = at + steps, *const mass = force + n * steps;
    for (int64_t i = first; i < last; i++) {
        for (int64_t k = 0; k < steps; k++) {
            const int64_t step = k * run->ended.last / steps;
            const double *const here = run->rows + 3 * n * step, h = t[step + 1] - t[step];
            at[k] = t[step] + a->looks[i] * h;
            for (int64_t d = 0; d < n; d++) {
                const double way = here[3 * n + d] - here[d];
                q[n * k + d] = here[d] + a->looks[i] * way, v[n * k + d] = way / h;
            }
        }
        const RowsArguments asked = {.count = steps, .c = a->c, .scene = a->push, .arguments = {q, v, at}, .apart = {n, n, 1},
                                     .results = {force, mass}, .widths = {n, n}};
        if (a->rows(&asked) != DONE) return 0;
        for (int64_t k = 0; k < n * steps; k++) largest[k] = fabs(force[k]) > largest[k] ? fabs(force[k]) : largest[k];
    }
    return 1;
}

/* The middle one of so many numbers, or between two of them; their order changes. */
static double middle_of(double *x, int64_t many) {
    place(x, 0, many - 1, many / 2);
    const double upper = x[many / 2];
    if (many % 2) return upper;
    place(x, 0, many - 1, many / 2 - 1);
    return (upper + x[many / 2 - 1]) / 2;
}

/* Each one's largest neighbour, and the middle of all steps at least. */
static void set_usual(int64_t n, int64_t steps, const double *largest, double *usual, double *room) {
    for (int64_t d = 0; d < n; d++) {
        for (int64_t k = 0; k < steps; k++) room[k] = largest[n * k + d];
        const double middle = middle_of(room, steps);
        for (int64_t k = 0; k < steps; k++) {
            const double here = largest[n * k + d], before = largest[n * ((k + steps - 1) % steps) + d],
                         behind = largest[n * ((k + 1) % steps) + d], beside = before > behind ? before : behind,
                         around = here > beside ? here : beside;
            usual[n * k + d] = around > middle ? around : middle;
        }
    }
}

/* Error at the end of an impulse at a node, so long before it. */
static double error_of(const Refined *a, int64_t d, double left, const double *scales) {
    double most = 0;
    for (int64_t i = 0; i < a->n; i++) {
        const double m = fabs(a->mass[a->apart * i]);
        most = m > most ? m : most;
    }
    const double m = fabs(a->mass[a->apart * d]);
    return left / (m > 0 ? m : most > 0 ? most : 1) / scales[d];
}

/* Whether bounds for many steps at once do so already. */
static int shows_at_once(const Refined *a, const Attempt *run, const double *t, const double *scales, double *room) {
    const int64_t n = a->n, steps = run->ended.last, groups = a->groups < steps ? a->groups : steps, some = a->sampled < steps ? a->sampled : steps;
    double *const q_low = room, *const q_high = q_low + n * groups, *const v_low = q_high + n * groups, *const v_high = v_low + n * groups,
           *const begin = v_high + n * groups, *const end = begin + groups, *const low = end + groups, *const high = low + n * groups,
           *const down = high + n * groups, *const up = down + n * groups, *const longest = up + n * groups, *const largest = longest + groups,
           *const rest = largest + n * some;
    const double total = fabs(t[steps] - t[0]);
    if (!a->bounds_of_many) return 0;
    for (int64_t g = 0; g < groups; g++) {
        const int64_t first = g * steps / groups, last = (g + 1) * steps / groups;
        begin[g] = t[first], end[g] = t[last], longest[g] = 0;
        for (int64_t d = 0; d < n; d++) {
            const double x = run->rows[3 * n * first + d];
            q_low[n * g + d] = q_high[n * g + d] = x, v_low[n * g + d] = INFINITY, v_high[n * g + d] = -INFINITY;
        }
        for (int64_t k = first; k < last; k++) {
            const double *const here = run->rows + 3 * n * k, h = t[k + 1] - t[k];
            longest[g] = h * h > longest[g] ? h * h : longest[g];
            for (int64_t d = 0; d < n; d++) {
                const int64_t i = n * g + d;
                const double x = here[3 * n + d], v = (x - here[d]) / h;
                q_low[i] = x < q_low[i] ? x : q_low[i], q_high[i] = x > q_high[i] ? x : q_high[i];
                v_low[i] = v < v_low[i] ? v : v_low[i], v_high[i] = v > v_high[i] ? v : v_high[i];
            }
        }
    }
    const RowsArguments asked = {.count = groups, .c = a->c, .scene = a->bounds_of_many,
                                 .arguments = {q_low, q_high, v_low, v_high, begin, end}, .apart = {n, n, n, n, 1, 1},
                                 .results = {low, high, down, up}, .widths = {n, n, n, n}};
    memset(largest, 0, n * some * sizeof(double));
    if (a->rows(&asked) != DONE || !look_at_forces(a, run, t, some, 0, a->few, largest, rest)) return 0;
    for (int64_t d = 0; d < n; d++) {
        for (int64_t k = 0; k < some; k++) rest[k] = largest[n * k + d];
        const double middle = middle_of(rest, some),
                     nothing = a->limits->nothing * a->tol / (error_of(a, d, total, scales) * total);
        for (int64_t g = 0, k = 0; g < groups; g++) {
            const int64_t i = n * g + d, last = (g + 1) * steps / groups;
            double here = INFINITY;
            for (; k < some && k * steps / some < last; k++) here = largest[n * k + d] < here ? largest[n * k + d] : here;
            const double smooth = a->limits->bends * (here > middle ? here : middle);
            if (-down[i] * longest[g] <= smooth && up[i] * longest[g] <= smooth) continue;
            if (!(-low[i] <= nothing && high[i] <= nothing)) return 0;
        }
    }
    return 1;
}

/* Whether bounds rule out that forces bend sharply within a step, as `missed_impulse` asks at a few places and then at all. */
static int shows_forces(const Refined *a, const Attempt *run, const double *t, const double *scales, double *room) {
    const int64_t n = a->n, steps = run->ended.last;
    double *const largest = room, *const bound = largest + n * steps, *const usual = bound + 4 * n * steps, *const rest = usual + n * steps;
    double *const low = bound, *const high = low + n * steps, *const down = high + n * steps, *const up = down + n * steps;
    const double total = fabs(t[steps] - t[0]);
    const RowsArguments asked = {.count = steps, .c = a->c, .scene = a->bounds,
                                 .arguments = {run->rows, run->rows + 3 * n, t, t + 1}, .apart = {3 * n, 3 * n, 1, 1},
                                 .results = {low, high, down, up}, .widths = {n, n, n, n}};
    if (a->rows(&asked) != DONE) return 0;
    memset(largest, 0, n * steps * sizeof(double));
    for (int pass = 0; pass < 2; pass++) {
        const int64_t first = pass ? a->few : 0, last = pass ? a->looked : a->few;
        int hides = 0;
        if (!look_at_forces(a, run, t, steps, first, last, largest, rest)) return 0;
        if (pass) set_usual(n, steps, largest, usual, rest);
        const double *const size = pass ? usual : largest;
        for (int64_t k = 0; k < steps && !hides; k++) {
            const double h = t[k + 1] - t[k], left = fabs(t[steps] - t[k]);
            for (int64_t d = 0; d < n; d++) {
                const double nothing = a->limits->nothing * a->tol / (error_of(a, d, left, scales) * total), smooth = a->limits->bends * size[n * k + d];
                const int64_t i = n * k + d;
                if (-down[i] * (h * h) <= smooth && up[i] * (h * h) <= smooth) continue;
                if (!(-low[i] <= nothing && high[i] <= nothing)) hides = 1;
            }
        }
        if (!hides) return 1;
    }
    return 0;
}

/* What nodes do not tell by their differences alone. */
static int doubted(const Refined *a, const Attempt *run, const Attempt *fine, int64_t parts, const double *scales) {
    const int64_t n = a->n, steps = run->ended.last, all = steps + fine->ended.last + 2, looked = a->timed ? (10 * n + 1) * steps + (8 * n + 3) * a->groups : 0;
    if (a->timed && !(a->push && a->bounds)) return 1;
    double few[SHORT], *const t = memory_for(all + (looked > 2 * all ? looked : 2 * all), few, few);
    if (!t) return 1;
    double *const room = t + all;
    set_times(t, &run->ended, a->t0, a->duration / run->steps), set_times(t + steps + 1, &fine->ended, a->t0, a->duration / fine->steps);
    const int sure = balanced(a, run, fine, parts, t, room) && (!a->timed || shows_at_once(a, run, t, scales, room) || shows_forces(a, run, t, scales, room));
    give_up(t, few);
    return !sure;
}

int refined(const Refined *a) {
    const Limits *const l = a->limits;
    double memory[2][SHORT];
    Attempt before = {.own = own_memory(memory[0], &a->room)}, now = {.own = own_memory(memory[1], &a->room)};
    int result = NOT_SHORT, two = 0, stalls = 0;
    double ends = INFINITY, last = INFINITY, ratio = l->near, slower = l->far, shown = INFINITY, growth = 1, between = 1, scales[a->n];
    const Measures measures = {a->n, a->apart, a->body, a->turns, a->mass};
    int64_t steps = (a->first + 3) / 4 * 4, runs = 0;
    while (runs < (int64_t)l->runs) {
        const double repeated = l->repeated * (double)steps * (double)steps, wanted = a->tol / (growth * between);
        if (repeated > a->tol || !try_whole(a, wanted, steps, ends, two ? 1 : l->coarser, &now)) goto end;
        runs++;
        ends = is_cut(&now.ended) ? now.ended.end : INFINITY;
        if (now.lost) {
            two = stalls = 0, steps *= 2, ratio = l->near, last = shown = INFINITY;
            continue;
        }
        if (two) {
            const int64_t unit = common_divisor(before.steps, steps), together = shared_parts(&before, &now);
            set_scales(&measures, now.rows, 3 * a->n, now.ended.last, scales);
            const double seen = seen_apart(a, &before, before.steps / unit, &now, steps / unit, scales);
            const double expected = last < INFINITY ? last * pow(ratio, -(double)a->order) : 0, off = seen > expected ? seen : expected;
            stalls = off <= l->stalled * last ? 0 : stalls + 1;
            if (seen != seen || stalls > (int)l->patience) break;
            if (off < l->no_digits) {
                const Spread spread = spread_of(a, &before, &now, unit, scales);
                const double grown = seen / (l->secular_growth * (spread.early > l->rounded ? spread.early : l->rounded)); /* growth_of */
                growth = grown > 1 ? grown : 1, between = spread.beyond; /* narrow places that are not resolved look like growth */
            }
            double order = l->least_order;
            if (last < l->tells) {
                const double drop = log((last > l->floor ? last : l->floor) / (off > l->floor ? off : l->floor)) / log(slower);
                if (together >= (int64_t)l->shared) order = drop < shown ? drop : shown;
                shown = drop;
                order = order > l->least_order ? order : l->least_order, order = order < (double)a->order ? order : (double)a->order;
            }
            const double walk = l->rounding * a->radians * sqrt((double)steps) * growth,
                         passed = l->passed * (double)steps / (double)a->first, by_passages = passed_by(a, passed, off, between),
                         rounded = off < walk ? off : walk,
                         each = l->repeated > 0 ? 0 : l->left * level_for(a, wanted, steps) * sqrt((double)steps),
                         iterated = iterated_by(a, each, off, growth, between),
                         floor = (repeated > l->floor ? repeated : l->floor) * extent_of(a, &now, scales);
            if (stalls && rounded == off) break;
            double estimate = left_of(a, off, ratio, order);
            estimate = between * (estimate > rounded ? estimate : rounded);
            estimate = estimate > by_passages ? estimate : by_passages, estimate = estimate > floor ? estimate : floor;
            estimate = estimate > iterated ? estimate : iterated;
            /* of two runs alone nothing is counted on but that the finer one errs by less than several times their difference */
            const int counted = last < INFINITY && unit >= (int64_t)l->shared && !(l->repeated > 0);
            if (counted && off < l->no_digits && estimate <= a->tol) {
                const double at_once = made_at_once(a, &before, &now, wanted, off, scales);
                estimate = estimate > at_once ? estimate : at_once;
            }
            if (a->bends && off > l->close * a->tol && off < l->no_digits && estimate <= a->tol) {
                const double grows = growth * between, made = grows * made_by_bends(a, &now, a->tol / grows, scales);
                estimate = estimate > made ? estimate : made;
            }
            if (off < l->no_digits && estimate <= a->tol && growth >= l->grows) {
                const double turns = a->radians > (double)steps ? a->radians : (double)steps,
                             likely = l->chance * l->rounding * turns * sqrt((double)steps) * growth * between, /* likely_rounding */
                             grown = likely <= a->tol ? likely : by_round_off(a, &now, wanted, estimate, scales);
                if (!(grown <= a->tol)) break; /* it is told elsewhere that it is out of reach */
                estimate = estimate > grown ? estimate : grown;
            }
            int begins_well = 1;
            if (off < l->no_digits && estimate <= a->tol && (together >= CUT_SHARED || !is_cut(&now.ended))) {
                const int64_t apart = steps / unit - 1, most = (int64_t)l->transient_steps, parts = (int64_t)l->transient_parts,
                              few = apart < 1 ? 1 : apart < most ? apart : most; /* before_shared */
                if (!try_run(a, wanted, parts * steps, parts * few, 1, &before)) goto end;
                if (before.lost) break;
                const double early = apart_from(a, &now, 1, &before, parts, scales);
                if (early != early) break;
                begins_well = early <= a->tol;
                if (begins_well) {
                    if (a->search.sought && !ends_early(&a->search) && !search(a, &now)) goto end;
                    result = doubted(a, &now, &before, parts, scales) ? DOUBTED : PROVED;
                    double *const rows = handed_over(now.rows, now.own, a->n, now.ended.last + 1, 2, &a->room);
                    *a->found = (Proved){steps, runs, estimate > early ? estimate : early, now.iterations, now.residual, rows, now.ended.last,
                                         now.ended.found, INFINITY};
                    now.rows = 0;
                    goto end;
                }
            }
            const double next = off * pow(ratio, -l->caution * (double)a->order);
            const int closer = begins_well && !stalls && ratio < l->far && left_of(a, next, ratio, (double)a->order) <= a->tol;
            last = off, slower = ratio, ratio = closer && steps % 2 == 0 ? ratio : l->far;
        }
        const Attempt older = before;
        before = now, now = older, two = 1;
        steps = (int64_t)rint(ratio * (double)steps);
    }
    result = NOT_PROVED;
end:
    give_up(before.rows, before.own), give_up(now.rows, now.own);
    return result;
}
