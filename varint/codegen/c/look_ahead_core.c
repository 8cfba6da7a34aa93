/* The first steps of a motion, explicit and rough: how a rate varies along it. The name ends in LEVEL, the instructions that
   are used.

   varint/integration/time_transformation/rate_pilot.py says why. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define look_ahead WITH_ALL(look_ahead, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "look_ahead.h"

typedef struct {
    Tape rate, step; /* (q, v) to w; (q, v, dt) and the sign to (q, v, dt) after dt, and to dt, w there, energy and p v here */
} Scene;

enum { DT, RATE, ENERGY, SIZE, EACH };

/* Nodes that were seen, the start among them; told is not written where they are fewer than two. */
int look_ahead(const LookAhead *a) {
    const Scene *const of = a->scene;
    const int64_t n = a->n;
    const int64_t registers = of->step.registers > of->rate.registers ? of->step.registers : of->rate.registers;
    double *const w = malloc((of->rate.registers + registers + 2 * n + 1 + EACH) * sizeof(double)), rate;
    if (!w) return 0;
    double *const w_rate = w, *const w_step = w + of->rate.registers, *const y = w_step + registers,
                  *const each = y + 2 * n + 1;
    prepare_tape(&of->rate, a->c, w_rate), prepare_tape(&of->step, a->c, w_step);
    memcpy(y, a->start, 2 * n * sizeof(double));
    evaluate_tape(&of->rate, (const V *const[]){y}, (V *const[]){&rate}, 1, w_rate);
    y[2 * n] = a->angle / rate;
    const double begin = rate;
    double time = 0, before = 0, turned = 0, largest = rate, first = 0, moving = 0, last = rate;
    int seen = 0;
    if (!(rate - rate == 0 && rate > 0)) goto end;
    for (int64_t k = 0; k <= a->steps; k++) {
        if (!(time - time == 0 && rate - rate == 0) || (k && !(before < a->total))) break;
        const double now = rate, late = time;
        if (k < a->steps) {
            evaluate_tape(&of->step, (const V *const[]){y, &a->sign}, (V *const[]){y, each}, 1, w_step);
            const double size = fabs(each[SIZE]);
            first = k ? first : each[ENERGY], moving = size > moving || size != size ? size : moving;
            if (fabs(each[ENERGY] - first) > a->astray * moving) break;
            time += each[DT], rate = each[RATE];
        }
        if (k) turned += (now + last) / 2 * (late - before);
        largest = now > largest ? now : largest;
        seen++, last = now, before = late;
    }
    if (seen > 1) a->told[0] = turned / before, a->told[1] = largest, a->told[2] = before, a->told[3] = begin;
end:
    free(w);
    return seen;
}
