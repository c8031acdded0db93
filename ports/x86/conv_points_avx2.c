/* Products at points of patches: pairs of words are multiplied and added. */
#include "port_avx2.h"

#define POINTS lull_points_int_avx2
#if LULL_X86_ASM
#define ADD_IN_PLACE(sum, t) __asm__("vpaddd %1, %0, %0" : "+x"(sum) : "x"(t))
#else
#define ADD_IN_PLACE(sum, t) sum = _mm256_add_epi32(sum, t)
#endif
#define DOT(sum, x, w) ADD_IN_PLACE(sum, _mm256_madd_epi16(x, w))

#include "conv_points_256.h"
