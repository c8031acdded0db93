/* Products at points of patches: dot products of words. */
#include "port_vnni.h"

#define POINTS lull_points_int_vnni
#define DOT DOT_WIDE
#include "dot_vnni.h"
#include "conv_points_512.h"
