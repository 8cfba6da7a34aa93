/* Vectors of LANES doubles (LANES = 1: plain double) and their elementary functions.

   LANES, a power of two, is defined before this file. Arithmetic is GCC's vector extension (also Clang's); what it lacks is
   an instruction where the machine has one and a loop over the lanes where not. Comparisons give 1.0 and 0.0 as in CasADi. */
#include "intrinsics.h"

#if LANES == 1
typedef double V;
typedef int64_t I;
#else
typedef double V __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
typedef int64_t I __attribute__((vector_size(8 * LANES), aligned(8 * LANES)));
#endif
#define INLINE static inline __attribute__((always_inline, unused))


#if defined(__clang__)
#define RARE static __attribute__((noinline, optnone, unused)) /* a function that is not worth the compiler's time */
#else
#define RARE static __attribute__((noinline, optimize("O0"), unused))
#endif

/* What is written for every operation are macros: an inline function takes the compiler several times as long. */
#if LANES == 1
INLINE V real_of(I x) { V y; memcpy(&y, &x, sizeof y); return y; }
INLINE I bits_of(V x) { I y; memcpy(&y, &x, sizeof y); return y; }
#define splat(x) (x)
#define lane(x, i) (x)
#define set_lane(x, i, y) (*(x) = (y))
#define MASK(comparison) (-(I)(comparison))
#define SPREAD(x, i) (x)
#else
#define real_of(x) ((V)(x))
#define bits_of(x) ((I)(x))
#define splat(x) ((x) - (V){0})
#define lane(x, i) ((x)[i])
#define set_lane(x, i, y) ((*(x))[i] = (y))
#define MASK(comparison) ((I)(comparison))
#if LANES == 8
#define SPREAD(x, i) __builtin_shuffle(x, (I){i, i, i, i, i, i, i, i})
#elif LANES == 4
#define SPREAD(x, i) __builtin_shuffle(x, (I){i, i, i, i})
#else
#define SPREAD(x, i) __builtin_shuffle(x, (I){i, i})
#endif
#if defined(__clang__)
#undef SPREAD
#define SPREAD(x, i) splat((x)[i]) /* one lane in all lanes */
#endif
#endif

/* a b + c with one rounding where the machine has an instruction for it, else with two. Where a product is fused with a
   sum is written down, here and in what is generated, and not left to the compiler: the same numbers on every way. */
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
#define s_fma(a, b, c) __builtin_fma(a, b, c)
#else
#define s_fma(a, b, c) ((a) * (b) + (c))
#endif
#if LANES == 1
#define v_fma(a, b, c) s_fma(a, b, c)
#elif LANES == 8 && defined(__AVX512F__)
#define v_fma(a, b, c) ((V)_mm512_fmadd_pd((__m512d)(a), (__m512d)(b), (__m512d)(c)))
#elif LANES == 4 && defined(__FMA__)
#define v_fma(a, b, c) ((V)_mm256_fmadd_pd((__m256d)(a), (__m256d)(b), (__m256d)(c)))
#elif LANES == 2 && defined(__FMA__)
#define v_fma(a, b, c) ((V)_mm_fmadd_pd((__m128d)(a), (__m128d)(b), (__m128d)(c)))
#elif defined(__FMA__) || defined(__ARM_FEATURE_FMA)
INLINE V v_fma(V a, V b, V c) { for (int i = 0; i < LANES; i++) set_lane(&c, i, __builtin_fma(lane(a, i), lane(b, i), lane(c, i))); return c; }
#else
#define v_fma(a, b, c) ((a) * (b) + (c))
#endif
#define v_fms(a, b, c) v_fma(a, b, -(c)) /* a b - c */
#define v_fnma(a, b, c) v_fma(-(a), b, c) /* c - a b */
#define K(x) splat(x)

