/* A scene and the derivatives of its rates as data, in place of the definitions and functions of generated source.

   tape.h stands before this file, and STRIDE is given. varint/codegen/native_sweep.py reads the names here. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(NU) DO(STAGES) DO(C) DO(NJ) DO(FE) DO(WINDOW) DO(LOSS) DO(MORE) DO(MOST_ITERATIONS)
#define LIMITS(DO) \
    DO(ROUNDED) DO(LEAST_SPEED)
#define PLACES(DO) \
    DO(FE_ROW) DO(FE_COLUMN)
#define TABLES(DO) \
    DO(COLUMN_A) DO(COLUMN_M) DO(STAGE_B) DO(STAGE_C) DO(GUESS_Q) DO(GUESS_V) DO(CONTINUED) DO(AHEAD) DO(ONWARDS)
#define FUNCTIONS(DO) \
    DO(slopes) DO(outside) DO(momentum) DO(pull) DO(density) DO(turn_q) DO(turn_p) DO(back_q) DO(back_p)
#include "scene_members.h"

#define N ((int)scene->N_)
#define NU ((int)scene->NU_)
#define STAGES ((int)scene->STAGES_)
#define C ((int)scene->C_)
#define NJ ((int)scene->NJ_)
#define FE ((int)scene->FE_)
#define WINDOW ((int)scene->WINDOW_)
#define LOSS ((int)scene->LOSS_)
#define MORE ((int)scene->MORE_)
#define MOST_ITERATIONS ((int)scene->MOST_ITERATIONS_)
#define ROUNDED scene->ROUNDED_
#define LEAST_SPEED scene->LEAST_SPEED_
#define FE_ROW scene->FE_ROW_
#define FE_COLUMN scene->FE_COLUMN_
#define COLUMN_A scene->COLUMN_A_
#define COLUMN_M scene->COLUMN_M_
#define STAGE_B scene->STAGE_B_
#define STAGE_C scene->STAGE_C_
#define GUESS_Q scene->GUESS_Q_
#define GUESS_V scene->GUESS_V_
#define CONTINUED scene->CONTINUED_
#define AHEAD scene->AHEAD_
#define ONWARDS scene->ONWARDS_
#define SLOPES_W (LANES * scene->slopes.registers)
#define OUTSIDE_W (LANES * scene->outside.registers)
#define MOMENTUM_W (LANES * scene->momentum.registers)
#define PULL_W (LANES * scene->pull.registers)
#define DENSITY_W (LANES * scene->density.registers)
#define TURN_Q_W (LANES * scene->turn_q.registers)
#define TURN_P_W (LANES * scene->turn_p.registers)
#define BACK_Q_W (LANES * scene->back_q.registers)
#define BACK_P_W (LANES * scene->back_p.registers)

#define AT_STAGES ARGUMENTS(q, p, t, u)
INLINE void slopes(In q, In p, In t, In u, Prepared w, V *f, V *slope) { CALL(slopes, AT_STAGES, f, slope); }
INLINE void outside(In q, In p, In t, In u, Prepared w, V *fe) { CALL(outside, AT_STAGES, fe); }
INLINE void momentum(In q, In v, In t, Prepared w, V *p) { CALL(momentum, ARGUMENTS(q, v, t), p); }
INLINE void pull(In q, In p, In t, In u, In m, Prepared w, V *of_e) { CALL(pull, ARGUMENTS(q, p, t, u, m), of_e); }
INLINE void density(In q, In p, In t, In u, Prepared w, V *value, V *of_x, V *of_e) { CALL(density, AT_STAGES, value, of_x, of_e); }
#define PRODUCT(name) INLINE void name(In slope, In x, In source, Prepared w, V *y) { CALL(name, ARGUMENTS(slope, x, source), y); }
PRODUCT(turn_q) PRODUCT(turn_p) PRODUCT(back_q) PRODUCT(back_p)
