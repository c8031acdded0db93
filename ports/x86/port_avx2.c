/* AVX2 and FMA. */
#include "port_avx2.h"

void lull_port_avx2(lull_kernels *kernels)
{
    kernels->block_f32 = 8;
    kernels->conv_f32 = lull_conv_f32_avx2;
}
