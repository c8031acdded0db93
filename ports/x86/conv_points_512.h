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

#define TEMPLATE "conv_points_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_512.h"

void POINTS(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
