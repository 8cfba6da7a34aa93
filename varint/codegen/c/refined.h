/* Runs with more and more steps: what is asked of them, one of them, and how far two are apart (refined_core.c). */
/* PROVED by all but a closer look at the energy, or at forces that act for less than a step: DOUBTED. GRADED: proved, by steps
   of more than one size, whose times stand in the place of the first velocity; the run is not in the room. */
enum Proof { GRADED_DOUBTED = -2, GRADED, PROVED, NOT_PROVED, NOT_SHORT, DOUBTED };

typedef struct {
    double caution, less, least_order, tells, shared, stalled, patience, floor, no_digits, near, far, runs,
        transient_steps, transient_parts, rounding, secular, level, poor, given, missed, bends, nothing, left,
        at_once, part_of_it, narrow_parts, uncertain, coarser, closely, rounded, secular_growth, grows, chance, uneven, passed, ways, parted, far_below,
        close, bent, sure, quiet, smooth, fewest, turned,
        low, clear, worth, least_runs, base, aimed, passable, halved, parts, farther,
        counted, alike, told, faint, made, aim, longer, foreseen, clearly, extra, unresolved, least_made, most_unresolved, begins, round_off, late,
        losses, made_first, roughly, sharp, faintly, repeated;
} Limits;

typedef struct {
    int (*run)(const RunArguments *);
    const void *scene;
    int (*rows)(const RowsArguments *);
    const void *balance;       /* (q, p, t), or (q, v, t), to the energy and the power of forces and explicit time */
    const void *push, *bounds, *bounds_of_many; /* those of varint/integration/force_bounds.py; 0: closer looks are taken elsewhere */
    const Limits *limits;
    const int64_t *body, *turns; /* first coordinate of the same body; is it an angle? */
    const double *looks;         /* parts of a step at which forces are looked at, a few of them first */
    const double *bends;         /* parts of a step at which forces are looked at that bend with velocities, and what makes their two highest
                                    coefficients of the values there; 0: none do */
    const void *pivots;          /* (q, t) to the least pivot of constraint rows; 0: they never come to depend on one another */
    int64_t n, carry, order, timed, looked, few, groups, sampled, pilot, longest; /* whether forces depend on time; steps of a first piece, and of a run that is short */
    int64_t bend_looks;      /* so many */
    const double *heights;   /* those of grades.h; 0: stages are not looked at */
    int64_t unknowns, stages, padded, grows; /* whether steps may grow; 2: beyond what stiff dampers stop at once, 3: there alone; less: they are not halved either */
    Grades *grades;          /* 0: this is filled in here */
    int64_t fitted;          /* steps at most of runs whose steps are shorter where forces bend; 0: all are equal there, too */
    int64_t by_velocity;     /* velocities are made by the runs, for they have no formula */
    int64_t held, folds;     /* constraint rows hold the motion; numbers of a node of a note of a fold, 0: none is made */
    Table table;             /* of controls */
    BEHIND_THE_COURSE
} Refined;

typedef struct {
    double *rows, *own, *u, *seen; /* u: controls at the stages of its steps; seen: what these show, 0: that is not looked at */
    double iterations, residual;
    int64_t steps; /* of the whole duration */
    Ended ended;   /* of those that were made */
    int lost, looks;
} Attempt;

/* Where iterations may stop, so that what they leave adds up to less than what is wanted. */
static double level_for(const Refined *a, double wanted, int64_t steps) {
    const double often = a->limits->secular / ((double)steps * (double)steps);
    return (wanted < a->limits->closely ? wanted : a->limits->closely) * (a->limits->level < often ? a->limits->level : often);
}

/* Steps at most of runs that are fitted to where forces bend: as many in every gear. */
static int64_t farthest(const Refined *a) { return (int64_t)a->limits->farther * a->fitted; }

/* Room for so many steps of a run, and what it carries on; 0 where there is none. */
static double *make_room(const Refined *a, int64_t count, Attempt *to) {
    const int64_t n = a->n, told = 3 * n + sizeof(RunStats) / sizeof(double);
    const int fitted = a->fitted && a->grades->count && a->grades->at != a->grades->own;
    if (count > (fitted ? farthest(a) : a->longest)) return 0;
    const int64_t noted = room_of_notes(a->folds), used = room_of_controls(&a->table, to->steps, count),
                  fixed = 3 * n * (count + 1) + a->carry + told + noted + used;
    to->rows = memory_for(fixed + (to->looks ? 2 * a->unknowns * count : 0), to->rows, to->own);
    if (!to->rows) return 0;
    to->seen = to->looks ? to->rows + fixed : 0;
    double *const carry = to->rows + 3 * n * (count + 1);
    to->u = carry + a->carry + told + noted;
    carry[0] = 0;
    if (a->opens && !a->open(a->duration / to->steps)) return 0;
    memcpy(carry + 1, a->opening, a->opens * sizeof(double));
    to->lost = 0, to->iterations = to->residual = 0;
    return carry;
}

