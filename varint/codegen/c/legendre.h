/* v(q, p, t) where the momentum dL/dv is not linear in v, by Newton's method
   from the v given, or from rest where that is outside of what L is defined for.

   `legendre` gives what is missing, dL/dv - p, and the correction that a linear dL/dv would need. Where L is defined for some
   v only (relativity) a full correction may leave them; comparisons with what is not a number are false, so it is halved, too.
   At round-off no part of it shrinks what is missing, and v stays. */
INLINE double square_of(const double *x) {
    double sum = 0;
    for (int i = 0; i < N; i++) sum = v_fma(x[i], x[i], sum);
    return sum;
}

LARGE void inverted(const double *q, const double *p, double t, const double *w, double *v) {
    double missing[N], correction[N], trial[N], next[N];
    legendre(v, q, p, &t, w, missing, correction);
    double size = square_of(missing);
    if (!(size < INFINITY)) {
        ZEROS(v, N);
        legendre(v, q, p, &t, w, missing, correction), size = square_of(missing);
    }
    for (int count = 0; count < LEGENDRE_ITERATIONS; count++) {
        double part = 1, left = size;
        int shrinks = 0;
        for (int k = 0; k < HALVINGS && !shrinks; k++, part *= 0.5) {
            for (int i = 0; i < N; i++) trial[i] = v_fnma(part, correction[i], v[i]);
            legendre(trial, q, p, &t, w, missing, next);
            left = square_of(missing), shrinks = left < size;
        }
        if (!shrinks) break;
        size = left, COPY(v, trial, N), COPY(correction, next, N);
    }
}
