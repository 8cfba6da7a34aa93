/* A step of newton.c, or a part of one. */

#include "band.h"
#include "map.h"
#ifdef WITHOUT_NODES
#define FOUND NONZEROS
#define equations_at_nodes(...) ((void)0)
#define finish_at_nodes(...) ((void)0)
#else
#include "nodes.c"
#endif

/* The factors of a matrix in the order of PERM from its nonzeros. */
LARGE void factors_of(const double *jacobian, double *matrix, int *pivots) {
    ZEROS(matrix, BAND_SIZE);
    if (SLOPES_AT_NODES)
        for (int i = 0; i < NONZEROS; i++) { ONE_BY_ONE; matrix[AT[i]] = jacobian[FROM[i]]; }
    else
        for (int i = 0; i < NONZEROS; i++) matrix[AT[i]] = jacobian[i];
    factorise(Y, BELOW, REACH, matrix, pivots);
}

/* The largest of what remains, or no number. */
INLINE double largest_of(const double *remains) {
    double left = 0;
    for (int i = 0; i < Y; i++) left = fabs(remains[i]) > left ? fabs(remains[i]) : left;
    return left + unsound(remains, Y);
}

/* Newton's method until a correction of LAST_CORRECTION, applied: what is left is its square. A correction by the factors of the
   one before leaves twice the product of both, or twice its square by the one before where that is less, which must not be
   more than that square. The second correction is one where that
   will do: it is `bend` times the square of the first. A linear solve errs by the round-off of the factors, the same in every
   step, in what it corrects alone: hardly anything, from a continued start. */
INLINE int solve(double *y, const double *q, const double *p, const double *u, double t, const double *w,
                  const double *units, const double *inverse, int most, double *matrix, int *pivots, double *bend, int64_t *count) {
    double jacobian[FOUND + 1];
    if (FROZEN) {
        frozen_of(y, q, &t, w, jacobian);
        factors_of(jacobian, matrix, pivots);
    }
    double before = INFINITY;
    int reused = 0;
    for (int i = 0; i < most; i++) {
        double b[Y + REACH], worst = 0;
        if (FROZEN && i && i % RENEWED == 0) {
            frozen_of(y, q, &t, w, jacobian);
            factors_of(jacobian, matrix, pivots);
        }
        ZEROS(b, Y + REACH);
        *count += 1;
        if (AT_NODES && FROZEN) equations_at_nodes(y, q, p, &t, u, w, units, b, 0);
        else if (CLOSED || LINEAR || FROZEN) residual_of(y, q, p, &t, u, w, b);
        else {
            reused = i == 1 && 2 * *bend * *bend * before * before * before <= LAST_CORRECTION * LAST_CORRECTION;
            if (SLOPES_AT_NODES) equations_at_nodes(y, q, p, &t, u, w, units, b, reused ? 0 : jacobian);
            else residual_and_slope(y, q, p, &t, u, w, b, jacobian);
            if (!reused) factors_of(jacobian, matrix, pivots);
        }
        if (!CLOSED) substitute(Y, BELOW, REACH, matrix, pivots, b);
        for (int k = 0; k < Y; k++) {
            const double size = fabs(b[k]) * inverse[k];
            worst = k < JUDGED && size > worst ? size : worst;
            y[PERM[k]] -= b[k];
        }
        const double left = reused ? 2 * worst * fmin(before, worst / before) : 0;
        if (i == 1) *bend = fmax(worst / (before * before), FADING * *bend);
        if (worst <= LAST_CORRECTION && left <= LAST_CORRECTION * LAST_CORRECTION) return 1; /* a correction that is not a number
                                                                                                ends it too, and shows in the residual */
        before = worst;
    }
    return 0;
}

/* x: velocities and multipliers (or multipliers alone) that make the momentum p fit the hidden constraint; how weak its matrix
   is: the reciprocal of the smallest pivot of G M^-1 G', or of the determinant of M and G together (of which zero or no number
   may be left where there are hundreds of pivots: then it is not known). */
