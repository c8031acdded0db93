#ifndef LULL_PORT_NEON_H
#define LULL_PORT_NEON_H

#include "kernels.h"

#if !defined(__ARM_NEON)
#error "this file is compiled with NEON: -mfpu=neon on 32-bit ARM"
#endif

void lull_conv_f32_neon(const lull_conv *conv);
void lull_conv_int_neon(const lull_conv *conv);
void lull_pool_f32_neon(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels);
void lull_pool_u8_neon(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels);
void lull_filter5_neon(const lull_window *window);
void lull_encode_neon(uint8_t *codes, const lull_encoding *from, unsigned pixels);
void lull_spread_neon(float *out, size_t plane, const float *albedo, unsigned pixels);
void lull_demodulate_neon(float *out, size_t plane, const lull_encoding *from, const float *smooth,
                         size_t smooth_plane, const uint8_t *codes, size_t code_step,
                         const float *table, unsigned pixels);
void lull_shrink_neon(float *out, size_t out_plane, const float *above, const float *below,
                     size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                     unsigned pixels);
void lull_blend_neon(const lull_blending *blending);
void lull_noise_neon(uint8_t *noise, const lull_surface *at, const lull_encoding *from,
                     const float *smooth, size_t smooth_plane, unsigned pixels);
void lull_bilateral_neon(const lull_smoothing *smoothing);
void lull_modulate_neon(float *out, const float *v, size_t plane, const float *smooth,
                       size_t smooth_plane, float unscale, unsigned pixels);
void lull_luminance_neon(float *sums, const float *pixels, unsigned n);

#endif
