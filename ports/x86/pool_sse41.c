/* 2x2 maximum: the two pixels of a pair are neighbours, so a vector of channels is the maximum
 * of four loads. What is left of them is done in plain C. */
#include "port_sse41.h"

void lull_pool_f32_sse41(float *out, const float *above, const float *below, unsigned channels,
                         unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 4 <= channels; c += 4) {
            __m128 a = _mm_max_ps(_mm_loadu_ps(above + c), _mm_loadu_ps(above + channels + c));
            __m128 b = _mm_max_ps(_mm_loadu_ps(below + c), _mm_loadu_ps(below + channels + c));
            _mm_storeu_ps(out + c, _mm_max_ps(a, b));
        }
        for (; c < channels; c++) {
            float a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            float b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}

#define POOL_U8 lull_pool_u8_sse41
#include "pool_u8.h"
