/* AMX: products of whole tiles of bytes. */
#include "port_amx.h"

void lull_port_amx(lull_kernels *kernels)
{
#if LULL_HAS_TILES
    kernels->block_int = 16;
    kernels->in_planes = 0;
    kernels->has_halves = 0;
    kernels->splits_wide = 1;
    kernels->patches_u = LULL_PATCHES_NONE; /* tiles multiply bytes only */
    kernels->patches_k = LULL_PATCHES_NONE;
    kernels->conv_int = lull_conv_int_amx;
#else
    (void)kernels;
#endif
}
