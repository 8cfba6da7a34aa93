/* Bodies that fly between impacts: steps of a loop (run.h) as long as every gap certainly stays open, impacts located
   within a step by shorter steps of the same rule, and Newton's law of restitution there.

   The same as varint/integration/events does in general, for rows that are clearly independent: blows that come together are
   dealt one after the other, then it is found what holds. Another set has another loop, which is asked for; the run ends SETTLED
   where there is none, and BESIDE where this is not enough. Gaps along a step are bounded from its two ends (enclosures.py), so
   that none closes and opens again unseen. */

#include "contact_state.h"
#include "contact_gaps.h"
#include "contact_forces.h"
#include "contact_blows.h"

/* Steps until a gap closes as it would with accelerations that stay. */
static double steps_ahead(Work *x, const double *point) {
    double acceleration[N + x->held[0]], ahead = INFINITY;
    if (!factorise(x)) return ahead;
    accelerate(x, acceleration);
    for (int i = 0; i < CONTACTS; i++) {
        if (x->a->holds[i]) continue;
        const double gap = fmax(GAP_OF(point)[i], 0), rate = RATE_OF(point)[i];
        const double bend = x->bend[FIRST + i] + sum_of(CONTACT_ROW(i), acceleration, N);
        const double inside = rate * rate - 2 * bend * gap;
        if (!(inside >= 0) || (rate >= 0 && bend >= 0)) continue;
        const double q = sqrt(inside), closes = rate < 0 ? 2 * gap / (q - rate) : -(rate + q) / bend;
        ahead = fmin(ahead, closes / x->a->h);
    }
    return ahead;
}

/* How far each coordinate moves in a step. */
INLINE void reaches(Work *x) {
    for (int d = 0; d < N; d++) x->reach[d] = fabs(x->a->h) * x->scale[d];
}

/* The loop of other contacts that hold, which is there; what it carries along. */
static double *take_begun(Work *x) {
    const int64_t *const begun = x->a->begun;
    x->run = (int (*)(const RunArguments *))(size_t)begun[0], x->loop = (const void *)(size_t)begun[1];
    double *const carry = (double *)(size_t)begun[2];
    x->carry = carry + begun[3];
    x->held[0] = begun[4], memcpy(x->held + 1, begun + 5, (size_t)begun[4] * sizeof(int64_t));
    x->scale = x->a->sizes + N, reaches(x);
    return carry;
}

/* Whether node k is kept; `due` is the first that is, from some node behind it on. */
INLINE int is_kept(const ContactArguments *a, int64_t k, int64_t *due) {
    if (k > *due) *due = (k + a->save_every - 1) / a->save_every * a->save_every;
    return k == *due || k == a->last;
}

INLINE void keep(double *row, double t, int64_t k, const double *state) {
    row[0] = t, row[1] = (double)k;
    COPY(row + 2, state, 3 * N);
}

