/* NEON, on AArch64 and ARMv7. */
#include "port_neon.h"

void lull_port_neon(lull_kernels *kernels)
{
    kernels->block_f32 = 4;
    kernels->block_int = 4;
    kernels->conv_f32 = lull_conv_f32_neon;
    kernels->conv_int = lull_conv_int_neon;
    kernels->pool_u8 = lull_pool_u8_neon;
#if defined(__aarch64__) /* 32-bit NEON takes subnormals for zeros, so these would not be exact */
    kernels->pool_f32 = lull_pool_f32_neon;
    kernels->filter5 = lull_filter5_neon;
#endif
}