/* Steps of the same size from node k on, which lies `first` of them behind t0, until another one, and what they tell; whether they
   were made. */
static int go_on(const Refined *a, const double *start, double t0, int64_t first, double h, double level, double most, int64_t k, int64_t end,
                 double *carry, RunStats *stats, double *notes, Attempt *to) {
    const int status = a->run(&(RunArguments){
        .steps = end - k, .save_every = 1, .first = first, .most = (int64_t)most, .t0 = t0, .h = h, .level = level, .start = start, .c = a->c,
        .u = to->u + a->table.stages * a->table.controls * k, .rows = to->rows + 3 * a->n * k, .carry = carry, .stats = stats, .scene = a->scene, .notes = a->folds ? notes : 0,
        .heights = a->heights, .seen = to->seen ? to->seen + 2 * a->unknowns * k : 0,
        .without_velocities = !a->by_velocity && !a->search.sought && !a->bends});
    to->iterations += stats->iterations;
    if (stats->residual > to->residual) to->residual = stats->residual;
    to->lost = status != DONE || (!k && a->pilot && to->iterations > most * end);
    return !to->lost;
}

/* Iterations of a step at most where they end at this level, or so many times coarser: these are over so much sooner, or hardly
   contract. */
static double most_for(const Refined *a, double level, double coarser) {
    return coarser > 1 ? floor(a->limits->poor * log(level * coarser) / log(level)) : a->limits->poor;
}

/* How many times as long as the first steps those of the motion that lasts would be: first ones are for what dampers stop at once. */
static double usual_steps(const Refined *a) {
    const double lasting = a->radians / 2 > a->limits->fewest ? a->radians / 2 : a->limits->fewest;
    return a->grows > 1 && (double)a->first > 2 * lasting ? (double)a->first / lasting : 1;
}

/* The next steps are of another size: plain ones would be as many more as these may grow. */
static void change_size(const Refined *a, double *carried) {
    Carry *const carry = (Carry *)carried;
    carry->steps_known = ANOTHER_SIZE, carry->expected *= usual_steps(a);
}

/* From a start, held ones with its velocity, which is node `from` of a run of so many steps, the next `count` of them, by so many
   times coarser iterations; false where there was no memory, they are too many, or a held motion may pass over a fold. */
static int try_from(const Refined *a, const double *start, const double *speed, double t0, double wanted, int64_t steps, int64_t from,
                    int64_t count, double coarser, Attempt *to) {
    const int64_t n = a->n;
    const double level = level_for(a, wanted, count), most = most_for(a, level, coarser), h = a->duration / steps;
    to->steps = steps, to->ended = ended_after(count, t0, h);
    double *const carry = make_room(a, count, to), begin[2 * n];
    if (!carry) return 0;
    set_controls(&a->table, steps, from, count, to->u);
    RunStats *const stats = (RunStats *)(carry + a->carry);
    double *const notes = carry + a->carry + 3 * n + sizeof(RunStats) / sizeof(double);
    if (a->held) memcpy(carry + 1 + 2 * n, speed, n * sizeof(double));
    memcpy(begin, start, 2 * n * sizeof(double));
    for (int64_t k = 0, end; k < count && !to->lost; k = end) {
        const Stretch here = stretch_of(a->grades, a->t0, a->duration, steps, from + k);
        const int64_t last = here.end - from < count ? here.end - from : count;
        end = !k && a->pilot && a->pilot < last ? a->pilot : last;
        const int graded = a->grades->count > 0;
        if (k && from + k == here.first) { /* slopes are for longer steps: what is fitted to bends begins anew */
            carry[0] = 0, memcpy(begin, to->rows + 3 * n * k, 2 * n * sizeof(double));
            if (a->grades->at == a->grades->own) change_size(a, carry);
        }
        go_on(a, begin, graded ? here.t : t0, graded ? from + k - here.first : k, here.h, level * coarser, most, k, end, carry, stats, notes, to);
    }
    if (a->held) {
        const FoldNotes folds = {a->rows, a->pivots, a->c, carry + a->carry - LATELY * a->folds, a->folds, count, t0, h};
        if (a->folds && !to->lost && !is_unfolded(&folds, stats)) return 0;
        memcpy(to->rows + 2 * n, speed, n * sizeof(double)); /* a run in pieces has no other velocity there */
    }
    if (!to->lost) to->lost = unsound(to->rows + 3 * n * count, n) != 0;
    return 1;
}

