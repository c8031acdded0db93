/* The last steps of family K's filter (docs/kernel-prediction.md, steps 6 and 7): averages along
 * surfaces whose light is even, and light that the result lacks. Models have them whose files ask
 * for them.
 *
 * noise: codes, whole numbers of at most 255, of pixels' noise: LULL_NOISE_CODES (D / (C (F +
 *     LULL_NOISE_EPSILON))) + 0.5, where D = (|V(r) - C f(r)| + |V(g) - C f(g)|) + |V(b) - C f(b)|
 *     and F = (f(r) + f(g)) + f(b). v: planes (C, V), confident radiance; f: 3 planes, filtered.
 *     255 where that is no number (C = 0).
 *
 * bilateral: the smoothed result of pixels all of whose columns, up to LULL_BILATERAL_REACH, or
 *     LULL_BILATERAL_FAR if is_far, to either side, are there (of the noise one to either side).
 *
 * residual: adds what n pixels make of their cell's balance to planes of sums. With V = (v(r)
 *     smooth(r) + v(g) smooth(g)) + v(b) smooth(b), R = (R(r) + R(g)) + R(b), L = V +
 *     LULL_BALANCE_EPSILON and q = min((R - V) (1 / L), LULL_MOST_LACKING): q, q q, (V (1 / L)) w,
 *     where w = min(noise code * LULL_NOISE_SHARE, 1), and min(max(q - LULL_SPARK, 0), 1), a count
 *     of sparks; 4 planes.
 */
#ifndef LULL_BILATERAL_H
#define LULL_BILATERAL_H

#include "base.h"

#define LULL_BILATERAL_REACH 6         /* columns to either side */
#define LULL_BILATERAL_FAR 12
#define LULL_NOISE_CODES 384.0f        /* per 1 of noise */
#define LULL_NOISE_EPSILON 0.06f       /* three times 0.02 */
#define LULL_NOISE_WIDTH 0.0026041667f /* of weights, per noise code of three pixels */
#define LULL_WIDEST 0.6f
#define LULL_NARROWEST 0.001f
#define LULL_GUIDE_SCALE 0.012288f /* of squared differences of codes */

#define LULL_CELL 16u              /* pixels, in either direction */
#define LULL_CELL_LEVEL 4u         /* log2 of it */
#define LULL_CELL_SUMS 4u          /* of a cell: q, q q, what may be corrected, sparks */
#define LULL_BALANCE_EPSILON 0.15f /* three times 0.05 */
#define LULL_NOISE_SHARE 0.05f     /* of a correction, per noise code */
#define LULL_MOST_LACKING 200.0f   /* of one pixel: single sparks are chance */
#define LULL_SPARK 2.0f
#define LULL_MOST_GAIN 0.5f
#define LULL_GAIN_REACH 64u /* columns to either side on which a correction depends */

/* A row of the result, 3 planes, `plane` floats apart, and its guide (kernels.h). */
typedef struct lull_surface {
    const float *v;
    const uint8_t *guide;
    size_t plane;
} lull_surface;

typedef struct lull_smoothing {
    float *out; /* 3 planes */
    const uint8_t *noise;
    size_t out_plane;
    lull_surface row, beside[4]; /* row y; y - 2, y + 2, y - 4, y + 4, or the nearest there is */
    int is_far;                  /* 1: with the pixels farthest away, else they need not be there */
    unsigned pixels;
} lull_smoothing;

/* Columns to either side, and rows of `beside`, that a smoothing looks at. */
LULL_INLINE int lull_bilateral_columns(int is_far)
{
    return is_far ? LULL_BILATERAL_FAR : LULL_BILATERAL_REACH;
}
LULL_INLINE unsigned lull_bilateral_rows(int is_far) { return is_far ? 4 : 2; }

/* Pixels of a row of the smoothed result, 3 planes, and what belongs to them; sums lie in planes,
 * sum_plane apart. */
typedef struct lull_balance {
    float *sums;
    const float *v, *smooth;
    const uint8_t *noise;
    size_t sum_plane, v_plane, smooth_plane;
    unsigned pixels;
} lull_balance;

/* The correction of a cell from the sums of it and those around it: of the sum of q the share that
 * is not chance, 1 - (sum of q q) / (sum of q)^2, which is 0 for one pixel and 1 - 1/n for n alike,
 * spread over what may be corrected. Few sparks are not light but fireflies: of n of them no more
 * counts than 20 + 0.3 n^2. */
LULL_INLINE float lull_cell_gain(float q, float squares, float base, float sparks)
{
    float share = 1.0f - squares / (q * q + 1e-6f), most = 20.0f + 0.3f * sparks * sparks;
    float gain = (share > 0.0f ? share : 0.0f) * (q < most ? q : most) / (base + 32.0f);
    gain = gain < -LULL_MOST_GAIN ? -LULL_MOST_GAIN : gain;
    return gain > LULL_MOST_GAIN ? LULL_MOST_GAIN : gain;
}

#endif
