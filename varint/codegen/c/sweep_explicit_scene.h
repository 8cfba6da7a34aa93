/* An explicit scene and the derivatives of the parts of its step as data, in place of the definitions and functions of
   generated source.

   tape.h stands before this file. varint/codegen/native_sweep.py reads the names here. */
#define SCENE_AS_DATA
#define COUNTS(DO) \
    DO(N) DO(NU) DO(CONTROLS) DO(PARTS) DO(PART) DO(C) DO(E) DO(LOSS) DO(SHARED) DO(KQ) DO(DP) DO(KE) DO(DE)
#define LIMITS(DO) /* none */
#define PLACES(DO) \
    DO(DRIFTS) DO(KQ_ROW) DO(KQ_BEGIN) DO(DP_ROW) DO(DP_BEGIN) DO(KE_ROW) DO(KE_COLUMN) DO(DE_ROW) DO(DE_COLUMN)
#define TABLES(DO) \
    DO(PART_TABLE)
#define FUNCTIONS(DO) \
    DO(part_of) DO(density)
#include "scene_members.h"

#define N ((int)scene->N_)
#define NU ((int)scene->NU_)
#define CONTROLS ((int)scene->CONTROLS_)
#define PARTS ((int)scene->PARTS_)
#define PART ((int)scene->PART_)
#define C ((int)scene->C_)
#define E ((int)scene->E_)
#define LOSS ((int)scene->LOSS_)
#define SHARED ((int)scene->SHARED_)
#define KQ ((int)scene->KQ_)
#define DP ((int)scene->DP_)
#define KE ((int)scene->KE_)
#define DE ((int)scene->DE_)
#define DRIFTS scene->DRIFTS_
#define KQ_ROW scene->KQ_ROW_
#define KQ_BEGIN scene->KQ_BEGIN_
#define DP_ROW scene->DP_ROW_
#define DP_BEGIN scene->DP_BEGIN_
#define KE_ROW scene->KE_ROW_
#define KE_COLUMN scene->KE_COLUMN_
#define DE_ROW scene->DE_ROW_
#define DE_COLUMN scene->DE_COLUMN_
#define PART_TABLE scene->PART_TABLE_
#define PART_OF_W (LANES * scene->part_of.registers)
#define DENSITY_W (LANES * scene->density.registers)

#define AT_A_PART ARGUMENTS(q, p, t, u, part)
INLINE void part_of(In q, In p, In t, In u, In part, Prepared w, V *kq, V *dp, V *ke, V *de, V *next) {
    CALL(part_of, AT_A_PART, kq, dp, ke, de, next);
}
INLINE void density(In q, In p, In t, In u, In part, Prepared w, V *value, V *of_x, V *of_e) {
    CALL(density, AT_A_PART, value, of_x, of_e);
}
