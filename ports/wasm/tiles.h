/* What the tiles of the convolutions share. A tile is VECTORS vectors of 4 output channels x PIXELS
 * pixels; its loops over them have constant bounds, so that compilers unroll them and keep the sums
 * in registers. */
#ifndef LULL_WASM_TILES_H
#define LULL_WASM_TILES_H

#include <wasm_simd128.h>

#include "kernels.h"

#define LANES 4u

/* A tile function: n <= vectors * LANES outputs from `first` on of `pixels` pixels from p on. */
typedef struct tile_shape {
    void (*tile)(const lull_conv *conv, unsigned first, unsigned p, unsigned n);
    unsigned vectors, pixels;
} tile_shape;

/* All of a convolution. Shapes are listed with decreasing numbers of vectors, then of pixels, and
 * end with one of one vector and one pixel: the first that is not more than needed is taken. The
 * last tile of a row is moved back to end at the last pixel. */
LULL_INLINE void run_tiles(const lull_conv *conv, const tile_shape *shapes)
{
    for (unsigned first = 0; first < conv->outputs;) {
        const tile_shape *shape = shapes;
        unsigned left = conv->outputs - first, n;
        while (shape->vectors * shape->pixels > 1 &&
               ((shape->vectors - 1) * LANES >= left || shape->pixels > conv->pixels))
            shape++;
        n = lull_min_u(left, shape->vectors * LANES);
        for (unsigned p = 0; p < conv->pixels; p += shape->pixels)
            shape->tile(conv, first, lull_min_u(p, conv->pixels - shape->pixels), n);
        first += shape->vectors * LANES;
    }
}

/* The tile function of a shape: `tile` of the including file with constant bounds. */
#define TILE(vectors, pixels)                                                                     \
    static void tile_##vectors##x##pixels(const lull_conv *conv, unsigned first, unsigned p,      \
                                          unsigned n)                                             \
    {                                                                                             \
        tile(conv, first, p, n, vectors, pixels);                                                 \
    }

#endif
