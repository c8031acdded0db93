/* Rows of integer tiles of VECTORS vectors of output channels x PIXELS pixels. Included once
 * for every shape, with TILE (the function's name), VECTORS (1 to 4) and PIXELS defined; they
 * are undefined at the end. The including file defines, for its instruction set:
 *
 *   vec, LANES                           a vector of LANES int32
 *   zero(), load(p), splat(p), add(a, b) splat: the dword at p in every lane
 *   splat_int(i), shift(a, n)            arithmetic shift to the right
 *   DOT_NARROW(sum, x, w)                sum += 4 products of u8 x and s8 w in every lane
 *   DOT_WIDE(sum, x, w)                  sum += 2 products of s16 x and s16 w in every lane
 *   finish, finish_init(&f, row, VECTORS, IS_SMALL)
 *                                        constants of the requantisation
 *   finish_tile(&f, row, p)              before the sums of the tile from pixel p on are stored
 *   finish_<VECTORS>(&f, how, i, j, ...)
 *                                        requantises and stores pixels i and j = i + 1 of the tile:
 *                                        the sums of i, then those of j; i = j: one pixel.
 *                                        how: BYTES and SMALL of tiles.h
 *   IS_SMALL                             1: the tile is for small sums (lull_conv)
 *   FINISH_FOUR, finish_four(&f, how, i, ...)
 *                                        optional: four pixels of one vector
 *   finish_end(&f, row, p, PIXELS)       after the tile
 */
#include "pixels.h"
#include "vectors.h"

