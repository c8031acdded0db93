/* Dot products of bytes. */
#include "port_dotprod.h"

void lull_port_dotprod(lull_kernels *kernels)
{
    kernels->block_int = 4;
    kernels->conv_int = lull_conv_int_dotprod;
}
