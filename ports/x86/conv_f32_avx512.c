/* fp32 convolution: vectors over 16 output channels; tiles of 24 accumulators. */
#include "port_avx512.h"
#include "tiles.h"

#define LANES 16u
typedef __m512 vec;

LULL_INLINE vec load(const float *p) { return _mm512_loadu_ps(p); }
LULL_INLINE vec splat(const float *p) { return _mm512_set1_ps(*p); }
LULL_INLINE vec madd(vec x, vec w, vec sum) { return _mm512_fmadd_ps(x, w, sum); }
LULL_INLINE vec most(vec a, vec b) { return _mm512_max_ps(a, b); }

LULL_INLINE void store(float *out, vec sum, unsigned n)
{
    if (n >= LANES)
        _mm512_storeu_ps(out, sum);
    else
        _mm512_mask_storeu_ps(out, (__mmask16)((1u << n) - 1), sum);
}

#define TEMPLATE "conv_f32_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_512.h"

void lull_conv_f32_avx512(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
