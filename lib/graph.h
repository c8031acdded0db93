/* The network as a list of layers: topology from nets.def, channel counts from the weights. */
#ifndef LULL_GRAPH_H
#define LULL_GRAPH_H

#include "base.h"
#include "tza.h"

#define LULL_MAX_LAYERS 46
#define LULL_MAX_CHANNELS 1024 /* of any one tensor; bounds scratch memory and sums */

/* Level 0's head of family K is two layers: the filter's logits, so many, are made when radiance is
 * ready, what comes after them before it, with the blend's logit in both parts. */
#define LULL_HEAD0_SPLIT 25u

/* Tensors are numbered: 0 is the input of the network, 1 + i the output of layer i. Family K also
 * keeps of the frame the unencoded radiance (r,g,b), the albedo (1,r,g,b; zeros outside the image),
 * what tells surfaces apart, the guide (kernels.h), and the normal (1,x,y,z; like the albedo). In
 * the guide's place integer models of family U may have the auxiliary channels of their input, as
 * bytes. */
#define LULL_TENSOR_INPUT 0
#define LULL_TENSOR_RADIANCE (LULL_MAX_LAYERS + 1)
#define LULL_TENSOR_ALBEDO (LULL_MAX_LAYERS + 2)
#define LULL_TENSOR_GUIDE (LULL_MAX_LAYERS + 3)
#define LULL_TENSOR_AUX LULL_TENSOR_GUIDE
#define LULL_TENSOR_NORMAL (LULL_MAX_LAYERS + 4)
#define LULL_TENSORS (LULL_MAX_LAYERS + 5)
#define LULL_TENSOR_NONE 0xff

/* Elements of a tensor: fp32, or integer codes in 8 bits (narrow) or in 15 of 16 bits (wide). */
typedef enum lull_dtype { LULL_DTYPE_F32, LULL_DTYPE_U8, LULL_DTYPE_U15 } lull_dtype;
LULL_INLINE size_t lull_dtype_bytes(lull_dtype dtype)
{
    return dtype == LULL_DTYPE_F32 ? 4u : dtype == LULL_DTYPE_U8 ? 1u : 2u;
}

typedef enum lull_family { LULL_FAMILY_U, LULL_FAMILY_K } lull_family;

/* What a layer does. Convolutions have weights; the others are the filter of family K, in the order
 * of docs/kernel-prediction.md, and make fp32 tensors. */
typedef enum lull_op {
    LULL_OP_CONV,       /* 3x3 */
    LULL_OP_HEAD,       /* 1x1; sources after the first only say when */
    LULL_OP_SMOOTH,     /* albedo, head: filtered albedo + epsilon */
    LULL_OP_DEMODULATE, /* radiance, smooth, head: (confidence, confidence * demodulated radiance)
                         */
    LULL_OP_POOL,       /* the same of the next level, head of that level */
    LULL_OP_FILTER, /* it, head: filtered radiance (r,g,b), and the codes of the blend weights; of
                     * level 0 also those of the noise, which the next two hand on */
    LULL_OP_BLEND,  /* it, coarser result: result (r,g,b) */
    LULL_OP_BILATERAL, /* level 0's result, guide: smoothed; like all below if the file asks for it
                        */
    LULL_OP_FACE,      /* normal, head: filtered normal (x,y,z), 0 where there is none */
    LULL_OP_FIT_SUMS,  /* smoothed result, filtered albedo and normal, radiance: sums over the
                        * pixels of a cell of 8x8 */
    LULL_OP_FIT,       /* them: coefficients of the regression */
    LULL_OP_REGRESS,   /* smoothed result, filtered albedo and normal, coefficients: result, and the
                        * codes of the noise */
    LULL_OP_RESIDUAL,  /* result, radiance: sums over the pixels of a cell of 16x16 */
    LULL_OP_GAINS,     /* them: what the result lacks in the cell */
    LULL_OP_CORRECT,   /* result, gains: result */
    LULL_OP_GRAIN_SUMS, /* input: sums over the pixels of a cell of 8x8, of codes of the albedo and
                         * of normals */
    LULL_OP_GRAIN,     /* them: of each how much of its mean stands for it, and the mean */
    LULL_OP_ENCODE,    /* input, radiance, grain: the input without it, in the input's memory */
    LULL_OPS
} lull_op;

/* Rows of a source that row y of a layer sees. */
typedef enum lull_reads {
    LULL_READS_ROW,    /* y */
    LULL_READS_3,      /* y-1 .. y+1 */
    LULL_READS_5,      /* y-2 .. y+2 */
    LULL_READS_25,     /* y-12 .. y+12 */
    LULL_READS_6,      /* y-4 .. y+1 */
    LULL_READS_COARSE, /* of half the resolution: (y+1)/2 - 1 and (y+1)/2 */
    LULL_READS_FINE,   /* of twice the resolution: 2y, 2y+1 */
    LULL_READS_CELL,   /* of 16 times the resolution: 16y .. 16y+15 */
    LULL_READS_16TH,   /* of a 16th of it: the two nearest */
    LULL_READS_8,      /* of 8 times the resolution: 8y .. 8y+7 */
    LULL_READS_EIGHTH  /* of an eighth of it: the two nearest */
} lull_reads;

#define LULL_MAX_SOURCES 4

