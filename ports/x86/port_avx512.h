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
void lull_filter5_avx512(float *out, const float *const *rows, const uint8_t *codes,
                         size_t code_step, const float *table, unsigned pixels);

#endif
