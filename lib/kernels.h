/* The kernel table: what a port implements. Rows of kernels.def are its members.
 *
 * Convolutions are written over segments. One output pixel is the sum over a few runs of
 * consecutive source elements: in rows of interleaved channels (NHWC) the three pixels under a 3x3
 * kernel's row are one run of 3*C elements. The next output pixel reads `step` elements further.
 * Plain 3x3 convolutions, the 2x2 phase kernels of upsampled inputs, concatenated inputs and 1x1
 * convolutions are all lists of segments, so one inner loop serves every layer.
 */
#ifndef LULL_KERNELS_H
#define LULL_KERNELS_H

#include "winograd.h"

#define LULL_MAX_SEGMENTS 6

typedef struct lull_segment {
    const void *row;     /* first element of the run of output pixel 0 */
    const void *weights; /* [o / B][k][o % B]: B outputs together, zero-padded to whole blocks */
    uint32_t length;     /* k: elements of a run (fp32) or dwords of a run (integer) */
    uint32_t step;       /* elements from one output pixel's run to the next one's */
} lull_segment;

/* A convolution, for both kinds of arithmetic. Exactly `outputs` elements of every pixel are
 * written.
 *
 * conv_f32:  out[p * out_step + o] = max(least, bias[o] + sum over segments and k of
 *                                                row[p * step + k] * weight[o][k])
 *     summed in the order of the segments and of k for each output; B is the table's block_f32.
 *
 * conv_int (docs/arithmetic.md): activations are unsigned 8 bit (narrow) or 15 bit in uint16_t
 * (wide), weights int8. s = sum over the first `wide` segments a = ((s + (1 << wide_shift >> 1)) >>
 * wide_shift) + bias[o] + sum over the other segments q = clamp((a * multiplier[o] + 2^30) >> 31,
 * 0, out_max)      (64-bit product) out_max <= 255 stores uint8_t, larger (to 32767) uint16_t. Runs
 * are read in whole dwords: 4 narrow or 2 wide elements; the weights of elements past the run are
 * zero. A weight dword holds 4 int8 or 2 int16 in memory order. B is the table's block_int.
 *
 * bias and multiplier are zero-padded to whole blocks. */
typedef struct lull_conv {
    void *out;
    size_t out_step;           /* elements from one output pixel to the next */
    const void *bias;          /* float or int32_t */
    const int32_t *multiplier; /* integer only, like the next three */
    unsigned wide, wide_shift;
    int32_t out_max;
    float least; /* fp32 only: 0, or -LULL_FLT_MAX for the sums as they are */
    unsigned outputs, pixels, segments;
    lull_segment segment[LULL_MAX_SEGMENTS];
} lull_conv;

/* filter5: out[4 p + c] = sum over k = 0..24 of table[codes[p * code_step + k]] *
 * rows[k / 5][4 (p + k % 5 - 2) + c], in that order, no contraction: bit-equal on every port. */

typedef struct lull_kernels {
    unsigned block_f32; /* output channels a weight block holds, fp32 */
    unsigned block_int;
#define KERNEL(name, parameters, tolerance, purpose) void(*name) parameters;
#include "kernels.def"
} lull_kernels;

/* Fills *kernels with the strongest implementation of each slot among the ports in `ports`. */
void lull_kernels_fill(lull_kernels *kernels, uint32_t ports);

/* Port (bit number) that filled slot `slot` (order of kernels.def) under this mask. */
unsigned lull_kernels_port(uint32_t ports, unsigned slot);

/* Each port's own filler overwrites the slots it has; declared here for every row of ports.def. */
#define PORT(name) void lull_port_##name(lull_kernels *kernels);
#include "ports.def"

#endif
