/* Integer convolution with AVX-VNNI. */
#include "port_avxvnni.h"

#define CONV lull_conv_int_avxvnni
#define CONV3 lull_conv_int3_avxvnni
#define TILE_2 6
#define TILE_1 12
#if LULL_X86_ASM
#define DOT_NARROW(sum, x, w) __asm__("%{vex%} vpdpbusd %2, %1, %0" : "+x"(sum) : "x"(x), "x"(w))
#define DOT_WIDE(sum, x, w) __asm__("%{vex%} vpdpwssd %2, %1, %0" : "+x"(sum) : "x"(x), "x"(w))
#else
#define DOT_NARROW(sum, x, w) sum = _mm256_dpbusd_avx_epi32(sum, x, w)
#define DOT_WIDE(sum, x, w) sum = _mm256_dpwssd_avx_epi32(sum, x, w)
#endif

#include "conv_int_256.h"
#include "conv_int3_256.h"
