/* Integer convolution to three outputs: vectors run over the elements of a run, so that no lane is
 * idle, and are summed at the end, those of four pixels together. Included after conv_int_512.h,
 * with CONV3 (the function's name). */
#include "conv_int3.h"

/* Sums within 128 bits: a, b, c, 0 of each. */
LULL_INLINE vec int3_one(vec a, vec b, vec c)
{
    vec x = add(_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
    vec z = add(_mm512_unpacklo_epi32(c, zero()), _mm512_unpackhi_epi32(c, zero()));
    return add(_mm512_unpacklo_epi64(x, z), _mm512_unpackhi_epi64(x, z));
}

/* The sums of the four times 128 bits of four pixels, in 128 bits each. */
LULL_INLINE vec int3_four(vec p, vec q, vec r, vec s)
{
    vec v = add(_mm512_shuffle_i32x4(p, q, 0x44), _mm512_shuffle_i32x4(p, q, 0xee));
    vec w = add(_mm512_shuffle_i32x4(r, s, 0x44), _mm512_shuffle_i32x4(r, s, 0xee));
    return add(_mm512_shuffle_i32x4(v, w, 0x88), _mm512_shuffle_i32x4(v, w, 0xdd));
}

/* The last dwords of the runs of `pixels` pixels, those that do not fill a vector. */
static LULL_NOINLINE vec int3_rests(const lull_segment *segment, unsigned size, unsigned p,
                                    unsigned pixels)
{
    int32_t sum[LANES] = {0};
    for (unsigned i = 0; i < pixels; i++)
        _mm_storeu_si128((__m128i *)(void *)(sum + 4 * i), int3_rest(segment, size, p + i));
    return load(sum);
}

/* What tiles share. */
typedef struct int3 {
    finish f;
    vec bias, half;
} int3;

/* Requantises and stores `pixels` pixels from p on. */
LULL_INLINE void int3_store(const int3 *s, const lull_conv *conv, unsigned p, unsigned pixels,
                            vec a)
{
    const vec together = _mm512_setr_epi32(0x10000, 0x80002, 0xa0009, 0x110010, 0x180012, 0x1a0019,
                                           0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    uint8_t *to = (uint8_t *)conv->out + p * conv->out_step * s->f.size;
    uint16_t codes[2 * LANES];
    vec q = requantise(&s->f, a, 0, 0);
    q = _mm512_min_epu16(_mm512_packus_epi32(q, q), _mm512_set1_epi16((short)s->f.max));
    q = _mm512_permutexvar_epi16(together, q); /* of each pixel's 8 words the first three */
    if (s->f.size == 2 && conv->out_step == 3) {
        _mm512_mask_storeu_epi16(to, (1u << 3 * pixels) - 1, q);
        return;
    }
    _mm512_storeu_si512(codes, q);
    for (unsigned i = 0; i < 3 * pixels; i++) {
        uint8_t *at = to + (i / 3 * conv->out_step + i % 3) * s->f.size;
        if (s->f.size == 2)
            memcpy(at, codes + i, 2);
        else
            *at = (uint8_t)codes[i];
    }
}

#define PIXELS 4
#define INT3_SUM(a, b, c) \
    int3_four(int3_one(a##0, b##0, c##0), int3_one(a##1, b##1, c##1), int3_one(a##2, b##2, c##2), \
              int3_one(a##3, b##3, c##3))
#define RUN int3_run_4
#define TILE int3_tile
#include "conv_int3_512_tile.h"

#define PIXELS 1
#define INT3_SUM(a, b, c) int3_four(int3_one(a##0, b##0, c##0), zero(), zero(), zero())
#define RUN int3_run_1
#define TILE int3_pixel
#include "conv_int3_512_tile.h"

void CONV3(const lull_conv *conv)
{
    const int32_t *b = conv->bias, *m = conv->multiplier;
    int3 s;
    s.bias = _mm512_broadcast_i32x4(_mm_setr_epi32(b[0], b[1], b[2], 0));
    s.half = splat_int(1 << conv->wide_shift >> 1);
    s.f.even[0] = _mm512_slli_epi32(_mm512_broadcast_i32x4(_mm_setr_epi32(m[0], m[1], m[2], 0)), 1);
    s.f.odd[0] = _mm512_srli_epi64(s.f.even[0], 32);
    s.f.max = conv->out_max;
    s.f.size = conv->out_max <= 255 ? 1 : 2;
    (conv->pixels < 4 ? int3_pixel : int3_tile)(conv, &s);
}
