/* Integer convolution with vectors of 8 outputs, for AVX2 and its extensions. The including
 * file defines DOT_NARROW and DOT_WIDE (see conv_int_tile.h), TILE_2 and TILE_1 (pixels of the
 * tiles of two vectors and of one) and CONV (the function's name). */
#include "intrinsics.h"
#include "kernels.h"
#include "tiles.h"

#define LANES 8u
typedef __m256i vec;

/* Bytes of the largest tile: 12 pixels of one vector or 6 of two, 2 bytes each. */
#define LULL_CONV_SPARE 384

LULL_INLINE vec zero(void) { return _mm256_setzero_si256(); }
LULL_INLINE vec load(const void *p) { return _mm256_loadu_si256((const __m256i *)p); }
LULL_INLINE vec splat_int(int v) { return _mm256_set1_epi32(v); }
LULL_INLINE vec splat(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm256_set1_epi32(v);
}
LULL_INLINE vec add(vec a, vec b) { return _mm256_add_epi32(a, b); }
LULL_INLINE vec shift(vec a, unsigned n) { return _mm256_sra_epi32(a, _mm_cvtsi32_si128((int)n)); }

/* Where and how the pixels of a tile are stored. Outputs that do not fill the vectors go to
 * `spare` first. */
typedef struct finish {
    vec even0, odd0, even1, odd1; /* twice the multipliers */
    uint8_t *to;
    size_t step; /* bytes */
    int32_t max;
    const lull_conv *conv;
    size_t at; /* bytes from conv->out */
    unsigned bytes; /* of a pixel, if they are in spare; else 0 */
    uint8_t spare[LULL_CONV_SPARE];
} finish;

LULL_INLINE void finish_init(finish *f, const lull_conv *conv, unsigned first, unsigned p,
                             unsigned n)
{
    const int32_t *m = conv->multiplier + first;
    unsigned size = conv->out_max <= 255 ? 1 : 2;
    f->even0 = _mm256_slli_epi32(load(m), 1);
    f->odd0 = _mm256_srli_epi64(f->even0, 32);
    f->even1 = _mm256_slli_epi32(load(n > LANES ? m + LANES : m), 1);
    f->odd1 = _mm256_srli_epi64(f->even1, 32);
    f->max = conv->out_max;
    f->conv = conv;
    f->step = size * conv->out_step;
    f->at = p * f->step + first * size;
    f->to = (uint8_t *)conv->out + f->at;
    f->bytes = n % LANES ? n * size : 0;
    if (f->bytes) {
        f->to = f->spare;
        f->step = 2 * LANES * size;
    }
}

LULL_INLINE void finish_end(const finish *f, unsigned pixels)
{
    const uint8_t *from = f->spare;
    size_t step = f->conv->out_step * (f->conv->out_max <= 255 ? 1 : 2);
    uint8_t *to = (uint8_t *)f->conv->out + f->at;
    if (f->bytes)
        for (unsigned i = 0; i < pixels; i++, from += f->step, to += step)
            memcpy(to, from, f->bytes);
}

/* (a * M + 2^30) >> 31 as the high half of a * 2M + 2^31, which always fits. */
LULL_INLINE vec requantise(vec a, vec even, vec odd)
{
    const vec half = _mm256_set1_epi64x((long long)1 << 31);
    vec q0 = _mm256_add_epi64(_mm256_mul_epi32(a, even), half);
    vec q1 = _mm256_add_epi64(_mm256_mul_epi32(_mm256_srli_epi64(a, 32), odd), half);
    return _mm256_blend_epi32(_mm256_srli_epi64(q0, 32), q1, 0xaa);
}

/* Two vectors of requantised sums. */
LULL_INLINE void finish_2(finish *f, unsigned i, vec a, vec b)
{
    uint8_t *to = f->to + i * f->step;
    a = requantise(a, f->even0, f->odd0);
    b = requantise(b, f->even1, f->odd1);
    if (f->max <= 255) {
        vec pairs = _mm256_packs_epi32(a, b); /* a0-3 b0-3, a4-7 b4-7 */
        __m128i q = _mm_packus_epi16(_mm256_castsi256_si128(pairs),
                                     _mm256_extracti128_si256(pairs, 1));
        q = _mm_min_epu8(_mm_shuffle_epi32(q, 0xd8), _mm_set1_epi8((char)f->max));
        _mm_storeu_si128((__m128i *)(void *)to, q);
    } else {
        vec q = _mm256_permute4x64_epi64(_mm256_packus_epi32(a, b), 0xd8);
        q = _mm256_min_epu16(q, _mm256_set1_epi16((short)f->max));
        _mm256_storeu_si256((__m256i *)(void *)to, q);
    }
}

LULL_INLINE void finish_1(finish *f, unsigned i, vec a)
{
    uint8_t *to = f->to + i * f->step;
    __m128i q;
    a = requantise(a, f->even0, f->odd0);
    if (f->max <= 255) {
        q = _mm_packs_epi32(_mm256_castsi256_si128(a), _mm256_extracti128_si256(a, 1));
        q = _mm_min_epu8(_mm_packus_epi16(q, q), _mm_set1_epi8((char)f->max));
        _mm_storel_epi64((__m128i *)(void *)to, q);
    } else {
        q = _mm_packus_epi32(_mm256_castsi256_si128(a), _mm256_extracti128_si256(a, 1));
        q = _mm_min_epu16(q, _mm_set1_epi16((short)f->max));
        _mm_storeu_si128((__m128i *)(void *)to, q);
    }
}

#define TILE tile_2
#define VECTORS 2
#define PIXELS TILE_2
#include "conv_int_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS TILE_1
#include "conv_int_tile.h"

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_int_tile.h"

static const tile_shape shapes[] = {{tile_2, 2, TILE_2}, {tile_1, 1, TILE_1}, {pixel_1, 1, 1}};

void CONV(const lull_conv *conv) { run_tiles(conv, shapes, LANES); }
