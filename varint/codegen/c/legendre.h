/* v(q, p, t) where the momentum dL/dv is not linear in v, by Newton's method
   from the v given, or from rest where that is outside of what L is defined for.

   `legendre` gives what is missing, dL/dv - p, and the correction that a linear dL/dv would need. Where L is defined for some
   v only (relativity) a full correction may leave them; comparisons with what is not a number are false, so it is halved, too.
   At round-off no part of it shrinks what is missing, and v stays. Of vectors all lanes are the same. */
INLINE double square_of(const V *x) {
    V sum = splat(0.0);
    for (int i = 0; i < N; i++) sum = v_fma(x[i], x[i], sum);
    return lane(sum, 0);
}

static __attribute__((noinline)) void inverted(const V *q, const V *p, const V *t, const double *w, V *v) {
    V missing[N], correction[N], trial[N], next[N];
    legendre(v, q, p, t, w, missing, correction);
    double size = square_of(missing);
    if (!(size < INFINITY)) {
        for (int i = 0; i < N; i++) v[i] = splat(0.0);
        legendre(v, q, p, t, w, missing, correction), size = square_of(missing);
    }
    for (int count = 0; count < LEGENDRE_ITERATIONS; count++) {
        double part = 1, left = size;
        int shrinks = 0;
        for (int k = 0; k < HALVINGS && !shrinks; k++, part *= 0.5) {
            for (int i = 0; i < N; i++) trial[i] = v_fnma(splat(part), correction[i], v[i]);
            legendre(trial, q, p, t, w, missing, next);
            left = square_of(missing), shrinks = left < size;
        }
        if (!shrinks) break;
        size = left, memcpy(v, trial, sizeof trial), memcpy(correction, next, sizeof next);
    }
}
