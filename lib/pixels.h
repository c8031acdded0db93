/* Arithmetic of single values and pixels, mostly of family K (docs/kernel-prediction.md), in what
 * C99 and OpenCL C have in common: the core, the scalar port and ports/opencl share this source.
 * For OpenCL, ports/opencl/prelude.cl stands in the place of base.h. Pointers are to variables of
 * the calling function. fp32 in the order written, without contraction. */
#ifndef LULL_PIXELS_H
#define LULL_PIXELS_H

#ifndef __OPENCL_VERSION__
#include "base.h"
#endif

/* ---- Single values --------------------------------------------------------------------------- */

LULL_INLINE float lull_abs(float v) { return v < 0.0f ? -v : v; }

/* m in [sqrt(1/2), sqrt(2)) and, as a number, the exponent *e of x = m 2^e; x finite >= FLT_MIN. */
LULL_INLINE float lull_mantissa(float x, float *e)
{
    uint32_t bits = lull_bits(x);
    int32_t exponent = (int32_t)(bits - 0x3f3504f3u) >> 23;
    *e = (float)exponent;
    return lull_float(bits - ((uint32_t)exponent << 23));
}

/* f where its magnitude is above the float of bits `least` and it is no NaN, else 0. */
LULL_INLINE float lull_above(float f, uint32_t least)
{
    uint32_t magnitude = lull_bits(f) & 0x7fffffffu;
    uint32_t keep = 0u - (uint32_t)((int32_t)magnitude > (int32_t)least);
    keep &= 0u - (uint32_t)((int32_t)magnitude <= (int32_t)0x7f800000);
    return lull_float(lull_bits(f) & keep);
}

/* lull_sanitize of one value (image.h). */
LULL_INLINE float lull_sane(float v, float scale, float lo, float hi)
{
    v = lull_above(lull_above(v, 0x007fffffu) * scale, 0x00800000u); /* FLT_MIN */
    v = v > lo ? v : lo;
    return v < hi ? v : hi;
}

/* The nearest code of a value that is not negative; NaN counts as too large. */
LULL_INLINE uint8_t lull_to_code(float v)
{
    float code = v + 0.5f;
    return code < 255.0f ? (uint8_t)code : 255;
}

/* ---- What the network sees ------------------------------------------------------------------- */

#define LULL_RADIANCE_MAX 65504.0f
#define LULL_FILTER_EPSILON 0.02f
#define LULL_LARGEST 3.402823466e38f /* FLT_MAX */
#define LULL_LOG_GAIN 32.0f
#define LULL_CODES 12u /* of a pixel of the input: radiance, albedo, normal, flags; 3 of each */
#define LULL_CODES_PER_OCTAVE 21.2493764f /* 255 / log2(1 + 32 * 128) */
/* A code of u = m 2^e, m in [sqrt(1/2), sqrt(2)), t = m - 1: e LULL_CODES_PER_OCTAVE + t
 * ((LULL_LOG_2 t + LULL_LOG_1) + (t t) (LULL_LOG_4 t + LULL_LOG_3)), within 0.0022 of the
 * logarithm's. */
#define LULL_LOG_1 30.6365147f
#define LULL_LOG_2 -15.4037612f
#define LULL_LOG_3 10.996752f
#define LULL_LOG_4 -7.00442797f

/* Logarithm of u >= 1 in codes. */
LULL_INLINE float lull_log_code(float u)
{
    float e, t = lull_mantissa(u, &e) - 1.0f;
    float p = LULL_LOG_2 * t + LULL_LOG_1, q = LULL_LOG_4 * t + LULL_LOG_3;
    return e * LULL_CODES_PER_OCTAVE + t * (p + t * t * q);
}

LULL_INLINE uint8_t lull_radiance_code(float demodulated)
{
    return lull_to_code(lull_log_code(1.0f + LULL_LOG_GAIN * demodulated));
}

