/* 2x2 maximum. */
#include "port_avx2.h"

#define POOL_F32 lull_pool_f32_avx2
#define POOL_U8 lull_pool_u8_avx2
#define LANES 8u
typedef __m256 floats;

LULL_INLINE floats load_floats(const float *p) { return _mm256_loadu_ps(p); }
LULL_INLINE void store_floats(float *p, floats v) { _mm256_storeu_ps(p, v); }
LULL_INLINE floats most_floats(floats a, floats b) { return _mm256_max_ps(a, b); }

#include "pool_u8.h"

#include "../pool_rows.h"
