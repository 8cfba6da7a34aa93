/* What runs with equal steps that prove an error hand over: one of them, and what is known of it. */

/* `run`: its rows, to be taken with `take_run`, which frees them; 0 where its nodes lie in the room. */
typedef struct {
    int64_t steps, runs;
    double estimate, iterations, residual;
    double *run;
    int64_t last, zeros; /* number of the last node; zeros that were found, less than none where they could not be looked for */
    double ends;         /* when the run before ended early, infinite where it did not */
} Proved;

/* Memory for so many numbers: coordinates of the nodes, momenta behind them, and velocities where they are asked for. */
typedef struct {
    double *at;
    int64_t most;
} Room;

static void put_nodes(const double *rows, int64_t n, int64_t nodes, int64_t parts, double *to) {
    for (int64_t k = 0; k < nodes; k++)
        for (int64_t i = 0; i < parts; i++)
            for (int64_t d = 0; d < n; d++) to[n * (nodes * i + k) + d] = rows[n * (3 * k + i) + d];
}

#define SHORT 2048 /* numbers of a run whose memory is the stack */

/* Rows of a run, which lie in memory of its own if they are few. */
static void give_up(double *rows, const double *own) {
    if (rows != own) free(rows);
}

/* Memory for so many numbers in place of these. */
static double *memory_for(int64_t numbers, double *rows, double *own) {
    give_up(rows, own);
    return own && numbers <= SHORT ? own : malloc(numbers * sizeof(double));
}

/* What runs have for rows that are few: what fits there fits into the room. */
static double *own_memory(double *memory, const Room *room) { return room->most < SHORT ? 0 : memory; }

/* The run as it is found: its nodes in the room if they fit. */
static double *handed_over(double *rows, const double *own, int64_t n, int64_t nodes, int64_t parts, const Room *room) {
    if (parts * n * nodes > room->most) return rows;
    put_nodes(rows, n, nodes, parts, room->at);
    give_up(rows, own);
    return 0;
}

/* What is handed over and asked behind a course of runs, in the order of Place and Asked in direct.c: q and p, parameters; what is
   found; the mass matrix' diagonal, its numbers so far apart; room; steps to begin with; rates that steps may follow (0: none);
   what writes what the loop is told at a fresh start, so many numbers, for steps h, and whether it is there; what is looked for. */
#define BEHIND_THE_COURSE \
    const double *start, *c; \
    Proved *found; \
    const double *mass; \
    int64_t apart; \
    Room room; \
    int64_t first; \
    double t0, duration, radians, tol; \
    const void *rates; \
    int (*open)(double h); \
    const double *opening; \
    int64_t opens; \
    Search search;