LULL_INLINE uint8_t lull_normal_code(float n)
{
    return lull_to_code(lull_sane(n, 1.0f, -1.0f, 1.0f) * 127.5f + 127.5f);
}

#define LULL_EMPTY_ALBEDO 0.1f /* of pixels that show nothing */
#define LULL_EMPTY_RUN 4u      /* pixels of a row that say together whether they do */

/* Lamps have their light as albedo, far above 1. What is above 4 counts as a quarter of it. */
#define LULL_ALBEDO_MOST 16.0f
#define LULL_LAMP 0.25f

/* 1 if a pixel's values are 0 once sanitised (lull_sane), all three. */
LULL_INLINE int lull_is_black(const float *v, float scale)
{
    for (int c = 0; c < 3; c++)
        if (v[c] >= 1.17549435e-38f && v[c] * scale > 1.17549435e-38f)
            return 0;
    return 1;
}

/* Sanitises the albedo of a pixel; where there is none, it is white. */
LULL_INLINE void lull_sane_albedo(float *a)
{
    for (int c = 0; c < 3; c++)
        a[c] = lull_sane(a[c], 1.0f, 0.0f, LULL_ALBEDO_MOST);
    if (!(a[0] + a[1] + a[2] > 0.0f))
        a[0] = a[1] = a[2] = 1.0f;
}

/* A value of an albedo as it counts, in [0, LULL_ALBEDO_MOST]. */
LULL_INLINE float lull_albedo_of(float v)
{
    v = lull_sane(v, 1.0f, 0.0f, LULL_ALBEDO_MOST / LULL_LAMP);
    if (v > 1.0f)
        v = v * LULL_LAMP > 1.0f ? v * LULL_LAMP : 1.0f;
    return v;
}

/* The values above 1 of pixel `own` of a run of n, as they count: if they are more than 1 and than
 * those of the others together, it is a spark. To `pixel`, which has the pixel's values. */
LULL_INLINE void lull_dim_lamps(float *pixel, const float *run, unsigned n, unsigned own)
{
    for (unsigned c = 0; c < 3; c++) {
        float most = 0.0f, v = lull_albedo_of(run[3 * own + c]);
        if (!(run[3 * own + c] > 1.0f))
            continue;
        for (unsigned i = 0; i < n; i++)
            if (i != own)
                most += lull_albedo_of(run[3 * i + c]);
        most = most > 1.0f ? most : 1.0f;
        pixel[c] = v < most ? v : most;
    }
}

/* The guide of a pixel (kernels.h) from the codes of its normal, or of its albedo. */
LULL_INLINE void lull_guide_of_normal(uint8_t *guide, const int *q)
{
    guide[0] = (uint8_t)((2 * q[0] - q[1] - q[2] + 510) / 8);
    guide[1] = (uint8_t)(7 * (q[1] - q[2] + 255) / 32);
}
LULL_INLINE void lull_guide_of_albedo(uint8_t *guide, const int *q)
{
    guide[0] = (uint8_t)(q[0] / 2);
    guide[1] = (uint8_t)((q[1] + q[2]) / 4);
}

/* ---- The filter ------------------------------------------------------------------------------ */

/* Shares of v, in its place (kernels.h). */
LULL_INLINE void lull_shares(float *v, float top, float bottom)
{
    float first = v[0] * v[1], share = top / (first * v[2] * bottom), other = v[0] * v[2];
    v[0] = v[1] * v[2] * share;
    v[1] = other * share;
    v[2] = first * share;
}

/* A fine value and the coarse ones around it: near and far row, here and beside. */
LULL_INLINE float lull_blended(float fine, float beta, float near_here, float far_here,
                               float near_beside, float far_beside)
{
    float here = 0.75f * near_here + 0.25f * far_here;
    float there = 0.75f * near_beside + 0.25f * far_beside;
    float up = 0.75f * here + 0.25f * there;
    return fine + beta * (up - fine);
}

#define LULL_NOISE_CODES 384.0f   /* per 1 of noise */
#define LULL_NOISE_EPSILON 0.06f  /* three times 0.02 */

