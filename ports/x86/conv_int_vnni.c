/* Integer convolution with AVX512-VNNI. As intrinsics, gcc 12 moves the sums around in memory. */
#include "port_vnni.h"

#define CONV lull_conv_int_vnni
#define CONV3 lull_conv_int3_vnni
#if LULL_X86_ASM
#define DOT_NARROW(sum, x, w) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#define DOT_WIDE(sum, x, w) __asm__("vpdpwssd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#else
#define DOT_NARROW(sum, x, w) sum = _mm512_dpbusd_epi32(sum, x, w)
#define DOT_WIDE(sum, x, w) sum = _mm512_dpwssd_epi32(sum, x, w)
#endif

#define SHARE_COLUMNS
#include "conv_int_512.h"
#include "conv_int3_512.h"
