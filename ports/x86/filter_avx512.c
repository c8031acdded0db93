/* Family K's filter with vectors of 16. */
#include "port_avx512.h"

#define NAME(op) lull_##op##_avx512
#if LULL_X86_ASM
#define TIE(a, b, c, d, e) __asm__("" : "+v"(a), "+v"(b), "+v"(c), "+v"(d), "+v"(e))
#else
#define TIE(a, b, c, d, e) (void)0
#endif
#define LANES 16u
typedef __m512 vec;
typedef __m512i ivec;

LULL_INLINE __mmask16 first_lanes(unsigned n) { return (__mmask16)((1u << n) - 1); }
LULL_INLINE vec set(float v) { return _mm512_set1_ps(v); }
LULL_INLINE vec load_n(const float *p, unsigned n)
{
    return n == LANES ? _mm512_loadu_ps(p) : _mm512_maskz_loadu_ps(first_lanes(n), p);
}
LULL_INLINE void store_n(float *p, vec v, unsigned n)
{
    if (n == LANES)
        _mm512_storeu_ps(p, v);
    else
        _mm512_mask_storeu_ps(p, first_lanes(n), v);
}
LULL_INLINE vec add(vec a, vec b) { return _mm512_add_ps(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm512_sub_ps(a, b); }
LULL_INLINE vec mul(vec a, vec b) { return _mm512_mul_ps(a, b); }
LULL_INLINE vec quotient(vec a, vec b) { return _mm512_div_ps(a, b); }
LULL_INLINE vec low(vec a, vec b) { return _mm512_min_ps(a, b); }
LULL_INLINE vec high(vec a, vec b) { return _mm512_max_ps(a, b); }
LULL_INLINE ivec ints(vec v) { return _mm512_castps_si512(v); }
LULL_INLINE vec floats(ivec v) { return _mm512_castsi512_ps(v); }
LULL_INLINE vec above(vec v, int least)
{
    return _mm512_maskz_mov_ps(_mm512_cmpgt_epi32_mask(ints(v), _mm512_set1_epi32(least)), v);
}
LULL_INLINE vec choose(vec if_positive, vec v, vec other)
{
    return _mm512_mask_mov_ps(other,
                              _mm512_cmp_ps_mask(if_positive, _mm512_setzero_ps(), _CMP_GT_OQ), v);
}
LULL_INLINE ivec whole(vec v) { return _mm512_cvttps_epi32(v); }
LULL_INLINE vec number(ivec v) { return _mm512_cvtepi32_ps(v); }
LULL_INLINE ivec set_int(int v) { return _mm512_set1_epi32(v); }
LULL_INLINE ivec sub_int(ivec a, ivec b) { return _mm512_sub_epi32(a, b); }
LULL_INLINE ivec add_int(ivec a, ivec b) { return _mm512_add_epi32(a, b); }
LULL_INLINE ivec or_int(ivec a, ivec b) { return _mm512_or_si512(a, b); }
LULL_INLINE ivec and_int(ivec a, ivec b) { return _mm512_and_si512(a, b); }
#define shift_left(v, n) _mm512_slli_epi32(v, n)
#define shift_right(v, n) _mm512_srli_epi32(v, n)
#define shift_sign(v, n) _mm512_srai_epi32(v, n)
LULL_INLINE vec is_number(vec v)
{
    return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(v, v, _CMP_ORD_Q), v);
}

/* Lanes of a and b by number; those of b count from 16 on. */
LULL_INLINE vec pick(vec a, ivec lanes, vec b) { return _mm512_permutex2var_ps(a, lanes, b); }

LULL_INLINE void split_pairs(vec a, vec b, vec *even, vec *odd)
{
    const ivec lanes = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    *even = pick(a, lanes, b);
    *odd = pick(a, _mm512_add_epi32(lanes, _mm512_set1_epi32(1)), b);
}

LULL_INLINE void join_pairs(vec even, vec odd, vec *a, vec *b)
{
    const ivec lanes = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    *a = pick(even, lanes, odd);
    *b = pick(even, _mm512_add_epi32(lanes, _mm512_set1_epi32(8)), odd);
}

/* Floats 16 i..16 i + 15 of 3 n. */
LULL_INLINE unsigned part_of(unsigned n, unsigned i)
{
    return 3 * n <= LANES * i ? 0 : lull_min_u(3 * n - LANES * i, LANES);
}

LULL_INLINE void split(const float *p, unsigned n, vec *a, vec *b, vec *c)
{
    vec x = load_n(p, part_of(n, 0)), y = load_n(p + LANES, part_of(n, 1));
    vec z = load_n(p + 2 * LANES, part_of(n, 2));
    *a = pick(pick(x, _mm512_setr_epi32(0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0), y),
              _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29), z);
    *b = pick(pick(x, _mm512_setr_epi32(1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0), y),
              _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30), z);
    *c = pick(pick(x, _mm512_setr_epi32(2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0), y),
              _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31), z);
}