/* Code of the noise of a pixel: v is (C, V), f its mean (bilateral.h). */
LULL_INLINE uint8_t lull_noise_code(const float *v, const float *f)
{
    float apart = 0.0f, all = 0.0f;
    for (int c = 0; c < 3; c++) {
        apart += lull_abs(v[1 + c] - v[0] * f[c]);
        all += f[c];
    }
    return lull_to_code(LULL_NOISE_CODES * (apart / (v[0] * (all + LULL_NOISE_EPSILON))));
}

/* ---- Smoothing along the result -------------------------------------------------------------- */

#define LULL_BILATERAL_REACH 6 /* columns to either side */
#define LULL_BILATERAL_FAR 12  /* columns and rows, where the pixels farthest away count */
#define LULL_NOISE_WIDTH 0.0026041667f /* of weights, per noise code of three pixels */
#define LULL_NARROWEST 0.001f
#define LULL_GUIDE_SCALE 0.012288f /* of squared differences of codes */

/* Pixels of its row, and of its column, that a smoothing looks at. */
LULL_INLINE unsigned lull_bilateral_columns(int is_far) { return is_far ? 8 : 4; }
LULL_INLINE unsigned lull_bilateral_rows(int is_far) { return is_far ? 8 : 2; }

/* The most that a width can be, and the weight of a pixel itself. */
LULL_INLINE float lull_smoothing_widest(int is_far) { return is_far ? 0.67f : 0.6f; }
LULL_INLINE float lull_smoothing_own(int is_far) { return is_far ? 2.5f : 1.0f; }

/* What differences of the channels of v count where the noise codes of three pixels sum to
 * `noise`. */
LULL_INLINE void lull_smoothing_factors(float *g, const float *v, int noise, int is_far)
{
    float width = (float)noise * LULL_NOISE_WIDTH, widest = lull_smoothing_widest(is_far);
    width = width < widest ? width : widest;
    for (int c = 0; c < 3; c++)
        g[c] = v[c] + LULL_FILTER_EPSILON;
    lull_shares(g, 0.5f, width > LULL_NARROWEST ? width : LULL_NARROWEST);
}

/* Weight of a pixel that differs by `change`, and in the guide by a and b. */
LULL_INLINE float lull_smoothing_weight(const float *change, const float *g, int a, int b)
{
    float x[3], t, w;
    for (int c = 0; c < 3; c++)
        x[c] = change[c] * g[c];
    t = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]) + LULL_GUIDE_SCALE * (float)(a * a + b * b);
    w = 1.0f - t > 0.0f ? 1.0f - t : 0.0f;
    return w * w;
}

/* ---- Cells of side x side pixels ------------------------------------------------------------- */

/* The cell before the centre between two cells at which pixel i lies, or the next one, of `count`
 * that there are. */
LULL_INLINE int lull_cell_near(unsigned side, int i, int next, int count)
{
    int cell = (i + (int)side / 2) / (int)side + next - 1;
    return cell < 0 ? 0 : cell >= count ? count - 1 : cell;
}

/* How far it lies on the way from one to the other. */
LULL_INLINE float lull_cell_part(unsigned side, int i)
{
    return ((float)((i + (int)side / 2) % (int)side) + 0.5f) * (1.0f / (float)side);
}

/* Cells that pixels lie in. */
LULL_INLINE unsigned lull_cell_count(unsigned side, unsigned pixels)
{
    return (pixels + side - 1) / side;
}

/* ---- Regression on normals and albedo -------------------------------------------------------- */