/* A coarse run from the start whose steps grow where the motion settles, no longer than that: `grades` are those it has found, none
   where all are equal. */
static int try_growing_to(const Refined *a, double wanted, int64_t steps, double coarser, double longest, Attempt *to) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, room = a->grows > 1 && steps > a->longest ? a->longest : steps;
    const double usual = usual_steps(a), level = level_for(a, wanted, (int64_t)((double)steps / usual)),
                 most = most_for(a, level, coarser), end = a->t0 + a->duration;
    Grades *const g = a->grades;
    to->steps = steps;
    double *const carry = make_room(a, room, to), begin[2 * n], largest[a->unknowns], farthest[n];
    if (!carry) return 0;
    const Looked looked = {a->heights, n, a->unknowns, a->stages, a->padded, l->quiet, l->smooth * a->tol, a->duration / (double)steps,
                           usual, largest, farthest};
    RunStats *const stats = (RunStats *)(carry + a->carry);
    begin_grades(g, steps, a->t0, a->duration);
    memcpy(begin, a->start, 2 * n * sizeof(double)), memset(largest, 0, sizeof largest), memset(farthest, 0, sizeof farthest);
    for (int64_t k = 0, next, quiet = 0; k < g->all; k = next) {
        const Begin *const last = g->at + g->count - 1;
        const double h = last->h;
        next = next_look(g, k);
        if (next > room) return 0;
        if (!go_on(a, begin, last->t, k - last->first, h, quiet ? level : level * coarser, most, k, next, carry, stats, 0, to)) break;
        if (next == g->all) continue;
        const Seen now = look_at(&looked, carry, h, to->rows + 3 * n * k, next - k);
        to->lost = g->count > 1 && !now.shown;
        if (to->lost) break;
        if (now.smooth && grow(g, longest, end, next)) change_size(a, carry), memcpy(begin, to->rows + 3 * n * next, 2 * n * sizeof(double));
        quiet = now.quiet;
    }
    to->steps = g->all, to->ended = ended_after(g->all, a->t0, a->duration / g->all);
    if (!to->lost) to->lost = unsound(to->rows + 3 * n * g->all, n) != 0;
    return 1;
}

/* The same, and where long steps of what lasts do not show the motion, with shorter ones. */
static int try_growing(const Refined *a, double wanted, int64_t steps, double coarser, Attempt *to) {
    Grades *const g = a->grades;
    double longest = a->limits->turned / a->radians * fabs(a->duration);
    for (;;) {
        if (!try_growing_to(a, wanted, steps, coarser, longest, to)) return 0;
        const double last = fabs(g->at[g->count - 1].h);
        if (!to->lost || g->count < 3 || !(usual_steps(a) > 1)) break;
        longest = last / 2;
    }
    if (g->count == 1) g->count = 0;
    return 1;
}

/* Looks for what is sought along a run. */
static int search(const Refined *a, Attempt *run) {
    const Crossings of = crossings_of(a->search.sought, a->rows, a->c, a->n, a->search.most);
    return search_run(&a->search, of, run->rows, a->t0, a->duration / run->steps, &run->ended);
}

static int try_run(const Refined *a, double wanted, int64_t steps, int64_t count, double coarser, Attempt *to) {
    return try_from(a, a->start, a->opening + 2 * a->n, a->t0, wanted, steps, 0, count, coarser, to);
}

/* Parts between the nodes that two runs of the whole duration share. */
static int64_t shared_parts(const Attempt *one, const Attempt *other) {
    const int64_t unit = common_divisor(one->steps, other->steps), mine = one->ended.whole / (one->steps / unit),
                  its = other->ended.whole / (other->steps / unit);
    return mine < its ? mine : its;
}

/* When a node of a run of so many steps is. */
static double time_of_node(const Refined *a, int64_t steps, int64_t k) {
    const Stretch here = stretch_of(a->grades, a->t0, a->duration, steps, k);
    return here.h * (double)(k - here.first) + here.t;
}

/* A run of the whole duration, or until what is sought, which another one has found at this time. */
static int try_whole(const Refined *a, double wanted, int64_t steps, double ends, double coarser, Attempt *to) {
    int64_t count = steps;
    if (!ends_early(&a->search)) return try_run(a, wanted, steps, steps, coarser, to);
    if (steps > a->search.longest) return 0;
    count = steps_until(ends, a->t0, a->duration / steps, steps);
    if (!try_run(a, wanted, steps, count, coarser, to)) return 0;
    if (!to->lost) to->lost = !search(a, to);
    return to->lost || count == steps || is_cut(&to->ended) || try_whole(a, wanted, steps, INFINITY, coarser, to);
}

