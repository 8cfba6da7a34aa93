/* The functions of a scene that is compiled apart from the loop of newton.c, in the table of newton_table.h, which stands
   before them. Defined besides: SHARED_W and shared_prepare(k, w), what they all take that is prepared. */

/* what this scene does not need, is not there: it is not called either */
#define NOTHING ((void)0)
#if !KICKED
#define kick(...) NOTHING
#endif
#if !HELD
#define sized(...) NOTHING
#define hidden(...) NOTHING
#define pulled(...) NOTHING
#endif
#if !WATCHED
#define independence(...) NOTHING
#define lengths(...) NOTHING
#endif
#if !FROZEN
#define frozen(...) NOTHING
#endif
#if SLOPES_AT_NODES || (AT_NODES && FROZEN)
#define equations(...) NOTHING
#endif
#if AT_NODES
#define finish(...) NOTHING
#else
#define node_values(...) NOTHING
#define row_units(...) NOTHING
#define judged(...) NOTHING
#endif
#if !SLOPES_AT_NODES || BY_DIRECTIONS
#define node_slopes(...) NOTHING
#endif
#if !STEADY_INERTIA
#define node_inertia(...) NOTHING
#endif
#if !BY_DIRECTIONS
#define node_turn(...) NOTHING
#endif
#if !LINEAR
#define slope(...) NOTHING
#endif
#if MAP
#define equations(...) NOTHING
#define units(...) NOTHING
#else
#define affine(...) NOTHING
#define driven(...) NOTHING
#endif
#if INVERTED
#define speed(...) NOTHING
#else
#define legendre(...) NOTHING
#endif
#if CLOSED || LINEAR || FROZEN
#define RESIDUAL(...) equations(__VA_ARGS__)
#define RESIDUAL_AND_SLOPE(...) NOTHING
#else
#define RESIDUAL(...) NOTHING
#define RESIDUAL_AND_SLOPE(...) equations(__VA_ARGS__)
#endif

INLINE void prepare_functions(In k, double *w) {
    memcpy(w + PREPARED_AT, k, (C + 1 + 2 * N + SIZES) * sizeof(double));
    shared_prepare(k, w + PREPARED_AT);
}
INLINE void residual_of(In y, In q, In p, In t, In u, In w, double *b) { RESIDUAL(y, q, p, t, u, w + PREPARED_AT, b); }
INLINE void residual_and_slope(In y, In q, In p, In t, In u, In w, double *b, double *jacobian) {
    RESIDUAL_AND_SLOPE(y, q, p, t, u, w + PREPARED_AT, b, jacobian);
}
INLINE void finished(In y, In q, In p, In t, In u, In w, double *increment, double *gain, double *remains) {
    finish(y, q, p, t, u, w + PREPARED_AT, increment, gain, remains);
}
INLINE void units_of(In w, double *size) { units(w + PREPARED_AT, size); }
INLINE void node_values_of(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap) {
    node_values(q, v, t, u, lam, w + PREPARED_AT, p, f, gap);
}
INLINE void node_slopes_of(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap, double *gap_q, double *p_q,
                           double *p_v, double *f_q, double *f_v) {
    node_slopes(q, v, t, u, lam, w + PREPARED_AT, p, f, gap, gap_q, p_q, p_v, f_q, f_v);
}
INLINE void node_turn_of(In q, In v, In t, In u, In lam, In dq, In dv, In w, double *dp, double *df, double *dg) {
    node_turn(q, v, t, u, lam, dq, dv, w + PREPARED_AT, dp, df, dg);
}
INLINE void node_inertia_of(In w, double *p_v) { node_inertia(w + PREPARED_AT, p_v); }
INLINE void row_units_of(In w, double *units) { row_units(w + PREPARED_AT, units); }
INLINE void judged_of(In y, In q, In p, In t, In gain, In w, double *sizes) { judged(y, q, p, t, gain, w + PREPARED_AT, sizes); }
INLINE void speed_of(In x, In q_or_p, In t, In w, double *v) { speed(x, q_or_p, t, w + PREPARED_AT, v); }
INLINE void kick_of(In q, In t, In u, In w, double *force) { kick(q, t, u, w + PREPARED_AT, force); }
INLINE void sized_of(In q, In t, In w, double *sizes) { sized(q, t, w + PREPARED_AT, sizes); }
INLINE void hidden_of(In q, In p, In t, In w, double *b, double *jacobian, double *size) {
    hidden(q, p, t, w + PREPARED_AT, b, jacobian, size);
}
INLINE void pulled_of(In x, In q, In p, In t, In w, double *pull) { pulled(x, q, p, t, w + PREPARED_AT, pull); }
INLINE void frozen_of(In y, In q, In t, In w, double *jacobian) { frozen(y, q, t, w + PREPARED_AT, jacobian); }
INLINE void slope_of(In w, double *jacobian) { slope(w + PREPARED_AT, jacobian); }
INLINE void affine_of(In w, double *parts) { affine(w + PREPARED_AT, parts); }
INLINE void driven_of(In t, In u, In w, double *parts) { driven(t, u, w + PREPARED_AT, parts); }
INLINE void legendre_of(In v, In q, In p, In t, In w, double *missing, double *correction) {
    legendre(v, q, p, t, w + PREPARED_AT, missing, correction);
}
INLINE void independence_of(In q, In t, In w, double *pivot) { independence(q, t, w + PREPARED_AT, pivot); }
INLINE void lengths_of(In q, In t, In w, double *squares) { lengths(q, t, w + PREPARED_AT, squares); }

#if CLOSED
#define WITHOUT_NODES
#include "newton_state.h"
#include "newton_step.c"
static int next_step(Run *r, double t, double end) { return step(r, state_in(r->carry), t, end); }
#endif

const Scene scene = {
    .prepared = PREPARED_AT + SHARED_W, .parameters = C,
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
    .node_values = node_values_of, .node_slopes = node_slopes_of, .node_turn = node_turn_of,
    .node_inertia = node_inertia_of, .row_units = row_units_of,
    .judged = judged_of,
#endif
};
