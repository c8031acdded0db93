/* Integer convolution to three outputs: vectors run over the elements of a run, so that no lane is
 * idle, and are summed at the end. Included after conv_int_256.h, with CONV3 (the function's
 * name). */

#include "conv_int3.h"

/* What a function for tiles is given besides: a run of segments of one width. */
typedef struct int3_run {
    const lull_segment *segment, *end;
    unsigned size; /* bytes of an element */
} int3_run;

LULL_INLINE four int3_add(vec a, vec b, vec c)
{
    const vec none = _mm256_setzero_si256();
    vec x = add(_mm256_unpacklo_epi32(a, b), _mm256_unpackhi_epi32(a, b));
    vec z = add(_mm256_unpacklo_epi32(c, none), _mm256_unpackhi_epi32(c, none));
    x = add(_mm256_unpacklo_epi64(x, z), _mm256_unpackhi_epi64(x, z));
    return _mm_add_epi32(_mm256_castsi256_si128(x), _mm256_extracti128_si256(x, 1));
}

/* Requantises a pixel's sums and stores them. */
LULL_INLINE void int3_store(const lull_conv *conv, unsigned p, four a)
{
    const four half = _mm_set1_epi64x((long long)1 << 31);
    const int32_t *m = conv->multiplier;
    four even = _mm_set_epi64x(2 * (long long)m[2], 2 * (long long)m[0]);
    four odd = _mm_set_epi64x(0, 2 * (long long)m[1]), q;
    size_t size = conv->out_max <= 255 ? 1 : 2;
    uint8_t *to = (uint8_t *)conv->out + p * conv->out_step * size;
    uint32_t two;
    q = _mm_srli_epi64(_mm_add_epi64(_mm_mul_epi32(a, even), half), 32);
    a = _mm_add_epi64(_mm_mul_epi32(_mm_srli_epi64(a, 32), odd), half);
    q = _mm_blend_epi16(q, a, 0xcc);
    q = _mm_max_epi32(_mm_min_epi32(q, _mm_set1_epi32(conv->out_max)), _mm_setzero_si128());
    q = size == 1 ? _mm_packus_epi16(_mm_packus_epi32(q, q), q) : _mm_packus_epi32(q, q);
    two = (uint32_t)_mm_cvtsi128_si32(q);
    memcpy(to, &two, 2 * size);
    two = size == 1 ? two >> 16 : (uint32_t)_mm_extract_epi16(q, 2);
    memcpy(to + 2 * size, &two, size);
}

#define TILE int3_tile
#define PIXELS 3
#include "conv_int3_256_tile.h"

#define TILE int3_pixel
#define PIXELS 1
#include "conv_int3_256_tile.h"

void CONV3(const lull_conv *conv)
{
    int3_run wide, narrow;
    wide.segment = conv->segment;
    wide.end = narrow.segment = conv->segment + conv->wide;
    narrow.end = conv->segment + conv->segments;
    wide.size = 2;
    narrow.size = 1;
    if (conv->pixels < 3) {
        int3_pixel(conv, &wide, &narrow);
        return;
    }
    int3_tile(conv, &wide, &narrow);
}
