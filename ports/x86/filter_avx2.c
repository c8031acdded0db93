/* The filter of family K beside its 5x5 sums: products and sums are rounded one by one, as in the
 * definition. */
#include "port_avx2.h"

/* ---- Codes ----------------------------------------------------------------------------------- */

#define VALUES 24u /* of 8 pixels */

/* v + 0.5 as codes: cut, and at most 255. */
LULL_INLINE __m256i to_codes(__m256 v)
{
    v = _mm256_add_ps(v, _mm256_set1_ps(0.5f));
    return _mm256_cvttps_epi32(_mm256_min_ps(v, _mm256_set1_ps(255.0f)));
}

/* 24 codes to bytes. */
LULL_INLINE void put_codes(uint8_t *out, __m256i a, __m256i b, __m256i c)
{
    const __m256i order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
    __m256i q = _mm256_packus_epi16(_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, c));
    _mm256_storeu_si256((__m256i *)(void *)out, _mm256_permutevar8x32_epi32(q, order));
}

/* log2 of u >= 1 (docs/arithmetic.md). */
LULL_INLINE __m256 log2_of(__m256 u)
{
    const __m256 one = _mm256_set1_ps(1.0f);
    __m256i bits = _mm256_castps_si256(u);
    __m256i exponent =
        _mm256_srai_epi32(_mm256_sub_epi32(bits, _mm256_set1_epi32(0x3f3504f3)), 23);
    __m256 m = _mm256_castsi256_ps(_mm256_sub_epi32(bits, _mm256_slli_epi32(exponent, 23)));
    __m256 s = _mm256_div_ps(_mm256_sub_ps(m, one), _mm256_add_ps(m, one));
    __m256 w = _mm256_mul_ps(s, s);
    __m256 p = _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(0.431737901252f), w),
                             _mm256_set1_ps(0.576714309537f));
    __m256 q = _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(0.961798848299f), w),
                             _mm256_set1_ps(2.88539007979f));
    p = _mm256_add_ps(_mm256_mul_ps(p, _mm256_mul_ps(w, w)), q);
    return _mm256_add_ps(_mm256_cvtepi32_ps(exponent), _mm256_mul_ps(s, p));
}

/* v where it is above 2^-126 (at least: 2^-126 itself if `least` is one less), else 0; v >= 0. */
LULL_INLINE __m256 above(__m256 v, int least)
{
    __m256i keep = _mm256_cmpgt_epi32(_mm256_castps_si256(v), _mm256_set1_epi32(least));
    return _mm256_and_ps(v, _mm256_castsi256_ps(keep));
}

/* Radiance, sanitised. The maximum is 0 if v is no number. */
LULL_INLINE __m256 sane_radiance(__m256 v, const lull_encoding *from)
{
    v = above(_mm256_max_ps(v, _mm256_setzero_ps()), 0x007fffff);
    v = _mm256_max_ps(_mm256_mul_ps(v, _mm256_set1_ps(from->scale)), _mm256_setzero_ps());
    return _mm256_min_ps(above(v, 0x00800000), _mm256_set1_ps(from->most));
}

/* Albedo; what is below 2^-126 does not matter to its code. */
LULL_INLINE __m256 clamped(const float *albedo)
{
    __m256 v = _mm256_max_ps(_mm256_loadu_ps(albedo), _mm256_setzero_ps());
    return _mm256_min_ps(v, _mm256_set1_ps(1.0f));
}

LULL_INLINE __m256i radiance_codes(const lull_encoding *from, __m256 r, __m256 albedo)
{
    __m256 v = _mm256_add_ps(albedo, _mm256_set1_ps(LULL_FILTER_EPSILON));
    v = _mm256_div_ps(sane_radiance(r, from), v);
    v = _mm256_add_ps(_mm256_set1_ps(1.0f), _mm256_mul_ps(_mm256_set1_ps(LULL_LOG_GAIN), v));
    return to_codes(_mm256_mul_ps(log2_of(v), _mm256_set1_ps(LULL_CODES_PER_OCTAVE)));
}

LULL_INLINE __m256i albedo_codes(__m256 albedo)
{
    return to_codes(_mm256_mul_ps(albedo, _mm256_set1_ps(255.0f)));
}

LULL_INLINE __m256i normal_codes(const float *normal)
{
    __m256 v = _mm256_loadu_ps(normal);
    v = _mm256_and_ps(v, _mm256_cmp_ps(v, v, _CMP_ORD_Q)); /* a number */
    v = _mm256_min_ps(_mm256_max_ps(v, _mm256_set1_ps(-1.0f)), _mm256_set1_ps(1.0f));
    v = _mm256_mul_ps(v, _mm256_set1_ps(127.5f));
    return to_codes(_mm256_add_ps(v, _mm256_set1_ps(127.5f)));
}

