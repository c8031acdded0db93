/* Integer convolution with plain NEON. 128 is subtracted from the activations, and made good in
 * the bias: then two products of signed bytes fit 16 bits. Products of two dwords are added in
 * 16 bits, then pairs of these in 32. During the narrow segments an output has two sums: a
 * vector of four outputs is held in two (named a<i> and a<i>h, and so on). */
#include "conv_int.h"
#include "port_neon.h"

LULL_INLINE int8x8_t splat(const uint8_t *p)
{
    return vreinterpret_s8_u32(vdup_n_u32(load_dword(p) ^ 0x80808080u));
}

LULL_INLINE int32x4_t even_lanes(int32x4_t v, int high)
{
    int32x4x2_t zipped = vzipq_s32(v, vdupq_n_s32(0));
    return high ? zipped.val[1] : zipped.val[0];
}

/* Adds neighbours of low and high, in order. */
LULL_INLINE int32x4_t join(int32x4_t low, int32x4_t high)
{
    return vcombine_s32(vpadd_s32(vget_low_s32(low), vget_high_s32(low)),
                        vpadd_s32(vget_low_s32(high), vget_high_s32(high)));
}

#define SPLIT(i)                                                                \
    int32x4_t a##i##h = even_lanes(a##i, 1) B(, b##i##h = even_lanes(b##i, 1)); \
    a##i = even_lanes(a##i, 0);                                                 \
    B(b##i = even_lanes(b##i, 0);)
#define JOIN(i)                 \
    a##i = join(a##i, a##i##h); \
    B(b##i = join(b##i, b##i##h);)
#define ADD(sum, half, v) \
    sum = vpadalq_s16(sum, vmlal_s8(vmull_s8(half(v##_0), x0), half(v##_1), x1)); KEEP(sum);
#define PAIR(i)                                                  \
    x0 = splat(x + (i) * step), x1 = splat(x + (i) * step + 4);  \
    ADD(a##i, vget_low_s8, v0) ADD(a##i##h, vget_high_s8, v0)    \
    B(ADD(b##i, vget_low_s8, v1) ADD(b##i##h, vget_high_s8, v1)) \
    IN_ORDER
#define ADD_LAST(sum, half, v) sum = vpadalq_s16(sum, vmull_s8(half(v##_0), x0));
#define LAST(i)                                                         \
    x0 = splat(x + (i) * step);                                         \
    ADD_LAST(a##i, vget_low_s8, v0) ADD_LAST(a##i##h, vget_high_s8, v0) \
    B(ADD_LAST(b##i, vget_low_s8, v1) ADD_LAST(b##i##h, vget_high_s8, v1))
#define NARROW                                                                \
    for (; k >= 2; k -= 2, x += 8, w += 32) {                                 \
        int8x16_t v0_0 = vld1q_s8(w), v0_1 = vld1q_s8(w + 16)                 \
            B(, v1_0 = vld1q_s8(w + block), v1_1 = vld1q_s8(w + block + 16)); \
        int8x8_t x0, x1;                                                      \
        FOR_PIXELS(PAIR)                                                      \
    }                                                                         \
    if (k) {                                                                  \
        int8x16_t v0_0 = vld1q_s8(w) B(, v1_0 = vld1q_s8(w + block));         \
        int8x8_t x0;                                                          \
        FOR_PIXELS(LAST)                                                      \
    }
#define NARROW_BEFORE FOR_PIXELS(SPLIT)
#define NARROW_AFTER FOR_PIXELS(JOIN)

#if defined(__aarch64__)
#define PIXELS_OF_2 4
#define PIXELS_OF_1 8
#else
#define PIXELS_OF_2 2
#define PIXELS_OF_1 4
#endif

#define TILE tile_2
#define VECTORS 2
#define PIXELS PIXELS_OF_2
#include "conv_int_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS PIXELS_OF_1
#include "conv_int_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {
    {tile_2, 2, PIXELS_OF_2}, {tile_1, 1, PIXELS_OF_1}, {pixel_1, 1, 1}};

void lull_conv_int_neon(const lull_conv *conv) { run_int(conv, shapes, 1); }
