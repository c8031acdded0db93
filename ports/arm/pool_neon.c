/* 2x2 maximum. */
#include <arm_neon.h>

#include "port_neon.h"

#define POOL_F32 lull_pool_f32_neon
#define POOL_U8 lull_pool_u8_neon
#define LANES 4u
typedef float32x4_t floats;
typedef uint8x16_t codes;

LULL_INLINE floats load_floats(const float *p) { return vld1q_f32(p); }
LULL_INLINE void store_floats(float *p, floats v) { vst1q_f32(p, v); }
LULL_INLINE floats most_floats(floats a, floats b) { return vmaxq_f32(a, b); }

LULL_INLINE codes load_16(const uint8_t *p) { return vld1q_u8(p); }
LULL_INLINE codes load_8(const uint8_t *p) { return vcombine_u8(vld1_u8(p), vdup_n_u8(0)); }
LULL_INLINE void store_16(uint8_t *p, codes v) { vst1q_u8(p, v); }
LULL_INLINE void store_8(uint8_t *p, codes v) { vst1_u8(p, vget_low_u8(v)); }
LULL_INLINE codes most_codes(codes a, codes b) { return vmaxq_u8(a, b); }

#include "../pool_rows.h"