LULL_INLINE uint32_t load_dword(const uint8_t *p)
{
    uint32_t v;
    memcpy(&v, p, sizeof v);
    return v;
}

static void encode_8(uint8_t *codes, const lull_encoding *from)
{
    uint8_t r[32], a[32] = {0}, n[32];
    __m256 none = _mm256_set1_ps(1.0f - LULL_FILTER_EPSILON), a0 = none, a1 = none, a2 = none;
    if (from->albedo) {
        a0 = clamped(from->albedo), a1 = clamped(from->albedo + 8), a2 = clamped(from->albedo + 16);
        put_codes(a, albedo_codes(a0), albedo_codes(a1), albedo_codes(a2));
    }
    put_codes(r, radiance_codes(from, _mm256_loadu_ps(from->radiance), a0),
              radiance_codes(from, _mm256_loadu_ps(from->radiance + 8), a1),
              radiance_codes(from, _mm256_loadu_ps(from->radiance + 16), a2));
    if (from->normal)
        put_codes(n, normal_codes(from->normal), normal_codes(from->normal + 8),
                  normal_codes(from->normal + 16));
    else
        memset(n, 128, sizeof n);
    for (unsigned i = 0; i < VALUES; i += 3, codes += 12) {
        uint32_t x = load_dword(r + i), y = load_dword(a + i), z = load_dword(n + i);
        uint32_t dwords[3];
        dwords[0] = (x & 0xffffff) | y << 24;
        dwords[1] = (y >> 8 & 0xffff) | z << 16;
        dwords[2] = (z >> 16 & 0xff) | from->flags << 8;
        memcpy(codes, dwords, sizeof dwords);
    }
}

/* The last pixels, by way of memory that holds 8. */
static void encode_rest(uint8_t *codes, const lull_encoding *from, size_t pixels)
{
    float last[3][VALUES] = {{0}};
    uint8_t made[96];
    lull_encoding rest = *from;
    rest.radiance = memcpy(last[0], from->radiance, 3 * pixels * sizeof(float));
    if (from->albedo)
        rest.albedo = memcpy(last[1], from->albedo, 3 * pixels * sizeof(float));
    if (from->normal)
        rest.normal = memcpy(last[2], from->normal, 3 * pixels * sizeof(float));
    encode_8(made, &rest);
    memcpy(codes, made, 12 * pixels);
}

void lull_encode_avx2(uint8_t *codes, const lull_encoding *from, unsigned pixels)
{
    lull_encoding next = *from;
    for (; pixels >= 8; pixels -= 8, codes += 96) {
        encode_8(codes, &next);
        next.radiance += VALUES;
        next.albedo = next.albedo ? next.albedo + VALUES : NULL;
        next.normal = next.normal ? next.normal + VALUES : NULL;
    }
    if (pixels)
        encode_rest(codes, &next, pixels);
}

/* ---- Radiance -------------------------------------------------------------------------------- */

/* Two pixels of three channels as lanes 1-3 and 5-7. Two more floats than their six are read: from
 * two floats before them, so that nothing behind them is touched. */
LULL_INLINE __m256 two_pixels(const float *v)
{
    return _mm256_permutevar8x32_ps(_mm256_loadu_ps(v - 2),
                                    _mm256_setr_epi32(0, 2, 3, 4, 1, 5, 6, 7));
}

/* The same of one pixel. */
LULL_INLINE __m256 lone_pixel(const float *v)
{
    return _mm256_setr_ps(0.0f, v[0], v[1], v[2], 0.0f, 0.0f, 0.0f, 0.0f);
}

LULL_INLINE __m256 spread_out(__m256 v)
{
    v = above(_mm256_max_ps(v, _mm256_setzero_ps()), 0x00800000);
    return _mm256_blend_ps(_mm256_min_ps(v, _mm256_set1_ps(1.0f)), _mm256_set1_ps(1.0f), 0x11);
}

void lull_spread_avx2(float *out, const float *albedo, unsigned pixels)
{
    for (size_t i = 0; i < pixels;) {
        const float *v = albedo + 3 * i;
        if (i == 0 || i + 1 == pixels) {
            _mm_storeu_ps(out + 4 * i, _mm256_castps256_ps128(spread_out(lone_pixel(v))));
            i++;
            continue;
        }
        _mm256_storeu_ps(out + 4 * i, spread_out(two_pixels(v)));
        i += 2;
    }
}

