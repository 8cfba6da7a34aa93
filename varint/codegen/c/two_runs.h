/* A coarse run, the run itself, their energies and their difference: how the error of a motion is proved.

   varint/integration/two_runs.py says why, and decides alike where runs are of another kind; its numbers are `limits`.

   Before this file: a Case, with `limits`, order, linear, exact, first, radians, tol and `found`, which counts the runs; an Attempt
   that has `seen`; and what is declared here. */
typedef struct { double wanted, estimate; int unseen; } Doubt; /* of a run: round-off of the start; may it be more than was seen? */

/* A run of one of so many parts of the steps; 0 where another way is to be taken. One of `watched` parts, more than one, ends
   with the first of them where that is none. */
static int try_run(const Case *a, int64_t steps, double wanted, int64_t part, int64_t watched, Attempt *to);
static void release(Attempt *run);
/* The largest difference of two runs, no number where one of them is none, and the least that an early one lets expect in the
   middle: those of regular motions grow with the square of time at most. `beyond`: how many times larger it is between the
   nodes that both share. */
static double apart_from(const Case *a, const Attempt *one, const Attempt *other, double *early, double *beyond);
/* What round-off grows to, the start's included, with which all runs begin alike; less than none where it is looked at
   elsewhere. */
static double by_round_off(const Case *a, const Attempt *run, const Doubt *of);
/* The number of a rate that steps should follow, since it varies along a run that went astray; less than none: of none. */
static int64_t varying_rate(const Case *a, const Attempt *run);
static void keep(const Case *a, Attempt *run, double estimate);
/* Whether a run of so many steps is made here. */
static int is_short(const Case *a, double steps);

/* Where iterations may stop, so that what they leave adds up to less than what is wanted. */
static double level_for(const Case *a, double wanted, int64_t steps) {
    const double often = a->limits->secular / ((double)steps * (double)steps);
    return wanted * (a->limits->level < often ? a->limits->level : often);
}

static double expected_of(const Case *a, const Seen *run) {
    return run->lost ? INFINITY : a->limits->gain * run->swing[QUANTILES - 1] * (a->radians > 1 ? a->radians : 1);
}

/* Parts of a coarse run, the first of which is looked at while it is made; 1 where it is too short for that. */
static int64_t watched_parts(const Case *a, int64_t steps) {
    const int64_t each = steps / (int64_t)a->limits->first_part, most = (int64_t)a->limits->watched,
                  parts = each < most ? each : most;
    return steps <= a->limits->most_without_a_part && parts >= a->limits->fewest ? parts : 1;
}

static double ratio_for(const Case *a, double error, double wanted, double most) {
    if (!(error - error == 0)) return most;
    double x = pow(error / wanted, 1 / (double)a->order);
    x = x > a->limits->least ? x : a->limits->least;
    return x < most ? x : most;
}

static int64_t shared(double steps) {
    const int64_t parts = steps > 256 ? 16 : steps > 96 ? 8 : 4; /* SHARED */
    const double each = ceil(steps / parts);
    return parts * (each > 2 ? (int64_t)each : 2);
}

/* Part of the coarse run's error that the finer one has left; no number where it does not shrink. */
static double shrinkage(const Case *a, const Seen *before, const Seen *after) {
    const Limits *const l = a->limits;
    const double sure = pow((double)after->steps / (double)before->steps, -l->caution * a->order);
    const double rounded = before->hidden > l->rounded ? before->hidden : l->rounded;
    double left = -1;
    for (int i = 0; i < QUANTILES; i++)
        if (before->swing[i] > l->evidence * rounded) {
            const double rest = (after->swing[i] > l->rounded ? after->swing[i] : l->rounded) / before->swing[i];
            left = rest > left ? rest : left;
        }
    if (left < 0) return a->linear || l->pairs > 1 ? sure : rounded > l->rounded ? l->not_worse : 0.5;
    if (left > l->no_shrinkage) return left < 1 ? l->not_worse : NO_NUMBER;
    left = l->safety * left < 0.5 ? l->safety * left : 0.5;
    return left > sure ? left : sure;
}

