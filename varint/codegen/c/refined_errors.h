/* What errs besides what the difference of two runs shows: round-off, narrow places, sharp bends. refined.h stands before this file. */
/* What round-off grows to, the start's included, with which all runs begin alike: by runs whose starts have other last digits,
   and times. */
static double by_round_off(const Refined *a, const Attempt *run, double wanted, double estimate, const double *scales) {
    const Limits *const l = a->limits;
    double start[2 * a->n], most = 0;
    Refined late = *a;
    double zeros[ends_early(&a->search) ? a->search.room * ZERO_SIZE(a->n) : 1];
    late.search.zeros = zeros;
    Attempt other = {0};
    for (int64_t way = 0; way < (int64_t)l->ways; way++) {
        set_other_digits(a->n, a->start, way, start), late.duration = nextafter(a->duration, way ? -INFINITY : INFINITY);
        if (!try_from(&late, start, a->opening + 2 * a->n, a->t0, wanted, run->steps, 0, run->steps, 1, &other) || other.lost) most = INFINITY;
        if (most < INFINITY && ends_early(&a->search) && !search(&late, &other)) most = INFINITY;
        if (!(most < INFINITY)) break;
        const double apart = l->parted * seen_apart(a, run, 1, &other, 1, scales);
        most = !(apart <= most) ? apart : most;
        if (most < l->far_below * estimate || (a->tol < most && most <= estimate)) break;
    }
    free(other.rows);
    return most == most ? most : INFINITY;
}

/* Error of the finer one of two runs that are so far apart. */
static double left_of(const Refined *a, double apart, double ratio, double order) {
    const double sure = order * (order / (double)a->order), least = a->limits->least_order,
                 counted = pow(ratio, -(ratio >= a->limits->far ? a->limits->caution : a->limits->less) * (sure > least ? sure : least));
    return apart * counted / (1 - counted);
}

/* The largest difference of two nodes by the scales of coordinates and momenta. */
static double parted_by(int64_t n, const double *one, const double *other, const double *scales) {
    double largest = 0;
    for (int64_t d = 0; d < 2 * n; d++) {
        const double off = fabs(one[d] - other[d]) / scales[d];
        largest = off > largest ? off : largest;
    }
    return largest;
}

/* Scales of coordinates, which are known, and of momenta: the largest ones of a run. */
static void set_both_scales(const Refined *a, const Attempt *run, const double *of_coordinates, double *scales) {
    const int64_t n = a->n;
    for (int64_t d = 0; d < n; d++) {
        scales[d] = of_coordinates[d], scales[n + d] = 0;
        for (int64_t k = 0; k <= run->ended.last; k++) {
            const double p = fabs(run->rows[3 * n * k + n + d]);
            scales[n + d] = p > scales[n + d] ? p : scales[n + d];
        }
        if (!(scales[n + d] > 0)) scales[n + d] = INFINITY;
    }
}

/* Error of a run whose steps err at once where the scene is narrow: by what they make there when done in parts, over what the
   coarser run is off by at that place; 0 where errors grow bit by bit, infinite where the parts fail.
   varint/integration/narrow_places.py says why. */
static double made_at_once(const Refined *a, const Attempt *before, const Attempt *now, double wanted, double off,
                           const double *of_coordinates) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, unit = common_divisor(before->steps, now->steps), few = 3 * n * (before->steps / unit),
                  each = now->steps / unit, many = 3 * n * each, parts = (int64_t)l->narrow_parts,
                  all = shared_parts(before, now);
    double scales[2 * n], largest = 0, last = 0, here = 0, made = 0;
    set_both_scales(a, now, of_coordinates, scales);
    for (int64_t k = 1; k <= all; k++) {
        const double apart = parted_by(n, before->rows + few * k, now->rows + many * k, scales);
        largest = apart > largest ? apart : largest;
    }
    int64_t k = 0;
    if (!all) return 0;
    do last = here, k++, here = parted_by(n, before->rows + few * k, now->rows + many * k, scales);
    while (k < all && here < l->part_of_it * largest);
    if (!(here > l->at_once * last)) return 0;
    const int64_t end = k < all ? k + 1 : k, over = end - k + 1; /* it may end in the next part */
    Attempt fine = {0};
    const double t0 = time_of_node(a, now->steps, each * (k - 1));
    const double *const node = now->rows + many * (k - 1);
    if (!try_from(a, node, node + 2 * n, t0, wanted, parts * now->steps, parts * each * (k - 1), parts * each * over, 1, &fine) || fine.lost)
        made = INFINITY;
    else
        made = l->uncertain * off * parted_by(n, fine.rows + parts * many * over, now->rows + many * end, scales) / here;
    free(fine.rows);
    return made;
}

/* What steps err by in which forces bend sharply with velocities, by what they make when done in parts, or more than what is
   wanted; infinite where the parts fail. varint/integration/bent_steps.py says why. */
static double made_by_bends(const Refined *a, const Attempt *run, double wanted, const double *of_coordinates) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, steps = run->ended.whole, parts = (int64_t)l->narrow_parts;
    const Bends of = {a->rows, a->push, a->c, a->bends, a->bends + a->bend_looks, n, a->bend_looks, 2};
    double few[SHORT], *const sharp = memory_for(steps + ROOM_OF_BENDS(n, of.looks, of.numbers), few, few), scales[2 * n], made = 0;
    set_both_scales(a, run, of_coordinates, scales);
    if (!sharp) made = INFINITY;
    for (int64_t k = 0, end; k < steps && made < INFINITY; k = end) {
        const Stretch here = stretch_of(a->grades, a->t0, a->duration, run->steps, k);
        end = here.end < steps ? here.end : steps;
        if (!set_sharpness(&of, run->rows + 3 * n * k, end - k, here.t, here.h, scales + n, sharp + k, sharp + steps)) made = INFINITY;
    }
    Attempt fine = {0};
    for (int64_t k = 0, end; k < steps && made <= wanted; k = end) {
        for (end = k; end < steps && !(sharp[end] * (double)steps <= l->bent * wanted);) end++;
        if (end++ == k) continue;
        const double *const node = run->rows + 3 * n * k;
        double most = 0;
        const double begins = time_of_node(a, run->steps, k);
        if (!try_from(a, node, node + 2 * n, begins, wanted, parts * run->steps, parts * k, parts * (end - 1 - k), 1, &fine) || fine.lost)
            most = INFINITY;
        for (int64_t i = 0; i < end - k && most < INFINITY; i++) {
            const double off = parted_by(n, fine.rows + 3 * n * parts * i, node + 3 * n * i, scales);
            most = off > most ? off : most;
        }
        made += l->sure * most;
    }
    free(fine.rows), give_up(sharp, few);
    return made;
}

/* The largest coordinate over its scale, one at least. */
static double extent_of(const Refined *a, const Attempt *run, const double *scales) {
    const int64_t n = a->n;
    double size = 1;
    for (int64_t d = 0; d < n; d++) {
        double most = 0;
        for (int64_t k = 0; k <= run->ended.last; k++) {
            const double x = fabs(run->rows[3 * n * k + d]);
            most = x > most ? x : most;
        }
        size = most / scales[d] > size ? most / scales[d] : size;
    }
    return size;
}
