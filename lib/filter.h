/* The filter of family K, one row segment at a time (docs/kernel-prediction.md). Rows hold
 * interleaved pixels; `codes` are those of the level's head. Fp32 in a fixed order: bit-equal on
 * every CPU. */
#ifndef LULL_FILTER_H
#define LULL_FILTER_H

#include "pack.h"

#define LULL_FILTER_EPSILON 0.02f
#define LULL_RADIANCE_MAX 65504.0f

/* Pixels whose sums are kept at a time. */
#define LULL_FILTER_RUN 32u

/* Channels of a head after the 25 logits of the radiance kernel. */
enum { LULL_HEAD_CONFIDENCE = 25, LULL_HEAD_BLEND = 26, LULL_HEAD_ALBEDO = 27 };

/* n pixels (r,g,b) to network codes, 12 a pixel: exposed radiance >= 0, albedo in [0,1] or NULL,
 * normals in [-1,1] or NULL. */
void lull_filter_encode(uint8_t *codes, const float *radiance, const float *albedo,
                        const float *normal, int is_clipped, unsigned n);

/* out (r,g,b): filtered albedo + epsilon. rows: five rows of (1,r,g,b), at the first pixel. */
void lull_filter_smooth(float *out, const lull_model *model, const float *const *rows,
                        const uint8_t *codes, size_t code_step, unsigned n);

/* out (C, C r, C g, C b) of radiance / smooth; `inside` pixels are in the image, the rest is zero.
 */
void lull_filter_demodulate(float *out, const lull_model *model, const float *radiance,
                            const float *smooth, const uint8_t *codes, size_t code_step, unsigned n,
                            unsigned inside);

/* out likewise at half the resolution, from two rows of 2n pixels. */
void lull_filter_pool(float *out, const lull_model *model, const float *above, const float *below,
                      const uint8_t *codes, size_t code_step, unsigned n);

/* out (r,g,b,beta) from five rows of confident radiance. */
void lull_filter_apply(float *out, const lull_model *model, const float *const *rows,
                       const uint8_t *codes, size_t code_step, unsigned n);

/* Rows and columns of the coarse level that a fine row segment is blended with. */
typedef struct lull_coarse {
    const float *near, *far; /* rows, at the coarse column of fine column 0 */
    int first, last;         /* coarse columns that exist, relative to that */
    unsigned channels;
} lull_coarse;

/* out: filtered + beta * (bilinear coarse - filtered), `channels` a pixel (3 or 4); the first fine
 * column is even. */
void lull_filter_blend(float *out, unsigned channels, const float *filtered,
                       const lull_coarse *coarse, unsigned n);

#endif
