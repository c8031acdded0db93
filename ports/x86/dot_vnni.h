/* The products of AVX512-VNNI. As intrinsics, gcc 12 moves the sums around in memory. */
#if LULL_X86_ASM
#define DOT_NARROW(sum, x, w) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#define DOT_WIDE(sum, x, w) __asm__("vpdpwssd %2, %1, %0" : "+v"(sum) : "v"(x), "v"(w))
#define DOT_HALF(sum, x, w) __asm__("vpdpbusd %t2, %t1, %t0" : "+v"(sum) : "v"(x), "v"(w))
#else
#define DOT_NARROW(sum, x, w) sum = _mm512_dpbusd_epi32(sum, x, w)
#define DOT_WIDE(sum, x, w) sum = _mm512_dpwssd_epi32(sum, x, w)
#define DOT_HALF(sum, x, w)                                                      \
    sum = _mm512_castsi256_si512(_mm256_dpbusd_epi32(_mm512_castsi512_si256(sum), \
                                                     _mm512_castsi512_si256(x),  \
                                                     _mm512_castsi512_si256(w)))
#endif
