/* Newton's method on the equations of a step, from extrapolated start values, with compensated updates of q and p.

   Defined before this file: N, NU, NODES, Y (unknowns), C (parameters), SIZES, HISTORY (steps that start values use), the
   tables of start values, PERM and the scene's functions. CLOSED: `equations` gives the correction; else the residual and the
   nonzeros of the Jacobian, which go to the places `AT` of a band matrix (BELOW, REACH: see below). LINEAR: the
   equations are linear, the matrix is factorised once and `equations` is their residual alone; FROZEN: a matrix near the
   Jacobian, `frozen`, is factorised once a step, and once more where many corrections follow; MAP: the equations are few, and a step is a constant affine map of q and p,
   see map.h. KICKED: half kicks stand
   before and behind the equations. HELD: the momentum is projected onto a hidden constraint of H unknowns, which gives the
   velocities too where HIDDEN_SPEED is set. INVERTED: the momentum is not linear in the velocities, see legendre.h. FORCED: inertia is
   constant, and steps are continued by their accelerations. PARTS: a step is composed of so many, of sizes SHARES h, which begin at
   BEGUN h. */

#define WINDOW 1024 /* steps between two looks at the typical sizes */
#define RENEWED 8   /* corrections by one frozen matrix: from a start that was far off, the next one is nearer */
#define FADING 0.9  /* of how much a correction leaves, a step: the most of some steps counts */
#define EASY 4      /* iterations of a step after which the next begins with what several steps continue, which leads far where steps are long */
#define RESIZED 16  /* steps between two looks at the sizes that change with the place */

/* Numbers of a node, of a note, and of what is carried along: the largest pivot and the last nodes; see folds.h. */
#define NODE_SIZE (2 + 2 * N + VELOCITY_ROWS)
#define NOTE_SIZE (1 + LATELY * NODE_SIZE)
#define FOLDS_SIZE (WATCHED ? 1 + LATELY * NODE_SIZE : 0)

/* What a run needs to go on as if it had not stopped, in this order; at a fresh start the caller fills scale and speed. */
typedef struct {
    double *started, *scale, *speed, *sizes, *h, *known, *age, *q, *p, *rest_q, *rest_p, *force, *seen, *y, *bend, *strongest, *folds;
} State; /* 1, 2 N, N, SIZES + 1, 1, 1, 1, N, N, N, N, N, 2 N, HISTORY rows of ROW numbers, 1, 1, FOLDS_SIZE */
#define ROW (Y + FORCED * N) /* the unknowns of a step, and the velocity where it begins */
#define CARRY_SIZE ((int64_t)(7 + 10 * N + SIZES + HISTORY * ROW + FOLDS_SIZE))
#ifdef SCENE_AS_DATA
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }
#else
const int64_t carry_size = CARRY_SIZE;
#endif
INLINE State state_in(double *at) {
    State s;
    s.started = at, s.scale = s.started + 1, s.speed = s.scale + 2 * N, s.sizes = s.speed + N, s.h = s.sizes + SIZES + 1;
    s.known = s.h + 1, s.age = s.known + 1, s.q = s.age + 1, s.p = s.q + N, s.rest_q = s.p + N, s.rest_p = s.rest_q + N;
    s.force = s.rest_p + N, s.seen = s.force + N, s.y = s.seen + 2 * N;
    s.bend = s.y + HISTORY * ROW, s.strongest = s.bend + 1, s.folds = s.strongest + 1;
    return s;
}
#define COPY(to, from, count) memcpy(to, from, (size_t)(count) * sizeof(double))
#define ZEROS(of, count) memset(of, 0, (size_t)(count) * sizeof(double))

