/* Auto-exposure (Open Image Denoise's rule). Bins of at most 16x16 pixels; the mean of log2
 * luminance over the bins brighter than 1e-8, summed in a fixed order. */
#ifndef LULL_EXPOSURE_H
#define LULL_EXPOSURE_H

#include "base.h"

/* Rows of bins of an image: ceil(height / 16). */
unsigned lull_exposure_rows(unsigned height);

/* Partial result of one row of bins; rows are independent and may be computed in parallel. */
typedef struct lull_exposure_row {
    float log_sum;
    uint32_t bins; /* bins counted */
} lull_exposure_row;

/* The kernel `luminance` (kernels.h). */
typedef void lull_luminance(float *sums, const float *pixels, unsigned n);

void lull_exposure_bin_row(lull_exposure_row *result, const lull_image *color, unsigned width,
                           unsigned height, unsigned row, lull_luminance *luminance);

/* The scale from all the rows: 0.18 / 2^mean; 1 if no bin counted; 0 if the mean is infinite. */
float lull_exposure_scale(const lull_exposure_row *rows, unsigned n);

#endif
