/* Integer convolution with plain NEON. 128 is subtracted from the activations, and made good in
 * the bias: then two products of signed bytes fit 16 bits. Products of two dwords are added in
 * 16 bits, then pairs of these in 32. During the narrow segments an output has two sums: a
 * vector of four outputs is held in two (named a<i> and a<i>h, and so on). Where weights fit words
 * (lull_conv), a lane's products of a whole run are added in 16 bits: with at most 128 of either
 * sign, and codes from -128 to 127, these fit, too. */
#include "conv_int.h"
#include "port_neon.h"

LULL_INLINE int8x16_t splat_all(const uint8_t *p)
{
    return vreinterpretq_s8_u32(vdupq_n_u32(load_dword(p) ^ 0x80808080u));
}
LULL_INLINE int8x8_t splat(const uint8_t *p) { return vget_low_s8(splat_all(p)); }

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

#undef NARROW
#define START_RUN(i)                                                \
    int16x8_t run_a##i = vdupq_n_s16(0), run_a##i##h = run_a##i B(, \
              run_b##i = run_a##i, run_b##i##h = run_a##i);
#if defined(__aarch64__)
#define HIGH(sum, v, x) vmlal_high_s8(sum, v, x)
#else
#define HIGH(sum, v, x) vmlal_s8(sum, vget_high_s8(v), vget_low_s8(x))
#endif
#define ADD_RUN(low, high, v)                             \
    low = vmlal_s8(low, vget_low_s8(v), vget_low_s8(x0)); \
    KEEP(low);                                            \
    high = HIGH(high, v, x0);                             \
    KEEP(high);
#define RUN(i)                            \
    x0 = splat_all(x + (i) * step);       \
    ADD_RUN(run_a##i, run_a##i##h, v0)    \
    B(ADD_RUN(run_b##i, run_b##i##h, v1)) \
    IN_ORDER
#define END_RUN(i)                               \
    a##i = vpadalq_s16(a##i, run_a##i);          \
    a##i##h = vpadalq_s16(a##i##h, run_a##i##h); \
    B(b##i = vpadalq_s16(b##i, run_b##i);        \
      b##i##h = vpadalq_s16(b##i##h, run_b##i##h);)
#define NARROW                                                    \
    FOR_PIXELS(START_RUN)                                         \
    for (; k; k--, x += 4, w += 16) {                             \
        int8x16_t v0 = vld1q_s8(w) B(, v1 = vld1q_s8(w + block)); \
        int8x16_t x0;                                             \
        FOR_PIXELS(RUN)                                           \
    }                                                             \
    FOR_PIXELS(END_RUN)

#define TILE words_2
#define VECTORS 2
#define PIXELS PIXELS_OF_2
#include "conv_int_tile.h"

#define TILE words_1
#define VECTORS 1
#define PIXELS PIXELS_OF_1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {
    {tile_2, 2, PIXELS_OF_2}, {tile_1, 1, PIXELS_OF_1}, {pixel_1, 1, 1}};
static const tile_shape word_shapes[] = {
    {words_2, 2, PIXELS_OF_2}, {words_1, 1, PIXELS_OF_1}, {pixel_1, 1, 1}};

void lull_conv_int_neon(const lull_conv *conv)
{
    run_int(conv, conv->fits_words ? word_shapes : shapes, 1);
}
