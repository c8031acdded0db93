/* The scalar port: plain C, every slot. The reference of the other ports. */
#include "port_scalar.h"

void lull_port_scalar(lull_kernels *kernels)
{
    kernels->block_f32 = LULL_SCALAR_BLOCK;
    kernels->block_int = LULL_SCALAR_BLOCK;
    kernels->splits_wide = 0;
    kernels->in_planes = 0;
    kernels->patches_u = LULL_PATCHES_NONE;
    kernels->patches_k = LULL_PATCHES_NONE;
#define KERNEL(name, parameters, tolerance, purpose) kernels->name = lull_##name##_scalar;
#include "kernels.def"
}
