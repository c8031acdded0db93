/* AMX: products of whole tiles of bytes. Only in 64-bit programs. */
#include "port_amx.h"

void lull_port_amx(lull_kernels *kernels)
{
#if defined(__x86_64__)
    kernels->block_int = 16;
    kernels->splits_wide = 1;
    kernels->conv_int = lull_conv_int_amx;
#else
    (void)kernels;
#endif
}
