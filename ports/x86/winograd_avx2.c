/* Winograd's form in vectors of 8 channels. */
#include "port_avx2.h"

#define LANES 8u
typedef __m256 vec;

LULL_INLINE vec zeros(void) { return _mm256_setzero_ps(); }
LULL_INLINE vec add(vec a, vec b) { return _mm256_add_ps(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm256_sub_ps(a, b); }
LULL_INLINE vec most(vec a, vec b) { return _mm256_max_ps(a, b); }
LULL_INLINE vec madd(vec x, float k, vec y) { return _mm256_fmadd_ps(x, _mm256_set1_ps(k), y); }

LULL_INLINE __m256i first(unsigned n)
{
    return _mm256_cmpgt_epi32(_mm256_set1_epi32((int)n), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
}

LULL_INLINE vec load(const float *p, unsigned n)
{
    return n >= LANES ? _mm256_loadu_ps(p) : _mm256_maskload_ps(p, first(n));
}

LULL_INLINE void store(float *p, vec v, unsigned n)
{
    if (n >= LANES)
        _mm256_storeu_ps(p, v);
    else
        _mm256_maskstore_ps(p, first(n), v);
}

#define IN lull_winograd_in_avx2
#define OUT lull_winograd_out_avx2
#include "../winograd_rows.h"
