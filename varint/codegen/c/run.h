/* What every run loop shares: how it is called, how it ends, and sums that keep their rounding error.

   lanes.h stands before this file. varint/codegen/arguments.py has the same layouts and reads the names of Status here. */

enum Status { DONE, NOT_CONVERGED, NOT_FINITE };
#define LATELY 6      /* nodes of a note of a fold: of a step and of two steps before and behind it */
#define MOST_NOTED 32 /* notes of a call, which ends with the last of them */

/* What a run tells of itself; residual: the worst of its solved steps; failed: that of the step that was not; last: (q, p, v) of the node where it ended, saved or not. */
typedef struct {
    double status, steps, iterations, most_iterations, residual, failed, contraction;
    double noted; /* notes of folds */
    double last[];
} RunStats;

/* One motion. */
typedef struct {
    int64_t steps, save_every, first, most; /* steps to take; index of the first; largest number of iterations a step */
    double t0, h, level;                    /* level: wanted relative error of the stages, 0 for round-off */
    const double *start, *c, *u;            /* q and p at a fresh start; parameters; controls of every step's nodes */
    double *rows, *carry;                   /* (q, p, v) of every saved node; carry[0] = 0: a fresh start; less: where its last step began */
    RunStats *stats;
    const void *scene; /* its operations, where they are data and not in the source */
    double *notes;     /* what is noted of folds (folds.h), up to MOST_NOTED; 0: they are not looked for */
    double *rests;     /* Newton's method: rounding errors of q and p at a fresh start, then at every saved node; 0: not wanted */
    int64_t without_velocities; /* whether v need not be there in the rows */
    const double *heights;      /* Gauss rules: what makes the highest Legendre coefficient but one of a step's unknowns, and the highest */
    double *seen;               /* for each step how large both are in each row of unknowns, and the sizes of rows; 0: not wanted */
    double end;                 /* from zero on, of the last coordinate: the node there or behind it is the last; 0: nowhere */
    int64_t alone;              /* Gauss rules: a step that is to be solved, however long it takes: it is not made shorter where it fails */
} RunArguments;

/* One step of a size of its own from each of many states. */
typedef struct {
    int64_t count, told, used, most; /* how many; numbers of `opening` and `u` for each of them; largest number of iterations */
    const double *start, *t, *h, *c; /* (count, 2 N), (count), (count); parameters */
    const double *u, *opening;       /* (count, used), (count, told) */
    double *rows;                    /* (count, 3 N): q, p, v where the step ends */
    int64_t *good;                   /* (count): whether it is solved */
    const void *scene;
} PartsArguments;

/* A motion with a node at each of its steps, and times within these, in order: `going` of them, for each the node before it, when
   that is, how far ahead it lies and where its state is to stand in found_q and found_p; see within_steps.c. */
typedef struct {
    int64_t going, nodes, most, order; /* most: iterations of a step; order: power of a step in which the motion's own rule errs */
    const double *q, *p, *t;           /* the nodes; t = 0: equal steps from t0 on */
    double h, t0;
    const double *sizes; /* of the steps, by the numbers k of those before each node; 0: they are all h */
    const int64_t *k;
    const int64_t *node, *which;
    const double *begin, *ahead, *c, *tables; /* tables: varint/codegen/within_steps.py */
    int64_t fewest;                    /* times in a step that is looked at */
    double *found_q, *found_p;
    int64_t *reached;     /* (going): whether it was found */
    const double *wanted; /* where the last coordinate is a clock: what it is to show, `ahead` being but a guess; else 0 */
    double *found_t;      /* when it does */
    const void *scene;
} WithinArguments;

/* Many motions of one scene, one in each lane. */
typedef struct {
    int64_t members, steps, save_every, nodes; /* nodes: rows of a member, its start included */
    int64_t apart;                             /* numbers between the controls of two members: 0 where all have the same */
    double t0, h;
    const double *q0, *p0, *c, *u; /* (members, N), (members, N), (members, parameters), (members or 1, steps, nodes, NU) */
    double *q, *p;                 /* (members, nodes, N); row 0 is not written */
    int64_t *good;                 /* (members): rows that are solved and finite, the start included */
} MembersArguments;

INLINE int is_behind(double x, double end) { return end > 0 ? x >= end : end < 0 && x <= end; }

/* value += increment, with the rounding error kept in rest */
#define DEFINE_COMPENSATED(name, Number) \
    INLINE void name(Number *value, Number *rest, Number increment) { \
        Number y = increment + *rest, old = *value, s = old + y, part = s - old; \
        *rest = (old - (s - part)) + (y - part); \
        *value = s; \
    }
DEFINE_COMPENSATED(compensated, double)
DEFINE_COMPENSATED(v_compensated, V)

/* high + low += a b */
INLINE void add_exactly(double *high, double *low, double a, double b) {
    const double product = a * b, sum = *high + product, part = sum - *high;
    *low += ((*high - (sum - part)) + (product - part)) + s_fma(a, b, -product);
    *high = sum;
}

/* 0 where all numbers are finite, else no number at all */
INLINE double unsound(const double *x, int count) {
    double zero = 0;
    for (int i = 0; i < count; i++) zero += x[i] * 0.0;
    return zero;
}