/* Times of the nodes of a run from the start. */
static void set_node_times(const Refined *a, const Attempt *run, double *t) {
    if (!a->grades->count) {
        set_times(t, &run->ended, a->t0, a->duration / run->steps);
        return;
    }
    Stretch here = stretch_of(a->grades, a->t0, a->duration, run->steps, 0);
    for (int64_t k = 0; k <= run->ended.last; k++) {
        if (k >= here.end) here = stretch_of(a->grades, a->t0, a->duration, run->steps, k);
        t[k] = k < run->steps ? here.t + here.h * (double)(k - here.first) : a->t0 + a->duration;
    }
}

/* The largest difference of every so many nodes of two runs by the scales; no number where one of them is none. */
static double apart_from(const Refined *a, const Attempt *one, int64_t few, const Attempt *other, int64_t many,
                         const double *scales) {
    const int64_t n = a->n;
    double largest = 0, zero = 0;
    for (int64_t d = 0; d < n; d++) {
        double most = 0;
        for (int64_t k = 0; few * k <= one->ended.whole && many * k <= other->ended.whole; k++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]);
            zero += off * 0, most = off > most ? off : most;
        }
        most /= scales[d], zero += most * 0, largest = most > largest ? most : largest;
    }
    return zero == 0 ? largest : zero;
}

/* The same with their ends, if they may end early. */
static double seen_apart(const Refined *a, const Attempt *one, int64_t few, const Attempt *other, int64_t many, const double *scales) {
    const double apart = apart_from(a, one, few, other, many, scales);
    const double ends = ends_early(&a->search) ? ends_apart(a->n, one->rows, &one->ended, other->rows, &other->ended, scales) : 0;
    return apart == apart && ends > apart ? ends : apart;
}

/* How errors of two runs of the whole duration are spread, the `other` one the finer: the least that an early difference lets
   expect in the middle, and how many times larger they are between the nodes that both share. */
typedef struct { double early, beyond; } Spread;
static Spread spread_of(const Refined *a, const Attempt *one, const Attempt *other, int64_t unit, const double *scales) {
    const int64_t n = a->n, few = one->steps / unit, many = other->steps / unit, parts = shared_parts(one, other), last = other->ended.last,
                  middle = (parts + 1) / 2, first = (parts + 1) / EARLIEST > 1 ? (parts + 1) / EARLIEST : 1;
    const int graded = a->grades->count > 0, timed = ends_early(&a->search) || graded, by_time = graded && a->grades->at == a->grades->own;
    double most[n], times[timed ? last + 1 : 1], largest = 0, least = INFINITY;
    if (timed) set_node_times(a, other, times);
    memset(most, 0, n * sizeof(double));
    for (int64_t k = 0; k <= parts; k++) {
        for (int64_t d = 0; d < n; d++) {
            const double off = fabs(one->rows[3 * n * few * k + d] - other->rows[3 * n * many * k + d]) / scales[d];
            largest = off > largest ? off : largest, most[d] = off > most[d] ? off : most[d];
        }
        /* most steps of a motion that settles are in its beginning, and err by nothing */
        const int64_t at = by_time ? (int64_t)((times[many * k] - a->t0) / a->duration * (double)parts) : k;
        if (first <= at && at <= middle) {
            const double expected = expected_in_the_middle(largest, a->limits->rounded, at, middle);
            least = expected < least ? expected : least;
        }
    }
    const Shared shared = {n, 3 * n, last + 1, many, parts + 1, other->rows, timed ? times : 0};
    return (Spread){least < INFINITY ? least : largest, last < 2 ? 1 : beyond_shared(&shared, most)};
}

/* What passages make of last digits where they magnify them by so much, whole where that is below what is wanted. */
static double passed_by(const Refined *a, double passed, double apart, double beyond) {
    const double seen = a->limits->chance * apart;
    return beyond * (beyond * passed <= a->tol || passed < seen ? passed : seen);
}

/* What iterations leave where errors grow by as much: no more than two runs show, which leave about as much each. */
static double iterated_by(const Refined *a, double each, double apart, double growth, double beyond) {
    const double seen = a->limits->chance * apart, most = a->limits->uneven, uneven = growth < most ? growth : most,
                 grown = each * growth * uneven, made = beyond * (grown < seen ? grown : seen);
    return each > made ? each : made;
}