LARGE double project(const double *q, const double *p, double t, const double *w, double *matrix, double *x) {
    double jacobian[HIDDEN_NONZEROS + 1], b[H + HIDDEN_REACH + 1], size[H + 1];
    int pivots[H + 1];
    ZEROS(b, H + HIDDEN_REACH);
    hidden_of(q, p, &t, w, b, jacobian, size);
    ZEROS(matrix, HIDDEN_SIZE);
    for (int i = 0; i < HIDDEN_NONZEROS; i++) matrix[HIDDEN_PLACES[i]] = jacobian[i];
    factorise(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots);
    substitute(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots, b);
    for (int k = 0; k < H; k++) x[HIDDEN_PERM[k]] = b[k] * size[k];
    double most = 0, all = 1;
    for (int k = 0; k < H; k++) {
        const double inverse = fabs(matrix[k * (HIDDEN_BELOW + HIDDEN_REACH + 1) + HIDDEN_BELOW]);
        most = inverse > most || inverse != inverse ? inverse : most, all *= inverse;
    }
    return KICKED ? most : all;
}

/* Start values of `rows` × `columns` unknowns of a step, from `offset` on: continued from `known` steps by the table. */
INLINE void extend(const double *table, int known, int rows, int columns, int offset, double *const *y, double *next) {
    table += columns * columns * (known * (known - 1) / 2);
    for (int j = 0; j < columns; j++) {
        double *const to = next + offset + j * rows;
        for (int i = 0; i < rows; i++) to[i] = 0;
        for (int s = 0; s < known; s++)
            for (int k = 0; k < columns; k++) {
                const double factor = table[(j * known + s) * columns + k], *const from = y[s] + offset + k * rows;
                for (int i = 0; i < rows; i++) to[i] = v_fma(factor, from[i], to[i]);
            }
    }
}

/* The same by the accelerations of `known` steps, whose velocities at the start stand behind their unknowns, as that of this
   step behind its; where inertia is constant. */
INLINE void extend_forces(int known, double *const *y, double *next) {
    const double *table = AHEAD_FORCES;
    for (int s = 1; s < known; s++) table += DEGREE * (s * (DEGREE + 1) + 1);
    for (int j = 0; j < DEGREE; j++) {
        double to[N];
        for (int i = 0; i < N; i++) to[i] = 0;
        for (int s = 0; s < known; s++)
            for (int k = 0; k <= DEGREE; k++, table++)
                for (int i = 0; i < N; i++) to[i] = v_fma(*table, y[s][k * N + i], to[i]);
        for (int i = 0; i < N; i++) next[j * N + i] = v_fma(*table, next[Y + i], to[i]);
        table++;
    }
}

/* Velocities, multipliers and those of non-holonomic rows continued; without a step behind, the velocity at the start. */
INLINE void guess(int known, double *const *y, const double *speed, double *next) {
    if (FORCED && known == HISTORY) extend_forces(HISTORY, y, next);
    else if (FORCED && known) extend_forces(known, y, next);
    else if (known) {
        extend(AHEAD_VELOCITIES, known, PATH, DEGREE, 0, y, next);
        extend(AHEAD_MULTIPLIERS, known, MULTIPLIERS, DEGREE, PATH * DEGREE, y, next);
        extend(AHEAD_ROWS, known, ROWS, 1, (PATH + MULTIPLIERS) * DEGREE, y, next);
    } else {
        for (int i = 0; i < Y; i++) next[i] = i < PATH * DEGREE ? POINTS[i / N] * speed[i % N] : 0;
    }
}

