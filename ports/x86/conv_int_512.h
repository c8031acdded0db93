/* Integer convolution with vectors of 16 outputs, for AVX-512 and its extensions. The including
 * file defines DOT_NARROW and DOT_WIDE (see conv_int_tile.h), SLIDE_VECTORS (tiles of up to so many
 * vectors read columns once) and CONV (the function's name). */
#include "finish_512.h"

#define FINISH_FOUR
#define IS_SMALL 0
#define TEMPLATE "conv_int_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_512.h"

#if SMALL_SUMS
#undef IS_SMALL
#define IS_SMALL 1
#define TEMPLATE "conv_int_tile.h"
#define SHAPES small_shapes
#define SHAPE(vectors) small_##vectors
#include "shapes_512.h"

#if SLIDE_VECTORS > 1
/* 1 if pixels share columns in all segments: then tiles of two vectors, which read each column
 * once, load less than those of four. */
static int slides(const lull_conv *conv)
{
    for (unsigned s = 0; s < conv->segments; s++)
        if (s < conv->wide || !tile_taps(&conv->segment[s], conv->segment[s].step))
            return 0;
    return 1;
}
#else
static int slides(const lull_conv *conv) { return (void)conv, 0; }
#endif
#endif

void CONV(const lull_conv *conv)
{
#if SMALL_SUMS
    if (conv->is_small) {
        run_tiles(conv, slides(conv) ? small_shapes + 2 : small_shapes, LANES, 1);
        return;
    }
#endif
    run_tiles(conv, shapes, LANES, 1);
}
