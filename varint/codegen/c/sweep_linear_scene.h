/* A linear scene and the derivatives of its step as data, in place of the definitions and functions of generated source.

   tape.h stands before this file. varint/codegen/native_sweep.py reads the names here. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(NU) DO(CONTROLS) DO(Y) DO(C) DO(E) DO(LOSS) DO(FE) DO(GE) DO(S)
#define LIMITS(DO) /* none */
#define PLACES(DO) \
    DO(FE_ROW) DO(FE_COLUMN) DO(GE_ROW) DO(GE_COLUMN) DO(S_ROW) DO(S_COLUMN)
#define TABLES(DO) /* none */
#define FUNCTIONS(DO) \
    DO(matrices) DO(rest) DO(outside) DO(pull) DO(density)
#include "scene_members.h"

#define N ((int)scene->N_)
#define NU ((int)scene->NU_)
#define CONTROLS ((int)scene->CONTROLS_)
#define Y ((int)scene->Y_)
#define C ((int)scene->C_)
#define E ((int)scene->E_)
#define LOSS ((int)scene->LOSS_)
#define FE ((int)scene->FE_)
#define GE ((int)scene->GE_)
#define S ((int)scene->S_)
#define FE_ROW scene->FE_ROW_
#define FE_COLUMN scene->FE_COLUMN_
#define GE_ROW scene->GE_ROW_
#define GE_COLUMN scene->GE_COLUMN_
#define S_ROW scene->S_ROW_
#define S_COLUMN scene->S_COLUMN_
#define MATRICES_W (LANES * scene->matrices.registers)
#define REST_W (LANES * scene->rest.registers)
#define OUTSIDE_W (LANES * scene->outside.registers)
#define PULL_W (LANES * scene->pull.registers)
#define DENSITY_W (LANES * scene->density.registers)

INLINE void matrices(Prepared w, V *slopes) { CALL(matrices, 0, slopes); }
INLINE void rest(In q, In p, In t, In u, Prepared w, V *left) { CALL(rest, ARGUMENTS(q, p, t, u), left); }
INLINE void outside(In y, In q, In p, In t, In u, In part, Prepared w, V *fe, V *ge) {
    CALL(outside, ARGUMENTS(y, q, p, t, u, part), fe, ge);
}
INLINE void pull(In y, In q, In p, In t, In u, In part, In mu, In eta, Prepared w, V *of_e, V *of_x) {
    CALL(pull, ARGUMENTS(y, q, p, t, u, part, mu, eta), of_e, of_x);
}
INLINE void density(In y, In q, In p, In t, In u, In part, Prepared w, V *value, V *of_y, V *of_x, V *of_e) {
    CALL(density, ARGUMENTS(y, q, p, t, u, part), value, of_y, of_x, of_e);
}