typedef struct lull_layer {
    uint8_t op;  /* lull_op */
    uint8_t row; /* number of its LAYER or HEAD row in nets.def, for the name */
    /* small: graphs are put on stacks */
    unsigned level : 4;       /* the layer runs at 1/2^level resolution, ... */
    unsigned pool : 1;        /* ... and its result is max-pooled by 2 if this is 1 */
    unsigned is_winograd : 1; /* fp32: computed in Winograd's form, two rows together */
    unsigned has_patches : 2; /* integers: sources packed for patches, too: 1 the first, 2 the
                               * second, or both; then four rows are made together, or eight of what
                               * has phases */
    uint8_t source[LULL_MAX_SOURCES]; /* tensors; LULL_TENSOR_NONE where there are fewer */
    uint8_t reads[LULL_MAX_SOURCES];
    uint16_t outputs;    /* channels */
    uint8_t first;       /* the first of them in the weights file: level 0's head is two layers */
    uint8_t bits;        /* integer models: of the output's codes: 8, or 13 or 15 in words */
} lull_layer;

typedef struct lull_graph {
    const char *network; /* static */
    lull_family family;
    unsigned layers;
    int is_integer;   /* int8 weights; docs/arithmetic.md */
    unsigned inputs;  /* channels of the network's input, and ... */
    unsigned aux;     /* ... how many of them, the last ones, are LULL_TENSOR_AUX */
    unsigned before;  /* layers that take grain out of the features, before all others; 0: none */
    uint8_t input;    /* the tensor that the network proper sees */
    int is_alone;     /* family K: for an albedo or normals alone, which stand for normals, too */
    unsigned levels;  /* number of 2x poolings: sizes are multiples of 1 << levels */
    unsigned overlap; /* pixels beside a strip that the output depends on, and ... */
    unsigned margin;  /* ... that make it equal to the bit; both multiples of 1 << levels */
    lull_layer layer[LULL_MAX_LAYERS];
    uint8_t made_by[LULL_OPS]; /* lull_graph_find */
} lull_graph;

/* The tensors of one layer in a weights file; rank 0 where there is none. In floating-point files
 * the skip's taps are the last input channels of `weight`. */
typedef struct lull_layer_tensors {
    lull_tza_tensor weight, skip, bias, scale, shift, max;
} lull_layer_tensors;

void lull_graph_tensors(lull_layer_tensors *tensors, const lull_layer *layer, const lull_tza *tza);

/* Finds the topology by its key tensor and checks the names, ranks and shapes of all its tensors.
 * Errors: NETWORK. */
lull_status lull_graph_build(lull_graph *graph, const lull_tza *tza);

/* Name of a layer: the prefix of its tensors in the weights file, "" if it has none. Static. */
const char *lull_layer_name(const lull_layer *layer);

/* Channels, log2 of the downscale, and element type of a tensor. */
unsigned lull_graph_channels(const lull_graph *graph, unsigned tensor);
unsigned lull_graph_level(const lull_graph *graph, unsigned tensor);
lull_dtype lull_graph_dtype(const lull_graph *graph, unsigned tensor);
/* The largest code of a tensor of an integer model. */
unsigned lull_graph_max(const lull_graph *graph, unsigned tensor);

/* 1 if rows of the tensor are planes, one for each channel: those of the filter's layers and the
 * albedo; other rows interleave the channels. Planes of bytes may follow: one more for each. */
int lull_graph_planes(const lull_graph *graph, unsigned tensor);

/* 1 if a layer, the smoothing along the result, looks at the pixels farthest away. */
int lull_graph_is_far(const lull_layer *layer);

/* 1 if the codes of the noise stand beside a tensor for the smoothing along the result, which not
 * all models have. */
int lull_graph_has_noise(const lull_graph *graph, unsigned tensor);

/* The tensor beside which the noise codes stand by which input is mixed into the output; NONE if it
 * is not. */
unsigned lull_graph_mixed_by(const lull_graph *graph);

/* 1 if the layer has weights. */
int lull_layer_is_conv(const lull_layer *layer);
/* 1 if it makes codes alone, no planes of floats. */
int lull_layer_makes_codes(const lull_layer *layer);
/* 1 if its first source is upsampled by 2. */
int lull_layer_is_up(const lull_layer *layer);
/* 1 if that one is packed for patches, too. */
int lull_layer_has_phases(const lull_layer *layer);
/* 1 if layer l is packed for patches of wide codes (patches.h). */
int lull_layer_has_wide_patches(const lull_graph *graph, unsigned l);

/* Outputs that no layer before makes, too. */
unsigned lull_layer_own_outputs(const lull_layer *layer);

/* 1 if a tensor is used part by part by the layers that follow the one that makes it: it needs no
 * rows. */
int lull_graph_is_local(const lull_graph *graph, unsigned tensor);

/* Channels of a layer's source number `index`; 0 where there is none. The auxiliary channels of the
 * input follow it as the next source; both share a tensor of weights. */
unsigned lull_layer_inputs(const lull_graph *graph, const lull_layer *layer, unsigned index);

/* Channels of all sources of a convolution. */
unsigned lull_layer_all_inputs(const lull_graph *graph, const lull_layer *layer);

/* Tensor made by the first layer of this op at level 0; LULL_TENSOR_NONE if there is none. */
LULL_INLINE unsigned lull_graph_find(const lull_graph *graph, lull_op op)
{
    return graph->made_by[op];
}

uint64_t lull_graph_macs_per_pixel(const lull_graph *graph);

#endif