#define LULL_FIT_SIDE 8u     /* pixels of a cell, in either direction */
#define LULL_FIT_LEVEL 3u    /* log2 of it */
#define LULL_FIT_FEATURES 6u /* filtered normal, filtered albedo */
#define LULL_FIT_SUMS 50u    /* of a cell: 1, f, e, f f (upper triangle), f e, e e; where: */
#define LULL_FIT_RESTS (1u + LULL_FIT_FEATURES)
#define LULL_FIT_SQUARES (LULL_FIT_RESTS + 3u)
#define LULL_FIT_MIXED (LULL_FIT_SQUARES + LULL_FIT_FEATURES * (LULL_FIT_FEATURES + 1u) / 2u)
#define LULL_FIT_NOISE (LULL_FIT_SUMS - 1u)
#define LULL_FIT_COEFFICIENTS 21u /* of the features for each channel, then the constants */
#define LULL_FIT_EPSILON 0.03f
#define LULL_FIT_MOST_REST 4.0f /* of one pixel: single sparks are chance */
#define LULL_THIRD 0.33333334f
#define LULL_RIDGE 0.001f
#define LULL_RIDGE_OF_NOISE 0.005f
#define LULL_MOST_FIT 0.5f

/* Features of a pixel from its filtered normal and its divisor. */
LULL_INLINE void lull_fit_features(float *f, const float *normal, const float *smooth)
{
    for (int c = 0; c < 3; c++) {
        f[c] = normal[c];
        f[3 + c] = smooth[c];
    }
}

/* What a pixel adds to the sums of its cell: result p, times its divisor, radiance r, features. */
LULL_INLINE void lull_fit_products(float *sums, const float *p, const float *r, const float *f)
{
    float e[3];
    unsigned k = 0;
    for (int c = 0; c < 3; c++) {
        e[c] = (r[c] - p[c]) * (1.0f / (p[c] + LULL_FIT_EPSILON));
        e[c] = e[c] < LULL_FIT_MOST_REST ? e[c] : LULL_FIT_MOST_REST;
    }
    sums[k++] = 1.0f;
    for (unsigned i = 0; i < LULL_FIT_FEATURES; i++)
        sums[k++] = f[i];
    for (int c = 0; c < 3; c++)
        sums[k++] = e[c];
    for (unsigned i = 0; i < LULL_FIT_FEATURES; i++)
        for (unsigned j = i; j < LULL_FIT_FEATURES; j++)
            sums[k++] = f[i] * f[j];
    for (unsigned i = 0; i < LULL_FIT_FEATURES; i++)
        for (int c = 0; c < 3; c++)
            sums[k++] = f[i] * e[c];
    sums[k] = (e[0] * e[0] + e[1] * e[1]) + e[2] * e[2];
}

/* LULL_FIT_COEFFICIENTS of a cell from the sums of it and those around it: square-root-free
 * Cholesky factors of the features' covariance, with a ridge that grows with the noise. */
LULL_INLINE void lull_fit(float *b, const float *sums)
{
    float lower[LULL_FIT_FEATURES][LULL_FIT_FEATURES], scaled[LULL_FIT_FEATURES][LULL_FIT_FEATURES];
    float m = 1.0f / sums[0], f[LULL_FIT_FEATURES], e[3], inverse[LULL_FIT_FEATURES], v, ridge;
    const unsigned n = LULL_FIT_FEATURES;
    for (unsigned i = 0; i < n; i++)
        f[i] = sums[1 + i] * m;
    for (unsigned c = 0; c < 3; c++)
        e[c] = sums[LULL_FIT_RESTS + c] * m;
    v = (sums[LULL_FIT_NOISE] * m - ((e[0] * e[0] + e[1] * e[1]) + e[2] * e[2])) * LULL_THIRD;
    ridge = LULL_RIDGE + LULL_RIDGE_OF_NOISE * (v > 0.0f ? v : 0.0f);
    for (unsigned i = 0; i < n; i++)
        for (unsigned c = 0; c < 3; c++)
            b[3 * i + c] = sums[LULL_FIT_MIXED + 3 * i + c] * m - f[i] * e[c];
    for (unsigned i = 0, k = LULL_FIT_SQUARES; i < n; i++) {
        for (unsigned j = i; j < n; j++, k++) {
            float a = sums[k] * m - f[i] * f[j];
            if (i == j)
                a += ridge;
            for (unsigned t = 0; t < i; t++)
                a -= lower[j][t] * scaled[i][t];
            scaled[j][i] = a;
        }
        inverse[i] = 1.0f / scaled[i][i];
        for (unsigned j = i + 1; j < n; j++)
            lower[j][i] = scaled[j][i] * inverse[i];
    }
    for (unsigned c = 0; c < 3; c++) {
        float all = 0.0f;
        for (unsigned i = 1; i < n; i++)
            for (unsigned t = 0; t < i; t++)
                b[3 * i + c] -= lower[i][t] * b[3 * t + c];
        for (unsigned i = n; i-- > 0;) {
            b[3 * i + c] *= inverse[i];
            for (unsigned t = i + 1; t < n; t++)
                b[3 * i + c] -= lower[t][i] * b[3 * t + c];
        }
        for (unsigned i = 0; i < n; i++)
            all = i ? all + f[i] * b[3 * i + c] : f[i] * b[3 * i + c];
        b[3 * n + c] = -all;
    }
}

