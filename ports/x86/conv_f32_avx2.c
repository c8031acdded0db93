/* fp32 convolution: vectors over 8 output channels; tiles of 2 vectors x 6 pixels or 1 x 12. */
#include "port_avx2.h"
#include "tiles.h"

#define LANES 8u
typedef __m256 vec;

LULL_INLINE vec load(const float *p) { return _mm256_loadu_ps(p); }
LULL_INLINE vec splat(const float *p) { return _mm256_broadcast_ss(p); }
LULL_INLINE vec madd(vec x, vec w, vec sum) { return _mm256_fmadd_ps(x, w, sum); }
LULL_INLINE vec most(vec a, vec b) { return _mm256_max_ps(a, b); }

LULL_INLINE void store(float *out, vec sum, unsigned n)
{
    if (n >= LANES)
        _mm256_storeu_ps(out, sum);
    else
        _mm256_maskstore_ps(out,
                            _mm256_cmpgt_epi32(_mm256_set1_epi32((int)n),
                                               _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)),
                            sum);
}

#define TEMPLATE "conv_f32_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#define TILE_2 6
#define TILE_1 12
#include "shapes_256.h"

void lull_conv_f32_avx2(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
