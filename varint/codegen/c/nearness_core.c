/* How near runs in fictitious time are to the motion and to each other: what energies of one tell, and how far two of them
   are apart. The names end in LEVEL, the instructions that are used.

   varint/integration/time_transformation/variable_course.py says why, and does alike where nodes are elsewhere. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define swing WITH_ALL(swing, LEVEL)
#define apart WITH_ALL(apart, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "rows.h"
#include "nearness.h"
#include "scales.h"
#include "order.h"

static const double *times(const Kept *a) { return a->kept + a->nodes; }
static const double *places(const Kept *a) { return a->kept + 3 * a->nodes; }

int swing(const Swing *a) {
    const Kept *const run = &a->run;
    const int64_t width = a->on.width, most = run->nodes / a->on.samples, every = most > 1 ? most : 1,
                  many = (run->nodes + every - 1) / every;
    double *const energy = malloc(2 * many * sizeof(double)), *const moving = energy + many;
    if (!energy) return NOT_FINITE;
    const RowsArguments asked = {
        .count = many, .c = a->at.c, .scene = a->on.energy,
        .arguments = {places(run), places(run) + width * run->nodes, times(run)},
        .apart = {width * every, width * every, every}, .results = {energy, moving}, .widths = {1, 1}};
    const int status = a->on.rows(&asked);
    if (status == DONE) quantiles(energy, moving, many, a->on.parts, a->told);
    free(energy);
    return status;
}

static int64_t parts_of(int64_t nodes, int64_t each) { return (nodes + each - 2) / each; }

/* At nodes of the same fictitious times, whose physical ones differ, and at the ends. */
int apart(const Apart *a) {
    const Kept *const one = &a->one, *const other = &a->other;
    const int64_t n = a->on.n, width = a->on.width, unit = common_divisor(a->few, a->many), each = a->few / unit, of_other = a->many / unit;
    const int64_t here = parts_of(one->nodes, each), there = parts_of(other->nodes, of_other), count = here < there ? here : there;
    const int64_t step = count / a->on.most > 1 ? count / a->on.most : 1, looked = (count + step - 1) / step;
    const int64_t i = step * each, j = step * of_other, middle = (looked + 1) / 2,
                  first = (looked + 1) / EARLIEST > 1 ? (looked + 1) / EARLIEST : 1;
    const double *const q = places(other), *const p = q + width * other->nodes, *const t = times(other);
    double *const v = malloc(looked * n * sizeof(double)), scales[n], most[n], largest = 0, zero = 0, least = INFINITY;
    if (!v) return NOT_FINITE;
    const RowsArguments asked = {.count = looked, .c = a->at.c, .scene = a->on.velocity, .arguments = {q, p, t},
                                 .apart = {width * j, width * j, j}, .results = {v}, .widths = {n}};
    const int status = a->on.rows(&asked);
    set_scales(&(Measures){n, a->at.apart, a->on.body, a->on.turns, a->at.mass}, q, width, other->nodes - 1, scales);
    memset(most, 0, n * sizeof(double));
    for (int64_t k = 0; k <= looked; k++) {
        const int64_t at = k < looked ? i * k : one->nodes - 1, by = k < looked ? j * k : other->nodes - 1;
        const double late = k < looked ? times(one)[at] - t[by] : 0;
        for (int64_t d = 0; d < n; d++) {
            const double between = places(one)[width * at + d] - q[width * by + d];
            const double off = fabs(k < looked ? between - late * v[n * k + d] : between) / scales[d];
            zero += off * 0, largest = off > largest ? off : largest, most[d] = off > most[d] ? off : most[d];
        }
        if (first <= k && k <= middle) {
            const double expected = expected_in_the_middle(largest, a->on.rounded, k, middle);
            least = expected < least ? expected : least;
        }
    }
    a->told[2] = beyond_shared(&(Shared){n, width, other->nodes, j, looked, q, t}, most);
    a->told[0] = zero == 0 ? largest : zero, a->told[1] = zero == 0 ? least : zero;
    free(v);
    return status;
}
