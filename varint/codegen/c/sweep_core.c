/* Derivatives of runs, step by step, for scenes as data. The names end in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define tangents WITH_ALL(tangents_sweep, LEVEL)
#define adjoints WITH_ALL(adjoints_sweep, LEVEL)
#define curvatures WITH_ALL(curvatures_sweep, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "sweep_scene.h"
#include "curvature.c"
