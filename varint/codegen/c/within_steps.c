/* Where a motion is within its steps, at many times in each: one step of this rule, which has more stages than the motion's own,
   from the node before. The rates at its stages, which are Gauss points, are a sum of Legendre polynomials; integrals of these in
   powers are in the tables (varint/codegen/within_steps.py). The step ends where the exact motion from that node does; on the
   way to where the motion's own rule ends, which errs by a power of the step, states are led by that power. */
#define PATIENCE 3 /* steps that have no good polynomials, and one more for so many times: beyond, no more are tried */
#define FOR_TIMES 16
#define NOISE 0x1p-47 /* of polynomials, relative to the way of the step: round-off, a few times over */
#define SHORTEST 0x1p-10 /* way that errors are measured by, beside the longest of its kind */
#define SHARE 0.25 /* of what the motion's own rule has erred by in a step so far, which polynomials may err by */
#define ALIKE 0x1p-20 /* sizes of steps that differ by the rounding of times */
#define CLOCK_ITERATIONS 12
#define LOCATED 0x1p-50 /* of a time that a clock shows, and of a step: neither is known better */
#define MOST_LED 1e-6 /* relative: rules that err by more are left to shorter steps */

/* y = sum_j m_j x_j, by the columns of m */
INLINE void combined(const double *m, const double *x, V *y) {
    for (int k = 0; k < VECTORS; k++) y[k] = splat(0.0);
    for (int j = 0; j < STAGES; j++)
        for (int k = 0; k < VECTORS; k++) y[k] = v_fma(entry(m, j * VECTORS + k), splat(x[j]), y[k]);
}

/* A polynomial by Horner's rule. */
INLINE V value_of(const V *polynomial, V y) {
    const double *const at = (const double *)polynomial;
    V sum = splat(at[STAGES - 1]);
    for (int k = STAGES - 2; k >= 0; k--) sum = v_fma(sum, y, splat(at[k]));
    return sum;
}

/* x p(2 x - 1), and its slope by x. */
INLINE V value_and_slope(const V *polynomial, V x, V *slope) {
    const double *const at = (const double *)polynomial;
    const V y = v_fma(splat(2.0), x, splat(-1.0));
    V sum = splat(at[STAGES - 1]), rate = splat(0.0);
    for (int k = STAGES - 2; k >= 0; k--) rate = v_fma(rate, y, sum), sum = v_fma(sum, y, splat(at[k]));
    *slope = v_fma(2.0 * x, rate, sum);
    return x * sum;
}

/* x^k */
INLINE V power_of(V x, int64_t k) {
    V found = splat(1.0);
    for (; k; k >>= 1, x *= x)
        if (k & 1) found *= x;
    return found;
}

/* What has been found of a step: its state at the start, integrals of the rates over the part x of it, divided by x (by x^2 the
   second ones of form 2), in powers of 2 x - 1, and what is missing at the end; the most that was missing so far, relative. */
typedef struct {
    double most_led;
    double start[2 * MOST_N], missing[2 * MOST_N];
    V first[MOST_ROWS][VECTORS], second[MOST_N][VECTORS];
} Within;

/* Nothing is known any more of the steps before. */
INLINE void forget(Run *r) { r->known = r->expected = r->now.count = r->next.count = 0, r->change.rate = 1; }

/* What polynomials of these coefficients leave out, as they fall off. */
INLINE double left_out(const double *a) {
    const double last = fmax(fabs(a[STAGES - 1]), fabs(a[STAGES - 2])), before = fmax(fabs(a[STAGES - 3]), fabs(a[STAGES - 4]));
    return (last < before ? last * (last / before) : last) / (4 * STAGES);
}

/* The lengths of the ways of a step by which errors are measured, those of coordinates and of momenta: none of them far below
   the longest, for that may be round-off. */
