/* The shapes of tiles of 256-bit vectors, and of words in 512-bit ones: two vectors by TILE_2
 * pixels, or one by TILE_1. Included once for each list, with TEMPLATE, SHAPES and SHAPE as for
 * shapes_512.h. */

#define TILE SHAPE(2)
#define VECTORS 2
#define PIXELS TILE_2
#include TEMPLATE

#define TILE SHAPE(1)
#define VECTORS 1
#define PIXELS TILE_1
#include TEMPLATE

#ifndef HAS_PIXEL_1
#define HAS_PIXEL_1
#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include TEMPLATE
#endif

static const tile_shape SHAPES[] = {
    {SHAPE(2), 2, TILE_2, 0}, {SHAPE(1), 1, TILE_1, 0}, {pixel_1, 1, 1, 0}};

#undef TEMPLATE
#undef SHAPES
#undef SHAPE
