/* Integer convolution: pairs of bytes are multiplied and added in 16 bits, which pair-safe
 * weights never saturate, then widened by a multiplication with ones. */
#include "port_avx2.h"

#define CONV lull_conv_int_avx2
#define CONV3 lull_conv_int3_avx2
#define TILE_2 4
#define TILE_1 8
#if LULL_X86_ASM
#define ADD_IN_PLACE(sum, t) __asm__("vpaddd %1, %0, %0" : "+x"(sum) : "x"(t))
#define ADD_WORDS(sum, t) __asm__("vpaddw %1, %0, %0" : "+x"(sum) : "x"(t))
#else
#define ADD_IN_PLACE(sum, t) sum = _mm256_add_epi32(sum, t)
#define ADD_WORDS(sum, t) sum = _mm256_add_epi16(sum, t)
#endif

#define DOT_NARROW(sum, x, w) \
    ADD_IN_PLACE(sum, _mm256_madd_epi16(_mm256_maddubs_epi16(x, w), _mm256_set1_epi16(1)))
#define DOT_WORDS(sum, x, w) ADD_WORDS(sum, _mm256_maddubs_epi16(x, w))
#define DOT_WIDE(sum, x, w) ADD_IN_PLACE(sum, _mm256_madd_epi16(x, w))

#include "conv_int_256.h"
#include "conv_int3_256.h"
