/* Fingerprint of an image, and the comparison that Open Image Denoise's own tests use. */
#ifndef LULL_APPS_COMPARE_H
#define LULL_APPS_COMPARE_H

#include <stddef.h>
#include <stdint.h>

#include "imageio.h"

/* FNV-1a, 32 bit, of the pixels as they lie in memory: rows from top to bottom, little-endian
 * values. */
uint32_t image_hash(const image *img);

/* Default limits of image_compare's average error. */
#define COMPARE_MAX_ERROR 0.003       /* radiance, albedo */
#define COMPARE_MAX_ERROR_SIGNED 0.05 /* normals, directional light maps */

#define COMPARE_SHOWN 5

typedef struct comparison {
    size_t values;
    size_t errors;  /* outliers; all values if the average is over the limit */
    double average; /* mean of |e - a| / (|e| + |a| + 0.01) */
    size_t shown;   /* first outliers: */
    struct {
        size_t index;
        float expected, actual;
    } examples[COMPARE_SHOWN];
} comparison;

/* Compares two images of the same size and number of channels. An outlier is a value that is
 * neither within 0.02 nor within 5 % of the expected one (any difference if max_error is 0). */
void image_compare(comparison *result, const image *expected, const image *actual,
                   double max_error);

/* INPUT, which it reports, if an image does not lie upon the main one pixel by pixel: other sizes,
 * or data windows of EXR files that begin elsewhere. The names are those of the files, which
 * may be one; role: what the image is of its. */
exit_code image_check_aligned(const image *img, const char *role, const char *name,
                              const image *main, const char *main_name);

/* INPUT, which it reports, if the image has not a single finite value: it would come out black. */
exit_code image_check_finite(const image *img, const char *name);

/* 1 if an albedo may be light by its name, and is: light that is part of the colour is brighter
 * than it next to nowhere, albedo in 4 to 100 % of the pixels of 59 renders. */
int image_is_light(const image *albedo, const image *color);

#endif