#if LANES == 1
#define v_fabs fabs
#define v_copysign copysign
#else
INLINE V v_fabs(V x) { return real_of(bits_of(x) & INT64_MAX); }
INLINE V v_copysign(V x, V y) { return real_of((bits_of(x) & INT64_MAX) | (bits_of(y) & INT64_MIN)); }
#endif
INLINE V choose(I mask, V a, V b) { return real_of((bits_of(a) & mask) | (bits_of(b) & ~mask)); }

#if LANES == 8 && defined(__AVX512F__)
INLINE V v_sqrt(V x) { return (V)_mm512_sqrt_pd((__m512d)x); }
INLINE V v_fmax(V a, V b) { return (V)_mm512_max_pd((__m512d)a, (__m512d)b); }
INLINE V v_fmin(V a, V b) { return (V)_mm512_min_pd((__m512d)a, (__m512d)b); }
INLINE double sum(V x) { return _mm512_reduce_add_pd((__m512d)x); }
INLINE double largest(V x) { return _mm512_reduce_max_pd((__m512d)x); }
INLINE int within(V x, double bound) { /* every lane |x| <= bound; false for NaN */
    return _mm512_cmp_pd_mask((__m512d)v_fabs(x), _mm512_set1_pd(bound), _CMP_LE_OQ) == 0xff;
}
#elif LANES == 4 && defined(__AVX__)
INLINE V v_sqrt(V x) { return (V)_mm256_sqrt_pd((__m256d)x); }
INLINE V v_fmax(V a, V b) { return (V)_mm256_max_pd((__m256d)a, (__m256d)b); }
INLINE V v_fmin(V a, V b) { return (V)_mm256_min_pd((__m256d)a, (__m256d)b); }
INLINE double sum(V x) { return (x[0] + x[2]) + (x[1] + x[3]); }
INLINE double largest(V x) {
    __m128d m = _mm_max_pd(_mm256_castpd256_pd128((__m256d)x), _mm256_extractf128_pd((__m256d)x, 1));
    return _mm_max_pd(m, _mm_unpackhi_pd(m, m))[0];
}
INLINE int within(V x, double bound) {
    return _mm256_movemask_pd(_mm256_cmp_pd((__m256d)v_fabs(x), _mm256_set1_pd(bound), _CMP_LE_OQ)) == 0xf;
}
#else
#if LANES == 1
#define v_sqrt sqrt
INLINE V v_fmax(V a, V b) { return a > b ? a : b; }
INLINE V v_fmin(V a, V b) { return a < b ? a : b; }
#else
INLINE V v_sqrt(V x) { for (int i = 0; i < LANES; i++) set_lane(&x, i, sqrt(lane(x, i))); return x; }
INLINE V v_fmax(V a, V b) { return choose(MASK(a > b), a, b); }
INLINE V v_fmin(V a, V b) { return choose(MASK(a < b), a, b); }
#endif
INLINE double sum(V x) { double s = 0; for (int i = 0; i < LANES; i++) s += lane(x, i); return s; }
INLINE double largest(V x) { double m = lane(x, 0); for (int i = 1; i < LANES; i++) if (lane(x, i) > m) m = lane(x, i); return m; }
INLINE int within(V x, double bound) { int y = 1; for (int i = 0; i < LANES; i++) y &= fabs(lane(x, i)) <= bound; return y; }
#endif