/* A channel of the result after the regression: v before, coefficients b[3 i] at the pixel. */
LULL_INLINE float lull_regressed(float v, const float *f, const float *b)
{
    float k = f[0] * b[0];
    for (unsigned i = 1; i < LULL_FIT_FEATURES; i++)
        k += f[i] * b[3 * i];
    k = b[3 * LULL_FIT_FEATURES] + k;
    k = k > -LULL_MOST_FIT ? k : -LULL_MOST_FIT;
    return v + v * (k < LULL_MOST_FIT ? k : LULL_MOST_FIT);
}

/* ---- What the result lacks ------------------------------------------------------------------- */

#define LULL_CELL 16u        /* pixels, in either direction */
#define LULL_CELL_LEVEL 4u   /* log2 of it */
#define LULL_CELL_SUMS 4u    /* of a cell: q, q q, what may be corrected, sparks */
#define LULL_CELLS_ABOVE 4   /* rows of cells above, and ... */
#define LULL_CELLS_BESIDE 6  /* ... columns on either side, that correct a cell, too */
#define LULL_BALANCE_EPSILON 0.15f /* three times 0.05 */
#define LULL_NOISE_SHARE 0.05f     /* of a correction, per noise code */
#define LULL_MOST_LACKING 400.0f   /* of one pixel; what says more counts less: it is broken */
#define LULL_SPARK 2.0f
#define LULL_MOST_GAIN 0.5f

/* What a pixel adds to the sums of its cell: result p, radiance r, code of the noise. */
LULL_INLINE void lull_balance_of(float *sums, const float *p, const float *r, uint8_t noise)
{
    float v = (p[0] + p[1]) + p[2], w = noise * LULL_NOISE_SHARE;
    float share = 1.0f / (v + LULL_BALANCE_EPSILON), lit;
    float q = (((r[0] + r[1]) + r[2]) - v) * share, most = 2.0f * LULL_MOST_LACKING - q;
    most = most > 0.0f ? most : 0.0f;
    q = q < most ? q : most;
    sums[0] = q;
    sums[1] = q * q;
    sums[2] = v * share * (w < 1.0f ? w : 1.0f);
    lit = q > LULL_SPARK ? q - LULL_SPARK : 0.0f;
    sums[3] = lit < 1.0f ? lit : 1.0f;
}

LULL_INLINE float lull_most_gain(float gain)
{
    gain = gain < -LULL_MOST_GAIN ? -LULL_MOST_GAIN : gain;
    return gain > LULL_MOST_GAIN ? LULL_MOST_GAIN : gain;
}

/* What sums over cells say that the result lacks, relative to it: of the sum of q the share that is
 * not chance, 1 - (sum of q q) / (sum of q)^2, which is 0 for one pixel and 1 - 1/n for n alike,
 * spread over what may be corrected. Few sparks are not light but fireflies: of n of them no more
 * counts than 20 + sparks n^2. */
