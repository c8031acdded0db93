/* Products at points of patches: dot products of words. */
#include "port_avxvnni.h"

#define POINTS lull_points_int_avxvnni
#if LULL_X86_ASM
#define DOT(sum, x, w) __asm__("%{vex%} vpdpwssd %2, %1, %0" : "+x"(sum) : "x"(x), "x"(w))
#else
#define DOT(sum, x, w) sum = _mm256_dpwssd_avx_epi32(sum, x, w)
#endif

#include "conv_points_256.h"
