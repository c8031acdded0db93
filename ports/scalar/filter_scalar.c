/* The filter of family K beside its 5x5 sums. */
#include "port_scalar.h"

static uint8_t to_code(float v)
{
    float code = v + 0.5f;
    return code < 255.0f ? (uint8_t)code : 255;
}

/* log2 of u >= 1 (docs/arithmetic.md). */
static float log2_of(float u)
{
    lull_logarithm l = lull_log2_parts(u);
    return l.whole + l.part;
}

static float radiance_at(const lull_encoding *from, size_t i)
{
    return lull_sane(from->radiance[i], from->scale, 0.0f, from->most);
}

void lull_encode_scalar(uint8_t *codes, const lull_encoding *from, unsigned pixels)
{
    const float *albedo = from->albedo, *normal = from->normal;
    for (size_t i = 0; i < pixels; i++, codes += 12) {
        for (size_t at = 3 * i, c = 0; c < 3; at++, c++) {
            float a = albedo ? lull_sane(albedo[at], 1.0f, 0.0f, 1.0f) : 1.0f - LULL_FILTER_EPSILON;
            float n = normal ? lull_sane(normal[at], 1.0f, -1.0f, 1.0f) : 0.0f;
            float v = radiance_at(from, at) / (a + LULL_FILTER_EPSILON);
            codes[c] = to_code(log2_of(1.0f + LULL_LOG_GAIN * v) * LULL_CODES_PER_OCTAVE);
            codes[3 + c] = albedo ? to_code(a * 255.0f) : 0;
            codes[6 + c] = normal ? to_code(n * 127.5f + 127.5f) : 128;
            codes[9 + c] = (uint8_t)(from->flags >> 8 * c);
        }
    }
}

void lull_spread_scalar(float *out, size_t plane, const float *albedo, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, albedo += 3) {
        out[i] = 1.0f;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = lull_sane(albedo[c], 1.0f, 0.0f, 1.0f);
    }
}

void lull_demodulate_scalar(float *out, size_t plane, const lull_encoding *from,
                            const float *smooth, size_t smooth_plane, const uint8_t *codes,
                            size_t code_step, const float *table, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        float confidence = table[codes[i * code_step + LULL_HEAD_CONFIDENCE]];
        out[i] = confidence;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] =
                confidence * (radiance_at(from, 3 * i + c) / smooth[c * smooth_plane + i]);
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
            out[c * out_plane + i] = weight > 0.0f ? confidence * (sum / weight) : 0.0f;
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
