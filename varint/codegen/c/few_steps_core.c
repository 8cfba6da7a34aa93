/* The steps of a motion and a look at the energies of its nodes, in one call. The name ends in LEVEL, the instructions that
   are used.

   varint/integration/energy_check.py looks closer where an energy is not quiet. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define few_steps WITH_ALL(few_steps, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "balance.h"
#include "order.h"
#include "held.h"
#include "crossings.h"
#include "sought.h"

/* varint/codegen/few_steps.py has the same layouts */
typedef struct { double gross, nothing, huge, missed, poor; LeapLimits leap; } Limits;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *energy; /* (q, p, t) to the energy and |p v|, or the power of what changes it; by velocity (q, v, t); controls */
    const Limits *limits;
    const void *pivots; /* (q, t) to the least pivot of the constraint rows; 0: they never come to depend on one another */
    int64_t n, carry, most, nodes_of_step, controls, by_velocity, works; /* works: what acts on the scene may change the energy */
    int64_t folds, leaps; /* numbers of a node of a note of a fold, 0: none is made; whether energies may leap from node to node */
    const double *start, *c; /* q and p; parameters */
    double *told;            /* iterations, residual, whether the energy is quiet */
    double *nodes;           /* q of all of them, p, t and their numbers k */
    double *speeds;          /* v of all of them; 0: not wanted */
    const double *u, *mean;  /* controls at the nodes of all steps, and their means over each */
    const double *opening;   /* what the loop is told at a fresh start, so many numbers */
    const int64_t *looked;   /* nodes whose energy is looked at */
    int64_t opens, looks, steps, save_every, pilot; /* pilot: steps after which the iteration must have contracted; 0: it need not */
    double t0, h, level;
    const Sought *sought; /* on the way, where nothing acts by controls; 0: nothing */
    const double *speed;  /* v at the start */
    double *zeros;        /* that are found, as many as there is room for */
    int64_t room;
    Typical typical;
} FewSteps;

/* Whether energies at nodes are that of the start, but for less than what others have looked at closely and found to be
   nothing; `given` may have been given until each of them. */
static int is_quiet(const double *energy, const double *given, const int64_t *looked, int64_t looks, double nothing) {
    for (int64_t i = 0; i < looks; i++) {
        const int64_t k = looked ? looked[i] : i;
        if (!(fabs(energy[k] - energy[0]) <= nothing + (given ? given[k] : 0))) return 0;
    }
    return 1;
}

static Energies energies_of(const FewSteps *a) { return (Energies){a->rows, a->energy, a->c, &a->t0, a->n, a->by_velocity}; }

/* Energies of a scene that keeps its own, at nodes that are looked at. */
static int keeps(const FewSteps *a, const double *rows, double *room) {
    const int64_t looks = a->looks;
    double *const energy = room, *const moving = energy + looks, largest = 0, fastest = 0;
    const Energies of = energies_of(a);
    if (!set_own_energies(&of, rows, a->looked, 0, looks, energy, moving, moving + looks)) return 0;
    for (int64_t i = 0; i < looks; i++) {
        moving[i] = power_of(moving[i]);
        largest = size_of(energy[i], largest), fastest = size_of(moving[i], fastest);
    }
    place(moving, 0, looks - 1, (looks - 1) / 2);
    const double gross = a->limits->gross, size = gross * fastest > largest ? gross * fastest : largest,
                 nothing = a->limits->nothing * size, usual = gross * moving[(looks - 1) / 2];
    return is_quiet(energy, 0, 0, looks, usual > nothing ? usual : nothing);
}

/* The mean controls of the step that begins at each node, or of that which ends there. */
static void set_controls(const FewSteps *a, int64_t nodes, int64_t before, double *u) {
    for (int64_t i = 0; i < nodes; i++) {
        int64_t k = i * a->save_every - before;
        k = k < 0 ? 0 : k >= a->steps ? a->steps - 1 : k;
        memcpy(u + a->controls * i, a->mean + a->controls * k, a->controls * sizeof(double));
    }
}

/* Energies and the work of what changes them. Nodes that lie several steps apart bound that poorly: an explosion alone tells. */
static int balances(const FewSteps *a, const double *rows, const double *t, double *room) {
    const int64_t nodes = a->steps / a->save_every + 1;
    const Balance b = {a->rows, a->energy, a->c, a->n, a->by_velocity ? 2 * a->n : a->n, a->controls, a->limits->missed};
    double *const energy = room, *const power = energy + nodes, *const other = power + nodes, *const u = other + nodes, largest = 0, early = 0;
    if (a->controls) {
        set_controls(a, nodes, 1, u);
        if (!set_energies(&b, rows, nodes, t, u, energy, other)) return 0;
        set_controls(a, nodes, 0, u);
    }
    if (!set_energies(&b, rows, nodes, t, u, energy, power)) return 0;
    if (a->controls) /* they jump at a node */
        for (int64_t k = 0; k < nodes; k++)
            if (power[k] - power[k] == 0 && !(fabs(other[k]) <= fabs(power[k]))) power[k] = other[k];
    double *const given = other;
    given[0] = 0;
    for (int64_t k = 1; k < nodes; k++) given[k] = given[k - 1] + work_before(&b, t, power, k);
    for (int64_t i = 0; i < a->looks; i++) {
        largest = size_of(energy[a->looked[i]], largest);
        if (i < (a->looks + 1) / 2) early = largest;
    }
    const double nothing = a->limits->nothing * largest, huge = a->save_every > 1 ? a->limits->huge * early : 0;
    return is_quiet(energy, given, a->looked, a->looks, huge > nothing ? huge : nothing);
}

