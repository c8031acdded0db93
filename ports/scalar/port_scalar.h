#ifndef LULL_PORT_SCALAR_H
#define LULL_PORT_SCALAR_H

#include "kernels.h"

/* Output channels of a weight block: enough for compilers to vectorise the inner loops. */
#define LULL_SCALAR_BLOCK 8u

/* Element `at` of integer outputs: a requantised, in a byte, or in a word if out_max is above 255.
 */
LULL_INLINE void lull_store_scalar(void *out, size_t at, int32_t a, int32_t multiplier,
                                   int32_t out_max)
{
    int64_t q = ((int64_t)a * multiplier + (1 << 30)) >> 31;
    q = q < 0 ? 0 : q > out_max ? out_max : q;
    if (out_max <= 255)
        ((uint8_t *)out)[at] = (uint8_t)q;
    else
        ((uint16_t *)out)[at] = (uint16_t)q;
}

/* Every slot: the port's function for it is lull_<slot>_scalar. */
#define KERNEL(name, parameters, tolerance, purpose) void lull_##name##_scalar parameters;
#include "kernels.def"

#endif
