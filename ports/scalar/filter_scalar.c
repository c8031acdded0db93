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

void lull_spread_scalar(float *out, const float *albedo, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, out += 4, albedo += 3) {
        out[0] = 1.0f;
        for (size_t c = 0; c < 3; c++)
            out[1 + c] = lull_sane(albedo[c], 1.0f, 0.0f, 1.0f);
    }
}

void lull_demodulate_scalar(float *out, const lull_encoding *from, const float *smooth,
                            const uint8_t *codes, size_t code_step, const float *table,
                            unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, out += 4) {
        out[0] = table[codes[i * code_step]];
        for (size_t at = 3 * i, c = 0; c < 3; at++, c++)
            out[1 + c] = out[0] * (radiance_at(from, at) / smooth[at]);
    }
}

void lull_blend_scalar(float *out, unsigned channels, const float *filtered, const float *near,
                       const float *far, unsigned pairs)
{
    for (size_t i = 0; i < 2 * (size_t)pairs; i++, out += channels, filtered += 4) {
        ptrdiff_t at = 4 * (ptrdiff_t)(i / 2), beside = i & 1 ? at + 4 : at - 4;
        for (int c = 0; c < 3; c++) {
            float here = 0.75f * near[at + c] + 0.25f * far[at + c];
            float there = 0.75f * near[beside + c] + 0.25f * far[beside + c];
            float up = 0.75f * here + 0.25f * there;
            out[c] = filtered[c] + filtered[3] * (up - filtered[c]);
        }
        if (channels == 4)
            out[3] = 0.0f;
    }
}

void lull_modulate_scalar(float *out, const float *v, const float *smooth, float unscale, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = lull_sane(v[i] * smooth[i], 1.0f, 0.0f, LULL_LARGEST) * unscale;
}
