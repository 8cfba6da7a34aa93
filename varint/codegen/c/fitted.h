/* Steps that are shorter where forces bend sharply, and nowhere else. varint/integration/fitted_steps.py says why; its numbers are
   `limits`. refined_errors.h stands before this file. */
#define MOST_HALVINGS 40
#define BEGINS 64 /* stretches that there is room for at first */

/* How steps are fitted: pairs of so many equal ones, 0 where none are yet; looks at each part of long ones; how often; and the least
   impulse of bends so far. */
typedef struct { int64_t equal, parts, count; double least; } Fits;

typedef struct {
    Bends of;
    const double *rows, *t, *scales; /* a run, times of its nodes, and scales of momenta */
    int64_t last, k;                 /* its last step, and the one that was looked at */
    double allowed, *room;
    Grades *to;
    int64_t most, parts, halved; /* steps; looks at each of so many parts of long ones, which are halved less often */
} Fitting;

/* Looks at both ends of a step, too: forces may bend between one of them and the first or last other look. */
static Bends closer_looks(const Refined *a) {
    const int64_t looks = a->bend_looks + 2;
    const double *const places = a->bends + 3 * a->bend_looks;
    return (Bends){a->rows, a->push, a->c, places, places + looks, a->n, looks, 4};
}

/* How sharply forces bend in each of a few steps h from t on, along the motion that the run shows. */
static int set_sharp(Fitting *f, double t, double h, int64_t steps, double *sharp) {
    const int64_t n = f->of.n;
    const Looks x = looks_in(&f->of, steps, f->room);
    for (int64_t j = 0; j < steps; j++)
        for (int64_t i = 0; i < f->of.looks; i++) {
            const int64_t to = steps * i + j;
            const double time = t + h * ((double)j + f->of.places[i]);
            while (f->k > 0 && (f->t[f->k] - time) * h > 0) f->k--;
            while (f->k < f->last && (time - f->t[f->k + 1]) * h >= 0) f->k++;
            const double size = f->t[f->k + 1] - f->t[f->k];
            const Hermite part = hermite_at((time - f->t[f->k]) / size, size);
            x.at[to] = time, set_place(&part, n, f->rows + 3 * n * f->k, x.q + n * to, x.v + n * to);
        }
    return set_impulses(&f->of, &x, steps, h, f->scales, sharp);
}

/* Whether forces bend by more than is allowed in one of a few steps; they do where that cannot be told. */
static int bends_in(Fitting *f, double t, double h, int64_t steps) {
    double sharp[SIDE_BY_SIDE];
    if (!set_sharp(f, t, h, steps, sharp)) return 1;
    for (int64_t k = 0; k < steps; k++)
        if (!(sharp[k] <= f->allowed)) return 1;
    return 0;
}

/* Two more steps; whether there is room for them. */
static int add_pair(Grades *g, int64_t most, double t, double h) {
    if (g->all + 2 > most) return 0;
    if (!g->count || g->at[g->count - 1].h != h) {
        if (g->count == g->room) {
            Begin *const more = realloc(g->at, 2 * g->room * sizeof(Begin));
            if (!more) return 0;
            g->at = more, g->room *= 2;
        }
        g->at[g->count++] = (Begin){g->all, t, h};
    }
    g->all += 2;
    return 1;
}

/* Two steps h from t on, or twice as many where forces bend sharply in them, and so on. Long ones are looked at in parts, too:
   what speeds just come close to acts for a short time. */
static int divide(Fitting *f, double t, double h, int halvings) {
    if (halvings == MOST_HALVINGS || (!bends_in(f, t, h, 2) && (halvings >= f->halved || f->parts == 1 || !bends_in(f, t, h / (double)f->parts, 2 * f->parts))))
        return add_pair(f->to, f->most, t, h);
    return divide(f, t, h / 2, halvings + 1) && divide(f, t + h, h / 2, halvings + 1);
}

/* No steps yet. */
static int begin_pairs(Grades *g, double duration) {
    Begin *const begins = malloc(BEGINS * sizeof(Begin));
    *g = (Grades){.room = BEGINS, .duration = duration, .at = begins};
    return begins != 0;
}

/* Whether steps may be fitted after a run of so many equal ones. */
static int may_fit(const Refined *a, int64_t steps) { return a->fitted && !a->grades->count && steps <= a->fitted; }

/* Equal steps, in pairs, after a run of so many: no more than make sense where nothing bends. */
static int begin_fits(const Refined *a, int64_t *steps, Fits *to) {
    const int64_t most = (int64_t)a->limits->base * a->first, equal = ((*steps < most ? *steps : most) + 1) / 2 * 2;
    Grades *const g = a->grades;
    if (!begin_pairs(g, a->duration)) return 0;
    g->all = equal, g->count = 1, g->at[0] = (Begin){0, a->t0, a->duration / equal};
    *to = (Fits){equal, 1, 1, INFINITY}, *steps = equal;
    return 1;
}

/* A run on its way whose steps are halved in pairs where they are not solved. */
typedef struct {
    const Refined *a;
    Attempt *to;
    Grades *made;
    RunStats *stats;
    double *carry, level, most;
    int64_t allowed;
} Divided;

