/* 2x2 maximum: the two pixels of a pair are neighbours, so a vector of channels is the maximum
 * of four loads. What is left of them is done in plain C. */
#include "port_avx2.h"

LULL_INLINE __m256 load_f32(const float *p) { return _mm256_loadu_ps(p); }

void lull_pool_f32_avx2(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 8 <= channels; c += 8) {
            __m256 a = _mm256_max_ps(load_f32(above + c), load_f32(above + channels + c));
            __m256 b = _mm256_max_ps(load_f32(below + c), load_f32(below + channels + c));
            _mm256_storeu_ps(out + c, _mm256_max_ps(a, b));
        }
        for (; c < channels; c++) {
            float a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            float b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}

LULL_INLINE __m128i load_16(const uint8_t *p)
{
    return _mm_loadu_si128((const __m128i *)(const void *)p);
}

LULL_INLINE __m128i load_8(const uint8_t *p)
{
    return _mm_loadl_epi64((const __m128i *)(const void *)p);
}

LULL_INLINE __m128i max_4(__m128i a, __m128i b, __m128i c, __m128i d)
{
    return _mm_max_epu8(_mm_max_epu8(a, b), _mm_max_epu8(c, d));
}

void lull_pool_u8_avx2(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 16 <= channels; c += 16)
            _mm_storeu_si128((__m128i *)(void *)(out + c),
                             max_4(load_16(above + c), load_16(above + channels + c),
                                   load_16(below + c), load_16(below + channels + c)));
        for (; c + 8 <= channels; c += 8)
            _mm_storel_epi64((__m128i *)(void *)(out + c),
                             max_4(load_8(above + c), load_8(above + channels + c),
                                   load_8(below + c), load_8(below + channels + c)));
        for (; c < channels; c++) {
            uint8_t a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            uint8_t b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}
