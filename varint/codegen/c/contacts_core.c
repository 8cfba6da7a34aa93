/* Motions with contacts, for scenes as data. The names end in LEVEL, the instructions that are used. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define contacts WITH_ALL(contacts, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"
#include "tape.h"
#include "rows.h"
#include "contacts_scene.h"
#include "cubic_root.h"
#include "contacts.c"
