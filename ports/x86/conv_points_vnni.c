/* Products at points of patches: dot products of words. As intrinsics, gcc 12 moves the sums
 * around in memory. */
#include "port_vnni.h"

#define POINTS lull_points_int_vnni
#if LULL_X86_ASM
#define DOT(sum, x, w) __asm__("vpdpwssd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#else
#define DOT(sum, x, w) sum = _mm512_dpwssd_epi32(sum, x, w)
#endif

#include "conv_points_512.h"
