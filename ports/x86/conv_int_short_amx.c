/* Integer convolution of few products for each sum, beside AMX: as with AVX512-VNNI, which every
 * CPU with tiles has. */
#include "port_amx.h"

#if LULL_HAS_TILES
#define CONV lull_conv_int_short_amx
#define SHARE_COLUMNS
#include "dot_vnni.h"
#include "conv_int_512.h"
#endif
