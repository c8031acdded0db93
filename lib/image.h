/* Rows of the caller's images to rows of floats and back. Stateless; never touches bytes outside
 * the pixels of the columns asked for. */
#ifndef LULL_IMAGE_H
#define LULL_IMAGE_H

#include "base.h"

/* IEEE 754 half to float (exact) and float to half (round to nearest even, overflow to
 * infinity). */
float lull_half_to_float(uint16_t h);
uint16_t lull_float_to_half(float f);

/* Bytes of one pixel, and the strides with the defaults filled in. */
size_t lull_image_pixel_bytes(const lull_image *image);
ptrdiff_t lull_image_pixel_stride(const lull_image *image);
ptrdiff_t lull_image_row_stride(const lull_image *image, unsigned width);

/* Pixel x of row y. */
uint8_t *lull_image_pixel(const lull_image *image, unsigned width, unsigned x, unsigned y);

/* The same if the row is tight (r,g,b) floats where a float may stand; else NULL. */
float *lull_image_floats(const lull_image *image, unsigned width, unsigned x, unsigned y);

/* 1 if pixel (x, y) of both begins at the same address, for all pixels of images of this size. */
int lull_image_is_in_place(const lull_image *a, const lull_image *b, unsigned width,
                           unsigned height);

/* 0 if no pixels of both share bytes: one lies behind the other, or, where row strides are the same
 * and no shorter than rows, its rows or pixels between those of the other. */
int lull_image_overlaps(const lull_image *a, const lull_image *b, unsigned width, unsigned height);

/* Columns [x, x+n) of row y into out[0..3n) as (r,g,b) floats, unchanged (NaN and infinities too).
 * `width`: of the whole image, for the default row stride. */
void lull_image_load(float *out, const lull_image *image, unsigned width, unsigned x, unsigned y,
                     unsigned n);

/* in[0..3n) to columns [x, x+n) of row y: the first 1..3 channels of each pixel. */
void lull_image_store(const lull_image *image, unsigned width, unsigned x, unsigned y, unsigned n,
                      const float *in);

/* In place, n values: times scale, NaN to 0, clamp to [lo, hi]: the order of Open Image
 * Denoise's input processing. Magnitudes below FLT_MIN before the product, and up to FLT_MIN
 * behind it, are 0. */
void lull_sanitize(float *values, size_t n, float scale, float lo, float hi);

#endif
