/* fp32 convolution: vectors over 4 output channels; tiles of 2 vectors x 6 pixels or 1 x 12.
 * Products and sums are rounded one by one, as in plain C. */
#include "port_sse41.h"
#include "tiles.h"

#define LANES 4u
typedef __m128 vec;

LULL_INLINE vec load(const float *p) { return _mm_loadu_ps(p); }
LULL_INLINE vec splat(const float *p) { return _mm_load1_ps(p); }
LULL_INLINE vec madd(vec x, vec w, vec sum) { return _mm_add_ps(sum, _mm_mul_ps(x, w)); }
LULL_INLINE vec most(vec a, vec b) { return _mm_max_ps(a, b); }

LULL_INLINE void store(float *out, vec sum, unsigned n)
{
    float part[LANES];
    _mm_storeu_ps(n < LANES ? part : out, sum);
    if (n < LANES)
        memcpy(out, part, n * sizeof *out);
}

#define TEMPLATE "conv_f32_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#define TILE_2 6
#define TILE_1 12
#include "shapes_256.h"

void lull_conv_f32_sse41(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
