/* The filter of family K, one row segment at a time (docs/kernel-prediction.md). Rows hold
 * interleaved pixels; `codes` are those of the level's head. Fp32 in a fixed order: bit-equal on
 * every CPU. */
#ifndef LULL_FILTER_H
#define LULL_FILTER_H

#include "pack.h"

/* Pixels whose sums are kept at a time. */
#define LULL_FILTER_RUN 32u

/* Channels of a head after the 25 logits of the radiance kernel. */
enum { LULL_HEAD_CONFIDENCE = 25, LULL_HEAD_BLEND = 26, LULL_HEAD_ALBEDO = 27 };

/* The flags of lull_encoding for the auxiliary images that it has. */
uint32_t lull_filter_flags(const lull_encoding *from, int is_clipped);

/* out (r,g,b): filtered albedo + epsilon. rows: five rows of (1,r,g,b), at the first pixel. */
void lull_filter_smooth(float *out, const lull_model *model, const float *const *rows,
                        const uint8_t *codes, size_t code_step, unsigned n);

/* out (C, C r, C g, C b) of radiance / smooth. */
void lull_filter_demodulate(float *out, const lull_model *model, const lull_encoding *from,
                            const float *smooth, const uint8_t *codes, size_t code_step,
                            unsigned n);

/* out likewise at half the resolution, from two rows of 2n pixels. */
void lull_filter_pool(float *out, const lull_model *model, const float *above, const float *below,
                      const uint8_t *codes, size_t code_step, unsigned n);

/* out (r,g,b,beta) from five rows of confident radiance. */
void lull_filter_apply(float *out, const lull_model *model, const float *const *rows,
                       const uint8_t *codes, size_t code_step, unsigned n);

/* Rows, 4 floats a pixel, and columns of the coarse level that a fine row is blended with. */
typedef struct lull_coarse {
    const float *near, *far; /* rows, at the coarse column of fine column 0 */
    int first, last;         /* coarse columns that exist, relative to that */
} lull_coarse;

/* out: filtered + beta * (bilinear coarse - filtered), `channels` a pixel (3 or 4); the first fine
 * column is even. */
void lull_filter_blend(float *out, const lull_model *model, unsigned channels,
                       const float *filtered, const lull_coarse *coarse, unsigned n);

#endif
