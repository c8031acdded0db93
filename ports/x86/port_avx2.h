#ifndef LULL_PORT_AVX2_H
#define LULL_PORT_AVX2_H

#include "kernels.h"

#if !defined(__AVX2__) || !defined(__FMA__)
#error "this file is compiled with -mavx2 -mfma"
#endif

void lull_conv_f32_avx2(const lull_conv *conv);

#endif
