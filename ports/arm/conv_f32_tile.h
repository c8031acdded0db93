/* One tile of an fp32 convolution. Included once for every shape, with TILE (the function's name),
 * VECTORS (1, 2 or 4) and PIXELS defined; they are undefined at the end. Every shape adds the same
 * products in the same order. The including file defines, for its instruction set:
 *
 *   GROUP, group                GROUP floats of a row in a register
 *   load_group(p), splat(p)     of GROUP floats, or the first one in all places
 *   MADD(sum, w, x, j)          sum + w * float j of x
 *   EACH(X)                     X(j) for j from 0 to GROUP - 1
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

#define DECLARE(i) \
    float32x4_t a##i = bias0 B(, b##i = bias1) CD(, c##i = bias2) CD(, d##i = bias3);
#define LOAD(i) group x##i = load_group(x + (i) * step);
#define SPLAT(i) group x##i = splat(x + (i) * step);
#define ADD(sum, w, x, j) sum = MADD(sum, w, x, j); KEEP(sum);
#define ADD_ALL(i, j)                                \
    ADD(a##i, v0, x##i, j) B(ADD(b##i, v1, x##i, j)) \
    CD(ADD(c##i, v2, x##i, j)) CD(ADD(d##i, v3, x##i, j))
#define ADD_0(i) ADD_ALL(i, 0)
#define ADD_1(i) ADD_ALL(i, 1)
#define ADD_2(i) ADD_ALL(i, 2)
#define ADD_3(i) ADD_ALL(i, 3)
#define STEP(j)                                                                                  \
    {                                                                                            \
        IN_ORDER                                                                                 \
        float32x4_t v0 = vld1q_f32(w + (j) * LANES) B(, v1 = vld1q_f32(w + block + (j) * LANES)) \
            CD(, v2 = vld1q_f32(w + 2 * block + (j) * LANES))                                    \
            CD(, v3 = vld1q_f32(w + 3 * block + (j) * LANES));                                   \
        FOR_PIXELS(ADD_##j)                                                                      \
    }
#define STORE(i)                                                                       \
    store(out + (i) * conv->out_step, a##i, n, least);                                 \
    B(store(out + (i) * conv->out_step + LANES, b##i, n - LANES, least);)              \
    CD(store(out + (i) * conv->out_step + 2 * LANES, c##i, n - 2 * LANES, least);)     \
    CD(store(out + (i) * conv->out_step + 3 * LANES, d##i, n - 3 * LANES, least);)

/* n outputs from `first` on, PIXELS pixels from p on. */
static void TILE(const lull_conv *conv, const void *biases, unsigned first, unsigned p, unsigned n)
{
    const float *bias = (const float *)biases;
    float *out = (float *)conv->out + (size_t)p * conv->out_step + first;
    float32x4_t bias0 = vld1q_f32(bias) B(, bias1 = vld1q_f32(bias + LANES))
        CD(, bias2 = vld1q_f32(bias + 2 * LANES)) CD(, bias3 = vld1q_f32(bias + 3 * LANES));
    FOR_PIXELS(DECLARE)
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t block = LANES * (size_t)segment->length, step = segment->step;
        const float *w = (const float *)segment->weights + first / LANES * block;
        const float *x = (const float *)segment->row + p * step;
        unsigned k = segment->length;
        for (; k >= GROUP; k -= GROUP, x += GROUP, w += GROUP * LANES) {
            FOR_PIXELS(LOAD)
            EACH(STEP)
        }
        for (; k; k--, x++, w += LANES) {
            FOR_PIXELS(SPLAT)
            STEP(0)
        }
    }
    float32x4_t least = vld1q_dup_f32(&conv->least);
    FOR_PIXELS(STORE)
}

#undef B
#undef CD
#undef FOR_PIXELS
#undef DECLARE
#undef LOAD
#undef SPLAT
#undef ADD
#undef ADD_ALL
#undef ADD_0
#undef ADD_1
#undef ADD_2
#undef ADD_3
#undef STEP
#undef STORE
#undef TILE
#undef VECTORS
#undef PIXELS
