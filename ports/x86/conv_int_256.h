/* Integer convolution with vectors of 8 outputs, for AVX2 and its extensions. The including
 * file defines DOT_NARROW, DOT_WIDE and, where that pays, DOT_WORDS (see conv_int_tile.h), TILE_2
 * and TILE_1 (pixels of the tiles of two vectors and of one) and CONV (the function's name). */
#include "intrinsics.h"
#include "kernels.h"
#include "requantise_256.h"
#include "tiles.h"

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

/* Where and how the pixels of a tile are stored. Outputs that do not fill the vectors go to `spare`
 * first: 12 pixels of one vector or 6 of two, 2 bytes each. */
typedef struct finish {
    vec even0, odd0, even1, odd1; /* twice the multipliers; small sums: `even` are their scales */
    uint8_t *to;
    size_t step; /* bytes */
    int32_t max;
    unsigned size;       /* bytes of an output */
    unsigned spare_step; /* 0: stored directly */
    uint8_t spare[384];
} finish;

LULL_INLINE void finish_init(finish *f, const tile_row *row, unsigned vectors, int is_small)
{
    const int32_t *m = row->conv->multiplier + row->first;
    vec m0 = load(m), m1 = load(vectors > 1 ? m + LANES : m);
    f->even0 = is_small ? small_scale(m0) : _mm256_slli_epi32(m0, 1);
    f->even1 = is_small ? small_scale(m1) : _mm256_slli_epi32(m1, 1);
    f->odd0 = _mm256_srli_epi64(f->even0, 32);
    f->odd1 = _mm256_srli_epi64(f->even1, 32);
    f->max = row->conv->out_max;
    f->size = f->max <= 255 ? 1 : 2;
    f->spare_step = row->n % LANES ? (row->n > LANES ? 2 : 1) * LANES * f->size : 0;
    f->to = f->spare;
    f->step = f->spare_step ? f->spare_step : f->size * row->conv->out_step;
}

LULL_INLINE void finish_tile(finish *f, const tile_row *row, unsigned p)
{
    if (!f->spare_step)
        f->to = (uint8_t *)row->conv->out + p * f->step + row->first * f->size;
}

/* n < 32 bytes, as two overlapping halves where it can. */
LULL_INLINE void copy_bytes(uint8_t *to, const uint8_t *from, unsigned n)
{
    if (n >= 16) {
        __m128i a = _mm_loadu_si128((const __m128i *)(const void *)from);
        __m128i b = _mm_loadu_si128((const __m128i *)(const void *)(from + n - 16));
        _mm_storeu_si128((__m128i *)(void *)to, a);
        _mm_storeu_si128((__m128i *)(void *)(to + n - 16), b);
    } else if (n >= 8) {
        memcpy(to, from, 8);
        memcpy(to + n - 8, from + n - 8, 8);
    } else if (n >= 4) {
        memcpy(to, from, 4);
        memcpy(to + n - 4, from + n - 4, 4);
    } else {
        for (; n; n--)
            *to++ = *from++;
    }
}

LULL_INLINE void finish_end(const finish *f, const tile_row *row, unsigned p, unsigned pixels)
{
    size_t step = f->size * row->conv->out_step;
    uint8_t *to = (uint8_t *)row->conv->out + p * step + row->first * f->size;
    const uint8_t *from = f->spare;
    if (f->spare_step)
        for (; pixels; pixels--, from += f->spare_step, to += step)
            copy_bytes(to, from, row->n * f->size);
}

/* Two vectors of requantised sums of one pixel. */
LULL_INLINE void store_wide(const finish *f, unsigned i, vec a, vec b)
{
    vec q = _mm256_permute4x64_epi64(_mm256_packus_epi32(a, b), 0xd8);
    q = _mm256_min_epu16(q, _mm256_set1_epi16((short)f->max));
    _mm256_storeu_si256((__m256i *)(void *)(f->to + i * f->step), q);
}

#define Q(v, n) \
    v = how & SMALL ? requantise_small(v, f->even##n) : requantise(v, f->even##n, f->odd##n)

LULL_INLINE void finish_2(const finish *f, int how, unsigned i, unsigned j, vec a, vec b,
                          vec c, vec d)
{
    Q(a, 0), Q(b, 1), Q(c, 0), Q(d, 1);
    if (how & BYTES) {
        vec q = _mm256_packus_epi16(_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, d));
        q = _mm256_permutevar8x32_epi32(q, _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7));
        q = _mm256_min_epu8(q, _mm256_set1_epi8((char)f->max));
        _mm_storeu_si128((__m128i *)(void *)(f->to + i * f->step), _mm256_castsi256_si128(q));
        _mm_storeu_si128((__m128i *)(void *)(f->to + j * f->step), _mm256_extracti128_si256(q, 1));
    } else {
        store_wide(f, i, a, b);
        store_wide(f, j, c, d);
    }
}

LULL_INLINE void finish_1(const finish *f, int how, unsigned i, unsigned j, vec a, vec b)
{
    uint8_t *to = f->to + i * f->step, *next = f->to + j * f->step;
    Q(a, 0), Q(b, 0);
    if (how & BYTES) {
        vec pairs = _mm256_packs_epi32(a, b); /* a0-3 b0-3, a4-7 b4-7 */
        __m128i q = _mm_packus_epi16(_mm256_castsi256_si128(pairs),
                                     _mm256_extracti128_si256(pairs, 1));
        q = _mm_min_epu8(_mm_shuffle_epi32(q, 0xd8), _mm_set1_epi8((char)f->max));
        _mm_storel_epi64((__m128i *)(void *)to, q);
        _mm_storel_epi64((__m128i *)(void *)next, _mm_unpackhi_epi64(q, q));
    } else {
        vec q = _mm256_permute4x64_epi64(_mm256_packus_epi32(a, b), 0xd8);
        q = _mm256_min_epu16(q, _mm256_set1_epi16((short)f->max));
        _mm_storeu_si128((__m128i *)(void *)to, _mm256_castsi256_si128(q));
        _mm_storeu_si128((__m128i *)(void *)next, _mm256_extracti128_si256(q, 1));
    }
}

#define IS_WORDS 0
#define IS_SMALL 0
#define TEMPLATE "conv_int_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_256.h"

#undef IS_SMALL
#define IS_SMALL 1
#define TEMPLATE "conv_int_tile.h"
#define SHAPES small_shapes
#define SHAPE(vectors) small_##vectors
#include "shapes_256.h"

LULL_INLINE vec widened(vec a) { return _mm256_madd_epi16(a, _mm256_set1_epi16(1)); }

#include "shapes_words.h"

void CONV(const lull_conv *conv)
{
    if (conv->is_small) {
        unsigned before = round_down();
        run_tiles(conv, conv->fits_words ? word_shapes : small_shapes, LANES, 1);
        round_as(before);
        return;
    }
    run_tiles(conv, shapes, LANES, 1);
}
