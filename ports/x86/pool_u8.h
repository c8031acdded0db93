/* What pool_rows.h wants of codes, in vectors of 128 bits. */
typedef __m128i codes;

LULL_INLINE codes load_16(const uint8_t *p)
{
    return _mm_loadu_si128((const __m128i *)(const void *)p);
}
LULL_INLINE codes load_8(const uint8_t *p)
{
    return _mm_loadl_epi64((const __m128i *)(const void *)p);
}
LULL_INLINE void store_16(uint8_t *p, codes v) { _mm_storeu_si128((__m128i *)(void *)p, v); }
LULL_INLINE void store_8(uint8_t *p, codes v) { _mm_storel_epi64((__m128i *)(void *)p, v); }
LULL_INLINE codes most_codes(codes a, codes b) { return _mm_max_epu8(a, b); }
