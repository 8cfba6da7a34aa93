/* A function as data at many points, one in each lane. The names end in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define rows WITH_ALL(rows, LEVEL)
#include "widest.h"
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "rows.h"
#define FEW 256 /* vectors that the stack has room for */

/* One number of each of `many` points, so far apart; those that are missing are the last one once more. */
INLINE V gathered(const double *at, int64_t apart, int many) {
    V x;
    if (many < LANES)
        for (int i = 0; i < LANES; i++) set_lane(&x, i, at[(i < many ? i : many - 1) * apart]);
    else if (apart == 1) memcpy(&x, at, sizeof x);
    else
        for (int i = 0; i < LANES; i++) set_lane(&x, i, at[i * apart]);
    return x;
}

INLINE void scatter(V x, double *to, int64_t width, int many) {
    if (many == LANES && width == 1) memcpy(to, &x, sizeof x);
    else if (many == LANES)
        for (int i = 0; i < LANES; i++) to[i * width] = lane(x, i);
    else
        for (int i = 0; i < many; i++) to[i * width] = lane(x, i);
}

int rows(const RowsArguments *a) {
    const Tape *const tape = a->scene;
    int64_t into[MOST_ARGUMENTS + 1] = {0}, from[MOST_ARGUMENTS + 1] = {0};
    for (int64_t k = 0; k < tape->inputs; k++) {
        int64_t *const end = into + tape->input[k].argument + 1;
        if (*end <= tape->input[k].component) *end = tape->input[k].component + 1;
    }
    for (int64_t k = 0; k < tape->outputs; k++) {
        int64_t *const end = from + tape->output[k].argument + 1;
        if (*end <= tape->output[k].component) *end = tape->output[k].component + 1;
    }
    for (int i = 0; i < MOST_ARGUMENTS; i++) into[i + 1] += into[i], from[i + 1] += from[i];
    const int64_t numbers = (tape->registers + into[MOST_ARGUMENTS] + from[MOST_ARGUMENTS]) * LANES;
    V few[FEW], *const own = numbers <= FEW * LANES ? 0 : aligned_alloc(64, (numbers * sizeof(double) + 63) / 64 * 64 + 64);
    V *const w = numbers <= FEW * LANES ? few : own;
    if (!w) return NOT_FINITE;
    V *const x = w + tape->registers, *const y = x + into[MOST_ARGUMENTS];
    const V *arguments[MOST_ARGUMENTS];
    V *results[MOST_ARGUMENTS];
    for (int i = 0; i < MOST_ARGUMENTS; i++) arguments[i] = x + into[i], results[i] = y + from[i];
    prepare_tape(tape, a->c, (double *)w);
    for (int64_t first = 0; first < a->count; first += LANES) {
        const int many = a->count - first < LANES ? (int)(a->count - first) : LANES;
        for (int64_t k = 0; k < tape->inputs; k++) {
            const Moved *const m = tape->input + k;
            const int64_t apart = a->apart[m->argument];
            x[into[m->argument] + m->component] = gathered(a->arguments[m->argument] + first * apart + m->component, apart, many);
        }
        evaluate_tape(tape, arguments, results, 1, (const double *)w);
        for (int64_t k = 0; k < tape->outputs; k++) {
            const Moved *const m = tape->output + k;
            const int64_t width = a->widths[m->argument];
            scatter(y[from[m->argument] + m->component], a->results[m->argument] + first * width + m->component, width, many);
        }
    }
    free(own);
    return DONE;
}
