/* Which tiles a convolution is cut into. */
#ifndef LULL_X86_TILES_H
#define LULL_X86_TILES_H

#include "kernels.h"

/* A tile function: n <= vectors * lanes outputs from `first` on of `pixels` pixels from p on. */
typedef struct tile_shape {
    void (*tile)(const lull_conv *conv, unsigned first, unsigned p, unsigned n);
    unsigned vectors, pixels;
} tile_shape;

/* Runs the whole convolution. The shapes are listed with decreasing numbers of vectors and end
 * with one of one vector and one pixel. For the outputs that are left, takes the first shape
 * whose vectors and pixels are not more than needed. The last tile of a row is moved back to
 * end at the last pixel. */
LULL_INLINE void run_tiles(const lull_conv *conv, const tile_shape *shapes, unsigned lanes)
{
    unsigned first = 0;
    while (first < conv->outputs) {
        unsigned n = conv->outputs - first;
        const tile_shape *shape = shapes;
        while (shape->vectors * shape->pixels > 1 &&
               ((shape->vectors - 1) * lanes >= n || shape->pixels > conv->pixels))
            shape++;
        n = lull_min_u(n, shape->vectors * lanes);
        for (unsigned p = 0; p < conv->pixels; p += shape->pixels)
            shape->tile(conv, first, lull_min_u(p, conv->pixels - shape->pixels), n);
        first += shape->vectors * lanes;
    }
}

#endif
