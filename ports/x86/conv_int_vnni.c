/* Integer convolution with AVX512-VNNI. */
#include "port_vnni.h"

#define CONV lull_conv_int_vnni
#define CONV_HALVES lull_conv_int_vnni_halves
#define CONV3 lull_conv_int3_vnni
#define SHARE_COLUMNS
#include "dot_vnni.h"
#include "conv_int_512.h"
#include "conv_int3_512.h"
