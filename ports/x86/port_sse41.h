#ifndef LULL_PORT_SSE41_H
#define LULL_PORT_SSE41_H

#include "intrinsics.h"
#include "kernels.h"

#if !LULL_EMULATE && (!defined(__SSE4_1__) || !defined(__SSSE3__))
#error "this file is compiled with -mssse3 -msse4.1"
#endif

/* Of these the port fills what port_sse41.c names: lull_<slot>_sse41. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_sse41 parameters;
#include "kernels.def"

#endif
