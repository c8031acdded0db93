/* AVX-512 F, BW, VL and DQ. Pooling is limited by memory: AVX2's serves. */
#include "port_avx512.h"

void lull_port_avx512(lull_kernels *kernels)
{
    kernels->block_f32 = 16;
    kernels->block_int = 16;
    kernels->in_planes = 0;
    kernels->conv_f32 = lull_conv_f32_avx512;
    kernels->winograd_in = lull_winograd_in_avx512;
    kernels->winograd_out = lull_winograd_out_avx512;
    kernels->conv_int = lull_conv_int_avx512;
    kernels->conv_int3 = lull_conv_int3_avx512;
    kernels->patches_u = LULL_PATCHES_UP;
    kernels->patches_k = LULL_PATCHES_OWN;
    kernels->patches_in = lull_patches_in_avx512;
    kernels->points_int = lull_points_int_avx512;
    kernels->patches_out = lull_patches_out_avx512;
#if !LULL_EMULATE /* it lacks the instructions */
    kernels->curve_in = lull_curve_in_avx512;
    kernels->curve_out = lull_curve_out_avx512;
    kernels->filter5 = lull_filter5_avx512;
    kernels->encode = lull_encode_avx512;
    kernels->spread = lull_spread_avx512;
    kernels->spread_xyz = lull_spread_xyz_avx512;
    kernels->guide = lull_guide_avx512;
    kernels->demodulate = lull_demodulate_avx512;
    kernels->shrink = lull_shrink_avx512;
    kernels->blend = lull_blend_avx512;
    kernels->noise = lull_noise_avx512;
    kernels->bilateral = lull_bilateral_avx512;
    kernels->fit_sums = lull_fit_sums_avx512;
    kernels->fit = lull_fit_avx512;
    kernels->regress = lull_regress_avx512;
    kernels->residual = lull_residual_avx512;
    kernels->edges = lull_edges_avx512;
    kernels->grain_sums = lull_grain_sums_avx512;
    kernels->take_grain = lull_take_grain_avx512;
    kernels->modulate = lull_modulate_avx512;
    kernels->luminance = lull_luminance_avx512;
#endif
}
