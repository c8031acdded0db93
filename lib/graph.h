/* The network as a list of layers: topology from nets.def, channel counts from the weights. */
#ifndef LULL_GRAPH_H
#define LULL_GRAPH_H

#include "base.h"
#include "tza.h"

#define LULL_MAX_LAYERS 20
#define LULL_MAX_CHANNELS 1024 /* of any one tensor; bounds scratch memory and sums */

/* Tensors are numbered: 0 is the input of the network, 1 + i the output of layer i. */
#define LULL_TENSOR_INPUT 0
#define LULL_TENSOR_NONE 0xff

/* Elements of a tensor: fp32, or integer codes in 8 bits (narrow) or in 15 of 16 bits (wide). */
typedef enum lull_dtype { LULL_DTYPE_F32, LULL_DTYPE_U8, LULL_DTYPE_U15 } lull_dtype;
size_t lull_dtype_bytes(lull_dtype dtype);

typedef struct lull_layer {
    uint8_t row;       /* number of its LAYER row in nets.def */
    uint8_t source;    /* tensor */
    uint8_t skip;      /* tensor or LULL_TENSOR_NONE */
    uint8_t up;        /* 1: the source is upsampled by 2 */
    uint8_t pool;      /* 1: the result is max-pooled by 2 */
    uint8_t level;     /* the convolution runs at 1/2^level resolution */
    uint16_t in_source, in_skip, outputs; /* channels; in_skip 0 without skip */
} lull_layer;

typedef struct lull_graph {
    const char *network; /* static */
    unsigned layers;
    int is_integer;   /* int8 weights; docs/arithmetic.md */
    unsigned inputs;  /* channels of tensor 0 */
    unsigned levels;  /* number of 2x poolings: sizes are multiples of 1 << levels */
    unsigned overlap; /* pixels beside a strip that make it exact, a multiple of 1 << levels */
    lull_layer layer[LULL_MAX_LAYERS];
} lull_graph;

/* The tensors of one layer in a weights file; rank 0 where there is none. In floating-point files the
 * skip's taps are the last input channels of `weight`. */
typedef struct lull_layer_tensors {
    lull_tza_tensor weight, skip, bias, scale, shift;
} lull_layer_tensors;

void lull_graph_tensors(lull_layer_tensors *tensors, const lull_layer *layer, const lull_tza *tza);

/* Finds the topology by its key tensor and checks the names, ranks and shapes of all its tensors.
 * Errors: NETWORK. */
lull_status lull_graph_build(lull_graph *graph, const lull_tza *tza);

/* Name of a layer: the prefix of its tensors in the weights file. Static. */
const char *lull_layer_name(const lull_layer *layer);

/* Channels, log2 of the downscale, and element type of a tensor. */
unsigned lull_graph_channels(const lull_graph *graph, unsigned tensor);
unsigned lull_graph_level(const lull_graph *graph, unsigned tensor);
lull_dtype lull_graph_dtype(const lull_graph *graph, unsigned tensor);

uint64_t lull_graph_macs_per_pixel(const lull_graph *graph);

#endif
