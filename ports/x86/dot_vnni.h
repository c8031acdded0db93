/* The products of AVX512-VNNI. As intrinsics, gcc 12 moves the sums around in memory, and so does
 * clang 14 those of halves; clang 18 and later print other registers than the halves of zmm16 and
 * above for %t. */
#if LULL_X86_ASM
#define DOT_NARROW(sum, x, w) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#define DOT_WIDE(sum, x, w) __asm__("vpdpwssd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#if defined(__clang__)
#define DOT_HALF(sum, x, w)                                                                     \
    do {                                                                                        \
        __m256i half = _mm512_castsi512_si256(sum);                                             \
        __asm__("vpdpbusd %2, %1, %0"                                                           \
                : "+v"(half)                                                                    \
                : "v"(_mm512_castsi512_si256(x)), "v"(_mm512_castsi512_si256(w)));              \
        sum = _mm512_castsi256_si512(half);                                                     \
    } while (0)
#else
#define DOT_HALF(sum, x, w) __asm__("vpdpbusd %t2, %t1, %t0" : "+v"(sum) : "v"(x), "v"(w))
#endif
#else
#define DOT_NARROW(sum, x, w) sum = _mm512_dpbusd_epi32(sum, x, w)
#define DOT_WIDE(sum, x, w) sum = _mm512_dpwssd_epi32(sum, x, w)
#define DOT_HALF(sum, x, w)                                                      \
    sum = _mm512_castsi256_si512(_mm256_dpbusd_epi32(_mm512_castsi512_si256(sum), \
                                                     _mm512_castsi512_si256(x),  \
                                                     _mm512_castsi512_si256(w)))
#endif
