/* Curves of the transfer functions, for loops that compilers make vectors of.
 *
 * Outline: log2 and 2^x are short polynomials (minimax, fitted for this file) around exact
 * reductions of the argument; where a product would lose bits before an exponential, its
 * constant is split so that the leading part of the product is exact. Pieces of a curve are all
 * computed and chosen with bit masks, and values pass in blocks of a fixed size, so that
 * compilers vectorise every loop with the same operations in the same order as scalar code. */
#ifndef LULL_CURVES_H
#define LULL_CURVES_H

#include <float.h>

#include "kernels.h"

/* 16: floats as they are, beside a type of 16 bits. */
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "single arithmetic with excess precision: use SSE on x86, -fexcess-precision=fast on s390x"
#endif

#define BLOCK 48u /* values per call of a curve */

#define BITS_MIN INT32_C(0x00800000) /* FLT_MIN */

/* All ones if a > b, else 0. */
LULL_INLINE uint32_t mask_greater(int32_t a, int32_t b) { return 0u - (uint32_t)(a > b); }

LULL_INLINE int32_t signed_bits(float f) { return (int32_t)lull_bits(f); }

/* mask ? a : b, for masks of all ones or zeros. */
LULL_INLINE float choose(uint32_t mask, float a, float b)
{
    return lull_float((lull_bits(a) & mask) | (lull_bits(b) & ~mask));
}

/* Subnormal and negative values to 0, so that CPUs which flush subnormals give the same bits. */
LULL_INLINE float flush_input(float v)
{
    return lull_float(lull_bits(v) & mask_greater(signed_bits(v), BITS_MIN - 1));
}

/* The same for results. FLT_MIN goes too: CPUs disagree whether it underflowed before rounding. */
LULL_INLINE float flush_output(float v)
{
    return lull_float(lull_bits(v) & mask_greater(signed_bits(v), BITS_MIN));
}

/* v, at most `limit`; positive NaN and infinity to `limit`. */
LULL_INLINE float at_most(float v, float limit)
{
    return choose(mask_greater(signed_bits(v), signed_bits(limit)), limit, v);
}

/* Nearest integer of |t| < 2^22, as float. */
LULL_INLINE float nearest(float t)
{
    const float magic = 12582912.0f; /* 1.5 * 2^23: its ulp is 1 */
    return (t + magic) - magic;
}

/* A logarithm in two parts, whole + part, with part in [-0.5, 0.5]. */
typedef struct lull_logarithm {
    float whole, part;
} lull_logarithm;

/* log2(x), x finite >= FLT_MIN. With s = (m-1)/(m+1), log2(m) = 2/ln(2) * atanh(s), an odd series.
 */
LULL_INLINE lull_logarithm lull_log2_parts(float x)
{
    lull_logarithm l;
    float m = lull_mantissa(x, &l.whole);
    float s = (m - 1.0f) / (m + 1.0f);
    float w = s * s;
    float p = (0.431737901252f * w + 0.576714309537f) * (w * w)
              + (0.961798848299f * w + 2.88539007979f);
    l.part = s * p;
    return l;
}

/* 2^r - 1 for r in [-0.5, 0.5] and a little more. */
LULL_INLINE float exp2m1_part(float r)
{
    float s = r * r;
    float p = (0.000154035123298f * r + 0.00133908498473f) * s +
              (0.00961823792896f * r + 0.0555035721998f);
    return (p * s + (0.240226497895f * r + 0.693147187971f)) * r;
}

/* 2^n, n in [-126, 127]. */
LULL_INLINE float power_of_two(int32_t n) { return lull_float((uint32_t)(n + 127) << 23); }

/* v * 2^n, n in [-252, 254]; overflows to infinity. */
LULL_INLINE float scale_wide(float v, int32_t n)
{
    int32_t half = n >> 1;
    return v * power_of_two(half) * power_of_two(n - half);
}

