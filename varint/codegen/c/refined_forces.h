/* What nodes do not tell by their differences alone: work that the energy misses, forces that act for less than a step.
   refined.h stands before this file. */
/* Whether the energy is clearly that of the start and the work of forces, which `fine` shows too where motions begin: so many
   parts of the first steps. `t`, `room`: times of both, and three times as many numbers, with as many controls. */
static int balanced(const Refined *a, const Attempt *run, const Attempt *fine, int64_t parts, const double *t, double *room) {
    const int64_t nodes = run->ended.last + 1, more = fine->ended.last + 1;
    const Balance b = {a->rows, a->balance, a->c, a->n, a->by_velocity ? 2 * a->n : a->n, a->table.controls, a->limits->missed};
    double *const energy = room, *const power = energy + nodes + more, *const other = power + nodes + more, *const u = other + nodes + more,
           *const before = a->table.rows ? other : power, largest = 0, given = 0;
    for (int jump = a->table.rows > 0; jump >= 0; jump--) { /* controls do at a node */
        double *const to = jump ? before : power;
        if (a->table.rows) set_at_nodes(&a->table, parts * run->steps, more, jump, u);
        if (!set_energies(&b, fine->rows, more, t + nodes, u, energy + nodes, to + nodes)) return 0;
        if (a->table.rows) set_at_nodes(&a->table, run->steps, nodes, jump, u);
        if (!set_energies(&b, run->rows, nodes, t, u, energy, to)) return 0;
    }
    for (int64_t k = 0; k < nodes; k++) largest = fabs(energy[k]) > largest ? fabs(energy[k]) : largest;
    for (int64_t k = 0; k < nodes; k++) {
        if (k) {
            double early = 0;
            for (int64_t i = parts * (k - 1) + 1; i <= parts * k && i < more; i++) early += work_between(&b, t + nodes, power + nodes, before + nodes, i);
            const double rough = work_between(&b, t, power, before, k);
            given += early > rough ? early : rough;
        }
        if (!(fabs(energy[k] - energy[0]) <= given + a->limits->given * largest)) return 0;
    }
    return 1;
}

/* Largest forces in so many of the steps, on the straight line between their nodes, at more of the places of the rule:
   `largest`. */
static int look_at_forces(const Refined *a, const Attempt *run, const double *t, int64_t steps, int64_t first, int64_t last,
                          double *largest, double *room) {
    const int64_t n = a->n;
    double *const q = room, *const v = q + n * steps, *const at = v + n * steps, *const force = at + steps, *const mass = force + n * steps;
    for (int64_t i = first; i < last; i++) {
        for (int64_t k = 0; k < steps; k++) {
            const int64_t step = k * run->ended.last / steps;
            const double *const here = run->rows + 3 * n * step, h = t[step + 1] - t[step];
            at[k] = t[step] + a->looks[i] * h;
            for (int64_t d = 0; d < n; d++) {
                const double way = here[3 * n + d] - here[d];
                q[n * k + d] = here[d] + a->looks[i] * way, v[n * k + d] = way / h;
            }
        }
        const RowsArguments asked = {.count = steps, .c = a->c, .scene = a->push, .arguments = {q, v, at}, .apart = {n, n, 1},
                                     .results = {force, mass}, .widths = {n, n}};
        if (a->rows(&asked) != DONE) return 0;
        for (int64_t k = 0; k < n * steps; k++) largest[k] = fabs(force[k]) > largest[k] ? fabs(force[k]) : largest[k];
    }
    return 1;
}

/* The middle one of so many numbers, or between two of them; their order changes. */
static double middle_of(double *x, int64_t many) {
    place(x, 0, many - 1, many / 2);
    const double upper = x[many / 2];
    if (many % 2) return upper;
    place(x, 0, many - 1, many / 2 - 1);
    return (upper + x[many / 2 - 1]) / 2;
}

/* Each one's largest neighbour, and the middle of all steps at least. */
static void set_usual(int64_t n, int64_t steps, const double *largest, double *usual, double *room) {
    for (int64_t d = 0; d < n; d++) {
        for (int64_t k = 0; k < steps; k++) room[k] = largest[n * k + d];
        const double middle = middle_of(room, steps);
        for (int64_t k = 0; k < steps; k++) {
            const double here = largest[n * k + d], before = largest[n * ((k + steps - 1) % steps) + d],
                         behind = largest[n * ((k + 1) % steps) + d], beside = before > behind ? before : behind,
                         around = here > beside ? here : beside;
            usual[n * k + d] = around > middle ? around : middle;
        }
    }
}

/* Error at the end of an impulse at a node, so long before it. */
static double error_of(const Refined *a, int64_t d, double left, const double *scales) {
    double most = 0;
    for (int64_t i = 0; i < a->n; i++) {
        const double m = fabs(a->mass[a->apart * i]);
        most = m > most ? m : most;
    }
    const double m = fabs(a->mass[a->apart * d]);
    return left / (m > 0 ? m : most > 0 ? most : 1) / scales[d];
}

