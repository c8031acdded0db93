#ifndef LULL_PORT_I8MM_H
#define LULL_PORT_I8MM_H

#include "kernels.h"

#if !defined(__ARM_FEATURE_MATMUL_INT8)
#error "this file is compiled with -march=armv8.2-a+dotprod+i8mm"
#endif

void lull_conv_int_i8mm(const lull_conv *conv);

#endif
