/* Integer sums in vectors of 16 outputs, for AVX-512 and its extensions: requantised and stored. */
#ifndef LULL_X86_FINISH_512_H
#define LULL_X86_FINISH_512_H

#include "intrinsics.h"
#include "kernels.h"
#include "tiles.h"

#define LANES 16u
typedef __m512i vec;

LULL_INLINE vec zero(void) { return _mm512_setzero_si512(); }
LULL_INLINE vec load(const void *p) { return _mm512_loadu_si512(p); }
LULL_INLINE vec splat_int(int v) { return _mm512_set1_epi32(v); }
LULL_INLINE vec splat(const uint8_t *p)
{
    int32_t v;
    memcpy(&v, p, sizeof v);
    return _mm512_set1_epi32(v);
}
LULL_INLINE vec add(vec a, vec b) { return _mm512_add_epi32(a, b); }
LULL_INLINE vec shift(vec a, unsigned n) { return _mm512_sra_epi32(a, _mm_cvtsi32_si128((int)n)); }

/* Where and how the pixels of a tile are stored. */
typedef struct finish {
    vec even[4], odd[4]; /* twice the multipliers, those of odd lanes in even ones; small sums:
                          * `even` are the multipliers times 2^-31 as floats */
    uint8_t *to;
    size_t step; /* bytes */
    int32_t max;
    unsigned size;          /* bytes of an output */
    __mmask64 narrow;       /* bytes of narrow outputs */
    __mmask32 wide0, wide1; /* wide outputs: the first 32 and the others */
} finish;

/* The first n of `lanes` lanes. */
LULL_INLINE uint64_t first_lanes(unsigned n, unsigned lanes)
{
    return n >= lanes ? ~(uint64_t)0 >> (64 - lanes) : ((uint64_t)1 << n) - 1;
}

/* Sums that a float holds, by multipliers that a float holds: the product with 0.5 added, rounded
 * down once, is cut to the same integer as the definition's. */
LULL_INLINE vec small_scale(vec multiplier)
{
    return _mm512_castps_si512(
        _mm512_mul_ps(_mm512_cvtepi32_ps(multiplier), _mm512_set1_ps(1.0f / 2147483648.0f)));
}
LULL_INLINE vec requantise_small(vec a, vec scale)
{
    return _mm512_cvttps_epi32(_mm512_fmadd_round_ps(
        _mm512_cvtepi32_ps(a), _mm512_castsi512_ps(scale), _mm512_set1_ps(0.5f),
        _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC));
}

LULL_INLINE void finish_init(finish *f, const tile_row *row, unsigned vectors, int is_small)
{
    for (unsigned i = 0; i < vectors; i++) {
        vec multiplier = load(row->conv->multiplier + row->first + i * LANES);
        if (is_small) {
            f->even[i] = small_scale(multiplier);
            continue;
        }
        f->even[i] = _mm512_slli_epi32(multiplier, 1);
        f->odd[i] = _mm512_srli_epi64(f->even[i], 32);
    }
    f->max = row->conv->out_max;
    f->size = f->max <= 255 ? 1 : 2;
    f->step = f->size * row->conv->out_step;
    f->narrow = (__mmask64)first_lanes(row->n, 64);
    f->wide0 = (__mmask32)first_lanes(row->n, 32);
    f->wide1 = (__mmask32)first_lanes(row->n > 32 ? row->n - 32 : 0, 32);
}

LULL_INLINE void finish_tile(finish *f, const tile_row *row, unsigned p)
{
    f->to = (uint8_t *)row->conv->out + p * f->step + row->first * f->size;
}

LULL_INLINE void finish_end(const finish *f, const tile_row *row, unsigned p, unsigned pixels)
{
    (void)f, (void)row, (void)p, (void)pixels;
}

/* (a * M + 2^30) >> 31 as the high half of a * 2M + 2^31, which always fits. */
LULL_INLINE vec requantise(const finish *f, vec a, unsigned vector, int is_small)
{
    const vec half = _mm512_set1_epi64((long long)1 << 31);
    vec q0, q1;
    if (is_small)
        return requantise_small(a, f->even[vector]);
    q0 = _mm512_add_epi64(_mm512_mul_epi32(a, f->even[vector]), half);
    q1 = _mm512_mul_epi32(_mm512_srli_epi64(a, 32), f->odd[vector]);
    q1 = _mm512_add_epi64(q1, half);
    return _mm512_mask_shuffle_epi32(q1, 0x5555, q0, _MM_PERM_DDBB);
}

/* Four vectors of requantised sums as bytes. Packing works within 128 bits: the dwords of the
 * result are then put in order. */
LULL_INLINE vec pack(const finish *f, vec a, vec b, vec c, vec d)
{
    const vec order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    vec q = _mm512_packus_epi16(_mm512_packs_epi32(a, b), _mm512_packs_epi32(c, d));
    q = _mm512_min_epu8(q, _mm512_set1_epi8((char)f->max));
    return _mm512_permutexvar_epi32(order, q);
}

