/* Derivatives of runs by Gauss rules for scenes as data: LANES numbers in a vector, VECTORS of them for the stages of a
   coordinate. The names end in these numbers and in LEVEL, the instructions that are used. */
#define NAMED(name, level, lanes, vectors) name##_##level##_##lanes##_##vectors
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define tangents WITH_ALL(tangents_stages, LEVEL, LANES, VECTORS)
#define adjoints WITH_ALL(adjoints_stages, LEVEL, LANES, VECTORS)
#define STRIDE VECTORS
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "sweep_gauss_scene.h"
#include "sweep_gauss.c"
