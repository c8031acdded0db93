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

#define POOL_U8 lull_pool_u8_avx2
#include "pool_u8.h"
