/* Integer convolution with vectors of 4 outputs: pairs of bytes are multiplied and added in 16
 * bits, which pair-safe weights never saturate, then widened by a multiplication with ones. */
#include "port_sse41.h"
#include "tiles.h"

#define LANES 4u
typedef __m128i vec;

LULL_INLINE vec zero(void) { return _mm_setzero_si128(); }
LULL_INLINE vec load(const void *p) { return _mm_loadu_si128((const __m128i *)p); }
LULL_INLINE vec splat_int(int v) { return _mm_set1_epi32(v); }
LULL_INLINE vec splat(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm_set1_epi32(v);
}
LULL_INLINE vec add(vec a, vec b) { return _mm_add_epi32(a, b); }
LULL_INLINE vec shift(vec a, unsigned n) { return _mm_sra_epi32(a, _mm_cvtsi32_si128((int)n)); }
LULL_INLINE vec widened(vec a) { return _mm_madd_epi16(a, _mm_set1_epi16(1)); }

/* (a * M + 2^30) >> 31 as the high half of a * 2M + 2^31, which always fits. twice: 2M. */
LULL_INLINE vec requantise(vec a, vec twice)
{
    const vec half = _mm_set1_epi64x((long long)1 << 31);
    vec q0 = _mm_add_epi64(_mm_mul_epi32(a, twice), half);
    vec q1 = _mm_add_epi64(_mm_mul_epi32(_mm_srli_epi64(a, 32), _mm_srli_epi64(twice, 32)), half);
    return _mm_blend_epi16(_mm_srli_epi64(q0, 32), q1, 0xcc);
}

/* Where and how the pixels of a tile are stored. */
typedef struct finish {
    vec twice0, twice1; /* the multipliers */
    vec max;            /* in bytes, or in words */
    uint8_t *to;
    size_t step;   /* bytes */
    unsigned size; /* bytes of an output */
    unsigned bytes;
} finish;

LULL_INLINE void finish_init(finish *f, const tile_row *row, unsigned vectors, int is_small)
{
    const int32_t *m = row->conv->multiplier + row->first;
    int32_t max = row->conv->out_max;
    (void)is_small;
    f->twice0 = _mm_slli_epi32(load(m), 1);
    f->twice1 = _mm_slli_epi32(load(vectors > 1 ? m + LANES : m), 1);
    f->size = max <= 255 ? 1 : 2;
    f->max = f->size == 1 ? _mm_set1_epi8((char)max) : _mm_set1_epi16((short)max);
    f->step = f->size * row->conv->out_step;
    f->bytes = f->size * row->n;
}

LULL_INLINE void finish_tile(finish *f, const tile_row *row, unsigned p)
{
    f->to = (uint8_t *)row->conv->out + p * f->step + row->first * f->size;
}

LULL_INLINE void finish_end(const finish *f, const tile_row *row, unsigned p, unsigned pixels)
{
    (void)f, (void)row, (void)p, (void)pixels;
}

/* The outputs of pixel i: the first bytes of q. */
LULL_INLINE void put(const finish *f, unsigned i, vec q)
{
    uint8_t *to = f->to + i * f->step, part[16];
    if (f->bytes == 8) {
        _mm_storel_epi64((__m128i *)(void *)to, q);
        return;
    }
    _mm_storeu_si128((__m128i *)(void *)(f->bytes == 16 ? to : part), q);
    if (f->bytes == 4)
        memcpy(to, part, 4);
    else if (f->bytes < 16)
        memcpy(to, part, f->bytes);
}

/* Called, as a copy at each of the many uses would be most of this file's code. */
static LULL_NOINLINE void finish_2(const finish *f, int how, unsigned i, unsigned j, vec a, vec b,
                                   vec c, vec d)
{
    a = requantise(a, f->twice0), b = requantise(b, f->twice1);
    c = requantise(c, f->twice0), d = requantise(d, f->twice1);
    if (how & BYTES) {
        a = _mm_packus_epi16(_mm_packs_epi32(a, b), _mm_packs_epi32(c, d));
        a = _mm_min_epu8(a, f->max);
        put(f, i, a);
        put(f, j, _mm_unpackhi_epi64(a, a));
    } else {
        put(f, i, _mm_min_epu16(_mm_packus_epi32(a, b), f->max));
        put(f, j, _mm_min_epu16(_mm_packus_epi32(c, d), f->max));
    }
}

static LULL_NOINLINE void finish_1(const finish *f, int how, unsigned i, unsigned j, vec a, vec b)
{
    a = requantise(a, f->twice0), b = requantise(b, f->twice0);
    if (how & BYTES) {
        a = _mm_packs_epi32(a, b);
        a = _mm_min_epu8(_mm_packus_epi16(a, a), f->max);
        put(f, i, a);
        put(f, j, _mm_srli_si128(a, 4));
    } else {
        a = _mm_min_epu16(_mm_packus_epi32(a, b), f->max);
        put(f, i, a);
        put(f, j, _mm_unpackhi_epi64(a, a));
    }
}

