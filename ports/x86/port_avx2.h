#ifndef LULL_PORT_AVX2_H
#define LULL_PORT_AVX2_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX2__) || !defined(__FMA__))
#error "this file is compiled with -mavx2 -mfma"
#endif

/* Of these the port fills what port_avx2.c names: lull_<slot>_avx2. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_avx2 parameters;
#include "kernels.def"

#endif
