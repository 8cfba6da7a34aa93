/* How functions as data are called at many points. run.h stands before this file. */
#define MOST_ARGUMENTS 8

/* varint/codegen/rows.py has the same layout */
typedef struct {
    int64_t count;                          /* points */
    const double *c;                        /* parameters */
    const void *scene;                      /* a Tape */
    const double *arguments[MOST_ARGUMENTS]; /* component k of argument i at point r: arguments[i][r apart[i] + k] */
    int64_t apart[MOST_ARGUMENTS];           /* 0 where all points have the same */
    double *results[MOST_ARGUMENTS];         /* results[j][r widths[j] + k] */
    int64_t widths[MOST_ARGUMENTS];
} RowsArguments;
