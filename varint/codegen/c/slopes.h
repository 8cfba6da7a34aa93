/* Simplified Newton's method for the stages of a step (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8).

   What an evaluation misses, fresh - x, is taken through the inverse of I - A (x) h J with slopes J of a single point, in the
   modes of A: pair by pair of its eigenvalues l, (I - l h J)^-1 or with FORM 2 (I - l h da/dv - l^2 h^2 da/dq)^-1. The iteration
   has the same fixed point, and contracts as J changes instead of as h J does: what is stiffly damped, or turned by fields,
   takes a few evaluations a step. Each of them takes longer, so it is for steps that take many. */
#define MOST_SLOPES 256 /* unknowns of a stage */
#define SLOPES_ROOM (MOST_ROWS < MOST_SLOPES ? MOST_ROWS : MOST_SLOPES)
#define IMPROVES (!BY_DEFECT && STAGES <= 8 && STAGES % 2 == 0 && ROWS <= MOST_SLOPES)
#define PAIRS (STAGES / 2)
/* evaluations that take as long: one with slopes, by rows and their products, and slopes themselves */
#define OPERATIONS ((double)WORK + (FORM == 2 && ON_VELOCITY ? 10.0 * ROWS : 0)) /* of an evaluation, with all products */
#define DEARER (1 + (40 + 12.0 * ROWS + 0.8 * ROWS * ROWS) / OPERATIONS)
#define RENEWAL (4 + (double)N / 3 + (DENSE ? 1.5 : 3.0) * ROWS * ROWS * ROWS / OPERATIONS)
#define SLOW 5      /* evaluations with slopes that a step takes at most if they are of use */
#define GROWN_OLD 6 /* evaluations with slopes of a step before, which are taken anew then */
#define TRIED 2     /* steps that tell whether they are the shorter way; one does where it is as many times longer */
#define FAILED 20   /* evaluations that a step is taken for which plain iteration does not solve, besides those that were made */
#define ALWAYS_REPAYS 12 /* rows whose slopes take less than a few plain steps */
#define SHORTER 50  /* evaluations of plain steps that are shorter by as much as the iteration diverges */
#define PERIOD 4    /* steps until the plain iteration is tried again, and each time four times as many */
#define REST 64     /* plain steps until slopes are, and each time four times as many */
#define LASTING (1 << 20)
#define APART_BY 0x1p-25 /* of a number and of how far it moves in a step: differences of slopes */
#define RESTS 0x1p-12     /* of the largest size on the way: less is round-off, or soon will be */
#define CLOSELY 0x1p-10    /* of what speeds miss in a plain round of scenes with full inertia, where slopes improve it */
#define EXACTLY 0x1p-45    /* the same where slopes are taken */
#define OUTGROWN 0x1p16  /* times its size that a number moves: round-off of its differences begins to count */

typedef double Pairs __attribute__((vector_size(32)));
typedef double Modes __attribute__((vector_size(64))); /* real parts of pairs of modes, and behind them the imaginary ones */
typedef struct {
    double left, period;      /* steps with slopes to come, and of them in all */
    double plain, rest;       /* plain steps to come before slopes are tried again, and of them in all */
    double was, spent, made;  /* evaluations of the plain step before those with slopes, and of theirs; how many these are */
    double renew, there;      /* are they to be taken anew, or were they? */
    double sizes[4 * MOST_N]; /* the largest by which they were taken on the way, and what last digits of coordinates make of rows */
#define SLOPES_TOLD (9 + 4 * N) /* these numbers */
#define FAINT(s) ((s)->sizes + 2 * N)
    double *of_places, *of_speeds; /* h J; or h^2 da/dq and h da/dv */
    /* Of every element of the inverse, mode by mode where unknowns have the real parts of modes, and then where these have the
       imaginary ones: what multiplies that part, and what the other one. */
    V (*own)[VECTORS], (*other)[VECTORS];
    Modes *modes;   /* what it is made of */
    double *room;   /* of all these, made when the first ones are taken; 0: not yet */
} Slopes;
