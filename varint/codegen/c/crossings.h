/* How zeros within the steps of a motion are searched for. run.h and rows.h stand before this file. */
enum Searched { SEARCHED, NO_ROOM, NOT_SOLVED };
enum Step { BROKEN, QUIET, WANTED }; /* from a node to the next: none of the motion, or whether it is to be searched */
/* varint/codegen/crossings.py has the same layout */
typedef struct {
    int (*parts)(const PartsArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *values, *bounds;           /* (q, v, t) to value and rate; (q, v at both ends, t, w) of a piece to its bounds */
    const double *t, *q, *v, *p, *c;       /* nodes, and parameters */
    const double *u, *opening;             /* of every node: controls held over the step, and what the loop must be told */
    const double *before;                  /* v and p in which the motion comes to nodes where it jumps */
    const int32_t *jumps;                  /* of every node: which of these, or -1; 0: it jumps nowhere */
    double *zeros;                         /* of each: node before it, sign before it, then a point */
    int64_t *found;                        /* zeros, and the first step that was not searched */
    char *steps;                           /* of every node but the last: a Step */
    int64_t n, nodes, marking, used, told, most, room; /* whether to tell apart QUIET steps alone; numbers of `u` and `opening` for each */
    int64_t halvings, deepest, most_pieces, iterations, secants, newton;
    double close, located, pole, shallow;  /* times so near to a node are that node's; see roots.py and isolation.py */
} Crossings;
