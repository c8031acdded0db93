/* Family K's filter with vectors of 4. */
#include <arm_neon.h>

#include "port_neon.h"

#if defined(__aarch64__) /* see port_neon.c */

#define NAME(op) lull_##op##_neon
#define LANES 4u
typedef float32x4_t vec;
typedef int32x4_t ivec;

LULL_INLINE vec set(float v) { return vdupq_n_f32(v); }
LULL_INLINE vec load_n(const float *p, unsigned n)
{
    float part[LANES] = {0};
    if (n < LANES) {
        memcpy(part, p, n * sizeof *p);
        p = part;
    }
    return vld1q_f32(p);
}
LULL_INLINE void store_n(float *p, vec v, unsigned n)
{
    float part[LANES];
    vst1q_f32(n < LANES ? part : p, v);
    if (n < LANES)
        memcpy(p, part, n * sizeof *p);
}
LULL_INLINE vec add(vec a, vec b) { return vaddq_f32(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return vsubq_f32(a, b); }
LULL_INLINE vec mul(vec a, vec b) { return vmulq_f32(a, b); }
LULL_INLINE vec quotient(vec a, vec b) { return vdivq_f32(a, b); }
LULL_INLINE vec low(vec a, vec b) { return vbslq_f32(vcltq_f32(a, b), a, b); }
LULL_INLINE vec high(vec a, vec b) { return vbslq_f32(vcgtq_f32(a, b), a, b); }
LULL_INLINE ivec ints(vec v) { return vreinterpretq_s32_f32(v); }
LULL_INLINE vec floats(ivec v) { return vreinterpretq_f32_s32(v); }
LULL_INLINE vec if_true(uint32x4_t is, vec v)
{
    return vreinterpretq_f32_u32(vandq_u32(is, vreinterpretq_u32_f32(v)));
}
LULL_INLINE vec above(vec v, int least)
{
    return if_true(vcgtq_s32(ints(v), vdupq_n_s32(least)), v);
}
LULL_INLINE vec choose(vec if_positive, vec v, vec other)
{
    return vbslq_f32(vcgtq_f32(if_positive, vdupq_n_f32(0.0f)), v, other);
}
LULL_INLINE ivec whole(vec v) { return vcvtq_s32_f32(v); }
LULL_INLINE vec number(ivec v) { return vcvtq_f32_s32(v); }
LULL_INLINE ivec set_int(int v) { return vdupq_n_s32(v); }
LULL_INLINE ivec sub_int(ivec a, ivec b) { return vsubq_s32(a, b); }
LULL_INLINE ivec add_int(ivec a, ivec b) { return vaddq_s32(a, b); }
LULL_INLINE ivec or_int(ivec a, ivec b) { return vorrq_s32(a, b); }
LULL_INLINE ivec and_int(ivec a, ivec b) { return vandq_s32(a, b); }
#define shift_left(v, n) vshlq_n_s32(v, n)
#define shift_right(v, n) vreinterpretq_s32_u32(vshrq_n_u32(vreinterpretq_u32_s32(v), n))
#define shift_sign(v, n) vshrq_n_s32(v, n)
LULL_INLINE vec is_number(vec v) { return if_true(vceqq_f32(v, v), v); }

LULL_INLINE void split(const float *p, unsigned n, vec *a, vec *b, vec *c)
{
    float part[3 * LANES] = {0};
    float32x4x3_t v;
    if (n < LANES) {
        memcpy(part, p, 3 * n * sizeof *p);
        p = part;
    }
    v = vld3q_f32(p);
    *a = v.val[0], *b = v.val[1], *c = v.val[2];
}

LULL_INLINE void join(float *p, unsigned n, vec a, vec b, vec c)
{
    float part[3 * LANES];
    float32x4x3_t v;
    v.val[0] = a, v.val[1] = b, v.val[2] = c;
    vst3q_f32(n < LANES ? part : p, v);
    if (n < LANES)
        memcpy(p, part, 3 * n * sizeof *p);
}

LULL_INLINE void split_pairs(vec a, vec b, vec *even, vec *odd)
{
    *even = vuzp1q_f32(a, b);
    *odd = vuzp2q_f32(a, b);
}

LULL_INLINE void join_pairs(vec even, vec odd, vec *a, vec *b)
{
    *a = vzip1q_f32(even, odd);
    *b = vzip2q_f32(even, odd);
}

LULL_INLINE vec four(float a, float b, float c, float d)
{
    const float v[LANES] = {a, b, c, d};
    return vld1q_f32(v);
}

typedef const float *tables;

LULL_INLINE void tables_init(tables *t, const float *table) { *t = table; }

LULL_INLINE vec weights(const tables *t, ivec q)
{
    const float *table = *t;
#define VALUE(i) table[(uint8_t)vgetq_lane_s32(q, i)]
    return four(VALUE(0), VALUE(1), VALUE(2), VALUE(3));
#undef VALUE
}

LULL_INLINE ivec codes_at(const uint8_t *q, size_t step, unsigned n)
{
#define CODE(i) (int32_t)lull_load_u32(q + lull_min_u(i, n - 1) * step)
    const int32_t v[LANES] = {CODE(0), CODE(1), CODE(2), CODE(3)};
#undef CODE
    return vld1q_s32(v);
}

LULL_INLINE vec values_at(const float *table, const uint8_t *q, size_t step, unsigned n)
{
    vec v = vld1q_dup_f32(table + q[0]);
#define VALUE(i) v = vld1q_lane_f32(table + q[lull_min_u(i, n - 1) * step], v, i)
    VALUE(1), VALUE(2), VALUE(3);
#undef VALUE
    return v;
}

LULL_INLINE vec look_up(const float *table, const uint8_t *q, unsigned n)
{
    return values_at(table, q, 1, n);
}

/* The first `count` of 8 bytes, zeros after them. */
LULL_INLINE uint8x8_t load_bytes(const uint8_t *p, unsigned count)
{
    uint8_t part[8] = {0};
    if (count < 8) {
        memcpy(part, p, count);
        p = part;
    }
    return vld1_u8(p);
}

LULL_INLINE vec bytes(const uint8_t *p, unsigned n)
{
    return vcvtq_f32_u32(vmovl_u16(vget_low_u16(vmovl_u8(load_bytes(p, n)))));
}

LULL_INLINE void put_bytes(uint8_t *p, ivec q, unsigned n)
{
    uint16x4_t words = vmovn_u32(vreinterpretq_u32_s32(q));
    uint8_t part[8];
    vst1_u8(part, vmovn_u16(vcombine_u16(words, words)));
    memcpy(p, part, n);
}

LULL_INLINE ivec pairs(const uint8_t *p, unsigned n)
{
    return vreinterpretq_s32_u16(vmovl_u8(load_bytes(p, 2 * n)));
}

LULL_INLINE void put_pairs(uint8_t *p, ivec q, unsigned n)
{
    uint8_t part[8];
    vst1_u8(n < LANES ? part : p, vreinterpret_u8_u16(vmovn_u32(vreinterpretq_u32_s32(q))));
    if (n < LANES)
        memcpy(p, part, 2 * n);
}

LULL_INLINE ivec squares_of_pairs(ivec a, ivec b)
{
    int16x8_t d = vsubq_s16(vreinterpretq_s16_s32(a), vreinterpretq_s16_s32(b));
    return vreinterpretq_s32_u32(vpaddlq_u16(vreinterpretq_u16_s16(vmulq_s16(d, d))));
}

LULL_INLINE void around(const float *p, vec *before, vec *after)
{
    *before = vdupq_n_f32(p[0]);
    *after = vdupq_n_f32(p[1]);
}

#include "../filter_rows.h"

#include "../bilateral_rows.h"
#include "../means_rows.h"
#include "../regression_rows.h"

#include "../grain_rows.h"

#endif
