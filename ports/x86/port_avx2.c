/* AVX2 and FMA. */
#include "port_avx2.h"

void lull_port_avx2(lull_kernels *kernels)
{
    kernels->block_f32 = 8;
    kernels->block_int = 8;
    kernels->conv_f32 = lull_conv_f32_avx2;
    kernels->winograd_in = lull_winograd_in_avx2;
    kernels->winograd_out = lull_winograd_out_avx2;
    kernels->pool_f32 = lull_pool_f32_avx2;
    kernels->conv_int = lull_conv_int_avx2;
    kernels->conv_int3 = lull_conv_int3_avx2;
    kernels->in_planes = 1;
    kernels->head = lull_head_avx2;
    kernels->patches_u = LULL_PATCHES_UP;
    kernels->patches_k = LULL_PATCHES_OWN;
    kernels->patches_in = lull_patches_in_avx2;
    kernels->points_int = lull_points_int_avx2;
    kernels->patches_out = lull_patches_out_avx2;
    kernels->pool_u8 = lull_pool_u8_avx2;
    kernels->filter5 = lull_filter5_avx2;
    kernels->encode = lull_encode_avx2;
    kernels->spread = lull_spread_avx2;
    kernels->spread_xyz = lull_spread_xyz_avx2;
    kernels->guide = lull_guide_avx2;
    kernels->demodulate = lull_demodulate_avx2;
    kernels->shrink = lull_shrink_avx2;
    kernels->blend = lull_blend_avx2;
    kernels->noise = lull_noise_avx2;
    kernels->bilateral = lull_bilateral_avx2;
    kernels->fit_sums = lull_fit_sums_avx2;
    kernels->fit = lull_fit_avx2;
    kernels->regress = lull_regress_avx2;
    kernels->residual = lull_residual_avx2;
    kernels->edges = lull_edges_avx2;
    kernels->grain_sums = lull_grain_sums_avx2;
    kernels->take_grain = lull_take_grain_avx2;
    kernels->modulate = lull_modulate_avx2;
    kernels->luminance = lull_luminance_avx2;
#if !LULL_EMULATE
    kernels->curve_in = lull_curve_in_avx2;
    kernels->curve_out = lull_curve_out_avx2;
#endif
}
