/* Compositions of kicks and drifts for scenes as data. The names end in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run_explicit, LEVEL)
#define parts WITH_ALL(parts_explicit, LEVEL)
#define carry_size WITH_ALL(carry_size_explicit, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#define SCENE_AS_DATA
/* varint/codegen/native.py has the same layout */
typedef struct {
    int64_t n, controls, kicks;
    const double *kick, *drift, *node;
    Tape rhs, velocity;
} Scene;
static _Thread_local const Scene *scene __attribute__((tls_model("initial-exec"))); /* of the run that is going on */
#define N ((int)scene->n)
#define NU ((int)scene->controls)
#define KICKS ((int)scene->kicks)
#define KICK scene->kick
#define DRIFT scene->drift
#define NODE scene->node
#define RHS_W scene->rhs.registers
#define VELOCITY_W scene->velocity.registers
INLINE void rhs_prepare(const double *c, double *w) { prepare_tape(&scene->rhs, c, w); }
INLINE void velocity_prepare(const double *c, double *w) { prepare_tape(&scene->velocity, c, w); }
INLINE void rhs(const double *q, const double *t, const double *u, const double *w, double *force) {
    evaluate_tape(&scene->rhs, (const double *const[]){q, t, u}, (double *const[]){force}, 1, w);
}
INLINE void velocity(const double *q, const double *p, const double *t, const double *w, double *v) {
    evaluate_tape(&scene->velocity, (const double *const[]){q, p, t}, (double *const[]){v}, 1, w);
}
#include "explicit.c"
#include "parts.c"
