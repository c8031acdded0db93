/* What the tiles of the ARM ports share. A tile is VECTORS vectors of 4 output channels x
 * PIXELS pixels, made of named variables because compilers keep arrays of accumulators in
 * memory. */
#ifndef LULL_ARM_TILES_H
#define LULL_ARM_TILES_H

#include <arm_neon.h>

#include "kernels.h"

#define LANES 4u
#define MAX_VECTORS 4u

/* The pixels of a tile, as lists for macros. */
#define PIXELS_1(X) X(0)
#define PIXELS_2(X) X(0) X(1)
#define PIXELS_4(X) PIXELS_2(X) X(2) X(3)
#define PIXELS_5(X) PIXELS_4(X) X(4)
#define PIXELS_6(X) PIXELS_5(X) X(5)
#define PIXELS_8(X) PIXELS_6(X) X(6) X(7)
#define PIXELS_12(X) PIXELS_8(X) X(8) X(9) X(10) X(11)
/* The same in pairs. */
#define PAIRS_2(X) X(0, 1)
#define PAIRS_4(X) PAIRS_2(X) X(2, 3)
#define PAIRS_8(X) PAIRS_4(X) X(4, 5) X(6, 7)

/* gcc copies sums around loops and loads all weights of an unrolled loop at its top, both by
 * way of the stack. KEEP holds a vector in one register; no load moves across IN_ORDER. */
#if defined(__GNUC__)
#define KEEP(v) __asm__("" : "+w"(v))
#define IN_ORDER __asm__ volatile("" : : : "memory");
#else
#define KEEP(v) (void)0
#define IN_ORDER
#endif

#define PASTE_(a, b) a##b
#define PASTE(a, b) PASTE_(a, b)

/* A tile function: n <= vectors * LANES outputs from `first` on of `pixels` pixels from p on.
 * `bias` is that of output `first`. */
typedef struct tile_shape {
    void (*tile)(const lull_conv *conv, const void *bias, unsigned first, unsigned p, unsigned n);
    unsigned vectors, pixels;
} tile_shape;

/* The first shape whose vectors and pixels are not more than needed for n outputs. Shapes are
 * listed with decreasing numbers of vectors and end with one of one vector and one pixel. */
LULL_INLINE const tile_shape *choose_shape(const tile_shape *shape, unsigned n, unsigned pixels)
{
    while (shape->vectors * shape->pixels > 1 &&
           ((shape->vectors - 1) * LANES >= n || shape->pixels > pixels))
        shape++;
    return shape;
}

/* A row of tiles; the last one is moved back to end at the last pixel. */
LULL_INLINE void run_row(const lull_conv *conv, const tile_shape *shape, const void *bias,
                         unsigned first, unsigned n)
{
    for (unsigned p = 0; p < conv->pixels; p += shape->pixels)
        shape->tile(conv, bias, first, lull_min_u(p, conv->pixels - shape->pixels), n);
}

#endif
