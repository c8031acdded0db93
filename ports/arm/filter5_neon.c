/* 5x5 filter, four pixels at a time. Products and sums are rounded one by one, in the order of the
 * definition. */
#include <arm_neon.h>

#include "port_neon.h"

#if defined(__aarch64__) /* see port_neon.c */

LULL_INLINE void store_means(float *out, float32x4_t sum, float32x4_t total,
                             const lull_window *window)
{
    uint32x4_t some = vcgtq_f32(total, vdupq_n_f32(0.0f));
    float32x4_t mean = vmulq_f32(sum, vdivq_f32(vdupq_n_f32(1.0f), total));
    mean = vaddq_f32(mean, vdupq_n_f32(window->more));
    vst1q_f32(out, vbslq_f32(some, mean, vdupq_n_f32(window->none)));
}

/* Pixels p..p + 3. */
static void four_pixels(const lull_window *window, size_t p)
{
    const uint8_t *q = window->codes + p * window->code_step;
    const float *table = window->table;
    size_t plane = window->plane, step = window->code_step, out_plane = window->out_plane;
    float32x4_t a = vdupq_n_f32(0.0f), b = a, c = a, d = a;
    for (unsigned y = 0; y < 5; y++) {
        const float *v = window->rows[y] + (ptrdiff_t)p - 2;
        for (unsigned x = 0; x < 5; x++, q++, v++) {
            float32x4_t w = vld1q_dup_f32(table + q[0]);
            w = vld1q_lane_f32(table + q[step], w, 1);
            w = vld1q_lane_f32(table + q[2 * step], w, 2);
            w = vld1q_lane_f32(table + q[3 * step], w, 3);
            a = vaddq_f32(a, vmulq_f32(w, vld1q_f32(v)));
            b = vaddq_f32(b, vmulq_f32(w, vld1q_f32(v + plane)));
            c = vaddq_f32(c, vmulq_f32(w, vld1q_f32(v + 2 * plane)));
            d = vaddq_f32(d, vmulq_f32(w, vld1q_f32(v + 3 * plane)));
        }
    }
    store_means(window->out + p, b, a, window);
    store_means(window->out + p + out_plane, c, a, window);
    store_means(window->out + p + 2 * out_plane, d, a, window);
}

static void one_pixel(const lull_window *window, size_t p)
{
    const uint8_t *q = window->codes + p * window->code_step;
    float sum[4] = {0};
    for (unsigned y = 0; y < 5; y++) {
        const float *v = window->rows[y] + (ptrdiff_t)p - 2;
        for (unsigned x = 0; x < 5; x++, v++) {
            float w = window->table[*q++];
            for (size_t c = 0; c < 4; c++)
                sum[c] += w * v[c * window->plane];
        }
    }
    for (size_t c = 0; c < 3; c++)
        window->out[c * window->out_plane + p] =
            sum[0] > 0.0f ? sum[c + 1] * (1.0f / sum[0]) + window->more : window->none;
}

void lull_filter5_neon(const lull_window *window)
{
    size_t p = 0;
    for (; p + 4 <= window->pixels; p += 4)
        four_pixels(window, p);
    for (; p < window->pixels; p++)
        one_pixel(window, p);
}

#endif