LULL_INLINE float lull_lacking(float q, const float *sums, float sparks)
{
    float share = 1.0f - sums[1] / (q * q + 1e-6f), most = 20.0f + sparks * sums[3] * sums[3];
    return lull_most_gain((share > 0.0f ? share : 0.0f) * (q < most ? q : most) /
                          (sums[2] + 32.0f));
}

/* The correction of a cell: what the sums over cells far around it say, and what those over the
 * cells beside it say beyond that. */
LULL_INLINE float lull_cell_gain(const float *near, const float *far)
{
    float gain = lull_lacking(far[0], far, 0.1f);
    return lull_most_gain(gain + lull_lacking(near[0] - gain * near[2], near, 0.3f));
}

/* ---- Some of the input where there is little noise ------------------------------------------- */

#define LULL_RUN 16u       /* pixels of a row; its share is that of the pixel in the middle */
#define LULL_RUNS_BESIDE 4 /* on either side that count for it, too */
#define LULL_MIX_REACH 96u /* columns to either side whose noise codes a pixel's share depends on */

/* The share of the input is half of it at most: whether what the result lacks is noise or texture
 * cannot be seen, and so no more than half of either stays. By how much noise codes above
 * LULL_LEAST_NOISE lessen it, and alone, without features, which tell noise from texture. */
#define LULL_MOST_SHARE 0.5f
#define LULL_MOST_SHARE_CLEAN 0.25f /* features without noise have shown most of the texture */
#define LULL_LEAST_NOISE 2.0f
#define LULL_SHARE_PER_CODE 0.125f
#define LULL_SHARE_PER_CODE_ALONE 0.0625f

/* In a calm frame there is little noise anywhere, so that a noise code counts less, and alone the
 * share may be larger. */
typedef struct lull_mixing {
    float calm;  /* how calm, in [0, 1] */
    float codes; /* what a noise code counts */
    float per_code, most;
} lull_mixing;

LULL_INLINE float lull_ramp(float v, float begin, float slope)
{
    float part = (v - begin) * slope;
    part = part > 0.0f ? part : 0.0f;
    return part < 1.0f ? part : 1.0f;
}

/* calm: of lull_images, below 0 for none of the input; are_clean: its features, if it has any. */
LULL_INLINE lull_mixing lull_mixing_of(float calm, int has_features, int are_clean)
{
    lull_mixing mixing;
    mixing.calm = lull_ramp(calm, has_features ? 0.14f : 0.17f, 12.5f);
    mixing.codes = 1.0f - 0.75f * mixing.calm;
    mixing.per_code = has_features ? LULL_SHARE_PER_CODE : LULL_SHARE_PER_CODE_ALONE;
    mixing.most = has_features && are_clean ? LULL_MOST_SHARE_CLEAN : LULL_MOST_SHARE;
    if (!has_features)
        mixing.most += 0.2f * mixing.calm;
    if (calm < 0.0f)
        mixing.most = 0.0f;
    return mixing;
}

/* What counts of a run, none where the mean noise code is below 1, as that of sky and lamps is. */
LULL_INLINE uint32_t lull_noisy(uint32_t v, uint32_t pixels, uint32_t noise)
{
    return noise < pixels ? 0 : v;
}

/* The share of the input of a run, from sums over the noisy ones around: of their pixels, and of
 * their noise codes. */
LULL_INLINE float lull_run_share(float pixels, float noise, const lull_mixing *mixing)
{
    float share = mixing->most;
    if (pixels > 0.0f)
        share = 1.0f - ((noise * (1.0f / pixels)) * mixing->codes - LULL_LEAST_NOISE) *
                           mixing->per_code;
    share = share > 0.0f ? share : 0.0f;
    return share < mixing->most ? share : mixing->most;
}

/* That of a pixel, given what lies between those of the runs around it, its own code, result p and
 * radiance r: sparks stay out, less of what has more than 64, all of what has 128; where it is calm
 * only those more than eight to twelve times as bright as the result. */
