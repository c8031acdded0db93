#ifndef LULL_PORT_NEON_H
#define LULL_PORT_NEON_H

#include "kernels.h"

#if !defined(__ARM_NEON)
#error "this file is compiled with NEON: -mfpu=neon on 32-bit ARM"
#endif

/* Of these the port fills what port_neon.c names: lull_<slot>_neon. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_neon parameters;
#include "kernels.def"

#endif
