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
 *   IS_HALF                              optional: no more than half of the last vector's outputs
 *                                        exist, no segment is wide and outputs are bytes; and
 *   DOT_HALF(sum, x, w)                  DOT_NARROW of the first half of the lanes, the others may
 *                                        become anything
 *   IS_SMALL                             1: the tile is for small sums (lull_conv)
 *   IS_WORDS                             1: for sums of runs that fit words, and
 *   DOT_WORDS(sum, x, w)                 sum += 2 products of u8 x and s8 w in every 16 bits
 *   widened(sum)                         the sums of the two words of every lane
 *   FINISH_FOUR, finish_four(&f, how, i, ...)
 *                                        optional: four pixels of one vector
 *   finish_end(&f, row, p, PIXELS)       after the tile
 */
#include "pixels.h"
#include "vectors.h"

#if defined(IS_HALF)
#define ALL_BYTES 1
#else
#define ALL_BYTES 0
#endif
#define DECLARE(i, base, offset) vec a##i B(, b##i) C(, c##i) D(, d##i);
#define START(i, base, offset)         \
    a##i = load(start);                \
    B(b##i = load(start + LANES);)     \
    C(c##i = load(start + 2 * LANES);) \
    D(d##i = load(start + 3 * LANES);) \
    start += start_step;
#define PRODUCTS(DOT, sums, base, offset, i) \
    value = splat((base) + (offset));        \
    DOT(1, sums##a##i, value, v0);           \
    B(DOT(2, sums##b##i, value, v1);)        \
    C(DOT(3, sums##c##i, value, v2);)        \
    D(DOT(4, sums##d##i, value, v3);)
#define WHOLE_WIDE(n, sum, x, w) DOT_WIDE(sum, x, w)
#define WHOLE_WORDS(n, sum, x, w) DOT_WORDS(sum, x, w)
#define NARROW(i, base, offset) PRODUCTS(DOT_VECTOR, , base, offset, i)
#define WIDE(i, base, offset) PRODUCTS(WHOLE_WIDE, , base, offset, i)
#define RUN(i, base, offset)                            \
    vec run_a##i = zero() B(, run_b##i = zero()) C(, run_c##i = zero()) D(, run_d##i = zero());
#define WORDS(i, base, offset) PRODUCTS(WHOLE_WORDS, run_, base, offset, i)
#define WIDEN(i, base, offset)                 \
    a##i = add(a##i, widened(run_a##i));       \
    B(b##i = add(b##i, widened(run_b##i));)    \
    C(c##i = add(c##i, widened(run_c##i));)    \
    D(d##i = add(d##i, widened(run_d##i));)
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

static void TILE(const tile_row *row)
{
    static const int32_t zeros[4 * LANES] = {0};
    const lull_conv *conv = row->conv;
    unsigned wide = IS_WORDS || ALL_BYTES ? 0 : conv->wide;
    unsigned count = wide ? conv->wide_shift : 0; /* 0: the bias may come first */
    const struct tile_part *end = row->part + conv->segments, *narrow = row->part + wide;
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
#if IS_WORDS
            FOR_PIXELS(RUN)
            SEGMENT(WORDS)
            FOR_PIXELS(WIDEN)
#else
            SEGMENT(NARROW)
#endif
        }
        finish_tile(&f, row, p);
        if (ALL_BYTES || f.size == 1) {
            STORE_ALL(BYTES | IS_SMALL * SMALL, STORE_BYTES)
        } else {
            STORE_ALL(IS_SMALL * SMALL, STORE_WORDS)
        }
        finish_end(&f, row, p, PIXELS);
    }
}

#undef ALL_BYTES
#undef DECLARE
#undef START
#undef PRODUCTS
#undef WHOLE_WIDE
#undef WHOLE_WORDS
#undef NARROW
#undef RUN
#undef WORDS
#undef WIDEN
#undef WIDE
#undef SHIFT
#undef STORE
#undef STORE_BYTES
#undef STORE_WORDS
#undef STORE_ALL
#undef SEGMENT
#include "vectors_end.h"
