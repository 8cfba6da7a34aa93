/* What a run of newton.c keeps, between two calls and on its way. */

#define WINDOW 1024 /* steps between two looks at the typical sizes */
#define RENEWED 8   /* corrections by one frozen matrix: from a start that was far off, the next one is nearer */
#define FADING 0.9  /* of how much a correction leaves, a step: the most of some steps counts */
#define EASY 4      /* iterations of a step after which the next begins with what several steps continue, which leads far where steps are long */
#define RESIZED 16  /* steps between two looks at the sizes that change with the place */

/* Numbers of a node, of a note, and of what is carried along: the largest pivot and the last nodes; see folds.h. */
#define NODE_SIZE (2 + 2 * N + VELOCITY_ROWS)
#define NOTE_SIZE (1 + LATELY * NODE_SIZE)
#define FOLDS_SIZE (WATCHED ? 1 + LATELY * NODE_SIZE : 0)

/* What a run needs to go on as if it had not stopped, in this order; at a fresh start the caller fills scale and speed. */
typedef struct {
    double *started, *scale, *speed, *sizes, *h, *known, *age, *q, *p, *rest_q, *rest_p, *force, *seen, *y, *bend, *strongest, *folds;
} State; /* 1, 2 N, N, SIZES + 1, 1, 1, 1, N, N, N, N, N, 2 N, HISTORY rows of ROW numbers, 1, 1, FOLDS_SIZE */
#define ROW (Y + FORCED * N) /* the unknowns of a step, and the velocity where it begins */
#define CARRY_SIZE ((int64_t)(7 + 10 * N + SIZES + HISTORY * ROW + FOLDS_SIZE))
INLINE State state_in(double *at) {
    State s;
    s.started = at, s.scale = s.started + 1, s.speed = s.scale + 2 * N, s.sizes = s.speed + N, s.h = s.sizes + SIZES + 1;
    s.known = s.h + 1, s.age = s.known + 1, s.q = s.age + 1, s.p = s.q + N, s.rest_q = s.p + N, s.rest_p = s.rest_q + N;
    s.force = s.rest_p + N, s.seen = s.force + N, s.y = s.seen + 2 * N;
    s.bend = s.y + HISTORY * ROW, s.strongest = s.bend + 1, s.folds = s.strongest + 1;
    return s;
}
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))
#define ZEROS(of, count) memset(of, 0, (size_t)(count) * sizeof(double))
#define LARGE static __attribute__((noinline))
#define ONE_BY_ONE __asm__ volatile("") /* in a loop that collects what has just been stored: a vector of it would have to wait */

/* A run on its way: its state and its controls from the step at hand on; the size h of that step, or of its part, and what was
   prepared for it; y[s], the unknowns of s steps ago. What a step tells of itself: its iterations, whether its equations are
   solved and what is left of them, how weak the hidden constraint's matrix is, and mean speeds where the momentum is not linear
   in them. */
typedef struct Run {
    const double *u;
    double *carry, h, per_h, *w, *units, *inverse, *matrix, **y, *speeds, left, weakness;
    int *pivots, most, solved;
    int64_t count;
} Run;
