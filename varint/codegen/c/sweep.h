/* How the loops that carry derivatives over the steps of a run are called; varint/codegen/sweep.py has the same layout. */

#define ROOM(count) ((count) + 1) /* no array of C has no elements */

/* varint/sensitivities/sweeps.py has the same order */
enum Sweep { SWEPT, NOT_SOLVED, NOT_REGULAR, NO_NUMBERS, NO_MEMORY };

/* A run, or a piece of one: `steps` steps, the first of which is the step `first` of the run. */
typedef struct {
    int64_t steps, first, columns, every, outer_moves, control_column, control_nodes;
    int64_t smooth; /* nothing jumps between the steps, and all have one size */
    int64_t x_apart, v_apart; /* numbers from node to node, so that the rows of a run can be read where they stand */
    const double *x, *v, *t, *h, *c, *u; /* (steps + 1, 2N of x_apart), (steps + 1, N of v_apart), (steps), (steps), (C), (steps, nodes, CONTROLS) */
    double *outer;   /* tangents: (C + 2, columns), of parameters, step, start time; adjoints: (C + 2), added to */
    double *tangent; /* (2N, columns), or the adjoint (2N): from the one end to the other */
    double *out;     /* tangents: (1 + steps / every, 2N, columns), every > 0; adjoints: (steps, control_nodes, CONTROLS) */
    const double *seeds;   /* (steps, 2N), what the node at which each step begins adds to the adjoint, or none */
    double *loss, *failed; /* the density summed; the step that failed */
    const double *along;   /* second derivatives: tangents at every node, (steps + 1, 2N, columns) */
    double *hessian;       /* (columns, columns), added to */
    const void *scene;     /* its operations, where they are data and not in the source */
} SweepArguments;

/* State and velocity at a node. */
#define STATE_AT(a, node) ((a)->x + (node) * (a)->x_apart)
#define SPEED_AT(a, node) ((a)->v + (node) * (a)->v_apart)

#ifdef SCENE_AS_DATA
#define BEGIN(a) scene = (a)->scene
#else
#define BEGIN(a) (void)0
#endif
