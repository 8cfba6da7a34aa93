/* What others look at closely in a run that constraint rows hold: folds of the rows (fold_watch.py), and leaps of the energy
   (energy_leap.py). run.h, rows.h and order.h stand before this file. */
#define SURE 0.9 /* of a limit: others come to the same numbers another way */
#define WIDTHS 2 /* of a note of a fold: numbers before q and p of a node (folds.h) */

typedef struct {
    int (*rows)(const RowsArguments *);
    const void *energy; /* (q, p, t) to the energy and |p v|; by velocity (q, v, t) */
    const double *c, *t0;
    int64_t n, by_velocity;
} Energies;

typedef struct { double least, round_off, leap, apart, all, few; } LeapLimits;

/* A run, and what its loop noted of folds: numbers of a node of a note, and the last nodes. */
typedef struct {
    int (*rows)(const RowsArguments *);
    const void *pivots; /* (q, t) to the least pivot of the constraint rows; 0: they never come to depend on one another */
    const double *c, *lately;
    int64_t size, steps;
    double t0, h;
} FoldNotes;

static double size_of(double x, double largest) {
    const double size = x - x == 0 ? fabs(x) : 0;
    return size > largest ? size : largest;
}

/* Energies and |p v| of so many nodes, every so many; `at` has room for their states. */
static int set_own_energies(const Energies *a, const double *rows, const int64_t *which, int64_t every, int64_t count, double *energy,
                            double *moving, double *at) {
    const int64_t n = a->n;
    for (int64_t i = 0; i < count; i++) {
        const double *const node = rows + 3 * n * (which ? which[i] : i * every);
        memcpy(at + 2 * n * i, node, n * sizeof(double));
        memcpy(at + 2 * n * i + n, node + (a->by_velocity ? 2 * n : n), n * sizeof(double));
    }
    const RowsArguments asked = {.count = count, .c = a->c, .scene = a->energy, .arguments = {at, at + n, a->t0},
                                 .apart = {2 * n, 2 * n, 0}, .results = {energy, moving}, .widths = {1, 1}};
    return a->rows(&asked) == DONE;
}

/* How many of the nodes after the start lie between two whose energies are compared. */
static int64_t between_looks(const LeapLimits *l, int64_t steps, int64_t nodes) {
    const int64_t some = (int64_t)l->apart * nodes / steps, rare = nodes / (int64_t)l->all, most = some < rare ? some : rare;
    return most > 1 ? most : 1;
}

/* Whether no energy of so many nodes after the start is off that of the one before by more than others nearby. */
static int leaps_nowhere(const Energies *a, const LeapLimits *l, const double *rows, int64_t steps, int64_t nodes, double *room) {
    const int64_t every = between_looks(l, steps, nodes), last = nodes / every;
    if (nodes < (int64_t)l->few) return 1;
    double *const energy = room, *const moving = energy + last + 1, *const changes = moving + last + 1, largest = 0, fastest = 0, most = 0;
    if (!set_own_energies(a, rows, 0, every, last + 1, energy, moving, changes)) return 0;
    for (int64_t i = 0; i <= last; i++) largest = size_of(energy[i], largest), fastest = size_of(moving[i], fastest);
    for (int64_t i = 0; i < last; i++) changes[i] = fabs(energy[i + 1] - energy[i]), most = size_of(changes[i], most);
    const double least = l->least * fastest, nothing = l->round_off * largest;
    if (most <= SURE * (least > nothing ? least : nothing)) return 1;
    place(changes, 0, last - 1, (last - 1) / 2);
    return most <= SURE * l->leap * changes[(last - 1) / 2];
}

/* Whether no fold of the constraint rows was noted on the way, and there is none at the very end, where a loop has noted none yet
   (fold_watch.py: _behind). */
static int is_unfolded(const FoldNotes *a, const RunStats *of) {
    double far[LATELY];
    int64_t count = 0;
    if (of->noted) return 0;
    if (!a->pivots) return 1;
    for (int64_t k = a->steps < LATELY ? 0 : a->steps - LATELY + 1; k <= a->steps; k++, count++) {
        const double *const node = a->lately + k % LATELY * a->size, t = a->t0 + a->h * (double)k;
        const RowsArguments asked = {.count = 1, .c = a->c, .scene = a->pivots, .arguments = {node + WIDTHS, &t},
                                     .results = {far + count}, .widths = {1}};
        if (node[0] != (double)k || a->rows(&asked) != DONE) return 0;
        far[count] = sqrt(fmax(far[count], 0));
    }
    for (int64_t i = 1; i < count; i++) {
        const double change = (far[i] - far[i - 1]) / SURE;
        if (!(far[i] + change > 0 && far[i - 1] - change > 0)) return 0;
    }
    return 1;
}

/* Numbers that notes of folds need, of so many numbers a node. */
static int64_t room_of_notes(int64_t size) { return size ? MOST_NOTED * (1 + LATELY * size) : 0; }
