/* A model: weights checked, folded and laid out for the kernels of the chosen ports. */
#ifndef LULL_PACK_H
#define LULL_PACK_H

#include "graph.h"
#include "kernels.h"

/* Weight blocks of one layer, by what they are multiplied with. Plain layers: the three rows of the
 * source, those of the skip or second source, and those of a third one. Upsampled sources, folded:
 * two rows of the small source for each of the four output phases (phase 2 * (y & 1) + (x & 1)). */
enum {
    LULL_PACK_SOURCE = 0,
    LULL_PACK_PHASES = 8,
    LULL_PACK_SKIP = 8,
    LULL_PACK_THIRD = 11,
    LULL_PACK_BLOCKS = 14
};

typedef struct lull_packed_layer {
    size_t weights[LULL_PACK_BLOCKS]; /* offsets from the model; 0: not there */
    size_t bias, multiplier;          /* offsets */
    size_t zeros, point_bytes;        /* Winograd's form: as many zeros as bias; bytes of an input
                                         channel's weights at a point */
    size_t patches[2];                /* weights of patches of each source; 0: not there */
    unsigned wide_shift;
    int is_small, fits_words; /* lull_conv's */
    int in_planes;            /* 1: a head that the kernel `head` makes */
    unsigned has_pairs; /* 1: a call makes pixels x and x + 1 as if the second one's outputs were
                         * more of the first one's, from runs of one more column; the blocks of a
                         * source that is upsampled are those of the phases of even x */
} lull_packed_layer;

struct lull_model {
    lull_graph graph;
    lull_kernels kernels;
    size_t bytes;         /* of the whole model */
    float input_scale[9]; /* codes per network value; integer models only, like output_scale */
    float output_scale;   /* network value of one code */
    float weight_table[256], blend_table[256]; /* family K: of codes; docs/kernel-prediction.md */
    lull_packed_layer layer[LULL_MAX_LAYERS];
};

/* The 3x3 taps of a kernel at a point: with the factors of a column of three taps, and of a row. */
double lull_pack_point(const double *taps, const double *column, const double *row);

/* Winograd's form of a layer's weights for source 0 or its skip, at each point that does not
 * vanish: [point][output / lanes][channel][output % lanes]. `offset`: first channel in the tensor.
 */
void lull_pack_winograd(float *out, const lull_tza_tensor *weight, unsigned outputs,
                        unsigned channels, unsigned offset, unsigned lanes, int is_up);

/* Weights of patches, of a phase or LULL_PATCH_WHOLE (always if is_wide), at the points that do not
 * vanish: [point][output / lanes][channel / 2][output % lanes][channel % 2]. Returns their end. */
int16_t *lull_pack_patches(int16_t *out, const lull_tza_tensor *weight, unsigned outputs,
                           unsigned channels, unsigned lanes, unsigned phase, int is_wide);

/* 1 if no pixel's sum over bytes, or over wide codes up to LULL_PATCH_WIDE_MAX, can leave what
 * patches know of it; sums: how many there are, each of `taps` weights. */
int lull_pack_fits_patches(const lull_tza_tensor *weight, unsigned sums, unsigned taps,
                           int is_wide);

/* 1 if layer l is one for conv_int3. */
int lull_pack_is_int3(const lull_graph *graph, const lull_kernels *kernels, unsigned l);

/* Length in a kernel's units of a run of elements: floats, or dwords of integers. */
unsigned lull_pack_length(lull_dtype dtype, unsigned elements);

/* Block with the weights of row `row` (0..2, or 0..1 of a phase) of a layer's source or skip. */
unsigned lull_pack_block(const lull_layer *layer, unsigned phase, unsigned row);

#endif
