/* A first run whose steps are halved, in pairs, where they are not solved, show the motion badly or have forces bend in them, and doubled
   again behind that. varint/integration/halved_steps.py says why; its numbers are `limits`. fitted.h stands before this file. */
#define DEEPEST 12 /* times that a step is halved at most */

typedef struct {
    const Refined *a;
    Bends of;
    double *largest, *scales, *room; /* sizes of unknowns and of momenta so far; room for looks at forces, 0: they are not looked at */
    double high, sharp;              /* what highest coefficients and impulses of bends may be */
} Halving;

/* How large the highest coefficients of a step h are beside the largest sizes of their rows so far, its own among them; these are kept
   where it is one of the run. */
static double high_in_step(const Halving *x, const double *seen, double h, int keeps) {
    const int64_t rows = x->a->unknowns, n = x->a->n;
    const double unit = fabs(rows == n ? h * h : h);
    double high = 0;
    for (int64_t kind = 0; kind < rows; kind += n) {
        double all[n], most = 0;
        for (int64_t i = 0; i < n; i++) {
            const double own = seen[rows + kind + i] / unit, before = x->largest[kind + i];
            all[i] = own > before ? own : before, most = all[i] > most ? all[i] : most;
            if (keeps) x->largest[kind + i] = all[i];
        }
        for (int64_t i = 0; i < n; i++) {
            const double part = seen[kind + i] / unit / all[i];
            if (all[i] > x->a->limits->round_off * most && !(part <= high)) high = part;
        }
    }
    return high;
}

/* Largest impulse of bends in so many parts of each of a pair of steps h from t on whose rows begin here, by the largest momenta so far,
   the pair's among them. */
static double sharp_in_pair(const Halving *x, const double *here, double t, double h, int64_t parts) {
    const int64_t n = x->a->n;
    double sharp[2], most = 0;
    for (int64_t d = 0; d < n; d++)
        for (int i = 0; i < 3; i++) {
            const double p = fabs(here[3 * n * i + n + d]);
            x->scales[d] = p > x->scales[d] ? p : x->scales[d];
        }
    for (int64_t i = 0; i < parts; i++) {
        if (!set_some(&x->of, here, 2, i, parts, t, h, x->scales, sharp, x->room)) return INFINITY;
        for (int k = 0; k < 2; k++) most = sharp[k] <= most ? most : sharp[k];
    }
    return most;
}

/* Whether steps are to be shorter where forces bend, after a run of equal ones: third order would ask for many, and forces bend in
   halves of its steps as well, where smooth ones do not. */
static int bends_sharply(const Refined *a, const Attempt *run) {
    const int64_t n = a->n;
    if (!a->bends) return 0;
    double few[SHORT], scales[n];
    int sharply = 1;
    Halving x = {.a = a, .of = closer_looks(a), .scales = scales};
    x.room = memory_for(ROOM_OF_BENDS(n, x.of.looks, x.of.numbers), few, few);
    if (!x.room) return 0;
    memset(scales, 0, sizeof scales);
    const double h = a->duration / (double)run->steps;
    for (int64_t parts = 1; parts <= 2 && sharply; parts++) {
        double most = 0;
        for (int64_t k = 0; k + 2 <= run->steps; k += 2) {
            const double sharp = sharp_in_pair(&x, run->rows + 3 * n * k, a->t0 + h * (double)k, h, parts);
            most = sharp <= most ? most : sharp;
        }
        sharply = !((double)(parts * run->steps) * cbrt(a->limits->sharp * most / a->tol) <= a->limits->worth);
    }
    give_up(x.room, few);
    return sharply;
}

