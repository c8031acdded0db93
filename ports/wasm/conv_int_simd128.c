/* Integer convolution: codes and weights are widened to 16 bits, and their products added in pairs
 * (i32x4.dot_i16x8_s), which are exact. A vector of four outputs has two sums while narrow segments
 * are added, of two outputs each, with the lanes (elements 0 and 1, 2 and 3) of the one, then of
 * the other. */
#include "port_simd128.h"
#include "tiles.h"

typedef struct sums {
    v128_t low, high;
} sums;

LULL_INLINE v128_t add(v128_t a, v128_t b) { return wasm_i32x4_add(a, b); }

/* q = clamp((a M + 2^30) >> 31, 0, max) of four outputs. */
LULL_INLINE v128_t requantised(v128_t a, v128_t multiplier, v128_t max)
{
    const v128_t half = wasm_i64x2_const_splat((int64_t)1 << 30);
    v128_t low = wasm_i64x2_add(wasm_i64x2_extmul_low_i32x4(a, multiplier), half);
    v128_t high = wasm_i64x2_add(wasm_i64x2_extmul_high_i32x4(a, multiplier), half);
    low = wasm_u64x2_shr(low, 31), high = wasm_u64x2_shr(high, 31);
    a = wasm_i32x4_shuffle(low, high, 0, 2, 4, 6);
    return wasm_i32x4_min(wasm_i32x4_max(a, wasm_i32x4_const_splat(0)), max);
}

/* Stores the first n of the outputs in q, vectors of four. */
LULL_INLINE void store(uint8_t *to, const v128_t *q, const unsigned vectors, unsigned n,
                       int is_byte)
{
    v128_t words = wasm_u16x8_narrow_i32x4(q[0], q[vectors - 1]);
    uint8_t part[16];
    if (is_byte) {
        v128_t codes = wasm_u8x16_narrow_i16x8(words, words);
        if (n == 8)
            wasm_v128_store64_lane(to, codes, 0);
        else if (n == 4)
            wasm_v128_store32_lane(to, codes, 0);
        else {
            wasm_v128_store(part, codes);
            memcpy(to, part, n);
        }
    } else if (n == 8)
        wasm_v128_store(to, words);
    else {
        wasm_v128_store(part, words);
        memcpy(to, part, 2 * (size_t)n);
    }
}

LULL_INLINE void tile(const lull_conv *conv, unsigned first, unsigned p, unsigned n,
                      const unsigned vectors, const unsigned pixels)
{
    const v128_t zero = wasm_i32x4_const_splat(0), max = wasm_i32x4_splat(conv->out_max);
    const int is_byte = conv->out_max <= 255;
    const size_t size = is_byte ? 1 : 2;
    const int32_t *bias = (const int32_t *)conv->bias + first;
    sums sum[4][2];
    unsigned s = 0;
    for (unsigned i = 0; i < pixels; i++)
        for (unsigned v = 0; v < vectors; v++)
            sum[i][v].low = sum[i][v].high = zero;
    for (; s < conv->wide; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = 16 * (size_t)segment->length, step = 2 * (size_t)segment->step;
        const uint8_t *w = (const uint8_t *)segment->weights + first / LANES * block;
        const uint8_t *x = (const uint8_t *)segment->row + p * step;
        for (unsigned k = segment->length; k; k--, x += 4, w += 16)
            for (unsigned i = 0; i < pixels; i++) {
                v128_t pair = wasm_v128_load32_splat(x + i * step);
                for (unsigned v = 0; v < vectors; v++)
                    sum[i][v].low = add(sum[i][v].low, wasm_i32x4_dot_i16x8(
                                                           pair, wasm_v128_load(w + v * block)));
            }
    }
    if (s)
        for (unsigned i = 0; i < pixels; i++)
            for (unsigned v = 0; v < vectors; v++)
                sum[i][v].low = wasm_i32x4_shr(
                    add(sum[i][v].low, wasm_i32x4_splat(1 << conv->wide_shift >> 1)),
                    conv->wide_shift);
    /* Lanes 0 and 2 of either sum begin with what the outputs have so far. */
    for (unsigned i = 0; i < pixels; i++)
        for (unsigned v = 0; v < vectors; v++) {
            v128_t so_far = add(sum[i][v].low, wasm_v128_load(bias + v * LANES));
            sum[i][v].low = wasm_i32x4_shuffle(so_far, zero, 0, 4, 1, 4);
            sum[i][v].high = wasm_i32x4_shuffle(so_far, zero, 2, 4, 3, 4);
        }
    for (; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = 16 * (size_t)segment->length, step = segment->step;
        const uint8_t *w = (const uint8_t *)segment->weights + first / LANES * block;
        const uint8_t *x = (const uint8_t *)segment->row + p * step;
        for (unsigned k = segment->length; k; k--, x += 4, w += 16) {
            v128_t code[4];
            for (unsigned i = 0; i < pixels; i++)
                code[i] = wasm_u16x8_extend_low_u8x16(wasm_v128_load32_splat(x + i * step));
            for (unsigned v = 0; v < vectors; v++) {
                v128_t low = wasm_i16x8_load8x8(w + v * block);
                v128_t high = wasm_i16x8_load8x8(w + v * block + 8);
                for (unsigned i = 0; i < pixels; i++) {
                    sum[i][v].low = add(sum[i][v].low, wasm_i32x4_dot_i16x8(code[i], low));
                    sum[i][v].high = add(sum[i][v].high, wasm_i32x4_dot_i16x8(code[i], high));
                }
            }
        }
    }
    for (unsigned i = 0; i < pixels; i++) {
        v128_t q[2];
        for (unsigned v = 0; v < vectors; v++) {
            v128_t a = add(wasm_i32x4_shuffle(sum[i][v].low, sum[i][v].high, 0, 2, 4, 6),
                           wasm_i32x4_shuffle(sum[i][v].low, sum[i][v].high, 1, 3, 5, 7));
            q[v] = requantised(a, wasm_v128_load(conv->multiplier + first + v * LANES), max);
        }
        store((uint8_t *)conv->out + size * ((p + i) * conv->out_step + first), q, vectors, n,
              is_byte);
    }
}