LULL_INLINE float lull_pixel_share(float share, uint8_t noise, const float *p, const float *r,
                                   const lull_mixing *mixing)
{
    float w = 1.0f - lull_ramp((float)noise, 64.0f, 0.015625f), v = (p[0] + p[1]) + p[2];
    float q = (((r[0] + r[1]) + r[2]) - v) * (1.0f / (v + LULL_BALANCE_EPSILON));
    float calm = mixing->calm * (1.0f - lull_ramp(q, 8.0f, 0.25f));
    return share * (w > calm ? w : calm);
}

/* ---- Averages along edges -------------------------------------------------------------------- */

#define LULL_EDGE_REACH 1u         /* pixels around, whose averages the output has */
#define LULL_EDGE_EPSILON 0.18f    /* three times 0.06 */
#define LULL_EDGE_SHARE 0.16666667f /* half of a third */
#define LULL_EDGE_TINY 1e-6f
#define LULL_EDGE_CONTRAST 0.2f, 5.0f       /* ramps: of the most change, relative to the light, */
#define LULL_EDGE_EVENNESS 0.0f, 3.3333333f /* and of the least, relative to the most */

/* What light changes by at the two ends of a line. */
LULL_INLINE float lull_edge_change(float light, float a, float b)
{
    return lull_abs(a - light) + lull_abs(b - light);
}

/* How much a pixel moves for each of the two ends of the line that changes least: where others
 * change much, and it does not. */
LULL_INLINE float lull_edge_share(float light, float least, float most, float strength)
{
    float contrast = lull_ramp(most * (1.0f / (light + LULL_EDGE_EPSILON)), LULL_EDGE_CONTRAST);
    float evenness =
        lull_ramp((most - least) * (1.0f / (most + LULL_EDGE_TINY)), LULL_EDGE_EVENNESS);
    return (contrast * evenness) * strength;
}

/* ---- Grain of albedo and normals ------------------------------------------------------------- */

#define LULL_GRAIN_SIDE 8u  /* pixels of a cell, in either direction */
#define LULL_GRAIN_LEVEL 3u /* log2 of it */
#define LULL_GRAIN_STEPS 4u /* to a neighbour: right, below, below right, below left */
#define LULL_GRAIN_SUMS (6u + LULL_GRAIN_STEPS) /* of a cell: 1, L, L L, r, g, b, squared steps */
#define LULL_GRAIN_VALUES 4u /* of a cell: how much of the mean stands for pixels, and the mean */
#define LULL_GRAINY 2u       /* features that may have it: albedo, then normals */
#define LULL_GRAIN_LIGHT (LULL_GRAINY * LULL_GRAIN_SUMS) /* the sum after theirs, of the light */
#define LULL_GRAIN_ALL_SUMS (LULL_GRAIN_LIGHT + 1u)
#define LULL_GRAIN_LIGHT_CODE 1u /* where the light is in the codes of a pixel: its green */
#define LULL_GRAIN_ALBEDO 0u
#define LULL_GRAIN_NORMAL 1u
#define LULL_GRAIN_STRAIGHT 0.5714286f /* half of a step's square by pixels: 7 pairs of 8, ... */
#define LULL_GRAIN_DIAGONAL 0.6530612f /* ... 49 of 64 */
#define LULL_GRAIN_WHITE 0.6f
#define LULL_GRAIN_WHITER 0.015625f /* more of it, by the variance in that of the light */
#define LULL_GRAIN_AROUND 5.0f
#define LULL_GRAIN_OWN 4.0f
#define LULL_GRAIN_REAL 0.083333336f /* beyond 12 times the light's variance there is texture */
#define LULL_GRAIN_OF_NORMAL 0.25f /* of how much more normals vary than the light what counts */

#define LULL_GRAIN_BLOCK 64u /* pixels whose grain is taken at once */
#define LULL_GRAIN_WORK 10240u /* bytes that the sums of as many take */

/* Grain has a variance above this, of codes; ... */
LULL_INLINE float lull_grain_flat(unsigned feature)
{
    return feature == LULL_GRAIN_NORMAL ? 2.0f : 16.0f;
}

