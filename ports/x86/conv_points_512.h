/* Products at points of patches, with vectors of 16 outputs: for AVX-512 and its extensions. The
 * including file defines DOT (conv_points_tile.h) and POINTS (the function's name). */
#include "tiles.h"

#define LANES 16u

typedef __m512i vec;

LULL_INLINE vec zero(void) { return _mm512_setzero_si512(); }
LULL_INLINE vec load(const void *p) { return _mm512_loadu_si512(p); }
LULL_INLINE vec splat(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm512_set1_epi32(v);
}

LULL_INLINE void store(void *out, vec sum, unsigned n)
{
    if (n >= LANES)
        _mm512_storeu_si512(out, sum);
    else
        _mm512_mask_storeu_ps(out, (__mmask16)((1u << n) - 1), _mm512_castsi512_ps(sum));
}

#define TILE tile_4
#define VECTORS 4
#define PIXELS 6
#include "conv_points_tile.h"

#define TILE tile_3
#define VECTORS 3
#define PIXELS 8
#include "conv_points_tile.h"

#define TILE tile_2
#define VECTORS 2
#define PIXELS 12
#include "conv_points_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 12
#include "conv_points_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_points_tile.h"

static const tile_shape shapes[] = {
    {tile_4, 4, 6}, {tile_3, 3, 8}, {tile_2, 2, 12}, {tile_1, 1, 12}, {pixel_1, 1, 1}};

void POINTS(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