/* turned[r] = x with lane i taken from lane i ^ r */
#if LANES == 8 && defined(__AVX512F__)
#define BLOCKS(x, order) (V)_mm512_shuffle_f64x2((__m512d)(x), (__m512d)(x), order)
#define NEIGHBOURS(x) (V)_mm512_permute_pd((__m512d)(x), 0x55)
INLINE void turned_lanes(V x, V *turned) {
    turned[0] = x, turned[2] = BLOCKS(x, 0xb1), turned[4] = BLOCKS(x, 0x4e), turned[6] = BLOCKS(x, 0x1b);
    turned[1] = NEIGHBOURS(x), turned[3] = NEIGHBOURS(turned[2]), turned[5] = NEIGHBOURS(turned[4]), turned[7] = NEIGHBOURS(turned[6]);
}
#elif LANES == 4 && defined(__AVX__)
INLINE void turned_lanes(V x, V *turned) {
    turned[0] = x, turned[2] = (V)_mm256_permute2f128_pd((__m256d)x, (__m256d)x, 1);
    turned[1] = (V)_mm256_permute_pd((__m256d)x, 5), turned[3] = (V)_mm256_permute_pd((__m256d)turned[2], 5);
}
#else
INLINE void turned_lanes(V x, V *turned) {
    for (int r = 0; r < LANES; r++)
        for (int i = 0; i < LANES; i++) set_lane(&turned[r], i, lane(x, i ^ r));
}
#endif

/* The sum over the lanes, in all lanes. */
#if LANES == 8 && defined(__AVX512F__)
INLINE V in_all_lanes(V x) { x += BLOCKS(x, 0x4e), x += BLOCKS(x, 0xb1); return x + NEIGHBOURS(x); }
#else
INLINE V in_all_lanes(V x) { return splat(sum(x)); }
#endif

