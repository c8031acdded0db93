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

#define TILE tile_4
#define VECTORS 4
#define PIXELS 6
#include "conv_f32_tile.h"

#define TILE tile_3
#define VECTORS 3
#define PIXELS 8
#include "conv_f32_tile.h"

#define TILE tile_2
#define VECTORS 2
#define PIXELS 12
#include "conv_f32_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 12
#include "conv_f32_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_f32_tile.h"

static const tile_shape shapes[] = {
    {tile_4, 4, 6}, {tile_3, 3, 8}, {tile_2, 2, 12}, {tile_1, 1, 12}, {pixel_1, 1, 1}};

void lull_conv_f32_avx512(const lull_conv *conv) { run_tiles(conv, shapes, LANES, 0); }
