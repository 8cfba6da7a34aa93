/* Flights in a uniform field, for scenes as data: every rule of order two and more gives the exact parabola. The names end in
   LEVEL, the instructions that are used.

   Rounding would repeat itself from step to step here, so that the mean velocity is summed with its compensation, as
   varint/integration/steppers/uniform_field.py says. What is carried along begins as that of newton.c does. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run_uniform, LEVEL)
#define parts WITH_ALL(parts_uniform, LEVEL)
#define carry_size WITH_ALL(carry_size_uniform, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#define SCENE_AS_DATA
/* varint/codegen/uniform.py has the same layout */
typedef struct {
    int64_t n;
    Tape speed, solved, field; /* p to M^-1 (p - d), x to M^-1 x, and F with M^-1 F */
} Scene;
static _Thread_local const Scene *scene __attribute__((tls_model("initial-exec"))); /* of the run that is going on */
#define N ((int)scene->n)
#define SOLVED_AT scene->speed.registers
#define FIELD_AT (SOLVED_AT + scene->solved.registers)
#define ALL_W (FIELD_AT + scene->field.registers + 1)
#define CARRY_SIZE ((int64_t)(2 + 7 * N))
#define COPY(to, from) memcpy(to, from, (size_t)N * sizeof(double))
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }

INLINE void applied(const Tape *tape, const double *x, const double *w, double *y) {
    evaluate_tape(tape, (const double *const[]){x}, (double *const[]){y}, 1, w);
}

int run(const RunArguments *a) {
    scene = a->scene;
    const double h = a->h;
    double w[ALL_W], force[N], field[N], v[N], zero = 0;
    double *const carry = a->carry, *const q = carry + 2 + 3 * N, *const p = q + N, *const rest_q = p + N, *const rest_p = rest_q + N;
    double *rows = a->rows, *rests = a->rests;
    prepare_tape(&scene->speed, a->c, w), prepare_tape(&scene->solved, a->c, w + SOLVED_AT), prepare_tape(&scene->field, a->c, w + FIELD_AT);
    evaluate_tape(&scene->field, 0, (double *const[]){force, field}, 1, w + FIELD_AT);
    if (!(carry[0] == 1 && carry[1 + 3 * N] == h)) {
        COPY(q, a->start), COPY(p, a->start + N);
        for (int d = 0; d < N; d++) rest_q[d] = rests ? rests[d] : 0, rest_p[d] = rests ? rests[N + d] : 0;
    }
    carry[0] = 1, carry[1 + 3 * N] = h;
    applied(&scene->speed, p, w, v);
    COPY(rows, q), COPY(rows + N, p), COPY(rows + 2 * N, v);
    int64_t done = 0, unsaved = 0;
    for (int ended = 0; done < a->steps && !ended;) {
        double rest[N];
        applied(&scene->solved, rest_p, w + SOLVED_AT, rest);
        for (int d = 0; d < N; d++) {
            compensated(&v[d], &rest[d], 0.5 * h * field[d]);
            compensated(&q[d], &rest_q[d], h * v[d] + h * rest[d]);
            compensated(&p[d], &rest_p[d], h * force[d]);
        }
        applied(&scene->speed, p, w, v);
        done++, ended = is_behind(q[N - 1], a->end);
        if (++unsaved < a->save_every) continue;
        unsaved = 0, rows += 3 * N;
        COPY(rows, q), COPY(rows + N, p), COPY(rows + 2 * N, v);
        if (rests) rests += 2 * N, COPY(rests, rest_q), COPY(rests + N, rest_p);
    }
    COPY(a->stats->last, q), COPY(a->stats->last + N, p), COPY(a->stats->last + 2 * N, v);
    for (int d = 0; d < N; d++) zero += q[d] * 0.0 + p[d] * 0.0;
    const int status = zero == 0 ? DONE : NOT_FINITE;
    a->stats->status = status, a->stats->steps = status ? 0 : (double)done;
    a->stats->iterations = a->stats->most_iterations = a->stats->residual = a->stats->failed = a->stats->contraction = 0;
    a->stats->noted = 0;
    return status;
}
#include "parts.c"
