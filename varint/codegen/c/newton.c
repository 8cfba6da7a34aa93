/* Newton's method on the equations of a step, from extrapolated start values, with compensated updates of q and p.

   Defined before this file: N, NU, NODES, Y (unknowns), C (parameters), SIZES, HISTORY (steps that start values use), the
   tables of start values, PERM and the scene's functions. CLOSED: `equations` gives the correction; else the residual and the
   nonzeros of the Jacobian, which go to the places `AT` of a band matrix (BELOW, REACH: see below). LINEAR: the
   equations are linear, the matrix is factorised once and `equations` is their residual alone; MAP: they are few, and
   `finish` is a constant affine map of q and p that needs no unknowns; `checked` is the residual that it leaves. KICKED: half kicks stand
   before and behind the equations. HELD: the momentum is projected onto a hidden constraint of H unknowns, which gives the
   velocities too where HIDDEN_SPEED is set. */

#define WINDOW 1024 /* steps between two looks at the typical sizes */
#define RESIZED 16  /* steps between two looks at the sizes that change with the place */

/* What a run needs to go on as if it had not stopped; at a fresh start the caller fills scale and speed. */
typedef struct {
    double started, scale[2 * N], speed[N], sizes[SIZES + 1], h, known, age, q[N], p[N], rest_q[N], rest_p[N];
    double force[N], seen[2 * N], y[HISTORY][Y];
} Carry;
const int64_t carry_size = sizeof(Carry) / sizeof(double);

#define LARGE static __attribute__((noinline))
#define EQUATIONS_AT 0
#define FINISH_AT (EQUATIONS_AT + EQUATIONS_W)
#define UNITS_AT (FINISH_AT + FINISH_W)
#define SPEED_AT (UNITS_AT + UNITS_W)
#define KICK_AT (SPEED_AT + SPEED_W)
#define SIZED_AT (KICK_AT + KICK_W)
#define HIDDEN_AT (SIZED_AT + SIZED_W)
#define PULLED_AT (HIDDEN_AT + HIDDEN_W)
#define SLOPE_AT (PULLED_AT + PULLED_W)
#define CHECKED_AT (SLOPE_AT + SLOPE_W)
#define INDEPENDENCE_AT (CHECKED_AT + CHECKED_W)
#define ALL_W (INDEPENDENCE_AT + INDEPENDENCE_W + 1)

#include "band.h"

#if !CLOSED
/* The correction of the unknowns, in the order of PERM, from the residual b in the same order. */
LARGE void correct(const double *jacobian, double *matrix, double *b) {
    int pivots[Y];
    memset(matrix, 0, BAND_SIZE * sizeof(double));
    for (int i = 0; i < NONZEROS; i++) matrix[AT[i]] = jacobian[i];
    factorise(Y, BELOW, REACH, matrix, pivots);
    substitute(Y, BELOW, REACH, matrix, pivots, b);
}
#endif

/* The largest of what remains, or no number. */
INLINE double largest_of(const double *remains) {
    double left = 0;
    for (int i = 0; i < Y; i++) left = fabs(remains[i]) > left || remains[i] != remains[i] ? fabs(remains[i]) : left;
    return left;
}

#if !MAP
/* Newton's method until a correction of LAST_CORRECTION, applied: what is left is its square. A linear solve errs by the
   round-off of the factors, the same in every step, in what it corrects alone: hardly anything, from a continued start. */
INLINE int solve(double *y, const double *q, const double *p, const double *u, double t, const double *w,
                  const double *inverse, int most, double *matrix, const int *pivots, int64_t *count) {
    for (int i = 0; i < most; i++) {
        double b[Y + REACH] = {0}, worst = 0;
        *count += 1;
#if LINEAR
        equations(y, q, p, &t, u, w + EQUATIONS_AT, b);
        substitute(Y, BELOW, REACH, matrix, pivots, b);
#elif CLOSED
        equations(y, q, p, &t, u, w + EQUATIONS_AT, b);
#else
        double jacobian[NONZEROS];
        equations(y, q, p, &t, u, w + EQUATIONS_AT, b, jacobian);
        correct(jacobian, matrix, b);
#endif
        for (int k = 0; k < Y; k++) {
            const double size = fabs(b[k]) * inverse[k];
            worst = size > worst ? size : worst;
            y[PERM[k]] -= b[k];
        }
        if (worst <= LAST_CORRECTION) return 1; /* a correction that is not a number ends it too, and shows in the residual */
    }
    return 0;
}
#endif

