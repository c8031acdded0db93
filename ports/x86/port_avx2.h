#ifndef LULL_PORT_AVX2_H
#define LULL_PORT_AVX2_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX2__) || !defined(__FMA__))
#error "this file is compiled with -mavx2 -mfma"
#endif

void lull_conv_f32_avx2(const lull_conv *conv);
void lull_conv_int_avx2(const lull_conv *conv);
void lull_winograd_in_avx2(const lull_winograd *image);
void lull_winograd_out_avx2(const lull_winograd *image);
void lull_pool_f32_avx2(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels);
void lull_pool_u8_avx2(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels);
void lull_filter5_avx2(float *out, const float *const *rows, const uint8_t *codes, size_t code_step,
                       const float *table, unsigned pixels);

#endif
