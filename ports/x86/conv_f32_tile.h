/* Rows of fp32 tiles of VECTORS vectors of output channels x PIXELS pixels. Included once for
 * every shape, with TILE (the function's name), VECTORS (1 to 4) and PIXELS defined; they are
 * undefined at the end. Every shape adds the same products in the same order. The including
 * file defines, for its instruction set:
 *
 *   vec, LANES                         a vector of LANES floats
 *   load(p), splat(p), madd(x, w, sum) splat: the float at p in every lane
 *   most(a, b)                         the larger one, lane by lane
 *   store(p, v, n)                     the first n lanes if n < LANES
 */
#include "pixels.h"
#include "vectors.h"

#define DECLARE(i, base, offset)                                                                   \
    vec a##i = bias0 B(, b##i = bias1) C(, c##i = bias2) D(, d##i = bias3);
#define ADD(i, base, offset)                                                                       \
    value = splat((base) + (offset));                                                              \
    a##i = madd(value, v0, a##i);                                                                  \
    B(b##i = madd(value, v1, b##i);)                                                               \
    C(c##i = madd(value, v2, c##i);)                                                               \
    D(d##i = madd(value, v3, d##i);)
#define STORE(i, base, offset)                                                                     \
    store(out + (i)*out_step, most(a##i, least), row->n);                                          \
    B(store(out + (i)*out_step + LANES, most(b##i, least), row->n - LANES);)                       \
    C(store(out + (i)*out_step + 2 * LANES, most(c##i, least), row->n - 2 * LANES);)               \
    D(store(out + (i)*out_step + 3 * LANES, most(d##i, least), row->n - 3 * LANES);)

static void TILE(const tile_row *row)
{
    const lull_conv *conv = row->conv;
    const struct tile_part *end = row->part + conv->segments;
    const float *bias = (const float *)conv->bias + row->first;
    size_t out_step = conv->out_step;
    FOR_TILES(p, conv, PIXELS)
    {
        float *out = (float *)conv->out + p * out_step + row->first;
        vec bias0 = load(bias) B(, bias1 = load(bias + LANES)) C(, bias2 = load(bias + 2 * LANES))
            D(, bias3 = load(bias + 3 * LANES));
        FOR_PIXELS(DECLARE)
        for (const struct tile_part *part = row->part; part < end; part++) {
            size_t block = part->block / sizeof(float), step = part->step / sizeof(float);
            const float *w = (const float *)(const void *)part->w;
            const float *x = (const float *)(const void *)part->x + p * step;
            for (unsigned k = part->length; k; k--, x++, w += LANES) {
                const float *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;
                vec v0 = load(w) B(, v1 = load(w + block)) C(, v2 = load(w + 2 * block))
                    D(, v3 = load(w + 3 * block)), value;
                FOR_PIXELS(ADD)
                (void)y, (void)z, (void)t, (void)block;
            }
        }
        vec least = splat(&conv->least);
        FOR_PIXELS(STORE)
    }
}

#undef DECLARE
#undef ADD
#undef STORE
#include "vectors_end.h"
