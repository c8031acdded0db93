/* What the host tells the kernels, in what C99 and OpenCL C have in common. Every kernel has the
 * same parameters: the working memory, the model's memory, and one of these structures. */
#ifndef LULL_OPENCL_ARGS_H
#define LULL_OPENCL_ARGS_H

#ifndef __OPENCL_VERSION__
#include "base.h"
#endif

#define LULL_CL_UNIT 64u  /* bytes that offsets of tensors count, and the alignment of their rows */
#define LULL_CL_BORDER 2  /* pixels of zeros on every side of a tensor that convolutions read */
#define LULL_CL_BLOCK 8u  /* output channels that a work item of a convolution makes */
#define LULL_CL_LOCAL_X 16u
#define LULL_CL_LOCAL_Y 4u /* work items of a group, of all kernels but `residual`: 16 by 1 */

/* A tensor in the working memory. */
typedef struct lull_cl_tensor {
    uint32_t at;    /* pixel (0, 0), in units of LULL_CL_UNIT bytes */
    uint32_t pitch; /* bytes from row to row */
    uint32_t pixel; /* bytes from pixel to pixel */
} lull_cl_tensor;

/* What a convolution does beside its 3x3 taps. */
#define LULL_CL_HEAD 1u /* 1x1 taps instead */
#define LULL_CL_UP 2u   /* the first source is upsampled by 2: 2x2 taps for each of four phases */
#define LULL_CL_POOL 4u /* 2x2 maxima */

#define LULL_CL_CONV_SOURCES 3

/* A convolution of integers (docs/arithmetic.md). Pixels of its tensors are whole dwords: of four
 * bytes, or of two words where a tensor is wide. Weights of source s are bytes, those of one row of
 * taps after the other, [output / 8][column][channel][output % 8]; rows of an upsampled source are
 * numbered 2 * phase + row. */
typedef struct lull_cl_conv {
    lull_cl_tensor out, source[LULL_CL_CONV_SOURCES];
    int32_t width, height; /* of the output before pooling */
    uint32_t outputs;
    int32_t most; /* largest code of the output; above 255 they are words */
    uint32_t sources;
    uint32_t wide;                          /* bit s: source s is, ... */
    uint32_t shift;                         /* ... and the sum of the wide ones is shifted */
    uint32_t length[LULL_CL_CONV_SOURCES];  /* dwords under a row of taps */
    uint32_t weights[LULL_CL_CONV_SOURCES]; /* bytes into the model's memory, like ... */
    uint32_t bias, multiplier;              /* ... 8 words for each block of outputs */
    uint32_t form;                          /* LULL_CL_HEAD, ... */
} lull_cl_conv;

/* What the filter's kernels have to know. */
#define LULL_CL_ALBEDO 1u  /* there is an albedo beside the main image */
#define LULL_CL_NORMAL 2u  /* there are normals */
#define LULL_CL_FEATURES (LULL_CL_ALBEDO | LULL_CL_NORMAL)
#define LULL_CL_CLIPPED 4u /* the main image's radiance is clipped to [0,1] */
#define LULL_CL_NOISE 8u   /* codes of the noise are asked for, or used for the output */
#define LULL_CL_ALONE 32u  /* the main image stands for normals, too, but is no LULL_CL_NORMAL */
#define LULL_CL_CLEAN 64u  /* albedo and normals have no noise */
#define LULL_CL_FAR 16u    /* the smoothing looks at the pixels farthest away, too */

#define LULL_CL_SOURCES 5

/* A kernel of the filter: what `out` and the sources are is said where it is defined. */
typedef struct lull_cl_filter {
    lull_cl_tensor out, source[LULL_CL_SOURCES];
    int32_t width, height; /* of the output, padding included */
    int32_t inside_width, inside_height; /* what is inside the image: of the output, or (blend) of
                                          * the coarser level */
    uint32_t code;  /* of a head's pixel: the first of the codes that are meant */
    uint32_t flags; /* LULL_CL_ALBEDO, ... */
    float calm, ragged; /* of lull_images */
} lull_cl_filter;

/* The model's memory begins with the tables of its weights and of the blend, 256 floats each. */
#define LULL_CL_TABLES 2048u

#endif
