/* Winograd's form of a 3x3 convolution in integers, F(4x4, 3x3), or F(2x2, 3x3) of wide codes;
 * docs/arithmetic.md has the formulas. The same sums as the direct form's, to the bit.
 *
 * Four rows of pixels are cut into patches of four columns. A patch is computed from 36 points, 6 *
 * (row of points) + column of points, of 16 bits: at each, one product of channels and outputs
 * takes the place of nine for each of the 16 pixels.
 *
 * Of a source upsampled by 2, patches lie on the small picture, and each makes four: those of the
 * four phases, whose 2x2 taps count as 3x3 taps with zeros. All have the same points; eleven of
 * each phase's weights vanish.
 *
 * Wide codes up to LULL_PATCH_WIDE_MAX, of a layer that has no other source and does not pool: rows
 * are cut two by two, into patches of two columns. 16 points, 4 * row + column.
 */
#ifndef LULL_PATCHES_H
#define LULL_PATCHES_H

#include "base.h"

#define LULL_PATCH_SIDE 4u
#define LULL_PATCH_POINTS 36u
#define LULL_PATCH_CHANNELS 16u /* channels and outputs are multiples of this */

/* What `sums` are of a pixel's sum of products y: 576 y modulo 2^32. The inverse of 9 modulo 2^32
 * and a shift by 6 make y of them if |y| < LULL_PATCH_LIMIT. */
#define LULL_PATCH_INVERSE 954437177u
#define LULL_PATCH_SHIFT 6u
#define LULL_PATCH_LIMIT (1 << 25)

/* What patches_out keeps between its two directions. */
#define LULL_PATCH_ROOM (24u * LULL_PATCH_CHANNELS)

#define LULL_PATCH_WIDE_SIDE 2u
#define LULL_PATCH_WIDE_POINTS 16u
#define LULL_PATCH_WIDE_MAX 8191
/* Sums are 4 y modulo 2^32. */
#define LULL_PATCH_WIDE_SHIFT 2u
#define LULL_PATCH_WIDE_LIMIT (1 << 29)

/* Taps of what is not upsampled, where a phase is asked for. */
#define LULL_PATCH_WHOLE 4u
#define LULL_PATCH_PHASE_POINTS 25u /* that do not vanish */

/* Of a phase, 2 * (y & 1) + (x & 1), the row and the column of points whose weights vanish: the
 * taps of even rows (or columns) are the first two of three, those of odd ones the last two. 6, or
 * none, of LULL_PATCH_WHOLE. */
LULL_INLINE unsigned lull_patch_no_row(unsigned phase)
{
    return phase == LULL_PATCH_WHOLE ? 6 : phase >> 1 ? 0 : 5;
}
LULL_INLINE unsigned lull_patch_no_column(unsigned phase)
{
    return phase == LULL_PATCH_WHOLE ? 6 : phase & 1 ? 0 : 5;
}
LULL_INLINE int lull_patch_vanishes(unsigned phase, unsigned k)
{
    return k / 6 == lull_patch_no_row(phase) || k % 6 == lull_patch_no_column(phase);
}

LULL_INLINE unsigned lull_patch_side(int is_wide)
{
    return is_wide ? LULL_PATCH_WIDE_SIDE : LULL_PATCH_SIDE;
}
LULL_INLINE unsigned lull_patch_points(int is_wide)
{
    return is_wide ? LULL_PATCH_WIDE_POINTS : LULL_PATCH_POINTS;
}

/* What the kernels are given.
 *
 * patches_in makes the points of every patch and channel from the six rows (four of wide codes)
 * that they see. A row points to the column left of the first patch.
 *
 * patches_out makes rows of codes from sums at the points, requantised as conv_int does
 * (kernels.h). Sums at points where the weights of `phase` vanish count as
 * 0 and are not read. a = ((y + (1 << shift >> 1)) >> shift) + bias; the shift is for wide codes,
 * which know of nothing that follows. If is_pooled, the 2x2 maxima of rows 0 and 1, and
 * 2 and 3, go to out[0] and out[1]. If is_raw, it stores a itself, as int32_t, raw_step elements
 * from one pixel to the next. `start`: NULL, or what stands in the place of bias for each pixel,
 * `channels` elements from one to the next, start_row from row to row (not if is_pooled). */
typedef struct lull_patches {
    const uint8_t *row[6]; /* in: [column][channel] */
    uint8_t *out[4];       /* out: [column][channel] */
    int16_t *points;       /* in: point k of patch p: points + k * plane + p * channels */
    int32_t *sums;         /* out: the same */
    int32_t *room;         /* out: LULL_PATCH_ROOM elements of its own, but of wide codes */
    const int32_t *bias;   /* out, like the next two */
    const int32_t *multiplier;
    const int32_t *start; /* out */
    size_t start_row, raw_step;
    int32_t out_max; /* above 255: words are stored */
    size_t plane;
    unsigned channels, patches, shift;
    unsigned phase; /* out: LULL_PATCH_WHOLE where there are none */
    int is_wide, is_pooled, is_raw;
    int is_small; /* out: as in lull_conv */
} lull_patches;

#endif
