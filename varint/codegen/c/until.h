/* How steps until a physical time are asked for. run.h and rows.h stand before this file. */
/* varint/codegen/until.py has the same layouts */
typedef struct {
    int64_t steps, nodes, iterations, quiet; /* until the end; that are kept */
    double residual;
} Told;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *energies; /* (q, p) to the energy that was E0 at the start, its |p·v|, the energy that is constant, its |p·v|, the clock's pace */
    int64_t n, carry, most;
    double *nodes; /* (nodes, 3 n): q, p, v */
    Told *told;
    double *kept;
    int64_t room; /* numbers that nodes may be */
    const double *start, *c;
    int64_t every;
    double patience, h, level, total, energy, off, t0; /* energy: that of the start, off by what part of |p·v| at most */
} Until;
