/* Integer sums in vectors of 8 outputs, requantised. */
#ifndef LULL_X86_REQUANTISE_256_H
#define LULL_X86_REQUANTISE_256_H

#include "base.h"
#include "intrinsics.h"

/* (a * M + 2^30) >> 31 as the high half of a * 2M + 2^31, which always fits. even, odd: 2M of the
 * even lanes, and of the odd ones, in even lanes. */
LULL_INLINE __m256i requantise(__m256i a, __m256i even, __m256i odd)
{
    const __m256i half = _mm256_set1_epi64x((long long)1 << 31);
    __m256i q0 = _mm256_add_epi64(_mm256_mul_epi32(a, even), half);
    __m256i q1 = _mm256_add_epi64(_mm256_mul_epi32(_mm256_srli_epi64(a, 32), odd), half);
    return _mm256_blend_epi32(_mm256_srli_epi64(q0, 32), q1, 0xaa);
}

/* Sums that a float holds, by multipliers that a float holds (`scale`: them times 2^-31): the
 * product with 0.5 added, rounded down once, is cut to the same integer as the definition's.
 * Instructions of 256 bits take the rounding from a register, so this is right between round_down
 * and round_as alone. What is computed before and after goes through memory, so it stays there. */
#if defined(__GNUC__)
#define LULL_X86_FENCE __asm__ volatile("" ::: "memory")
#else
#define LULL_X86_FENCE (void)0
#endif
LULL_INLINE unsigned round_down(void)
{
    unsigned before = _mm_getcsr();
    _mm_setcsr(((before | _MM_MASK_MASK) & ~(unsigned)_MM_ROUND_MASK) | _MM_ROUND_DOWN);
    LULL_X86_FENCE;
    return before;
}
LULL_INLINE void round_as(unsigned before)
{
    LULL_X86_FENCE;
    _mm_setcsr(before);
}
LULL_INLINE __m256i small_scale(__m256i multiplier)
{
    return _mm256_castps_si256(
        _mm256_mul_ps(_mm256_cvtepi32_ps(multiplier), _mm256_set1_ps(1.0f / 2147483648.0f)));
}
LULL_INLINE __m256i requantise_small(__m256i a, __m256i scale)
{
    return _mm256_cvttps_epi32(_mm256_fmadd_ps(_mm256_cvtepi32_ps(a), _mm256_castsi256_ps(scale),
                                               _mm256_set1_ps(0.5f)));
}

#endif