/* r, s: lanes 1-3 and 5-7 of two pixels; c: their confidences in all lanes. */
LULL_INLINE __m256 demodulated(__m256 r, __m256 s, __m256 c, const lull_encoding *from)
{
    __m256 v = _mm256_mul_ps(c, _mm256_div_ps(sane_radiance(r, from), s));
    return _mm256_blend_ps(v, c, 0x11);
}

void lull_demodulate_avx2(float *out, const lull_encoding *from, const float *smooth,
                          const uint8_t *codes, size_t code_step, const float *table,
                          unsigned pixels)
{
    const float *r = from->radiance;
    for (unsigned i = 0; i < pixels;) {
        const uint8_t *q = codes + i * code_step;
        float *to = out + 4 * (size_t)i;
        size_t at = 3 * (size_t)i;
        if (i == 0 || i + 1 == pixels) {
            _mm_storeu_ps(to, _mm256_castps256_ps128(
                                  demodulated(lone_pixel(r + at), lone_pixel(smooth + at),
                                              _mm256_broadcast_ss(table + *q), from)));
            i++;
            continue;
        }
        _mm256_storeu_ps(to, demodulated(two_pixels(r + at), two_pixels(smooth + at),
                                         _mm256_blend_ps(_mm256_broadcast_ss(table + q[0]),
                                                         _mm256_broadcast_ss(table + q[code_step]),
                                                         0xf0),
                                         from));
        i += 2;
    }
}

/* 0.75 near + 0.25 far of two coarse pixels. */
LULL_INLINE __m256 between(__m256 near, __m256 far)
{
    return _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(0.75f), near),
                         _mm256_mul_ps(_mm256_set1_ps(0.25f), far));
}

/* Pixels p - 1 and p + 1. */
LULL_INLINE __m256 beside(const float *p)
{
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p - 4)), _mm_loadu_ps(p + 4),
                                1);
}

LULL_INLINE __m256 both(const float *p)
{
    return _mm256_broadcast_ps((const __m128 *)(const void *)p);
}

LULL_INLINE __m256 blended(const float *filtered, const float *near, const float *far)
{
    __m256 f = _mm256_loadu_ps(filtered), beta = _mm256_permute_ps(f, 0xff);
    __m256 up = between(between(both(near), both(far)), between(beside(near), beside(far)));
    return _mm256_add_ps(f, _mm256_mul_ps(beta, _mm256_sub_ps(up, f)));
}

void lull_blend_avx2(float *out, unsigned channels, const float *filtered, const float *near,
                     const float *far, unsigned pairs)
{
    float last[8];
    if (channels == 4) {
        for (; pairs; pairs--, out += 8, filtered += 8, near += 4, far += 4)
            _mm256_storeu_ps(out, _mm256_blend_ps(blended(filtered, near, far),
                                                  _mm256_setzero_ps(), 0x88));
        return;
    }
    for (; pairs > 1; pairs--, out += 6, filtered += 8, near += 4, far += 4) {
        __m256 v = blended(filtered, near, far);
        _mm_storeu_ps(out, _mm256_castps256_ps128(v));
        _mm_storeu_ps(out + 3, _mm256_extractf128_ps(v, 1)); /* the next pair's store mends it */
    }
    if (!pairs)
        return;
    _mm256_storeu_ps(last, blended(filtered, near, far));
    memcpy(out, last, 3 * sizeof(float));
    memcpy(out + 3, last + 4, 3 * sizeof(float));
}

LULL_INLINE __m256 modulated(__m256 v, __m256 smooth, __m256 unscale)
{
    v = _mm256_max_ps(_mm256_mul_ps(v, smooth), _mm256_setzero_ps());
    v = _mm256_min_ps(above(v, 0x00800000), _mm256_set1_ps(LULL_LARGEST));
    return _mm256_mul_ps(v, unscale);
}

void lull_modulate_avx2(float *out, const float *v, const float *smooth, float unscale, size_t n)
{
    __m256 factor = _mm256_set1_ps(unscale);
    float last[3][8] = {{0}};
    for (; n >= 8; n -= 8, out += 8, v += 8, smooth += 8)
        _mm256_storeu_ps(out, modulated(_mm256_loadu_ps(v), _mm256_loadu_ps(smooth), factor));
    if (!n)
        return;
    memcpy(last[0], v, n * sizeof *v);
    memcpy(last[1], smooth, n * sizeof *v);
    _mm256_storeu_ps(last[2],
                     modulated(_mm256_loadu_ps(last[0]), _mm256_loadu_ps(last[1]), factor));
    memcpy(out, last[2], n * sizeof *out);
}
