/* One tile of an fp32 convolution: VECTORS vectors of output channels x PIXELS pixels. Included
 * once for every shape, with TILE (the function's name), VECTORS (1 to 4) and PIXELS defined;
 * they are undefined at the end. Every shape adds the same products in the same order. The
 * including file defines, for its instruction set:
 *
 *   vec, LANES                        a vector of LANES floats
 *   load(p), splat(p), madd(x, w, sum) splat: the float at p in every lane
 *   store(p, v, n)                    the maximum of 0 and v; the first n lanes if n < LANES
 */
#include "pixels.h"

#if VECTORS > 1
#define B(...) __VA_ARGS__
#else
#define B(...)
#endif
#if VECTORS > 2
#define C(...) __VA_ARGS__
#else
#define C(...)
#endif
#if VECTORS > 3
#define D(...) __VA_ARGS__
#else
#define D(...)
#endif
#define FOR_PIXELS PIXELS_PASTE(PIXELS)

#define DECLARE(i, base, offset) \
    vec a##i = bias0 B(, b##i = bias1) C(, c##i = bias2) D(, d##i = bias3);
#define ADD(i, base, offset)          \
    value = splat((base) + (offset)); \
    a##i = madd(value, v0, a##i);     \
    B(b##i = madd(value, v1, b##i);)  \
    C(c##i = madd(value, v2, c##i);)  \
    D(d##i = madd(value, v3, d##i);)
#define STORE(i, base, offset)                                             \
    store(out + (i) * conv->out_step, a##i, n);                            \
    B(store(out + (i) * conv->out_step + LANES, b##i, n - LANES);)         \
    C(store(out + (i) * conv->out_step + 2 * LANES, c##i, n - 2 * LANES);) \
    D(store(out + (i) * conv->out_step + 3 * LANES, d##i, n - 3 * LANES);)

/* n outputs from `first` on, PIXELS pixels from p on. */
static void TILE(const lull_conv *conv, unsigned first, unsigned p, unsigned n)
{
    const float *bias = (const float *)conv->bias + first;
    float *out = (float *)conv->out + (size_t)p * conv->out_step + first;
    vec bias0 = load(bias) B(, bias1 = load(bias + LANES)) C(, bias2 = load(bias + 2 * LANES))
        D(, bias3 = load(bias + 3 * LANES));
    FOR_PIXELS(DECLARE)
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = LANES * (size_t)segment->length, step = segment->step;
        const float *w = (const float *)segment->weights + first / LANES * block;
        const float *x = (const float *)segment->row + p * step;
        for (unsigned k = segment->length; k; k--, x++, w += LANES) {
            const float *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;
            vec v0 = load(w) B(, v1 = load(w + block)) C(, v2 = load(w + 2 * block))
                D(, v3 = load(w + 3 * block)), value;
            FOR_PIXELS(ADD)
            (void)y, (void)z, (void)t;
        }
    }
    FOR_PIXELS(STORE)
}

#undef B
#undef C
#undef D
#undef FOR_PIXELS
#undef DECLARE
#undef ADD
#undef STORE
#undef TILE
#undef VECTORS
#undef PIXELS
