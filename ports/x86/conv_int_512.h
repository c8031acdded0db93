/* Integer convolution with vectors of 16 outputs, for AVX-512 and its extensions. The including
 * file defines DOT_NARROW and DOT_WIDE (see conv_int_tile.h), SLIDE_VECTORS (tiles of up to so many
 * vectors read columns once) and CONV (the function's name). */
#include "finish_512.h"

#define FINISH_FOUR
#define IS_SMALL 0
#define TILE tile_4
#define VECTORS 4
#define PIXELS 6
#include "conv_int_tile.h"

#define TILE tile_3
#define VECTORS 3
#define PIXELS 8
#include "conv_int_tile.h"

#define TILE tile_2
#define VECTORS 2
#define PIXELS 12
#include "conv_int_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 12
#include "conv_int_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {
    {tile_4, 4, 6}, {tile_3, 3, 8}, {tile_2, 2, 12}, {tile_1, 1, 12}, {pixel_1, 1, 1}};

#if SMALL_SUMS
#undef IS_SMALL
#define IS_SMALL 1
#define TILE small_4
#define VECTORS 4
#define PIXELS 6
#include "conv_int_tile.h"

#define TILE small_3
#define VECTORS 3
#define PIXELS 8
#include "conv_int_tile.h"

#define TILE small_2
#define VECTORS 2
#define PIXELS 12
#include "conv_int_tile.h"

#define TILE small_1
#define VECTORS 1
#define PIXELS 12
#include "conv_int_tile.h"

static const tile_shape small_shapes[] = {
    {small_4, 4, 6}, {small_3, 3, 8}, {small_2, 2, 12}, {small_1, 1, 12}, {pixel_1, 1, 1}};

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
    if (conv->is_small && conv->out_max <= 255) {
        run_tiles(conv, slides(conv) ? small_shapes + 2 : small_shapes, LANES, 1);
        return;
    }
#endif
    run_tiles(conv, shapes, LANES, 1);
}
