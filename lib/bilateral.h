/* The last step of family K's filter, which averages along surfaces whose light is even
 * (docs/kernel-prediction.md, step 6 of the filter). Models have it whose files ask for it.
 *
 * noise: what bilateral knows of n pixels: codes of the normal as those of `encode` (planes 0 to 2;
 *     left alone if from->normal is NULL), and of the noise (plane 3): with d of a channel =
 *     |R / smooth - v| / (v + LULL_FILTER_EPSILON), the whole part of
 *     min(LULL_NOISE_CODES ((d(r) + d(g)) + d(b)) + 0.5, 255).
 *
 * bilateral: the smoothed result of pixels all of whose columns, up to LULL_BILATERAL_REACH to
 *     either side, are there. In the place of a row outside the image stands the row itself.
 */
#ifndef LULL_BILATERAL_H
#define LULL_BILATERAL_H

#include "base.h"

#define LULL_BILATERAL_REACH 8         /* columns to either side */
#define LULL_BILATERAL_CODES 4         /* planes of bytes of a surface */
#define LULL_NOISE_CODES 128.0f        /* per 1 of noise */
#define LULL_NOISE_WIDTH 0.0017361111f /* of weights, per noise code of three pixels */
#define LULL_WIDEST 0.4f
#define LULL_NARROWEST 0.001f
#define LULL_SMOOTH_SCALE 11.0f     /* of squared differences of the albedo, */
#define LULL_NORMAL_SCALE 0.000384f /* and of codes of the normal */

/* A row of the result and of the filtered albedo + epsilon (3 planes each), and of the codes beside
 * them: each plane so many elements after the one before. */
typedef struct lull_surface {
    const float *v, *smooth;
    const uint8_t *codes;
    size_t v_plane, smooth_plane, code_plane;
} lull_surface;

typedef struct lull_smoothing {
    float *out; /* 3 planes */
    size_t out_plane;
    lull_surface row, beside[4]; /* row y; y - 2, y - 1, y + 1, y + 2 */
    unsigned pixels;
} lull_smoothing;

#endif
