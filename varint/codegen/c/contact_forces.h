/* What holds: accelerations and multipliers, and when a contact lets go: a part of contacts.c. */

/* The equations M y - W' m = b, W y = c of all that holds, factorised; scaled as `saddle` in held.py. 0 where they
   are not regular. */
static int factorise(Work *x) {
    const int held = (int)x->held[0], all = N + held;
    double *const f = x->factors, *const size = x->size, largest = 0;
    for (int d = 0; d < N; d++) size[d] = sqrt(fabs(x->mass[d * N + d])), largest = fmax(largest, size[d]);
    for (int d = 0; d < N; d++) size[d] = size[d] > 0 ? size[d] : largest;
    memset(f, 0, (size_t)(all * all) * sizeof(double));
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) f[i * all + j] = x->mass[j * N + i] / (size[i] * size[j]);
    for (int j = 0; j < held; j++) {
        const double *const row = HELD_ROW(j);
        double square = 0;
        for (int d = 0; d < N; d++) square += row[d] / size[d] * (row[d] / size[d]);
        size[N + j] = square > 0 ? sqrt(square) : 1;
        for (int d = 0; d < N; d++) f[(N + j) * all + d] = row[d] / size[d] / size[N + j], f[d * all + N + j] = -f[(N + j) * all + d];
    }
    for (int c = 0; c < all; c++) {
        int best = c;
        for (int r = c + 1; r < all; r++)
            if (fabs(f[r * all + c]) > fabs(f[best * all + c])) best = r;
        x->pivots[c] = best;
        if (!(fabs(f[best * all + c]) > REGULAR)) return 0;
        for (int j = c; j < all && best != c; j++) { /* factors stay in their rows: `substitute` swaps as it goes */
            const double y = f[c * all + j];
            f[c * all + j] = f[best * all + j], f[best * all + j] = y;
        }
        for (int r = c + 1; r < all; r++) {
            const double y = f[r * all + c] /= f[c * all + c];
            for (int j = c + 1; j < all && y != 0; j++) f[r * all + j] -= y * f[c * all + j];
        }
    }
    return 1;
}

static void substitute(const Work *x, double *b) {
    const int all = N + (int)x->held[0];
    const double *const f = x->factors;
    for (int i = 0; i < all; i++) b[i] /= x->size[i];
    for (int i = 0; i < all; i++) {
        const double y = b[x->pivots[i]];
        b[x->pivots[i]] = b[i], b[i] = y;
        for (int r = i + 1; r < all; r++) b[r] -= f[r * all + i] * y;
    }
    for (int i = all - 1; i >= 0; i--) {
        for (int j = i + 1; j < all; j++) b[i] -= f[i * all + j] * b[j];
        b[i] /= f[i * all + i];
    }
    for (int i = 0; i < all; i++) b[i] /= x->size[i];
}

/* Accelerations, and behind them the multipliers of what holds; after `view` and `factorise`. */
static void accelerate(const Work *x, double *b) {
    COPY(b, x->force, N);
    for (int j = 0; j < x->held[0]; j++) b[N + j] = -x->bend[HELD(j)];
    substitute(x, b);
}

/* Forces that move other bodies: a push that is little beside them is none. */
static double hardly(const Work *x, const double *acceleration) {
    double most = 0;
    for (int d = 0; d < N; d++) {
        double force = 0;
        for (int k = 0; k < N; k++) force += x->mass[k * N + d] * acceleration[k];
        most = fmax(most, NEAR * fabs(force));
    }
    return most;
}

/* Whether a contact that holds would pull at an instant. */
static int lets_go(Work *x, const double *point, double t) {
    const int64_t held = x->held[0];
    double acceleration[N + held], least = 0;
    if (!held || HELD(held - 1) < FIRST) return 0;
    view(x, point, t);
    if (!factorise(x)) return 1;
    accelerate(x, acceleration);
    double most = hardly(x, acceleration);
    for (int j = 0; j < held; j++) {
        const double push = acceleration[N + j];
        most = fmax(most, fabs(push));
        if (HELD(j) >= FIRST) least = fmin(least, push);
    }
    return !(least >= -PULL * most);
}

/* Multiplier of the row that holds as number j at an instant, and what is nothing beside other forces; no number where the rows
   are not regular. */
static double push_of(Work *x, const double *point, double t, int j, double *nothing) {
    double acceleration[N + x->held[0]];
    view(x, point, t);
    if (!factorise(x)) return 0 * INFINITY;
    accelerate(x, acceleration);
    *nothing = PULL * hardly(x, acceleration);
    return acceleration[N + j];
}

/* When the contact that holds as number j begins to pull; see `release_time` in gaps.py and `find_root` in roots.py. */
static int release_time(Work *x, const double *from, double t, const double *end, int j, double *at) {
    double nothing, a = 0, b = end[0], fb = push_of(x, end, t + b, j, &nothing), fa;
    if (!(fb < -nothing)) return NONE;
    fa = push_of(x, from, t, j, &nothing), x->looks = 0;
    if (fa != fa) return DOUBT;
    COPY(at, from, POINT), at[0] = 0;
    if (!(fa > 0)) return LEAVES;
    const double tolerance = LOCATED * fabs(b);
    for (int k = 0; k < ROOT_ITERATIONS; k++) {
        double c = b - fb * (b - a) / (fb - fa);
        if (!(fmin(a, b) < c && c < fmax(a, b))) c = (a + b) / 2;
        if (!ahead_by(x, from, t, c, at)) return DOUBT;
        const double fc = push_of(x, at, t + c, j, &nothing);
        if (fc != fc) return DOUBT;
        if (fc == 0 || fabs(b - a) <= tolerance) break;
        if (fc * fb < 0) a = b, fa = fb;
        else fa /= 2;
        b = c, fb = fc;
        if (fabs(b - a) <= tolerance) break;
    }
    return LEAVES;
}

/* The first of the contacts that hold to let go in a step, as its number there, and the instant. */
static int first_release(Work *x, const double *from, double t, const double *end, double *at, int *first) {
    double instant[POINT];
    int found = NONE;
    for (int j = 0; j < x->held[0]; j++) {
        if (HELD(j) < FIRST) continue;
        const int lets = release_time(x, from, t, end, j, instant);
        if (lets == DOUBT) return DOUBT;
        if (lets == LEAVES && (!found || instant[0] < at[0])) COPY(at, instant, POINT), found = LEAVES, *first = j;
    }
    return found ? found : DOUBT;
}
