/* v(q, p, t) where the momentum dL/dv is not linear in v, by Newton's method
   from the v given, or from rest where that is outside of what L is defined for; where there is no inertia, as with v^4 at
   rest, from the multiple of p by a power of 4 whose momentum is nearest to p (varint/discrete/legendre.py).

   `legendre` gives what is missing, dL/dv - p, and the correction that a linear dL/dv would need. Where L is defined for some
   v only (relativity) a full correction may leave them; comparisons with what is not a number are false, so it is halved, too.
   At round-off no part of it shrinks what is missing, and v stays; so it does at rest where inertia is infinite there, as that
   of powers of sqrt(v.Gv), with much missing, which is no end. Of vectors all lanes are the same. */
#define SOLVED 1e-20 /* of p^2: less is round-off */
INLINE double square_of(const V *x) {
    V sum = splat(0.0);
    for (int i = 0; i < N; i++) sum = v_fma(x[i], x[i], sum);
    return lane(sum, 0);
}

static __attribute__((noinline)) void begin_along(const V *q, const V *p, const V *t, const double *w, V *v) {
    V missing[N], correction[N], trial[N];
    double best = INFINITY;
    for (int power = -20; power <= 20; power++) {
        for (int i = 0; i < N; i++) trial[i] = splat(ldexp(1.0, 2 * power)) * p[i];
        legendre(trial, q, p, t, w, missing, correction);
        const double size = square_of(missing);
        if (size < best) best = size, memcpy(v, trial, sizeof trial);
    }
}

/* Newton's method; 0 where its first correction shrinks nothing. */
static int improved(const V *q, const V *p, const V *t, const double *w, V *v, V *correction, double size) {
    V missing[N], trial[N], next[N];
    for (int count = 0; count < LEGENDRE_ITERATIONS; count++) {
        double part = 1, left = size;
        int shrinks = 0;
        for (int k = 0; k < HALVINGS && !shrinks; k++, part *= 0.5) {
            for (int i = 0; i < N; i++) trial[i] = v_fnma(splat(part), correction[i], v[i]);
            legendre(trial, q, p, t, w, missing, next);
            left = square_of(missing), shrinks = left < size;
        }
        if (!shrinks) return count > 0;
        size = left, memcpy(v, trial, sizeof trial), memcpy(correction, next, sizeof next);
    }
    return 1;
}

static __attribute__((noinline)) void inverted(const V *q, const V *p, const V *t, const double *w, V *v) {
    V missing[N], correction[N];
    legendre(v, q, p, t, w, missing, correction);
    double size = square_of(missing);
    if (!(size < INFINITY)) {
        for (int i = 0; i < N; i++) v[i] = splat(0.0);
        legendre(v, q, p, t, w, missing, correction), size = square_of(missing);
    }
    if (square_of(correction) < INFINITY && (improved(q, p, t, w, v, correction, size) || size <= SOLVED * square_of(p))) return;
    begin_along(q, p, t, w, v);
    legendre(v, q, p, t, w, missing, correction);
    improved(q, p, t, w, v, correction, square_of(missing));
}
