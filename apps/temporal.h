/* Steadier sequences: the input of a frame, colour and features, becomes the mean of those of the
 * frames before, brought to where things are now, as far as features and light agree; and so does
 * some of the result (docs/apps.md, Sequences). */
#ifndef LULL_APPS_TEMPORAL_H
#define LULL_APPS_TEMPORAL_H

#include "imageio.h"

/* What is kept of the frame before. A zeroed struct has had none. */
typedef struct temporal {
    size_t width, height;
    int left, top;     /* corner of the data window */
    unsigned colors;   /* channels of the noisy image */
    unsigned channels; /* of a pixel of last: noisy image, albedo, normal, result, light, age */
    float *last;       /* means of these, a pixel's one after the other; NULL: none */
    float *moved;      /* between the two calls for a frame: colors + 2 per pixel */
    uint8_t *guide;    /* 6 per pixel: 3x3 means of albedo and normal; 255 stands for 1 */
    int features;      /* channels of the albedo, and 4 times those of the normal */
    int number;        /* of the frame */
    int is_whole;      /* 1: it has a result, too */
    float floor;       /* of light */
    float scale[2];    /* signs of motion vectors, once they were found; else 0 */
} temporal;

typedef struct temporal_frame {
    int number;             /* the frame before has the number before, else nothing is taken over */
    image *noisy;           /* linear or not, as the result; of a data window that may move */
    image *albedo, *normal; /* NULL: there is none */
    const image *motion; /* two channels or more: where in the frame before a pixel was, less where
                          * it is, in pixels, by the scale below to the right and down. NULL:
                          * nothing moves */
    const float *scale;  /* across, down; NULL: signs are found in the first frame that moves */
} temporal_frame;

/* Before a frame is denoised: makes its noisy image, albedo and normal means over the frames
 * before. 0, or -1 if memory is short; nothing is kept then, and the images are as they were. */
int temporal_gather(temporal *t, const temporal_frame *frame);

/* After it, for the same frame: mixes the result, of the noisy image's size and channels, and keeps
 * it for the next one. */
void temporal_mix(temporal *t, image *result, int number);
void temporal_free(temporal *t);

#endif