/* The same by the order that a difference shows after the one `before`, of so many times as many steps: part_left. */
static double left_by_order(const Case *a, double before, double finer, double apart, double ratio) {
    const Limits *const l = a->limits;
    const double p = (double)a->order;
    double order = l->least_order;
    if (before < l->tells) {
        const double drop = log((before > l->floor ? before : l->floor) / (apart > l->floor ? apart : l->floor)) / log(finer);
        order = drop > order ? drop : order, order = order < p ? order : p;
    }
    const double lasting = order * (order / p), sure = lasting > l->least_order ? lasting : l->least_order;
    return pow(ratio, -(ratio >= l->nearly ? l->sure_of_order : l->less_of_order) * sure);
}

/* Whether energies are round-off, and differences shrink by far less than truncation does. */
static int stays_behind(const Case *a, const Seen *coarse, const Seen *fine, double before, double apart) {
    const Limits *const l = a->limits;
    if (a->linear || !(fine->swing[MIDDLE] > l->no_shrinkage * coarse->swing[MIDDLE]) || !(before < l->rough * l->evidence)) return 0;
    return l->evidence * before * pow((double)fine->steps / (double)coarse->steps, -l->caution * a->order) < apart;
}

/* Of what two runs differ by, what round-off may have made; that of one map is the same in all steps. */
static double by_steps_alike(const Case *a, int64_t steps, double apart, double rounded) {
    if (!a->exact) return rounded;
    const double all = a->limits->same_rounding * (double)steps * (double)steps, most = a->limits->same_chance * apart,
                 alike = most < all ? most : all;
    return alike > rounded ? alike : rounded;
}

