/* Classical denoiser: non-local means with feature weights. It needs no training and no weights
 * file, and is the yardstick that networks are measured against.
 *
 * Radiance is divided by albedo (irradiance r), and each pixel becomes a weighted mean of the
 * pixels q in a window of 17x17 around it:
 *
 *     r'(p) = sum_q w(p,q) r(q) / sum_q w(p,q),    w = exp(-(color + features + space))
 *     color     max(0, mean over the 5x5 patch of
 *                   ((g(p)-g(q))^2 - (v(p) + min(v(p), v(q)))) / (e + k^2 (v(p) + v(q))))
 *     features  |albedo(p)-albedo(q)|^2 / 0.2^2  +  |normal(p)-normal(q)|^2 / 0.5^2
 *     space     |p-q|^2 / 100
 *
 * with g = log(1 + 4 r) and v the variance of the noise in g, estimated from the image itself:
 * the lesser of the squared second differences along x and y, averaged over 7x7 pixels. Pixels
 * much brighter than all but one of their neighbours (fireflies) are limited first. exp(-t) is
 * computed as (1 - t/8)^8, 0 from t = 8 on.
 *
 * Sources: Buades, Coll, Morel 2005, "A non-local algorithm for image denoising" (the mean);
 * Rousselle, Knaus, Zwicker 2012, "Adaptive rendering with non-local means filtering" (the
 * distance less its expected noise); Rousselle, Manzi, Zwicker 2013, "Robust denoising using
 * feature and color information" (features). These have a variance from the renderer; here there
 * is none.
 *
 * The image is cut into tiles that may be computed in any order, by any number of threads, each
 * with memory of its own; the output bytes do not depend on it, nor on the CPU. A row of tiles
 * reads LULL_NLM_HALO rows of the inputs above and below it and nothing else, so frames can be
 * streamed. */
#ifndef LULL_NLM_H
#define LULL_NLM_H

#include "base.h"

#define LULL_NLM_TILE_WIDTH 64u
#define LULL_NLM_TILE_HEIGHT 32u
#define LULL_NLM_HALO 15u

typedef struct lull_nlm {
    unsigned width, height;           /* pixels, up to LULL_MAX_SIZE */
    lull_image color, albedo, normal; /* linear radiance; the others may be missing (data NULL) */
    lull_image output;                /* must not overlap the inputs */
    float scale;    /* brings mid-grey to 0.18: lull_autoexposure() for HDR, 1 for LDR; > 0 */
    float strength; /* k above: 1 is right for 4 to 64 samples per pixel; lower keeps more noise */
} lull_nlm;

/* ARGUMENT (sizes, scale, strength), IMAGE (data missing, channels) or OK. */
lull_status lull_nlm_check(const lull_nlm *job);

/* Bytes that one worker needs, the same for all images (about 0.4 MB). */
size_t lull_nlm_bytes(void);

/* Tiles of the image; tile i stands in row i / lull_nlm_columns() of tiles. */
unsigned lull_nlm_columns(unsigned width);
unsigned lull_nlm_rows(unsigned height);

/* Denoises tile `column`, `row` of a job that passed lull_nlm_check, into its pixels of the output.
 * `memory`: lull_nlm_bytes() bytes, aligned to LULL_ALIGN, used by no other call meanwhile. */
void lull_nlm_tile(const lull_nlm *job, unsigned column, unsigned row, void *memory);

#endif