static int whole_run(const ContactArguments *a) {
    scene = a->scene;
    const int64_t stats_size = (int64_t)(sizeof(RunStats) / sizeof(double)) + 3 * N;
    const int64_t all = N + ROWS;
    const int64_t sizes[] = {a->carry_size, 6 * N, stats_size, CONTACTS, ROWS * N, N * N, N, ROWS, CONTACTS, N, all * all, all,
                             5 * N * (MOST_STEPS + 1), ALL_W, CONTACTS, BOX * MOST_STEPS, CONTACTS * MOST_STEPS, MOST_STEPS};
    double *part[sizeof sizes / sizeof *sizes];
    int64_t total = 0;
    for (int i = 0; i < (int)(sizeof sizes / sizeof *sizes); i++) total += sizes[i];
    double *const memory = malloc((size_t)total * sizeof(double));
    if (!memory) return BESIDE;
    total = 0;
    for (int i = 0; i < (int)(sizeof sizes / sizeof *sizes); i++) part[i] = memory + total, total += sizes[i];
    double *const rows = part[12], *const rests = rows + 3 * N * (MOST_STEPS + 1), *const w = part[13];
    int pivots[all];
    int64_t held[1 + ROWS], known[1 + ROWS];
    Work work = {a, a->run, a->loop, a->scale, w, part[0], part[1], part[2], part[3], part[4], part[5], part[6], part[7], part[8], part[9], part[10], part[11],
                 part[14], part[15], part[16], part[17], pivots, held, 0, 0, 0, 0};
    Work *const x = &work;
    double *const state = a->state, *carry = state + STATE_Q + NUMBERS, *row = a->rows, *hit = a->hit;
    int64_t k = (int64_t)state[0], due = 0, steps = 0;
    double now[POINT], end[POINT], at[POINT], before[POINT], moved[N];
    a->stats[4] = 0;
    memset(held, 0, sizeof held);
    held[0] = a->held, memcpy(held + 1, a->rows_held, (size_t)a->held * sizeof(int64_t)), memcpy(known, held, sizeof held);
    int status = FULL;
    prepare_tape(&scene->gaps, a->c, w + GAPS_AT), prepare_tape(&scene->bounds, a->c, w + BOUNDS_AT);
    prepare_tape(&scene->blow, a->c, w + BLOW_AT);
    double *const t = state + 1, *const impacts = state + 2, *const next = state + 3;
    reaches(x);
    now[0] = 0;
    COPY(now + 1, state + STATE_Q, NUMBERS);
    look(x, now, *t);
    int begins = (int)a->begins;
    while (k < a->last && status == FULL) {
        if ((row - a->rows) / ROW_SIZE + MOST_STEPS + 2 > a->room || (hit - a->hit) / HIT_SIZE + MOST_IMPACTS + 1 > a->hits || steps >= a->steps) break;
        int found = NONE, leaves = -1;
        view(x, now, *t);
        if (begins) { /* what touches and approaches bounces at once, what rests and must push holds */
            found = HIT;
            COPY(at, now, POINT);
        } else if (*t == a->t0 + a->h * (double)k) { /* steps of the grid until something may close */
            const double many = fmin(fmin(*next, (double)(a->last - k)), floor(steps_ahead(x, now)) + 1);
            const int64_t count = many > 1 ? (int64_t)many : 1;
            closeness(x, Q_OF(now), x->reach, x->close);
            if (carry[0] == 0) begin_afresh(x, carry, V_OF(now)), COPY(rests, REST_OF(now), 2 * N);
            const RunArguments some = {count, 1, k, a->most, a->t0, a->h, a->level, now + 1, a->c, 0, rows, carry,
                                       (RunStats *)x->told, x->loop, 0, rests};
            x->run(&some);
            const RunStats *const told = (RunStats *)x->told;
            const int64_t good = (int64_t)told->steps;
            x->iterations += told->iterations, x->residual = fmax(x->residual, told->residual); /* shorter steps tell theirs there */
            const int rests_on = held[0] && held[held[0]] >= FIRST; /* what holds may let go */
            const int together = good >= TOGETHER && !rests_on;
            int64_t passed = 0, looked = 0; /* node whose gaps are known */
            if (together) clear_steps(x, k, good, rows);
            for (; passed < good; passed++) {
                const double *const reached = rows + 3 * N * (passed + 1), *const rest = rests + 2 * N * (passed + 1);
                const double then = a->t0 + a->h * (double)(k + 1);
                if (!together || !x->clear[passed]) {
                    if (looked != passed) COPY(now + 1, reached - 3 * N, 3 * N), COPY(REST_OF(now), rest - 2 * N, 2 * N), look(x, now, *t);
                    end[0] = a->h;
                    COPY(end + 1, reached, 3 * N), COPY(REST_OF(end), rest, 2 * N);
                    look(x, end, then);
                    found = is_finite_point(end) ? first_impact(x, now, *t, end, at) : DOUBT;
                    if (!found && lets_go(x, end, then)) found = first_release(x, now, *t, end, at, &leaves);
                    looked = passed;
                    if (found) break;
                    COPY(now + 1, end + 1, POINT - 1), looked++;
                }
                k++, *t = then, *impacts = 0;
                if (is_kept(a, k, &due)) keep(row, *t, k, reached), row += ROW_SIZE;
            }
            if (looked < passed && !found) {
                COPY(now + 1, rows + 3 * N * passed, 3 * N), COPY(REST_OF(now), rests + 2 * N * passed, 2 * N);
                look(x, now, *t);
            }
            steps += passed + 1;
            if (passed < count) carry[0] = 0;
            else *next = fmin(*next + FEW_STEPS, MOST_STEPS); /* as the root of the flight: what is too much beside what it costs */
            if (found == NONE && good < count) found = DOUBT; /* a step that is not solved */
        } else { /* the rest of a step after an impact */
            carry[0] = 0, steps++, x->looks = 0;
            end[0] = a->t0 + a->h * (double)(k + 1) - *t;
            if (!ahead_by(x, now, *t, end[0], end)) { status = BESIDE; break; }
            count_step(x);
            for (int d = 0; d < N; d++) moved[d] = fmax(x->reach[d], fabs(Q_OF(end)[d] - Q_OF(now)[d]));
            closeness(x, Q_OF(now), moved, x->close);
            found = first_impact(x, now, *t, end, at);
            if (!found && lets_go(x, end, a->t0 + a->h * (double)(k + 1))) found = first_release(x, now, *t, end, at, &leaves);
            if (found == NONE) {
                k++, *t = a->t0 + a->h * (double)k, *impacts = 0;
                COPY(now + 1, end + 1, POINT - 1);
                if (is_kept(a, k, &due)) keep(row, *t, k, now + 1), row += ROW_SIZE;
            }
        }
        if (found == NONE) continue;
        const double stop = a->t0 + a->h * (double)(k + 1);
        double when = *t + at[0];
        const int ends = !begins && (at[0] == end[0] || fabs(stop - when) <= LOCATED * fabs(stop));
        if (ends) when = stop;
        if (found == DOUBT || *impacts >= (found == LEAVES ? RESTLESS : MOST_IMPACTS)) { status = BESIDE; break; }
        if (found == HIT && lets_go(x, at, when)) { status = BESIDE; break; }
        COPY(before, at, POINT);
        const int struck = settle(x, at, when, leaves, hit);
        const int same = held[0] == known[0] && !memcmp(held + 1, known + 1, (size_t)held[0] * sizeof(int64_t));
        for (int i = 0; i < struck; i++) hit[0] = (double)((row - a->rows) / ROW_SIZE), hit += HIT_SIZE;
        if (struck < 0 || !same) {
            a->stats[4] = struck >= 0 || found == HIT, a->stats[5] = when, a->stats[6] = ends;
            COPY(a->stats + 7, (struck < 0 ? before : at) + 1, NUMBERS);
            for (int i = 0; i < CONTACTS && struck >= 0; i++) a->holds[i] = 0;
            for (int64_t j = 0; j < held[0] && struck >= 0; j++)
                if (held[1 + j] >= FIRST) a->holds[held[1 + j] - FIRST] = 1;
            if (struck < 0 || !a->change || !a->change((row - a->rows) / ROW_SIZE, k + ends, a->last)) {
                status = struck < 0 ? BESIDE : SETTLED;
                break;
            }
            a->stats[4] = 0;
            carry = take_begun(x), memcpy(known, held, sizeof known);
            COPY(V_OF(at), a->sizes, N);
            look(x, at, when);
        }
        k += ends, *t = when, *impacts = ends || begins ? 0 : *impacts + 1, *next = FEW_STEPS, begins = 0;
        COPY(now + 1, at + 1, POINT - 1);
        keep(row, *t, k, now + 1), row += ROW_SIZE;
    }
    if (k == a->last) status = ENDED;
    state[0] = (double)k;
    COPY(state + STATE_Q, now + 1, NUMBERS);
    a->stats[0] = (double)((row - a->rows) / ROW_SIZE), a->stats[1] = (double)((hit - a->hit) / HIT_SIZE);
    a->stats[2] = x->iterations, a->stats[3] = x->residual;
    free(memory);
    return status;
}

