/* Derivatives of linear runs for scenes as data, as many steps at once as a register has room for. The names end in LEVEL, the
   instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define tangents WITH_ALL(tangents_linear, LEVEL)
#define adjoints WITH_ALL(adjoints_linear, LEVEL)
#include "widest.h"
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "sweep_linear_scene.h"
#include "sweep_linear.c"
