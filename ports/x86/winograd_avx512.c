/* Winograd's form in vectors of 16 channels. */
#include "port_avx512.h"

#define LANES 16u
typedef __m512 vec;

LULL_INLINE vec zeros(void) { return _mm512_setzero_ps(); }
LULL_INLINE vec add(vec a, vec b) { return _mm512_add_ps(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return _mm512_sub_ps(a, b); }
LULL_INLINE vec most(vec a, vec b) { return _mm512_max_ps(a, b); }
LULL_INLINE vec madd(vec x, float k, vec y) { return _mm512_fmadd_ps(x, _mm512_set1_ps(k), y); }

LULL_INLINE vec load(const float *p, unsigned n)
{
    return n >= LANES ? _mm512_loadu_ps(p) : _mm512_maskz_loadu_ps((__mmask16)((1u << n) - 1), p);
}

LULL_INLINE void store(float *p, vec v, unsigned n)
{
    if (n >= LANES)
        _mm512_storeu_ps(p, v);
    else
        _mm512_mask_storeu_ps(p, (__mmask16)((1u << n) - 1), v);
}

#define IN lull_winograd_in_avx512
#define OUT lull_winograd_out_avx512
#include "../winograd_rows.h"
