/* Integer convolution with the 8-bit matrix multiplication extension: an instruction multiplies
 * 2 pixels by 2 outputs over 8 elements. During the narrow segments, the sums of pixels i, j
 * and outputs 0..3 are held as two 2x2 matrices, outputs 0, 1 in pixel i's variable and outputs
 * 2, 3 in pixel j's. */
#include "conv_int.h"
#include "port_i8mm.h"

LULL_INLINE int32x4_t low(int32x4_t a, int32x4_t b)
{
    return vreinterpretq_s32_s64(vzip1q_s64(vreinterpretq_s64_s32(a), vreinterpretq_s64_s32(b)));
}

LULL_INLINE int32x4_t high(int32x4_t a, int32x4_t b)
{
    return vreinterpretq_s32_s64(vzip2q_s64(vreinterpretq_s64_s32(a), vreinterpretq_s64_s32(b)));
}

/* 8 elements of two pixels. */
LULL_INLINE uint8x16_t two_runs(const uint8_t *p, const uint8_t *q)
{
    return vcombine_u8(vld1_u8(p), vld1_u8(q));
}

/* 4 elements of two pixels, then zeros. */
LULL_INLINE uint8x16_t two_dwords(const uint8_t *p, const uint8_t *q)
{
    return vcombine_u8(vreinterpret_u8_u64(vcreate_u64(load_dword(p))),
                       vreinterpret_u8_u64(vcreate_u64(load_dword(q))));
}

#define WEIGHTS(v, at)                                               \
    int32x4_t v##_0 = vreinterpretq_s32_s8(vld1q_s8(at)),            \
              v##_1 = vreinterpretq_s32_s8(vld1q_s8((at) + 16));     \
    int8x16_t v##l = vreinterpretq_s8_s32(vzip1q_s32(v##_0, v##_1)), \
              v##h = vreinterpretq_s8_s32(vzip2q_s32(v##_0, v##_1));
#define LAST_WEIGHTS(v, at)                                          \
    int32x4_t v##_0 = vreinterpretq_s32_s8(vld1q_s8(at));            \
    int8x16_t v##l = vreinterpretq_s8_s32(vzip1q_s32(v##_0, v##_0)), \
              v##h = vreinterpretq_s8_s32(vzip2q_s32(v##_0, v##_0));
#define MULTIPLY(i, j)                                                              \
    a##i = vusmmlaq_s32(a##i, values, v0l), a##j = vusmmlaq_s32(a##j, values, v0h); \
    B(b##i = vusmmlaq_s32(b##i, values, v1l), b##j = vusmmlaq_s32(b##j, values, v1h);)
#define RUNS(i, j)                                     \
    values = two_runs(x + (i) * step, x + (j) * step); \
    MULTIPLY(i, j)
#define DWORDS(i, j)                                     \
    values = two_dwords(x + (i) * step, x + (j) * step); \
    MULTIPLY(i, j)
#define NARROW                                             \
    for (; k >= 2; k -= 2, x += 8, w += 32) {              \
        uint8x16_t values;                                 \
        WEIGHTS(v0, w) B(WEIGHTS(v1, w + block))           \
        FOR_PAIRS(RUNS)                                    \
    }                                                      \
    if (k) {                                               \
        uint8x16_t values;                                 \
        LAST_WEIGHTS(v0, w) B(LAST_WEIGHTS(v1, w + block)) \
        FOR_PAIRS(DWORDS)                                  \
    }
#define SWAP(i, j)                        \
    swap = low(a##i, a##j);               \
    a##j = high(a##i, a##j), a##i = swap; \
    B(swap = low(b##i, b##j); b##j = high(b##i, b##j), b##i = swap;)
#define SWAP_ALL        \
    {                   \
        int32x4_t swap; \
        FOR_PAIRS(SWAP) \
    }
#define NARROW_BEFORE SWAP_ALL
#define NARROW_AFTER SWAP_ALL

#define TILE tile_2
#define VECTORS 2
#define PIXELS 8
#include "conv_int_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 8
#include "conv_int_tile.h"

#undef NARROW_BEFORE
#undef NARROW_AFTER
#undef NARROW
#define NARROW                      \
    for (; k; k--, x += 4, w += 16) \
        a0 = vusdotq_s32(a0, vreinterpretq_u8_u32(vdupq_n_u32(load_dword(x))), vld1q_s8(w));
#define NARROW_BEFORE
#define NARROW_AFTER

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {{tile_2, 2, 8}, {tile_1, 1, 8}, {pixel_1, 1, 1}};

void lull_conv_int_i8mm(const lull_conv *conv) { run_int(conv, shapes, 0); }
