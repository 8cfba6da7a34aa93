/* A scene that is compiled apart from its loop: its functions, as gauss.h has them, and the iteration of a step. */

#define LOOP_APART
#include "gauss.h"
#include "gauss_step.c"

static void prepare_there(const double *c, double *w) { prepare(c, w); }
static void velocity_there(const V *q, const V *p, const V *t, const double *w, V *v) { velocity(q, p, t, w + RHS_W, v); }
#if FORM == 2 /* else no node needs it */
static void momentum_there(const V *q, const V *v, const V *t, const double *w, V *p) {
    momentum(q, v, t, w + RHS_W + VELOCITY_W, p);
}
#endif

const Scene scene = {
    .numbers = RHS_W + VELOCITY_W + MOMENTUM_W,
    .work = EVALUATION,
    .needs_q = NEEDS_Q,
    .needs_p = NEEDS_P,
    .prepare = prepare_there,
    .velocity = velocity_there,
#if FORM == 2
    .momentum = momentum_there,
#endif
    .iterated = iterated,
#if HALVES
    .taken = TAKEN,
#endif
};
