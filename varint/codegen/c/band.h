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

/* x before the numbers of y, whose last one leaves it; and the last one of x before them. */
#if defined(__clang__)
#define LAST_BEFORE(x, y) __builtin_shufflevector(x, y, 7, 8, 9, 10, 11, 12, 13, 14)
#else
typedef int64_t ChunkPlaces __attribute__((vector_size(64)));
#define LAST_BEFORE(x, y) __builtin_shuffle(x, y, (ChunkPlaces){7, 8, 9, 10, 11, 12, 13, 14})
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

/* What is known of b behind row c: x of the rows c + 1 to c + reach. The last `chunks` vectors of it stay in registers: out of
   memory they would have to wait until their numbers have come there one by one. */
INLINE void substitute_back(const int n, const int below, const int chunks, const double *a, double *b) {
    const int width = below + 8 * chunks;
    Chunk behind[chunks];
    for (int k = 0; k < chunks; k++) behind[k] = (Chunk){0};
    for (int c = n - 1; c >= 0; c--) {
        const double *const row = a + c * (width + 1) + below;
        const int right = least(8 * chunks, n - 1 - c);
        Chunk parts = {0};
        for (int k = 0; k < chunks && 8 * k < right; k++) parts = chunks_fma(AT_CHUNK(row, 1 + 8 * k), behind[k], parts);
        const double x = b[c] - (((parts[0] + parts[1]) + (parts[2] + parts[3])) + ((parts[4] + parts[5]) + (parts[6] + parts[7])));
        b[c] = x * row[0];
        for (int k = chunks - 1; k > 0; k--) behind[k] = LAST_BEFORE(behind[k - 1], behind[k]);
        behind[0] = LAST_BEFORE((Chunk)(b[c] - (Chunk){0}), behind[0]);
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
    if (reach == 8) substitute_back(n, below, 1, a, b);
    else if (reach == 16) substitute_back(n, below, 2, a, b);
    else if (reach == 24) substitute_back(n, below, 3, a, b);
    else if (reach == 32) substitute_back(n, below, 4, a, b);
    else if (reach == 40) substitute_back(n, below, 5, a, b);
    else if (reach == 48) substitute_back(n, below, 6, a, b);
    else for (int c = n - 1; c >= 0; c--) {
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
