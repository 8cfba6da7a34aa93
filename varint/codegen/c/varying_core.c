/* Two runs with steps that follow the scene that prove an error, in one call. The name ends in LEVEL, the instructions that
   are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define varying_runs WITH_ALL(varying_runs, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "until.h"
#include "nearness.h"
#include "scales.h"
#include "order.h"
#include "proof.h"

/* varint/codegen/varying_runs.py has the same layouts. The nodes of the run are where until_core.c keeps them. */
typedef struct {
    int64_t steps, runs;     /* steps of the whole duration at the pace that was foreseen */
    double estimate, wanted; /* wanted, unseen: of a run that is doubted */
    int64_t unseen, failed;  /* failed: so many runs came to no good end */
} Proved;

typedef struct {
    const Limits *limits;
    int (*until)(const Until *), (*swing)(const Swing *), (*apart)(const Apart *);
    int64_t order;
    double patience, sooner, poor; /* steps over those that are expected, and more; iterations a step */
    Course on;
    Places at;
    Until run;
    Proved *found;
    int64_t first;
    double radians, span, tol; /* span: the fictitious time that was foreseen */
} Varying;
typedef struct { const Limits *limits; Proved *found; int64_t order, linear, exact, first; double radians, tol; const Varying *of; } Case;

typedef struct {
    Seen seen;
    Told told;
    double *kept;
} Attempt;
#include "two_runs.h"

static void release(Attempt *run) { free(run->kept); }

static int64_t size_of(const Until *run, const Told *told) { return (3 + 2 * run->n) * told->nodes; }

#define MOST_LOST 3 /* runs, beyond which it is found out elsewhere why */

static int try_run(const Case *a, int64_t steps, double wanted, int64_t part, int64_t watched, Attempt *to) {
    const Varying *const of = a->of;
    Until run = of->run;
    run.h = of->span / (double)steps, run.level = level_for(a, wanted, steps);
    const double expected = steps / part > 1 ? (double)(steps / part) : 1;
    run.total = of->run.total / (double)part, run.patience = of->patience * (expected + of->sooner);
    if (of->until(&run) != DONE) { /* as steps too long for the motion are, a few times */
        a->found->runs++, a->found->failed++;
        to->seen.steps = steps, to->seen.lost = 1;
        return a->found->failed <= MOST_LOST;
    }
    if ((double)run.told->iterations > of->poor * (double)(run.told->steps + 1)) {
        a->found->failed++;
        return 0;
    }
    free(to->kept);
    const size_t size = (size_t)size_of(&run, run.told) * sizeof(double);
    *to = (Attempt){.told = *run.told, .kept = malloc(size), .seen = {.steps = steps}};
    if (!to->kept) return 0;
    memcpy(to->kept, run.kept, size);
    a->found->runs++;
    return of->swing(&(Swing){of->on, of->at, {to->kept, to->told.nodes}, to->seen.swing}) == DONE;
}

static int is_short(const Case *a, double steps) { return 1; }

static double apart_from(const Case *a, const Attempt *one, const Attempt *other, double *early, double *beyond) {
    double told[3] = {NO_NUMBER, NO_NUMBER, 1};
    const Varying *const of = a->of;
    const Kept kept[2] = {{one->kept, one->told.nodes}, {other->kept, other->told.nodes}};
    if (of->apart(&(Apart){of->on, of->at, kept[0], kept[1], one->seen.steps, other->seen.steps, told}) != DONE) return NO_NUMBER;
    *early = told[1], *beyond = told[2];
    return told[0];
}

/* From a start that is made elsewhere. */
static double by_round_off(const Case *a, const Attempt *run, const Doubt *of) {
    a->found->wanted = of->wanted, a->found->unseen = of->unseen;
    return -1;
}

static int64_t varying_rate(const Case *a, const Attempt *run) { return -1; }

static void keep(const Case *a, Attempt *run, double estimate) {
    const Until *const to = &a->of->run;
    a->found->steps = run->seen.steps, a->found->estimate = estimate, *to->told = run->told;
    memcpy(to->kept, run->kept, (size_t)size_of(to, &run->told) * sizeof(double));
}

int varying_runs(const Varying *a) {
    a->found->failed = 0;
    return prove(&(Case){a->limits, a->found, a->order, 0, 0, a->first, a->radians, a->tol, a}, (Attempt){0}, (Attempt){0});
}
