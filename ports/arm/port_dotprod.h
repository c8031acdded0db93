#ifndef LULL_PORT_DOTPROD_H
#define LULL_PORT_DOTPROD_H

#include "kernels.h"

#if !defined(__ARM_FEATURE_DOTPROD)
#error "this file is compiled with -march=armv8.2-a+dotprod"
#endif

void lull_conv_int_dotprod(const lull_conv *conv);

#endif
