/* The functions of a scene that is compiled apart, under the names that newton.c has for them: called by the table whose address
   w begins with. */
#define SCENE_APART
#include "newton_table.h"
typedef const Scene *Table __attribute__((may_alias));
#define TABLE (*(const Table *)w)
#define C ((int)((const Scene *)a->scene)->parameters) /* of a run with the arguments a */
#define ALL_W ((const Scene *)a->scene)->prepared

/* Sines and cosines of ANGLES angles, of all at a time where none is far. */
static void sines_of(const double *angle, double *sine, double *cosine) {
#ifdef REDUCED
    int far = 0;
    for (int i = 0; i < ANGLES; i++) far |= !within(angle[i], REDUCED);
    if (!far) {
        for (int i = 0; i < ANGLES; i++) near_sincos(angle[i], &sine[i], &cosine[i]);
        return;
    }
#endif
    for (int i = 0; i < ANGLES; i++) v_sincos(angle[i], &sine[i], &cosine[i]);
}

#define prepare_functions(k, w) TABLE->prepare(k, w)
#define residual_of(y, q, p, t, u, w, b) TABLE->residual(y, q, p, t, u, w, b)
#define residual_and_slope(y, q, p, t, u, w, b, jacobian) TABLE->residual_and_slope(y, q, p, t, u, w, b, jacobian)
#define finished(y, q, p, t, u, w, increment, gain, remains) TABLE->finish(y, q, p, t, u, w, increment, gain, remains)
#define units_of(w, size) TABLE->units(w, size)
#define node_values_of(q, v, t, u, lam, w, p, f, gap) TABLE->node_values(q, v, t, u, lam, w, p, f, gap)
#define node_slopes_of(q, v, t, u, lam, w, p, f, gap, gap_q, p_q, p_v, f_q, f_v) \
    TABLE->node_slopes(q, v, t, u, lam, w, p, f, gap, gap_q, p_q, p_v, f_q, f_v)
#define node_turn_of(q, v, t, u, lam, dq, dv, w, dp, df, dg) TABLE->node_turn(q, v, t, u, lam, dq, dv, w, dp, df, dg)
#define node_inertia_of(w, p_v) TABLE->node_inertia(w, p_v)
#define row_units_of(w, units) TABLE->row_units(w, units)
#define judged_of(y, q, p, t, gain, w, sizes) TABLE->judged(y, q, p, t, gain, w, sizes)
#define speed_of(x, q_or_p, t, w, v) TABLE->speed(x, q_or_p, t, w, v)
#define kick_of(q, t, u, w, force) TABLE->kick(q, t, u, w, force)
#define sized_of(q, t, w, sizes) TABLE->sized(q, t, w, sizes)
#define hidden_of(q, p, t, w, b, jacobian, size) TABLE->hidden(q, p, t, w, b, jacobian, size)
#define pulled_of(x, q, p, t, w, pull) TABLE->pulled(x, q, p, t, w, pull)
#define frozen_of(y, q, t, w, jacobian) TABLE->frozen(y, q, t, w, jacobian)
#define slope_of(w, jacobian) TABLE->slope(w, jacobian)
#define affine_of(w, parts) TABLE->affine(w, parts)
#define driven_of(t, u, w, parts) TABLE->driven(t, u, w, parts)
#define legendre(v, q, p, t, w, missing, correction) TABLE->legendre(v, q, p, t, w, missing, correction)
#define independence_of(q, t, w, pivot) TABLE->independence(q, t, w, pivot)
#define lengths_of(q, t, w, squares) TABLE->lengths(q, t, w, squares)
#if CLOSED /* a call of each function would take longer than the rest of such a step */
#define NEXT_STEP(r, state, t, end) TABLE->step(r, t, end)
#endif