/* One pixel's vectors as 16-bit words. */
LULL_INLINE void store_wide(const finish *f, unsigned i, vec a, vec b, vec c, vec d,
                            unsigned vectors)
{
    const vec order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
    vec max = _mm512_set1_epi16((short)f->max);
    vec q = _mm512_min_epu16(_mm512_packus_epi32(a, b), max);
    uint8_t *to = f->to + i * f->step;
    _mm512_mask_storeu_epi16(to, f->wide0, _mm512_permutexvar_epi64(order, q));
    if (vectors < 3)
        return;
    q = _mm512_min_epu16(_mm512_packus_epi32(c, d), max);
    _mm512_mask_storeu_epi16(to + 64, f->wide1, _mm512_permutexvar_epi64(order, q));
}

#define Q(v, n) requantise(f, v, n, how & SMALL)

LULL_INLINE void finish_4(const finish *f, int how, unsigned i, unsigned j, vec ai, vec bi,
                          vec ci, vec di, vec aj, vec bj, vec cj, vec dj)
{
    if (how & BYTES) {
        _mm512_mask_storeu_epi8(f->to + i * f->step, f->narrow,
                                pack(f, Q(ai, 0), Q(bi, 1), Q(ci, 2), Q(di, 3)));
        _mm512_mask_storeu_epi8(f->to + j * f->step, f->narrow,
                                pack(f, Q(aj, 0), Q(bj, 1), Q(cj, 2), Q(dj, 3)));
    } else {
        store_wide(f, i, Q(ai, 0), Q(bi, 1), Q(ci, 2), Q(di, 3), 4);
        store_wide(f, j, Q(aj, 0), Q(bj, 1), Q(cj, 2), Q(dj, 3), 4);
    }
}

LULL_INLINE void finish_3(const finish *f, int how, unsigned i, unsigned j, vec ai, vec bi,
                          vec ci, vec aj, vec bj, vec cj)
{
    if (how & BYTES) {
        _mm512_mask_storeu_epi8(f->to + i * f->step, f->narrow,
                                pack(f, Q(ai, 0), Q(bi, 1), Q(ci, 2), zero()));
        _mm512_mask_storeu_epi8(f->to + j * f->step, f->narrow,
                                pack(f, Q(aj, 0), Q(bj, 1), Q(cj, 2), zero()));
    } else {
        store_wide(f, i, Q(ai, 0), Q(bi, 1), Q(ci, 2), zero(), 3);
        store_wide(f, j, Q(aj, 0), Q(bj, 1), Q(cj, 2), zero(), 3);
    }
}

LULL_INLINE void finish_2(const finish *f, int how, unsigned i, unsigned j, vec ai, vec bi,
                          vec aj, vec bj)
{
    ai = Q(ai, 0), bi = Q(bi, 1), aj = Q(aj, 0), bj = Q(bj, 1);
    if (how & BYTES) {
        vec q = pack(f, ai, bi, aj, bj);
        _mm256_mask_storeu_epi8(f->to + i * f->step, (__mmask32)f->narrow,
                                _mm512_castsi512_si256(q));
        _mm256_mask_storeu_epi8(f->to + j * f->step, (__mmask32)f->narrow,
                                _mm512_extracti64x4_epi64(q, 1));
    } else {
        store_wide(f, i, ai, bi, zero(), zero(), 2);
        store_wide(f, j, aj, bj, zero(), zero(), 2);
    }
}

/* Four pixels. */
LULL_INLINE void finish_four(const finish *f, int how, unsigned i, vec a, vec b, vec c,
                             vec d)
{
    a = Q(a, 0), b = Q(b, 0), c = Q(c, 0), d = Q(d, 0);
    if (how & BYTES) {
        vec q = pack(f, a, b, c, d);
        uint8_t *to = f->to + i * f->step;
        __mmask16 mask = (__mmask16)f->narrow;
        if (f->step == LANES && mask == 0xffff) {
            _mm512_storeu_si512(to, q);
            return;
        }
        _mm_mask_storeu_epi8(to, mask, _mm512_castsi512_si128(q));
        _mm_mask_storeu_epi8(to + f->step, mask, _mm512_extracti32x4_epi32(q, 1));
        _mm_mask_storeu_epi8(to + 2 * f->step, mask, _mm512_extracti32x4_epi32(q, 2));
        _mm_mask_storeu_epi8(to + 3 * f->step, mask, _mm512_extracti32x4_epi32(q, 3));
    } else {
        store_wide(f, i, a, zero(), zero(), zero(), 1);
        store_wide(f, i + 1, b, zero(), zero(), zero(), 1);
        store_wide(f, i + 2, c, zero(), zero(), zero(), 1);
        store_wide(f, i + 3, d, zero(), zero(), zero(), 1);
    }
}

/* A lone pixel. */
LULL_INLINE void finish_1(const finish *f, int how, unsigned i, unsigned j, vec a, vec b)
{
    (void)j, (void)b;
    a = Q(a, 0);
    if (how & BYTES)
        _mm_mask_storeu_epi8(f->to + i * f->step, (__mmask16)f->narrow,
                             _mm512_castsi512_si128(pack(f, a, zero(), zero(), zero())));
    else
        store_wide(f, i, a, zero(), zero(), zero(), 1);
}

#endif
