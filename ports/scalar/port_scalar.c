/* The scalar port: plain C, every slot. The reference of the other ports. */
#include "port_scalar.h"

void lull_port_scalar(lull_kernels *kernels)
{
    kernels->block_f32 = LULL_SCALAR_BLOCK;
    kernels->block_int = LULL_SCALAR_BLOCK;
    kernels->splits_wide = 0;
    kernels->has_patches = 0;
    kernels->conv_f32 = lull_conv_f32_scalar;
    kernels->winograd_in = lull_winograd_in_scalar;
    kernels->winograd_out = lull_winograd_out_scalar;
    kernels->pool_f32 = lull_pool_f32_scalar;
    kernels->conv_int = lull_conv_int_scalar;
    kernels->conv_int3 = lull_conv_int3_scalar;
    kernels->patches_in = lull_patches_in_scalar;
    kernels->points_int = lull_points_int_scalar;
    kernels->patches_out = lull_patches_out_scalar;
    kernels->pool_u8 = lull_pool_u8_scalar;
    kernels->filter5 = lull_filter5_scalar;
    kernels->encode = lull_encode_scalar;
    kernels->spread = lull_spread_scalar;
    kernels->demodulate = lull_demodulate_scalar;
    kernels->shrink = lull_shrink_scalar;
    kernels->blend = lull_blend_scalar;
    kernels->modulate = lull_modulate_scalar;
    kernels->luminance = lull_luminance_scalar;
    kernels->curve_in = lull_curve_in_scalar;
    kernels->curve_out = lull_curve_out_scalar;
}
