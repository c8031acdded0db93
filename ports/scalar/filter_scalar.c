/* The filter of family K beside its 5x5 sums. */
#include "port_scalar.h"

static uint8_t to_code(float v)
{
    float code = v + 0.5f;
    return code < 255.0f ? (uint8_t)code : 255;
}

/* Logarithm of u >= 1 in codes (kernels.h). */
static float log_code(float u)
{
    float e, t = lull_mantissa(u, &e) - 1.0f;
    float p = LULL_LOG_2 * t + LULL_LOG_1, q = LULL_LOG_4 * t + LULL_LOG_3;
    return e * LULL_CODES_PER_OCTAVE + t * (p + t * t * q);
}

/* Shares of v, in its place (kernels.h). */
static void shares(float *v, float top, float bottom)
{
    float first = v[0] * v[1], share = top / (first * v[2] * bottom), other = v[0] * v[2];
    v[0] = v[1] * v[2] * share;
    v[1] = other * share;
    v[2] = first * share;
}

static uint8_t normal_code(float n)
{
    return to_code(lull_sane(n, 1.0f, -1.0f, 1.0f) * 127.5f + 127.5f);
}

static float radiance_at(const lull_encoding *from, size_t i)
{
    return lull_sane(from->radiance[i], from->scale, 0.0f, from->most);
}

/* Albedo of a pixel, sanitised: where there is none, white. */
static void get_albedo(float *a, const float *pixel)
{
    for (unsigned c = 0; c < 3; c++)
        a[c] = lull_sane(pixel[c], 1.0f, 0.0f, 1.0f);
    if (!(a[0] + a[1] + a[2] > 0.0f))
        a[0] = a[1] = a[2] = 1.0f;
}

void lull_encode_scalar(uint8_t *codes, const lull_encoding *from, unsigned pixels)
{
    const float *albedo = from->albedo, *normal = from->normal, none = 1.0f - LULL_FILTER_EPSILON;
    for (size_t i = 0; i < pixels; i++, codes += 12) {
        float a[3] = {none, none, none}, share[3];
        if (albedo)
            get_albedo(a, albedo + 3 * i);
        for (size_t c = 0; c < 3; c++)
            share[c] = a[c] + LULL_FILTER_EPSILON;
        shares(share, 1.0f, 1.0f);
        for (size_t at = 3 * i, c = 0; c < 3; at++, c++) {
            float v = radiance_at(from, at) * share[c];
            codes[c] = to_code(log_code(1.0f + LULL_LOG_GAIN * v));
            codes[3 + c] = albedo ? to_code(a[c] * 255.0f) : 0;
            codes[6 + c] = normal ? normal_code(normal[at]) : 128;
            codes[9 + c] = (uint8_t)(from->flags >> 8 * c);
        }
    }
}

void lull_guide_scalar(uint8_t *guide, const float *albedo, const float *normal, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, guide += 2) {
        int q[3] = {0, 0, 0};
        float a[3];
        if (!normal && albedo)
            get_albedo(a, albedo + 3 * i);
        for (size_t c = 0; c < 3 && (normal || albedo); c++)
            q[c] = normal ? normal_code(normal[3 * i + c]) : to_code(a[c] * 255.0f);
        guide[0] = (uint8_t)(normal ? (2 * q[0] - q[1] - q[2] + 510) / 8 : q[0] / 2);
        guide[1] = (uint8_t)(normal ? 7 * (q[1] - q[2] + 255) / 32 : (q[1] + q[2]) / 4);
    }
}

void lull_spread_scalar(float *out, size_t plane, const float *albedo, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, albedo += 3) {
        float a[3];
        get_albedo(a, albedo);
        out[i] = 1.0f;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = a[c];
    }
}

void lull_demodulate_scalar(float *out, size_t plane, const lull_encoding *from,
                            const float *smooth, size_t smooth_plane, const uint8_t *codes,
                            size_t code_step, const float *table, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        float confidence = table[codes[i * code_step + LULL_HEAD_CONFIDENCE]], share[3];
        for (size_t c = 0; c < 3; c++)
            share[c] = smooth[c * smooth_plane + i];
        shares(share, 1.0f, 1.0f);
        out[i] = confidence;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = confidence * (radiance_at(from, 3 * i + c) * share[c]);
    }
}

void lull_shrink_scalar(float *out, size_t out_plane, const float *above, const float *below,
                        size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                        unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        const float *a = above + 2 * i, *b = below + 2 * i;
        float weight = ((a[0] + a[1]) + b[0]) + b[1];
        float confidence = table[codes[i * code_step + LULL_HEAD_CONFIDENCE]];
        out[i] = weight > 0.0f ? confidence : 0.0f;
        for (size_t c = 1; c < 4; c++) {
            float sum = ((a[c * plane] + a[c * plane + 1]) + b[c * plane]) + b[c * plane + 1];
            out[c * out_plane + i] = weight > 0.0f ? confidence * (sum * (1.0f / weight)) : 0.0f;
        }
    }
}

void lull_blend_scalar(const lull_blending *b)
{
    for (size_t c = 0; c < 3; c++) {
        const float *near = b->near + c * b->coarse_plane, *far = b->far + c * b->coarse_plane;
        for (size_t i = 0; i < 2 * (size_t)b->pairs; i++) {
            ptrdiff_t at = (ptrdiff_t)(i / 2), beside = i & 1 ? at + 1 : at - 1;
            float fine = b->fine[c * b->fine_plane + i];
            float here = 0.75f * near[at] + 0.25f * far[at];
            float there = 0.75f * near[beside] + 0.25f * far[beside];
            float up = 0.75f * here + 0.25f * there;
            b->out[c * b->out_plane + i] = fine + b->table[b->codes[i]] * (up - fine);
        }
    }
}