/* z^(high + low) for z in [FLT_MIN, FLT_MAX]; |high * log2(z)| < 190. `high` has 12 significant
 * bits, so its product with the whole part of the logarithm is exact. */
LULL_INLINE float power(float z, float high, float low)
{
    lull_logarithm l = lull_log2_parts(z);
    float n = nearest((high + low) * (l.whole + l.part));
    float r = (high * l.whole - n) + (low * l.whole + (high + low) * l.part);
    return scale_wide(1.0f + exp2m1_part(r), (int32_t)n);
}

/* ---- Curves ---------------------------------------------------------------------------------- */

LULL_INLINE float linear(float v) { return flush_input(v); }

/* y <= 0.0031308: 12.92 y; else 1.055 y^(1/2.4) - 0.055 */
LULL_INLINE float srgb_forward(float y)
{
    float v = flush_input(y);
    float z = choose(mask_greater(signed_bits(v), BITS_MIN), v, FLT_MIN);
    float high = 1.055f * power(z, 0x1.aaap-2f, 0x1.555556p-15f) - 0.055f; /* 1/2.4 in two parts */
    return choose(mask_greater(signed_bits(v), signed_bits(0.0031308f)), high, 12.92f * v);
}

/* x <= 0.04045: x / 12.92; else ((x + 0.055) / 1.055)^2.4. From 2^53.75 it overflows. */
LULL_INLINE float srgb_inverse(float x)
{
    float v = at_most(flush_input(x), 0x1p54f);
    float high = power((v + 0.055f) * (1.0f / 1.055f), 0x1.332p+1f, 0x1.333334p-11f); /* 2.4 */
    return flush_output(
        choose(mask_greater(signed_bits(v), signed_bits(0.04045f)), high, v * (1.0f / 12.92f)));
}

/* The PU curve and its constants, N = 1/X = 1 / f(65504):
 *     y <= y0: a y;   y <= y1: b y^c + d;   else e ln(y + f) + g
 * a 1412.83765  b 1.64593172  c 0.431384981  d -0.00294139609  e 0.192653254  f 0.00626026094
 * g 0.998620152  y0 1.57945760e-6  y1 0.0322087631; x0 = f(y0), x1 = f(y1); X = 3.13511903584.
 * Both upper pieces share one logarithm forward, and one exponential back. The last piece is also
 * there alone: most blocks of a picture need no other. */
#define PU_Y0 1.57945760e-06f
#define PU_Y1 3.22087631e-02f
#define PU_X0 7.1178066430e-04f /* x0 N */
#define PU_X1 1.1832876033e-01f /* x1 N */
#define PU_F 6.26026094e-03f
#define PU_C_HIGH 0x1.b9ap-2f /* c in two parts */
#define PU_C_LOW 0x1.cfc058p-14f

LULL_INLINE float pu_forward_upper(float y)
{
    lull_logarithm l = lull_log2_parts(y + PU_F);
    return 0.042593936086398f * (l.whole + l.part) + 0.31852702898491f; /* e ln(2) N, gN */
}

LULL_INLINE float pu_forward(float y)
{
    float v = flush_input(y);
    uint32_t upper = mask_greater(signed_bits(v), signed_bits(PU_Y1));
    uint32_t above = mask_greater(signed_bits(v), signed_bits(PU_Y0));
    lull_logarithm l = lull_log2_parts(choose(above, choose(upper, v + PU_F, v), PU_Y0));
    float n = nearest((PU_C_HIGH + PU_C_LOW) * (l.whole + l.part));
    float r = (PU_C_HIGH * l.whole - n) + (PU_C_LOW * l.whole + (PU_C_HIGH + PU_C_LOW) * l.part);
    float middle = (0.52499815834241f * (1.0f + exp2m1_part(r))) * power_of_two((int32_t)n) -
                   0.00093820874307323f;                                      /* bN, dN */
    float high = 0.042593936086398f * (l.whole + l.part) + 0.31852702898491f; /* e ln(2) N, gN */
    return choose(above, choose(upper, high, middle), 450.6488059461f * v);   /* aN */
}

