/* 2x2 maximum: the two pixels of a pair are neighbours, so a vector of channels is the maximum of
 * four loads. What is left of them is done in plain C. */
#include <wasm_simd128.h>

#include "port_simd128.h"

/* a > b ? a : b */
LULL_INLINE v128_t most(v128_t a, v128_t b) { return wasm_f32x4_pmax(b, a); }

void lull_pool_f32_simd128(float *out, const float *above, const float *below, unsigned channels,
                           unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 4 <= channels; c += 4) {
            v128_t a = most(wasm_v128_load(above + c), wasm_v128_load(above + channels + c));
            v128_t b = most(wasm_v128_load(below + c), wasm_v128_load(below + channels + c));
            wasm_v128_store(out + c, most(a, b));
        }
        for (; c < channels; c++) {
            float a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            float b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}

void lull_pool_u8_simd128(uint8_t *out, const uint8_t *above, const uint8_t *below,
                          unsigned channels, unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 16 <= channels; c += 16) {
            v128_t a = wasm_u8x16_max(wasm_v128_load(above + c),
                                      wasm_v128_load(above + channels + c));
            v128_t b = wasm_u8x16_max(wasm_v128_load(below + c),
                                      wasm_v128_load(below + channels + c));
            wasm_v128_store(out + c, wasm_u8x16_max(a, b));
        }
        for (; c + 8 <= channels; c += 8) {
            v128_t a = wasm_u8x16_max(wasm_v128_load64_zero(above + c),
                                      wasm_v128_load64_zero(above + channels + c));
            v128_t b = wasm_u8x16_max(wasm_v128_load64_zero(below + c),
                                      wasm_v128_load64_zero(below + channels + c));
            wasm_v128_store64_lane(out + c, wasm_u8x16_max(a, b), 0);
        }
        for (; c < channels; c++) {
            uint8_t a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            uint8_t b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}
