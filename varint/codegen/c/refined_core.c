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
#include "carry.h"
#include "grades.h"
#include "table.h"
#include "refined.h"
#include "refined_errors.h"
#include "fitted.h"
#include "halved.h"
#include "refined_forces.h"
#include "refined_stages.h"

#define CUT_SHARED 3 /* nodes that runs which end early share at least: those of the whole duration have gone on, and show what was missed */

/* The run as it is found, with times of nodes in the place of velocities. */
static int hand_over_graded(const Refined *a, const Attempt *run, Proved *to) {
    const int64_t n = a->n, nodes = run->steps + 1;
    double *const rows = to->run = malloc((3 * n + 1) * nodes * sizeof(double));
    if (!rows) return 0;
    double *const t = rows + 3 * n * nodes;
    memcpy(rows, run->rows, 3 * n * nodes * sizeof(double)), set_node_times(a, run, t);
    for (int64_t k = 0; k < nodes; k++) rows[3 * n * k + 2 * n] = t[k];
    return 1;
}

/* A proof by runs whose first one may have steps that grow, and those behind it so many times the same, or by some that are fitted to
   where forces bend; `runs` counts them. Where runs are lost or forces bend, one may be halved, once, and those behind it so many times
   the same. */
static int prove(const Refined *a, int grows, int *halves, int64_t *made) {
    const Limits *const l = a->limits;
    double memory[2][SHORT];
    const int looks = a->heights && !a->table.rows;
    Attempt before = {.own = own_memory(memory[0], &a->room)}, now = {.own = own_memory(memory[1], &a->room), .looks = looks};
    int result = NOT_SHORT, two = 0, stalls = 0, clear = 0, halved = 0, losses = 0, many = 0, sharply = 0; /* many: more steps seem to be needed than repay a look at bends */
    double ends = INFINITY, last = INFINITY, ratio = l->near, slower = l->far, shown = INFINITY, growth = 1, between = 1, uneven = 1, scales[a->n];
    const Measures measures = {a->n, a->apart, a->body, a->turns, a->mass};
    int64_t steps = a->table.rows ? a->first : (a->first + 3) / 4 * 4, runs = 0;
    Fits fits = {0};
    while (runs - fits.count < (int64_t)l->runs) {
        const double repeated = l->repeated * (double)steps * (double)steps, wanted = a->tol / (growth * between * uneven);
        if (repeated > a->tol) goto end;
        if (fits.equal && steps > farthest(a)) break;
        if (fits.equal && !two) {
            if (!try_divided(a, wanted, &now)) goto end;
        } else if (halved && !two) {
            if (!try_halving(a, wanted, steps, l->coarser, &now)) goto end;
            halved = 0;
        } else if (!(grows && !runs ? try_growing(a, wanted, steps, l->coarser, &now)
                                    : try_whole(a, wanted, steps, ends, two ? 1 : l->coarser, &now)))
            goto end;
        runs++, steps = now.steps;
        ends = is_cut(&now.ended) ? now.ended.end : INFINITY;
        if (now.lost) {
            if (fits.equal || a->grades->count) break;
            if (may_fit(a, steps) && runs >= (int64_t)l->least_runs) {
                if (!begin_fits(a, &steps, &fits)) goto end;
                two = stalls = 0, growth = between = 1, last = shown = INFINITY;
                continue;
            }
            if (*halves && ++losses >= (int)l->losses && !a->grades->count) halved = 1, *halves = 0;
            runs -= l->repeated > 0; /* steps too long for a map, which was not made */
            two = stalls = 0, steps *= 2, ratio = l->near, last = shown = INFINITY;
            continue;
        }
        if (now.seen) set_seen(a, &now);
        if (fits.equal && !two) {
            set_scales(&measures, now.rows, 3 * a->n, now.ended.last, scales);
            if (is_bent(a, &now, 1, wanted, scales, &fits)) {
                if (!fit(a, &now, wanted, scales, &fits, &steps)) break;
                continue;
            }
        }
        uneven = 1;
        if (two) {
            const int64_t unit = common_divisor(before.steps, steps), together = shared_parts(&before, &now);
            set_scales(&measures, now.rows, 3 * a->n, now.ended.last, scales);
            const double seen = seen_apart(a, &before, before.steps / unit, &now, steps / unit, scales);
            const double expected = last < l->no_digits ? last * pow(slower, -(double)a->order) : 0, off = seen > expected ? seen : expected;
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
            const int asks = off < l->tells && !(between * estimate <= a->tol);
            const double by_stages = asks ? left_by_stages(a, &before, &now, unit, off) : INFINITY;
            const int shown_by_stages = by_stages < estimate;
            estimate = shown_by_stages ? by_stages : estimate;
            estimate = between * (estimate > rounded ? estimate : rounded);
            estimate = estimate > by_passages ? estimate : by_passages, estimate = estimate > floor ? estimate : floor;
            estimate = estimate > iterated ? estimate : iterated;
            /* of two runs alone nothing is counted on but that the finer one errs by less than several times their difference */
            const int counted = shown_by_stages || (last < INFINITY && unit >= (int64_t)l->shared && !(l->repeated > 0));
            if (counted && !shown_by_stages) {
                const double least = between * least_by_stages(a, &before, &now);
                estimate = estimate > least ? estimate : least;
            }
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
            const int has_nodes = together >= CUT_SHARED || !is_cut(&now.ended);
            int begins_well = 1;
            if (fits.equal && fits.parts == 1) { /* what looks at whole steps have missed */
                fits.parts = (int64_t)l->parts, fits.least = INFINITY;
                if (is_bent(a, &now, 0, wanted, scales, &fits)) {
                    fits.equal = fits.equal * steps / before.steps; /* nodes of this run lie between pairs, or steps, of it */
                    fits.equal *= 1 + fits.equal % 2;
                    if (!fit(a, &now, wanted, scales, &fits, &steps)) break;
                    two = stalls = 0, fits.least = INFINITY, ratio = l->near, last = shown = INFINITY;
                    continue;
                }
            }
            if (off < l->no_digits && estimate <= a->tol && has_nodes) {
                const int64_t apart = steps / unit - 1, most = (int64_t)l->transient_steps, parts = (int64_t)l->transient_parts,
                              few = apart < 1 ? 1 : apart < most ? apart : most; /* before_shared */
                const int clearly = begins_clearly(a, &before, &now, few);
                if (!clearly && !try_run(a, wanted, parts * steps, parts * few, 1, &before)) goto end;
                if (before.lost) break;
                const double early = clearly ? 0 : apart_from(a, &now, 1, &before, parts, scales);
                if (early != early) break;
                begins_well = early <= a->tol;
                if (begins_well) {
                    if (a->search.sought && !ends_early(&a->search) && !search(a, &now)) goto end;
                    if (clearly) before.steps = parts * steps, before.ended = (Ended){.last = 0}; /* the start alone */
                    result = doubted(a, &now, &before, parts, scales) ? DOUBTED : PROVED;
                    *a->found = (Proved){steps, *made + runs, estimate > early ? estimate : early, now.iterations, now.residual, 0,
                                         now.ended.last, now.ended.found, INFINITY};
                    if (a->grades->count) {
                        result = result == PROVED ? GRADED : GRADED_DOUBTED;
                        if (!hand_over_graded(a, &now, a->found)) result = NOT_SHORT;
                        goto end;
                    }
                    a->found->run = handed_over(now.rows, now.own, a->n, now.ended.last + 1, 2, &a->room);
                    now.rows = 0;
                    goto end;
                }
            }
            const int low = last < l->tells && order < l->low && off < l->clear;
            many = (low || last == INFINITY) && (double)steps * cbrt(estimate / a->tol) > l->worth;
            sharply = *halves && many && !a->grades->count && bends_sharply(a, &now);
            if (many && low && !sharply && may_fit(a, steps)) {
                const int64_t there = steps;
                growth = between = 1; /* bends look like growth */
                if (!begin_fits(a, &steps, &fits)) goto end;
                if (steps == there && !fit(a, &now, a->tol, scales, &fits, &steps)) break;
                two = stalls = 0, ratio = l->near, last = shown = INFINITY;
                continue;
            }
            const double next = off * pow(l->near, -l->caution * (double)a->order);
            const int closer = begins_well && has_nodes && !stalls && left_of(a, next, l->near, (double)a->order) <= a->tol;
            last = off, slower = ratio, ratio = closer && steps % 2 == 0 && is_divided(a->grades, steps, l->near) ? l->near : l->far;
            if (by_stages < INFINITY && begins_well && has_nodes && !stalls) ratio = ratio_to(a, steps, by_stages, a->tol / between);
        } else {
            if (now.seen) clear = !plan_by_stages(a, &now, &ratio, &uneven), many = ratio > l->near;
            sharply = *halves && many && !a->grades->count && bends_sharply(a, &now);
        }
        if (sharply) {
            steps = (a->first + 3) / 4 * 4, halved = 1, *halves = 0;
            two = stalls = clear = 0, growth = between = uneven = 1, ratio = l->near, last = shown = INFINITY;
            continue;
        }
        const Attempt older = before;
        before = now, now = older, two = 1, now.looks = looks && !clear, clear = 0;
        if (a->table.rows && steps % (2 * a->table.rows)) ratio = l->far; /* as many in each row */
        steps = (int64_t)rint(ratio * (double)steps);
    }
    result = NOT_PROVED;
end:
    give_up(before.rows, before.own), give_up(now.rows, now.own);
    *made += runs;
    return result;
}

int refined(const Refined *asked) {
    Grades grades = {0};
    Refined own = *asked;
    own.grades = &grades;
    int64_t runs = 0;
    int halves = own.grows >= 0 && own.heights && !own.table.rows && !own.search.sought && !(own.limits->repeated > 0),
        grows = own.grows > 0 && !own.search.sought && own.first >= (int64_t)own.limits->fewest && (own.grows < 3 || usual_steps(asked) > 1);
    if (own.search.sought) own.fitted = 0;
    for (;;) { /* until steps that differ have proved it, or equal ones are to */
        const int could = halves, result = prove(&own, grows, &halves, &runs), fitted = grades.at && grades.at != grades.own;
        if (fitted) free(grades.at), grades.at = 0, own.fitted = could > halves ? own.fitted : 0;
        if (!(fitted || grades.count) || result < PROVED) return result;
        if (grows && usual_steps(asked) > 1) return NOT_SHORT; /* as many equal ones are not short */
        grades.count = grows = 0;
    }
}