#if HELD
/* x: velocities and multipliers (or multipliers alone) that make the momentum p fit the hidden constraint */
LARGE void project(const double *q, const double *p, double t, const double *w, double *matrix, double *x) {
    double jacobian[HIDDEN_NONZEROS], b[H + HIDDEN_REACH] = {0};
    int pivots[H];
    hidden(q, p, &t, w + HIDDEN_AT, b, jacobian);
    memset(matrix, 0, HIDDEN_SIZE * sizeof(double));
    for (int i = 0; i < HIDDEN_NONZEROS; i++) matrix[HIDDEN_PLACES[i]] = jacobian[i];
    factorise(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots);
    substitute(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots, b);
    for (int k = 0; k < H; k++) x[HIDDEN_PERM[k]] = b[k];
}
#endif

/* Start values of `rows` × `columns` unknowns of a step, from `offset` on: continued from `known` steps by the table. */
INLINE void extend(const double *table, int known, int rows, int columns, int offset, double *const *y, double *next) {
    table += columns * columns * (known * (known - 1) / 2);
    for (int j = 0; j < columns; j++) {
        double *const to = next + offset + j * rows;
        for (int i = 0; i < rows; i++) to[i] = 0;
        for (int s = 0; s < known; s++)
            for (int k = 0; k < columns; k++) {
                const double factor = table[(j * known + s) * columns + k], *const from = y[s] + offset + k * rows;
                for (int i = 0; i < rows; i++) to[i] += factor * from[i];
            }
    }
}

/* Velocities, multipliers and those of non-holonomic rows continued; without a step behind, the velocity at the start. */
INLINE void guess(int known, double *const *y, const double *speed, double *next) {
    if (known) {
        extend(AHEAD_VELOCITIES, known, PATH, DEGREE, 0, y, next);
        extend(AHEAD_MULTIPLIERS, known, MULTIPLIERS, DEGREE, PATH * DEGREE, y, next);
        extend(AHEAD_ROWS, known, ROWS, 1, (PATH + MULTIPLIERS) * DEGREE, y, next);
    } else {
        for (int i = 0; i < Y; i++) next[i] = i < PATH * DEGREE ? POINTS[i / N] * speed[i % N] : 0;
    }
}

LARGE void save(double *row, const double *q, const double *p, double t, const double *w, double *matrix) {
    memcpy(row, q, N * sizeof(double)), memcpy(row + N, p, N * sizeof(double));
#if HELD && HIDDEN_SPEED
    double x[H];
    project(q, p, t, w, matrix, x);
    speed(x, q, &t, w + SPEED_AT, row + 2 * N);
#else
    speed(q, p, &t, w + SPEED_AT, row + 2 * N);
#endif
}

#if WATCHED
/* What the saved nodes have shown of the constraint rows: pivots and lengths. What is not a number stays. */
typedef struct { double nearest, farthest, least[VELOCITY_ROWS], largest[VELOCITY_ROWS]; } Rows;

LARGE void look(Rows *rows, const double *q, double t, const double *w) {
    double pivot, length[VELOCITY_ROWS];
    independence(q, &t, w + INDEPENDENCE_AT, &pivot, length);
    rows->nearest = pivot < rows->nearest || pivot != pivot ? pivot : rows->nearest;
    rows->farthest = pivot > rows->farthest ? pivot : rows->farthest;
    for (int i = 0; i < VELOCITY_ROWS; i++) {
        rows->least[i] = length[i] < rows->least[i] || length[i] != length[i] ? length[i] : rows->least[i];
        rows->largest[i] = length[i] > rows->largest[i] ? length[i] : rows->largest[i];
    }
}
#endif

/* What depends on parameters, step and sizes alone. */
LARGE void prepare(const double *k, double *w, double *inverse, double *matrix, int *pivots) {
    finish_prepare(k, w + FINISH_AT), speed_prepare(k, w + SPEED_AT);
#if !MAP
    equations_prepare(k, w + EQUATIONS_AT), units_prepare(k, w + UNITS_AT);
    double size[Y];
    units(w + UNITS_AT, size);
    for (int i = 0; i < Y; i++) inverse[i] = 1 / size[PERM[i]];
#endif
#if KICKED
    kick_prepare(k, w + KICK_AT);
#endif
#if HELD
    sized_prepare(k, w + SIZED_AT), hidden_prepare(k, w + HIDDEN_AT), pulled_prepare(k, w + PULLED_AT);
#endif
#if MAP
    checked_prepare(k, w + CHECKED_AT);
#endif
#if WATCHED
    independence_prepare(k, w + INDEPENDENCE_AT);
#endif
#if LINEAR && !MAP
    double jacobian[NONZEROS];
    slope_prepare(k, w + SLOPE_AT), slope(w + SLOPE_AT, jacobian);
    memset(matrix, 0, BAND_SIZE * sizeof(double));
    for (int i = 0; i < NONZEROS; i++) matrix[AT[i]] = jacobian[i];
    factorise(Y, BELOW, REACH, matrix, pivots);
#endif
}

