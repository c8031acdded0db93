/* Family K's filter with vectors of 4. */
#include <wasm_simd128.h>

#include "port_simd128.h"

#define NAME(op) lull_##op##_simd128
#define LANES 4u
typedef v128_t vec;
typedef v128_t ivec;

LULL_INLINE vec set(float v) { return wasm_f32x4_splat(v); }
LULL_INLINE vec load(const float *p) { return wasm_v128_load(p); }
LULL_INLINE void store(float *p, vec v) { wasm_v128_store(p, v); }

#include "../parts_rows.h"

LULL_INLINE vec add(vec a, vec b) { return wasm_f32x4_add(a, b); }
LULL_INLINE vec sub(vec a, vec b) { return wasm_f32x4_sub(a, b); }
LULL_INLINE vec mul(vec a, vec b) { return wasm_f32x4_mul(a, b); }
LULL_INLINE vec quotient(vec a, vec b) { return wasm_f32x4_div(a, b); }
/* pmin(b, a) is a < b ? a : b. */
LULL_INLINE vec low(vec a, vec b) { return wasm_f32x4_pmin(b, a); }
LULL_INLINE vec high(vec a, vec b) { return wasm_f32x4_pmax(b, a); }
LULL_INLINE ivec ints(vec v) { return v; }
LULL_INLINE vec floats(ivec v) { return v; }
LULL_INLINE vec above(vec v, int least)
{
    return wasm_v128_and(v, wasm_i32x4_gt(v, wasm_i32x4_splat(least)));
}
LULL_INLINE vec choose(vec if_positive, vec v, vec other)
{
    return wasm_v128_bitselect(v, other, wasm_f32x4_gt(if_positive, set(0.0f)));
}
LULL_INLINE ivec whole(vec v) { return wasm_i32x4_trunc_sat_f32x4(v); }
LULL_INLINE vec number(ivec v) { return wasm_f32x4_convert_i32x4(v); }
LULL_INLINE ivec set_int(int v) { return wasm_i32x4_splat(v); }
LULL_INLINE ivec sub_int(ivec a, ivec b) { return wasm_i32x4_sub(a, b); }
LULL_INLINE ivec add_int(ivec a, ivec b) { return wasm_i32x4_add(a, b); }
LULL_INLINE ivec or_int(ivec a, ivec b) { return wasm_v128_or(a, b); }
LULL_INLINE ivec and_int(ivec a, ivec b) { return wasm_v128_and(a, b); }
#define shift_left(v, n) wasm_i32x4_shl(v, n)
#define shift_right(v, n) wasm_u32x4_shr(v, n)
#define shift_sign(v, n) wasm_i32x4_shr(v, n)
LULL_INLINE vec is_number(vec v) { return wasm_v128_and(v, wasm_f32x4_eq(v, v)); }

LULL_INLINE void split(const float *p, unsigned n, vec *a, vec *b, vec *c)
{
    float part[3 * LANES] = {0};
    vec x, y, z;
    if (n < LANES)
        p = copy_pixels(part, p, n);
    x = wasm_v128_load(p), y = wasm_v128_load(p + 4), z = wasm_v128_load(p + 8);
    *a = wasm_i32x4_shuffle(wasm_i32x4_shuffle(x, y, 0, 3, 6, 6), z, 0, 1, 2, 5);
    *b = wasm_i32x4_shuffle(wasm_i32x4_shuffle(x, y, 1, 4, 7, 7), z, 0, 1, 2, 6);
    *c = wasm_i32x4_shuffle(wasm_i32x4_shuffle(x, y, 2, 5, 5, 5), z, 0, 1, 4, 7);
}

LULL_INLINE void join(float *p, unsigned n, vec a, vec b, vec c)
{
    float part[3 * LANES], *to = n < LANES ? part : p;
    vec x = wasm_i32x4_shuffle(a, b, 0, 4, 1, 1), y = wasm_i32x4_shuffle(b, c, 1, 5, 2, 2);
    vec z = wasm_i32x4_shuffle(c, a, 2, 7, 3, 3);
    wasm_v128_store(to, wasm_i32x4_shuffle(x, c, 0, 1, 4, 2));
    wasm_v128_store(to + 4, wasm_i32x4_shuffle(y, a, 0, 1, 6, 2));
    wasm_v128_store(to + 8, wasm_i32x4_shuffle(z, b, 0, 1, 7, 2));
    if (n < LANES)
        copy_pixels(p, part, n);
}