LULL_INLINE void join(float *p, unsigned n, vec a, vec b, vec c)
{
    vec x = pick(pick(a, _mm512_setr_epi32(0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5), b),
                 _mm512_setr_epi32(0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15), c);
    vec y =
        pick(pick(a, _mm512_setr_epi32(21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26), b),
             _mm512_setr_epi32(0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15), c);
    vec z = pick(
        pick(a, _mm512_setr_epi32(0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0), b),
        _mm512_setr_epi32(26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31), c);
    store_n(p, x, part_of(n, 0));
    store_n(p + LANES, y, part_of(n, 1));
    store_n(p + 2 * LANES, z, part_of(n, 2));
}

typedef struct tables {
    vec high, low; /* of the two halves of a code */
} tables;

LULL_INLINE void tables_init(tables *t, const float *table)
{
    const ivec sixteens = _mm512_slli_epi32(
        _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15), 4);
    t->high = _mm512_i32gather_ps(sixteens, table + 15, 4);
    t->low = _mm512_loadu_ps(table + 240);
}

LULL_INLINE vec weights(const tables *t, ivec q)
{
    return mul(_mm512_permutexvar_ps(shift_right(q, 4), t->high), _mm512_permutexvar_ps(q, t->low));
}

LULL_INLINE ivec codes_at(const uint8_t *q, size_t step, unsigned n)
{
    const ivec lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    return _mm512_mask_i32gather_epi32(_mm512_setzero_si512(), first_lanes(n),
                                       _mm512_mullo_epi32(lanes, set_int((int)step)), q, 1);
}

LULL_INLINE vec look_up(const float *table, const uint8_t *q, unsigned n)
{
    __m128i codes = n == LANES ? _mm_loadu_si128((const __m128i *)(const void *)q)
                               : _mm_maskz_loadu_epi8(first_lanes(n), q);
    return _mm512_i32gather_ps(_mm512_cvtepu8_epi32(codes), table, 4);
}

/* 16 bytes at q of pixels j, j + 4, j + 8 and j + 12, each not beyond pixel n - 1. */
LULL_INLINE ivec pixels_from(const uint8_t *q, size_t step, unsigned j, unsigned n)
{
#define ROW(j) _mm_loadu_si128((const __m128i *)(const void *)(q + lull_min_u(j, n - 1) * step))
    ivec v = _mm512_castsi128_si512(ROW(j));
    v = _mm512_inserti32x4(v, ROW(j + 4), 1);
    v = _mm512_inserti32x4(v, ROW(j + 8), 2);
    return _mm512_inserti32x4(v, ROW(j + 12), 3);
#undef ROW
}

LULL_INLINE ivec low32(ivec a, ivec b) { return _mm512_unpacklo_epi32(a, b); }
LULL_INLINE ivec high32(ivec a, ivec b) { return _mm512_unpackhi_epi32(a, b); }
LULL_INLINE ivec low64(ivec a, ivec b) { return _mm512_unpacklo_epi64(a, b); }
LULL_INLINE ivec high64(ivec a, ivec b) { return _mm512_unpackhi_epi64(a, b); }

LULL_INLINE vec bytes(const uint8_t *p, unsigned n)
{
    return number(_mm512_cvtepu8_epi32(_mm_maskz_loadu_epi8(first_lanes(n), p)));
}

LULL_INLINE void put_bytes(uint8_t *p, ivec q, unsigned n)
{
    _mm512_mask_cvtepi32_storeu_epi8(p, first_lanes(n), q);
}

LULL_INLINE ivec pairs(const uint8_t *p, unsigned n)
{
    return _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(first_lanes(n), p));
}

LULL_INLINE void put_pairs(uint8_t *p, ivec q, unsigned n)
{
    _mm512_mask_cvtepi32_storeu_epi16(p, first_lanes(n), q);
}

LULL_INLINE ivec squares_of_pairs(ivec a, ivec b)
{
    a = _mm512_abs_epi8(_mm512_sub_epi8(a, b));
    return _mm512_maddubs_epi16(a, a);
}

LULL_INLINE void around(const float *p, vec *before, vec *after)
{
    const ivec lanes = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2);
    vec v = _mm512_broadcast_f32x4(_mm_loadu_ps(p));
    *before = _mm512_permutexvar_ps(lanes, v);
    *after = _mm512_permutexvar_ps(_mm512_add_epi32(lanes, set_int(1)), v);
}

#include "../filter_rows.h"

#include "../bilateral_rows.h"
#include "../regression_rows.h"

#include "../grain_rows.h"
#include "filter5_rows.h"
