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

#endif
