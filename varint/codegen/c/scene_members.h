/* The structure of a scene as data, from lists of its members: COUNTS, LIMITS, PLACES, TABLES, FUNCTIONS.

   tape.h and the lists stand before this file. varint/codegen/native.py has the same layout and reads the lists. */
#define COUNT(name) int64_t name##_;
#define LIMIT(name) double name##_;
#define PLACE(name) const int *name##_;
#define TABLE(name) const double *name##_;
#define FUNCTION(name) Tape name;
typedef struct { COUNTS(COUNT) LIMITS(LIMIT) PLACES(PLACE) TABLES(TABLE) FUNCTIONS(FUNCTION) } Scene;
static _Thread_local const Scene *scene __attribute__((tls_model("initial-exec"))); /* of the run that is going on */

#define PREPARE(name) INLINE void name##_prepare(const double *c, double *w) { prepare_tape(&scene->name, c, w); }
FUNCTIONS(PREPARE)
#define ARGUMENTS(...) (const V *const[]){__VA_ARGS__}
#define CALL(name, arguments, ...) evaluate_tape(&scene->name, arguments, (V *const[]){__VA_ARGS__}, 1, w)
typedef const V *In;
typedef const double *Prepared;
