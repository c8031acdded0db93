/* Family K's filter with vectors of 8. */
#include "port_avx2.h"

#define NAME(op) lull_##op##_avx2
#if LULL_X86_ASM
#define TIE(a, b, c, d, e) __asm__("" : "+x"(a), "+x"(b), "+x"(c), "+x"(d), "+x"(e))
#else
#define TIE(a, b, c, d, e) (void)0
#endif
#define LANES 8u
typedef __m256 vec;
typedef __m256i ivec;

/* The first n lanes. */
LULL_INLINE ivec first_lanes(unsigned n)
{
    static const int32_t lanes[16] = {-1, -1, -1, -1, -1, -1, -1, -1};
    return _mm256_loadu_si256((const __m256i *)(const void *)(lanes + LANES - n));
}
LULL_INLINE vec set(float v) { return _mm256_set1_ps(v); }
LULL_INLINE vec load_n(const float *p, unsigned n)
{
    return n == LANES ? _mm256_loadu_ps(p)
           : n        ? _mm256_maskload_ps(p, first_lanes(n))
                      : _mm256_setzero_ps();
}
LULL_INLINE void store_n(float *p, vec v, unsigned n)
{
    if (n == LANES)
        _mm256_storeu_ps(p, v);
    else if (n)
        _mm256_maskstore_ps(p, first_lanes(n), v);
}
LULL_INLINE vec add(vec a, vec b) { return _mm256_add_ps(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm256_sub_ps(a, b); }
LULL_INLINE vec mul(vec a, vec b) { return _mm256_mul_ps(a, b); }
LULL_INLINE vec quotient(vec a, vec b) { return _mm256_div_ps(a, b); }
LULL_INLINE vec low(vec a, vec b) { return _mm256_min_ps(a, b); }
LULL_INLINE vec high(vec a, vec b) { return _mm256_max_ps(a, b); }
LULL_INLINE ivec ints(vec v) { return _mm256_castps_si256(v); }
LULL_INLINE vec floats(ivec v) { return _mm256_castsi256_ps(v); }
LULL_INLINE vec above(vec v, int least)
{
    return _mm256_and_ps(v, floats(_mm256_cmpgt_epi32(ints(v), _mm256_set1_epi32(least))));
}
LULL_INLINE vec choose(vec if_positive, vec v, vec other)
{
    return _mm256_blendv_ps(other, v, _mm256_cmp_ps(if_positive, _mm256_setzero_ps(), _CMP_GT_OQ));
}
LULL_INLINE ivec whole(vec v) { return _mm256_cvttps_epi32(v); }
LULL_INLINE vec number(ivec v) { return _mm256_cvtepi32_ps(v); }
LULL_INLINE ivec set_int(int v) { return _mm256_set1_epi32(v); }
LULL_INLINE ivec sub_int(ivec a, ivec b) { return _mm256_sub_epi32(a, b); }
LULL_INLINE ivec add_int(ivec a, ivec b) { return _mm256_add_epi32(a, b); }
LULL_INLINE ivec or_int(ivec a, ivec b) { return _mm256_or_si256(a, b); }
LULL_INLINE ivec and_int(ivec a, ivec b) { return _mm256_and_si256(a, b); }
#define shift_left(v, n) _mm256_slli_epi32(v, n)
#define shift_right(v, n) _mm256_srli_epi32(v, n)
#define shift_sign(v, n) _mm256_srai_epi32(v, n)
LULL_INLINE vec is_number(vec v) { return _mm256_and_ps(v, _mm256_cmp_ps(v, v, _CMP_ORD_Q)); }

/* Works within 128 bits, hence the order of lanes before and after. */
LULL_INLINE vec in_fours(vec v)
{
    return _mm256_castpd_ps(_mm256_permute4x64_pd(_mm256_castps_pd(v), 0xd8));
}

LULL_INLINE void split_pairs(vec a, vec b, vec *even, vec *odd)
{
    *even = in_fours(_mm256_shuffle_ps(a, b, 0x88));
    *odd = in_fours(_mm256_shuffle_ps(a, b, 0xdd));
}

LULL_INLINE void join_pairs(vec even, vec odd, vec *a, vec *b)
{
    vec x = _mm256_unpacklo_ps(even, odd), y = _mm256_unpackhi_ps(even, odd);
    *a = _mm256_permute2f128_ps(x, y, 0x20);
    *b = _mm256_permute2f128_ps(x, y, 0x31);
}

/* Floats 8 i..8 i + 7 of 3 n. */
LULL_INLINE unsigned part_of(unsigned n, unsigned i)
{
    return 3 * n <= LANES * i ? 0 : lull_min_u(3 * n - LANES * i, LANES);
}

/* Lanes that belong to a value of 0, 1, 2 (modulo 3) are gathered by blends, then put in order. */
LULL_INLINE void split(const float *p, unsigned n, vec *a, vec *b, vec *c)
{
    vec x = load_n(p, part_of(n, 0)), y = load_n(p + LANES, part_of(n, 1));
    vec z = load_n(p + 2 * LANES, part_of(n, 2));
    *a = _mm256_blend_ps(_mm256_blend_ps(x, y, 0x92), z, 0x24);
    *b = _mm256_blend_ps(_mm256_blend_ps(x, y, 0x24), z, 0x49);
    *c = _mm256_blend_ps(_mm256_blend_ps(x, y, 0x49), z, 0x92);
    *a = _mm256_permutevar8x32_ps(*a, _mm256_setr_epi32(0, 3, 6, 1, 4, 7, 2, 5));
    *b = _mm256_permutevar8x32_ps(*b, _mm256_setr_epi32(1, 4, 7, 2, 5, 0, 3, 6));
    *c = _mm256_permutevar8x32_ps(*c, _mm256_setr_epi32(2, 5, 0, 3, 6, 1, 4, 7));
}

LULL_INLINE void join(float *p, unsigned n, vec a, vec b, vec c)
{
    a = _mm256_permutevar8x32_ps(a, _mm256_setr_epi32(0, 3, 6, 1, 4, 7, 2, 5));
    b = _mm256_permutevar8x32_ps(b, _mm256_setr_epi32(5, 0, 3, 6, 1, 4, 7, 2));
    c = _mm256_permutevar8x32_ps(c, _mm256_setr_epi32(2, 5, 0, 3, 6, 1, 4, 7));
    store_n(p, _mm256_blend_ps(_mm256_blend_ps(a, b, 0x92), c, 0x24), part_of(n, 0));
    store_n(p + LANES, _mm256_blend_ps(_mm256_blend_ps(a, b, 0x24), c, 0x49), part_of(n, 1));
    store_n(p + 2 * LANES, _mm256_blend_ps(_mm256_blend_ps(a, b, 0x49), c, 0x92), part_of(n, 2));
}

typedef struct tables {
    vec high0, high1, low0, low1; /* of the two halves of a code, each in two eights */
} tables;

LULL_INLINE void tables_init(tables *t, const float *table)
{
    t->high0 = _mm256_setr_ps(table[15], table[31], table[47], table[63], table[79], table[95],
                              table[111], table[127]);
    t->high1 = _mm256_setr_ps(table[143], table[159], table[175], table[191], table[207],
                              table[223], table[239], table[255]);
    t->low0 = _mm256_loadu_ps(table + 240);
    t->low1 = _mm256_loadu_ps(table + 248);
}

/* Of 16 values, those that the lowest four bits of i name. */
LULL_INLINE vec of_sixteen(vec first, vec second, ivec i)
{
    return _mm256_blendv_ps(_mm256_permutevar8x32_ps(first, i), _mm256_permutevar8x32_ps(second, i),
                            floats(shift_left(i, 28)));
}

LULL_INLINE vec weights(const tables *t, ivec q)
{
    return mul(of_sixteen(t->high0, t->high1, shift_right(q, 4)), of_sixteen(t->low0, t->low1, q));
}

LULL_INLINE ivec codes_at(const uint8_t *q, size_t step, unsigned n)
{
#define CODE(i) (int)lull_load_u32(q + lull_min_u(i, n - 1) * step)
    return _mm256_setr_epi32(CODE(0), CODE(1), CODE(2), CODE(3), CODE(4), CODE(5), CODE(6),
                             CODE(7));
#undef CODE
}

#define TAKES_PLANES
LULL_INLINE ivec codes_from(const uint8_t *q, unsigned n)
{
    uint8_t part[LANES] = {0};
    if (n < LANES) {
        memcpy(part, q, n);
        q = part;
    }
    return _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)(const void *)q));
}

