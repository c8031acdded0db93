/* 5x5 means of family K's filter, LANES pixels at a time, in the order of the definition
 * (kernels.h). After ../filter_rows.h, whose operations it uses, and
 *
 *   pixels_from(q, step, j, n)      16 bytes at q + i * step of pixels i = j, j + 4, ..., a quarter
 *                                   of the lanes, each not beyond pixel n - 1
 *   low32, high32, low64, high64    (a, b): of each 16 bytes that half, dwords or qwords in turn
 *   TIE(a, b, c, d, e)              none is used before all are there: else compilers compute many
 *                                   weights at once and spill them
 */

/* 25 codes at q + i * step for lane i < n: see TAP. */
LULL_INLINE void tap_codes(ivec *taps, const uint8_t *q, size_t step, unsigned n)
{
    ivec a = pixels_from(q, step, 0, n), b = pixels_from(q, step, 1, n);
    ivec c = pixels_from(q, step, 2, n), d = pixels_from(q, step, 3, n);
    ivec ab = low32(a, b), cd = low32(c, d);
    taps[0] = low64(ab, cd);
    taps[1] = high64(ab, cd);
    ab = high32(a, b), cd = high32(c, d);
    taps[2] = low64(ab, cd);
    taps[3] = high64(ab, cd);
    q += 9;
    a = pixels_from(q, step, 0, n), b = pixels_from(q, step, 1, n);
    c = pixels_from(q, step, 2, n), d = pixels_from(q, step, 3, n);
    taps[4] = high64(low32(a, b), low32(c, d));
    ab = high32(a, b), cd = high32(c, d);
    taps[5] = low64(ab, cd);
    taps[6] = high64(ab, cd);
}

#define ADD_TAP(x, codes)                                                                          \
    {                                                                                              \
        vec w = weights(&t, codes);                                                                \
        const float *v = row + (x);                                                                \
        s0 = add(s0, mul(w, load_n(v, n)));                                                        \
        s1 = add(s1, mul(w, load_n(v + plane, n)));                                                \
        s2 = add(s2, mul(w, load_n(v + 2 * plane, n)));                                            \
        s3 = add(s3, mul(w, load_n(v + 3 * plane, n)));                                            \
    }

LULL_INLINE void store_means(const lull_window *window, size_t p, vec s0, vec s1, vec s2, vec s3,
                             unsigned n)
{
    vec more = set(window->more), none = set(window->none), share = quotient(set(1.0f), s0);
    float *out = window->out + p;
    store_n(out, choose(s0, add(mul(s1, share), more), none), n);
    store_n(out + window->out_plane, choose(s0, add(mul(s2, share), more), none), n);
    store_n(out + 2 * window->out_plane, choose(s0, add(mul(s3, share), more), none), n);
}

/* Taps 0..15 are the bytes of taps[0..3], taps 13..24 those of taps[4..6]. */
#define TAP(x, vector, byte)                                                                       \
    TIE(taps[vector], s0, s1, s2, s3);                                                             \
    ADD_TAP(x, shift_right(taps[vector], 8 * (byte)))

LULL_INLINE void filter_block(const lull_window *window, const tables *table, size_t p, unsigned n)
{
    tables t = *table;
    vec s0 = set(0.0f), s1 = s0, s2 = s0, s3 = s0;
    ivec taps[7];
    size_t plane = window->plane;
    const float *row = window->rows[0] + p - 2;
    tap_codes(taps, window->codes + p * window->code_step, window->code_step, n);
    TAP(0, 0, 0) TAP(1, 0, 1) TAP(2, 0, 2) TAP(3, 0, 3) TAP(4, 1, 0) row = window->rows[1] + p - 2;
    TAP(0, 1, 1) TAP(1, 1, 2) TAP(2, 1, 3) TAP(3, 2, 0) TAP(4, 2, 1) row = window->rows[2] + p - 2;
    TAP(0, 2, 2) TAP(1, 2, 3) TAP(2, 3, 0) TAP(3, 3, 1) TAP(4, 3, 2) row = window->rows[3] + p - 2;
    TAP(0, 3, 3) TAP(1, 4, 3) TAP(2, 5, 0) TAP(3, 5, 1) TAP(4, 5, 2) row = window->rows[4] + p - 2;
    TAP(0, 5, 3)
    TAP(1, 6, 0) TAP(2, 6, 1) TAP(3, 6, 2) TAP(4, 6, 3)
    store_means(window, p, s0, s1, s2, s3, n);
}

#if defined(TAKES_PLANES)
/* The same of codes in planes. */
LULL_INLINE void filter_planes(const lull_window *window, const tables *table, size_t p, unsigned n)
{
    tables t = *table;
    vec s0 = set(0.0f), s1 = s0, s2 = s0, s3 = s0;
    size_t plane = window->plane, code_plane = window->code_plane;
    const uint8_t *q = window->codes + p;
    for (unsigned y = 0; y < 5; y++) {
        const float *row = window->rows[y] + p - 2;
        for (unsigned x = 0; x < 5; x++, q += code_plane)
            ADD_TAP(x, codes_from(q, n))
    }
    store_means(window, p, s0, s1, s2, s3, n);
}
#endif

void NAME(filter5)(const lull_window *window)
{
    tables t;
    tables_init(&t, window->table);
#if defined(TAKES_PLANES)
    if (window->code_step == 1) {
#define BLOCK(n) filter_planes(window, &t, p, n)
        FOR_BLOCKS(window->pixels)
#undef BLOCK
        return;
    }
#endif
#define BLOCK(n) filter_block(window, &t, p, n)
    FOR_BLOCKS(window->pixels)
#undef BLOCK
}
