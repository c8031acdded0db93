/* Integer convolution with vectors of 8 outputs, for AVX2 and its extensions. The including file defines
 * DOT_NARROW and DOT_WIDE (see conv_int_tile.h), TILE_2 and TILE_1 (pixels of the tiles of two vectors
 * and of one) and CONV (the function's name). */
#include "intrinsics.h"
#include "kernels.h"

#define LANES 8u
typedef __m256i vec;

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

typedef struct finish {
    vec even0, odd0, even1, odd1; /* twice the multipliers */
    void *out;
    int32_t max;
    unsigned n;
} finish;

LULL_INLINE void finish_init(finish *f, const lull_conv *conv, unsigned first, unsigned n)
{
    const int32_t *m = conv->multiplier + first;
    f->even0 = _mm256_slli_epi32(load(m), 1);
    f->odd0 = _mm256_srli_epi64(f->even0, 32);
    f->even1 = _mm256_slli_epi32(load(n > LANES ? m + LANES : m), 1);
    f->odd1 = _mm256_srli_epi64(f->even1, 32);
    f->out = conv->out;
    f->max = conv->out_max;
    f->n = n;
}

/* (a * M + 2^30) >> 31 as the high half of a * 2M + 2^31, which always fits. */
LULL_INLINE vec requantise(vec a, vec even, vec odd)
{
    const vec half = _mm256_set1_epi64x((long long)1 << 31);
    vec q0 = _mm256_add_epi64(_mm256_mul_epi32(a, even), half);
    vec q1 = _mm256_add_epi64(_mm256_mul_epi32(_mm256_srli_epi64(a, 32), odd), half);
    return _mm256_blend_epi32(_mm256_srli_epi64(q0, 32), q1, 0xaa);
}

/* Stores the first n <= 16 bytes. */
LULL_INLINE void store_bytes(void *out, __m128i v, unsigned n)
{
    uint8_t *to = (uint8_t *)out;
    uint32_t last;
    if (n >= 16) {
        _mm_storeu_si128((__m128i *)(void *)to, v);
        return;
    }
    if (n & 8) {
        _mm_storel_epi64((__m128i *)(void *)to, v);
        v = _mm_srli_si128(v, 8);
        to += 8;
    }
    last = (uint32_t)_mm_cvtsi128_si32(v);
    if (n & 4) {
        memcpy(to, &last, 4);
        last = (uint32_t)_mm_cvtsi128_si32(_mm_srli_si128(v, 4));
        to += 4;
    }
    if (n & 2) {
        to[0] = (uint8_t)last;
        to[1] = (uint8_t)(last >> 8);
        last >>= 16;
        to += 2;
    }
    if (n & 1)
        to[0] = (uint8_t)last;
}

/* Two vectors of requantised sums. */
LULL_INLINE void store_narrow(const finish *f, size_t at, vec a, vec b)
{
    vec pairs = _mm256_packs_epi32(a, b); /* a0-3 b0-3, a4-7 b4-7 */
    __m128i q = _mm_packus_epi16(_mm256_castsi256_si128(pairs), _mm256_extracti128_si256(pairs, 1));
    q = _mm_min_epu8(q, _mm_set1_epi8((char)f->max));
    store_bytes((uint8_t *)f->out + at, _mm_shuffle_epi32(q, 0xd8), f->n);
}

LULL_INLINE void store_wide(const finish *f, size_t at, vec a, vec b)
{
    uint16_t *out = (uint16_t *)f->out + at;
    vec q = _mm256_min_epu16(_mm256_packus_epi32(a, b), _mm256_set1_epi16((short)f->max));
    q = _mm256_permute4x64_epi64(q, 0xd8);
    store_bytes(out, _mm256_castsi256_si128(q), lull_min_u(2 * f->n, 16));
    if (f->n > LANES)
        store_bytes(out + LANES, _mm256_extracti128_si256(q, 1), 2 * f->n - 16);
}

LULL_INLINE void finish_2(const finish *f, size_t at, vec a, vec b)
{
    a = requantise(a, f->even0, f->odd0);
    b = requantise(b, f->even1, f->odd1);
    if (f->max <= 255)
        store_narrow(f, at, a, b);
    else
        store_wide(f, at, a, b);
}

LULL_INLINE void finish_1(const finish *f, size_t at, vec a)
{
    a = requantise(a, f->even0, f->odd0);
    if (f->max <= 255)
        store_narrow(f, at, a, a);
    else
        store_wide(f, at, a, a);
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

/* Pixels in tiles; the last tile is moved back to end at the last pixel. */
#define FOR_TILES(tile, size)                             \
    for (unsigned p = 0; p < conv->pixels; p += (size)) { \
        if (p + (size) > conv->pixels)                    \
            p = conv->pixels - (size);                    \
        tile(conv, first, p, n);                          \
    }

void CONV(const lull_conv *conv)
{
    unsigned first = 0;
    while (first < conv->outputs) {
        unsigned n = conv->outputs - first;
        if (n > LANES && conv->pixels >= TILE_2) {
            n = lull_min_u(n, 2 * LANES);
            FOR_TILES(tile_2, TILE_2)
            first += 2 * LANES;
        } else {
            n = lull_min_u(n, LANES);
            if (conv->pixels >= TILE_1) {
                FOR_TILES(tile_1, TILE_1)
            } else {
                FOR_TILES(pixel_1, 1)
            }
            first += LANES;
        }
    }
}