LULL_INLINE void split_pairs(vec a, vec b, vec *even, vec *odd)
{
    *even = wasm_i32x4_shuffle(a, b, 0, 2, 4, 6);
    *odd = wasm_i32x4_shuffle(a, b, 1, 3, 5, 7);
}

LULL_INLINE void join_pairs(vec even, vec odd, vec *a, vec *b)
{
    *a = wasm_i32x4_shuffle(even, odd, 0, 4, 1, 5);
    *b = wasm_i32x4_shuffle(even, odd, 2, 6, 3, 7);
}

typedef const float *tables;

LULL_INLINE void tables_init(tables *t, const float *table) { *t = table; }

LULL_INLINE vec weights(const tables *t, ivec q)
{
#define VALUE(i) (*t)[wasm_i32x4_extract_lane(q, i) & 255]
    return wasm_f32x4_make(VALUE(0), VALUE(1), VALUE(2), VALUE(3));
#undef VALUE
}

LULL_INLINE ivec codes_at(const uint8_t *q, size_t step, unsigned n)
{
#define CODE(i) (int32_t)lull_load_u32(q + lull_min_u(i, n - 1) * step)
    return wasm_i32x4_make(CODE(0), CODE(1), CODE(2), CODE(3));
#undef CODE
}

LULL_INLINE vec values_at(const float *table, const uint8_t *q, size_t step, unsigned n)
{
    vec v = wasm_v128_load32_splat(table + q[0]);
#define VALUE(i) v = wasm_v128_load32_lane(table + q[lull_min_u(i, n - 1) * step], v, i)
    VALUE(1), VALUE(2), VALUE(3);
#undef VALUE
    return v;
}

LULL_INLINE vec look_up(const float *table, const uint8_t *q, unsigned n)
{
    return values_at(table, q, 1, n);
}

/* Four groups of `size` bytes, 1 or 2, of which n are read, as integers. */
LULL_INLINE ivec load_groups(const uint8_t *p, size_t size, unsigned n)
{
    uint8_t part[8] = {0};
    memcpy(part, p, n * size);
    return wasm_v128_load64_zero(part);
}

LULL_INLINE vec bytes(const uint8_t *p, unsigned n)
{
    ivec v = n == LANES ? wasm_v128_load32_zero(p) : load_groups(p, 1, n);
    return number(wasm_u32x4_extend_low_u16x8(wasm_u16x8_extend_low_u8x16(v)));
}

LULL_INLINE void put_bytes(uint8_t *p, ivec q, unsigned n)
{
    uint32_t part;
    q = wasm_u16x8_narrow_i32x4(q, q);
    part = (uint32_t)wasm_i32x4_extract_lane(wasm_u8x16_narrow_i16x8(q, q), 0);
    if (n == LANES)
        memcpy(p, &part, LANES);
    else
        memcpy(p, &part, n);
}

LULL_INLINE ivec pairs(const uint8_t *p, unsigned n)
{
    return wasm_u16x8_extend_low_u8x16(n == LANES ? wasm_v128_load64_zero(p)
                                                  : load_groups(p, 2, n));
}

LULL_INLINE void put_pairs(uint8_t *p, ivec q, unsigned n)
{
    uint64_t part;
    q = wasm_i8x16_shuffle(q, q, 0, 1, 4, 5, 8, 9, 12, 13, 0, 1, 4, 5, 8, 9, 12, 13);
    part = (uint64_t)wasm_i64x2_extract_lane(q, 0);
    if (n == LANES)
        memcpy(p, &part, 2 * LANES);
    else
        memcpy(p, &part, 2 * n);
}

LULL_INLINE ivec squares_of_pairs(ivec a, ivec b)
{
    v128_t d = wasm_i16x8_sub(a, b);
    return wasm_i32x4_dot_i16x8(d, d);
}

LULL_INLINE void around(const float *p, vec *before, vec *after)
{
    *before = set(p[0]);
    *after = set(p[1]);
}

#include "../filter_rows.h"

#include "../bilateral_rows.h"
#include "../means_rows.h"
#include "../regression_rows.h"

#include "../grain_rows.h"
