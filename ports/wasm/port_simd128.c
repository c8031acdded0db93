/* WebAssembly with vectors of 128 bits. */
#include "port_simd128.h"

void lull_port_simd128(lull_kernels *kernels)
{
    kernels->block_f32 = 4;
    kernels->block_int = 4;
    kernels->conv_f32 = lull_conv_f32_simd128;
    kernels->pool_f32 = lull_pool_f32_simd128;
    kernels->conv_int = lull_conv_int_simd128;
    kernels->conv_int3 = lull_conv_int3_simd128;
    kernels->pool_u8 = lull_pool_u8_simd128;
    kernels->filter5 = lull_filter5_simd128;
    kernels->encode = lull_encode_simd128;
    kernels->spread = lull_spread_simd128;
    kernels->spread_xyz = lull_spread_xyz_simd128;
    kernels->guide = lull_guide_simd128;
    kernels->demodulate = lull_demodulate_simd128;
    kernels->shrink = lull_shrink_simd128;
    kernels->blend = lull_blend_simd128;
    kernels->noise = lull_noise_simd128;
    kernels->bilateral = lull_bilateral_simd128;
    kernels->fit_sums = lull_fit_sums_simd128;
    kernels->fit = lull_fit_simd128;
    kernels->regress = lull_regress_simd128;
    kernels->residual = lull_residual_simd128;
    kernels->edges = lull_edges_simd128;
    kernels->grain_sums = lull_grain_sums_simd128;
    kernels->take_grain = lull_take_grain_simd128;
    kernels->modulate = lull_modulate_simd128;
    kernels->luminance = lull_luminance_simd128;
}