/* So many steps h from t on, an even number, of which those that are not solved are halved; 0 where they become too many. */
static int go_on_divided(Divided *x, double t, double h, int64_t count, int halvings) {
    const Refined *const a = x->a;
    const int64_t n = a->n;
    double begin[2 * n];
    for (int64_t i = 0; i < count;) {
        const int64_t done = x->made->all;
        if (done + count - i > x->allowed || halvings > MOST_HALVINGS) return 0;
        memcpy(begin, done ? x->to->rows + 3 * n * done : a->start, 2 * n * sizeof(double)), x->carry[0] = 0;
        const double now = t + h * (double)i;
        go_on(a, begin, now, 0, h, x->level, x->most, done, done + count - i, x->carry, x->stats, 0, x->to);
        const int64_t whole = x->to->lost ? (int64_t)x->stats->steps / 2 * 2 : count - i;
        if (x->to->lost && x->stats->status == DONE) return 0; /* iterations that hardly contract: another method's */
        x->to->lost = 0;
        for (int64_t k = 0; k < whole; k += 2)
            if (!add_pair(x->made, x->allowed, now + h * (double)k, h)) return 0;
        i += whole;
        if (i == count) break;
        if (!go_on_divided(x, t + h * (double)i, h / 2, 4, halvings + 1)) return 0;
        i += 2;
    }
    return 1;
}

/* A run of the steps of a->grades, which become those that could be solved. */
static int try_divided(const Refined *a, double wanted, Attempt *to) {
    const Grades *const g = a->grades;
    Grades made;
    const int64_t some = 8 * g->all + 1024, most = some < farthest(a) ? some : farthest(a);
    to->steps = g->all;
    double *const carry = make_room(a, most, to);
    if (!carry || !begin_pairs(&made, a->duration)) return 0;
    const double level = level_for(a, wanted, g->all);
    Divided x = {a, to, &made, (RunStats *)(carry + a->carry), carry, level, most_for(a, level, 1), most};
    for (int64_t i = 0; i < g->count && !to->lost; i++) {
        const int64_t end = i + 1 < g->count ? g->at[i + 1].first : g->all;
        to->lost = !go_on_divided(&x, g->at[i].t, g->at[i].h, end - g->at[i].first, 0);
    }
    free(g->at), *a->grades = made;
    to->steps = made.all, to->ended = ended_after(made.all, a->t0, a->duration / made.all);
    if (!to->lost) to->lost = unsound(to->rows + 3 * a->n * made.all, a->n) != 0;
    return 1;
}

/* How a run shows its motion; 0 where there is no memory. `room` is to be freed. */
static Fitting begin_looking(const Refined *a, const Attempt *run, const double *of_coordinates, double *scales, double **room) {
    const Bends of = closer_looks(a);
    const int64_t nodes = run->steps + 1;
    double *const t = *room = malloc((nodes + ROOM_OF_BENDS(a->n, of.looks, of.numbers)) * sizeof(double));
    if (t) set_both_scales(a, run, of_coordinates, scales), set_node_times(a, run, t);
    return (Fitting){.of = of, .rows = run->rows, .t = t, .scales = scales + a->n, .last = run->steps - 1, .room = t + nodes};
}

/* The next run has pairs of equal steps, halved until forces bend by no more than is aimed at in each of them; 0 where these are too
   many. */
static int fit(const Refined *a, const Attempt *run, double wanted, const double *of_coordinates, Fits *x, int64_t *steps) {
    double scales[2 * a->n], *room;
    Grades found;
    Fitting f = begin_looking(a, run, of_coordinates, scales, &room);
    int good = begin_pairs(&found, a->duration) && room;
    const double h = a->duration / x->equal;
    f.allowed = a->limits->aimed * wanted, f.to = &found, f.most = farthest(a), f.parts = x->parts, f.halved = (int64_t)a->limits->halved;
    for (int64_t k = 0; k < x->equal && good; k += 2) good = divide(&f, h * (double)k + a->t0, h, 0);
    free(room), free(good ? a->grades->at : found.at);
    if (good) *a->grades = found, *steps = found.all, x->count++;
    return good;
}

/* Impulses of bends in all steps of a run, or in the long ones alone, which are looked at in parts. */
static double bent_by(const Refined *a, const Attempt *run, const Fits *x, int all, const double *of_coordinates) {
    double scales[2 * a->n], sharp[SIDE_BY_SIDE], made = 0, *room;
    Fitting f = begin_looking(a, run, of_coordinates, scales, &room);
    if (!room) return INFINITY;
    const double longest = ldexp(fabs(a->duration) / x->equal, -(int)a->limits->halved);
    for (int64_t k = 0, some; k < run->steps; k += some) {
        const Stretch here = stretch_of(a->grades, a->t0, a->duration, run->steps, k);
        const int64_t left = here.end - k, parts = fabs(here.h) > longest ? x->parts : all;
        const double t = here.t + here.h * (double)(k - here.first);
        some = left < SIDE_BY_SIDE ? left : SIDE_BY_SIDE;
        for (int64_t i = 0; i < parts; i++) {
            if (!set_some(&f.of, run->rows + 3 * a->n * k, some, i, parts, t, here.h, f.scales, sharp, f.room)) made = INFINITY;
            for (int64_t j = 0; j < some && made < INFINITY; j++) made += sharp[j];
        }
    }
    free(room);
    return made == made ? made : INFINITY;
}

/* Whether those of a run are more than what is wanted, and another one may do better. */
static int is_bent(const Refined *a, const Attempt *run, int all, double wanted, const double *of_coordinates, Fits *x) {
    const double bent = bent_by(a, run, x, all, of_coordinates), before = x->least;
    x->least = bent;
    return bent > a->limits->passable * wanted && 2 * bent < before;
}
