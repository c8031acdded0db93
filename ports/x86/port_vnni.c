/* AVX-512 with VNNI: dot products of bytes and words in one instruction. */
#include "port_vnni.h"

void lull_port_vnni(lull_kernels *kernels)
{
    kernels->block_int = 16;
    kernels->in_planes = 0;
    kernels->has_halves = kernels->halves_pay;
    kernels->conv_int = kernels->has_halves ? lull_conv_int_vnni_halves : lull_conv_int_vnni;
    kernels->conv_int3 = lull_conv_int3_vnni;
    kernels->patches_u = kernels->adds_beside ? LULL_PATCHES_OWN : LULL_PATCHES_WIDE;
    kernels->patches_k = LULL_PATCHES_NONE;
    kernels->points_int = lull_points_int_vnni;
}
