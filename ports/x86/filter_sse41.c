/* Family K's filter with vectors of 4. */
#include "port_sse41.h"

#define NAME(op) lull_##op##_sse41
#define LANES 4u
typedef __m128 vec;
typedef __m128i ivec;

LULL_INLINE vec set(float v) { return _mm_set1_ps(v); }
LULL_INLINE vec load(const float *p) { return _mm_loadu_ps(p); }
LULL_INLINE void store(float *p, vec v) { _mm_storeu_ps(p, v); }

#include "../parts_rows.h"

LULL_INLINE vec add(vec a, vec b) { return _mm_add_ps(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm_sub_ps(a, b); }
LULL_INLINE vec mul(vec a, vec b) { return _mm_mul_ps(a, b); }
LULL_INLINE vec quotient(vec a, vec b) { return _mm_div_ps(a, b); }
LULL_INLINE vec low(vec a, vec b) { return _mm_min_ps(a, b); }
LULL_INLINE vec high(vec a, vec b) { return _mm_max_ps(a, b); }
LULL_INLINE ivec ints(vec v) { return _mm_castps_si128(v); }
LULL_INLINE vec floats(ivec v) { return _mm_castsi128_ps(v); }
LULL_INLINE vec above(vec v, int least)
{
    return _mm_and_ps(v, floats(_mm_cmpgt_epi32(ints(v), _mm_set1_epi32(least))));
}
LULL_INLINE vec choose(vec if_positive, vec v, vec other)
{
    return _mm_blendv_ps(other, v, _mm_cmpgt_ps(if_positive, _mm_setzero_ps()));
}
LULL_INLINE ivec whole(vec v) { return _mm_cvttps_epi32(v); }
LULL_INLINE vec number(ivec v) { return _mm_cvtepi32_ps(v); }
LULL_INLINE ivec set_int(int v) { return _mm_set1_epi32(v); }
LULL_INLINE ivec sub_int(ivec a, ivec b) { return _mm_sub_epi32(a, b); }
LULL_INLINE ivec add_int(ivec a, ivec b) { return _mm_add_epi32(a, b); }
LULL_INLINE ivec or_int(ivec a, ivec b) { return _mm_or_si128(a, b); }
LULL_INLINE ivec and_int(ivec a, ivec b) { return _mm_and_si128(a, b); }
#define shift_left(v, n) _mm_slli_epi32(v, n)
#define shift_right(v, n) _mm_srli_epi32(v, n)
#define shift_sign(v, n) _mm_srai_epi32(v, n)
LULL_INLINE vec is_number(vec v) { return _mm_and_ps(v, _mm_cmpord_ps(v, v)); }

LULL_INLINE void split(const float *p, unsigned n, vec *a, vec *b, vec *c)
{
    float part[3 * LANES] = {0};
    vec x, y, z, xy, yz; /* a0 b0 c0 a1, b1 c1 a2 b2, c2 a3 b3 c3 */
    if (n < LANES)
        p = copy_pixels(part, p, n);
    x = _mm_loadu_ps(p), y = _mm_loadu_ps(p + 4), z = _mm_loadu_ps(p + 8);
    xy = _mm_shuffle_ps(x, y, _MM_SHUFFLE(1, 0, 2, 1)); /* b0 c0 b1 c1 */
    yz = _mm_shuffle_ps(y, z, _MM_SHUFFLE(2, 1, 3, 2)); /* a2 b2 a3 b3 */
    *a = _mm_shuffle_ps(x, yz, _MM_SHUFFLE(2, 0, 3, 0));
    *b = _mm_shuffle_ps(xy, yz, _MM_SHUFFLE(3, 1, 2, 0));
    *c = _mm_shuffle_ps(xy, z, _MM_SHUFFLE(3, 0, 3, 1));
}

LULL_INLINE void join(float *p, unsigned n, vec a, vec b, vec c)
{
    float part[3 * LANES], *to = n < LANES ? part : p;
    vec ab = _mm_shuffle_ps(a, b, _MM_SHUFFLE(2, 0, 2, 0)); /* a0 a2 b0 b2 */
    vec bc = _mm_shuffle_ps(b, c, _MM_SHUFFLE(3, 1, 3, 1)); /* b1 b3 c1 c3 */
    vec ca = _mm_shuffle_ps(c, a, _MM_SHUFFLE(3, 1, 2, 0)); /* c0 c2 a1 a3 */
    _mm_storeu_ps(to, _mm_shuffle_ps(ab, ca, _MM_SHUFFLE(2, 0, 2, 0)));
    _mm_storeu_ps(to + 4, _mm_shuffle_ps(bc, ab, _MM_SHUFFLE(3, 1, 2, 0)));
    _mm_storeu_ps(to + 8, _mm_shuffle_ps(ca, bc, _MM_SHUFFLE(3, 1, 3, 1)));
    if (n < LANES)
        copy_pixels(p, part, n);
}

LULL_INLINE void split_pairs(vec a, vec b, vec *even, vec *odd)
{
    *even = _mm_shuffle_ps(a, b, _MM_SHUFFLE(2, 0, 2, 0));
    *odd = _mm_shuffle_ps(a, b, _MM_SHUFFLE(3, 1, 3, 1));
}

LULL_INLINE void join_pairs(vec even, vec odd, vec *a, vec *b)
{
    *a = _mm_unpacklo_ps(even, odd);
    *b = _mm_unpackhi_ps(even, odd);
}

typedef const float *tables;

LULL_INLINE void tables_init(tables *t, const float *table) { *t = table; }

LULL_INLINE vec weights(const tables *t, ivec q)
{
#define VALUE(i) (*t)[(uint8_t)_mm_extract_epi8(q, 4 * (i))]
    return _mm_setr_ps(VALUE(0), VALUE(1), VALUE(2), VALUE(3));
#undef VALUE
}

LULL_INLINE ivec codes_at(const uint8_t *q, size_t step, unsigned n)
{
#define CODE(i) (int)lull_load_u32(q + lull_min_u(i, n - 1) * step)
    return _mm_setr_epi32(CODE(0), CODE(1), CODE(2), CODE(3));
#undef CODE
}

LULL_INLINE vec values_at(const float *table, const uint8_t *q, size_t step, unsigned n)
{
#define VALUE(i) table[q[lull_min_u(i, n - 1) * step]]
    return _mm_setr_ps(VALUE(0), VALUE(1), VALUE(2), VALUE(3));
#undef VALUE
}

LULL_INLINE vec look_up(const float *table, const uint8_t *q, unsigned n)
{
    return values_at(table, q, 1, n);
}

LULL_INLINE vec bytes(const uint8_t *p, unsigned n)
{
    uint8_t part[LANES] = {0};
    int32_t v;
    memcpy(part, p, n);
    memcpy(&v, part, sizeof v);
    return number(_mm_cvtepu8_epi32(_mm_cvtsi32_si128(v)));
}

LULL_INLINE void put_bytes(uint8_t *p, ivec q, unsigned n)
{
    int32_t v;
    q = _mm_packs_epi32(q, q);
    v = _mm_cvtsi128_si32(_mm_packus_epi16(q, q));
    memcpy(p, &v, n);
}

LULL_INLINE ivec pairs(const uint8_t *p, unsigned n)
{
    uint8_t part[2 * LANES] = {0};
    memcpy(part, p, 2 * n);
    return _mm_cvtepu16_epi32(_mm_loadl_epi64((const __m128i *)(const void *)part));
}

LULL_INLINE void put_pairs(uint8_t *p, ivec q, unsigned n)
{
    uint8_t part[2 * LANES];
    _mm_storel_epi64((__m128i *)(void *)part, _mm_packus_epi32(q, q));
    memcpy(p, part, 2 * n);
}

LULL_INLINE ivec squares_of_pairs(ivec a, ivec b)
{
    a = _mm_abs_epi8(_mm_sub_epi8(a, b));
    return _mm_maddubs_epi16(a, a);
}

LULL_INLINE void around(const float *p, vec *before, vec *after)
{
    *before = set(p[0]);
    *after = set(p[1]);
}

#include "../filter_rows.h"

#include "../bilateral_rows.h"
#include "../means_rows.h"
#include "../regression_rows.h"

#include "../grain_rows.h"
