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

#include "bilateral.h"
#include "patches.h"
#include "winograd.h"

#define LULL_MAX_SEGMENTS 8

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
 * (wide), weights int8, and, with a product of 64 bits,
 *     s = sum over the first `wide` segments,
 *     a = ((s + (1 << wide_shift >> 1)) >> wide_shift) + bias[o] + sum over the other segments,
 *     q = clamp((a * multiplier[o] + 2^30) >> 31, 0, out_max).
 *
 *     out_max <= 255 stores uint8_t, larger (to 32767) uint16_t. Runs are read in whole dwords: 4
 *     narrow or 2 wide elements; the weights of elements past the run are zero. A weight dword
 *     holds 4 int8 or 2 int16 in memory order. B is the table's block_int. If the table has
 *     splits_wide, wide weights w0, w1 are the bytes 0, w0, 0, w1 instead, and all of them follow
 *     once more as w0, 0, w1, 0.
 *
 * conv_int3: the same for exactly three outputs, with B = 1, which is what integer layers of three
 * outputs are packed for, unless the table has splits_wide.
 *
 * head: the same over one segment of 2 or LULL_HEAD_RUN dwords that fits_words, without `start`, to
 * at most LULL_HEAD_CODES planes of bytes: to out[o * out_step + p]. Exactly `pixels` bytes of
 * every plane are written.
 *
 * points_int: out[p * out_step + o] = sum over k of row[p * step + k] * weight[o][k], modulo 2^32,
 * over one segment of int16 points: two of them, and two int16 weights, are a dword; `length` and
 * `step` count dwords. B is block_int; there is no bias.
 *
 * bias and multiplier are zero-padded to whole blocks. */
typedef struct lull_conv {
    void *out;
    size_t out_step;           /* elements from one output pixel to the next */
    const void *bias;          /* float or int32_t */
    const int32_t *start; /* conv_int of ports that have patches: NULL, or what stands in the place
                           * of bias for each pixel, start_step elements from one to the next,
                           * the last one padded to whole blocks */
    size_t start_step;
    const int32_t *multiplier; /* integer only, like the next three */
    unsigned wide, wide_shift;
    int32_t out_max;
    int is_small; /* integer only: no |a| is above 2^24, and no multiplier has more than 24
                   * significant bits (ports may take it or leave it) */
    int fits_words; /* conv_int only: is_small, no segment is wide, and in each segment, of each
                     * output, the positive weights in the low words of dwords (elements 0 and 1 of
                     * 4) sum to at most 128, the negative ones to at least -128, those in the high
                     * words alike: a run's sums of either, in any order, fit int16 (ports may take
                     * it or leave it) */
    float least;  /* fp32 only: 0, or -LULL_FLT_MAX for the sums as they are */
    unsigned outputs, pixels, segments;
    lull_segment segment[LULL_MAX_SEGMENTS];
} lull_conv;

/* The rest is of family K (docs/kernel-prediction.md), fp32 in the order written and without
 * contraction: bit-equal on every port. Rows of its tensors are planes, one for each channel,
 * `plane` floats apart; images are interleaved, 3 floats a pixel.
 * `table`: E(q); table[q] is the rounded product table[q | 15] * table[q | 240].
 *
 * Code k of pixel p of a head is codes[k * code_plane + p * code_step]; code_plane is 1, or, where
 * the table has in_planes, code_step.
 *
 * filter5: with S[c] = sum over k = 0..24, in that order, of
 *     table[code k of pixel p] * rows[k / 5][c * plane + p + k % 5 - 2],
 *     out[c * out_plane + p] = S[0] > 0 ? S[c + 1] (1 / S[0]) + more : none, for c = 0, 1, 2.
 *
 * lull_encoding: 3 floats a pixel as they are in the caller's image. Radiance counts as
 *     R = S(radiance, scale, 0, most), albedo as S(albedo, 1, 0, 16), or as 1
 *     where that is 0 in all three channels, normals as S(normal, 1, -1, 1), S being lull_sane;
 *     scale >= 0, most <= 65504. Albedo and normals may be NULL.
 *
 * Shares of three numbers v, of (top, bottom): with s = top / (((v(0) v(1)) v(2)) bottom) they are
 *     (v(1) v(2)) s, (v(0) v(2)) s and (v(0) v(1)) s: top / (v bottom) with one division.
 *
 * encode: 12 codes a pixel, those of the radiance from u = 1 + LULL_LOG_GAIN (R share), share of
 *     the albedo + epsilon (1, 1). The last three codes are the bytes of `flags`, the lowest first.
 *
 * spread: planes (1, albedo), counting as above.
 *
 * spread_xyz: planes (1, normal), counting as above.
 *
 * guide: two bytes a pixel of at most 127, of the codes n of the normal that `encode` makes or, if
 *     that is NULL, a of the albedo, divisions cut: (2 n(x) - n(y) - n(z) + 510) / 8 and 7 (n(y) -
 *     n(z) + 255) / 32, which for lack of a third do not tell normals apart that differ along
 *     (1,1,1); a(r) / 2 and (a(g) + a(b)) / 4. Zeros if both are NULL.
 *
 * demodulate: with C = table[codes[p * code_step]], planes (C, C (R share), ...), share being that
 *     of `smooth` (1, 1); smooth has 3 planes, smooth_plane apart. `codes` are those of confidence;
 *     three bytes before each may be read if code_step is above 1.
 *
 * shrink: planes (C, C mean, ...), C as above; mean: the sum over the 2x2 pixels below of planes 1
 *     to 3 times 1 / that of plane 0, each ((above left + right) + below left) + right. Zeros where
 *     the latter is 0.
 *
 * blend: pixels 2 i and 2 i + 1 of `fine` (3 planes) lie on pixel i of two coarse rows, whose
 *     pixels i - 1 and i + 1 are there, too. With here = 0.75 near + 0.25 far of coarse pixel i,
 *     there = the same of i - 1 or i + 1: out = fine + beta ((0.75 here + 0.25 there) - fine), beta
 *     = table[codes[pixel]]. `table`: any 256 floats.
 *
 * noise, bilateral, fit_sums, fit, regress, residual, edges: bilateral.h.
 *
 * grain_sums: LULL_GRAIN_ALL_SUMS of each cell of LULL_GRAIN_SIDE columns (pixels.h), `plane`
 *     apart, of `count` rows of codes that begin with a cell, at most as many as it has; `work`:
 *     LULL_GRAIN_WORK bytes, aligned for floats.
 *
 * take_grain: a feature's values, 3 planes, less its grain (lull_without_grain), in their place and
 *     in `out`, an image, unless it is NULL. `cells`: LULL_GRAIN_VALUES, cell_plane apart, of
 *     LULL_FIT_ROOM(pixels) cells, the first of which is left of pixel 0, which begins one. Pixel i
 *     lies between numbers j = (i + 4) / 8, cut, and j + 1: a + t (b - a), t = lull_cell_part.
 *
 * modulate: out = S(v * smooth, 1, 0, FLT_MAX) * unscale; out is an image.
 *
 * luminance: sums[p] += (0.212671 r + 0.715160 g) + 0.072169 b, of S(r, 1, 0, FLT_MAX) etc. */
