/* 5x5 filter: a vector holds the 4 channels of a pixel; 4 pixels at a time, so that their chains of
 * sums overlap. Products and sums are rounded one by one, in the order of the definition. */
#include <arm_neon.h>

#include "port_neon.h"

#if defined(__aarch64__) /* see port_neon.c */

LULL_INLINE float32x4_t add_tap(float32x4_t sum, const float *v, float weight)
{
    return vaddq_f32(sum, vmulq_n_f32(vld1q_f32(v), weight));
}

/* Sums (S0, S1, S2, S3) to (S1 / S0, S2 / S0, S3 / S0, S0); zeros where S0 is 0. */
LULL_INLINE float32x4_t means(float32x4_t sums)
{
    float32x4_t total = vdupq_laneq_f32(sums, 0), turned = vextq_f32(sums, sums, 1);
    uint32x4_t some = vcgtq_f32(total, vdupq_n_f32(0.0f));
    uint32x4_t q = vandq_u32(vreinterpretq_u32_f32(vdivq_f32(turned, total)), some);
    return vcopyq_laneq_f32(vreinterpretq_f32_u32(q), 3, turned, 3);
}

static void four_pixels(float *out, const float *const *rows, size_t at, const uint8_t *codes,
                        size_t step, const float *table)
{
    float32x4_t a = vdupq_n_f32(0.0f), b = a, c = a, d = a;
    for (unsigned y = 0; y < 5; y++) {
        const float *v = rows[y] + at - 8;
        for (unsigned x = 0; x < 5; x++, codes++, v += 4) {
            a = add_tap(a, v, table[codes[0]]);
            b = add_tap(b, v + 4, table[codes[step]]);
            c = add_tap(c, v + 8, table[codes[2 * step]]);
            d = add_tap(d, v + 12, table[codes[3 * step]]);
        }
    }
    vst1q_f32(out, means(a));
    vst1q_f32(out + 4, means(b));
    vst1q_f32(out + 8, means(c));
    vst1q_f32(out + 12, means(d));
}

static void one_pixel(float *out, const float *const *rows, size_t at, const uint8_t *codes,
                      const float *table)
{
    float32x4_t sum = vdupq_n_f32(0.0f);
    for (unsigned y = 0; y < 5; y++) {
        const float *v = rows[y] + at - 8;
        for (unsigned x = 0; x < 5; x++, v += 4)
            sum = add_tap(sum, v, table[*codes++]);
    }
    vst1q_f32(out, means(sum));
}

void lull_filter5_neon(float *out, const float *const *rows, const uint8_t *codes, size_t code_step,
                       const float *table, unsigned pixels)
{
    size_t p = 0;
    for (; p + 4 <= pixels; p += 4)
        four_pixels(out + 4 * p, rows, 4 * p, codes + p * code_step, code_step, table);
    for (; p < pixels; p++)
        one_pixel(out + 4 * p, rows, 4 * p, codes + p * code_step, table);
}

#endif
