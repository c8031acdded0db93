/* Tiles of PIXELS pixels of three outputs, for conv_int3_256.h: included once for each size, with
 * TILE (the function's name) and PIXELS defined; they are undefined at the end. */
#include "pixels.h"
#define FOR_PIXELS PIXELS_PASTE(PIXELS_, PIXELS)

#define DECLARE(i, base, offset)                     \
    vec a##i = zero(), b##i = zero(), c##i = zero(); \
    four t##i = start;
#define CLEAR(i, base, offset) a##i = b##i = c##i = zero();
#define ADD(i, base, offset) t##i = _mm_add_epi32(t##i, int3_add(a##i, b##i, c##i));
#define SHIFT(i, base, offset) \
    t##i = _mm_add_epi32(_mm_sra_epi32(_mm_add_epi32(t##i, half), count), bias);
#define REST(i, base, offset) t##i = _mm_add_epi32(t##i, int3_rest(segment, run.size, p + i));
#define STORE(i, base, offset) int3_store(conv, p + i, t##i);

/* Adds the segments of a run to t0, t1, ... */
#define RUN(DOT)                                                                               \
    for (const lull_segment *segment = run.segment; segment < run.end; segment++) {            \
        size_t step = run.size * (size_t)segment->step, next = 4 * (size_t)segment->length;    \
        const uint8_t *x = (const uint8_t *)segment->row + p * step;                           \
        const uint8_t *w = (const uint8_t *)segment->weights;                                  \
        for (unsigned k = segment->length / LANES; k; k--, x += 4 * LANES, w += 4 * LANES) {   \
            const uint8_t *y = x + 3 * step;                                                   \
            vec v0 = load(w), v1 = load(w + next), v2 = load(w + 2 * next), value;             \
            FOR_PIXELS(DOT)                                                                    \
            (void)y;                                                                           \
        }                                                                                      \
        if (segment->length % LANES) {                                                         \
            FOR_PIXELS(REST)                                                                   \
        }                                                                                      \
    }                                                                                          \
    FOR_PIXELS(ADD)

static void TILE(const lull_conv *conv, const int3_run *wide, const int3_run *narrow)
{
    const int32_t *b = (const int32_t *)conv->bias;
    four bias = _mm_setr_epi32(b[0], b[1], b[2], 0), start = _mm_setzero_si128();
    four half = _mm_set1_epi32(1 << conv->wide_shift >> 1);
    four count = _mm_cvtsi32_si128((int)conv->wide_shift);
    FOR_TILES(p, conv, PIXELS)
    {
        int3_run run = *wide;
        FOR_PIXELS(DECLARE)
        RUN(INT3_WIDE)
        FOR_PIXELS(SHIFT)
        if (narrow->segment < narrow->end) {
            FOR_PIXELS(CLEAR)
            run = *narrow;
            RUN(INT3_NARROW)
        }
        FOR_PIXELS(STORE)
    }
}

#undef DECLARE
#undef CLEAR
#undef ADD
#undef SHIFT
#undef REST
#undef STORE
#undef RUN
#undef FOR_PIXELS
#undef TILE
#undef PIXELS