INLINE void set_ways(const Run *r, const double *start, double *ways) {
    V rows_of[MOST_ROWS];
    for (int i = 0; i < ROWS; i++) rows_of[i] = size_of(r->last[i]);
    row_sums(rows_of, ROWS, ways);
    for (int kind = 0; kind < ROWS; kind += N) {
        double longest = 1e-300;
        for (int i = kind; i < kind + N; i++) {
            ways[i] = fmax(ways[i], fabs(start[FORM == 2 ? N + i : i])); /* of form 2: at the speed of the start */
            longest = fmax(longest, ways[i]);
        }
        for (int i = kind; i < kind + N; i++) ways[i] = fmax(ways[i], SHORTEST * longest);
    }
}

/* The step that has just been made from `start` towards the next node, q and p; whether its polynomials are as good as that. */
APART int found_within(const Run *r, const double *start, const double *q, const double *p, const double *tables, Within *to) {
    const double *const to_legendre = tables, *const to_first = tables + STAGES * PADDED, *const to_second = to_first + STAGES * PADDED;
    const Step *const s = &r->now;
    double ends[2 * MOST_N], ways[MOST_ROWS], most_left_out = 0, led = 0;
    COPY(to->start, start, 2 * N), COPY(ends, r->y, 2 * N);
#if FORM == 2
    V at[MOST_N], speed[MOST_N], out[MOST_N], time = splat(r->t0 + r->h);
    for (int d = 0; d < N; d++) at[d] = splat(r->y[d]), speed[d] = splat(r->y[N + d] / r->h);
    momentum(at, speed, &time, r->w + RHS_W + VELOCITY_W, out);
    for (int d = 0; d < N; d++) ends[N + d] = lane(out[d], 0);
#endif
    for (int d = 0; d < N; d++) to->missing[d] = q[d] - ends[d], to->missing[N + d] = p[d] - ends[N + d];
    set_ways(r, start, ways);
    for (int i = 0; i < ROWS; i++) {
        V legendre[VECTORS];
        combined(to_legendre, (const double *)r->last[i], legendre);
        const double *const a = (const double *)legendre;
        most_left_out = fmax(most_left_out, left_out(a) / ways[i]);
        led = fmax(led, fabs(to->missing[i]) / fmax(ways[i], fabs(start[i])));
        combined(to_first, a, to->first[i]);
#if FORM == 2
        combined(to_second, a, to->second[i]);
#endif
    }
    (void)s;
    to->most_led = fmax(to->most_led, led);
    return led <= MOST_LED && most_left_out <= fmax(NOISE, SHARE * to->most_led);
}

#if FORM == 1
/* The parts of a step after which its last coordinate is what is wanted, from those that are there on; whether they were found. */
APART int reach_clock(const Within *w, V wanted, int64_t order, V *x) {
    const int clock = N - 1;
    const V start = splat(w->start[clock]), missing = splat(w->missing[clock]), size = v_fmax(v_fabs(wanted), v_fabs(start)) + 1e-300;
    for (int k = 0; k < CLOCK_ITERATIONS; k++) {
        V pace;
        const V passed = value_and_slope(w->first[clock], *x, &pace), led = power_of(*x, order - 1) * missing,
                off = (wanted - start) - v_fma(led, *x, passed), step = off / v_fma(splat((double)order), led, pace);
        const double far = largest(v_fmin(v_fabs(off) / size, v_fabs(step)));
        if (far <= LOCATED) return 1;
        if (!(far <= 1)) return 0;
        *x += step;
    }
    return 0;
}
#endif

