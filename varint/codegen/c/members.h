/* What the loops over members share: groups of LANES of them, their start, and their rows. */

/* The members in the lanes of a group; lanes without one repeat the last. */
typedef struct { int64_t at[LANES]; int count; } Group;

static int64_t run_group(const MembersArguments *a, const Group *g); /* how many of its members failed */

INLINE void load(const double *from, int size, const Group *g, V *x) {
    for (int l = 0; l < LANES; l++)
        for (int d = 0; d < size; d++) set_lane(&x[d], l, from[g->at[l] * size + d]);
}

INLINE void save(const MembersArguments *a, int64_t member, int lane_of, int64_t row, const V *q, const V *p) {
    double *to_q = a->q + (member * a->nodes + row) * N, *to_p = a->p + (member * a->nodes + row) * N;
    for (int d = 0; d < N; d++) to_q[d] = lane(q[d], lane_of), to_p[d] = lane(p[d], lane_of);
    a->good[member] = row + 1;
}

int run(const MembersArguments *a) {
    int64_t failed = 0;
    for (int64_t first = 0; first < a->members; first += LANES) {
        Group g;
        g.count = a->members - first < LANES ? (int)(a->members - first) : LANES;
        for (int l = 0; l < LANES; l++) g.at[l] = first + (l < g.count ? l : g.count - 1), a->good[g.at[l]] = 1;
        failed += run_group(a, &g);
    }
    return failed > 0;
}
