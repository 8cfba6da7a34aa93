/* A scene and the derivatives of its step as data, in place of the definitions and functions of generated source.

   tape.h stands before this file. varint/codegen/native_sweep.py reads the names here. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(NU) DO(CONTROLS) DO(PARTS) DO(PART) DO(Y) DO(POINTS) DO(ENDS) DO(C) DO(E) DO(LOSS) DO(BELOW) DO(REACH) \
    DO(BAND_SIZE) DO(MOST_ITERATIONS) DO(FY) DO(FX) DO(GY) DO(GX) DO(FE) DO(GE) DO(SS)
#define LIMITS(DO) \
    DO(LAST_CORRECTION) DO(ROUNDED) DO(LEAST_SPEED) DO(ROUNDABLE)
#define PLACES(DO) \
    DO(PERM) DO(AT) DO(FY_ROW) DO(FY_COLUMN) DO(FX_ROW) DO(FX_COLUMN) DO(GY_ROW) DO(GY_COLUMN) DO(GX_ROW) DO(GX_COLUMN) \
    DO(FE_ROW) DO(FE_COLUMN) DO(GE_ROW) DO(GE_COLUMN) DO(SS_ROW) DO(SS_COLUMN)
#define TABLES(DO) \
    DO(PART_TABLE) DO(HERMITE)
#define FUNCTIONS(DO) \
    DO(blocks) DO(outside) DO(pull) DO(after) DO(density) DO(curved)
#include "scene_members.h"

#define N ((int)scene->N_)
#define NU ((int)scene->NU_)
#define CONTROLS ((int)scene->CONTROLS_)
#define PARTS ((int)scene->PARTS_)
#define PART ((int)scene->PART_)
#define Y ((int)scene->Y_)
#define POINTS ((int)scene->POINTS_)
#define ENDS ((int)scene->ENDS_)
#define C ((int)scene->C_)
#define E ((int)scene->E_)
#define LOSS ((int)scene->LOSS_)
#define BELOW ((int)scene->BELOW_)
#define REACH ((int)scene->REACH_)
#define BAND_SIZE ((int)scene->BAND_SIZE_)
#define MOST_ITERATIONS ((int)scene->MOST_ITERATIONS_)
#define FY ((int)scene->FY_)
#define FX ((int)scene->FX_)
#define GY ((int)scene->GY_)
#define GX ((int)scene->GX_)
#define FE ((int)scene->FE_)
#define GE ((int)scene->GE_)
#define SS ((int)scene->SS_)
#define LAST_CORRECTION scene->LAST_CORRECTION_
#define ROUNDED scene->ROUNDED_
#define LEAST_SPEED scene->LEAST_SPEED_
#define ROUNDABLE scene->ROUNDABLE_
#define PERM scene->PERM_
#define AT scene->AT_
#define FY_ROW scene->FY_ROW_
#define FY_COLUMN scene->FY_COLUMN_
#define FX_ROW scene->FX_ROW_
#define FX_COLUMN scene->FX_COLUMN_
#define GY_ROW scene->GY_ROW_
#define GY_COLUMN scene->GY_COLUMN_
#define GX_ROW scene->GX_ROW_
#define GX_COLUMN scene->GX_COLUMN_
#define FE_ROW scene->FE_ROW_
#define FE_COLUMN scene->FE_COLUMN_
#define GE_ROW scene->GE_ROW_
#define GE_COLUMN scene->GE_COLUMN_
#define SS_ROW scene->SS_ROW_
#define SS_COLUMN scene->SS_COLUMN_
#define PART_TABLE scene->PART_TABLE_
#define HERMITE scene->HERMITE_
#define BLOCKS_W scene->blocks.registers
#define OUTSIDE_W scene->outside.registers
#define PULL_W scene->pull.registers
#define AFTER_W scene->after.registers
#define DENSITY_W scene->density.registers
#define CURVED_W scene->curved.registers

#define AT_A_PART ARGUMENTS(y, q, p, t, u, part)
INLINE void blocks(In y, In q, In p, In t, In u, In part, Prepared w, V *f, V *fy, V *fx, V *gy, V *gx) {
    CALL(blocks, AT_A_PART, f, fy, fx, gy, gx);
}
INLINE void outside(In y, In q, In p, In t, In u, In part, Prepared w, V *fe, V *ge) { CALL(outside, AT_A_PART, fe, ge); }
INLINE void pull(In y, In q, In p, In t, In u, In part, In mu, In eta, Prepared w, V *of_e, V *of_x) {
    CALL(pull, ARGUMENTS(y, q, p, t, u, part, mu, eta), of_e, of_x);
}
INLINE void after(In y, In q, In p, In t, In u, In part, Prepared w, V *next) { CALL(after, AT_A_PART, next); }
INLINE void density(In y, In q, In p, In t, In u, In part, Prepared w, V *value, V *of_y, V *of_x, V *of_e) {
    CALL(density, AT_A_PART, value, of_y, of_x, of_e);
}
INLINE void curved(In y, In q, In p, In t, In u, In part, In mu, In eta, Prepared w, V *nonzeros) {
    CALL(curved, ARGUMENTS(y, q, p, t, u, part, mu, eta), nonzeros);
}
