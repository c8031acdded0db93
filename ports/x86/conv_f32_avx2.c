/* fp32 convolution: vectors over 8 output channels; 2 vectors x 6 pixels or 1 x 12 accumulators.
 * Accumulators are named variables: arrays of them end up in memory with some compilers. */
#include "port_avx2.h"

#define TILE_2 6u  /* pixels of a tile of two vectors */
#define TILE_1 12u /* of one vector */

#define SIX(X) X(0) X(1) X(2) X(3) X(4) X(5)
#define TWELVE(X) SIX(X) X(6) X(7) X(8) X(9) X(10) X(11)

/* Stores n <= 8 outputs. */
LULL_INLINE void store(float *out, __m256 sum, unsigned n, __m256i mask)
{
    sum = _mm256_max_ps(sum, _mm256_setzero_ps());
    if (n == 8)
        _mm256_storeu_ps(out, sum);
    else
        _mm256_maskstore_ps(out, mask, sum);
}

LULL_INLINE __m256i first_lanes(unsigned n)
{
    return _mm256_cmpgt_epi32(_mm256_set1_epi32((int)n),
                              _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
}

/* Two vectors of outputs from `first` on, TILE_2 pixels from p on. */
static void tile_2x6(const lull_conv *conv, unsigned first, unsigned p, unsigned n, __m256i mask)
{
    float *out = (float *)conv->out + (size_t)p * conv->out_step + first;
    __m256 bias0 = _mm256_loadu_ps((const float *)conv->bias + first);
    __m256 bias1 = _mm256_loadu_ps((const float *)conv->bias + first + 8);
#define DECLARE(i) __m256 a##i = bias0, b##i = bias1;
    SIX(DECLARE)
#undef DECLARE
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        const float *w0 = (const float *)segment->weights + (size_t)first * segment->length;
        const float *w1 = w0 + 8 * (size_t)segment->length;
        const float *x = (const float *)segment->row + (size_t)p * segment->step;
        size_t step = segment->step;
        for (unsigned k = segment->length; k; k--, x++, w0 += 8, w1 += 8) {
            __m256 v0 = _mm256_loadu_ps(w0), v1 = _mm256_loadu_ps(w1), value;
            const float *y = x + 3 * step;
#define ADD(i, base, offset)                          \
    value = _mm256_broadcast_ss((base) + (offset));   \
    a##i = _mm256_fmadd_ps(value, v0, a##i);          \
    b##i = _mm256_fmadd_ps(value, v1, b##i);
            ADD(0, x, 0) ADD(1, x, step) ADD(2, x, 2 * step)
            ADD(3, y, 0) ADD(4, y, step) ADD(5, y, 2 * step)
#undef ADD
        }
    }
#define STORE(i)                                               \
    store(out + (i) * conv->out_step, a##i, 8, mask);          \
    store(out + (i) * conv->out_step + 8, b##i, n - 8, mask);
    SIX(STORE)
#undef STORE
}

/* One vector of outputs, TILE_1 pixels. */
static void tile_1x12(const lull_conv *conv, unsigned first, unsigned p, unsigned n,
                      __m256i mask)
{
    float *out = (float *)conv->out + (size_t)p * conv->out_step + first;
    __m256 bias = _mm256_loadu_ps((const float *)conv->bias + first);
#define DECLARE(i) __m256 a##i = bias;
    TWELVE(DECLARE)
#undef DECLARE
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        const float *w = (const float *)segment->weights + (size_t)first * segment->length;
        const float *x = (const float *)segment->row + (size_t)p * segment->step;
        size_t step = segment->step;
        for (unsigned k = segment->length; k; k--, x++, w += 8) {
            __m256 v = _mm256_loadu_ps(w);
            const float *y = x + 3 * step, *z = x + 6 * step, *t = x + 9 * step;
#define ADD(i, base, offset) \
    a##i = _mm256_fmadd_ps(_mm256_broadcast_ss((base) + (offset)), v, a##i);
            ADD(0, x, 0) ADD(1, x, step) ADD(2, x, 2 * step)
            ADD(3, y, 0) ADD(4, y, step) ADD(5, y, 2 * step)
            ADD(6, z, 0) ADD(7, z, step) ADD(8, z, 2 * step)
            ADD(9, t, 0) ADD(10, t, step) ADD(11, t, 2 * step)
#undef ADD
        }
    }
#define STORE(i) store(out + (i) * conv->out_step, a##i, n, mask);
    TWELVE(STORE)
#undef STORE
}

/* One vector, one pixel: the same sums in the same order. */
static void tile_1x1(const lull_conv *conv, unsigned first, unsigned p, unsigned n, __m256i mask)
{
    __m256 a = _mm256_loadu_ps((const float *)conv->bias + first);
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        const float *w = (const float *)segment->weights + (size_t)first * segment->length;
        const float *x = (const float *)segment->row + (size_t)p * segment->step;
        for (unsigned k = 0; k < segment->length; k++)
            a = _mm256_fmadd_ps(_mm256_broadcast_ss(x + k), _mm256_loadu_ps(w + 8 * (size_t)k), a);
    }
    store((float *)conv->out + (size_t)p * conv->out_step + first, a, n, mask);
}

/* Pixels in tiles; the last tile is moved back to end at the last pixel. */
#define FOR_TILES(tile, size)                                       \
    for (unsigned p = 0; p < conv->pixels; p += (size)) {           \
        if (p + (size) > conv->pixels)                              \
            p = conv->pixels - (size);                              \
        tile(conv, first, p, n, mask);                              \
    }

void lull_conv_f32_avx2(const lull_conv *conv)
{
    unsigned first = 0;
    while (first < conv->outputs) {
        unsigned n = conv->outputs - first;
        if (n > 8 && conv->pixels >= TILE_2) {
            __m256i mask = first_lanes(n - 8);
            n = lull_min_u(n, 16);
            FOR_TILES(tile_2x6, TILE_2)
            first += 16;
        } else {
            __m256i mask = first_lanes(n);
            n = lull_min_u(n, 8);
            if (conv->pixels >= TILE_1) {
                FOR_TILES(tile_1x12, TILE_1)
            } else {
                FOR_TILES(tile_1x1, 1)
            }
            first += 8;
        }
    }
}
