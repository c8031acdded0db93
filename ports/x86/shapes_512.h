/* The shapes of tiles of 512-bit vectors: 24 sums, or 12 of one vector. Included once for each
 * list, with TEMPLATE (the file of a tile's function), SHAPES (the list's name; without it none is
 * made) and SHAPE(vectors) (those of its functions) defined; they are undefined at the end. Lists
 * end with pixel_1, which the first of a file makes. */

#define TILE SHAPE(4)
#define VECTORS 4
#define PIXELS 6
#include TEMPLATE

#define TILE SHAPE(3)
#define VECTORS 3
#define PIXELS 8
#include TEMPLATE

#define TILE SHAPE(2)
#define VECTORS 2
#define PIXELS 12
#include TEMPLATE

#define TILE SHAPE(1)
#define VECTORS 1
#define PIXELS 12
#include TEMPLATE

#ifndef HAS_PIXEL_1
#define HAS_PIXEL_1
#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include TEMPLATE
#endif

#if defined(SHAPES)
static const tile_shape SHAPES[] = {{SHAPE(4), 4, 6, 0},
                                    {SHAPE(3), 3, 8, 0},
                                    {SHAPE(2), 2, 12, 0},
                                    {SHAPE(1), 1, 12, 0},
                                    {pixel_1, 1, 1, 0}};
#endif

#undef TEMPLATE
#undef SHAPES
#undef SHAPE