/* Are the energies of these nodes quiet, and do they leap nowhere? */
static int is_right(const FewSteps *a, const double *rows, const double *t, double *room) {
    const Energies own = energies_of(a);
    const int64_t nodes = a->steps / a->save_every;
    if (a->works) return balances(a, rows, t, room);
    return keeps(a, rows, room) && (!a->leaps || leaps_nowhere(&own, &a->limits->leap, rows, a->steps, nodes, room));
}

/* What is sought along the nodes, and the run until there: how many nodes it has, and the zeros. Numbers of nodes and times are
   those of the node before the end and of the end, the last node. */
static int seek(FewSteps *a, double *rows, double *p, double *t, int64_t *numbers, int64_t *looked) {
    const Sought *const s = a->sought;
    const int64_t n = a->n, width = 3 * n, samples = s->samples;
    double *const q = a->nodes, *const v = a->speeds;
    Crossings of = crossings_of(s, a->rows, a->c, n, a->most);
    of.t = t, of.q = q, of.v = v, of.p = p;
    Course x = {t, q, v, p, a->zeros, a->steps + 1, a->room, 0, a->typical};
    if (search_along(s, &of, a->h, &x) != SEARCHED) return NOT_CONVERGED;
    a->told[4] = (double)x.found;
    if (!s->stops || !x.found || a->zeros[1] != 0) return DONE;
    const int64_t last = x.nodes - 1;
    const double *const end = a->zeros + 2;
    double *const node = rows + width * last;
    memcpy(node, end + 3, n * sizeof(double)), memcpy(node + n, end + 3 + 2 * n, n * sizeof(double));
    memcpy(node + 2 * n, end + 3 + n, n * sizeof(double));
    memcpy(q + n * last, node, n * sizeof(double)), memcpy(p + n * last, node + n, n * sizeof(double));
    t[last] = end[0], numbers[last] = last - 1, a->steps = last;
    a->looks = last < samples ? last + 1 : samples, a->looked = looked;
    for (int64_t i = 0; i < a->looks; i++) looked[i] = last < samples ? i : (int64_t)(s->places[i] * (double)last);
    return DONE;
}

int few_steps(const FewSteps *asked_for) {
    FewSteps own = *asked_for, *const a = &own;
    const int64_t n = a->n, width = 3 * n, nodes = a->steps / a->save_every + 1;
    double *const q = a->nodes, *const p = q + n * nodes, *const t = p + n * nodes;
    int64_t *const numbers = (int64_t *)(t + nodes);
    const int64_t noted = room_of_notes(a->folds);
    const int64_t kept = (2 + 2 * n) * (a->leaps ? nodes : a->looks), looked = a->works ? (3 + a->controls) * nodes : kept;
    const int64_t told = sizeof(RunStats) / sizeof(double) + width;
    double *const rows = malloc((width * nodes + a->carry + told + noted + looked) * sizeof(double));
    if (!rows) return NOT_FINITE;
    double *const carry = rows + width * nodes, *const stats = carry + a->carry, *const notes = stats + told, *const room = notes + noted;
    RunStats *const of = (RunStats *)stats;
    double iterations = 0, residual = 0;
    int status = DONE;
    carry[0] = 0;
    memcpy(carry + 1, a->opening, a->opens * sizeof(double));
    for (int64_t k = 0, end; k < a->steps && status == DONE; k = end) {
        end = k < a->pilot && a->pilot < a->steps ? a->pilot : a->steps;
        const RunArguments asked = {.steps = end - k, .save_every = a->save_every, .first = k, .most = a->most, .t0 = a->t0,
                                    .h = a->h, .level = a->level, .start = a->start, .c = a->c,
                                    .u = a->u + a->nodes_of_step * a->controls * k, .rows = rows + width * (k / a->save_every),
                                    .carry = carry, .stats = of, .scene = a->scene, .notes = noted ? notes : 0,
                                    .without_velocities = !a->by_velocity && !a->speeds};
        status = a->run(&asked);
        iterations += of->iterations, residual = of->residual > residual ? of->residual : residual;
        if (!k && a->pilot && iterations > a->limits->poor * (double)end) status = NOT_CONVERGED;
        const FoldNotes folds = {a->rows, a->pivots, a->c, carry + a->carry - LATELY * a->folds, a->folds, a->steps, a->t0, a->h};
        if (status == DONE && a->folds && !is_unfolded(&folds, of)) status = NOT_CONVERGED;
    }
    if (status == DONE) {
        memcpy(q, a->start, n * sizeof(double)), memcpy(p, a->start + n, n * sizeof(double));
        for (int64_t k = 1; k < nodes; k++) {
            memcpy(q + n * k, rows + width * k, n * sizeof(double));
            memcpy(p + n * k, rows + width * k + n, n * sizeof(double));
        }
        for (int64_t k = 0; k < nodes; k++) numbers[k] = k * a->save_every, t[k] = a->h * (double)numbers[k] + a->t0;
        for (int64_t k = 0; a->speeds && k < nodes; k++) memcpy(a->speeds + n * k, rows + width * k + 2 * n, n * sizeof(double));
        a->told[0] = iterations, a->told[1] = residual;
        int64_t looked_at[a->sought ? a->sought->samples : 1];
        if (a->sought) {
            memcpy(a->speeds, a->speed, n * sizeof(double)), memcpy(rows + 2 * n, a->speed, n * sizeof(double));
            status = seek(a, rows, p, t, numbers, looked_at);
        }
        a->told[2] = status == DONE && is_right(a, rows, t, room), a->told[3] = (double)(a->steps / a->save_every + 1);
    }
    free(rows);
    return status;
}
