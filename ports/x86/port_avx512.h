#ifndef LULL_PORT_AVX512_H
#define LULL_PORT_AVX512_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX512F__) || !defined(__AVX512BW__) || !defined(__AVX512VL__) || \
                      !defined(__AVX512DQ__))
#error "this file is compiled with -mavx512f -mavx512bw -mavx512vl -mavx512dq"
#endif

void lull_conv_f32_avx512(const lull_conv *conv);
void lull_conv_int_avx512(const lull_conv *conv);
void lull_conv_int3_avx512(const lull_conv *conv);
void lull_winograd_in_avx512(const lull_winograd *image);
void lull_winograd_out_avx512(const lull_winograd *image);
void lull_patches_in_avx512(const lull_patches *image);
void lull_points_int_avx512(const lull_conv *conv);
void lull_patches_out_avx512(const lull_patches *image);
void lull_filter5_avx512(const lull_window *window);
void lull_encode_avx512(uint8_t *codes, const lull_encoding *from, unsigned pixels);
void lull_spread_avx512(float *out, size_t plane, const float *albedo, unsigned pixels);
void lull_demodulate_avx512(float *out, size_t plane, const lull_encoding *from,
                         const float *smooth, size_t smooth_plane, const uint8_t *codes,
                         size_t code_step, const float *table, unsigned pixels);
void lull_shrink_avx512(float *out, size_t out_plane, const float *above, const float *below,
                     size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                     unsigned pixels);
void lull_blend_avx512(const lull_blending *blending);
void lull_noise_avx512(uint8_t *noise, const lull_surface *at, const lull_encoding *from,
                     const float *smooth, size_t smooth_plane, unsigned pixels);
void lull_bilateral_avx512(const lull_smoothing *smoothing);
void lull_modulate_avx512(float *out, const float *v, size_t plane, const float *smooth,
                       size_t smooth_plane, float unscale, unsigned pixels);
void lull_luminance_avx512(float *sums, const float *pixels, unsigned n);
void lull_curve_in_avx512(float *values, const lull_curve *curve, size_t n);
void lull_curve_out_avx512(float *values, const lull_curve *curve, size_t n);

#endif
