/* 2x2 maximum. */
#include "port_sse41.h"

#define POOL_F32 lull_pool_f32_sse41
#define POOL_U8 lull_pool_u8_sse41
#define LANES 4u
typedef __m128 floats;

LULL_INLINE floats load_floats(const float *p) { return _mm_loadu_ps(p); }
LULL_INLINE void store_floats(float *p, floats v) { _mm_storeu_ps(p, v); }
LULL_INLINE floats most_floats(floats a, floats b) { return _mm_max_ps(a, b); }

#include "pool_u8.h"

#include "../pool_rows.h"
