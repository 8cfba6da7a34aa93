/* How a look ahead is asked for. */
/* varint/codegen/look_ahead.py has the same layout */
typedef struct {
    const void *scene;
    const double *start, *c; /* q and v; parameters */
    double *told;            /* mean of w over time, its largest value, the time that was seen, w at the start */
    int64_t n, steps;
    double angle, sign, total, astray; /* of w in a step; how long at most; energy error over p v where it ends */
} LookAhead;
