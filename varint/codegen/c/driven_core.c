/* Runs of x' = A x + g(t, u), x = (q, p), A constant, u controls, by Gauss rules, for scenes as data: a step is one map of x, and of g at its
   nodes. The names end in LEVEL, the instructions that are used.

   With z = h A the stages solve Y = x + z a Y + h a g, and a step is x + (R(z) - 1) x + h sum W_i(z) g(t + c_i h), where
   R - 1 = 2 odd / Q and W_i = N_i / Q; varint/codegen/driven.py has the coefficients of the polynomials Q, odd and N_i, row by row.
   Velocities are not looked for. */
#define NAMED(name, level) name##_##level
#define WITH_ALL(name, ...) NAMED(name, __VA_ARGS__)
#define run WITH_ALL(run_driven, LEVEL)
#include "widest.h"
#include "lanes.h"
#include "run.h"
#include "tape.h"
int ilogb(double);
double scalbn(double, int);

typedef struct {
    int64_t n, stages, many, controls; /* many: rows of g that are not zero, whose numbers are `active` */
    const double *active, *nodes;
    const double *left, *odd, *of; /* coefficients of Q, 2 odd and N_i, (stages, stages + 1) */
    Tape slopes, drive;            /* to A column by column and the mass matrix' diagonal; t and u to g */
} Scene;
#define CARRY_SIZE(n) (2 + 4 * (n))

/* columns of x := m^-1 x, (d, width) row by row, m (d, d); false where m has no inverse */
static int solved(int64_t d, int64_t width, double *m, double *x) {
    for (int64_t k = 0; k < d; k++) {
        int64_t best = k;
        for (int64_t r = k + 1; r < d; r++)
            if (fabs(m[r * d + k]) > fabs(m[best * d + k])) best = r;
        for (int64_t j = 0; j < d; j++) { const double y = m[k * d + j]; m[k * d + j] = m[best * d + j], m[best * d + j] = y; }
        for (int64_t j = 0; j < width; j++) { const double y = x[k * width + j]; x[k * width + j] = x[best * width + j], x[best * width + j] = y; }
        if (!(fabs(m[k * d + k]) > 0)) return 0;
        for (int64_t r = k + 1; r < d; r++) {
            const double factor = -m[r * d + k] / m[k * d + k];
            if (factor == 0) continue;
            for (int64_t j = k; j < d; j++) m[r * d + j] = s_fma(factor, m[k * d + j], m[r * d + j]);
            for (int64_t j = 0; j < width; j++) x[r * width + j] = s_fma(factor, x[k * width + j], x[r * width + j]);
        }
    }
    for (int64_t k = d - 1; k >= 0; k--)
        for (int64_t j = 0; j < width; j++) {
            double left = x[k * width + j];
            for (int64_t r = k + 1; r < d; r++) left = s_fma(-m[k * d + r], x[r * width + j], left);
            x[k * width + j] = left / m[k * d + k];
        }
    return 1;
}

/* The largest sum of sizes in rows of z, or in columns. */
static double largest_sum(const double *z, int64_t d, int64_t row, int64_t column) {
    double most = 0;
    for (int64_t i = 0; i < d; i++) {
        double sum = 0;
        for (int64_t j = 0; j < d; j++) sum += fabs(z[i * row + j * column]);
        most = sum <= most ? most : sum;
    }
    return most;
}

#define MOST_OF_Q 256 /* size of its highest power beyond which little is left of what is slow: h A of 24 with eight stages */
#define SQUARES 4     /* numbers (d, d) that maps are made of */
#define ON_STACK 24   /* of so many rows at most, what they need is there */

/* R - 1 and h W of a step, side by side: (2 n, 2 n + stages many), row by row. Momenta are in units of powers of two near
   mass / h. `w`: registers of the slopes; `found`: (d d + n); `z`: (SQUARES, d, d); false where there is no such map, or the step
   is too long for it. */
static int set_maps(const Scene *s, const RunArguments *a, double *w, V *found, double *z, double *maps) {
    const int64_t d = 2 * s->n, width = d + s->stages * s->many, more = s->stages + 1;
    double unit[d], *power = z + d * d, *next = power + d * d, *const left = next + d * d;
    prepare_tape(&s->slopes, a->c, w);
    evaluate_tape(&s->slopes, 0, (V *const[]){found, found + d * d}, 1, w);
    for (int64_t i = 0; i < d; i++) {
        const double mass = i < s->n ? 1 : fabs(lane(found[d * d + i - s->n], 0) / a->h);
        unit[i] = mass > 0 && mass - mass == 0 ? scalbn(1.0, ilogb(mass)) : 1;
    }
    for (int64_t i = 0; i < d; i++)
        for (int64_t j = 0; j < d; j++)
            z[i * d + j] = a->h * lane(found[j * d + i], 0) * unit[j] / unit[i], power[i * d + j] = i == j;
    memset(left, 0, d * d * sizeof(double)), memset(maps, 0, d * width * sizeof(double));
    for (int64_t k = 0; k <= s->stages; k++) {
        for (int64_t i = 0; i < d; i++) {
            for (int64_t j = 0; j < d; j++) {
                left[i * d + j] = s_fma(s->left[k], power[i * d + j], left[i * d + j]);
                maps[i * width + j] = s_fma(s->odd[k], power[i * d + j], maps[i * width + j]);
            }
            for (int64_t l = 0; l < s->stages; l++)
                for (int64_t j = 0; j < s->many; j++) {
                    double *const to = maps + i * width + d + l * s->many + j;
                    *to = s_fma(s->of[l * more + k], power[i * d + (int64_t)s->active[j]], *to);
                }
        }
        if (k == s->stages) break;
        memset(next, 0, d * d * sizeof(double));
        for (int64_t i = 0; i < d; i++)
            for (int64_t l = 0; l < d; l++) {
                const double slope = z[i * d + l]; /* of which most are none */
                if (slope == 0) continue;
                for (int64_t j = 0; j < d; j++) next[i * d + j] = s_fma(slope, power[l * d + j], next[i * d + j]);
            }
        double *const last = power;
        power = next, next = last;
    }
    const double by_row = largest_sum(power, d, d, 1), by_column = largest_sum(power, d, 1, d);
    if (!(fabs(s->left[s->stages]) * (by_row < by_column ? by_row : by_column) <= MOST_OF_Q)) return 0;
    if (!solved(d, width, left, maps)) return 0;
    for (int64_t i = 0; i < d; i++) {
        for (int64_t j = 0; j < d; j++) maps[i * width + j] *= unit[i] / unit[j];
        for (int64_t l = 0; l < s->stages; l++)
            for (int64_t j = 0; j < s->many; j++)
                maps[i * width + d + l * s->many + j] *= a->h * (unit[i] / unit[(int64_t)s->active[j]]);
    }
    return 1;
}