#ifndef SCENE_AS_DATA /* what this scene does not need, is not there: it is not called either */
#define NOT_NEEDED(...) ((void)0)
#if !KICKED
#define kick NOT_NEEDED
#define kick_prepare NOT_NEEDED
#endif
#if !HELD
#define sized NOT_NEEDED
#define hidden NOT_NEEDED
#define pulled NOT_NEEDED
#define sized_prepare NOT_NEEDED
#define hidden_prepare NOT_NEEDED
#define pulled_prepare NOT_NEEDED
#endif
#if !WATCHED
#define independence NOT_NEEDED
#define independence_prepare NOT_NEEDED
#define lengths NOT_NEEDED
#define lengths_prepare NOT_NEEDED
#endif
#if !FROZEN
#define frozen NOT_NEEDED
#define frozen_prepare NOT_NEEDED
#endif
#if !LINEAR
#define slope NOT_NEEDED
#define slope_prepare NOT_NEEDED
#endif
#if MAP
#define equations NOT_NEEDED
#define equations_prepare NOT_NEEDED
#define units NOT_NEEDED
#define units_prepare NOT_NEEDED
#else
#define affine NOT_NEEDED
#define affine_prepare NOT_NEEDED
#define driven NOT_NEEDED
#define driven_prepare NOT_NEEDED
#endif
#define finished finish
#if INVERTED
#define speed_of NOT_NEEDED
#define speed_prepare NOT_NEEDED
#else
#define speed_of speed
#define legendre NOT_NEEDED
#define legendre_prepare NOT_NEEDED
#endif
#if CLOSED || LINEAR || FROZEN
#define residual_of equations
#define residual_and_slope NOT_NEEDED
#else
#define residual_of NOT_NEEDED
#define residual_and_slope equations
#endif
#endif

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
#define AFFINE_AT (SLOPE_AT + SLOPE_W)
#define DRIVEN_AT (AFFINE_AT + AFFINE_W)
#define LEGENDRE_AT (DRIVEN_AT + DRIVEN_W)
#define INDEPENDENCE_AT (LEGENDRE_AT + LEGENDRE_W)
#define LENGTHS_AT (INDEPENDENCE_AT + INDEPENDENCE_W)
#define FROZEN_AT (LENGTHS_AT + LENGTHS_W)
#define ALL_W (FROZEN_AT + FROZEN_W + 1)

#include "band.h"
#include "map.h"
#include "legendre.h"

