/* Integer convolution with the dot-product extension. Its mixed products want signed
 * activations: 128 is subtracted from them, and made good in the bias. Runs are read 4 dwords
 * at a time and multiplied lane by lane. */
#include "conv_int.h"
#include "port_dotprod.h"

LULL_INLINE int8x16_t make_signed(uint8x16_t x)
{
    return vreinterpretq_s8_u8(veorq_u8(x, vdupq_n_u8(0x80)));
}

LULL_INLINE int8x16_t splat(const uint8_t *p)
{
    return make_signed(vreinterpretq_u8_u32(vdupq_n_u32(load_dword(p))));
}

#define LOAD(i) int8x16_t x##i = make_signed(vld1q_u8(x + (i) * step));
#define SPLAT(i) int8x16_t x##i = splat(x + (i) * step);
#define DOT(sum, w, x, j) sum = vdotq_laneq_s32(sum, w, x, j); KEEP(sum);
#define DOT_ALL(i, j)                                \
    DOT(a##i, v0, x##i, j) B(DOT(b##i, v1, x##i, j)) \
    CD(DOT(c##i, v2, x##i, j)) CD(DOT(d##i, v3, x##i, j))
#define DOT_0(i) DOT_ALL(i, 0)
#define DOT_1(i) DOT_ALL(i, 1)
#define DOT_2(i) DOT_ALL(i, 2)
#define DOT_3(i) DOT_ALL(i, 3)
#define STEP(j)                                                                        \
    {                                                                                  \
        IN_ORDER                                                                       \
        int8x16_t v0 = vld1q_s8(w + 16 * (j)) B(, v1 = vld1q_s8(w + block + 16 * (j))) \
            CD(, v2 = vld1q_s8(w + 2 * block + 16 * (j)))                              \
            CD(, v3 = vld1q_s8(w + 3 * block + 16 * (j)));                             \
        FOR_PIXELS(DOT_##j)                                                            \
    }
#define NARROW                                 \
    for (; k >= 4; k -= 4, x += 16, w += 64) { \
        FOR_PIXELS(LOAD)                       \
        STEP(0) STEP(1) STEP(2) STEP(3)        \
    }                                          \
    for (; k; k--, x += 4, w += 16) {          \
        FOR_PIXELS(SPLAT)                      \
        STEP(0)                                \
    }
#define NARROW_BEFORE
#define NARROW_AFTER

#define TILE tile_4
#define VECTORS 4
#define PIXELS 4
#include "conv_int_tile.h"

#define TILE tile_2
#define VECTORS 2
#define PIXELS 8
#include "conv_int_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 8
#include "conv_int_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {
    {tile_4, 4, 4}, {tile_2, 2, 8}, {tile_1, 1, 8}, {pixel_1, 1, 1}};

void lull_conv_int_dotprod(const lull_conv *conv) { run_int(conv, shapes, 1); }