#if LULL_X86_ASM
#define ADD_IN_PLACE(sum, t) __asm__("paddd %1, %0" : "+x"(sum) : "x"(t))
#define ADD_WORDS(sum, t) __asm__("paddw %1, %0" : "+x"(sum) : "x"(t))
#else
#define ADD_IN_PLACE(sum, t) sum = _mm_add_epi32(sum, t)
#define ADD_WORDS(sum, t) sum = _mm_add_epi16(sum, t)
#endif

#define DOT_NARROW(sum, x, w) ADD_IN_PLACE(sum, widened(_mm_maddubs_epi16(x, w)))
#define DOT_WORDS(sum, x, w) ADD_WORDS(sum, _mm_maddubs_epi16(x, w))
#define DOT_WIDE(sum, x, w) ADD_IN_PLACE(sum, _mm_madd_epi16(x, w))

#define IS_WORDS 0
#define IS_SMALL 0
#define TILE_2 4
#define TILE_1 8
#define TEMPLATE "conv_int_tile.h"
#define SHAPES shapes
#define SHAPE(vectors) tile_##vectors
#include "shapes_256.h"

#include "shapes_words.h"

void lull_conv_int_sse41(const lull_conv *conv)
{
    run_tiles(conv, conv->fits_words ? word_shapes : shapes, LANES, 1);
}

/* ---- Three outputs: vectors of a run's elements ---------------------------------------------- */

LULL_INLINE int32_t total(vec v)
{
    v = _mm_add_epi32(v, _mm_unpackhi_epi64(v, v));
    return _mm_cvtsi128_si32(v) + _mm_extract_epi32(v, 1);
}

LULL_INLINE vec one_dword(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm_cvtsi32_si128(v);
}

LULL_INLINE vec two_dwords(const uint8_t *p)
{
    return _mm_loadl_epi64((const __m128i *)(const void *)p);
}

/* Sums of n dwords of codes of 16 bits (two of each), or of 8 (four). */
static int32_t dot_wide(const uint8_t *x, const uint8_t *w, unsigned n)
{
    vec sum = zero();
    for (; n >= 4; n -= 4, x += 16, w += 16)
        sum = add(sum, _mm_madd_epi16(load(x), load(w)));
    for (; n; n--, x += 4, w += 4)
        sum = add(sum, _mm_madd_epi16(one_dword(x), one_dword(w)));
    return total(sum);
}

static int32_t dot_narrow(const uint8_t *x, const uint8_t *w, unsigned n)
{
    vec sum = zero();
    for (; n >= 2; n -= 2, x += 8, w += 8)
        sum = add(sum, _mm_madd_epi16(_mm_cvtepu8_epi16(two_dwords(x)),
                                      _mm_cvtepi8_epi16(two_dwords(w))));
    if (n)
        sum = add(sum, _mm_madd_epi16(_mm_cvtepu8_epi16(one_dword(x)),
                                      _mm_cvtepi8_epi16(one_dword(w))));
    return total(sum);
}

void lull_conv_int3_sse41(const lull_conv *conv)
{
    const int32_t *m = conv->multiplier;
    const vec twice = _mm_slli_epi32(_mm_setr_epi32(m[0], m[1], m[2], 0), 1);
    const unsigned size = conv->out_max <= 255 ? 1 : 2;
    for (size_t p = 0; p < conv->pixels; p++) {
        int32_t sum[LANES] = {0};
        uint8_t part[16];
        vec q;
        for (unsigned s = 0; s < conv->segments; s++) {
            const lull_segment *segment = &conv->segment[s];
            const unsigned n = segment->length;
            const uint8_t *w = (const uint8_t *)segment->weights;
            const uint8_t *x = (const uint8_t *)segment->row +
                               p * segment->step * (s < conv->wide ? 2u : 1u);
            for (unsigned o = 0; o < 3; o++, w += 4 * (size_t)n) {
                sum[o] += s < conv->wide ? dot_wide(x, w, n) : dot_narrow(x, w, n);
                if (s + 1 == conv->wide)
                    sum[o] = (sum[o] + (1 << conv->wide_shift >> 1)) >> conv->wide_shift;
            }
        }
        for (unsigned o = 0; o < 3; o++)
            sum[o] += ((const int32_t *)conv->bias)[o];
        q = requantise(load(sum), twice);
        q = _mm_min_epi32(_mm_max_epi32(q, zero()), splat_int(conv->out_max));
        q = _mm_packus_epi32(q, q);
        if (size == 1)
            q = _mm_packus_epi16(q, q);
        _mm_storeu_si128((__m128i *)(void *)part, q);
        memcpy((uint8_t *)conv->out + size * p * conv->out_step, part, size == 1 ? 3 : 6);
    }
}