/* The factors of a matrix in the order of PERM from its nonzeros. */
LARGE void factors_of(const double *jacobian, double *matrix, int *pivots) {
    ZEROS(matrix, BAND_SIZE);
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
                  const double *inverse, int most, double *matrix, int *pivots, double *bend, int64_t *count) {
    double jacobian[NONZEROS + 1];
    if (FROZEN) {
        frozen(y, q, &t, w + FROZEN_AT, jacobian);
        factors_of(jacobian, matrix, pivots);
    }
    double before = INFINITY;
    int reused = 0;
    for (int i = 0; i < most; i++) {
        double b[Y + REACH], worst = 0;
        if (FROZEN && i && i % RENEWED == 0) {
            frozen(y, q, &t, w + FROZEN_AT, jacobian);
            factors_of(jacobian, matrix, pivots);
        }
        ZEROS(b, Y + REACH);
        *count += 1;
        if (CLOSED || LINEAR || FROZEN) residual_of(y, q, p, &t, u, w + EQUATIONS_AT, b);
        else {
            residual_and_slope(y, q, p, &t, u, w + EQUATIONS_AT, b, jacobian);
            reused = i == 1 && 2 * *bend * *bend * before * before * before <= LAST_CORRECTION * LAST_CORRECTION;
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

/* x: velocities and multipliers (or multipliers alone) that make the momentum p fit the hidden constraint. How weak its matrix
   is: the reciprocal of the smallest pivot of G M^-1 G', or of the determinant of M and G together (of which zero or no number
   may be left where there are hundreds of pivots: then it is not known). */
LARGE double project(const double *q, const double *p, double t, const double *w, double *matrix, double *x) {
    double jacobian[HIDDEN_NONZEROS + 1], b[H + HIDDEN_REACH + 1];
    int pivots[H + 1];
    ZEROS(b, H + HIDDEN_REACH);
    hidden(q, p, &t, w + HIDDEN_AT, b, jacobian);
    ZEROS(matrix, HIDDEN_SIZE);
    for (int i = 0; i < HIDDEN_NONZEROS; i++) matrix[HIDDEN_PLACES[i]] = jacobian[i];
    factorise(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots);
    substitute(H, HIDDEN_BELOW, HIDDEN_REACH, matrix, pivots, b);
    for (int k = 0; k < H; k++) x[HIDDEN_PERM[k]] = b[k];
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

/* Where the momentum is not linear in v, row has a guess of v. */
LARGE void save(double *row, const double *q, const double *p, double t, const double *w, double *matrix) {
    memcpy(row, q, N * sizeof(double)), memcpy(row + N, p, N * sizeof(double));
    if (HELD && HIDDEN_SPEED) {
        double x[H + 1];
        project(q, p, t, w, matrix, x);
        speed_of(x, q, &t, w + SPEED_AT, row + 2 * N);
    } else if (INVERTED) inverted(q, p, &t, w + LEGENDRE_AT, row + 2 * N);
    else speed_of(q, p, &t, w + SPEED_AT, row + 2 * N);
}

LARGE void save_afresh(double *row, const double *q, const double *p, double t, const double *w, double *matrix) {
    if (INVERTED) ZEROS(row + 2 * N, N);
    save(row, q, p, t, w, matrix);
}

#include "folds.h"

/* What depends on parameters, step and sizes alone. */
LARGE void prepare(const double *k, double *w, double *inverse, double *matrix, int *pivots) {
    finish_prepare(k, w + FINISH_AT);
    if (FROZEN) frozen_prepare(k, w + FROZEN_AT);
    if (INVERTED) legendre_prepare(k, w + LEGENDRE_AT);
    else speed_prepare(k, w + SPEED_AT);
    if (!MAP) {
        equations_prepare(k, w + EQUATIONS_AT), units_prepare(k, w + UNITS_AT);
        double size[Y];
        units(w + UNITS_AT, size);
        for (int i = 0; i < Y; i++) inverse[i] = 1 / size[PERM[i]];
    } else affine_prepare(k, w + AFFINE_AT), driven_prepare(k, w + DRIVEN_AT);
    if (KICKED) kick_prepare(k, w + KICK_AT);
    if (HELD) {
        sized_prepare(k, w + SIZED_AT), hidden_prepare(k, w + HIDDEN_AT);
        pulled_prepare(k, w + PULLED_AT);
    }
    if (WATCHED) independence_prepare(k, w + INDEPENDENCE_AT), lengths_prepare(k, w + LENGTHS_AT);
    if (LINEAR) {
        double jacobian[NONZEROS + 1];
        slope_prepare(k, w + SLOPE_AT);
        slope(w + SLOPE_AT, jacobian);
        factors_of(jacobian, matrix, pivots);
        if (MAP) prepare_map(w, matrix, pivots);
    }
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
    const double least = fmax(SMALLEST * most, UNKNOWN); /* of what has come to rest: sizes that vanish divide zero by zero */
    for (int d = 0; d < N; d++) {
        scale[d] = fmax(scale[d], least / root[d]);
        scale[N + d] = fmax(scale[N + d], least * root[d]);
    }
}

int run(const RunArguments *a) {
#ifdef SCENE_AS_DATA
    scene = a->scene;
#endif
    const int64_t steps = a->steps, first = a->first;
    const int most = a->most < MOST_ITERATIONS ? (int)a->most : MOST_ITERATIONS;
    const double t0 = a->t0, whole = a->h; /* h: of a part, and of the whole step where that is one */
    double h = whole * SHARES[0], per_h = 1 / h;
    double before[PARTS > 1 ? 4 * N : 1]; /* the step of several parts */
    int part = 0;
    const double *u = a->u;
    double *rows = a->rows, *rests = a->rests, k[C + 1 + 2 * N + SIZES], w[ALL_W], inverse[Y], *matrix = 0;
    double *const scale = k + C + 1, *const sizes = scale + 2 * N;
    int pivots[Y];
    const State state = state_in(a->carry);
    double *const q = state.q, *const p = state.p, *const seen = state.seen;
    int64_t iterations = 0, largest_count = 0, done = 0, unsaved = 0;
    int status = DONE;
    double left = 0, worst = 0;
    if (MATRIX_SIZE) {
        matrix = malloc(MATRIX_SIZE * sizeof(double));
        if (!matrix) return NOT_FINITE;
    }
    const int goes_on = *state.started == 1 && *state.h == whole;
    COPY(k, a->c, C), k[C] = h;
    if (!goes_on) {
        COPY(q, a->start, N), COPY(p, a->start + N, N);
        if (rests) COPY(state.rest_q, rests, N), COPY(state.rest_p, rests + N, N);
        else ZEROS(state.rest_q, N), ZEROS(state.rest_p, N);
        ZEROS(seen, 2 * N);
        ZEROS(state.force, N), ZEROS(state.y, HISTORY * ROW), state.sizes[SIZES] = 0;
        *state.strongest = INFINITY, *state.bend = 1;
        *state.known = *state.age = 0;
    }
    COPY(scale, state.scale, 2 * N), COPY(sizes, state.sizes, SIZES);
    prepare(k, w, inverse, matrix, pivots);
    if (KICKED && !goes_on) {
        const double t = t0 + whole * (double)first;
        kick(q, &t, u, w + KICK_AT, state.force);
    }
    double *y[HISTORY + 1], unknowns[HISTORY][ROW]; /* y[s] are those of s steps ago */
    for (int s = 0; s < HISTORY; s++) y[s + 1] = unknowns[s];
    for (int s = 0; s < HISTORY; s++) COPY(y[s + 1], state.y + s * ROW, ROW);
    save_afresh(rows, q, p, t0 + whole * (double)first, w, matrix), rows += 3 * N;
    const int watched = WATCHED && a->notes;
    const Folds folds = {state.folds, state.folds + 1};
    int64_t noted = 0;
    if (watched && !goes_on) {
        *folds.farthest = 0;
        for (int i = 0; i < LATELY; i++) folds.lately[i * NODE_SIZE] = -1;
        watch(&folds, q, p, first, t0, whole, 0, w);
    }

    while (done < steps) {
        if (PARTS > 1) {
            h = whole * SHARES[part], per_h = 1 / h, k[C] = h;
            prepare(k, w, inverse, matrix, pivots);
            if (!part) COPY(before, q, N), COPY(before + N, p, N), COPY(before + 2 * N, state.rest_q, N), COPY(before + 3 * N, state.rest_p, N);
        }
        const double t = t0 + whole * ((double)(first + done) + BEGUN[part]);
        const double end = t0 + whole * ((double)(first + done) + BEGUN[part + 1]);
        double here[N], push[N], z[ROW]; /* q, p and the unknowns of this step in places of their own, which registers may be */
        const double *p_start = push;
        COPY(here, q, N), COPY(push, p, N);
        double increment[N], gain[N], remains[Y], kicked[N], force[N], after[N], weakness = 0;
        if (HELD && (int64_t)*state.age % RESIZED == 0) {
            sized(q, &t, w + SIZED_AT, sizes);
            prepare(k, w, inverse, matrix, pivots);
        }
        if (KICKED) {
            if (NU) kick(q, &t, u, w + KICK_AT, force);
            else COPY(force, state.force, N);
            for (int d = 0; d < N; d++) kicked[d] = v_fma(0.5 * h, force[d], p[d]);
            p_start = kicked;
        }
        int64_t count = 0;
        if (FORCED) speed_of(here, push, &t, w + SPEED_AT, z + Y);
        if (MAP) {
            mapped(matrix, q, p, t, u, w, increment, gain);
            count = 1;
            if ((int64_t)*state.age % WINDOW == 0) {
                checked(matrix, pivots, q, p, t, u, w, remains);
                left = largest_of(remains);
            }
        } else for (;;) { /* once more from the last step alone where the continued start is too far, then from the velocity */
            const int known = (int)*state.known;
            guess(known, y + 1, state.speed, z);
            const int converged = solve(z, here, p_start, u, t, w, inverse, most, matrix, pivots, state.bend, &count);
            finished(z, here, p_start, &t, u, w + FINISH_AT, increment, gain, remains);
            left = largest_of(remains);
            status = converged && left <= RESIDUAL_LIMIT ? DONE : left == left && left < INFINITY ? NOT_CONVERGED : NOT_FINITE;
            if (!status || !known) break;
            *state.known = known > 1;
            if (known == 1) {
                double row[3 * N];
                save_afresh(row, q, p, t, w, matrix), COPY(state.speed, row + 2 * N, N);
            }
        }
        iterations += count;
        largest_count = count > largest_count ? count : largest_count;
        if (status) break;
        worst = left > worst ? left : worst;
        double q1[N], p1[N], rest_q[N], rest_p[N], zero = 0;
        for (int d = 0; d < N; d++) q1[d] = q[d], rest_q[d] = state.rest_q[d], compensated(&q1[d], &rest_q[d], increment[d]);
        if (KICKED) {
            kick(q1, &end, u + (NODES - 1) * NU, w + KICK_AT, after);
            for (int d = 0; d < N; d++) gain[d] = v_fma(0.5 * h, force[d] + after[d], gain[d]);
        }
        if (HELD) {
            double reached[N], x[H + 1], pull[N];
            for (int d = 0; d < N; d++) reached[d] = p[d] + gain[d];
            weakness = project(q1, reached, end, w, matrix, x);
            *state.strongest = weakness < *state.strongest ? weakness : *state.strongest;
            pulled(x, q1, reached, &end, w + PULLED_AT, pull);
            for (int d = 0; d < N; d++) gain[d] += pull[d];
        }
        for (int d = 0; d < N; d++) {
            p1[d] = p[d], rest_p[d] = state.rest_p[d], compensated(&p1[d], &rest_p[d], gain[d]);
            zero += q1[d] * 0.0 + p1[d] * 0.0; /* not zero as soon as one of them is not finite */
        }
        if (!(zero == 0)) { status = NOT_FINITE; break; }
        for (int d = 0; d < N; d++) {
            const double v = fabs(increment[d] * per_h), m = fabs(p1[d]);
            seen[d] = v > seen[d] ? v : seen[d], seen[N + d] = m > seen[N + d] ? m : seen[N + d];
            q[d] = q1[d], p[d] = p1[d], state.rest_q[d] = rest_q[d], state.rest_p[d] = rest_p[d];
        }
        if (INVERTED && unsaved + 1 == a->save_every)
            for (int d = 0; d < N; d++) rows[2 * N + d] = increment[d] * per_h;
        if (KICKED) COPY(state.force, after, N);
        if (!MAP) {
            double *const oldest = y[HISTORY];
            for (int s = HISTORY; s > 1; s--) y[s] = y[s - 1];
            y[1] = oldest, COPY(oldest, z, ROW);
            *state.known += *state.known < HISTORY;
            if (!FROZEN && count > EASY && *state.known > 1) *state.known = 1;
        }
        *state.age += 1;
        if ((int64_t)*state.age % WINDOW == 0) rescale(scale, seen), prepare(k, w, inverse, matrix, pivots);
        if (++part < PARTS) continue;
        part = 0;
        u += NODES * NU;
        if (++unsaved == a->save_every) {
            unsaved = 0, save(rows, q, p, end, w, matrix), rows += 3 * N;
            if (rests) rests += 2 * N, COPY(rests, state.rest_q, N), COPY(rests + N, state.rest_p, N);
        }
        if (watched) {
            const int64_t at = first + done + 1;
            const int regular = weakness < (KICKED ? VERY_NEARLY : NEARLY) * *state.strongest;
            const int kind = watch(&folds, q, p, at, t0, whole, regular, w);
            if (kind >= 0) note(&folds, kind, at, a->notes + noted++ * NOTE_SIZE);
            if (kind == ON_FOLD || noted == MOST_NOTED) {
                done++;
                break;
            }
        }
        done++;
    }
    if (PARTS > 1 && part) COPY(q, before, N), COPY(p, before + N, N), COPY(state.rest_q, before + 2 * N, N), COPY(state.rest_p, before + 3 * N, N);
    save_afresh(a->stats->last, q, p, t0 + whole * (double)(first + done), w, matrix);
    *state.started = !status, *state.h = whole;
    COPY(state.scale, scale, 2 * N), COPY(state.sizes, sizes, SIZES);
    for (int s = 0; s < HISTORY; s++) COPY(state.y + s * ROW, y[s + 1], ROW);
    free(matrix);
    a->stats->noted = (double)noted;
    a->stats->status = status, a->stats->steps = (double)done, a->stats->iterations = (double)iterations;
    a->stats->most_iterations = (double)largest_count, a->stats->residual = worst, a->stats->failed = status ? left : 0, a->stats->contraction = 0;
    return status;
}