typedef struct lull_encoding {
    const float *radiance, *albedo, *normal;
    float scale, most;
    uint32_t flags;
} lull_encoding;

/* Channels of a head after the 25 logits of the radiance kernel. */
enum {
    LULL_HEAD_CONFIDENCE = 25,
    LULL_HEAD_BLEND = 26,
    LULL_HEAD_ALBEDO = 27,
    LULL_HEAD_CODES = 52
};

#define LULL_HEAD_RUN 3u /* dwords: of longer runs `head` is not faster */

typedef struct lull_window {
    float *out;
    const float *rows[5];
    size_t out_plane, plane; /* floats from plane to plane */
    const uint8_t *codes;
    size_t code_step, code_plane;
    const float *table;
    float more, none;
    unsigned pixels;
} lull_window;

typedef struct lull_blending {
    float *out;
    const float *fine, *near, *far;
    size_t out_plane, fine_plane, coarse_plane;
    const uint8_t *codes;
    const float *table;
    unsigned pairs;
} lull_blending;

/* What happens to an image's values before and after a U network; S is lull_sane, `transfer` a
 * lull_transfer with its curves F and F'.
 *
 * curve_in: v = F(S(v, scale, low, high)), with s * 0.5 + 0.5 of what S gives if is_signed.
 *
 * curve_out: r = F'(S(v, 1, 0, FLT_MAX)), r * 2 - 1 if is_signed; then not below low (a number) nor
 *     above high (a number or infinity), times scale.
 *
 * Both in place, n values. */
typedef struct lull_curve {
    unsigned transfer;
    float scale, low, high;
    int is_signed;
} lull_curve;

/* What of a network's integer layers is faster in patches (patches.h) than by conv_int. */
enum {
    LULL_PATCHES_NONE,
    LULL_PATCHES_WIDE, /* wide sources of a layer's own resolution */
    LULL_PATCHES_OWN,  /* narrow ones, too */
    LULL_PATCHES_UP    /* upsampled ones, too */
};

typedef struct lull_kernels {
    unsigned block_f32; /* output channels a weight block holds, fp32 */
    unsigned block_int;
    unsigned adds_beside; /* lull_cpu_adds_beside, for those who fill the table */
    unsigned halves_pay;  /* lull_cpu_halves_pay, likewise */
    unsigned has_halves;  /* 1: half a weight block costs conv_int half of a whole one */
    unsigned splits_wide; /* 1: conv_int multiplies the bytes of wide elements by themselves */
    unsigned in_planes;   /* 1: heads that `head` can make are made by it, others by conv_int. Who
                           * sets block_int, and has no head, sets this to 0 */
    unsigned patches_u;   /* LULL_PATCHES_... of networks of family U */
    unsigned patches_k;   /* ... and of family K, whose layers have fewer channels */
#define KERNEL(name, parameters, tolerance, purpose) void(*name) parameters;
#include "kernels.def"
} lull_kernels;

/* Fills *kernels with the strongest implementation of each slot among the ports in `ports`. */
void lull_kernels_fill(lull_kernels *kernels, uint32_t ports);

/* Each port's own filler overwrites the slots it has; declared here for every row of ports.def. */
#define PORT(name) void lull_port_##name(lull_kernels *kernels);
#include "ports.def"

#endif
