/* Newton's method on the equations of a step, from extrapolated start values, with compensated updates of q and p.

   Defined before this file: N, NU, NODES, GIVEN (nodes at which a step has controls), Y (unknowns), C (parameters), SIZES,
   HISTORY (steps that start values use), the tables of start values, PERM and the scene's functions: as data (newton_scene.h), or
   compiled apart (newton_apart.h), so that this loop is compiled once for all scenes of a size. newton_step.c is a step; where the
   unknowns are few it is compiled with the scene, whose functions take less time there than to be called. CLOSED:
   `equations` gives the correction; else the residual and the nonzeros of the Jacobian, which go to the places `AT` of a
   band matrix (BELOW, REACH: see below). LINEAR: the equations are linear, the matrix is factorised once and `equations` is
   their residual alone; FROZEN: a matrix near the Jacobian, `frozen`, is factorised once a step, and once more where many
   corrections follow; MAP: the equations are few, and a step is a constant affine map of q and p, see map.h. KICKED: half
   kicks stand before and behind the equations. HELD: the momentum is projected onto a hidden constraint of H unknowns, which
   gives the velocities too where HIDDEN_SPEED is set. INVERTED: the momentum is not linear in the velocities, see
   legendre.h. FORCED: inertia is constant, and steps are continued by their accelerations. PARTS: a step is composed of so
   many, of sizes SHARES h, which begin at BEGUN h. */

#include "newton_state.h"
#include "newton_step.c"
#include "legendre.h"
#ifndef NEXT_STEP
#define NEXT_STEP step
#endif

#ifdef SCENE_AS_DATA
int64_t carry_size(const Scene *of) { scene = of; return CARRY_SIZE; }
#else
const int64_t carry_size = CARRY_SIZE;
#endif

/* Where the momentum is not linear in v, row has a guess of v. */
LARGE void save(double *row, const double *q, const double *p, double t, const double *w, double *matrix) {
    memcpy(row, q, N * sizeof(double)), memcpy(row + N, p, N * sizeof(double));
    if (HELD && HIDDEN_SPEED) {
        double x[H + 1];
        project(q, p, t, w, matrix, x);
        speed_of(x, q, &t, w, row + 2 * N);
    } else if (INVERTED) inverted(q, p, &t, w, row + 2 * N);
    else speed_of(q, p, &t, w, row + 2 * N);
}

LARGE void save_afresh(double *row, const double *q, const double *p, double t, const double *w, double *matrix) {
    if (INVERTED) ZEROS(row + 2 * N, N);
    save(row, q, p, t, w, matrix);
}

#include "folds.h"

