/* Rows of integer tiles of VECTORS vectors (1 or 2) of output channels x 24 / VECTORS pixels, for
 * small sums and narrow outputs, of segments whose pixels share columns (struct tile_part's
 * `share`): each column is read once, for all its taps. Included once for each, with TILE and
 * VECTORS defined, which are undefined at the end; otherwise as conv_int_tile.h. */
#include "pixels.h"
#if VECTORS > 1
#define PIXELS 12
#else
#define PIXELS 24
#endif
#include "vectors.h"

#define DECLARE(i, base, offset) vec a##i B(, b##i);
#define START(i, base, offset)    \
    a##i = load(start);           \
    B(b##i = load(start + LANES);) \
    start += start_step;
/* The taps of a column: the one that pixel i begins with, and the next ones of those before. */
#define FIRST(i)                    \
    DOT_VECTOR(1, a##i, value, v0); \
    B(DOT_VECTOR(2, b##i, value, v1);)
#define SECOND(i)                   \
    DOT_VECTOR(1, a##i, value, w0); \
    B(DOT_VECTOR(2, b##i, value, w1);)
#define THIRD(i)                    \
    DOT_VECTOR(1, a##i, value, u0); \
    B(DOT_VECTOR(2, b##i, value, u1);)
#define NONE(i)
#define COLUMN(base, offset, ...)     \
    value = splat((base) + (offset)); \
    __VA_ARGS__
/* Columns are at a base + 0, 1, 2, 4 or 8 steps, as an x86 operand has them: 26 of six bases, or 14
 * of four. y: x + 1 step, z: x + 6, t: x + 11, q: x + 16, r: x + 21. */
#define COLUMNS_12(S, T)                           \
    COLUMN(x, 0, FIRST(0))                         \
    COLUMN(x, step, FIRST(1) S(0))                 \
    COLUMN(x, 2 * step, FIRST(2) S(1) T(0))        \
    COLUMN(y, 2 * step, FIRST(3) S(2) T(1))        \
    COLUMN(x, 4 * step, FIRST(4) S(3) T(2))        \
    COLUMN(y, 4 * step, FIRST(5) S(4) T(3))        \
    COLUMN(z, 0, FIRST(6) S(5) T(4))               \
    COLUMN(z, step, FIRST(7) S(6) T(5))            \
    COLUMN(z, 2 * step, FIRST(8) S(7) T(6))        \
    COLUMN(y, 8 * step, FIRST(9) S(8) T(7))        \
    COLUMN(z, 4 * step, FIRST(10) S(9) T(8))       \
    COLUMN(t, 0, FIRST(11) S(10) T(9))
#define AFTER_12(S, T) COLUMN(t, step, S(11) T(10))
#define LAST_12 COLUMN(t, 2 * step, THIRD(11))
#define COLUMNS_24(S, T)                           \
    COLUMNS_12(S, T)                               \
    COLUMN(t, step, FIRST(12) S(11) T(10))         \
    COLUMN(t, 2 * step, FIRST(13) S(12) T(11))     \
    COLUMN(z, 8 * step, FIRST(14) S(13) T(12))     \
    COLUMN(t, 4 * step, FIRST(15) S(14) T(13))     \
    COLUMN(q, 0, FIRST(16) S(15) T(14))            \
    COLUMN(q, step, FIRST(17) S(16) T(15))         \
    COLUMN(q, 2 * step, FIRST(18) S(17) T(16))     \
    COLUMN(t, 8 * step, FIRST(19) S(18) T(17))     \
    COLUMN(q, 4 * step, FIRST(20) S(19) T(18))     \
    COLUMN(r, 0, FIRST(21) S(20) T(19))            \
    COLUMN(r, step, FIRST(22) S(21) T(20))         \
    COLUMN(r, 2 * step, FIRST(23) S(22) T(21))
#define AFTER_24(S, T) COLUMN(q, 8 * step, S(23) T(22))
#define LAST_24 COLUMN(r, 4 * step, THIRD(23))
#define COLUMNS PIXELS_PASTE(COLUMNS_, PIXELS)
#define AFTER PIXELS_PASTE(AFTER_, PIXELS)
#define LAST PIXELS_PASTE(LAST_, PIXELS)
#define STORE(i, j) finish_2(&f, BYTES | SMALL, i, j, a##i B(, b##i), a##j B(, b##j));
#define STORE_FOUR(i, j, k, l) finish_four(&f, BYTES | SMALL, i, a##i, a##j, a##k, a##l);
#if VECTORS > 1
#define STORE_ALL FOR_PAIRS(STORE)
#else
#define STORE_ALL                                                           \
    STORE_FOUR(0, 1, 2, 3) STORE_FOUR(4, 5, 6, 7) STORE_FOUR(8, 9, 10, 11)  \
    STORE_FOUR(12, 13, 14, 15) STORE_FOUR(16, 17, 18, 19) STORE_FOUR(20, 21, 22, 23)
#endif

/* Adds the products of `dwords` dwords of each column from `at` on; weights of a tap's dwords
 * follow each other from `weights` on, those of the other taps further on. */
#define EACH_DWORD(at, weights, OTHERS, SUMS)                                                     \
    {                                                                                             \
        const uint8_t *x = (at), *y = x + step, *z = x + 6 * step, *t = x + 11 * step;            \
        const uint8_t *q = x + 16 * step, *r = x + 21 * step;                                     \
        const uint8_t *w = (weights)B(, *w2 = w + part->block);                                   \
        for (unsigned k = dwords; k; k--) {                                                       \
            vec v0 = load(w) B(, v1 = load(w2)), value;                                           \
            OTHERS                                                                                \
            SUMS                                                                                  \
            x += 4, y += 4, z += 4, t += 4, q += 4, r += 4, w += 4 * LANES B(, w2 += 4 * LANES); \
        }                                                                                         \
        (void)q, (void)r; /* which 12 columns do without */                                       \
    }
#define ONE_MORE(gap) vec w0 = load(w + (gap)) B(, w1 = load(w2 + (gap)));
#define TWO_MORE(gap) ONE_MORE(gap) vec u0 = load(w + 2 * (gap)) B(, u1 = load(w2 + 2 * (gap)));

static void TILE(const tile_row *row)
{
    const lull_conv *conv = row->conv;
    const struct tile_part *end = row->part + conv->segments;
    finish f;
    finish_init(&f, row, VECTORS, 1);
    FOR_TILES(p, conv, PIXELS)
    {
        size_t start_step = row->bias_step;
        const int32_t *start = row->bias + p * start_step;
        FOR_PIXELS(DECLARE)
        FOR_PIXELS(START)
        for (const struct tile_part *part = row->part; part < end; part++) {
            size_t step = part->step;
            unsigned dwords = part->column;
            size_t next = (size_t)dwords * 4 * LANES;
            const uint8_t *from = part->x + p * step;
            if (part->share == SHARE_3) {
                EACH_DWORD(from, part->w, TWO_MORE(next),
                           COLUMNS(SECOND, THIRD) AFTER(SECOND, THIRD) LAST)
                continue;
            }
            /* Two columns, or the first and the last of three; then the middle one. */
            EACH_DWORD(from, part->w, ONE_MORE(part->share == SHARE_ENDS ? 2 * next : next),
                       COLUMNS(SECOND, NONE) AFTER(SECOND, NONE))
            if (part->share == SHARE_ENDS)
                EACH_DWORD(from + (size_t)dwords * 4, part->w + next, , COLUMNS(NONE, NONE))
        }
        finish_tile(&f, row, p);
        STORE_ALL
    }
}

#undef DECLARE
#undef START
#undef FIRST
#undef SECOND
#undef THIRD
#undef NONE
#undef COLUMN
#undef COLUMNS_12
#undef AFTER_12
#undef LAST_12
#undef COLUMNS_24
#undef AFTER_24
#undef LAST_24
#undef COLUMNS
#undef AFTER
#undef LAST
#undef STORE
#undef STORE_FOUR
#undef STORE_ALL
#undef EACH_DWORD
#undef ONE_MORE
#undef TWO_MORE
#include "vectors_end.h"
