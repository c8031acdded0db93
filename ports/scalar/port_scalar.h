#ifndef LULL_PORT_SCALAR_H
#define LULL_PORT_SCALAR_H

#include "kernels.h"

/* Output channels of a weight block: enough for compilers to vectorise the inner loops. */
#define LULL_SCALAR_BLOCK 8u

/* Element `at` of integer outputs: a requantised, in a byte, or in a word if out_max is above 255.
 */
LULL_INLINE void lull_store_scalar(void *out, size_t at, int32_t a, int32_t multiplier,
                                   int32_t out_max)
{
    int64_t q = ((int64_t)a * multiplier + (1 << 30)) >> 31;
    q = q < 0 ? 0 : q > out_max ? out_max : q;
    if (out_max <= 255)
        ((uint8_t *)out)[at] = (uint8_t)q;
    else
        ((uint16_t *)out)[at] = (uint16_t)q;
}

void lull_conv_f32_scalar(const lull_conv *conv);
void lull_pool_f32_scalar(float *out, const float *above, const float *below, unsigned channels,
                          unsigned pixels);
void lull_winograd_in_scalar(const lull_winograd *image);
void lull_winograd_out_scalar(const lull_winograd *image);
void lull_conv_int_scalar(const lull_conv *conv);
void lull_conv_int3_scalar(const lull_conv *conv);
void lull_patches_in_scalar(const lull_patches *image);
void lull_points_int_scalar(const lull_conv *conv);
void lull_patches_out_scalar(const lull_patches *image);
void lull_pool_u8_scalar(uint8_t *out, const uint8_t *above, const uint8_t *below,
                         unsigned channels, unsigned pixels);
void lull_filter5_scalar(const lull_window *window);
void lull_encode_scalar(uint8_t *codes, const lull_encoding *from, unsigned pixels);
void lull_spread_scalar(float *out, size_t plane, const float *albedo, unsigned pixels);
void lull_demodulate_scalar(float *out, size_t plane, const lull_encoding *from,
                         const float *smooth, size_t smooth_plane, const uint8_t *codes,
                         size_t code_step, const float *table, unsigned pixels);
void lull_shrink_scalar(float *out, size_t out_plane, const float *above, const float *below,
                     size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                     unsigned pixels);
void lull_blend_scalar(const lull_blending *blending);
void lull_modulate_scalar(float *out, const float *v, size_t plane, const float *smooth,
                       size_t smooth_plane, float unscale, unsigned pixels);
void lull_luminance_scalar(float *sums, const float *pixels, unsigned n);
void lull_curve_in_scalar(float *values, const lull_curve *curve, size_t n);
void lull_curve_out_scalar(float *values, const lull_curve *curve, size_t n);

#endif
