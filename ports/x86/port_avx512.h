#ifndef LULL_PORT_AVX512_H
#define LULL_PORT_AVX512_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__AVX512F__) || !defined(__AVX512BW__) || !defined(__AVX512VL__) || \
                      !defined(__AVX512DQ__))
#error "this file is compiled with -mavx512f -mavx512bw -mavx512vl -mavx512dq"
#endif

/* Of these the port fills what port_avx512.c names: lull_<slot>_avx512. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_avx512 parameters;
#include "kernels.def"

#endif