/* How far the run is, at the nodes of both, from one in fewer steps that has ended clean: coordinate by coordinate. Nodes of impacts
   come behind that of the grid before them. */
static int from_fewer(const ContactArguments *a, const double *few, int64_t nodes) {
    const double *many = a->rows, *const end = a->rows + ROW_SIZE * (int64_t)a->stats[0];
    const double ratio = (double)(a->last / a->fewer);
    for (int d = 0; d < N; d++) a->apart[d] = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const double *const node = few + ROW_SIZE * i;
        if (i && node[1] == node[1 - ROW_SIZE]) continue;
        while (many < end && many[1] != ratio * node[1]) many += ROW_SIZE;
        if (many == end) return 0;
        for (int d = 0; d < N; d++) a->apart[d] = fmax(a->apart[d], fabs(many[2 + d] - node[2 + d]));
    }
    return 1;
}

int contacts(const ContactArguments *a) {
    scene = a->scene;
    if (!a->fewer) return whole_run(a);
    const int64_t size = STATE_Q + NUMBERS + a->carry_size;
    double *const memory = malloc((size_t)(size + ROW_SIZE * a->room + HIT_SIZE * a->hits) * sizeof(double));
    int64_t holds[CONTACTS], nodes = 0;
    for (int d = 0; d < N; d++) a->apart[d] = INFINITY;
    if (memory) {
        ContactArguments few = *a;
        few.last = a->fewer, few.h = a->h * (double)(a->last / a->fewer);
        few.state = memory, few.rows = memory + size, few.hit = few.rows + ROW_SIZE * a->room;
        COPY(few.state, a->state, size), memcpy(holds, a->holds, sizeof holds);
        if (whole_run(&few) == ENDED) nodes = (int64_t)a->stats[0];
        memcpy(a->holds, holds, sizeof holds);
    }
    const int status = whole_run(a);
    if (status == ENDED && nodes && !from_fewer(a, memory + size, nodes)) for (int d = 0; d < N; d++) a->apart[d] = INFINITY;
    free(memory);
    return status;
}
