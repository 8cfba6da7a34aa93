/* What the stages of runs tell of their errors. varint/integration/shown_by_stages.py says why; its numbers are `limits`. refined.h
   stands before this file. */
static double largest_of(const double *x, int64_t count) {
    double largest = 0, zero = 0;
    for (int64_t k = 0; k < count; k++) zero += x[k] * 0, largest = x[k] > largest ? x[k] : largest;
    return zero == 0 ? largest : INFINITY;
}

/* How large the highest coefficients of each step are beside the largest sizes of their rows, where these are largest, in the place
   of what has been seen of the rows. Those of round-off alone tell nothing. */
static void set_seen(const Refined *a, Attempt *run) {
    const int64_t rows = a->unknowns, n = a->n, steps = run->ended.whole;
    double largest[rows];
    for (int64_t i = 0; i < rows; i++) {
        largest[i] = 0;
        for (int64_t k = 0; k < steps; k++) {
            const double size = run->seen[2 * rows * k + rows + i];
            largest[i] = size > largest[i] ? size : largest[i];
        }
    }
    for (int64_t kind = 0; kind < rows; kind += n) {
        const double most = largest_of(largest + kind, n);
        for (int64_t i = kind; i < kind + n; i++) largest[i] = largest[i] > a->limits->round_off * most ? 1 / largest[i] : 0;
    }
    for (int64_t k = 0; k < steps; k++) {
        double high[rows];
        for (int64_t i = 0; i < rows; i++) high[i] = run->seen[2 * rows * k + i] * largest[i];
        run->seen[k] = largest_of(high, rows);
    }
}

/* What the steps of a run are likely to make; and how much more this seems to grow than the error of a regular motion, because most
   of it is made late: growth_of. */
static double made_by_stages(const Refined *a, const Attempt *run, double *uneven) {
    const Limits *const l = a->limits;
    const int64_t steps = run->ended.whole, middle = (steps + 1) / 2, first = (steps + 1) / EARLIEST > 1 ? (steps + 1) / EARLIEST : 1;
    double made = 0, least = INFINITY;
    for (int64_t k = 1; k <= steps; k++) {
        made += l->made * (run->seen[k - 1] * run->seen[k - 1]);
        if (first <= k && k <= middle) {
            const double expected = expected_in_the_middle(made, l->rounded, k, middle);
            least = expected < least ? expected : least;
        }
    }
    const double grown = made / (l->secular_growth * (least > l->rounded ? least : l->rounded));
    *uneven = grown < 1 ? 1 : grown < l->foreseen ? grown : l->foreseen;
    return made;
}

/* Error of the finer one of two runs that are `off`; infinite where their stages tell nothing. */
static double left_by_stages(const Refined *a, const Attempt *before, const Attempt *now, int64_t unit, double off) {
    const Limits *const l = a->limits;
    if (!before->seen || !now->seen || unit < (int64_t)l->shared) return INFINITY;
    const int64_t few = before->steps / unit, many = now->steps / unit, parts = shared_parts(before, now);
    const double most = largest_of(before->seen, few * parts), ratio = (double)now->steps / (double)before->steps, faint = l->faint * most;
    double fallen = 0, uneven;
    for (int64_t k = 0; k < parts; k++) {
        const int64_t from = k ? k - 1 : 0, to = k + 2 < parts ? k + 2 : parts; /* what a step does not show by chance its neighbours do */
        const double one = largest_of(before->seen + few * from, few * (to - from)), other = largest_of(now->seen + many * k, many);
        if (one > faint || !(other <= faint)) fallen = other / one > fallen ? other / one : fallen;
    }
    const double unresolved = most / l->told, shown = l->alike * (1 + unresolved * unresolved) * (fallen * fallen),
                 least = pow(ratio, -l->counted * (double)a->order), left = shown > least ? shown : least;
    if (!(left < 0.5)) return INFINITY;
    const double by_difference = off * left / (1 - left), by_itself = made_by_stages(a, now, &uneven);
    return by_difference > by_itself ? by_difference : by_itself;
}

/* Error of a run at least: orders that runs show which do not resolve the motion may be luck. */
static double least_by_stages(const Refined *a, const Attempt *before, const Attempt *now) {
    double uneven;
    if (!before->seen || !now->seen) return 0;
    const double unresolved = largest_of(before->seen, before->ended.whole) / a->limits->told, more = 1 + unresolved * unresolved,
                 most = a->limits->most_unresolved;
    return a->limits->least_made * (more < most ? more : most) * made_by_stages(a, now, &uneven);
}

/* Whether stages show that nothing is made in the first steps of the finer one of two runs, before the first node that both have;
   those of the coarser one where the finer one's have not been looked at, and so many times less where they resolve the motion. */
static int begins_clearly(const Refined *a, const Attempt *before, const Attempt *now, int64_t few) {
    const Limits *const l = a->limits;
    const double ratio = now->seen ? 1 : (double)before->steps / (double)now->steps, *const seen = now->seen ? now->seen : before->seen;
    if (!seen) return 0;
    const int64_t some = (int64_t)ceil((double)few * ratio);
    const double most = largest_of(seen, some), fallen = most <= l->told ? pow(ratio, l->counted * (double)a->order) : 1;
    return l->begins * l->made * (double)some * (most * most) * fallen <= a->tol;
}

/* How many times as many steps err by so much less that this is proved. */
static double needed_for(const Refined *a, double error, double wanted) {
    return pow(a->limits->aim * error / wanted, 1 / (a->limits->counted * (double)a->order));
}

/* How many times as many steps a run has that proves an error, where runs of these err by so much. */
static double ratio_to(const Refined *a, int64_t steps, double error, double wanted) {
    const Limits *const l = a->limits;
    const double needed = needed_for(a, error, wanted), some[] = {l->near, l->far, (l->far + l->longer) / 2, l->longer};
    for (int i = 0; i < 4; i++) {
        const double more = some[i] * (double)steps;
        if (!(needed <= some[i] || i == 3) || more != rint(more)) continue;
        const int shows = i == 0 || common_divisor(steps, (int64_t)more) >= (int64_t)l->shared;
        if (shows && is_divided(a->grades, steps, some[i])) return some[i];
    }
    return l->far;
}

/* How many times as many steps the run behind a first one has, and how much its iterations are to leave less; whether stages are to
   tell its error, which two runs alone may not show. */
static int plan_by_stages(const Refined *a, const Attempt *first, double *ratio, double *uneven) {
    const Limits *const l = a->limits;
    const double made = made_by_stages(a, first, uneven);
    if (largest_of(first->seen, first->ended.whole) > l->unresolved) /* the run behind the second one may prove it */
        *ratio = needed_for(a, made, a->tol) > l->near * l->near ? l->far : l->near;
    else *ratio = ratio_to(a, first->steps, made, a->tol);
    const int tells = *ratio > l->near || made > l->clearly * a->tol;
    *uneven = tells ? l->extra * *uneven : 1;
    return tells;
}
