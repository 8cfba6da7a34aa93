/* What motions with contacts are told, what they work with, and an instant of one: a part of contacts.c. */

enum Ended { ENDED, FULL, BESIDE, SETTLED };
#define MOST_STEPS 256 /* between two looks at the gaps */
#define FEW_STEPS 16   /* after an impact */
#define TOGETHER 4     /* so many steps or more are looked at together */
#define IN_A_BOX 8     /* so many of them in one box */
#define BOX (2 * N + 2)
#define ROUND_OFF 0x1p-52 /* of what adds up */
#define REGULAR 1e-10  /* pivots of scaled equations: below, rows may depend on each other */
#define NUMBERS (5 * N) /* q, p, v and the rounding errors of q and p */
#define POINT (1 + NUMBERS + 2 * CONTACTS)
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))

/* varint/codegen/contacts.py has the same layouts */
typedef struct {
    int (*run)(const RunArguments *);
    const void *loop;                       /* its scene, where that is data */
    int (*many)(const RowsArguments *);     /* a tape at many points, see rows_core.c */
    int64_t carry_size;                     /* of the loop */
    int64_t last, save_every, most;         /* the last node of the grid; iterations of a step */
    int64_t room, hits, steps;              /* rows and hits that have room; steps after which the call ends */
    int64_t begins;                         /* whether the motion begins at that instant, which becomes a node */
    double t0, h, level;
    int64_t held;                           /* rows that hold: constraints, and contacts that push */
    const int64_t *rows_held;               /* which */
    int64_t *holds;                         /* of each contact whether it is closed for now; where the run is SETTLED, then */
    const double *c, *scale;                /* typical sizes of velocities and momenta */
    double *state;                          /* k, t, impacts in step k, steps of the next look; q, p, v, rests of q and p; carry */
    double *rows;                           /* t, k, q, p, v of every node */
    double *hit;                            /* row, contact, whether it is stopped (1) or lets go (2), when, impulse, energies, q, v and p before,
                                               v and p after */
    double *stats;                          /* rows, hits, iterations, residual; whether an instant was located, before blows
                                               that are not for here, or SETTLED, when, whether its step ends there, q, p, v,
                                               rests of q and p; its hits have the row that would follow */
    const void *scene;
    int (*change)(int64_t row, int64_t k, int64_t last); /* other contacts hold from a row on, in step k of a run of so many: as SETTLED
                                               says it in `holds` and `stats`. Whether there is a loop for them, then in `begun`; none
                                               where it is 0 */
    const int64_t *begun;                   /* its loop, the loop's scene, memory of what it carries, twice, its size, how many
                                               rows hold, which */
    const double *sizes;                    /* velocities then, typical sizes */
    int64_t fewer;                          /* steps of a run that comes first, a whole part of them; none where it is 0 */
    double *apart;                          /* how far it is; infinitely where one of them does not end */
} ContactArguments;

#define STATE_Q 4
#define HIT_HEAD 7
#define HIT_SIZE (HIT_HEAD + 5 * N)
#define ROW_SIZE (2 + 3 * N)

typedef struct {
    const ContactArguments *a;
    int (*run)(const RunArguments *);       /* of what holds just now */
    const void *loop;
    const double *scale;
    const double *w;
    double *carry, *ends, *told, *close;    /* of shorter steps; told: RunStats */
    double *slope, *mass, *force, *bend, *quick, *reach; /* reach: how far each coordinate moves in a step */
    double *factors, *size;                 /* of the equations of motion, and what they are scaled by */
    double *restitution;
    double *boxes, *floors, *clear;         /* of steps: where they lie, floors of the gaps, whether no gap may close */
    int *pivots;
    int64_t *held;                          /* how many rows hold just now, then which: those of constraints first */
    double iterations, residual, energy;
    int looks;
} Work;

/* An instant of the motion: how far ahead, then q, p and v, rounding errors of q and p, gaps, rates. */
#define Q_OF(x) ((x) + 1)
#define P_OF(x) ((x) + 1 + N)
#define V_OF(x) ((x) + 1 + 2 * N)
#define REST_OF(x) ((x) + 1 + 3 * N)
#define GAP_OF(x) ((x) + 1 + NUMBERS)
#define RATE_OF(x) ((x) + 1 + NUMBERS + CONTACTS)
#define HELD(j) x->held[1 + (j)]
#define HELD_ROW(j) (x->slope + HELD(j) * N)
#define FIRST (ROWS - CONTACTS) /* row of the first contact */
#define CONTACT_ROW(i) (x->slope + (FIRST + (i)) * N)

INLINE double sum_of(const double *x, const double *y, int count) {
    double s = 0;
    for (int d = 0; d < count; d++) s += x[d] * y[d];
    return s;
}

#define LEAST(x, y) ((x) < (y) ? (x) : (y))
#define MOST(x, y) ((x) > (y) ? (x) : (y))

INLINE double clipped(double x) { return x > 0 ? x < 1 ? x : 1 : x == x ? 0 : 0.5; }

INLINE void look(const Work *x, double *point, double t) {
    gaps(Q_OF(point), V_OF(point), &t, x->w + GAPS_AT, GAP_OF(point), RATE_OF(point));
}

INLINE int is_finite_point(const double *point) { return unsound(point, POINT) == 0; }

static void begin_afresh(const Work *x, double *carry, const double *v) {
    carry[0] = 0;
    COPY(carry + 1, x->scale, 2 * N), COPY(carry + 1 + 2 * N, v, N);
}

/* The instant so much later, by one step of that size; 0 where it cannot be solved. */
static int ahead_by(Work *x, const double *from, double t, double ahead, double *to) {
    const ContactArguments *a = x->a;
    if (++x->looks > MOST_LOOKS) return 0;
    begin_afresh(x, x->carry, V_OF(from));
    double rests[4 * N];
    COPY(rests, REST_OF(from), 2 * N);
    const RunArguments one = {1, 1, 0, a->most, t, ahead, a->level, from + 1, a->c, 0, x->ends, x->carry, (RunStats *)x->told,
                              x->loop, 0, rests};
    const int status = x->run(&one);
    to[0] = ahead;
    COPY(to + 1, x->ends + 3 * N, 3 * N), COPY(REST_OF(to), rests + 2 * N, 2 * N);
    if (status != DONE || !(((RunStats *)x->told)->residual <= RESIDUAL_LIMIT)) return 0;
    look(x, to, t + ahead);
    return is_finite_point(to);
}

INLINE void count_step(Work *x) {
    const RunStats *s = (RunStats *)x->told;
    x->iterations += s->iterations, x->residual = fmax(x->residual, s->residual);
}