/* x <= x0: X/a x;   x <= x1: (X/b x - d/b)^(1/c);   else 2^(K x - G) - f, with K = X/(e ln 2)
 * and G = g/(e ln 2). K and G are split, and x too, so that the argument is reduced without
 * rounding. */
LULL_INLINE float pu_inverse_upper_argument(float v, float *part)
{
    const float k_high = 0x1.77ap+4f, k_low = 0x1.f62c8p-11f;
    const float g_high = 0x1.de8p+2f, g_low = 0x1.b3c2c6p-10f;
    float head = lull_float(lull_bits(v) & 0xfffff000u), tail = v - head;
    float n = nearest((k_high + k_low) * v - (g_high + g_low));
    *part = ((k_high * head - n) - g_high) + ((k_high * tail + k_low * v) - g_low);
    return n;
}

LULL_INLINE float pu_inverse_upper(float x)
{
    float r, n = pu_inverse_upper_argument(at_most(x, 6.0f), &r);
    return scale_wide(1.0f + exp2m1_part(r), (int32_t)n) - PU_F;
}

LULL_INLINE float pu_inverse(float x)
{
    float v = at_most(flush_input(x), 6.0f); /* overflows from 5.7705 */
    uint32_t upper = mask_greater(signed_bits(v), signed_bits(PU_X1));
    float r_high, n_high = pu_inverse_upper_argument(v, &r_high);
    lull_logarithm l = lull_log2_parts(1.9047685865362f * v + 0.0017870705414195f); /* X/b, -d/b */
    const float p_high = 0x1.28ap+1f, p_low = 0x1.7fe206p-11f; /* 1/c in two parts */
    float n_middle = nearest((p_high + p_low) * (l.whole + l.part));
    float r_middle = (p_high * l.whole - n_middle) + (p_low * l.whole + (p_high + p_low) * l.part);
    float n = choose(upper, n_high, n_middle);
    float r = choose(upper, r_high, r_middle);
    float y = scale_wide(1.0f + exp2m1_part(r), (int32_t)n) - choose(upper, PU_F, 0.0f);
    return flush_output(choose(mask_greater(signed_bits(v), signed_bits(PU_X0)), y,
                               0.0022190228550602f * v)); /* X/a */
}

/* ln(1 + y) N, N = 1 / ln(65505). `lost` is what the rounding of 1 + y took away. */
LULL_INLINE float log_forward(float y)
{
    float v = flush_input(y);
    float u = 1.0f + v;
    float lost = v - (u - 1.0f);
    lull_logarithm l = lull_log2_parts(u);
    return flush_output(0.062502666475519f * (l.whole + l.part) /* ln(2) N */
                        + (lost * 0.090172286966568f) / u);     /* N */
}

/* 2^(K x) - 1 with K = ln(65505) / ln(2) = 16 - 0.000682588611; up to 2^-30 ln(65505) x, where the
 * small part of K would give subnormals. */
LULL_INLINE float log_inverse(float x)
{
    float v = at_most(flush_input(x), 8.0625f); /* overflows from 8.00035 */
    float n = nearest(16.0f * v - 0.000682588611f * v);
    float part = exp2m1_part((16.0f * v - n) - 0.000682588611f * v);
    int32_t half = (int32_t)n >> 1, rest = (int32_t)n - half;
    float y = part * power_of_two(half) + (power_of_two(half) - power_of_two(-rest));
    return flush_output(choose(mask_greater(signed_bits(v), signed_bits(0x1p-30f)),
                               y * power_of_two(rest), 11.089881754588f * v));
}

/* ---- Rows ------------------------------------------------------------------------------------ */

typedef void curve_function(float *values, const lull_curve *curve);