/* Whether bounds for many steps at once do so already. */
static int shows_at_once(const Refined *a, const Attempt *run, const double *t, const double *scales, double *room) {
    const int64_t n = a->n, steps = run->ended.last, groups = a->groups < steps ? a->groups : steps, some = a->sampled < steps ? a->sampled : steps;
    double *const q_low = room, *const q_high = q_low + n * groups, *const v_low = q_high + n * groups, *const v_high = v_low + n * groups,
           *const begin = v_high + n * groups, *const end = begin + groups, *const low = end + groups, *const high = low + n * groups,
           *const down = high + n * groups, *const up = down + n * groups, *const longest = up + n * groups, *const largest = longest + groups,
           *const rest = largest + n * some;
    const double total = fabs(t[steps] - t[0]);
    if (!a->bounds_of_many) return 0;
    for (int64_t g = 0; g < groups; g++) {
        const int64_t first = g * steps / groups, last = (g + 1) * steps / groups;
        begin[g] = t[first], end[g] = t[last], longest[g] = 0;
        for (int64_t d = 0; d < n; d++) {
            const double x = run->rows[3 * n * first + d];
            q_low[n * g + d] = q_high[n * g + d] = x, v_low[n * g + d] = INFINITY, v_high[n * g + d] = -INFINITY;
        }
        for (int64_t k = first; k < last; k++) {
            const double *const here = run->rows + 3 * n * k, h = t[k + 1] - t[k];
            longest[g] = h * h > longest[g] ? h * h : longest[g];
            for (int64_t d = 0; d < n; d++) {
                const int64_t i = n * g + d;
                const double x = here[3 * n + d], v = (x - here[d]) / h;
                q_low[i] = x < q_low[i] ? x : q_low[i], q_high[i] = x > q_high[i] ? x : q_high[i];
                v_low[i] = v < v_low[i] ? v : v_low[i], v_high[i] = v > v_high[i] ? v : v_high[i];
            }
        }
    }
    const RowsArguments asked = {.count = groups, .c = a->c, .scene = a->bounds_of_many,
                                 .arguments = {q_low, q_high, v_low, v_high, begin, end}, .apart = {n, n, n, n, 1, 1},
                                 .results = {low, high, down, up}, .widths = {n, n, n, n}};
    memset(largest, 0, n * some * sizeof(double));
    if (a->rows(&asked) != DONE || !look_at_forces(a, run, t, some, 0, a->few, largest, rest)) return 0;
    for (int64_t d = 0; d < n; d++) {
        for (int64_t k = 0; k < some; k++) rest[k] = largest[n * k + d];
        const double middle = middle_of(rest, some),
                     nothing = a->limits->nothing * a->tol / (error_of(a, d, total, scales) * total);
        for (int64_t g = 0, k = 0; g < groups; g++) {
            const int64_t i = n * g + d, last = (g + 1) * steps / groups;
            double here = INFINITY;
            for (; k < some && k * steps / some < last; k++) here = largest[n * k + d] < here ? largest[n * k + d] : here;
            const double smooth = a->limits->bends * (here > middle ? here : middle);
            if (-down[i] * longest[g] <= smooth && up[i] * longest[g] <= smooth) continue;
            if (!(-low[i] <= nothing && high[i] <= nothing)) return 0;
        }
    }
    return 1;
}

/* Whether bounds rule out that forces bend sharply within a step, as `missed_impulse` asks at a few places and then at all. */
static int shows_forces(const Refined *a, const Attempt *run, const double *t, const double *scales, double *room) {
    const int64_t n = a->n, steps = run->ended.last;
    double *const largest = room, *const bound = largest + n * steps, *const usual = bound + 4 * n * steps, *const rest = usual + n * steps;
    double *const low = bound, *const high = low + n * steps, *const down = high + n * steps, *const up = down + n * steps;
    const double total = fabs(t[steps] - t[0]);
    const RowsArguments asked = {.count = steps, .c = a->c, .scene = a->bounds,
                                 .arguments = {run->rows, run->rows + 3 * n, t, t + 1}, .apart = {3 * n, 3 * n, 1, 1},
                                 .results = {low, high, down, up}, .widths = {n, n, n, n}};
    if (a->rows(&asked) != DONE) return 0;
    memset(largest, 0, n * steps * sizeof(double));
    for (int pass = 0; pass < 2; pass++) {
        const int64_t first = pass ? a->few : 0, last = pass ? a->looked : a->few;
        int hides = 0;
        if (!look_at_forces(a, run, t, steps, first, last, largest, rest)) return 0;
        if (pass) set_usual(n, steps, largest, usual, rest);
        const double *const size = pass ? usual : largest;
        for (int64_t k = 0; k < steps && !hides; k++) {
            const double h = t[k + 1] - t[k], left = fabs(t[steps] - t[k]);
            for (int64_t d = 0; d < n; d++) {
                const double nothing = a->limits->nothing * a->tol / (error_of(a, d, left, scales) * total), smooth = a->limits->bends * size[n * k + d];
                const int64_t i = n * k + d;
                if (-down[i] * (h * h) <= smooth && up[i] * (h * h) <= smooth) continue;
                if (!(-low[i] <= nothing && high[i] <= nothing)) hides = 1;
            }
        }
        if (!hides) return 1;
    }
    return 0;
}

/* What nodes do not tell by their differences alone. */
static int doubted(const Refined *a, const Attempt *run, const Attempt *fine, int64_t parts, const double *scales) {
    const int64_t n = a->n, steps = run->ended.last, all = steps + fine->ended.last + 2, looked = a->timed ? (10 * n + 1) * steps + (8 * n + 3) * a->groups : 0;
    if (a->timed && !(a->push && a->bounds)) return 1;
    const double far = fabs(a->t0) + fabs(a->duration), rate = a->radians / fabs(a->duration); /* times far from zero: late_rounding */
    if (a->timed && a->limits->late * far * rate > a->tol) return 1;
    const int64_t balance = (3 + a->table.controls) * all;
    double few[SHORT], *const t = memory_for(all + (looked > balance ? looked : balance), few, few);
    if (!t) return 1;
    double *const room = t + all;
    set_node_times(a, run, t), set_node_times(a, fine, t + steps + 1);
    const int sure = balanced(a, run, fine, parts, t, room) && (!a->timed || shows_at_once(a, run, t, scales, room) || shows_forces(a, run, t, scales, room));
    give_up(t, few);
    return !sure;
}
