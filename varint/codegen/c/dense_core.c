/* The loop of core.c for scenes whose large inertia matrix is full (dense.c), as data. */
#define NAMED(name, level, lanes, vectors) name##_dense_##level##_##lanes##_##vectors
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run, LEVEL, LANES, VECTORS)
#define parts WITH_ALL(parts, LEVEL, LANES, VECTORS)
#define within_steps WITH_ALL(within_steps, LEVEL, LANES, VECTORS)
#define carry_size WITH_ALL(carry_size, LEVEL, LANES, VECTORS)
#define FORM 1
#define DENSE 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "scene.h"
#include "gauss.h"
#include "gauss_step.c"
#include "gauss_loop.c"
#include "parts.c"
#include "within_steps.c"
