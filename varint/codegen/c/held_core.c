/* Whether a start is clearly on its constraint rows and determines a motion there, and its momentum without round-off across
   them. The name ends in LEVEL, the instructions that are used.

   varint/discrete/consistency.py looks closer where this leaves a doubt, and says what is wrong. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define held WITH_ALL(held, LEVEL)
#define LANES 1
#include "lanes.h"
#include "run.h"

enum Start { CLEAR, IN_DOUBT };
#define SURE 0.9         /* of a limit: sums in another order differ by their last digits */
#define INDEPENDENT 1e-10 /* least determinant of a matrix with a unit diagonal: its eigenvalues are not below a third of that */

/* varint/codegen/held.py has the same layout */
typedef struct {
    int64_t n, rows, positions;     /* coordinates; rows that restrict velocities; holonomic ones */
    const double *q, *v, *mass;     /* (n, n) */
    const double *g, *speeds, *slopes; /* of holonomic rows; W v + w; W, column after column */
    const double *along, *change;   /* velocity along the rows that belongs to the momentum; change that makes it fit them */
    double *p;                      /* is changed by that */
    double off, steepest, little;   /* see OFF in projection.py and STEEPEST in start.py; of the largest coordinate: the least size of one */
} Held;

/* Determinant of a symmetric matrix with a unit diagonal, which is overwritten; 0 where it is not positive definite. */
static double determinant(double *a, int64_t n) {
    double found = 1;
    for (int64_t k = 0; k < n; k++) {
        const double pivot = a[k * n + k];
        if (!(pivot > 0)) return 0;
        found *= pivot;
        for (int64_t i = k + 1; i < n; i++) {
            const double part = a[i * n + k] / pivot;
            for (int64_t j = k + 1; j < n; j++) a[i * n + j] -= part * a[k * n + j];
        }
    }
    return found;
}

/* Whether all masses are positive by far, and no row depends on the others in their metric; `room` has (n or rows) squared. */
static int is_regular(const Held *a, double *roots, double *lengths, double *room) {
    const int64_t n = a->n, rows = a->rows;
    for (int64_t i = 0; i < n; i++) {
        if (!(a->mass[i * n + i] > 0)) return 0;
        roots[i] = sqrt(a->mass[i * n + i]);
    }
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) room[i * n + j] = i == j ? 1 : a->mass[i * n + j] / (roots[i] * roots[j]);
    if (!(determinant(room, n) > INDEPENDENT)) return 0;
    for (int64_t i = 0; i < rows; i++) {
        double sum = 0;
        for (int64_t j = 0; j < n; j++) sum += (a->slopes[j * rows + i] / roots[j]) * (a->slopes[j * rows + i] / roots[j]);
        if (!(sum > 0)) return 0;
        lengths[i] = sqrt(sum);
    }
    for (int64_t i = 0; i < rows; i++)
        for (int64_t k = 0; k < rows; k++) {
            double sum = 0;
            for (int64_t j = 0; j < n; j++) sum += (a->slopes[j * rows + i] / roots[j]) * (a->slopes[j * rows + k] / roots[j]);
            room[i * rows + k] = i == k ? 1 : sum / (lengths[i] * lengths[k]);
        }
    return determinant(room, rows) > INDEPENDENT;
}

/* Whether the rows hold at the start, and for its velocities. */
static int is_on_rows(const Held *a) {
    const int64_t n = a->n, rows = a->rows;
    double far = 0, fast = 0;
    for (int64_t j = 0; j < n; j++) far = fmax(far, fabs(a->q[j])), fast = fmax(fast, fabs(a->v[j]));
    const double least = far > 0 ? a->little * far : 1;
    for (int64_t i = 0; i < rows; i++) {
        double reach = 0, moved = 0, size = 0, sum = 0;
        for (int64_t j = 0; j < n; j++) {
            const double w = a->slopes[j * rows + i], part = w * a->v[j];
            if (!(fabs(w) < a->steepest)) return 0;
            reach += fabs(w) * fmax(fabs(a->q[j]), least), moved += part, size += fabs(part), sum += fabs(w);
        }
        if (!(fabs(a->speeds[i]) + size < a->steepest)) return 0;
        size += fabs(a->speeds[i] - moved);
        if (!(fabs(a->speeds[i]) <= SURE * a->off * fmax(size, sum * fast))) return 0;
        if (i < a->positions && !(fabs(a->g[i]) <= SURE * a->off * reach)) return 0;
    }
    return 1;
}

int held(const Held *a) {
    const int64_t n = a->n, most = n > a->rows ? n : a->rows;
    if (unsound(a->along, (int)n) + unsound(a->change, (int)n) != 0 || !is_on_rows(a)) return IN_DOUBT;
    double *const room = malloc((size_t)(2 * most + most * most) * sizeof *room);
    const int regular = room && is_regular(a, room, room + most, room + 2 * most);
    free(room);
    if (!regular) return IN_DOUBT;
    for (int64_t j = 0; j < n; j++) a->p[j] += a->change[j];
    return CLEAR;
}
