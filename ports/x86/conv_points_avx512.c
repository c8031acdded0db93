/* Products at points of patches: pairs of words are multiplied and added. */
#include "port_avx512.h"

#define POINTS lull_points_int_avx512
#if LULL_X86_ASM
#define ADD_IN_PLACE(sum, t) __asm__("vpaddd %1, %0, %0" : "+v"(sum) : "v"(t))
#else
#define ADD_IN_PLACE(sum, t) sum = _mm512_add_epi32(sum, t)
#endif
#define DOT(sum, x, w) ADD_IN_PLACE(sum, _mm512_madd_epi16(x, w))

#include "conv_points_512.h"
