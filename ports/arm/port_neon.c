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
    kernels->winograd_in = lull_winograd_in_neon;
    kernels->winograd_out = lull_winograd_out_neon;
    kernels->filter5 = lull_filter5_neon;
    kernels->encode = lull_encode_neon;
    kernels->spread = lull_spread_neon;
    kernels->spread_xyz = lull_spread_xyz_neon;
    kernels->guide = lull_guide_neon;
    kernels->demodulate = lull_demodulate_neon;
    kernels->shrink = lull_shrink_neon;
    kernels->blend = lull_blend_neon;
    kernels->noise = lull_noise_neon;
    kernels->bilateral = lull_bilateral_neon;
    kernels->fit_sums = lull_fit_sums_neon;
    kernels->fit = lull_fit_neon;
    kernels->regress = lull_regress_neon;
    kernels->residual = lull_residual_neon;
    kernels->edges = lull_edges_neon;
    kernels->grain_sums = lull_grain_sums_neon;
    kernels->take_grain = lull_take_grain_neon;
    kernels->modulate = lull_modulate_neon;
    kernels->luminance = lull_luminance_neon;
#endif
}
