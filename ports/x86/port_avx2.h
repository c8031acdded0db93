#ifndef LULL_PORT_AVX2_H
#define LULL_PORT_AVX2_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX2__) || !defined(__FMA__))
#error "this file is compiled with -mavx2 -mfma"
#endif

void lull_conv_f32_avx2(const lull_conv *conv);
void lull_conv_int_avx2(const lull_conv *conv);
void lull_conv_int3_avx2(const lull_conv *conv);
void lull_winograd_in_avx2(const lull_winograd *image);
void lull_winograd_out_avx2(const lull_winograd *image);
void lull_patches_in_avx2(const lull_patches *image);
void lull_points_int_avx2(const lull_conv *conv);
void lull_patches_out_avx2(const lull_patches *image);
void lull_pool_f32_avx2(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels);
void lull_pool_u8_avx2(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels);
void lull_filter5_avx2(const lull_window *window);
void lull_encode_avx2(uint8_t *codes, const lull_encoding *from, unsigned pixels);
void lull_spread_avx2(float *out, size_t plane, const float *albedo, unsigned pixels);
void lull_demodulate_avx2(float *out, size_t plane, const lull_encoding *from, const float *smooth,
                         size_t smooth_plane, const uint8_t *codes, size_t code_step,
                         const float *table, unsigned pixels);
void lull_shrink_avx2(float *out, size_t out_plane, const float *above, const float *below,
                     size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                     unsigned pixels);
void lull_blend_avx2(const lull_blending *blending);
void lull_noise_avx2(uint8_t *noise, const lull_surface *at, const lull_encoding *from,
                     const float *smooth, size_t smooth_plane, unsigned pixels);
void lull_bilateral_avx2(const lull_smoothing *smoothing);
void lull_modulate_avx2(float *out, const float *v, size_t plane, const float *smooth,
                       size_t smooth_plane, float unscale, unsigned pixels);
void lull_luminance_avx2(float *sums, const float *pixels, unsigned n);
void lull_curve_in_avx2(float *values, const lull_curve *curve, size_t n);
void lull_curve_out_avx2(float *values, const lull_curve *curve, size_t n);

#endif
