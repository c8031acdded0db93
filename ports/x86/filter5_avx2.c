/* 5x5 filter: a vector holds two neighbouring pixels of 4 channels; 4 pairs of pixels at a
 * time, so that their chains of sums overlap. Products and sums are rounded one by one, in the
 * order of the definition. */
#include "port_avx2.h"

/* The weights of a pair of pixels whose codes for this tap are at q and q + step. */
LULL_INLINE __m256 pair_weights(const float *table, const uint8_t *q, size_t step)
{
    return _mm256_blend_ps(_mm256_broadcast_ss(table + q[0]), _mm256_broadcast_ss(table + q[step]),
                           0xf0);
}

LULL_INLINE __m256 add_tap(__m256 sum, const float *v, __m256 weights)
{
    return _mm256_add_ps(sum, _mm256_mul_ps(weights, _mm256_loadu_ps(v)));
}

/* Sums (S0, S1, S2, S3) to (S1 / S0, S2 / S0, S3 / S0, S0); zeros where S0 is 0. */
LULL_INLINE __m256 means(__m256 sums)
{
    __m256 total = _mm256_permute_ps(sums, 0x00), turned = _mm256_permute_ps(sums, 0x39);
    __m256 some = _mm256_cmp_ps(total, _mm256_setzero_ps(), _CMP_GT_OQ);
    return _mm256_blend_ps(_mm256_and_ps(_mm256_div_ps(turned, total), some), turned, 0x88);
}

static void eight_pixels(float *out, const float *const *rows, size_t at, const uint8_t *codes,
                         size_t step, const float *table)
{
    __m256 a = _mm256_setzero_ps(), b = a, c = a, d = a;
    const uint8_t *q = codes, *r = codes + 4 * step;
    for (unsigned y = 0; y < 5; y++) {
        const float *v = rows[y] + at - 8;
        for (unsigned x = 0; x < 5; x++, q++, r++, v += 4) {
            a = add_tap(a, v, pair_weights(table, q, step));
            b = add_tap(b, v + 8, pair_weights(table, q + 2 * step, step));
            c = add_tap(c, v + 16, pair_weights(table, r, step));
            d = add_tap(d, v + 24, pair_weights(table, r + 2 * step, step));
        }
    }
    _mm256_storeu_ps(out, means(a));
    _mm256_storeu_ps(out + 8, means(b));
    _mm256_storeu_ps(out + 16, means(c));
    _mm256_storeu_ps(out + 24, means(d));
}

static void one_pixel(float *out, const float *const *rows, size_t at, const uint8_t *codes,
                      const float *table)
{
    __m128 sum = _mm_setzero_ps();
    for (unsigned y = 0; y < 5; y++) {
        const float *v = rows[y] + at - 8;
        for (unsigned x = 0; x < 5; x++, v += 4)
            sum = _mm_add_ps(sum, _mm_mul_ps(_mm_broadcast_ss(table + *codes++), _mm_loadu_ps(v)));
    }
    _mm_storeu_ps(out, _mm256_castps256_ps128(means(_mm256_castps128_ps256(sum))));
}

void lull_filter5_avx2(float *out, const float *const *rows, const uint8_t *codes, size_t code_step,
                       const float *table, unsigned pixels)
{
    size_t p = 0;
    for (; p + 8 <= pixels; p += 8)
        eight_pixels(out + 4 * p, rows, 4 * p, codes + p * code_step, code_step, table);
    for (; p < pixels; p++)
        one_pixel(out + 4 * p, rows, 4 * p, codes + p * code_step, table);
}