/* The step from time t to `end`, or that part of it: its status. Where that is not DONE, q and p stay where they were. */
INLINE int step(Run *r, const State s, double t, double end) {
    const double *const u = r->u, *const w = r->w, h = r->h;
    double *const q = s.q, *const p = s.p;
    double here[N], push[N], z[ROW]; /* q, p and the unknowns of this step in places of their own, which registers may be */
    const double *p_start = push;
    COPY(here, q, N), COPY(push, p, N);
    double increment[N], gain[N], remains[Y], kicked[N], force[N], after[N];
    if (KICKED) {
        if (NU) kick_of(q, &t, u, w, force);
        else COPY(force, s.force, N);
        for (int d = 0; d < N; d++) kicked[d] = v_fma(0.5 * h, force[d], p[d]);
        p_start = kicked;
    }
    if (FORCED) speed_of(here, push, &t, w, z + Y);
    if (MAP) {
        mapped(r->matrix, q, p, t, u, w, increment, gain);
        r->count = r->solved = 1;
        if ((int64_t)*s.age % WINDOW == 0) {
            checked(r->matrix, r->pivots, q, p, t, u, w, remains);
            r->left = largest_of(remains);
        }
    } else {
        guess((int)*s.known, r->y + 1, s.speed, z);
        const int converged = solve(z, here, p_start, u, t, w, r->units, r->inverse, r->most, r->matrix, r->pivots, s.bend, &r->count);
        if (AT_NODES) finish_at_nodes(z, here, p_start, &t, u, w, r->units, increment, gain, remains);
        else finished(z, here, p_start, &t, u, w, increment, gain, remains);
        const double left = r->left = largest_of(remains);
        r->solved = converged && left <= RESIDUAL_LIMIT;
        if (!r->solved) return left == left && left < INFINITY ? NOT_CONVERGED : NOT_FINITE;
    }
    double q1[N], p1[N], rest_q[N], rest_p[N], zero = 0;
    for (int d = 0; d < N; d++) q1[d] = q[d], rest_q[d] = s.rest_q[d], compensated(&q1[d], &rest_q[d], increment[d]);
    if (KICKED) {
        kick_of(q1, &end, u + (NODES - 1) * NU, w, after);
        for (int d = 0; d < N; d++) gain[d] = v_fma(0.5 * h, force[d] + after[d], gain[d]);
    }
    if (HELD) {
        double reached[N], x[H + 1], pull[N];
        for (int d = 0; d < N; d++) reached[d] = p[d] + gain[d];
        r->weakness = project(q1, reached, end, w, r->matrix, x);
        *s.strongest = r->weakness < *s.strongest ? r->weakness : *s.strongest;
        pulled_of(x, q1, reached, &end, w, pull);
        for (int d = 0; d < N; d++) gain[d] += pull[d];
    }
    for (int d = 0; d < N; d++) {
        p1[d] = p[d], rest_p[d] = s.rest_p[d], compensated(&p1[d], &rest_p[d], gain[d]);
        zero += q1[d] * 0.0 + p1[d] * 0.0; /* not zero as soon as one of them is not finite */
    }
    if (!(zero == 0)) return NOT_FINITE;
    for (int d = 0; d < N; d++) {
        const double v = fabs(increment[d] * r->per_h), m = fabs(p1[d]);
        s.seen[d] = v > s.seen[d] ? v : s.seen[d], s.seen[N + d] = m > s.seen[N + d] ? m : s.seen[N + d];
        q[d] = q1[d], p[d] = p1[d], s.rest_q[d] = rest_q[d], s.rest_p[d] = rest_p[d];
        if (INVERTED) r->speeds[d] = increment[d] * r->per_h;
    }
    if (KICKED) COPY(s.force, after, N);
    if (!MAP) {
        double **const y = r->y, *const oldest = y[HISTORY];
        for (int i = HISTORY; i > 1; i--) y[i] = y[i - 1];
        y[1] = oldest, COPY(oldest, z, ROW);
        *s.known += *s.known < HISTORY;
        if (!FROZEN && r->count > EASY && *s.known > 1) *s.known = 1;
    }
    return DONE;
}
