/* The loop of Gauss rules for scenes as data: LANES numbers in a vector, VECTORS of them for the stages of a coordinate, and
   FORM are given on the command line. The names end in these numbers and in LEVEL, the instructions that are used. */
#define NAMED(name, level, lanes, vectors, form) name##_##level##_##lanes##_##vectors##_##form
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run, LEVEL, LANES, VECTORS, FORM)
#define parts WITH_ALL(parts, LEVEL, LANES, VECTORS, FORM)
#define within_steps WITH_ALL(within_steps, LEVEL, LANES, VECTORS, FORM)
#define carry_size WITH_ALL(carry_size, LEVEL, LANES, VECTORS, FORM)
#ifdef DIGEST /* of the sources: a library built from others is not used */
const char digest[] = DIGEST;
#endif
#define DENSE 0
#include "lanes.h"
#ifdef DIGEST
const int newer_functions = NEWER_FUNCTIONS;
#endif
#include "run.h"
#include "tape.h"
#include "scene.h"
#include "gauss.h"
#include "gauss_step.c"
#include "gauss_loop.c"
#include "parts.c"
#include "within_steps.c"
