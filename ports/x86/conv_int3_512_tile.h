/* Tiles of PIXELS pixels of three outputs, for conv_int3_512.h: included once for each size, with
 * TILE and RUN (the functions' names), PIXELS and INT3_SUM(a, b, c) (sums of all pixels) defined;
 * they are undefined at the end. */
#include "pixels.h"
#define FOR_PIXELS PIXELS_PASTE(PIXELS_, PIXELS)

#define DECLARE(i, base, offset) vec a##i = zero(), b##i = zero(), c##i = zero();

/* Sums of the pixels from p on over the segments from `first` to `end`, which have elements of
 * `size` bytes. */
LULL_INLINE vec RUN(const lull_conv *conv, unsigned first, unsigned end, unsigned size, unsigned p)
{
    vec rest = zero();
    FOR_PIXELS(DECLARE)
    for (const lull_segment *s = conv->segment + first; s < conv->segment + end; s++) {
        size_t step = size * (size_t)s->step, next = 4 * (size_t)s->length;
        const uint8_t *x = (const uint8_t *)s->row + p * step, *w = (const uint8_t *)s->weights;
        for (unsigned k = s->length / LANES; k; k--, x += 4 * LANES, w += 4 * LANES) {
            const uint8_t *y = x + 3 * step;
            vec v0 = load(w), v1 = load(w + next), v2 = load(w + 2 * next), value;
            if (size == 2) {
                FOR_PIXELS(INT3_WIDE)
            } else {
                FOR_PIXELS(INT3_NARROW)
            }
            (void)y;
        }
        if (s->length % LANES)
            rest = add(rest, int3_rests(s, size, p, PIXELS));
    }
    return add(rest, INT3_SUM(a, b, c));
}

static void TILE(const lull_conv *conv, const int3 *s)
{
    FOR_TILES(p, conv, PIXELS)
    {
        vec sum = shift(add(RUN(conv, 0, conv->wide, 2, p), s->half), conv->wide_shift);
        sum = add(sum, s->bias);
        if (conv->wide < conv->segments)
            sum = add(sum, RUN(conv, conv->wide, conv->segments, 1, p));
        int3_store(s, conv, p, PIXELS, sum);
    }
}

#undef DECLARE
#undef FOR_PIXELS
#undef PIXELS
#undef INT3_SUM
#undef RUN
#undef TILE