/* The states at times of the step, from number `from` on up to `end`. */
APART void set_states(const Run *r, const WithinArguments *a, int64_t from, int64_t end, const Within *w) {
    const Step *const s = &r->now;
    for (int64_t i = from; i < end; i += LANES) {
        V x, t, wanted = splat(0.0), q[MOST_N], p[MOST_N];
        for (int l = 0; l < LANES; l++) {
            const int64_t j = i + l < end ? i + l : end - 1;
            set_lane(&x, l, a->ahead[j] / r->h), set_lane(&t, l, a->begin[j] + a->ahead[j]);
            if (a->wanted) set_lane(&wanted, l, a->wanted[j]);
        }
        if (a->wanted) {
#if FORM == 1 /* that of scenes with a clock */
            if (!reach_clock(w, wanted, a->order, &x)) continue;
            for (int l = 0; l < LANES && i + l < end; l++) a->found_t[a->which[i + l]] = a->begin[i] + r->h * lane(x, l);
#else
            return;
#endif
        }
        const V y = v_fma(splat(2.0), x, splat(-1.0)), led = power_of(x, a->order);
#if FORM == 2
        V speed[MOST_N];
        for (int d = 0; d < N; d++) {
            const V there = v_fma(x, value_of(w->second[d], y), splat(w->start[N + d]));
            q[d] = v_fma(led, splat(w->missing[d]), v_fma(x, there, splat(w->start[d])));
            speed[d] = v_fma(x, value_of(w->first[d], y), splat(w->start[N + d])) / r->h;
        }
        momentum(q, speed, &t, r->w + RHS_W + VELOCITY_W, p);
        for (int d = 0; d < N; d++) p[d] = v_fma(led, splat(w->missing[N + d]), p[d]);
#else
        for (int d = 0; d < N; d++) {
            q[d] = v_fma(led, splat(w->missing[d]), v_fma(x, value_of(w->first[d], y), splat(w->start[d])));
            p[d] = v_fma(led, splat(w->missing[N + d]), v_fma(x, value_of(w->first[N + d], y), splat(w->start[N + d])));
        }
#endif
        for (int l = 0; l < LANES && i + l < end; l++) {
            double *const to_q = a->found_q + N * a->which[i + l], *const to_p = a->found_p + N * a->which[i + l];
            for (int d = 0; d < N; d++) to_q[d] = lane(q[d], l), to_p[d] = lane(p[d], l);
            a->reached[i + l] = 1;
        }
    }
    (void)s;
}

INLINE double size_at(const WithinArguments *a, int64_t node) { return a->sizes ? a->sizes[a->k[node]] : a->h; }

/* Whether the next node is a whole step behind this one. */
INLINE int is_whole(const WithinArguments *a, int64_t node) {
    if (node + 1 >= a->nodes) return 0;
    return !a->t || fabs(a->t[node + 1] - a->t[node] - size_at(a, node)) <= 0x1p-49 * fmax(fabs(a->h), fmax(fabs(a->t[node]), fabs(a->t[node + 1])));
}

int within_steps(const WithinArguments *a) {
    Run r;
    ROOM_FOR(r, a->scene);
    Carry none = {0};
    double start[2 * MOST_N];
    memset(start, 0, sizeof start), COPY(start, a->q, N), COPY(start + N, a->p, N);
    const RunArguments one = {1, 1, 0, a->most, a->t0, a->h, 0, start, a->c, 0, 0, (double *)&none, 0, a->scene};
    restore(&r, &one);
    Within step;
    int64_t before = -2, next;
    int64_t missed = 0;
    step.most_led = 0;
    memset(a->reached, 0, (size_t)a->going * sizeof *a->reached);
    for (int64_t i = 0; i < a->going && missed < PATIENCE + i / FOR_TIMES; i = next) {
        const int64_t node = a->node[i];
        for (next = i + 1; next < a->going && a->node[next] == node;) next++;
        if (next - i < a->fewest || !is_whole(a, node)) continue;
        const double size = size_at(a, node);
        if (node != before + 1 || !(fabs(size - r.h) <= ALIKE * fabs(r.h))) forget(&r);
        if (size != r.h) set_size(&r, size);
        before = node;
        COPY(start, a->q + N * node, N), COPY(start + N, a->p + N * node, N);
        r.t0 = a->begin[i], stand_at(&r, start);
        COPY(start + N, r.y + N, N); /* of form 2: what it moves by at its speed */
        if (!solve(&r, 0) || !accept(&r)) {
            forget(&r), missed++;
            continue;
        }
        if (found_within(&r, start, a->q + N * (node + 1), a->p + N * (node + 1), a->tables, &step)) set_states(&r, a, i, next, &step);
        else missed++;
    }
    free(r.slopes.room);
    FREE_ROOM(r);
    return DONE;
}