/* New typical sizes from what the last steps showed. */
LARGE void rescale(double *scale, double *seen) {
    double root[N], most = 0;
    for (int d = 0; d < N; d++) {
        root[d] = sqrt(scale[N + d] / scale[d]); /* of the inertia */
        scale[d] = fmax(seen[d], 0.1 * scale[d]), scale[N + d] = fmax(seen[N + d], 0.1 * scale[N + d]);
        most = fmax(most, scale[d] * root[d]);
        seen[d] = seen[N + d] = 0;
    }
    for (int d = 0; d < N; d++) {
        scale[d] = fmax(scale[d], SMALLEST * most / root[d]);
        scale[N + d] = fmax(scale[N + d], SMALLEST * most * root[d]);
    }
}

int run(const RunArguments *a) {
    const int64_t steps = a->steps, first = a->first;
    const int most = a->most < MOST_ITERATIONS ? (int)a->most : MOST_ITERATIONS;
    const double t0 = a->t0, h = a->h, per_h = 1 / h;
    const double *u = a->u;
    double *rows = a->rows, k[C + 1 + 2 * N + SIZES], w[ALL_W], inverse[Y], *matrix = 0;
    double *const scale = k + C + 1, *const sizes = scale + 2 * N;
    int pivots[Y];
    Carry *const state = (Carry *)a->carry;
    double *const q = state->q, *const p = state->p, *const seen = state->seen;
    int64_t iterations = 0, largest_count = 0, done = 0, unsaved = 0;
    int status = DONE;
    double left = 0, worst = 0;
#if MATRIX_SIZE
    matrix = malloc(MATRIX_SIZE * sizeof(double));
    if (!matrix) return NOT_FINITE;
#endif
    memcpy(k, a->c, C * sizeof(double)), k[C] = h;
    if (!(state->started == 1 && state->h == h)) {
        memcpy(q, a->start, N * sizeof(double)), memcpy(p, a->start + N, N * sizeof(double));
        memset(state->rest_q, 0, sizeof state->rest_q), memset(state->rest_p, 0, sizeof state->rest_p);
        memset(seen, 0, sizeof state->seen), state->known = state->age = 0;
    }
    memcpy(scale, state->scale, sizeof state->scale), memcpy(sizes, state->sizes, SIZES * sizeof(double));
    prepare(k, w, inverse, matrix, pivots);
#if KICKED
    if (!(state->started == 1 && state->h == h)) {
        const double t = t0 + h * (double)first;
        kick(q, &t, u, w + KICK_AT, state->force);
    }
#endif
    double *y[HISTORY + 1], unknowns[HISTORY + 1][Y]; /* y[0] is the step at hand, y[s] that of s steps ago */
    for (int s = 0; s <= HISTORY; s++) y[s] = unknowns[s];
    for (int s = 0; s < HISTORY; s++) memcpy(y[s + 1], state->y[s], sizeof state->y[s]);
    save(rows, q, p, t0 + h * (double)first, w, matrix), rows += 3 * N;
#if WATCHED
    Rows held = {INFINITY, 0, {0}, {0}};
    for (int i = 0; i < VELOCITY_ROWS; i++) held.least[i] = INFINITY;
    look(&held, q, t0 + h * (double)first, w);
#endif

    for (; done < steps; done++) {
        const double t = t0 + h * (double)(first + done), end = t0 + h * (double)(first + done + 1);
        const double *p_start = p;
        double increment[N], gain[N], remains[Y];
#if HELD
        if ((int64_t)state->age % RESIZED == 0) {
            sized(q, &t, w + SIZED_AT, sizes);
            prepare(k, w, inverse, matrix, pivots);
        }
#endif
#if KICKED
        double kicked[N], force[N];
        if (NU) kick(q, &t, u, w + KICK_AT, force);
        else memcpy(force, state->force, sizeof force);
        for (int d = 0; d < N; d++) kicked[d] = p[d] + 0.5 * h * force[d];
        p_start = kicked;
#endif
        int64_t count = 0;
#if MAP
        finish(q, p, &t, u, w + FINISH_AT, increment, gain);
        count = 1;
        if ((int64_t)state->age % WINDOW == 0) {
            checked(q, p, &t, u, w + CHECKED_AT, remains);
            left = largest_of(remains);
        }
#else
        for (;;) { /* once more from the last step alone where the continued start is too far, then from the velocity */
            const int known = (int)state->known;
            guess(known, y + 1, state->speed, y[0]);
            const int converged = solve(y[0], q, p_start, u, t, w, inverse, most, matrix, pivots, &count);
            finish(y[0], q, p_start, &t, u, w + FINISH_AT, increment, gain, remains);
            left = largest_of(remains);
            status = converged && left <= RESIDUAL_LIMIT ? DONE : left == left && left < INFINITY ? NOT_CONVERGED : NOT_FINITE;
            if (!status || !known) break;
            state->known = known > 1;
            if (known == 1) {
                double row[3 * N];
                save(row, q, p, t, w, matrix), memcpy(state->speed, row + 2 * N, sizeof state->speed);
            }
        }
#endif
        iterations += count;
        largest_count = count > largest_count ? count : largest_count;
        if (status) break;
        worst = left > worst ? left : worst;
        double q1[N], p1[N], rest_q[N], rest_p[N], zero = 0;
        for (int d = 0; d < N; d++) q1[d] = q[d], rest_q[d] = state->rest_q[d], compensated(&q1[d], &rest_q[d], increment[d]);
#if KICKED
        double after[N];
        kick(q1, &end, u + (NODES - 1) * NU, w + KICK_AT, after);
        for (int d = 0; d < N; d++) gain[d] += 0.5 * h * (force[d] + after[d]);
#endif
#if HELD
        double reached[N], x[H], pull[N];
        for (int d = 0; d < N; d++) reached[d] = p[d] + gain[d];
        project(q1, reached, end, w, matrix, x);
        pulled(x, q1, reached, &end, w + PULLED_AT, pull);
        for (int d = 0; d < N; d++) gain[d] += pull[d];
#endif
        for (int d = 0; d < N; d++) {
            p1[d] = p[d], rest_p[d] = state->rest_p[d], compensated(&p1[d], &rest_p[d], gain[d]);
            zero += q1[d] * 0.0 + p1[d] * 0.0; /* not zero as soon as one of them is not finite */
        }
        if (!(zero == 0)) { status = NOT_FINITE; break; }
        for (int d = 0; d < N; d++) {
            const double v = fabs(increment[d] * per_h), m = fabs(p1[d]);
            seen[d] = v > seen[d] ? v : seen[d], seen[N + d] = m > seen[N + d] ? m : seen[N + d];
            q[d] = q1[d], p[d] = p1[d], state->rest_q[d] = rest_q[d], state->rest_p[d] = rest_p[d];
        }
#if KICKED
        memcpy(state->force, after, sizeof after);
#endif
#if !MAP
        double *const oldest = y[HISTORY];
        for (int s = HISTORY; s > 0; s--) y[s] = y[s - 1];
        y[0] = oldest;
        state->known += state->known < HISTORY;
#endif
        state->age += 1;
        if ((int64_t)state->age % WINDOW == 0) rescale(scale, seen), prepare(k, w, inverse, matrix, pivots);
        u += NODES * NU;
        if (++unsaved == a->save_every) {
            unsaved = 0, save(rows, q, p, end, w, matrix), rows += 3 * N;
#if WATCHED
            look(&held, q, end, w);
#endif
        }
    }
    save(a->stats->last, q, p, t0 + h * (double)(first + done), w, matrix);
    state->started = !status, state->h = h;
    memcpy(state->scale, scale, sizeof state->scale), memcpy(state->sizes, sizes, SIZES * sizeof(double));
    for (int s = 0; s < HISTORY; s++) memcpy(state->y[s], y[s + 1], sizeof state->y[s]);
    free(matrix);
    a->stats->nearest = a->stats->farthest = a->stats->shrunk = 0;
#if WATCHED
    a->stats->nearest = held.nearest, a->stats->farthest = held.farthest, a->stats->shrunk = INFINITY;
    for (int i = 0; i < VELOCITY_ROWS; i++) {
        const double part = held.least[i] / held.largest[i];
        a->stats->shrunk = part < a->stats->shrunk || part != part ? part : a->stats->shrunk;
    }
#endif
    a->stats->status = status, a->stats->steps = (double)done, a->stats->iterations = (double)iterations;
    a->stats->most_iterations = (double)largest_count, a->stats->residual = worst, a->stats->failed = status ? left : 0, a->stats->contraction = 0;
    return status;
}
