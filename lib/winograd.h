/* Winograd's form of a 3x3 convolution in fp32, F(2x4, 3x3); docs/arithmetic.md has the formulas.
 *
 * Two rows of pixels are cut into patches of four columns. A patch is computed from 24 points, 6 *
 * (row of points) + column of points: at each, one product of channels and outputs takes the place
 * of nine for each of the eight pixels. Points are made by adding, and made into pixels likewise.
 */
#ifndef LULL_WINOGRAD_H
#define LULL_WINOGRAD_H

#include "base.h"

#define LULL_WINOGRAD_ROWS 2u
#define LULL_WINOGRAD_COLUMNS 4u
#define LULL_WINOGRAD_POINTS 24u
#define LULL_WINOGRAD_BIAS 7u /* a sum that this point alone has is added to all pixels */

/* 1 if point k is zero wherever the source is upsampled by 2. */
LULL_INLINE int lull_winograd_vanishes(unsigned k) { return k / 6 == 2 || k % 6 == 2; }

/* What the kernels are given.
 *
 * winograd_in makes the points of every patch and channel from the four rows that they see. A row
 * points to the column left of the first patch. Where the source is upsampled, the rows are those
 * of the small source (the two in the middle are the same), and points that vanish are not written.
 *
 * winograd_out makes rows of pixels, max(0, .), from points; or, if there is no second row, the 2x2
 * maxima of both. */
typedef struct lull_winograd {
    const float *row[4]; /* in: [column][channel] */
    float *out[2];       /* out: [column][channel]; out[1] may be NULL */
    float *points;       /* point k of patch p: points + k * plane + p * channels */
    size_t plane;
    unsigned channels, patches;
    unsigned is_up; /* in: 1 if the source is upsampled */
} lull_winograd;

#endif
