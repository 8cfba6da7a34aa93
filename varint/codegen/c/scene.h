/* A scene and a Gauss rule as data, in place of the definitions and functions of generated source.

   tape.h stands before this file. varint/codegen/core.py has the same layout. */
#define SCENE_AS_DATA
#define MOST_N 256
#define MOST_NU 64

typedef struct {
    int64_t n, controls, stages, diagonals, on_velocity, ahead, by_defect, legendre_iterations, halvings, work, geometry;
    const char *needs_q, *needs_p;
    const double *const *tables;
    /* accelerations; or forces, and velocities made of new momenta, and inertias where these are of momenta that are missed;
       velocities of momenta, or where they are found by Newton's method what is missing and its correction (legendre.h). Those
       of dense.c in place of the first three: geometry, which leaves so many numbers to the others, product and push. */
    Tape rhs[2], inertia, velocity, momentum;
} Scene;
static _Thread_local const Scene *scene __attribute__((tls_model("initial-exec"))); /* of the run that is going on */

#define N ((int)scene->n)
#define NU ((int)scene->controls)
#define STAGES ((int)scene->stages)
#define DIAGONALS scene->diagonals
#define ON_VELOCITY scene->on_velocity
#define AHEAD scene->ahead
#define BY_DEFECT scene->by_defect
#define LEGENDRE_ITERATIONS scene->legendre_iterations
#define HALVINGS scene->halvings
#define NEEDS_Q scene->needs_q
#define NEEDS_P scene->needs_p
/* the tableau, in the order of varint/codegen/tableau.py */
#define STAGE_C scene->tables[0]
#define STAGE_B scene->tables[1]
#define STAGE_BETA scene->tables[2]
#define STAGE_M1 scene->tables[3]
#define STAGE_M2 scene->tables[4]
#define START_M1 scene->tables[5]
#define START_OLDER_M1 scene->tables[6]
#define START_ONE_M1 scene->tables[7]
#define LOW_M1 scene->tables[8]
#define LOW_OLDER_M1 scene->tables[9]
#define LOW_ONE_M1 scene->tables[10]
#define START_M2 scene->tables[11]
#define START_OLDER_M2 scene->tables[12]
#define START_ONE_M2 scene->tables[13]
#define LOW_M2 scene->tables[14]
#define LOW_OLDER_M2 scene->tables[15]
#define LOW_ONE_M2 scene->tables[16]
#define START_M0 scene->tables[17]
#define START_OLDER_M0 scene->tables[18]
#define START_ONE_M0 scene->tables[19]
#define LOW_M0 scene->tables[20]
#define LOW_OLDER_M0 scene->tables[21]
#define LOW_ONE_M0 scene->tables[22]
#define STAGE_INVERSE scene->tables[23]
#define STAGE_MODES scene->tables[24]
#define STAGE_OF_MODES scene->tables[25]
#define MODE_RE scene->tables[26]
#define MODE_IM scene->tables[27]
#define PADDED (VECTORS * LANES)
#define FILE_SIZE(tape) (LANES * scene->tape.registers)
#define KICK_W FILE_SIZE(rhs[0])
#define DRIFT_W FILE_SIZE(rhs[1])
#define INERTIA_W FILE_SIZE(inertia)
#define RHS_W (KICK_W + DRIFT_W + INERTIA_W)
#define VELOCITY_W FILE_SIZE(velocity)
#define MOMENTUM_W FILE_SIZE(momentum)
#if DENSE
#define GEOMETRY ((int)scene->geometry)
#define GEOMETRY_W KICK_W
#define PRODUCT_W DRIFT_W
#define PUSH_W INERTIA_W
#define STRIDE VECTORS
INLINE void geometry_prepare(const double *c, double *w) { prepare_tape(&scene->rhs[0], c, w); }
INLINE void product_prepare(const double *c, double *w) { prepare_tape(&scene->rhs[1], c, w); }
INLINE void push_prepare(const double *c, double *w) { prepare_tape(&scene->inertia, c, w); }
INLINE void geometry(const V *q, const V *t, const double *w, V *g, V *d) {
    evaluate_tape(&scene->rhs[0], (const V *const[]){q, t}, (V *const[]){g, d}, 1, w);
}
INLINE void product(const V *q, const V *g, const V *v, const V *t, const double *w, V *y) {
    evaluate_tape(&scene->rhs[1], (const V *const[]){q, g, v, t}, (V *const[]){y}, 1, w);
}
INLINE void push(const V *q, const V *g, const V *v, const V *t, const V *u, const double *w, V *f) {
    evaluate_tape(&scene->inertia, (const V *const[]){q, g, v, t, u}, (V *const[]){f}, 1, w);
}
#include "dense.c"
#endif