#define DECLARE(i, base, offset) vec a##i B(, b##i) C(, c##i) D(, d##i);
#define START(i, base, offset)         \
    a##i = load(start);                \
    B(b##i = load(start + LANES);)     \
    C(c##i = load(start + 2 * LANES);) \
    D(d##i = load(start + 3 * LANES);) \
    start += start_step;
#define NARROW(i, base, offset)       \
    value = splat((base) + (offset)); \
    DOT_NARROW(a##i, value, v0);      \
    B(DOT_NARROW(b##i, value, v1);)   \
    C(DOT_NARROW(c##i, value, v2);)   \
    D(DOT_NARROW(d##i, value, v3);)
#define WIDE(i, base, offset)         \
    value = splat((base) + (offset)); \
    DOT_WIDE(a##i, value, v0);        \
    B(DOT_WIDE(b##i, value, v1);)     \
    C(DOT_WIDE(c##i, value, v2);)     \
    D(DOT_WIDE(d##i, value, v3);)
#define SHIFT(i, base, offset)                                             \
    a##i = add(shift(add(a##i, half), count), load(start));                \
    B(b##i = add(shift(add(b##i, half), count), load(start + LANES));)     \
    C(c##i = add(shift(add(c##i, half), count), load(start + 2 * LANES));) \
    D(d##i = add(shift(add(d##i, half), count), load(start + 3 * LANES));) \
    start += start_step;
#define STORE(how, i, j)                                                              \
    PIXELS_PASTE(finish_, VECTORS)(&f, how, i, j, a##i B(, b##i) C(, c##i) D(, d##i), \
                                   a##j B(, b##j) C(, c##j) D(, d##j));
#define STORE_BYTES(i, j) STORE(BYTES | IS_SMALL * SMALL, i, j)
#define STORE_WORDS(i, j) STORE(IS_SMALL * SMALL, i, j)
#if defined(FINISH_FOUR) && VECTORS == 1 && PIXELS == 12
#define STORE_ALL(how, LIST)                 \
    finish_four(&f, how, 0, a0, a1, a2, a3); \
    finish_four(&f, how, 4, a4, a5, a6, a7); \
    finish_four(&f, how, 8, a8, a9, a10, a11);
#else
#define STORE_ALL(how, LIST) FOR_PAIRS(LIST)
#endif

#define SEGMENT(ADD)                                                                 \
    {                                                                                \
        size_t block = part->block, step = part->step;                               \
        const uint8_t *w = part->w, *x = part->x + p * step;                         \
        for (unsigned k = part->length; k; k--, x += 4, w += 4 * LANES) {            \
            const uint8_t *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;   \
            vec v0 = load(w) B(, v1 = load(w + block)) C(, v2 = load(w + 2 * block)) \
                D(, v3 = load(w + 3 * block)), value;                                \
            FOR_PIXELS(ADD)                                                          \
            (void)y, (void)z, (void)t, (void)block;                                  \
        }                                                                            \
    }

#if IS_SMALL && VECTORS <= SLIDE_VECTORS && PIXELS == 12
#define SLIDES(segment) (segment)->taps
/* Pixels that follow each other share columns: each column is read once, for all its taps. The
 * weights of the taps are `third` bytes (or, with two taps, as many) apart. */
#define FIRST(i)                \
    DOT_NARROW(a##i, value, v0); \
    B(DOT_NARROW(b##i, value, v1);)
#define SECOND(i)               \
    DOT_NARROW(a##i, value, w0); \
    B(DOT_NARROW(b##i, value, w1);)
#define THIRD(i)                \
    DOT_NARROW(a##i, value, u0); \
    B(DOT_NARROW(b##i, value, u1);)
#define NO_TAP(i)
#define COLUMN(base, offset, ...) \
    value = splat((base) + (offset)); \
    __VA_ARGS__
#define COLUMNS(LAST)                                         \
    COLUMN(x, 0, FIRST(0))                                    \
    COLUMN(x, step, FIRST(1) SECOND(0))                       \
    COLUMN(x, 2 * step, FIRST(2) SECOND(1) LAST(0))           \
    COLUMN(y, 0, FIRST(3) SECOND(2) LAST(1))                  \
    COLUMN(y, step, FIRST(4) SECOND(3) LAST(2))               \
    COLUMN(y, 2 * step, FIRST(5) SECOND(4) LAST(3))           \
    COLUMN(z, 0, FIRST(6) SECOND(5) LAST(4))                  \
    COLUMN(z, step, FIRST(7) SECOND(6) LAST(5))               \
    COLUMN(z, 2 * step, FIRST(8) SECOND(7) LAST(6))           \
    COLUMN(t, 0, FIRST(9) SECOND(8) LAST(7))                  \
    COLUMN(t, step, FIRST(10) SECOND(9) LAST(8))              \
    COLUMN(t, 2 * step, FIRST(11) SECOND(10) LAST(9))         \
    COLUMN(q, 0, SECOND(11) LAST(10))
#define SLIDE_NEXT                                         \
    k--, x += 4, y += 4, z += 4, t += 4, q += 4, w += 4 * LANES, B(w2 += 4 * LANES, )(void)0
#define SLIDE_SEGMENT                                                              \
    {                                                                              \
        size_t step = part->step;                                                  \
        unsigned k = part->length / part->taps;                                    \
        size_t third = (size_t)k * 4 * LANES;                                      \
        const uint8_t *w = part->w B(, *w2 = w + part->block);                     \
        const uint8_t *x = part->x + p * step, *y = x + 3 * step, *z = y + 3 * step; \
        const uint8_t *t = z + 3 * step, *q = t + 3 * step;                        \
        if (part->taps == 3)                                                       \
            for (; k; SLIDE_NEXT) {                                                \
                vec v0 = load(w) B(, v1 = load(w2));                               \
                vec w0 = load(w + third) B(, w1 = load(w2 + third));               \
                vec u0 = load(w + 2 * third) B(, u1 = load(w2 + 2 * third)), value; \
                COLUMNS(THIRD)                                                     \
                COLUMN(q, step, THIRD(11))                                         \
            }                                                                      \
        else                                                                       \
            for (; k; SLIDE_NEXT) {                                                \
                vec v0 = load(w) B(, v1 = load(w2));                               \
                vec w0 = load(w + third) B(, w1 = load(w2 + third)), value;        \
                COLUMNS(NO_TAP)                                                    \
            }                                                                      \
    }
#else
#define SLIDES(segment) 0
#define SLIDE_SEGMENT \
    {                 \
    }
#endif

static void TILE(const tile_row *row)
{
    static const int32_t zeros[4 * LANES] = {0};
    const lull_conv *conv = row->conv;
    const struct tile_part *end = row->part + conv->segments, *narrow = row->part + conv->wide;
    unsigned count = conv->wide ? conv->wide_shift : 0; /* 0: the bias may come first */
    finish f;
    finish_init(&f, row, VECTORS, IS_SMALL);
    FOR_TILES(p, conv, PIXELS)
    {
        const struct tile_part *part = row->part;
        size_t start_step = count ? 0 : row->bias_step;
        const int32_t *start = count ? zeros : row->bias + p * start_step;
        FOR_PIXELS(DECLARE)
        FOR_PIXELS(START)
        for (; part < narrow; part++)
            SEGMENT(WIDE)
        if (count) {
            vec half = splat_int(1 << count >> 1);
            start_step = row->bias_step;
            start = row->bias + p * start_step;
            FOR_PIXELS(SHIFT)
        }
        for (; part < end; part++) {
            if (SLIDES(part))
                SLIDE_SEGMENT
            else
                SEGMENT(NARROW)
        }
        finish_tile(&f, row, p);
        if (f.size == 1) {
            STORE_ALL(BYTES | IS_SMALL * SMALL, STORE_BYTES)
        } else {
            STORE_ALL(IS_SMALL * SMALL, STORE_WORDS)
        }
        finish_end(&f, row, p, PIXELS);
    }
}

#undef DECLARE
#undef START
#undef NARROW
#undef WIDE
#undef SHIFT
#undef STORE
#undef STORE_BYTES
#undef STORE_WORDS
#undef STORE_ALL
#undef SEGMENT
#undef SLIDES
#undef SLIDE_SEGMENT
#undef SLIDE_NEXT
#undef FIRST
#undef SECOND
#undef THIRD
#undef NO_TAP
#undef COLUMN
#undef COLUMNS
#include "vectors_end.h"
