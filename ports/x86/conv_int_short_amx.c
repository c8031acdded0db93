/* Integer convolution of few products for each sum, beside AMX: as with AVX512-VNNI, which every
 * CPU with tiles has. */
#include "port_amx.h"

#if LULL_HAS_TILES
#define CONV lull_conv_int_short_amx
#define DOT_NARROW(sum, x, w) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#define DOT_WIDE(sum, x, w) __asm__("vpdpwssd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))

#define SHARE_COLUMNS
#include "conv_int_512.h"
#endif
