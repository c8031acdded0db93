/* Patches in vectors of 16 words and 8 sums. */
#include "port_avx2.h"

#include "requantise_256.h"

#define WORDS 16u
typedef __m256i words;

LULL_INLINE words addw(words a, words b) { return _mm256_add_epi16(a, b); }
LULL_INLINE words subw(words a, words b) { return _mm256_sub_epi16(a, b); }
#define shlw(a, bits) _mm256_slli_epi16(a, bits)

/* Channels are multiples of 16: all vectors are full. */
LULL_INLINE words load_words(const void *p, unsigned n)
{
    (void)n;
    return _mm256_loadu_si256((const __m256i *)p);
}

LULL_INLINE void store_words(void *p, words v, unsigned n)
{
    (void)n;
    _mm256_storeu_si256((__m256i *)p, v);
}

#define load_codes(p, n) _mm256_cvtepu8_epi16(_mm_loadu_si128((const __m128i *)(const void *)(p)))

#define LANES 8u
typedef __m256i vec;

LULL_INLINE vec load(const void *p) { return _mm256_loadu_si256((const __m256i *)p); }
LULL_INLINE void save(void *p, vec v) { _mm256_storeu_si256((__m256i *)p, v); }
LULL_INLINE vec splat_int(int v) { return _mm256_set1_epi32(v); }
LULL_INLINE vec add(vec a, vec b) { return _mm256_add_epi32(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm256_sub_epi32(a, b); }
LULL_INLINE vec most(vec a, vec b) { return _mm256_max_epi32(a, b); }
LULL_INLINE vec shift(vec a, unsigned n) { return _mm256_sra_epi32(a, _mm_cvtsi32_si128((int)n)); }
#define shl(a, bits) _mm256_slli_epi32(a, bits)
#define shr(a, bits) _mm256_srai_epi32(a, bits)

LULL_INLINE vec exact(vec a)
{
    a = _mm256_mullo_epi32(a, _mm256_set1_epi32(LULL_PATCH_INVERSE));
    return _mm256_srai_epi32(a, LULL_PATCH_SHIFT);
}

typedef struct scales {
    vec even, odd, bias; /* twice the multipliers; small sums: `even` is their scale */
    int32_t max;
    int is_small;
} scales;

LULL_INLINE void scales_init(scales *s, const lull_patches *image, unsigned first)
{
    vec multiplier = load(image->multiplier + first);
    s->is_small = image->is_small;
    s->even = s->is_small ? small_scale(multiplier) : _mm256_slli_epi32(multiplier, 1);
    s->odd = _mm256_srli_epi64(s->even, 32);
    s->bias = load(image->bias + first);
    s->max = image->out_max;
}

LULL_INLINE void put(const scales *s, uint8_t *to, uint8_t *next, size_t pixel, const vec *a)
{
    vec q[4];
    for (unsigned i = 0; i < 4; i++)
        q[i] = s->is_small ? requantise_small(a[i], s->even) : requantise(a[i], s->even, s->odd);
    if (s->max <= 255) { /* packing works within 128 bits: the dwords are then put in order */
        vec codes = _mm256_packus_epi16(_mm256_packs_epi32(q[0], q[1]),
                                        _mm256_packs_epi32(q[2], q[3]));
        __m128i low, high;
        codes = _mm256_min_epu8(codes, _mm256_set1_epi8((char)s->max));
        codes = _mm256_permutevar8x32_epi32(codes, _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7));
        low = _mm256_castsi256_si128(codes);
        high = _mm256_extracti128_si256(codes, 1);
        _mm_storel_epi64((__m128i *)(void *)to, low);
        _mm_storel_epi64((__m128i *)(void *)(to + pixel), _mm_unpackhi_epi64(low, low));
        _mm_storel_epi64((__m128i *)(void *)next, high);
        _mm_storel_epi64((__m128i *)(void *)(next + pixel), _mm_unpackhi_epi64(high, high));
        return;
    }
    for (unsigned i = 0; i < 4; i += 2) {
        vec v = _mm256_permute4x64_epi64(_mm256_packus_epi32(q[i], q[i + 1]), 0xd8);
        uint8_t *at = i ? next : to;
        v = _mm256_min_epu16(v, _mm256_set1_epi16((short)s->max));
        _mm_storeu_si128((__m128i *)(void *)at, _mm256_castsi256_si128(v));
        _mm_storeu_si128((__m128i *)(void *)(at + pixel), _mm256_extracti128_si256(v, 1));
    }
}

#include "patches_rows.h"

void lull_patches_in_avx2(const lull_patches *image) { patches_in(image); }

void lull_patches_out_avx2(const lull_patches *image)
{
    unsigned before = round_down();
    patches_out(image);
    round_as(before);
}