LULL_INLINE vec look_up(const float *table, const uint8_t *q, unsigned n)
{
#define VALUE(i) table[q[lull_min_u(i, n - 1)]]
    return _mm256_setr_ps(VALUE(0), VALUE(1), VALUE(2), VALUE(3), VALUE(4), VALUE(5), VALUE(6),
                          VALUE(7));
#undef VALUE
}

/* 16 bytes at q of pixels j and j + 4, each not beyond pixel n - 1. */
LULL_INLINE ivec pixels_from(const uint8_t *q, size_t step, unsigned j, unsigned n)
{
#define ROW(j) _mm_loadu_si128((const __m128i *)(const void *)(q + lull_min_u(j, n - 1) * step))
    return _mm256_inserti128_si256(_mm256_castsi128_si256(ROW(j)), ROW(j + 4), 1);
#undef ROW
}

LULL_INLINE ivec low32(ivec a, ivec b) { return _mm256_unpacklo_epi32(a, b); }
LULL_INLINE ivec high32(ivec a, ivec b) { return _mm256_unpackhi_epi32(a, b); }
LULL_INLINE ivec low64(ivec a, ivec b) { return _mm256_unpacklo_epi64(a, b); }
LULL_INLINE ivec high64(ivec a, ivec b) { return _mm256_unpackhi_epi64(a, b); }

