/* AVX2 with AVX-VNNI: dot products of bytes and words in one instruction. */
#include "port_avxvnni.h"

void lull_port_avxvnni(lull_kernels *kernels)
{
    kernels->block_int = 8;
    kernels->in_planes = 0;
    kernels->conv_int = lull_conv_int_avxvnni;
    kernels->conv_int3 = lull_conv_int3_avxvnni;
    kernels->patches_u = LULL_PATCHES_OWN; /* upsampled sources: vpdpbusd is as fast */
    kernels->patches_k = LULL_PATCHES_OWN;
    kernels->points_int = lull_points_int_avxvnni;
}