INLINE double *registers(void) {
    return aligned_alloc(64, ((RHS_W + VELOCITY_W + MOMENTUM_W + LANES) * sizeof(double) + 63) / 64 * 64);
}
/* Room for what one function of the right-hand side leaves to another. */
INLINE V *taken_room(void) {
    return aligned_alloc(64, (size_t)(scene->rhs[0].outputs + scene->inertia.outputs + 1) * VECTORS * sizeof(V) / 64 * 64 + 64);
}
INLINE void velocity_prepare(const double *c, double *w) { prepare_tape(&scene->velocity, c, w); }
INLINE void momentum_prepare(const double *c, double *w) { prepare_tape(&scene->momentum, c, w); }
INLINE void momentum(const V *q, const V *v, const V *t, const double *w, V *p) {
    evaluate_tape(&scene->momentum, (const V *const[]){q, v, t}, (V *const[]){p}, 1, w);
}
#if !DENSE
INLINE void kick_prepare(const double *c, double *w) { prepare_tape(&scene->rhs[0], c, w); }
INLINE void drift_prepare(const double *c, double *w) { prepare_tape(&scene->rhs[1], c, w); }
INLINE void inertia_prepare(const double *c, double *w) { prepare_tape(&scene->inertia, c, w); }
#if FORM == 2
INLINE void rhs_prepare(const double *c, double *w) { kick_prepare(c, w), drift_prepare(c, w + KICK_W); }
INLINE void rhs(const V *q, const V *v, const V *t, const V *u, const double *w, V *a) {
    evaluate_tape(&scene->rhs[0], (const V *const[]){q, v, t, u}, (V *const[]){a}, VECTORS, w);
}
#else
INLINE void kick(const V *q, const V *p, const V *t, const V *u, const double *w, V *f, V *had, V *taken) {
    evaluate_tape(&scene->rhs[0], (const V *const[]){q, p, t, u}, (V *const[]){f, BY_DEFECT ? had : taken}, VECTORS, w);
}
INLINE void inertia(const V *q, const V *v, const V *t, const double *w, V *taken) {
    evaluate_tape(&scene->inertia, (const V *const[]){q, v, t}, (V *const[]){taken}, VECTORS, w);
}
INLINE void drift(const V *p, const V *taken, const double *w, V *v) {
    evaluate_tape(&scene->rhs[1], (const V *const[]){p, taken}, (V *const[]){v}, VECTORS, w);
}
#endif
INLINE void legendre(const V *v, const V *q, const V *p, const V *t, const double *w, V *missing, V *correction) {
    evaluate_tape(&scene->velocity, (const V *const[]){v, q, p, t}, (V *const[]){missing, correction}, 1, w);
}
#include "legendre.h"
INLINE void velocity(const V *q, const V *p, const V *t, const double *w, V *v) {
    if (LEGENDRE_ITERATIONS) inverted(q, p, t, w, v);
    else evaluate_tape(&scene->velocity, (const V *const[]){q, p, t}, (V *const[]){v}, 1, w);
}
#endif
