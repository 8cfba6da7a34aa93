/* Where constraint rows come to depend on one another, looked for in every step: what is noted, the caller judges.

   newton.c stands around this file; varint/integration/fold_watch.py says what it is for. A node is its step's number, the
   smallest pivot there (UNSEEN: not looked at), q, p and the squares of the rows' lengths; a note is its kind and the last LATELY nodes. newton.c has the sizes. */
#define UNSEEN (-1.0)
#define NEARLY 4       /* times the smallest reciprocal of a determinant, or of the largest pivot: as regular as elsewhere */
#define VERY_NEARLY 64 /* the same for steps without nodes within, of which the ends alone may lie on a fold */
#define OFTEN 16 /* steps between two looks at least, so that the largest pivot is known */

enum Note { OVER_FOLD, ON_FOLD };

typedef struct { double *farthest, *lately; } Folds;

INLINE double *node_at(const Folds *s, int64_t k) { return s->lately + k % LATELY * NODE_SIZE; }
INLINE int is_kept(const double *node, int64_t k) { return node[0] == (double)k; }
INLINE int is_seen(const double *node, int64_t k) { return is_kept(node, k) && node[1] != UNSEEN; }

LARGE void look(const Folds *s, double *node, double t, const double *w) {
    double pivot = 0;
    independence_of(node + 2, &t, w, &pivot);
    if (KICKED) lengths_of(node + 2, &t, w, node + 2 + 2 * N);
    node[1] = pivot < 0 ? 0 : pivot;
    *s->farthest = pivot > *s->farthest ? pivot : *s->farthest;
}

/* Whether a row's gradient has lost its length, or the rows their rank, or there are no numbers. Where steps are KICKED lengths
   show in the rank of G M^-1 G'; else they are measured at every node. */
INLINE int is_lost(const Folds *s, int64_t k) {
    const double *const node = node_at(s, k), *const before = node_at(s, k - (k > 0));
    const int seen = is_seen(node, k);
    if (seen && !(node[1] >= FOLDED * FOLDED * *s->farthest)) return 1;
    if (!k || (KICKED ? !(seen && is_seen(before, k - 1)) : !is_kept(before, k - 1))) return 0;
    for (int i = 2 + 2 * N; i < NODE_SIZE; i++)
        if (!(node[i] >= VANISHED * VANISHED * before[i])) return 1;
    return 0;
}

/* Whether the distance of a row from the others (the pivot is its square) comes to zero in the step from node k on, in a
   straight line from either side. */
INLINE int is_over(const Folds *s, int64_t k) {
    const double *const a = node_at(s, k - 1), *const b = node_at(s, k), *const c = node_at(s, k + 1), *const d = node_at(s, k + 2);
    return (k > 0 && is_seen(a, k - 1) && is_seen(b, k) && 4 * b[1] <= a[1])
           || (is_seen(c, k + 1) && is_seen(d, k + 2) && 4 * c[1] <= d[1]);
}

/* The kind of what there is to note at node k, or −1; `regular`: the rows are as independent as elsewhere. */
INLINE int watch(const Folds *s, const double *q, const double *p, int64_t k, double t0, double h, int regular, const double *w) {
    double *const node = node_at(s, k), *const before = node_at(s, k - (k > 0));
    node[0] = (double)k, node[1] = UNSEEN;
    COPY(node + 2, q, N), COPY(node + 2 + N, p, N);
    if (!KICKED) lengths_of(q, &(double){t0 + h * (double)k}, w, node + 2 + 2 * N);
    const int known = k > 0 && is_kept(before, k - 1), seen = known && is_seen(before, k - 1);
    if (!regular || k % OFTEN == 0 || (seen && (KICKED ? VERY_NEARLY : NEARLY) * before[1] < *s->farthest)) {
        look(s, node, t0 + h * (double)k, w);
        if (!regular && known && !seen) look(s, before, t0 + h * (double)(k - 1), w);
    }
    if (is_lost(s, k)) return ON_FOLD;
    return k > 2 && is_kept(node_at(s, k - 3), k - 3) && is_over(s, k - 3) ? OVER_FOLD : -1;
}

LARGE void note(const Folds *s, int kind, int64_t k, double *to) {
    to[0] = kind;
    for (int i = 0; i < LATELY; i++) COPY(to + 1 + i * NODE_SIZE, s->lately + (k + 1 + i) % LATELY * NODE_SIZE, NODE_SIZE);
}
