/* What runs with equal steps that prove an error hand over: one of them, and what is known of it. */

/* `run`: its rows, to be taken with `take_run`, which frees them; 0 where its nodes lie in the room. */
typedef struct {
    int64_t steps, runs;
    double estimate, iterations, residual;
    double *run;
} Proved;

/* Memory for so many numbers: coordinates of the nodes, momenta behind them, and velocities where they are asked for. */
typedef struct {
    double *at;
    int64_t most;
} Room;

static void put_nodes(const double *rows, int64_t n, int64_t nodes, int64_t parts, double *to) {
    for (int64_t i = 0; i < parts; i++)
        for (int64_t k = 0; k < nodes; k++, to += n) memcpy(to, rows + n * (3 * k + i), n * sizeof(double));
}

/* The run as it is found: its nodes in the room if they fit. */
static double *handed_over(double *rows, int64_t n, int64_t nodes, int64_t parts, const Room *room) {
    if (parts * n * nodes > room->most) return rows;
    put_nodes(rows, n, nodes, parts, room->at);
    free(rows);
    return 0;
}