/* With memory for two runs. */
static int prove(const Case *a, Attempt coarse, Attempt fine) {
    const Limits *const l = a->limits;
    int result = NOT_SHORT, known = 0, compared = 0, doubted = 0, measured = 0;
    const double p = (double)a->order, full = a->tol * pow(2, p) / l->half, rough = full < l->rough ? full : l->rough;
    double expected = INFINITY, before = INFINITY, clear = l->clear, growth = 1, start_growth = 1,
           between = 1, previous = INFINITY, ratio = 1; /* the last difference, and of how many times as many steps */
    const double close = l->rough * l->closer, level = rough < close ? rough : close;
    const double alike = a->exact ? l->same_step * (double)a->first : 0, floor = alike > l->floor ? alike : l->floor;
    int64_t steps = shared((double)a->first), rate;
    a->found->runs = 0;
    for (int looks = 0; !a->exact && steps > l->most_without_a_part && looks < 3; looks++) {
        if (!try_run(a, steps, rough, (int64_t)l->parts, 1, &coarse)) goto end;
        const double likely = expected_of(a, &coarse.seen);
        if (coarse.seen.lost && (rate = varying_rate(a, &coarse)) >= 0) goto varies;
        if (rough / l->part_close < likely && likely < rough * l->part_close) {
            if (!is_short(a, steps * ratio_for(a, l->margin * likely, a->tol, l->most))) goto end; /* the finer run */
            break;
        }
        double factor = likely - likely == 0 ? pow((likely > 1e-300 ? likely : 1e-300) / rough, 1 / p) : 2;
        factor = factor < 0.5 ? 0.5 : factor > 2 ? 2 : factor;
        steps = shared(steps * factor);
    }
    for (int attempt = 0; attempt < l->attempts; attempt++) {
        if (!known) {
            if (!try_run(a, steps, level, 1, a->exact ? 1 : watched_parts(a, steps), &coarse)) goto end;
            expected = expected_of(a, &coarse.seen);
            if (coarse.seen.lost || !(expected <= l->lost)) {
                if ((rate = varying_rate(a, &coarse)) >= 0) goto varies;
                steps = shared(steps * ratio_for(a, expected, rough, 2));
                continue;
            }
            const double wanted = ratio_for(a, l->margin * expected, a->tol, INFINITY);
            if (wanted > (expected <= clear ? l->far : l->most)) {
                steps = shared(steps * wanted / l->good), clear = l->lost;
                continue;
            }
            known = 1;
        }
        double finer = ratio_for(a, l->margin * expected, a->tol, l->far);
        if (compared >= (int)l->pairs) finer = finer > l->again ? finer : l->again;
        else if (compared < (int)l->pairs - 1) finer = finer < l->again ? finer : l->again;
        const int64_t more = shared(steps * finer);
        const double magnifies = growth * between, wanted = a->tol / (magnifies > l->foreseen ? magnifies : l->foreseen);
        double early = 0, beyond = 1;
        if (!try_run(a, more, wanted, 1, 1, &fine)) goto end;
        if (fine.seen.lost && (rate = varying_rate(a, &fine)) >= 0) goto varies;
        if (fine.seen.lost) break;
        const double apart = apart_from(a, &coarse, &fine, &early, &beyond), made = coarse.seen.swing[MIDDLE],
                     regular = l->secular_growth * (early > l->rounded ? early : l->rounded),
                     grown = apart / (made > regular ? made : regular), /* growth_of */
                     often = l->magnified * grown, begun = apart / regular < often ? apart / regular : often; /* magnified */
        start_growth = begun > start_growth ? begun : start_growth;
        growth = grown > growth ? grown : growth;
        between = beyond > between ? beyond : between;
        const double walk = l->rounding * a->radians * sqrt((double)more) * growth,
                     rounded = by_steps_alike(a, more, apart, apart < walk ? apart : walk),
                     more_steps = (double)more / (double)steps;
        double left = shrinkage(a, &coarse.seen, &fine.seen);
        if (walk > l->hopeless * a->tol) goto end; /* it is shown elsewhere that no steps mend it */
        const int stalls = apart > l->stalled * before;
        if (l->ways < 1 && rounded > a->tol && stays_behind(a, &coarse.seen, &fine.seen, before, apart)) goto end; /* as elsewhere */
        if (!(apart - apart == 0) || (stalls && rounded > a->tol)) break;
        const int converges = before < INFINITY && apart < l->converges * before;
        if (left != left && converges && fine.seen.swing[MIDDLE] < l->still) left = l->not_worse;
        const int shrinks = left == left;
        compared++;
        if (shrinks && compared > 1 && l->pairs > 1) {
            const double by_order = left_by_order(a, previous, ratio, apart, more_steps);
            left = by_order > left ? by_order : left;
        }
        previous = apart, ratio = more_steps;
        if (!shrinks) {
            expected = expected_of(a, &fine.seen), expected = apart > expected ? apart : expected;
            if (doubted || !(expected <= l->lost)) break;
        }
        const double uneven = start_growth < l->uneven ? start_growth : l->uneven,
                     likely_between = (double)common_divisor(steps, more) < l->seen_parts ? uneven : sqrt(uneven),
                     spread = l->spread * (likely_between > beyond ? likely_between : beyond);
        const int unseen = growth >= l->grows && rounded > a->tol && l->ways >= 1 && !measured; /* other runs show what round-off makes */
        double shown = spread * apart * left / (1 - left);
        const double of_rounding = beyond * rounded;
        shown = shown > of_rounding || unseen ? shown : of_rounding, shown = shown > floor ? shown : floor;
        if (l->pairs > 1) {
            double told = apart < a->tol ? apart : a->tol;
            told = told < l->by_chance ? told : l->by_chance, shown = shown > told ? shown : told;
        }
        const double iterated = l->left * level_for(a, wanted, more) * sqrt((double)more) * growth * beyond;
        double estimate = shown > iterated ? shown : iterated;
        const int near = apart < l->rough * l->evidence;
        if (shrinks && near && compared >= (int)l->pairs && estimate <= a->tol) {
            const double turns = a->radians > (double)more ? a->radians : (double)more;
            const double likely = l->chance * l->rounding * turns * sqrt((double)more) * start_growth * beyond;
            const int grows = start_growth >= l->grows;
            double rounded_to = 0;
            if (likely <= a->tol) rounded_to = grows || l->foreseen > 1 ? likely : 0;
            else if (grows) rounded_to = by_round_off(a, &fine, &(Doubt){wanted, estimate, unseen});
            if (rounded_to < 0) {
                result = DOUBTED;
                keep(a, &fine, estimate);
                goto end;
            }
            if (rounded_to > a->tol && !unseen) goto end;
            if (unseen) rounded_to *= l->chance, measured = 1;
            if (rounded_to <= a->tol) {
                result = PROVED;
                keep(a, &fine, rounded_to > estimate ? rounded_to : estimate);
                goto end;
            }
        }
        const Attempt older = coarse;
        coarse = fine, fine = older;
        steps = more;
        if (shrinks) before = apart, expected = near ? shown : apart;
        else doubted = 1;
    }
    if (start_growth < l->grows && !doubted) result = NOT_PROVED; /* elsewhere it may be shown to be out of reach */
    goto end;
varies:
    result = VARIES + (int)rate;
end:
    release(&coarse), release(&fine);
    return result;
}
