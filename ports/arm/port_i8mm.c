/* Matrix products of bytes. */
#include "port_i8mm.h"

void lull_port_i8mm(lull_kernels *kernels)
{
    kernels->block_int = 4;
    kernels->conv_int = lull_conv_int_i8mm;
}