void lull_modulate_scalar(float *out, const float *v, size_t plane, const float *smooth,
                          size_t smooth_plane, float unscale, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, out += 3)
        for (size_t c = 0; c < 3; c++)
            out[c] = lull_sane(v[c * plane + i] * smooth[c * smooth_plane + i], 1.0f, 0.0f,
                               LULL_LARGEST) *
                     unscale;
}

void lull_luminance_scalar(float *sums, const float *pixels, unsigned n)
{
    for (unsigned i = 0; i < n; i++, pixels += 3) {
        float v[3];
        for (unsigned c = 0; c < 3; c++)
            v[c] = lull_sane(pixels[c], 1.0f, 0.0f, LULL_LARGEST);
        sums[i] += (0.212671f * v[0] + 0.715160f * v[1]) + 0.072169f * v[2];
    }
}

void lull_noise_scalar(uint8_t *noise, const float *v, size_t plane, const float *f,
                       size_t f_plane, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        float apart = 0.0f, all = 0.0f;
        for (size_t c = 0; c < 3; c++) {
            float mean = f[c * f_plane + i], e = v[(1 + c) * plane + i] - v[i] * mean;
            apart += e < 0.0f ? -e : e;
            all += mean;
        }
        noise[i] = to_code(LULL_NOISE_CODES * (apart / (v[i] * (all + LULL_NOISE_EPSILON))));
    }
}

void lull_residual_scalar(const lull_balance *b, const lull_encoding *from)
{
    for (size_t i = 0; i < b->pixels; i++) {
        float p[3], r[3], share, q, lit, w = b->noise[i] * LULL_NOISE_SHARE;
        for (size_t c = 0; c < 3; c++) {
            p[c] = b->v[c * b->v_plane + i] * b->smooth[c * b->smooth_plane + i];
            r[c] = radiance_at(from, 3 * i + c);
        }
        p[0] = (p[0] + p[1]) + p[2];
        share = 1.0f / (p[0] + LULL_BALANCE_EPSILON);
        q = (((r[0] + r[1]) + r[2]) - p[0]) * share;
        q = q < LULL_MOST_LACKING ? q : LULL_MOST_LACKING;
        b->sums[i] += q;
        b->sums[b->sum_plane + i] += q * q;
        b->sums[2 * b->sum_plane + i] += p[0] * share * (w < 1.0f ? w : 1.0f);
        lit = q > LULL_SPARK ? q - LULL_SPARK : 0.0f;
        b->sums[3 * b->sum_plane + i] += lit < 1.0f ? lit : 1.0f;
    }
}

/* The weight of pixel j of `other` for pixel i of `row`, g being what differences of its channels
 * count. Those go to `change`. */
static float weight_of(const lull_surface *row, ptrdiff_t i, const lull_surface *other, ptrdiff_t j,
                       const float *g, float *change)
{
    int a = other->guide[2 * j] - row->guide[2 * i];
    int b = other->guide[2 * j + 1] - row->guide[2 * i + 1], apart = a * a + b * b;
    float x[3], t, w;
    for (ptrdiff_t c = 0; c < 3; c++) {
        change[c] = other->v[c * (ptrdiff_t)other->plane + j] -
                    row->v[c * (ptrdiff_t)row->plane + i];
        x[c] = change[c] * g[c];
    }
    t = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]) + LULL_GUIDE_SCALE * (float)apart;
    w = 1.0f - t > 0.0f ? 1.0f - t : 0.0f;
    return w * w;
}

void lull_bilateral_scalar(const lull_smoothing *s)
{
    static const int8_t columns[] = {-LULL_BILATERAL_REACH, -2, 2, LULL_BILATERAL_REACH, 0, 0,
                                     -LULL_BILATERAL_FAR, LULL_BILATERAL_FAR, 0, 0};
    const lull_surface *const row = &s->row, *const beside = s->beside;
    const lull_surface *const rows[] = {row,         row, row, row,        beside,
                                        beside + 1,  row, row, beside + 2, beside + 3};
    for (ptrdiff_t i = 0; i < (ptrdiff_t)s->pixels; i++) {
        const uint8_t *noise = s->noise + i;
        const float *v = row->v + i;
        float width = (float)(noise[-1] + noise[0] + noise[1]) * LULL_NOISE_WIDTH;
        float g[3], change[3], sum[3] = {0.0f, 0.0f, 0.0f}, weights = 1.0f;
        width = width < LULL_WIDEST ? width : LULL_WIDEST;
        for (size_t c = 0; c < 3; c++)
            g[c] = v[c * row->plane] + LULL_FILTER_EPSILON;
        shares(g, 0.5f, width > LULL_NARROWEST ? width : LULL_NARROWEST);
        for (unsigned k = 0; k < (s->is_far ? 10u : 6u); k++) {
            float w = weight_of(row, i, rows[k], i + columns[k], g, change);
            weights += w;
            for (unsigned c = 0; c < 3; c++)
                sum[c] += w * change[c];
        }
        for (size_t c = 0; c < 3; c++)
            s->out[c * s->out_plane + (size_t)i] = v[c * row->plane] + sum[c] * (1.0f / weights);
    }
}