/* How many of so many solved steps h from t on, in pairs, are good; the highest coefficients and the largest impulse in these. */
static int64_t good_steps(const Halving *x, const double *rows, const double *seen, double t, double h, int64_t solved, double *high, double *sharp) {
    const int64_t n = x->a->n, unknowns = x->a->unknowns;
    *high = *sharp = 0;
    for (int64_t k = 0; k + 2 <= solved; k += 2) {
        for (int64_t i = k; i < k + 2; i++) {
            const double now = high_in_step(x, seen + 2 * unknowns * i, h, 0);
            if (!(now <= x->high)) return k;
            *high = now > *high ? now : *high;
        }
        if (x->room) {
            const double now = sharp_in_pair(x, rows + 3 * n * k, t + h * (double)k, h, 1);
            if (!(now <= x->sharp)) return k;
            *sharp = now > *sharp ? now : *sharp;
        }
        for (int64_t i = k; i < k + 2; i++) high_in_step(x, seen + 2 * unknowns * i, h, 1);
    }
    return solved / 2 * 2;
}

/* A run from so many steps on, whose sizes are a->grades then, none where all are equal; 0 where there is no memory. */
static int try_halving(const Refined *a, double wanted, int64_t steps, double coarser, Attempt *to) {
    const Limits *const l = a->limits;
    const int64_t n = a->n, some = 16 * steps + 64, allowed = some < a->longest ? some : a->longest, ticks = steps << DEEPEST;
    const double level = level_for(a, wanted, steps), most = most_for(a, level, coarser), whole = a->duration / (double)steps,
                 seen = sqrt(l->made_first * a->tol / (l->made * (double)steps)), twice = ldexp(2, (int)a->stages - 1);
    double begin[2 * n], largest[a->unknowns], scales[n];
    Halving x = {.a = a, .largest = largest, .scales = scales, .high = seen < l->roughly ? seen : l->roughly, .sharp = l->aimed * a->tol};
    Grades *const g = a->grades;
    to->steps = steps, to->looks = 1;
    double *const carry = make_room(a, allowed, to);
    if (!carry || !begin_pairs(g, a->duration)) return 0;
    if (a->bends) x.of = closer_looks(a), x.room = malloc(ROOM_OF_BENDS(n, x.of.looks, x.of.numbers) * sizeof(double));
    RunStats *const stats = (RunStats *)(carry + a->carry);
    memcpy(begin, a->start, 2 * n * sizeof(double)), memset(largest, 0, sizeof largest), memset(scales, 0, sizeof scales);
    for (int64_t at = 0, k = 0, first = 0, began = 0, deep = 0; at < ticks;) { /* at node k; a stretch began at its `first` one */
        const int64_t unit = (int64_t)1 << (DEEPEST - deep), left = (ticks - at) / unit, piece = deep ? 2 : PIECE, count = left < piece ? left : piece;
        const double h = ldexp(whole, -(int)deep), t = a->t0 + whole * ldexp((double)at, -DEEPEST), spent = to->iterations;
        to->lost = k + count > allowed;
        if (to->lost) break;
        to->iterations = 0;
        go_on(a, begin, a->t0 + whole * ldexp((double)began, -DEEPEST), k - first, h, level * coarser, most, k, k + count, carry, stats, 0, to);
        to->iterations += spent;
        const int64_t solved = to->lost ? stats->status == DONE ? 0 : (int64_t)stats->steps : count; /* hardly contracting ones are not */
        double high, sharp;
        const int64_t good = good_steps(&x, to->rows + 3 * n * k, to->seen + 2 * a->unknowns * k, t, h, solved, &high, &sharp);
        int there = 1;
        for (int64_t i = 0; i < good && there; i += 2) there = add_pair(g, allowed, t + h * (double)i, h);
        k += good, at += good * unit;
        to->lost = !there || (good < count && deep == DEEPEST);
        if (to->lost) break;
        if (good < count) deep++;
        else if (deep && at % (4 * unit) == 0 && high * twice <= x.high && sharp * l->faintly <= x.sharp) deep--;
        else continue;
        memcpy(begin, k ? to->rows + 3 * n * k : a->start, 2 * n * sizeof(double)), carry[0] = 0, first = k, began = at;
    }
    free(x.room);
    if (!to->lost) to->steps = g->all, to->lost = unsound(to->rows + 3 * n * g->all, n) != 0;
    to->ended = ended_after(to->steps, a->t0, a->duration / (double)to->steps);
    if (g->count == 1 || to->lost) free(g->at), *g = (Grades){0};
    return 1;
}
