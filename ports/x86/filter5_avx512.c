/* 5x5 filter: a vector holds four neighbouring pixels of 4 channels. The weights of four taps of
 * four pixels are made together, as products of two tables of 16 that registers hold. Products and
 * sums are rounded one by one, in the order of the definition. */
#include "port_avx512.h"

typedef struct tables {
    __m512 high, low; /* of the two halves of a code */
} tables;

LULL_INLINE __m128i load_16(const uint8_t *p)
{
    return _mm_loadu_si128((const __m128i *)(const void *)p);
}

/* Table values of 16 codes. */
LULL_INLINE __m512 weights_of(const tables *t, __m128i codes)
{
    __m512i q = _mm512_cvtepu8_epi32(codes);
    return _mm512_mul_ps(_mm512_permutexvar_ps(_mm512_srli_epi32(q, 4), t->high),
                         _mm512_permutexvar_ps(q, t->low));
}

LULL_INLINE __m512 add_tap(__m512 sum, const float *v, __m512 weights)
{
    return _mm512_add_ps(sum, _mm512_mul_ps(weights, _mm512_loadu_ps(v)));
}

/* Sums (S0, S1, S2, S3) to (S1 / S0, S2 / S0, S3 / S0, S0); zeros where S0 is 0. */
LULL_INLINE __m512 means(__m512 sums)
{
    __m512 total = _mm512_permute_ps(sums, 0x00), turned = _mm512_permute_ps(sums, 0x39);
    __mmask16 some = _mm512_cmp_ps_mask(total, _mm512_setzero_ps(), _CMP_GT_OQ);
    __m512 q = _mm512_maskz_div_ps(some, turned, total);
    return _mm512_mask_blend_ps(0x8888, q, turned);
}

/* Codes of taps 4 i..4 i + 3 of four pixels, i = 0..5: their dwords turned. */
LULL_INLINE void turn_codes(__m128i *taps, const uint8_t *q, size_t step)
{
    __m128i a = load_16(q), b = load_16(q + step);
    __m128i c = load_16(q + 2 * step), d = load_16(q + 3 * step);
    __m128i ab = _mm_unpacklo_epi32(a, b), cd = _mm_unpacklo_epi32(c, d);
    taps[0] = _mm_unpacklo_epi64(ab, cd);
    taps[1] = _mm_unpackhi_epi64(ab, cd);
    ab = _mm_unpackhi_epi32(a, b), cd = _mm_unpackhi_epi32(c, d);
    taps[2] = _mm_unpacklo_epi64(ab, cd);
    taps[3] = _mm_unpackhi_epi64(ab, cd);
    q += 8;
    ab = _mm_unpackhi_epi32(load_16(q), load_16(q + step));
    cd = _mm_unpackhi_epi32(load_16(q + 2 * step), load_16(q + 3 * step));
    taps[4] = _mm_unpacklo_epi64(ab, cd);
    taps[5] = _mm_unpackhi_epi64(ab, cd);
}

/* Weights of the last tap of four pixels. */
LULL_INLINE __m512 last_weights(const float *table, const uint8_t *q, size_t step)
{
    __m512 w = _mm512_set1_ps(table[q[24]]);
    w = _mm512_mask_broadcastss_ps(w, 0x00f0, _mm_load_ss(table + q[24 + step]));
    w = _mm512_mask_broadcastss_ps(w, 0x0f00, _mm_load_ss(table + q[24 + 2 * step]));
    return _mm512_mask_broadcastss_ps(w, 0xf000, _mm_load_ss(table + q[24 + 3 * step]));
}

/* Tap k of both groups of four pixels; v and w are their weights of four taps. */
#define TAP(k, i)                                                                 \
    a = add_tap(a, tap[k] + at, _mm512_permute_ps(v, (i) * 0x55));                \
    b = add_tap(b, tap[k] + at + 16, _mm512_permute_ps(w, (i) * 0x55));

/* tap: where each tap of pixel 0 reads. */
static void eight_pixels(float *out, const float *const *tap, size_t at, const uint8_t *codes,
                         size_t step, const float *table, const tables *t)
{
    __m512 a = _mm512_setzero_ps(), b = a, v, w;
    __m128i first[6], second[6];
    turn_codes(first, codes, step);
    turn_codes(second, codes + 4 * step, step);
    for (unsigned i = 0; i < 6; i++, tap += 4) { /* unrolled, it would keep too much at once */
        v = weights_of(t, first[i]);
        w = weights_of(t, second[i]);
        TAP(0, 0)
        TAP(1, 1)
        TAP(2, 2)
        TAP(3, 3)
    }
    v = last_weights(table, codes, step);
    w = last_weights(table, codes + 4 * step, step);
    TAP(0, 0)
    _mm512_storeu_ps(out, means(a));
    _mm512_storeu_ps(out + 16, means(b));
}

static void one_pixel(float *out, const float *const *rows, size_t at, const uint8_t *codes,
                      const float *table)
{
    __m128 sum = _mm_setzero_ps();
    for (unsigned y = 0; y < 5; y++) {
        const float *v = rows[y] + at - 8;
        for (unsigned x = 0; x < 5; x++, v += 4)
            sum = _mm_add_ps(sum, _mm_mul_ps(_mm_set1_ps(table[*codes++]), _mm_loadu_ps(v)));
    }
    _mm_storeu_ps(out, _mm512_castps512_ps128(means(_mm512_castps128_ps512(sum))));
}

void lull_filter5_avx512(float *out, const float *const *rows, const uint8_t *codes,
                         size_t code_step, const float *table, unsigned pixels)
{
    const __m512i sixteens = _mm512_slli_epi32(
        _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15), 4);
    const float *tap[25];
    tables t;
    size_t p = 0;
    for (unsigned k = 0; k < 25; k++)
        tap[k] = rows[k / 5] + 4 * (k % 5) - 8;
    t.high = _mm512_i32gather_ps(sixteens, table + 15, 4);
    t.low = _mm512_loadu_ps(table + 240);
    for (; p + 8 <= pixels; p += 8)
        eight_pixels(out + 4 * p, tap, 4 * p, codes + p * code_step, code_step, table, &t);
    for (; p < pixels; p++)
        one_pixel(out + 4 * p, rows, 4 * p, codes + p * code_step, table);
}
