/* Measurements of noise and edges for the input doctor. */
#ifndef LULL_APPS_DOCTOR_MAPS_H
#define LULL_APPS_DOCTOR_MAPS_H

#include "imageio.h"

#define DOCTOR_MIN_SIZE 32 /* pixels a side below which nothing can be said */

typedef struct doctor_maps {
    size_t width, height;
    float *luminance; /* logarithm, a small part of the mean added */
    float *edges;     /* gradient of the smoothed logarithm */
} doctor_maps;

/* 0, or -1 if the image is too small or memory runs out. */
int doctor_maps_init(doctor_maps *maps, const image *color);
void doctor_maps_free(doctor_maps *maps);

/* Mean difference of log luminance of pixels at distance 1 over that at distance 2 (near), and at 4
 * over 8 (far). */
void doctor_noise_scale(const doctor_maps *maps, double *near, double *far);

/* Correlations between the edges of the colour and those of an auxiliary image. */
typedef struct doctor_alignment {
    double as_given;
    double shifted; /* the best within a few pixels, at (dx, dy) */
    int dx, dy;
    double mirrored; /* the better of both mirror images */
    int is_vertical;
} doctor_alignment;

int doctor_align(const doctor_maps *maps, const image *aux, doctor_alignment *out);

#endif
