/* A motion and the times at which it is looked at, in order: its nodes, and the shorter steps that go from them.

   varint/codegen/times.py has the same layout. */
typedef struct {
    int (*parts)(const void *); /* PartsArguments in run.h */
    const void *scene;
    int64_t n, most, told; /* coordinates; iterations of a step; numbers that its loop is told at each fresh start */
    int64_t nodes, count;  /* of the motion; times */
    const double *t, *q, *p;
    const int64_t *k; /* whole steps before each node; 0: equal steps from t0 on, with a node at each of them, and no t */
    const double *c, *times;
    double *found_q, *found_p;
    int64_t *found_k;
    double h, t0;
    const double *sizes; /* of the steps, where they differ: h is then one of them; else 0 */
    double *room;          /* ROOM_OF_TIMES numbers: what goes ahead, see times_core.c */
    const double *opening; /* what the loop is told, for each shorter step */
    int (*within)(const void *); /* of a rule of more stages, for steps that hold many times: WithinArguments in run.h; or 0 */
    const void *within_scene;
    const double *tables;
    int64_t order, fewest; /* times that such a step holds at least */
} Times;

/* One whose last coordinate is a clock, and what it is to show; its pace at the nodes, and the own times that are found. */
typedef struct {
    Times times;
    const double *paces;
    double *found_t;
} ClockTimes;

#define ROOM_OF_TIMES(n, count) (1 + (count) * (5 * (n) + 6))
