#ifndef LULL_PORT_AVXVNNI_H
#define LULL_PORT_AVXVNNI_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVXVNNI__) || !defined(__AVX2__))
#error "this file is compiled with -mavx2 -mavxvnni"
#endif

void lull_conv_int_avxvnni(const lull_conv *conv);
void lull_conv_int3_avxvnni(const lull_conv *conv);
void lull_points_int_avxvnni(const lull_conv *conv);

#endif
