/* Winograd's form in vectors of 4 channels. */
#include <arm_neon.h>
#include <string.h>

#include "port_neon.h"

#if defined(__aarch64__) /* see port_neon.c */

#define LANES 4u
typedef float32x4_t vec;

LULL_INLINE vec zeros(void) { return vdupq_n_f32(0.0f); }
LULL_INLINE vec add(vec a, vec b) { return vaddq_f32(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return vsubq_f32(a, b); }
LULL_INLINE vec most(vec a, vec b) { return vbslq_f32(vcgtq_f32(a, b), a, b); } /* b for NaN */
LULL_INLINE vec madd(vec x, float k, vec y) { return vfmaq_n_f32(y, x, k); }

LULL_INLINE vec load(const float *p, unsigned n)
{
    if (n < LANES) {
        float some[LANES] = {0};

        memcpy(some, p, n * sizeof *p);
        return vld1q_f32(some);
    }
    return vld1q_f32(p);
}

LULL_INLINE void store(float *p, vec v, unsigned n)
{
    if (n < LANES) {
        float all[LANES];

        vst1q_f32(all, v);
        memcpy(p, all, n * sizeof *p);
    } else
        vst1q_f32(p, v);
}

#define IN lull_winograd_in_neon
#define OUT lull_winograd_out_neon
#include "../winograd_rows.h"

#endif
