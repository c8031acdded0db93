/* The last step of family K's filter, which averages along surfaces whose light is even
 * (docs/kernel-prediction.md, step 6 of the filter). Models have it whose files ask for it.
 *
 * noise: what bilateral knows of n pixels beside their result. Codes are whole numbers, at most
 *     255: of the filtered albedo + epsilon A = LULL_ALBEDO_CODES smooth + 0.5, 3 planes; of the
 *     normal n those of `encode`, 128 if from->normal is NULL; of the noise, with d of a channel =
 *     |R / smooth - v| / (v + LULL_FILTER_EPSILON), LULL_NOISE_CODES ((d(r) + d(g)) + d(b)) + 0.5.
 *
 * bilateral: the smoothed result of pixels all of whose columns, up to LULL_BILATERAL_REACH to
 *     either side, are there (of the noise one to either side).
 */
#ifndef LULL_BILATERAL_H
#define LULL_BILATERAL_H

#include "base.h"

#define LULL_BILATERAL_REACH 12        /* columns to either side */
#define LULL_BILATERAL_CODES 7         /* bytes of a pixel: three pairs and the noise */
#define LULL_NOISE_CODES 128.0f        /* per 1 of noise */
#define LULL_NOISE_WIDTH 0.0017361111f /* of weights, per noise code of three pixels */
#define LULL_WIDEST 0.4f
#define LULL_NARROWEST 0.001f
#define LULL_ALBEDO_CODES 240.0f     /* per 1 of the albedo */
#define LULL_SURFACE_SCALE 0.000384f /* of squared differences of codes */

/* A row of the result, 3 planes, and of the codes beside it, 3 planes of pairs: (A(r), A(g)),
 * (A(b), n(x)), (n(y), n(z)). Each plane lies so many floats or bytes after the one before. */
typedef struct lull_surface {
    const float *v;
    uint8_t *pairs;
    size_t v_plane, pair_plane;
} lull_surface;

typedef struct lull_smoothing {
    float *out; /* 3 planes */
    const uint8_t *noise;
    size_t out_plane;
    lull_surface row, beside[4]; /* row y; y - 4, y - 2, y + 2, y + 4, or the nearest there is */
    unsigned pixels;
} lull_smoothing;

#endif