TILE(2, 2)
TILE(2, 1)
TILE(1, 4)
TILE(1, 1)

void lull_conv_int_simd128(const lull_conv *conv)
{
    static const tile_shape shapes[] = {
        {tile_2x2, 2, 2}, {tile_2x1, 2, 1}, {tile_1x4, 1, 4}, {tile_1x1, 1, 1}};
    run_tiles(conv, shapes);
}

/* ---- Three outputs: vectors of a run's elements ---------------------------------------------- */

LULL_INLINE int32_t total(v128_t v)
{
    v = add(v, wasm_i32x4_shuffle(v, v, 2, 3, 0, 1));
    return wasm_i32x4_extract_lane(v, 0) + wasm_i32x4_extract_lane(v, 1);
}

/* Sums of n dwords of codes of 16 bits (two of each), or of 8 (four). */
static int32_t dot_wide(const uint8_t *x, const uint8_t *w, unsigned n)
{
    v128_t sum = wasm_i32x4_const_splat(0);
    for (; n >= 4; n -= 4, x += 16, w += 16)
        sum = add(sum, wasm_i32x4_dot_i16x8(wasm_v128_load(x), wasm_v128_load(w)));
    for (; n; n--, x += 4, w += 4)
        sum = add(sum, wasm_i32x4_dot_i16x8(wasm_v128_load32_zero(x), wasm_v128_load32_zero(w)));
    return total(sum);
}

static int32_t dot_narrow(const uint8_t *x, const uint8_t *w, unsigned n)
{
    v128_t sum = wasm_i32x4_const_splat(0);
    for (; n >= 2; n -= 2, x += 8, w += 8)
        sum = add(sum, wasm_i32x4_dot_i16x8(wasm_u16x8_load8x8(x), wasm_i16x8_load8x8(w)));
    if (n)
        sum = add(sum, wasm_i32x4_dot_i16x8(
                           wasm_u16x8_extend_low_u8x16(wasm_v128_load32_zero(x)),
                           wasm_i16x8_extend_low_i8x16(wasm_v128_load32_zero(w))));
    return total(sum);
}

void lull_conv_int3_simd128(const lull_conv *conv)
{
    const v128_t multiplier = wasm_i32x4_make(conv->multiplier[0], conv->multiplier[1],
                                              conv->multiplier[2], 0);
    const v128_t max = wasm_i32x4_splat(conv->out_max);
    const int is_byte = conv->out_max <= 255;
    for (size_t p = 0; p < conv->pixels; p++) {
        int32_t sum[4] = {0};
        v128_t q;
        for (unsigned s = 0; s < conv->segments; s++) {
            const lull_segment *segment = &conv->segment[s];
            const unsigned size = s < conv->wide ? 2 : 1, n = segment->length;
            const uint8_t *x = (const uint8_t *)segment->row + p * size * segment->step;
            const uint8_t *w = (const uint8_t *)segment->weights;
            for (unsigned o = 0; o < 3; o++, w += 4 * (size_t)n) {
                sum[o] += size == 2 ? dot_wide(x, w, n) : dot_narrow(x, w, n);
                if (s + 1 == conv->wide)
                    sum[o] = (sum[o] + (1 << conv->wide_shift >> 1)) >> conv->wide_shift;
            }
        }
        for (unsigned o = 0; o < 3; o++)
            sum[o] += ((const int32_t *)conv->bias)[o];
        q = requantised(wasm_v128_load(sum), multiplier, max);
        store((uint8_t *)conv->out + (is_byte ? 1u : 2u) * p * conv->out_step, &q, 1, 3, is_byte);
    }
}