/* ... by so much per unit above it it may go. */
LULL_INLINE float lull_grain_rise(unsigned feature)
{
    return feature == LULL_GRAIN_NORMAL ? 0.125f : 0.015625f;
}

/* Where the codes of a feature are, in those of a pixel. */
LULL_INLINE unsigned lull_grain_codes(unsigned feature) { return 3u + 3u * feature; }

/* L of the codes of a pixel's feature. */
LULL_INLINE int lull_grain_light(const uint8_t *code)
{
    return (code[0] + 2 * code[1] + code[2]) >> 2;
}

/* From sums, also of the light: the share of the mean in the feature, and the mean, in [0,1]; gain:
 * how fast it grows with whiteness, part: of how much more it varies than the light what counts. */
LULL_INLINE void lull_grain_share(float *cell, const float *sums, float light, unsigned feature,
                                  float gain, float part)
{
    float m = 1.0f / sums[0], mean = sums[1] * m, v = sums[2] * m - mean * mean;
    float steps = (sums[6] < sums[7] ? sums[6] : sums[7]) * LULL_GRAIN_STRAIGHT;
    float diagonal = (sums[8] < sums[9] ? sums[8] : sums[9]) * LULL_GRAIN_DIAGONAL;
    float flat = lull_grain_flat(feature), much, noise, ratio, grain;
    float white = 1.0f / (v > flat ? v : flat);
    noise = (light * m) * LULL_GRAIN_STRAIGHT;
    ratio = (v * (1.0f / (noise > 1.0f ? noise : 1.0f))) * part;
    white = ((steps < diagonal ? steps : diagonal) * m) * white;
    white = (white - (LULL_GRAIN_WHITE + ratio * LULL_GRAIN_WHITER)) * gain;
    much = (v - flat) * lull_grain_rise(feature);
    white = white > 0.0f ? white : 0.0f;
    much = much > 0.0f ? much : 0.0f;
    grain = 2.0f - ratio * LULL_GRAIN_REAL;
    grain = grain > 0.0f ? grain : 0.0f;
    cell[0] = ((white < 1.0f ? white : 1.0f) * (much < 1.0f ? much : 1.0f)) *
              (grain < 1.0f ? grain : 1.0f);
    for (int c = 0; c < 3; c++)
        cell[1 + c] = lull_sane((sums[3 + c] * m) * (1.0f / 255.0f), 1.0f, 0.0f, 1.0f);
}

/* The same of a cell, from sums over it and those around it, and over itself; light: likewise. */
LULL_INLINE void lull_grain(float *cell, const float *around, const float *own,
                            const float light[2], unsigned feature, float part)
{
    float other[LULL_GRAIN_VALUES], whole, more;
    lull_grain_share(cell, around, light[0], feature, LULL_GRAIN_AROUND, part);
    lull_grain_share(other, own, light[1], feature, LULL_GRAIN_OWN, part);
    other[0] = (1.0f - cell[0]) * other[0];
    whole = cell[0] + other[0];
    more = whole > 0.0f ? other[0] * (1.0f / whole) : 0.0f;
    more = more < 1.0f ? more : 1.0f;
    cell[0] = whole;
    for (int c = 1; c < 4; c++)
        cell[c] = cell[c] + more * (other[c] - cell[c]);
}

/* What counts of the albedo of a cell whose normals have this much grain. */
LULL_INLINE float lull_grain_of_albedo(float of_normal) { return 1.0f - of_normal; }

/* A value less its grain; mean: in [0,1], of what a normal of [-1,1] stands at. */
LULL_INLINE float lull_without_grain(float v, float share, float mean, unsigned feature)
{
    float gain = feature == LULL_GRAIN_NORMAL ? 2.0f : 1.0f;
    float less = feature == LULL_GRAIN_NORMAL ? 1.0f : 0.0f;
    return v + share * ((mean * gain - less) - v);
}

#endif
