/* SSE4.1, for CPUs without AVX2. */
#include "port_sse41.h"

void lull_port_sse41(lull_kernels *kernels)
{
    kernels->block_f32 = 4;
    kernels->block_int = 4;
    kernels->conv_f32 = lull_conv_f32_sse41;
    kernels->pool_f32 = lull_pool_f32_sse41;
    kernels->conv_int = lull_conv_int_sse41;
    kernels->conv_int3 = lull_conv_int3_sse41;
    kernels->pool_u8 = lull_pool_u8_sse41;
    kernels->filter5 = lull_filter5_sse41;
    kernels->encode = lull_encode_sse41;
    kernels->spread = lull_spread_sse41;
    kernels->spread_xyz = lull_spread_xyz_sse41;
    kernels->guide = lull_guide_sse41;
    kernels->demodulate = lull_demodulate_sse41;
    kernels->shrink = lull_shrink_sse41;
    kernels->blend = lull_blend_sse41;
    kernels->noise = lull_noise_sse41;
    kernels->bilateral = lull_bilateral_sse41;
    kernels->fit_sums = lull_fit_sums_sse41;
    kernels->fit = lull_fit_sse41;
    kernels->regress = lull_regress_sse41;
    kernels->residual = lull_residual_sse41;
    kernels->edges = lull_edges_sse41;
    kernels->grain_sums = lull_grain_sums_sse41;
    kernels->take_grain = lull_take_grain_sse41;
    kernels->modulate = lull_modulate_sse41;
    kernels->luminance = lull_luminance_sse41;
}
