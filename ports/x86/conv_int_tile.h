/* One tile of an integer convolution: VECTORS vectors of output channels x PIXELS pixels.
 * Included once for every shape, with TILE (the function's name), VECTORS (1 to 4) and PIXELS
 * defined; they are undefined at the end. The including file defines, for its instruction set:
 *
 *   vec, LANES                           a vector of LANES int32
 *   zero(), load(p), splat(p), add(a, b) splat: the dword at p in every lane
 *   shift(a, n)                          arithmetic shift to the right
 *   DOT_NARROW(sum, x, w)                sum += 4 products of u8 x and s8 w in every lane
 *   DOT_WIDE(sum, x, w)                  sum += 2 products of s16 x and s16 w in every lane
 *   finish, finish_init(&f, conv, first, p, n), finish_<VECTORS>(&f, i, a, ...),
 *   finish_end(&f, PIXELS)               requantise and store n outputs from `first` on of pixel
 *                                        p + i
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
#define FINISH__(n) finish_##n
#define FINISH_(n) FINISH__(n)
#define FOR_PIXELS PIXELS_PASTE(PIXELS)

#define DECLARE(i, base, offset) \
    vec a##i = zero() B(, b##i = zero()) C(, c##i = zero()) D(, d##i = zero());
#define NARROW(i, base, offset)       \
    value = splat((base) + (offset)); \
    DOT_NARROW(a##i, value, v0);      \
    B(DOT_NARROW(b##i, value, v1);) C(DOT_NARROW(c##i, value, v2);) D(DOT_NARROW(d##i, value, v3);)
#define WIDE(i, base, offset)         \
    value = splat((base) + (offset)); \
    DOT_WIDE(a##i, value, v0);        \
    B(DOT_WIDE(b##i, value, v1);) C(DOT_WIDE(c##i, value, v2);) D(DOT_WIDE(d##i, value, v3);)
#define SHIFT(i, base, offset)               \
    a##i = shift(add(a##i, half), count);    \
    B(b##i = shift(add(b##i, half), count);) \
    C(c##i = shift(add(c##i, half), count);) \
    D(d##i = shift(add(d##i, half), count);)
#define BIAS(i, base, offset)                    \
    a##i = add(a##i, load(bias));                \
    B(b##i = add(b##i, load(bias + LANES));)     \
    C(c##i = add(c##i, load(bias + 2 * LANES));) \
    D(d##i = add(d##i, load(bias + 3 * LANES));)
#define STORE(i, base, offset) FINISH_(VECTORS)(&f, i, a##i B(, b##i) C(, c##i) D(, d##i));

/* Adds segment s, whose elements have `bytes` bytes. */
#define SEGMENT(ADD, bytes)                                                           \
    {                                                                                 \
        const lull_segment *segment = &conv->segment[s];                              \
        size_t block = 4 * LANES * (size_t)segment->length;                           \
        size_t step = (bytes) * (size_t)segment->step;                                \
        const uint8_t *w = (const uint8_t *)segment->weights + first / LANES * block; \
        const uint8_t *x = (const uint8_t *)segment->row + p * step;                  \
        for (unsigned k = segment->length; k; k--, x += 4, w += 4 * LANES) {          \
            const uint8_t *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;    \
            vec v0 = load(w) B(, v1 = load(w + block)) C(, v2 = load(w + 2 * block))  \
                D(, v3 = load(w + 3 * block)), value;                                 \
            FOR_PIXELS(ADD)                                                           \
            (void)y, (void)z, (void)t;                                                \
        }                                                                             \
    }

/* n outputs from `first` on, PIXELS pixels from p on. */
static void TILE(const lull_conv *conv, unsigned first, unsigned p, unsigned n)
{
    const int32_t *bias = (const int32_t *)conv->bias + first;
    unsigned s = 0;
    finish f;
    FOR_PIXELS(DECLARE)
    for (; s < conv->wide; s++)
        SEGMENT(WIDE, 2)
    if (s) {
        unsigned count = conv->wide_shift;
        vec half = splat_int(1 << count >> 1);
        FOR_PIXELS(SHIFT)
    }
    FOR_PIXELS(BIAS)
    for (; s < conv->segments; s++)
        SEGMENT(NARROW, 1)
    finish_init(&f, conv, first, p, n);
    FOR_PIXELS(STORE)
    finish_end(&f, PIXELS);
}

#undef B
#undef C
#undef D
#undef FINISH__
#undef FINISH_
#undef FOR_PIXELS
#undef DECLARE
#undef NARROW
#undef WIDE
#undef SHIFT
#undef BIAS
#undef STORE
#undef SEGMENT
#undef TILE
#undef VECTORS
#undef PIXELS
