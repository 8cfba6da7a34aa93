/* The functions of a scene that is compiled apart from the loop of newton.c, in the table of newton_table.h. */
#include "newton_table.h"
#include "newton_places.h"

/* what this scene does not need, is not there: it is not called either */
#define NOTHING ((void)0)
#if !KICKED
#define kick(...) NOTHING
#define kick_prepare(...) NOTHING
#endif
#if !HELD
#define sized(...) NOTHING
#define hidden(...) NOTHING
#define pulled(...) NOTHING
#define sized_prepare(...) NOTHING
#define hidden_prepare(...) NOTHING
#define pulled_prepare(...) NOTHING
#endif
#if !WATCHED
#define independence(...) NOTHING
#define independence_prepare(...) NOTHING
#define lengths(...) NOTHING
#define lengths_prepare(...) NOTHING
#endif
#if !FROZEN
#define frozen(...) NOTHING
#define frozen_prepare(...) NOTHING
#endif
#if !LINEAR
#define slope(...) NOTHING
#define slope_prepare(...) NOTHING
#endif
#if MAP
#define equations(...) NOTHING
#define equations_prepare(...) NOTHING
#define units(...) NOTHING
#define units_prepare(...) NOTHING
#else
#define affine(...) NOTHING
#define affine_prepare(...) NOTHING
#define driven(...) NOTHING
#define driven_prepare(...) NOTHING
#endif
#if INVERTED
#define speed(...) NOTHING
#define speed_prepare(...) NOTHING
#else
#define legendre(...) NOTHING
#define legendre_prepare(...) NOTHING
#endif
#if CLOSED || LINEAR || FROZEN
#define RESIDUAL(...) equations(__VA_ARGS__)
#define RESIDUAL_AND_SLOPE(...) NOTHING
#else
#define RESIDUAL(...) NOTHING
#define RESIDUAL_AND_SLOPE(...) equations(__VA_ARGS__)
#endif

INLINE void prepare_functions(In k, double *w) {
    finish_prepare(k, w + FINISH_AT), speed_prepare(k, w + SPEED_AT), legendre_prepare(k, w + LEGENDRE_AT);
    equations_prepare(k, w + EQUATIONS_AT), units_prepare(k, w + UNITS_AT), frozen_prepare(k, w + FROZEN_AT);
    slope_prepare(k, w + SLOPE_AT), affine_prepare(k, w + AFFINE_AT), driven_prepare(k, w + DRIVEN_AT);
    kick_prepare(k, w + KICK_AT), sized_prepare(k, w + SIZED_AT), hidden_prepare(k, w + HIDDEN_AT);
    pulled_prepare(k, w + PULLED_AT), independence_prepare(k, w + INDEPENDENCE_AT), lengths_prepare(k, w + LENGTHS_AT);
}
INLINE void residual_of(In y, In q, In p, In t, In u, In w, double *b) { RESIDUAL(y, q, p, t, u, w + EQUATIONS_AT, b); }
INLINE void residual_and_slope(In y, In q, In p, In t, In u, In w, double *b, double *jacobian) {
    RESIDUAL_AND_SLOPE(y, q, p, t, u, w + EQUATIONS_AT, b, jacobian);
}
INLINE void finished(In y, In q, In p, In t, In u, In w, double *increment, double *gain, double *remains) {
    finish(y, q, p, t, u, w + FINISH_AT, increment, gain, remains);
}
INLINE void units_of(In w, double *size) { units(w + UNITS_AT, size); }
INLINE void speed_of(In x, In q_or_p, In t, In w, double *v) { speed(x, q_or_p, t, w + SPEED_AT, v); }
INLINE void kick_of(In q, In t, In u, In w, double *force) { kick(q, t, u, w + KICK_AT, force); }
INLINE void sized_of(In q, In t, In w, double *sizes) { sized(q, t, w + SIZED_AT, sizes); }
INLINE void hidden_of(In q, In p, In t, In w, double *b, double *jacobian) { hidden(q, p, t, w + HIDDEN_AT, b, jacobian); }
INLINE void pulled_of(In x, In q, In p, In t, In w, double *pull) { pulled(x, q, p, t, w + PULLED_AT, pull); }
INLINE void frozen_of(In y, In q, In t, In w, double *jacobian) { frozen(y, q, t, w + FROZEN_AT, jacobian); }
INLINE void slope_of(In w, double *jacobian) { slope(w + SLOPE_AT, jacobian); }
INLINE void affine_of(In w, double *parts) { affine(w + AFFINE_AT, parts); }
INLINE void driven_of(In t, In u, In w, double *parts) { driven(t, u, w + DRIVEN_AT, parts); }
INLINE void legendre_of(In v, In q, In p, In t, In w, double *missing, double *correction) {
    legendre(v, q, p, t, w + LEGENDRE_AT, missing, correction);
}
INLINE void independence_of(In q, In t, In w, double *pivot) { independence(q, t, w + INDEPENDENCE_AT, pivot); }
INLINE void lengths_of(In q, In t, In w, double *squares) { lengths(q, t, w + LENGTHS_AT, squares); }

#if CLOSED
#include "newton_state.h"
#include "newton_step.c"
static int next_step(Run *r, double t, double end) { return step(r, state_in(r->carry), t, end); }
#endif

const Scene scene = {
    .prepared = ALL_W, .parameters = C,
    .prepare = prepare_functions, .units = units_of, .speed = speed_of, .kick = kick_of, .sized = sized_of, .slope = slope_of,
    .affine = affine_of, .legendre = legendre_of, .independence = independence_of, .lengths = lengths_of,
#if !CLOSED || HIDDEN_SPEED
    .hidden = hidden_of,
#endif
#if CLOSED
    .step = next_step,
#else
    .residual = residual_of, .residual_and_slope = residual_and_slope, .finish = finished, .pulled = pulled_of,
    .frozen = frozen_of, .driven = driven_of,
#endif
};
