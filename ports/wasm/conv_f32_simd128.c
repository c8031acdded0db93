/* fp32 convolution: vectors over 4 output channels. Products and sums are rounded one by one, in
 * the order of the definition, as in plain C. */
#include "port_simd128.h"
#include "tiles.h"

LULL_INLINE void tile(const lull_conv *conv, unsigned first, unsigned p, unsigned n,
                      const unsigned vectors, const unsigned pixels)
{
    const v128_t least = wasm_f32x4_splat(conv->least);
    v128_t sum[4][4];
    for (unsigned i = 0; i < pixels; i++)
        for (unsigned v = 0; v < vectors; v++)
            sum[i][v] = wasm_v128_load((const float *)conv->bias + first + v * LANES);
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = LANES * (size_t)segment->length, step = segment->step;
        const float *w = (const float *)segment->weights + first / LANES * block;
        const float *x = (const float *)segment->row + p * step;
        for (unsigned k = segment->length; k; k--, x++, w += LANES)
            for (unsigned v = 0; v < vectors; v++) {
                v128_t weight = wasm_v128_load(w + v * block);
                for (unsigned i = 0; i < pixels; i++)
                    sum[i][v] = wasm_f32x4_add(
                        sum[i][v],
                        wasm_f32x4_mul(wasm_v128_load32_splat(x + i * step), weight));
            }
    }
    for (unsigned i = 0; i < pixels; i++)
        for (unsigned v = 0; v < vectors; v++) {
            float *out = (float *)conv->out + (p + i) * conv->out_step + first + v * LANES, part[4];
            unsigned lanes = lull_min_u(n - v * LANES, LANES);
            wasm_v128_store(lanes < LANES ? part : out, wasm_f32x4_pmax(least, sum[i][v]));
            if (lanes < LANES)
                memcpy(out, part, lanes * sizeof *out);
        }
}

TILE(2, 4)
TILE(1, 4)
TILE(1, 1)

void lull_conv_f32_simd128(const lull_conv *conv)
{
    static const tile_shape shapes[] = {{tile_2x4, 2, 4}, {tile_1x4, 1, 4}, {tile_1x1, 1, 1}};
    run_tiles(conv, shapes);
}
