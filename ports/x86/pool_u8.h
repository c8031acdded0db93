/* 2x2 maximum of codes, in vectors of 128 bits. The including file defines POOL_U8, the function's
 * name. */
LULL_INLINE __m128i load_16(const uint8_t *p)
{
    return _mm_loadu_si128((const __m128i *)(const void *)p);
}

LULL_INLINE __m128i load_8(const uint8_t *p)
{
    return _mm_loadl_epi64((const __m128i *)(const void *)p);
}

LULL_INLINE __m128i max_4(__m128i a, __m128i b, __m128i c, __m128i d)
{
    return _mm_max_epu8(_mm_max_epu8(a, b), _mm_max_epu8(c, d));
}

void POOL_U8(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
             unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 16 <= channels; c += 16)
            _mm_storeu_si128((__m128i *)(void *)(out + c),
                             max_4(load_16(above + c), load_16(above + channels + c),
                                   load_16(below + c), load_16(below + channels + c)));
        for (; c + 8 <= channels; c += 8)
            _mm_storel_epi64((__m128i *)(void *)(out + c),
                             max_4(load_8(above + c), load_8(above + channels + c),
                                   load_8(below + c), load_8(below + channels + c)));
        for (; c < channels; c++) {
            uint8_t a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            uint8_t b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}
