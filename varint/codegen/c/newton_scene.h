/* A scene and the equations of its step as data, in place of the definitions and functions of generated source.

   tape.h stands before this file. varint/codegen/native_newton.py reads the names here. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(NU) DO(NODES) DO(Y) DO(C) DO(SIZES) DO(HISTORY) DO(DEGREE) DO(PATH) DO(MULTIPLIERS) \
    DO(ROWS) DO(CLOSED) DO(LINEAR) DO(FROZEN) DO(MAP) DO(STEADY) DO(FORCED) DO(JUDGED) DO(INVERTED) DO(KICKED) DO(HELD) DO(WATCHED) DO(VELOCITY_ROWS) DO(BELOW) \
    DO(REACH) DO(BAND_SIZE) DO(NONZEROS) DO(H) DO(HIDDEN_BELOW) DO(HIDDEN_REACH) DO(HIDDEN_NONZEROS) \
    DO(HIDDEN_SPEED) DO(HIDDEN_SIZE) DO(MATRIX_SIZE) DO(MOST_ITERATIONS) DO(LEGENDRE_ITERATIONS) DO(HALVINGS) DO(PARTS) DO(GIVEN) \
    DO(AT_NODES) DO(SLOPES_AT_NODES) DO(COUPLED) DO(GAP_NONZEROS) DO(MOMENTUM_BY_Q) DO(PUSH_BY_Q) DO(PUSH_BY_V) DO(STEADY_INERTIA) DO(BY_DIRECTIONS)
#define LIMITS(DO) \
    DO(LAST_CORRECTION) DO(RESIDUAL_LIMIT) DO(SMALLEST) DO(UNKNOWN) DO(FOLDED) DO(VANISHED)
#define PLACES(DO) \
    DO(PERM) DO(AT) DO(FROM) DO(HIDDEN_PERM) DO(HIDDEN_PLACES) DO(COUPLED_ROW) DO(COUPLED_COLUMN) DO(GAP_ROW) DO(GAP_COLUMN)
#define TABLES(DO) \
    DO(POINTS) DO(AHEAD_VELOCITIES) DO(AHEAD_MULTIPLIERS) DO(AHEAD_ROWS) DO(AHEAD_FORCES) DO(SHARES) DO(BEGUN) \
    DO(BASIS) DO(SLOPES) DO(WEIGHTS) DO(POINT_TIMES)
#define FUNCTIONS(DO) \
    DO(equations) DO(finish) DO(units) DO(speed) DO(kick) DO(sized) DO(hidden) DO(pulled) DO(slope) \
    DO(affine) DO(driven) DO(legendre) DO(independence) DO(lengths) DO(frozen) \
    DO(node_values) DO(node_slopes) DO(node_turn) DO(node_inertia) DO(row_units) DO(judged)

#include "scene_members.h"
#define N ((int)scene->N_)
#define NU ((int)scene->NU_)
#define NODES ((int)scene->NODES_)
#define GIVEN ((int)scene->GIVEN_)
#define Y ((int)scene->Y_)
#define C ((int)scene->C_)
#define SIZES ((int)scene->SIZES_)
#define HISTORY ((int)scene->HISTORY_)
#define DEGREE ((int)scene->DEGREE_)
#define PATH ((int)scene->PATH_)
#define MULTIPLIERS ((int)scene->MULTIPLIERS_)
#define ROWS ((int)scene->ROWS_)
#define CLOSED ((int)scene->CLOSED_)
#define LINEAR ((int)scene->LINEAR_)
#define FROZEN ((int)scene->FROZEN_)
#define MAP ((int)scene->MAP_)
#define STEADY ((int)scene->STEADY_)
#define FORCED ((int)scene->FORCED_)
#define JUDGED ((int)scene->JUDGED_)
#define KICKED ((int)scene->KICKED_)
#define HELD ((int)scene->HELD_)
#define WATCHED ((int)scene->WATCHED_)
#define VELOCITY_ROWS ((int)scene->VELOCITY_ROWS_)
#define BELOW ((int)scene->BELOW_)
#define REACH ((int)scene->REACH_)
#define BAND_SIZE ((int)scene->BAND_SIZE_)
#define NONZEROS ((int)scene->NONZEROS_)
#define H ((int)scene->H_)
#define HIDDEN_BELOW ((int)scene->HIDDEN_BELOW_)
#define HIDDEN_REACH ((int)scene->HIDDEN_REACH_)
#define HIDDEN_NONZEROS ((int)scene->HIDDEN_NONZEROS_)
#define HIDDEN_SPEED ((int)scene->HIDDEN_SPEED_)
#define HIDDEN_SIZE ((int)scene->HIDDEN_SIZE_)
#define MATRIX_SIZE ((int)scene->MATRIX_SIZE_)
#define MOST_ITERATIONS ((int)scene->MOST_ITERATIONS_)
#define LEGENDRE_ITERATIONS ((int)scene->LEGENDRE_ITERATIONS_)
#define HALVINGS ((int)scene->HALVINGS_)
#define INVERTED ((int)scene->INVERTED_)
#define PARTS ((int)scene->PARTS_)
#define AT_NODES ((int)scene->AT_NODES_)
#define SLOPES_AT_NODES ((int)scene->SLOPES_AT_NODES_)
#define COUPLED ((int)scene->COUPLED_)
#define GAP_NONZEROS ((int)scene->GAP_NONZEROS_)
#define MOMENTUM_BY_Q ((int)scene->MOMENTUM_BY_Q_)
#define PUSH_BY_Q ((int)scene->PUSH_BY_Q_)
#define PUSH_BY_V ((int)scene->PUSH_BY_V_)
#define STEADY_INERTIA ((int)scene->STEADY_INERTIA_)
#define BY_DIRECTIONS ((int)scene->BY_DIRECTIONS_)
#define LAST_CORRECTION scene->LAST_CORRECTION_
#define RESIDUAL_LIMIT scene->RESIDUAL_LIMIT_
#define SMALLEST scene->SMALLEST_
#define UNKNOWN scene->UNKNOWN_
#define FOLDED scene->FOLDED_
#define VANISHED scene->VANISHED_
#define PERM scene->PERM_
#define AT scene->AT_
#define FROM scene->FROM_
#define HIDDEN_PERM scene->HIDDEN_PERM_
#define HIDDEN_PLACES scene->HIDDEN_PLACES_
#define COUPLED_ROW scene->COUPLED_ROW_
#define COUPLED_COLUMN scene->COUPLED_COLUMN_
#define GAP_ROW scene->GAP_ROW_
#define GAP_COLUMN scene->GAP_COLUMN_
#define BASIS scene->BASIS_
#define SLOPES scene->SLOPES_
#define WEIGHTS scene->WEIGHTS_
#define POINT_TIMES scene->POINT_TIMES_
#define POINTS scene->POINTS_
#define AHEAD_VELOCITIES scene->AHEAD_VELOCITIES_
#define AHEAD_MULTIPLIERS scene->AHEAD_MULTIPLIERS_
#define AHEAD_ROWS scene->AHEAD_ROWS_
#define AHEAD_FORCES scene->AHEAD_FORCES_
#define SHARES scene->SHARES_
#define BEGUN scene->BEGUN_
#define EQUATIONS_W scene->equations.registers
#define FINISH_W scene->finish.registers
#define UNITS_W scene->units.registers
#define SPEED_W scene->speed.registers
#define KICK_W scene->kick.registers
#define SIZED_W scene->sized.registers
#define HIDDEN_W scene->hidden.registers
#define PULLED_W scene->pulled.registers
#define SLOPE_W scene->slope.registers
#define AFFINE_W scene->affine.registers
#define DRIVEN_W scene->driven.registers
#define LEGENDRE_W scene->legendre.registers
#define INDEPENDENCE_W scene->independence.registers
#define LENGTHS_W scene->lengths.registers
#define FROZEN_W scene->frozen.registers
#define NODE_VALUES_W scene->node_values.registers
#define NODE_SLOPES_W scene->node_slopes.registers
#define NODE_TURN_W scene->node_turn.registers
#define NODE_INERTIA_W scene->node_inertia.registers
#define ROW_UNITS_W scene->row_units.registers
#define JUDGED_W scene->judged.registers

/* Where the prepared numbers of each function begin. */
#define EQUATIONS_AT 0
#define FINISH_AT (EQUATIONS_AT + EQUATIONS_W)
#define UNITS_AT (FINISH_AT + FINISH_W)
#define SPEED_AT (UNITS_AT + UNITS_W)
#define KICK_AT (SPEED_AT + SPEED_W)
#define SIZED_AT (KICK_AT + KICK_W)
#define HIDDEN_AT (SIZED_AT + SIZED_W)
#define PULLED_AT (HIDDEN_AT + HIDDEN_W)
#define SLOPE_AT (PULLED_AT + PULLED_W)
#define AFFINE_AT (SLOPE_AT + SLOPE_W)
#define DRIVEN_AT (AFFINE_AT + AFFINE_W)
#define LEGENDRE_AT (DRIVEN_AT + DRIVEN_W)
#define INDEPENDENCE_AT (LEGENDRE_AT + LEGENDRE_W)
#define LENGTHS_AT (INDEPENDENCE_AT + INDEPENDENCE_W)
#define FROZEN_AT (LENGTHS_AT + LENGTHS_W)
#define NODE_VALUES_AT (FROZEN_AT + FROZEN_W)
#define NODE_SLOPES_AT (NODE_VALUES_AT + NODE_VALUES_W)
#define NODE_TURN_AT (NODE_SLOPES_AT + NODE_SLOPES_W)
#define NODE_INERTIA_AT (NODE_TURN_AT + NODE_TURN_W)
#define ROW_UNITS_AT (NODE_INERTIA_AT + NODE_INERTIA_W)
#define JUDGED_AT (ROW_UNITS_AT + ROW_UNITS_W)
#define ALL_W (JUDGED_AT + JUDGED_W)
#define CALL_AT(place, name, arguments, ...) evaluate_tape(&scene->name, arguments, (V *const[]){__VA_ARGS__}, 1, w + (place))
INLINE void prepare_functions(In k, double *w) {
    if (AT_NODES) {
        node_values_prepare(k, w + NODE_VALUES_AT), row_units_prepare(k, w + ROW_UNITS_AT), judged_prepare(k, w + JUDGED_AT);
    } else finish_prepare(k, w + FINISH_AT);
    if (STEADY_INERTIA) node_inertia_prepare(k, w + NODE_INERTIA_AT);
    if (BY_DIRECTIONS) node_turn_prepare(k, w + NODE_TURN_AT);
    else if (SLOPES_AT_NODES) node_slopes_prepare(k, w + NODE_SLOPES_AT);
    if (FROZEN) frozen_prepare(k, w + FROZEN_AT);
    if (INVERTED) legendre_prepare(k, w + LEGENDRE_AT);
    else speed_prepare(k, w + SPEED_AT);
    if (MAP) affine_prepare(k, w + AFFINE_AT), driven_prepare(k, w + DRIVEN_AT);
    else units_prepare(k, w + UNITS_AT);
    if (!MAP && !SLOPES_AT_NODES && !(AT_NODES && FROZEN)) equations_prepare(k, w + EQUATIONS_AT);
    if (KICKED) kick_prepare(k, w + KICK_AT);
    if (HELD) {
        sized_prepare(k, w + SIZED_AT), hidden_prepare(k, w + HIDDEN_AT);
        pulled_prepare(k, w + PULLED_AT);
    }
    if (WATCHED) independence_prepare(k, w + INDEPENDENCE_AT), lengths_prepare(k, w + LENGTHS_AT);
    if (LINEAR) slope_prepare(k, w + SLOPE_AT);
}
INLINE void residual_of(In y, In q, In p, In t, In u, In w, double *b) { CALL_AT(EQUATIONS_AT, equations, ARGUMENTS(y, q, p, t, u), b); }
INLINE void residual_and_slope(In y, In q, In p, In t, In u, In w, double *b, double *jacobian) {
    CALL_AT(EQUATIONS_AT, equations, ARGUMENTS(y, q, p, t, u), b, jacobian);
}
INLINE void finished(In y, In q, In p, In t, In u, In w, double *increment, double *gain, double *remains) {
    CALL_AT(FINISH_AT, finish, ARGUMENTS(y, q, p, t, u), increment, gain, remains);
}
INLINE void units_of(In w, double *size) { CALL_AT(UNITS_AT, units, 0, size); }
INLINE void node_values_of(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap) {
    CALL_AT(NODE_VALUES_AT, node_values, ARGUMENTS(q, v, t, u, lam), p, f, gap);
}
INLINE void node_slopes_of(In q, In v, In t, In u, In lam, In w, double *p, double *f, double *gap, double *gap_q, double *p_q,
                           double *p_v, double *f_q, double *f_v) {
    CALL_AT(NODE_SLOPES_AT, node_slopes, ARGUMENTS(q, v, t, u, lam), p, f, gap, gap_q, p_q, p_v, f_q, f_v);
}
INLINE void node_turn_of(In q, In v, In t, In u, In lam, In dq, In dv, In w, double *dp, double *df, double *dg) {
    CALL_AT(NODE_TURN_AT, node_turn, ARGUMENTS(q, v, t, u, lam, dq, dv), dp, df, dg);
}
INLINE void node_inertia_of(In w, double *p_v) { CALL_AT(NODE_INERTIA_AT, node_inertia, 0, p_v); }
INLINE void row_units_of(In w, double *units) { CALL_AT(ROW_UNITS_AT, row_units, 0, units); }
INLINE void judged_of(In y, In q, In p, In t, In gain, In w, double *sizes) {
    CALL_AT(JUDGED_AT, judged, ARGUMENTS(y, q, p, t, gain), sizes);
}
INLINE void speed_of(In x, In q_or_p, In t, In w, double *v) { CALL_AT(SPEED_AT, speed, ARGUMENTS(x, q_or_p, t), v); }
INLINE void kick_of(In q, In t, In u, In w, double *force) { CALL_AT(KICK_AT, kick, ARGUMENTS(q, t, u), force); }
INLINE void sized_of(In q, In t, In w, double *sizes) { CALL_AT(SIZED_AT, sized, ARGUMENTS(q, t), sizes); }
INLINE void hidden_of(In q, In p, In t, In w, double *b, double *jacobian, double *size) {
    CALL_AT(HIDDEN_AT, hidden, ARGUMENTS(q, p, t), b, jacobian, size);
}
INLINE void pulled_of(In x, In q, In p, In t, In w, double *pull) { CALL_AT(PULLED_AT, pulled, ARGUMENTS(x, q, p, t), pull); }
INLINE void frozen_of(In y, In q, In t, In w, double *jacobian) { CALL_AT(FROZEN_AT, frozen, ARGUMENTS(y, q, t), jacobian); }
INLINE void slope_of(In w, double *jacobian) { CALL_AT(SLOPE_AT, slope, 0, jacobian); }
INLINE void affine_of(In w, double *parts) { CALL_AT(AFFINE_AT, affine, 0, parts); }
INLINE void driven_of(In t, In u, In w, double *parts) { CALL_AT(DRIVEN_AT, driven, ARGUMENTS(t, u), parts); }
INLINE void legendre(In v, In q, In p, In t, In w, double *missing, double *correction) {
    CALL_AT(LEGENDRE_AT, legendre, ARGUMENTS(v, q, p, t), missing, correction);
}
INLINE void independence_of(In q, In t, In w, double *pivot) { CALL_AT(INDEPENDENCE_AT, independence, ARGUMENTS(q, t), pivot); }
INLINE void lengths_of(In q, In t, In w, double *squares) { CALL_AT(LENGTHS_AT, lengths, ARGUMENTS(q, t), squares); }