/* What depends on parameters, step and sizes alone. */
LARGE void prepare(const double *k, double *w, double *units, double *inverse, double *matrix, int *pivots) {
    prepare_functions(k, w);
    if (AT_NODES) units_at_nodes(w, units);
    if (!MAP) {
        double size[Y];
        units_of(w, size);
        for (int i = 0; i < Y; i++) inverse[i] = 1 / size[PERM[i]];
    }
    if (LINEAR) {
        double jacobian[NONZEROS + 1];
        slope_of(w, jacobian);
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

/* Whether the next step begins with a look at the sizes that change with the place. */
INLINE int is_resized(const State *s) { return HELD && (int64_t)*s->age % RESIZED == 0; }

int run(const RunArguments *a) {
#ifdef SCENE_AS_DATA
    scene = a->scene;
#endif
    const int64_t steps = a->steps, first = a->first;
    const double t0 = a->t0, whole = a->h; /* of the whole step, where it has parts */
    double before[PARTS > 1 ? 4 * N : 1];  /* the step of several parts */
    int part = 0, pivots[Y], status = DONE;
    double *rows = a->rows, *rests = a->rests, k[C + 1 + 2 * N + SIZES], w[ALL_W], units[UNITS_SIZE], inverse[Y], speeds[N], *matrix = 0;
    double *const scale = k + C + 1, *const sizes = scale + 2 * N;
#ifdef SCENE_APART
    memcpy(w, &a->scene, sizeof a->scene), memcpy(w + 1, &(Angles){sines_of}, sizeof(Angles));
#endif
    const State state = state_in(a->carry);
    double *const q = state.q, *const p = state.p;
    int64_t iterations = 0, largest_count = 0, done = 0, unsaved = 0;
    double worst = 0;
    if (MATRIX_SIZE) {
        matrix = malloc(MATRIX_SIZE * sizeof(double));
        if (!matrix) return NOT_FINITE;
    }
    double *y[HISTORY + 1], unknowns[HISTORY][ROW];
    Run r = {a->u, a->carry, whole * SHARES[0], 1 / (whole * SHARES[0]), w, units, inverse, matrix, y, speeds};
    r.pivots = pivots, r.most = a->most < MOST_ITERATIONS ? (int)a->most : MOST_ITERATIONS;
    const int goes_on = *state.started == 1 && *state.h == whole;
    COPY(k, a->c, C), k[C] = r.h;
    if (!goes_on) {
        COPY(q, a->start, N), COPY(p, a->start + N, N);
        if (rests) COPY(state.rest_q, rests, N), COPY(state.rest_p, rests + N, N);
        else ZEROS(state.rest_q, N), ZEROS(state.rest_p, N);
        ZEROS(state.seen, 2 * N);
        ZEROS(state.force, N), ZEROS(state.y, HISTORY * ROW), state.sizes[SIZES] = 0;
        *state.strongest = INFINITY, *state.bend = 1;
        *state.known = *state.age = 0;
    }
    COPY(scale, state.scale, 2 * N), COPY(sizes, state.sizes, SIZES);
    if (PARTS > 1 || is_resized(&state)) prepare_functions(k, w); /* all else is prepared anew for the first step */
    else prepare(k, w, units, inverse, matrix, pivots);
    if (KICKED && !goes_on) {
        const double t = t0 + whole * (double)first;
        kick_of(q, &t, a->u, w, state.force);
    }
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
            r.h = k[C] = whole * SHARES[part], r.per_h = 1 / r.h;
            prepare(k, w, units, inverse, matrix, pivots);
            if (!part) COPY(before, q, N), COPY(before + N, p, N), COPY(before + 2 * N, state.rest_q, N), COPY(before + 3 * N, state.rest_p, N);
        }
        const double t = t0 + whole * ((double)(first + done) + BEGUN[part]);
        const double end = t0 + whole * ((double)(first + done) + BEGUN[part + 1]);
        if (is_resized(&state)) {
            sized_of(q, &t, w, sizes);
            prepare(k, w, units, inverse, matrix, pivots);
        }
        for (r.count = 0;;) { /* once more from the last step alone where the continued start is too far, then from the velocity */
            const int known = (int)*state.known;
            status = NEXT_STEP(&r, state, t, end);
            if (!status || r.solved || !known) break;
            *state.known = known > 1;
            if (known == 1) {
                double row[3 * N];
                save_afresh(row, q, p, t, w, matrix), COPY(state.speed, row + 2 * N, N);
            }
        }
        iterations += r.count;
        largest_count = r.count > largest_count ? r.count : largest_count;
        if (r.solved) worst = r.left > worst ? r.left : worst;
        if (status) break;
        if (INVERTED && unsaved + 1 == a->save_every) COPY(rows + 2 * N, speeds, N);
        *state.age += 1;
        if ((int64_t)*state.age % WINDOW == 0) rescale(scale, state.seen), prepare(k, w, units, inverse, matrix, pivots);
        if (++part < PARTS) continue;
        part = 0;
        r.u += GIVEN * NU;
        if (++unsaved == a->save_every) {
            unsaved = 0, save(rows, q, p, end, w, matrix), rows += 3 * N;
            if (rests) rests += 2 * N, COPY(rests, state.rest_q, N), COPY(rests + N, state.rest_p, N);
        }
        if (watched) {
            const int64_t at = first + done + 1;
            const int regular = r.weakness < (KICKED ? VERY_NEARLY : NEARLY) * *state.strongest;
            const int kind = watch(&folds, q, p, at, t0, whole, regular, w);
            if (kind >= 0) note(&folds, kind, at, a->notes + noted++ * NOTE_SIZE);
            if (kind == ON_FOLD || noted == MOST_NOTED) {
                done++;
                break;
            }
        }
        done++;
        if (is_behind(q[N - 1], a->end)) break;
    }
    if (PARTS > 1 && part) COPY(q, before, N), COPY(p, before + N, N), COPY(state.rest_q, before + 2 * N, N), COPY(state.rest_p, before + 3 * N, N);
    if (done && !(status || unsaved || INVERTED)) COPY(a->stats->last, rows - 3 * N, 3 * N); /* it has just been saved */
    else save_afresh(a->stats->last, q, p, t0 + whole * (double)(first + done), w, matrix);
    *state.started = !status, *state.h = whole;
    COPY(state.scale, scale, 2 * N), COPY(state.sizes, sizes, SIZES);
    for (int s = 0; s < HISTORY; s++) COPY(state.y + s * ROW, y[s + 1], ROW);
    free(matrix);
    a->stats->noted = (double)noted;
    a->stats->status = status, a->stats->steps = (double)done, a->stats->iterations = (double)iterations;
    a->stats->most_iterations = (double)largest_count, a->stats->residual = worst, a->stats->failed = status ? r.left : 0, a->stats->contraction = 0;
    return status;
}
