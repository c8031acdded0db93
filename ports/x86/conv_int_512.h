/* Integer convolution with vectors of 16 outputs, for AVX-512 and its extensions. The including
 * file defines DOT_NARROW and DOT_WIDE (see conv_int_tile.h), CONV (the function's name), DOT_WORDS
 * where that pays, and SHARE_COLUMNS where tiles that read columns once fit the registers; then
 * also DOT_HALF and CONV_HALVES, the function for CPUs to which half a vector is half the work. */
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

#define IS_HALF
#define TEMPLATE "conv_int_tile.h"
#define SHAPE(vectors) half_##vectors
#include "shapes_512.h"

#define TILE slide_half_2
#define VECTORS 2
#include "conv_int_slide.h"

#define TILE slide_half_1
#define VECTORS 1
#include "conv_int_slide.h"
#undef IS_HALF

/* Where pixels share columns in all segments, tiles that read each column once load less: those of
 * two vectors no more than tiles of four that do not. */
static const tile_shape slide_shapes[] = {
    {slide_2, 2, 12, 0}, {slide_1, 1, 24, 0}, {small_1, 1, 12, 0}, {pixel_1, 1, 1, 0}};

/* Both where half a vector takes half the time. */
static const tile_shape small_or_half_shapes[] = {
    {half_4, 4, 6, 1},   {small_4, 4, 6, 0}, {half_3, 3, 8, 1},
    {small_3, 3, 8, 0},  {half_2, 2, 12, 1}, {small_2, 2, 12, 0},
    {half_1, 1, 12, 1},  {small_1, 1, 12, 0}, {pixel_1, 1, 1, 0}};
static const tile_shape slide_or_half_shapes[] = {
    {slide_half_2, 2, 12, 1}, {slide_2, 2, 12, 0}, {slide_half_1, 1, 24, 1}, {slide_1, 1, 24, 0},
    {half_1, 1, 12, 1},       {small_1, 1, 12, 0}, {pixel_1, 1, 1, 0}};

static int shares_columns(const lull_conv *conv)
{
    for (unsigned s = 0; s < conv->segments; s++) {
        unsigned share = tile_share(&conv->segment[s], conv->segment[s].step);
        if (share == SHARE_NONE || (share == SHARE_ENDS && conv->outputs > LANES))
            return 0;
    }
    return conv->pixels >= slide_shapes[0].pixels;
}

/* bytes: the shapes for small sums without wide segments, of outputs in bytes; slide: for those of
 * shared columns. */
LULL_INLINE void run_shapes(const lull_conv *conv, const tile_shape *bytes, const tile_shape *slide)
{
    const tile_shape *chosen = shapes;
    if (conv->is_small)
        chosen = conv->wide || conv->out_max > 255 ? small_shapes
                 : shares_columns(conv)            ? slide
                                                   : bytes;
    run_tiles(conv, chosen, LANES, 1);
}

void CONV(const lull_conv *conv) { run_shapes(conv, small_shapes, slide_shapes); }

void CONV_HALVES(const lull_conv *conv)
{
    run_shapes(conv, small_or_half_shapes, slide_or_half_shapes);
}
#else
void CONV(const lull_conv *conv)
{
    run_tiles(conv,
              conv->fits_words ? word_shapes
              : conv->is_small ? small_shapes
                               : shapes,
              LANES, 1);
}
#endif
