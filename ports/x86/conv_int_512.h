/* Integer convolution with vectors of 16 outputs, for AVX-512 and its extensions. The including
 * file defines DOT_NARROW and DOT_WIDE (see conv_int_tile.h), CONV (the function's name), DOT_WORDS
 * where that pays, and SHARE_COLUMNS where tiles that read columns once fit the registers. */
#include "finish_512.h"

#define FINISH_FOUR
#define IS_WORDS 0
#define IS_SMALL 0
#define TEMPLATE "conv_int_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_512.h"

#undef IS_SMALL
#define IS_SMALL 1
#define TEMPLATE "conv_int_tile.h"
#define SHAPES small_shapes
#define SHAPE(vectors) small_##vectors
#include "shapes_512.h"

LULL_INLINE vec widened(vec a) { return _mm512_madd_epi16(a, _mm512_set1_epi16(1)); }

#include "shapes_words.h"

#if defined(SHARE_COLUMNS)
#define TILE slide_2
#define VECTORS 2
#include "conv_int_slide.h"

#define TILE slide_1
#define VECTORS 1
#include "conv_int_slide.h"

/* Where pixels share columns in all segments, tiles that read each column once load less: those of
 * two vectors no more than tiles of four that do not. */
static const tile_shape slide_shapes[] = {
    {slide_2, 2, 12}, {slide_1, 1, 24}, {small_1, 1, 12}, {pixel_1, 1, 1}};

static int shares_columns(const lull_conv *conv)
{
    for (unsigned s = 0; s < conv->segments; s++) {
        unsigned share = tile_share(&conv->segment[s], conv->segment[s].step);
        if (share == SHARE_NONE || (share == SHARE_ENDS && conv->outputs > LANES))
            return 0;
    }
    return conv->pixels >= slide_shapes[0].pixels;
}
#endif

void CONV(const lull_conv *conv)
{
#if defined(SHARE_COLUMNS)
    if (conv->is_small && !conv->wide && conv->out_max <= 255 && shares_columns(conv)) {
        run_tiles(conv, slide_shapes, LANES, 1);
        return;
    }
#endif
    run_tiles(conv,
              conv->fits_words ? word_shapes
              : conv->is_small ? small_shapes
                               : shapes,
              LANES, 1);
}
