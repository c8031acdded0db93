/* Steadier sequences: the result of a frame is mixed with that of the frame before, brought to
 * where things are now, as far as features and the noisy image agree with it (docs/apps.md,
 * Sequences). */
#ifndef LULL_APPS_TEMPORAL_H
#define LULL_APPS_TEMPORAL_H

#include "imageio.h"

/* What is kept of the frame before. A zeroed struct has had none. */
typedef struct temporal {
    size_t width, height;
    int left, top; /* corner of the data window */
    unsigned channels;
    float *last;    /* its mixed result, width * height * channels; NULL: none */
    uint8_t *guide; /* 6 per pixel: 3x3 means of albedo and normal; 255 stands for 1 */
    uint8_t *age;   /* how many frames a pixel is the mean of, AGE_ONE each */
    int features;   /* bit 0: albedo, bit 1: normal */
    int number;     /* of the frame */
    float scale[2]; /* signs of motion vectors, once they were found; else 0 */
} temporal;

typedef struct temporal_frame {
    int number;         /* the frame before has the number before, else nothing is mixed */
    const image *noisy; /* linear or not, as the result; of a data window that may move */
    const image *albedo, *normal; /* NULL: there is none */
    const image *motion; /* two channels or more: where in the frame before a pixel was, less where
                          * it is, in pixels, by the scale below to the right and down. NULL:
                          * nothing moves */
    const float *scale;  /* across, down; NULL: signs are found in the first frame that moves */
} temporal_frame;

/* Mixes the result, of the noisy image's size and channels, and keeps it for the next frame. 0, or
 * -1 if memory is short; nothing is kept then, and the result is as it was. */
int temporal_mix(temporal *t, image *result, const temporal_frame *frame);
void temporal_free(temporal *t);

#endif
