/* Tiles of products at a point of patches: VECTORS vectors of outputs x PIXELS patches. Included
 * once for every shape, with TILE (the function's name), VECTORS (1 to 4) and PIXELS defined; they
 * are undefined at the end. The including file defines, for its instruction set:
 *
 *   vec, LANES                   a vector of LANES int32
 *   zero(), load(p), splat(p)    splat: the dword at p in every lane
 *   DOT(sum, x, w)               sum += 2 products of s16 x and s16 w in every lane
 *   store(p, v, n)               the first n lanes if n < LANES
 */
#include "pixels.h"
#include "vectors.h"

#define DECLARE(i, base, offset) \
    vec a##i = zero() B(, b##i = zero()) C(, c##i = zero()) D(, d##i = zero());
#define ADD(i, base, offset)          \
    value = splat((base) + (offset)); \
    DOT(a##i, value, v0);             \
    B(DOT(b##i, value, v1);)          \
    C(DOT(c##i, value, v2);)          \
    D(DOT(d##i, value, v3);)
#define STORE(i, base, offset)                     \
    store(out, a##i, n);                           \
    B(store(out + LANES, b##i, n - LANES);)        \
    C(store(out + 2 * LANES, c##i, n - 2 * LANES);) \
    D(store(out + 3 * LANES, d##i, n - 3 * LANES);) \
    out += out_step;

static void TILE(const tile_row *row)
{
    const lull_conv *conv = row->conv;
    const struct tile_part *part = row->part;
    size_t block = part->block, step = part->step, out_step = conv->out_step;
    unsigned n = row->n;
    FOR_TILES(p, conv, PIXELS)
    {
        const uint8_t *w = part->w, *x = part->x + p * step;
        int32_t *out = (int32_t *)conv->out + p * out_step + row->first;
        const uint8_t *next = x + PIXELS * step; /* the next tile's, as many bytes */
        FOR_PIXELS(DECLARE)
        for (unsigned k = part->length; k; k--, x += 4, w += 4 * LANES, next += 4 * PIXELS) {
            const uint8_t *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;
            vec v0 = load(w) B(, v1 = load(w + block)) C(, v2 = load(w + 2 * block))
                D(, v3 = load(w + 3 * block)), value;
            _mm_prefetch((const char *)next, _MM_HINT_T0);
            FOR_PIXELS(ADD)
            (void)y, (void)z, (void)t, (void)block;
        }
        FOR_PIXELS(STORE)
    }
}

#undef DECLARE
#undef ADD
#undef STORE
#include "vectors_end.h"
