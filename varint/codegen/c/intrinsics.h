/* What lanes.h needs of the system: integers, functions of the C library, and the few vector instructions that C has no
   operators for.

   The system's headers say the same, and take the compiler longer than the rest of a kernel: immintrin.h alone 0.35 s. With GCC
   the instructions are its builtins, under the names of immintrin.h; SYSTEM_HEADERS asks for the headers, where a compiler
   does not know these. */
#if defined(__linux__)
#include <features.h> /* which C library, and its version */
#endif

#if defined(SYSTEM_HEADERS)
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#else
typedef __SIZE_TYPE__ size_t;
typedef __INT32_TYPE__ int32_t;
typedef __INT64_TYPE__ int64_t;
#define INT64_MAX __INT64_MAX__
#define INT64_MIN (-INT64_MAX - 1)
#define INFINITY __builtin_inf()
void *memcpy(void *, const void *, __SIZE_TYPE__), *memset(void *, int, __SIZE_TYPE__), *malloc(__SIZE_TYPE__);
void *aligned_alloc(__SIZE_TYPE__, __SIZE_TYPE__), *calloc(__SIZE_TYPE__, __SIZE_TYPE__);
void free(void *);
int memcmp(const void *, const void *, __SIZE_TYPE__);
double sqrt(double), fabs(double), copysign(double, double), fmin(double, double), fmax(double, double);
double sin(double), cos(double), tan(double), asin(double), acos(double), atan(double), atan2(double, double);
double sinh(double), cosh(double), tanh(double), asinh(double), acosh(double), atanh(double);
double exp(double), expm1(double), log(double), log1p(double), pow(double, double), erf(double), hypot(double, double);
double floor(double), ceil(double), ldexp(double, int), fma(double, double, double), fmod(double, double), remainder(double, double);
#endif

#if defined(__x86_64__) && defined(__AVX__)
#if !defined(__GNUC__) || defined(__clang__) || defined(SYSTEM_HEADERS)
#include <immintrin.h>
#else
typedef double __m128d __attribute__((vector_size(16), may_alias));
typedef double __m256d __attribute__((vector_size(32), may_alias));
#define _CMP_LE_OQ 18
#define _mm_max_pd(a, b) __builtin_ia32_maxpd(a, b)
#define _mm_unpackhi_pd(a, b) __builtin_ia32_unpckhpd(a, b)
#define _mm256_sqrt_pd(a) __builtin_ia32_sqrtpd256(a)
#define _mm256_max_pd(a, b) __builtin_ia32_maxpd256(a, b)
#define _mm256_min_pd(a, b) __builtin_ia32_minpd256(a, b)
#define _mm256_castpd256_pd128(a) __builtin_ia32_vextractf128_pd256(a, 0)
#define _mm256_extractf128_pd(a, which) __builtin_ia32_vextractf128_pd256(a, which)
#define _mm256_set1_pd(x) ((__m256d){x, x, x, x})
#define _mm256_cmp_pd(a, b, how) __builtin_ia32_cmppd256(a, b, how)
#define _mm256_movemask_pd(a) __builtin_ia32_movmskpd256(a)
#define _mm256_permute2f128_pd(a, b, order) __builtin_ia32_vperm2f128_pd256(a, b, order)
#define _mm256_permute_pd(a, order) __builtin_ia32_vpermilpd256(a, order)
#if defined(__FMA__)
#define _mm_fmadd_pd(a, b, c) __builtin_ia32_vfmaddpd(a, b, c)
#define _mm256_fmadd_pd(a, b, c) __builtin_ia32_vfmaddpd256(a, b, c)
#endif
#if defined(__AVX512F__)
typedef double __m512d __attribute__((vector_size(64), may_alias));
#define EVERY_LANE ((__m512d){0}), ((unsigned char)-1)
#define _mm512_fmadd_pd(a, b, c) __builtin_ia32_vfmaddpd512_mask(a, b, c, (unsigned char)-1, 4)
#define _mm512_sqrt_pd(a) __builtin_ia32_sqrtpd512_mask(a, EVERY_LANE, 4)
#define _mm512_max_pd(a, b) __builtin_ia32_maxpd512_mask(a, b, EVERY_LANE, 4)
#define _mm512_min_pd(a, b) __builtin_ia32_minpd512_mask(a, b, EVERY_LANE, 4)
#define _mm512_rsqrt14_pd(a) __builtin_ia32_rsqrt14pd512_mask(a, EVERY_LANE)
#define _mm512_shuffle_f64x2(a, b, order) __builtin_ia32_shuf_f64x2_mask(a, b, order, EVERY_LANE)
#define _mm512_permute_pd(a, order) __builtin_ia32_vpermilpd512_mask(a, order, EVERY_LANE)
#define _mm512_set1_pd(x) ((__m512d){x, x, x, x, x, x, x, x})
#define _mm512_cmp_pd_mask(a, b, how) ((unsigned char)__builtin_ia32_cmppd512_mask(a, b, how, (unsigned char)-1, 4))
#define HALF(a, which) __builtin_ia32_extractf64x4_mask(a, which, ((__m256d){0}), (unsigned char)-1)
static inline __attribute__((always_inline, unused)) double _mm512_reduce_add_pd(__m512d a) {
    __m256d four = HALF(a, 1) + HALF(a, 0);
    __m128d two = _mm256_extractf128_pd(four, 1) + _mm256_extractf128_pd(four, 0);
    return two[0] + two[1];
}
static inline __attribute__((always_inline, unused)) double _mm512_reduce_max_pd(__m512d a) {
    __m256d four = _mm256_max_pd(HALF(a, 1), HALF(a, 0));
    __m128d two = _mm_max_pd(_mm256_extractf128_pd(four, 1), _mm256_extractf128_pd(four, 0));
    return _mm_max_pd(two, _mm_unpackhi_pd(two, two))[0];
}
#endif
#endif
#endif
