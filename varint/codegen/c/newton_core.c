/* Newton's method on the equations of a step for scenes as data. The names end in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run_newton, LEVEL)
#define parts WITH_ALL(parts_newton, LEVEL)
#define carry_size WITH_ALL(carry_size_newton, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "newton_scene.h"
#include "newton.c"
#include "parts.c"
