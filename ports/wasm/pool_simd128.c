/* 2x2 maximum. */
#include <wasm_simd128.h>

#include "port_simd128.h"

#define POOL_F32 lull_pool_f32_simd128
#define POOL_U8 lull_pool_u8_simd128
#define LANES 4u
typedef v128_t floats;
typedef v128_t codes;

LULL_INLINE floats load_floats(const float *p) { return wasm_v128_load(p); }
LULL_INLINE void store_floats(float *p, floats v) { wasm_v128_store(p, v); }
/* pmax(b, a) is b < a ? a : b. */
LULL_INLINE floats most_floats(floats a, floats b) { return wasm_f32x4_pmax(b, a); }

LULL_INLINE codes load_16(const uint8_t *p) { return wasm_v128_load(p); }
LULL_INLINE codes load_8(const uint8_t *p) { return wasm_v128_load64_zero(p); }
LULL_INLINE void store_16(uint8_t *p, codes v) { wasm_v128_store(p, v); }
LULL_INLINE void store_8(uint8_t *p, codes v) { wasm_v128_store64_lane(p, v, 0); }
LULL_INLINE codes most_codes(codes a, codes b) { return wasm_u8x16_max(a, b); }

#include "../pool_rows.h"
