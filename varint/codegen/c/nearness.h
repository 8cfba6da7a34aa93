/* How runs in fictitious time are looked at. rows.h stands before this file. */
/* varint/codegen/nearness.py has the same layouts */
typedef struct {
    int (*rows)(const RowsArguments *);
    const void *energy, *velocity; /* (q, p, t) to the energy that stays and |p v|; to v */
    const int64_t *body, *turns;   /* first coordinate of the same body; is it an angle? */
    const double *parts;           /* of quantiles */
    int64_t n, width, samples, most; /* coordinates, and of a node with those of the clock; nodes whose energy is looked at, and
                                        that are compared, and up to as many more */
    double rounded;
} Course;

typedef struct {
    const double *c, *mass; /* parameters; the mass matrix' diagonal, its numbers so far apart */
    int64_t apart;
} Places;

/* What until_core.c has kept of so many nodes: with the clock among the coordinates. */
typedef struct { const double *kept; int64_t nodes; } Kept;
typedef struct {
    Course on;
    Places at;
    Kept run;
    double *told; /* QUANTILES */
} Swing;

typedef struct {
    Course on;
    Places at;
    Kept one, other;
    int64_t few, many; /* steps of the whole duration */
    double *told;      /* the largest difference, the least that an early one lets expect in the middle, how much larger between */
} Apart;
