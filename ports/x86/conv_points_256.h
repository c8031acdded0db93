/* Products at points of patches, with vectors of 8 outputs: for AVX2 and its extensions. The
 * including file defines DOT (conv_points_tile.h) and POINTS (the function's name). */
#include "tiles.h"

#define LANES 8u

typedef __m256i vec;

LULL_INLINE vec zero(void) { return _mm256_setzero_si256(); }
LULL_INLINE vec load(const void *p) { return _mm256_loadu_si256((const __m256i *)p); }
LULL_INLINE vec splat(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm256_set1_epi32(v);
}

LULL_INLINE void store(void *out, vec sum, unsigned n)
{
    if (n >= LANES)
        _mm256_storeu_si256((__m256i *)out, sum);
    else
        _mm256_maskstore_epi32((int *)out,
                               _mm256_cmpgt_epi32(_mm256_set1_epi32((int)n),
                                                  _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)),
                               sum);
}

#define TEMPLATE "conv_points_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#define TILE_2 6
#define TILE_1 12
#include "shapes_256.h"

void POINTS(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
