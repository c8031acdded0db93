/* One tile of an integer convolution. Included once for every shape, with TILE (the function's
 * name), VECTORS (1, 2 or 4) and PIXELS defined; they are undefined at the end. The including
 * file defines
 *
 *   NARROW                      the loop over the elements of one narrow segment; it sees the sums
 *                               (a<i> to d<i> for pixel i), the run's start x, step, the weights
 *                               w of the first vector, `block` bytes before those of the next
 *                               one, and the length k
 *   NARROW_BEFORE, NARROW_AFTER what it does to the sums before and after all of them
 */

#if VECTORS > 1
#define B(...) __VA_ARGS__
#else
#define B(...)
#endif
#if VECTORS > 2
#define CD(...) __VA_ARGS__
#else
#define CD(...)
#endif
#define FOR_PIXELS PASTE(PIXELS_, PIXELS)
#define FOR_PAIRS PASTE(PAIRS_, PIXELS)

#define DECLARE(i) \
    int32x4_t a##i = zero B(, b##i = zero) CD(, c##i = zero) CD(, d##i = zero);
#define WIDE(i)                                      \
    pair = load_dword(x + (i) * step);               \
    a##i = wide_add(a##i, v0, pair); KEEP(a##i);     \
    B(b##i = wide_add(b##i, v1, pair); KEEP(b##i);)  \
    CD(c##i = wide_add(c##i, v2, pair); KEEP(c##i);) \
    CD(d##i = wide_add(d##i, v3, pair); KEEP(d##i);)
#define SHIFT(i)                                        \
    a##i = vshlq_s32(vaddq_s32(a##i, half), right);     \
    B(b##i = vshlq_s32(vaddq_s32(b##i, half), right);)  \
    CD(c##i = vshlq_s32(vaddq_s32(c##i, half), right);) \
    CD(d##i = vshlq_s32(vaddq_s32(d##i, half), right);)
#define BIAS(i)                                      \
    a##i = vaddq_s32(a##i, vld1q_s32(bias));         \
    B(b##i = vaddq_s32(b##i, vld1q_s32(bias + 4));)  \
    CD(c##i = vaddq_s32(c##i, vld1q_s32(bias + 8));) \
    CD(d##i = vaddq_s32(d##i, vld1q_s32(bias + 12));)
#define STORE(i)                     \
    finish_store(&f, i, 0, a##i);    \
    B(finish_store(&f, i, 1, b##i);) \
    CD(finish_store(&f, i, 2, c##i); finish_store(&f, i, 3, d##i);)

/* n outputs from `first` on, PIXELS pixels from p on. */
static void TILE(const lull_conv *conv, const void *biases, unsigned first, unsigned p, unsigned n)
{
    const int32_t *bias = (const int32_t *)biases;
    const int32x4_t zero = vdupq_n_s32(0);
    unsigned s = 0;
    finish f;
    FOR_PIXELS(DECLARE)
    for (; s < conv->wide; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = 16 * (size_t)segment->length, step = 2 * (size_t)segment->step;
        const uint8_t *w = (const uint8_t *)segment->weights + first / LANES * block;
        const uint8_t *x = (const uint8_t *)segment->row + p * step;
        for (unsigned k = segment->length; k; k--, x += 4, w += 16) {
            int16x4x2_t v0 = load_wide(w) B(, v1 = load_wide(w + block))
                CD(, v2 = load_wide(w + 2 * block)) CD(, v3 = load_wide(w + 3 * block));
            uint32_t pair;
            FOR_PIXELS(WIDE)
        }
    }
    if (s) {
        int32x4_t half = vdupq_n_s32(1 << conv->wide_shift >> 1);
        int32x4_t right = vdupq_n_s32(-(int32_t)conv->wide_shift);
        FOR_PIXELS(SHIFT)
    }
    FOR_PIXELS(BIAS)
    if (s < conv->segments) {
        NARROW_BEFORE
        for (; s < conv->segments; s++) {
            const lull_segment *segment = &conv->segment[s];
            size_t block = 16 * (size_t)segment->length, step = segment->step;
            const uint8_t *x = (const uint8_t *)segment->row + p * step;
            const int8_t *w = (const int8_t *)segment->weights + first / LANES * block;
            unsigned k = segment->length;
            NARROW
        }
        NARROW_AFTER
    }
    finish_init(&f, conv, first, p, n);
    FOR_PIXELS(STORE)
}

#undef B
#undef CD
#undef FOR_PIXELS
#undef FOR_PAIRS
#undef DECLARE
#undef WIDE
#undef SHIFT
#undef BIAS
#undef STORE
#undef TILE
#undef VECTORS
#undef PIXELS