/* Steps before and behind a curve. Each is a loop of its own: together compilers see branches. */
LULL_INLINE void sanitize_block(float *values, float scale, float low, float high)
{
    for (unsigned i = 0; i < BLOCK; i++)
        values[i] = lull_sane(values[i], scale, low, high);
}

LULL_INLINE void scale_block(float *values, float factor, float offset)
{
    for (unsigned i = 0; i < BLOCK; i++)
        values[i] = values[i] * factor + offset;
}

LULL_INLINE void range_block(float *values, float low, float high, float scale)
{
    for (unsigned i = 0; i < BLOCK; i++) {
        float v = values[i] < low ? low : values[i];
        values[i] = (v > high ? high : v) * scale;
    }
}

/* By a curve, or by its last piece where all values are above its lower end. */
#define EACH(name)                         \
    for (unsigned i = 0; i < BLOCK; i++) \
        values[i] = name(values[i]);
#define UPPER_OR_EACH(name, end)                                         \
    uint32_t above = ~UINT32_C(0);                                       \
    for (unsigned i = 0; i < BLOCK; i++)                                 \
        above &= mask_greater(signed_bits(values[i]), signed_bits(end)); \
    if (above)                                                           \
        EACH(name##_upper)                                               \
    else                                                                 \
        EACH(name)

/* A block of values to network values by one curve, and back by another. */
#define CURVE_IN(name, CONVERT)                                                                    \
    static void name##_in(float *values, const lull_curve *curve)                                  \
    {                                                                                              \
        sanitize_block(values, curve->scale, curve->low, curve->high);                             \
        if (curve->is_signed)                                                                      \
            scale_block(values, 0.5f, 0.5f);                                                       \
        CONVERT                                                                                    \
    }
#define CURVE_OUT(name, CONVERT)                                                                   \
    static void name##_out(float *values, const lull_curve *curve)                                 \
    {                                                                                              \
        sanitize_block(values, 1.0f, 0.0f, FLT_MAX);                                               \
        CONVERT                                                                                    \
        if (curve->is_signed)                                                                      \
            scale_block(values, 2.0f, -1.0f);                                                      \
        range_block(values, curve->low, curve->high, curve->scale);                                \
    }

CURVE_IN(linear, EACH(linear))
CURVE_IN(srgb_forward, EACH(srgb_forward))
CURVE_IN(pu_forward, UPPER_OR_EACH(pu_forward, PU_Y1))
CURVE_IN(log_forward, EACH(log_forward))
CURVE_OUT(linear, EACH(linear))
CURVE_OUT(srgb_inverse, EACH(srgb_inverse))
CURVE_OUT(pu_inverse, UPPER_OR_EACH(pu_inverse, PU_X1))
CURVE_OUT(log_inverse, EACH(log_inverse))

/* All values of a row. */
LULL_INLINE void curve_rows(curve_function *block, float *values, const lull_curve *curve, size_t n)
{
    float last[BLOCK] = {0};
    size_t whole = n - n % BLOCK;
    for (size_t i = 0; i < whole; i += BLOCK)
        block(values + i, curve);
    if (whole < n) {
        memcpy(last, values + whole, (n - whole) * sizeof *last);
        block(last, curve);
        memcpy(values + whole, last, (n - whole) * sizeof *last);
    }
}

LULL_INLINE void curve_in(float *values, const lull_curve *curve, size_t n)
{
    static curve_function *const blocks[] = {linear_in, srgb_forward_in, pu_forward_in,
                                             log_forward_in};
    curve_rows(blocks[curve->transfer], values, curve, n);
}

LULL_INLINE void curve_out(float *values, const lull_curve *curve, size_t n)
{
    static curve_function *const blocks[] = {linear_out, srgb_inverse_out, pu_inverse_out,
                                             log_inverse_out};
    curve_rows(blocks[curve->transfer], values, curve, n);
}

#endif
