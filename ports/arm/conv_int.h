/* What the integer convolutions of the ARM ports share: 16-bit products, requantisation, and the
 * correction of the bias where activations are made signed by subtracting 128. */
#ifndef LULL_ARM_CONV_INT_H
#define LULL_ARM_CONV_INT_H

#include "tiles.h"

LULL_INLINE uint32_t load_dword(const uint8_t *p)
{
    uint32_t v;
    memcpy(&v, p, sizeof v);
    return v;
}

/* Weights of the even and of the odd elements of 4 outputs. (vld2_s16 wants neighbouring registers,
 * for which gcc 14 goes by way of the stack.) */
LULL_INLINE int16x4x2_t load_wide(const uint8_t *w)
{
    int16x8_t v = vld1q_s16((const int16_t *)(const void *)w);
    return vuzp_s16(vget_low_s16(v), vget_high_s16(v));
}

LULL_INLINE int32x4_t wide_add(int32x4_t sum, int16x4x2_t w, uint32_t pair)
{
    int16x4_t x = vreinterpret_s16_u32(vdup_n_u32(pair));
    return vmlal_lane_s16(vmlal_lane_s16(sum, w.val[0], x, 0), w.val[1], x, 1);
}

/* Where and how the pixels of a tile are stored. */
typedef struct finish {
    const int32_t *multiplier;
    uint8_t *to;
    size_t step; /* bytes */
    int32_t max;
    unsigned n;
} finish;

LULL_INLINE void finish_init(finish *f, const lull_conv *conv, unsigned first, unsigned p,
                             unsigned n)
{
    unsigned size = conv->out_max <= 255 ? 1 : 2;
    f->multiplier = conv->multiplier + first;
    f->step = size * conv->out_step;
    f->to = (uint8_t *)conv->out + p * f->step + first * size;
    f->max = conv->out_max;
    f->n = n;
}

/* Requantises and stores vector v of pixel i. (a * M + 2^30) >> 31 is the rounding doubling
 * multiply. */
LULL_INLINE void finish_store(const finish *f, unsigned i, unsigned v, int32x4_t a)
{
    int32x4_t q = vqrdmulhq_s32(a, vld1q_s32(f->multiplier + v * LANES));
    uint16x4_t u = vmin_u16(vqmovun_s32(q), vdup_n_u16((uint16_t)f->max));
    unsigned n = lull_min_u(f->n - v * LANES, LANES);
    uint8_t *to = f->to + i * f->step;
    if (f->max <= 255) {
        uint8x8_t b = vmovn_u16(vcombine_u16(u, u));
        uint32_t bytes = vget_lane_u32(vreinterpret_u32_u8(b), 0);
        to += v * LANES;
        if (n == LANES)
            memcpy(to, &bytes, 4);
        else
            for (; n; n--, bytes >>= 8)
                *to++ = (uint8_t)bytes;
    } else {
        uint64_t words = vget_lane_u64(vreinterpret_u64_u16(u), 0);
        to += 2 * v * LANES;
        if (n == LANES)
            memcpy(to, &words, 8);
        else
            for (; n; n--, words >>= 16, to += 2)
                memcpy(to, &words, 2);
    }
}

/* Biases of VECTORS vectors of outputs from `first` on, for activations from which 128 is
 * subtracted: 128 times the sum of an output's narrow weights is added. */
LULL_INLINE void offset_bias(int32_t *bias, const lull_conv *conv, unsigned first, unsigned vectors)
{
    for (unsigned v = 0; v < vectors; v++) {
        int32x4_t sum = vdupq_n_s32(0);
        for (unsigned s = conv->wide; s < conv->segments; s++) {
            const lull_segment *segment = &conv->segment[s];
            const int8_t *w = (const int8_t *)segment->weights +
                              (size_t)(first / LANES + v) * 16 * segment->length;
            for (unsigned k = segment->length; k; k--, w += 16)
                sum = vpadalq_s16(sum, vpaddlq_s8(vld1q_s8(w)));
        }
        vst1q_s32(bias + v * LANES,
                  vaddq_s32(vld1q_s32((const int32_t *)conv->bias + first + v * LANES),
                            vshlq_n_s32(sum, 7)));
    }
}

/* Runs a convolution; is_offset: with offset_bias. */
LULL_INLINE void run_int(const lull_conv *conv, const tile_shape *shapes, int is_offset)
{
    unsigned first = 0;
    while (first < conv->outputs) {
        const tile_shape *shape = choose_shape(shapes, conv->outputs - first, conv->pixels);
        unsigned n = lull_min_u(conv->outputs - first, shape->vectors * LANES);
        int32_t bias[MAX_VECTORS * LANES];
        if (is_offset)
            offset_bias(bias, conv, first, shape->vectors);
        run_row(conv, shape, is_offset ? bias : (const int32_t *)conv->bias + first, first, n);
        first += shape->vectors * LANES;
    }
}

#endif
