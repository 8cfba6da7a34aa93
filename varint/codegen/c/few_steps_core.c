/* A few steps of a motion and the energies of its nodes, in one call. The name ends in LEVEL, the instructions that are
   used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define few_steps WITH_ALL(few_steps, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"

/* varint/codegen/few_steps.py has the same layout */
typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *energy; /* (q, p, t) to the energy and |p v| */
    int64_t n, carry, most;
    const double *start, *c;
    double *told;  /* iterations, residual, largest change of the energy and largest energy */
    double *nodes; /* q of all of them, p, t and their numbers k */
    int64_t steps;
    double t0, h, level;
} FewSteps;

int few_steps(const FewSteps *a) {
    const int64_t n = a->n, nodes = a->steps + 1;
    double *const q = a->nodes, *const p = q + n * nodes, *const t = p + n * nodes;
    int64_t *const numbers = (int64_t *)(t + nodes);
    double rows[3 * n * nodes], carry[a->carry], energy[nodes], moving[nodes], stats[sizeof(RunStats) / sizeof(double) + 3 * n];
    RunStats *const of = (RunStats *)stats;
    carry[0] = 0;
    const RunArguments asked = {.steps = a->steps, .save_every = 1, .most = a->most, .t0 = a->t0, .h = a->h, .level = a->level,
                                .start = a->start, .c = a->c, .rows = rows, .carry = carry, .stats = of, .scene = a->scene,
                                .without_velocities = 1};
    const int status = a->run(&asked);
    if (status != DONE) return status;
    for (int64_t k = 0; k < nodes; k++) {
        memcpy(q + n * k, k ? rows + 3 * n * k : a->start, n * sizeof(double));
        memcpy(p + n * k, k ? rows + 3 * n * k + n : a->start + n, n * sizeof(double));
        numbers[k] = k, t[k] = a->h * (double)k + a->t0;
    }
    const RowsArguments looked = {.count = nodes, .c = a->c, .scene = a->energy, .arguments = {q, p, &a->t0},
                                  .apart = {n, n, 0}, .results = {energy, moving}, .widths = {1, 1}};
    double change = 0, largest = 0;
    if (a->rows(&looked) != DONE) energy[0] = INFINITY; /* no memory */
    for (int64_t k = 0; k < nodes; k++) {
        const double off = fabs(energy[k] - energy[0]), size = fabs(energy[k]);
        change = off <= change ? change : off, largest = size > largest ? size : largest;
    }
    a->told[0] = of->iterations, a->told[1] = of->residual, a->told[2] = change, a->told[3] = largest;
    return DONE;
}
