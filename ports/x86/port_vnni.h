#ifndef LULL_PORT_VNNI_H
#define LULL_PORT_VNNI_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX512VNNI__) || !defined(__AVX512BW__) || !defined(__AVX512VL__))
#error "this file is compiled with -mavx512vnni -mavx512f -mavx512bw -mavx512vl -mavx512dq"
#endif

void lull_conv_int_vnni(const lull_conv *conv);
void lull_conv_int_vnni_halves(const lull_conv *conv);
void lull_conv_int3_vnni(const lull_conv *conv);
void lull_points_int_vnni(const lull_conv *conv);

#endif
