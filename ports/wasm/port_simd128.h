#ifndef LULL_PORT_SIMD128_H
#define LULL_PORT_SIMD128_H

#include "kernels.h"

#if !defined(__wasm_simd128__)
#error "this file is compiled with -msimd128"
#endif

/* Of these the port fills what port_simd128.c names: lull_<slot>_simd128. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_simd128 parameters;
#include "kernels.def"

#endif
