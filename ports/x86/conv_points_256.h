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

#define TILE tile_2
#define VECTORS 2
#define PIXELS 6
#include "conv_points_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 12
#include "conv_points_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_points_tile.h"

static const tile_shape shapes[] = {{tile_2, 2, 6}, {tile_1, 1, 12}, {pixel_1, 1, 1}};

void POINTS(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
