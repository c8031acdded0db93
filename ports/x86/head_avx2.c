/* Heads in planes (kernels.h), 8 pixels at a time: a vector has a dword of each pixel's run, and is
 * multiplied by a weight's dword in all lanes. */
#include "port_avx2.h"
#include "requantise_256.h"

#define LANES 8u
typedef __m256i vec;

LULL_INLINE vec splat(const void *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm256_set1_epi32(v);
}

/* 2 or 3 dwords at p. */
LULL_INLINE __m128i dwords_at(const uint8_t *p, unsigned n)
{
    __m128i first = _mm_loadl_epi64((const __m128i *)(const void *)p);
    return n == 2 ? first : _mm_insert_epi32(first, (int)lull_load_u32(p + 8), 2);
}

/* Runs of `length` dwords of n <= 8 pixels by dwords; pixels that are missing are the last one. */
LULL_INLINE void order_runs(vec *x, const uint8_t *row, size_t step, unsigned length, unsigned n)
{
#define RUN_OF(j) dwords_at(row + lull_min_u(j, n - 1) * step, length)
#define RUNS(j) _mm256_inserti128_si256(_mm256_castsi128_si256(RUN_OF(j)), RUN_OF((j) + 4), 1)
    vec a = RUNS(0), b = RUNS(1), c = RUNS(2), d = RUNS(3);
    vec first = _mm256_unpacklo_epi32(a, b), second = _mm256_unpacklo_epi32(c, d);
    x[0] = _mm256_unpacklo_epi64(first, second);
    x[1] = _mm256_unpackhi_epi64(first, second);
    x[2] = _mm256_unpacklo_epi64(_mm256_unpackhi_epi32(a, b), _mm256_unpackhi_epi32(c, d));
#undef RUNS
#undef RUN_OF
}

/* The sum of a run, whose weights for the output are at w, in words. */
LULL_INLINE vec run_sum(const vec *x, const uint8_t *w, unsigned length)
{
    vec sum = _mm256_add_epi16(_mm256_maddubs_epi16(x[0], splat(w)),
                               _mm256_maddubs_epi16(x[1], splat(w + 4 * LANES)));
    if (length == 3)
        sum = _mm256_add_epi16(sum, _mm256_maddubs_epi16(x[2], splat(w + 8 * LANES)));
    return _mm256_madd_epi16(sum, _mm256_set1_epi16(1));
}

LULL_INLINE vec code(vec sum, const int32_t *bias, const int32_t *scale)
{
    return requantise_small(_mm256_add_epi32(sum, splat(bias)), splat(scale));
}

/* 8 bytes of a plane, of which the first n exist. */
LULL_INLINE void store_plane(uint8_t *out, __m128i v, unsigned n)
{
    uint8_t part[16];
    if (n == LANES) {
        _mm_storel_epi64((__m128i *)(void *)out, v);
        return;
    }
    _mm_storeu_si128((__m128i *)(void *)part, v);
    memcpy(out, part, n);
}

/* Codes of four outputs and n pixels as bytes of planes; `outputs` of them exist. */
LULL_INLINE void store_planes(uint8_t *out, size_t plane, vec bytes, unsigned outputs, unsigned n)
{
    __m128i first = _mm256_castsi256_si128(bytes), second = _mm256_extracti128_si256(bytes, 1);
    store_plane(out, first, n);
    if (outputs > 1)
        store_plane(out + plane, _mm_unpackhi_epi64(first, first), n);
    if (outputs > 2)
        store_plane(out + 2 * plane, second, n);
    if (outputs > 3)
        store_plane(out + 3 * plane, _mm_unpackhi_epi64(second, second), n);
}

/* All pixels, by runs of `length` dwords. scale: small_scale of every output. */
LULL_INLINE void run_head(const lull_conv *conv, unsigned length, const int32_t *scale)
{
    const lull_segment segment = conv->segment[0];
    const unsigned outputs = conv->outputs, pixels = conv->pixels;
    const int32_t *bias = conv->bias;
    const size_t plane = conv->out_step;
    const vec max = _mm256_set1_epi8((char)conv->out_max);
    const vec in_order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
    for (unsigned p = 0; p < pixels; p += LANES) {
        const unsigned n = lull_min_u(pixels - p, LANES);
        uint8_t *out = (uint8_t *)conv->out + p;
        vec x[LULL_HEAD_RUN];
        order_runs(x, (const uint8_t *)segment.row + p * (size_t)segment.step, segment.step, length,
                   n);
        for (unsigned o = 0; o < outputs; o += 4, out += 4 * plane) {
            const uint8_t *w = (const uint8_t *)segment.weights +
                               (size_t)(o / LANES) * length * 4 * LANES + o % LANES * 4;
            vec a = code(run_sum(x, w, length), bias + o, scale + o);
            vec b = code(run_sum(x, w + 4, length), bias + o + 1, scale + o + 1);
            vec c = code(run_sum(x, w + 8, length), bias + o + 2, scale + o + 2);
            vec d = code(run_sum(x, w + 12, length), bias + o + 3, scale + o + 3);
            a = _mm256_packus_epi16(_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, d));
            a = _mm256_permutevar8x32_epi32(_mm256_min_epu8(a, max), in_order);
            store_planes(out, plane, a, outputs - o, n);
        }
    }
}

void lull_head_avx2(const lull_conv *conv)
{
    int32_t scale[(LULL_HEAD_CODES + LANES - 1) / LANES * LANES];
    const unsigned before = round_down();
    for (unsigned o = 0; o < conv->outputs; o += LANES) {
        vec m = _mm256_loadu_si256((const __m256i *)(const void *)(conv->multiplier + o));
        _mm256_storeu_si256((__m256i *)(void *)(scale + o), small_scale(m));
    }
    if (conv->segment[0].length == 2)
        run_head(conv, 2, scale);
    else
        run_head(conv, 3, scale);
    round_as(before);
}