LULL_INLINE vec bytes(const uint8_t *p, unsigned n)
{
    return number(codes_from(p, n));
}

LULL_INLINE void put_bytes(uint8_t *p, ivec q, unsigned n)
{
    uint8_t part[LANES];
    __m128i w = _mm_packs_epi32(_mm256_castsi256_si128(q), _mm256_extracti128_si256(q, 1));
    _mm_storel_epi64((__m128i *)(void *)(n < LANES ? part : p), _mm_packus_epi16(w, w));
    if (n < LANES)
        memcpy(p, part, n);
}

LULL_INLINE ivec pairs(const uint8_t *p, unsigned n)
{
    uint8_t part[2 * LANES] = {0};
    if (n < LANES) {
        memcpy(part, p, 2 * n);
        p = part;
    }
    return _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(const void *)p));
}

LULL_INLINE void put_pairs(uint8_t *p, ivec q, unsigned n)
{
    uint8_t part[2 * LANES];
    __m128i w = _mm_packus_epi32(_mm256_castsi256_si128(q), _mm256_extracti128_si256(q, 1));
    _mm_storeu_si128((__m128i *)(void *)(n < LANES ? part : p), w);
    if (n < LANES)
        memcpy(p, part, 2 * n);
}

LULL_INLINE ivec squares_of_pairs(ivec a, ivec b)
{
    a = _mm256_abs_epi8(_mm256_sub_epi8(a, b));
    return _mm256_maddubs_epi16(a, a);
}

LULL_INLINE void around(const float *p, vec *before, vec *after)
{
    __m128 middle = _mm_broadcast_ss(p + 1);
    *before = _mm256_set_m128(middle, _mm_broadcast_ss(p));
    *after = _mm256_set_m128(_mm_broadcast_ss(p + 2), middle);
}

#include "../filter_rows.h"

#include "../bilateral_rows.h"
#include "../regression_rows.h"

#include "../grain_rows.h"
#include "filter5_rows.h"