int run(const RunArguments *a) {
    const Scene *const s = a->scene;
    const int64_t n = s->n, d = 2 * n, m = s->many, width = d + s->stages * m, vectors = (d + LANES - 1) / LANES;
    const int64_t registers = (s->slopes.registers > s->drive.registers ? s->slopes.registers : s->drive.registers) + 1,
                  numbers = SQUARES * d * d + d * width, all = registers + d * d + n + d * vectors + numbers / LANES + 1;
    V few[d > ON_STACK ? 1 : all], *const own = d > ON_STACK ? aligned_alloc(64, (all * sizeof(V) + 63) / 64 * 64) : 0,
      *const w = d > ON_STACK ? own : few, gained[vectors], g[m + 1], given[d], u[s->controls + 1];
    if (!w) return NOT_FINITE;
    V *const found = w + registers, *const change = found + d * d + n;
    double *const z = (double *)(change + d * vectors), *const maps = z + SQUARES * d * d, *const carry = a->carry, *const x = carry + 2,
           *const rest = x + d, *rows = a->rows;
    int64_t done = 0, unsaved = 0;
    int status = set_maps(s, a, (double *)w, found, z, maps) ? DONE : NOT_FINITE;
    for (int64_t j = 0; j < d; j++)
        for (int64_t i = 0; i < vectors * LANES; i++) ((double *)(change + j * vectors))[i] = i < d ? maps[i * width + j] : 0;
    if (!(carry[0] == 1 && carry[1] == a->h)) memcpy(x, a->start, d * sizeof(double)), memset(rest, 0, d * sizeof(double));
    carry[0] = 1, carry[1] = a->h;
    memcpy(rows, x, d * sizeof(double));
    prepare_tape(&s->drive, a->c, (double *)w);
    for (int64_t l = 0; done < a->steps && !status && !is_behind(x[n - 1], a->end); done++, l = l + 1 < LANES ? l + 1 : 0) {
        if (!l) { /* what is given to as many steps as there are lanes */
            memset(given, 0, sizeof given);
            for (int64_t i = 0; i < s->stages && m; i++) {
                V t;
                for (int k = 0; k < LANES; k++) set_lane(&t, k, a->t0 + a->h * (double)(a->first + done + k) + s->nodes[i] * a->h);
                for (int64_t j = 0; j < s->controls; j++)
                    for (int k = 0; k < LANES; k++) {
                        const int64_t step = done + k < a->steps ? done + k : a->steps - 1;
                        set_lane(&u[j], k, a->u[s->controls * (s->stages * step + i) + j]);
                    }
                evaluate_tape(&s->drive, (const V *const[]){&t, u}, (V *const[]){g}, 1, (const double *)w);
                for (int64_t r = 0; r < d; r++)
                    for (int64_t j = 0; j < m; j++) given[r] = v_fma(splat(maps[r * width + d + i * m + j]), g[j], given[r]);
            }
        }
        for (int64_t r = 0; r < vectors * LANES; r++) ((double *)gained)[r] = r < d ? ((double *)given)[r * LANES + l] : 0;
        for (int64_t j = 0; j < d; j++)
            for (int64_t b = 0; b < vectors; b++) gained[b] = v_fma(splat(x[j]), change[j * vectors + b], gained[b]);
        for (int64_t r = 0; r < d; r++) compensated(&x[r], &rest[r], ((const double *)gained)[r]);
        if (++unsaved < a->save_every) continue;
        unsaved = 0, rows += 3 * n;
        memcpy(rows, x, d * sizeof(double));
    }
    free(own);
    memcpy(a->stats->last, x, d * sizeof(double));
    if (!status && unsound(x, (int)d) != 0) status = NOT_FINITE;
    a->stats->status = status, a->stats->steps = status ? 0 : (double)done;
    a->stats->iterations = a->stats->most_iterations = a->stats->residual = a->stats->failed = a->stats->contraction = 0;
    a->stats->noted = 0;
    return status;
}
