/* Patches in vectors of 32 words and 16 sums. */
#include "port_avx512.h"

#include "finish_512.h"

#define WORDS 32u
typedef __m512i words;

LULL_INLINE words addw(words a, words b) { return _mm512_add_epi16(a, b); }
LULL_INLINE words subw(words a, words b) { return _mm512_sub_epi16(a, b); }
#define shlw(a, bits) _mm512_slli_epi16(a, bits)

LULL_INLINE words load_words(const void *p, unsigned n)
{
    return n >= WORDS ? load(p)
                      : _mm512_castsi256_si512(_mm256_loadu_si256((const __m256i *)p));
}

LULL_INLINE void store_words(void *p, words v, unsigned n)
{
    if (n >= WORDS)
        _mm512_storeu_si512(p, v);
    else
        _mm256_storeu_si256((__m256i *)p, _mm512_castsi512_si256(v));
}

#if LULL_EMULATE /* it lacks the instructions */
#define widen(bytes) _mm512_and_si512(_mm512_cvtepi8_epi16(bytes), _mm512_set1_epi16(255))
#define shr(a, n) shift(a, n)
#else
#define widen(bytes) _mm512_cvtepu8_epi16(bytes)
#define shr(a, n) _mm512_srai_epi32(a, n)
#endif

#define load_codes(p, n)                                                           \
    ((n) >= WORDS ? widen(_mm256_loadu_si256((const __m256i *)(const void *)(p)))  \
                  : _mm512_castsi256_si512(_mm256_cvtepu8_epi16(                   \
                        _mm_loadu_si128((const __m128i *)(const void *)(p)))))

LULL_INLINE void save(void *p, vec v) { _mm512_storeu_si512(p, v); }
LULL_INLINE vec sub(vec a, vec b) { return _mm512_sub_epi32(a, b); }
LULL_INLINE vec most(vec a, vec b) { return _mm512_max_epi32(a, b); }
#define shl(a, bits) _mm512_slli_epi32(a, bits)

LULL_INLINE vec exact(vec a)
{
    a = _mm512_mullo_epi32(a, _mm512_set1_epi32(LULL_PATCH_INVERSE));
    return shr(a, LULL_PATCH_SHIFT);
}

typedef struct scales {
    finish f;
    vec bias;
    int is_small;
} scales;

LULL_INLINE void scales_init(scales *s, const lull_patches *image, unsigned first)
{
    vec multiplier = load(image->multiplier + first);
    s->bias = load(image->bias + first);
    s->is_small = image->is_small;
    s->f.max = image->out_max;
    s->f.even[0] = _mm512_slli_epi32(multiplier, 1);
    s->f.odd[0] = _mm512_srli_epi64(s->f.even[0], 32);
    if (s->is_small)
        s->f.even[0] = small_scale(multiplier);
}

LULL_INLINE void put(const scales *s, uint8_t *to, uint8_t *next, size_t pixel, const vec *a)
{
    vec q[4];
    for (unsigned i = 0; i < 4; i++)
        q[i] = s->is_small ? requantise(&s->f, a[i], 0, SMALL) : requantise(&s->f, a[i], 0, 0);
    if (s->f.max <= 255) {
        vec codes = pack(&s->f, q[0], q[1], q[2], q[3]);
        _mm_storeu_si128((__m128i *)(void *)to, _mm512_castsi512_si128(codes));
        _mm_storeu_si128((__m128i *)(void *)(to + pixel), _mm512_extracti32x4_epi32(codes, 1));
        _mm_storeu_si128((__m128i *)(void *)next, _mm512_extracti32x4_epi32(codes, 2));
        _mm_storeu_si128((__m128i *)(void *)(next + pixel), _mm512_extracti32x4_epi32(codes, 3));
        return;
    }
    for (unsigned i = 0; i < 4; i += 2) {
        const vec order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
        vec v = _mm512_permutexvar_epi64(order, _mm512_packus_epi32(q[i], q[i + 1]));
        uint8_t *at = i ? next : to;
        v = _mm512_min_epu16(v, _mm512_set1_epi16((short)s->f.max));
        _mm256_storeu_si256((__m256i *)(void *)at, _mm512_castsi512_si256(v));
        _mm256_storeu_si256((__m256i *)(void *)(at + pixel), _mm512_extracti64x4_epi64(v, 1));
    }
}

#include "patches_rows.h"

void lull_patches_in_avx512(const lull_patches *image) { patches_in(image); }
void lull_patches_out_avx512(const lull_patches *image) { patches_out(image); }
