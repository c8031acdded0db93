#include "filter.h"

#include "transfer.h"

/* 255 / log2(1 + 32 * 128): codes per octave of 1 + 32 I. */
#define CODES_PER_OCTAVE 21.2493764f
#define LOG_GAIN 32.0f

static uint8_t to_code(float v)
{
    float code = v + 0.5f;
    return code < 255.0f ? (uint8_t)code : 255;
}

void lull_filter_encode(uint8_t *codes, const float *radiance, const float *albedo,
                        const float *normal, int is_clipped, unsigned n)
{
    for (unsigned i = 0; i < n; i++, codes += 12) {
        for (unsigned c = 0; c < 3; c++) {
            float a = albedo ? albedo[3 * i + c] : 1.0f - LULL_FILTER_EPSILON;
            float r = radiance[3 * i + c];
            float v = (r < LULL_RADIANCE_MAX ? r : LULL_RADIANCE_MAX) / (a + LULL_FILTER_EPSILON);
            codes[c] = to_code(lull_log2(1.0f + LOG_GAIN * v) * CODES_PER_OCTAVE);
            codes[3 + c] = albedo ? to_code(a * 255.0f) : 0;
            codes[6 + c] = normal ? to_code(normal[3 * i + c] * 127.5f + 127.5f) : 128;
        }
        codes[9] = albedo ? 255 : 0;
        codes[10] = normal ? 255 : 0;
        codes[11] = is_clipped ? 255 : 0;
    }
}

void lull_filter_smooth(float *out, const lull_model *model, const float *const *rows,
                        const uint8_t *codes, size_t code_step, unsigned n)
{
    float sums[LULL_FILTER_RUN * 4];
    const float *at[5];
    for (unsigned done = 0; done < n; done += LULL_FILTER_RUN) {
        unsigned count = lull_min_u(LULL_FILTER_RUN, n - done);
        for (unsigned y = 0; y < 5; y++)
            at[y] = rows[y] + 4 * (size_t)done;
        model->kernels.filter5(sums, at, codes + done * code_step + LULL_HEAD_ALBEDO, code_step,
                               model->weight_table, count);
        for (unsigned i = 0; i < count; i++, out += 3)
            for (unsigned c = 0; c < 3; c++)
                out[c] = sums[4 * i] > 0.0f
                             ? sums[4 * i + 1 + c] / sums[4 * i] + LULL_FILTER_EPSILON
                             : 1.0f;
    }
}

void lull_filter_demodulate(float *out, const lull_model *model, const float *radiance,
                            const float *smooth, const uint8_t *codes, size_t code_step, unsigned n,
                            unsigned inside)
{
    for (unsigned i = 0; i < n; i++, out += 4) {
        float confidence = model->weight_table[codes[i * code_step + LULL_HEAD_CONFIDENCE]];
        out[0] = i < inside ? confidence : 0.0f;
        for (unsigned c = 0; c < 3; c++) {
            float r = radiance[3 * i + c];
            r = r < LULL_RADIANCE_MAX ? r : LULL_RADIANCE_MAX;
            out[1 + c] = out[0] * (r / smooth[3 * i + c]);
        }
    }
}

void lull_filter_pool(float *out, const lull_model *model, const float *above, const float *below,
                      const uint8_t *codes, size_t code_step, unsigned n)
{
    for (unsigned i = 0; i < n; i++, out += 4, above += 8, below += 8) {
        float weight = above[0] + above[4] + below[0] + below[4];
        float confidence = model->weight_table[codes[i * code_step + LULL_HEAD_CONFIDENCE]];
        out[0] = weight > 0.0f ? confidence : 0.0f;
        for (unsigned c = 1; c < 4; c++) {
            float sum = above[c] + above[4 + c] + below[c] + below[4 + c];
            out[c] = weight > 0.0f ? confidence * (sum / weight) : 0.0f;
        }
    }
}

void lull_filter_apply(float *out, const lull_model *model, const float *const *rows,
                       const uint8_t *codes, size_t code_step, unsigned n)
{
    model->kernels.filter5(out, rows, codes, code_step, model->weight_table, n);
    for (unsigned i = 0; i < n; i++, out += 4) {
        float weight = out[0];
        for (unsigned c = 0; c < 3; c++)
            out[c] = weight > 0.0f ? out[1 + c] / weight : 0.0f;
        out[3] = model->blend_table[codes[i * code_step + LULL_HEAD_BLEND]];
    }
}

void lull_filter_blend(float *out, unsigned channels, const float *filtered,
                       const lull_coarse *coarse, unsigned n)
{
    for (unsigned i = 0; i < n; i++, out += channels, filtered += 4) {
        int x = (int)(i / 2), beside = x + (i & 1 ? 1 : -1);
        ptrdiff_t near_at, far_at;
        x = x > coarse->last ? coarse->last : x;
        beside = beside > coarse->last ? coarse->last : beside;
        beside = beside < coarse->first ? coarse->first : beside;
        near_at = x * (ptrdiff_t)coarse->channels;
        far_at = beside * (ptrdiff_t)coarse->channels;
        for (int c = 0; c < 3; c++) {
            float here = 0.75f * coarse->near[near_at + c] + 0.25f * coarse->far[near_at + c];
            float there = 0.75f * coarse->near[far_at + c] + 0.25f * coarse->far[far_at + c];
            float up = 0.75f * here + 0.25f * there;
            out[c] = filtered[c] + filtered[3] * (up - filtered[c]);
        }
        if (channels == 4)
            out[3] = 0.0f;
    }
}