/* The sums over the lanes of `count` vectors, LANES of them at a time by a tree of shuffles. */
#if LANES > 1
#if defined(__clang__)
#define SHUFFLE2(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define SHUFFLE2(a, b, ...) __builtin_shuffle(a, b, (I){__VA_ARGS__})
#endif
#endif
INLINE void row_sums(const V *rows, int count, double *out) {
    for (int r = 0; r < count; r += LANES) {
        const int n = count - r < LANES ? count - r : LANES;
        V s[LANES];
        for (int i = 0; i < LANES; i++) s[i] = i < n ? rows[r + i] : splat(0.0);
#if LANES == 8
        for (int i = 0; i < 8 && i < n; i += 2)
            s[i] = SHUFFLE2(s[i], s[i + 1], 0, 8, 2, 10, 4, 12, 6, 14) + SHUFFLE2(s[i], s[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
        for (int i = 0; i < 8 && i < n; i += 4)
            s[i] = SHUFFLE2(s[i], s[i + 2], 0, 1, 8, 9, 4, 5, 12, 13) + SHUFFLE2(s[i], s[i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        s[0] = SHUFFLE2(s[0], s[4], 0, 1, 2, 3, 8, 9, 10, 11) + SHUFFLE2(s[0], s[4], 4, 5, 6, 7, 12, 13, 14, 15);
#elif LANES == 4
        for (int i = 0; i < 4 && i < n; i += 2) s[i] = SHUFFLE2(s[i], s[i + 1], 0, 4, 2, 6) + SHUFFLE2(s[i], s[i + 1], 1, 5, 3, 7);
        s[0] = SHUFFLE2(s[0], s[2], 0, 1, 4, 5) + SHUFFLE2(s[0], s[2], 2, 3, 6, 7);
#elif LANES == 2
        s[0] = SHUFFLE2(s[0], s[1], 0, 2) + SHUFFLE2(s[0], s[1], 1, 3);
#endif
        for (int i = 0; i < n; i++) out[r + i] = lane(s[0], i);
    }
}

/* 1 / sqrt(x); with MANY_ROOTS their number counts, not their latency */
#define v_rsqrt_exact(x) (1.0 / v_sqrt(x))
#if LANES == 8 && defined(__AVX512F__)
INLINE V v_rsqrt_iterated(V x) { /* 14 bits by instruction, then one step of fourth order: cheaper than sqrt and / */
    V y = (V)_mm512_rsqrt14_pd((__m512d)x), e = v_fnma(x * y, y, K(1.0));
    return v_fma(y * e, v_fma(e, v_fma(K(0.3125), e, K(0.375)), K(0.5)), y);
}
#else
#define v_rsqrt_iterated v_rsqrt_exact
#endif
#ifdef MANY_ROOTS
#define v_rsqrt v_rsqrt_iterated
#else
#define v_rsqrt v_rsqrt_exact
#endif

/* sin, cos and exp in line, to about one unit in the last place: a call would spill every vector register. Reduction by
   a two-part constant needs fused multiply-adds and |x| < REDUCED; beyond, the C library lane by lane. The polynomials are
   minimax (Remez, 60 digits), their own errors below 0.15 units in the last place. */
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
#define REDUCED 1e6
#define FAR(f) \
    static __attribute__((noinline, cold, unused)) V far_##f(V x) { for (int i = 0; i < LANES; i++) set_lane(&x, i, f(lane(x, i))); return x; }
FAR(sin) FAR(cos) FAR(exp) /* not in line: written out at every call they took the compiler longer than the polynomials */
#define ROUNDER 6755399441055744.0 /* 1.5 * 2^52: adding it rounds to an integer, kept in the low bits */
INLINE V odd_sine(V r) { /* sin(r), |r| <= pi / 2 */
    V z = r * r, z2 = z * z, z4 = z2 * z2;
    V a = v_fma(K(0x1.11111111110cbp-7), z, K(-0x1.5555555555555p-3)), b = v_fma(K(0x1.71de3a52c11bap-19), z, K(-0x1.a01a01a01517ap-13));
    V c = v_fma(K(0x1.6123d13eb7a13p-33), z, K(-0x1.ae6454e484ba4p-26)), d = v_fma(K(0x1.885157360d771p-49), z, K(-0x1.ae44a43450780p-41));
    return v_fma(r * z, v_fma(v_fma(d, z2, c), z4, v_fma(b, z2, a)), r);
}
INLINE V v_sin(V x) {
    if (__builtin_expect(!within(x, REDUCED), 0)) return far_sin(x);
    V n = v_fma(x, K(0x1.45f306dc9c883p-2), K(ROUNDER)), k = n - ROUNDER;
    V r = v_fnma(k, K(0x1.1a62633145c07p-53), v_fnma(k, K(0x1.921fb54442d18p+1), x));
    return real_of(bits_of(odd_sine(r)) ^ (bits_of(n) << 63));
}
INLINE V v_cos(V x) { /* sin(x + pi / 2), reduced to the nearest odd multiple of pi / 2 */
    if (__builtin_expect(!within(x, REDUCED), 0)) return far_cos(x);
    V n = v_fma(x, K(0x1.45f306dc9c883p-2), K(-0.5)) + ROUNDER, k = (n - ROUNDER) + 0.5;
    V r = v_fnma(k, K(0x1.1a62633145c07p-53), v_fnma(k, K(0x1.921fb54442d18p+1), x));
    return real_of(bits_of(odd_sine(r)) ^ (~bits_of(n) << 63));
}
INLINE void near_sincos(V x, V *sine, V *cosine) { /* |x| <= REDUCED */
    V n = v_fma(x, K(0x1.45f306dc9c883p-1), K(ROUNDER)), k = n - ROUNDER;
    V r = v_fnma(k, K(0x1.1a62633145c07p-54), v_fnma(k, K(0x1.921fb54442d18p+0), x));
    V z = r * r, z2 = z * z, z4 = z2 * z2;
    V a = v_fma(K(0x1.111111110f87ap-7), z, K(-0x1.5555555555549p-3)), b = v_fma(K(0x1.71de3577b69e7p-19), z, K(-0x1.a01a019c11996p-13));
    V c = v_fma(K(0x1.5d9300fbbf4b8p-33), z, K(-0x1.ae5e663a90a1fp-26));
    V s = v_fma(r * z, v_fma(c, z4, v_fma(b, z2, a)), r);
    a = v_fma(K(-0x1.6c16c16c1517ep-10), z, K(0x1.555555555554cp-5)), b = v_fma(K(-0x1.27e4f809f06a1p-22), z, K(0x1.a01a019cb1bd7p-16));
    c = v_fma(K(-0x1.8fae9c618cbaap-37), z, K(0x1.1ee9ebe905c6bp-29));
    V w = 0.5 * z, one = 1.0 - w;
    V u = one + v_fma(z2, v_fma(c, z4, v_fma(b, z2, a)), (1.0 - one) - w);
    I quadrant = bits_of(n), swap = -(quadrant & 1);
    *sine = real_of(bits_of(choose(swap, u, s)) ^ ((quadrant & 2) << 62));
    *cosine = real_of(bits_of(choose(swap, s, u)) ^ (((quadrant + 1) & 2) << 62));
}
INLINE void v_sincos(V x, V *sine, V *cosine) {
    if (__builtin_expect(!within(x, REDUCED), 0)) *sine = far_sin(x), *cosine = far_cos(x);
    else near_sincos(x, sine, cosine);
}
INLINE V v_exp(V x) {
    if (__builtin_expect(!within(x, 708.0), 0)) return far_exp(x);
    V n = v_fma(x, K(0x1.71547652b82fep+0), K(ROUNDER)), k = n - ROUNDER;
    V r = v_fnma(k, K(0x1.abc9e3b39803fp-56), v_fnma(k, K(0x1.62e42fefa39efp-1), x));
    V z = r * r, z2 = z * z, z4 = z2 * z2;
    V a = v_fma(K(0x1.5555555555558p-3), r, K(0x1.0000000000001p-1)), b = v_fma(K(0x1.111111110f7fep-7), r, K(0x1.5555555553d5dp-5));
    V c = v_fma(K(0x1.a01a01b00ed39p-13), r, K(0x1.6c16c1788df5ap-10)), d = v_fma(K(0x1.71ddf6ac82ce1p-19), r, K(0x1.a019b905137b0p-16));
    V e = v_fma(K(0x1.af6338bdbc1abp-26), r, K(0x1.28918ee6f26b9p-22));
    V y = 1.0 + v_fma(z, v_fma(e, z4, v_fma(v_fma(d, z, c), z2, v_fma(b, z, a))), r);
    return real_of(bits_of(y) + (bits_of(n) << 52));
}
#else
#define LIBRARY_SINCOS
#endif

/* The rest: the C library's vector functions where it has them, else lane by lane. */
#define EACH1(f, g) INLINE V v_##f(V x) { for (int i = 0; i < LANES; i++) set_lane(&x, i, g(lane(x, i))); return x; }
#define EACH2(f, g) INLINE V v_##f(V x, V y) { for (int i = 0; i < LANES; i++) set_lane(&x, i, g(lane(x, i), lane(y, i))); return x; }
#if defined(__x86_64__) && defined(__GLIBC__) && !defined(NO_LIBMVEC)
#if LANES == 8 && defined(__AVX512F__)
#define LIBMVEC(f) _ZGVeN8v_##f
#define LIBMVEC2(f) _ZGVeN8vv_##f
#elif LANES == 4 && defined(__AVX2__)
#define LIBMVEC(f) _ZGVdN4v_##f
#define LIBMVEC2(f) _ZGVdN4vv_##f
#elif LANES == 2
#define LIBMVEC(f) _ZGVbN2v_##f
#define LIBMVEC2(f) _ZGVbN2vv_##f
#endif
#endif
#ifdef LIBMVEC
#define VECTOR1(f) V LIBMVEC(f)(V); INLINE V v_##f(V x) { return LIBMVEC(f)(x); }
#define VECTOR2(f) V LIBMVEC2(f)(V, V); INLINE V v_##f(V x, V y) { return LIBMVEC2(f)(x, y); }
#else
#define VECTOR1(f) EACH1(f, f)
#define VECTOR2(f) EACH2(f, f)
#endif
#ifdef LIBMVEC
#if __GLIBC_PREREQ(2, 35) && !defined(NO_NEWER_FUNCTIONS)
#define NEWER_FUNCTIONS 1
#define NEWER1(f) VECTOR1(f)
#define NEWER2(f) VECTOR2(f)
#endif
#endif
#ifndef NEWER1
#define NEWER_FUNCTIONS 0
#define NEWER1(f) EACH1(f, f)
#define NEWER2(f) EACH2(f, f)
#endif
#ifdef LIBRARY_SINCOS
VECTOR1(sin) VECTOR1(cos) VECTOR1(exp)
INLINE void v_sincos(V x, V *sine, V *cosine) { *sine = v_sin(x), *cosine = v_cos(x); }
#endif
VECTOR1(log) VECTOR2(pow)
NEWER1(tan) NEWER1(asin) NEWER1(acos) NEWER1(atan) NEWER1(sinh) NEWER1(cosh) NEWER1(tanh) NEWER1(asinh) NEWER1(acosh)
NEWER1(atanh) NEWER1(erf) NEWER1(expm1) NEWER1(log1p) NEWER2(atan2) NEWER2(hypot)
EACH1(floor, floor) EACH1(ceil, ceil) EACH2(fmod, fmod) EACH2(remainder, remainder)

INLINE V truth(I mask) { return real_of(mask & bits_of(splat(1.0))); }
INLINE V v_lt(V a, V b) { return truth(MASK(a < b)); }
INLINE V v_le(V a, V b) { return truth(MASK(a <= b)); }
INLINE V v_eq(V a, V b) { return truth(MASK(a == b)); }
INLINE V v_ne(V a, V b) { return truth(MASK(a != b)); }
INLINE V v_not(V a) { return truth(MASK(a == 0.0)); }
INLINE V v_and(V a, V b) { return truth(MASK(a != 0.0) & MASK(b != 0.0)); }
INLINE V v_or(V a, V b) { return truth(MASK(a != 0.0) | MASK(b != 0.0)); }
INLINE V v_if_else_zero(V a, V b) { return real_of(MASK(a != 0.0) & bits_of(b)); }
INLINE V v_sign(V a) { return truth(MASK(a > 0.0)) - truth(MASK(a < 0.0)); }

/* The same for one number: what depends on the parameters alone is computed once a run. */
INLINE double s_lt(double a, double b) { return a < b; }
INLINE double s_le(double a, double b) { return a <= b; }
INLINE double s_eq(double a, double b) { return a == b; }
INLINE double s_ne(double a, double b) { return a != b; }
INLINE double s_not(double a) { return !(a != 0.0); }
INLINE double s_and(double a, double b) { return a != 0.0 && b != 0.0; }
INLINE double s_or(double a, double b) { return a != 0.0 || b != 0.0; }
INLINE double s_if_else_zero(double a, double b) { return a != 0.0 ? b : 0.0; }
INLINE double s_sign(double a) { return (a > 0.0) - (a < 0.0); }
INLINE double s_rsqrt(double a) { return 1.0 / sqrt(a); }
#define s_fmin(a, b) ((a) < (b) ? (a) : (b))
#define s_fmax(a, b) ((a) > (b) ? (a) : (b))
#define s_sqrt sqrt
#define s_fabs fabs
#define s_copysign copysign
#define s_sin sin
#define s_cos cos
#define s_tan tan
#define s_asin asin
#define s_acos acos
#define s_atan atan
#define s_sinh sinh
#define s_cosh cosh
#define s_tanh tanh
#define s_asinh asinh
#define s_acosh acosh
#define s_atanh atanh
#define s_exp exp
#define s_log log
#define s_erf erf
#define s_expm1 expm1
#define s_log1p log1p
#define s_pow pow
#define s_atan2 atan2
#define s_hypot hypot
#define s_fmod fmod
#define s_remainder remainder
#define s_floor floor
#define s_ceil ceil
