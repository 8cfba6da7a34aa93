/* Band matrices: element (i, j) at i (below + reach) + below + j, where row exchanges need a reach of below + above; it is
   rounded up to whole chunks, whose zeros stay zeros. Rows of zeros follow the last one. */
typedef double Chunk __attribute__((vector_size(64), aligned(8), may_alias));
#define IN_CHUNKS(reach) ((reach) % 8 == 0)
#define AT_CHUNK(x, j) (*(Chunk *)((x) + (j)))
#if defined(__AVX512F__)
INLINE Chunk chunk_fma(double f, Chunk x, Chunk y) { /* f x + y */
    return (Chunk)_mm512_fmadd_pd((__m512d)(f - (Chunk){0}), (__m512d)x, (__m512d)y);
}
INLINE Chunk chunks_fma(Chunk f, Chunk x, Chunk y) { return (Chunk)_mm512_fmadd_pd((__m512d)f, (__m512d)x, (__m512d)y); }
#else
INLINE Chunk chunk_fma(double f, Chunk x, Chunk y) { for (int i = 0; i < 8; i++) y[i] = v_fma(f, x[i], y[i]); return y; }
INLINE Chunk chunks_fma(Chunk f, Chunk x, Chunk y) { for (int i = 0; i < 8; i++) y[i] = v_fma(f[i], x[i], y[i]); return y; }
#endif

INLINE int least(int a, int b) { return a < b ? a : b; }

/* LU with row exchanges, in place; multipliers stay below the diagonal, reciprocals on it. */
INLINE void factorise(const int n, const int below, const int reach, double *a, int *pivots) {
    const int width = below + reach;
    for (int c = 0; c < n; c++) {
        double *const row = a + c * (width + 1) + below;
        const int down = least(below, n - 1 - c), right = least(reach, n - 1 - c);
        int best = 0;
        double most = fabs(row[0]);
        for (int r = 1; r <= down; r++) {
            const double size = fabs(row[r * width]);
            if (size > most) most = size, best = r;
        }
        pivots[c] = c + best;
        if (best)
            for (int j = 0; j <= right; j++) {
                double *const other = row + best * width + j, x = row[j];
                row[j] = *other, *other = x;
            }
        const double inverse = row[0] = 1 / row[0];
        for (int r = 1; r <= down; r++) {
            double *const other = row + r * width;
            if (other[0] != 0) {
                const double f = other[0] *= inverse;
                if (IN_CHUNKS(reach))
                    for (int j = 1; j <= right; j += 8) AT_CHUNK(other, j) = chunk_fma(-f, AT_CHUNK(row, j), AT_CHUNK(other, j));
                else
                    for (int j = 1; j <= reach; j++) other[j] = v_fnma(f, row[j], other[j]);
            }
        }
    }
}

/* b has room for `reach` zeros behind its end. */
INLINE void substitute(const int n, const int below, const int reach, const double *a, const int *pivots, double *b) {
    const int width = below + reach;
    for (int c = 0; c < n; c++) {
        const double *const row = a + c * (width + 1) + below, x = b[pivots[c]];
        const int down = least(below, n - 1 - c);
        b[pivots[c]] = b[c], b[c] = x;
        for (int r = 1; r <= down; r++) b[c + r] = v_fnma(row[r * width], x, b[c + r]);
    }
    for (int c = n - 1; c >= 0; c--) {
        const double *const row = a + c * (width + 1) + below;
        const int right = least(reach, n - 1 - c);
        double x = b[c];
        if (IN_CHUNKS(reach)) {
            Chunk parts = {0};
            for (int j = 1; j <= right; j += 8) parts = chunks_fma(AT_CHUNK(row, j), AT_CHUNK(b + c, j), parts);
            x -= ((parts[0] + parts[1]) + (parts[2] + parts[3])) + ((parts[4] + parts[5]) + (parts[6] + parts[7]));
        } else {
            for (int j = 1; j <= reach; j++) x = v_fnma(row[j], b[c + j], x);
        }
        b[c] = x * row[0];
    }
}

/* The transposed system; b is solved for in place, without the order that `substitute` has of it. */
INLINE void substitute_transposed(const int n, const int below, const int reach, const double *a, const int *pivots, double *b) {
    const int width = below + reach;
    for (int c = 0; c < n; c++) {
        const double *const row = a + c * (width + 1) + below, x = b[c] *= row[0];
        const int right = least(reach, n - 1 - c);
        for (int j = 1; j <= right; j++) b[c + j] -= row[j] * x;
    }
    for (int c = n - 1; c >= 0; c--) {
        const double *const row = a + c * (width + 1) + below;
        const int down = least(below, n - 1 - c);
        double x = b[c];
        for (int r = 1; r <= down; r++) x -= row[r * width] * b[c + r];
        b[c] = b[pivots[c]], b[pivots[c]] = x;
    }
}
