#include "filter.h"

uint32_t lull_filter_flags(const lull_encoding *from, int is_clipped)
{
    return (from->albedo ? 0xffu : 0) | (from->normal ? 0xff00u : 0) |
           (is_clipped ? 0xff0000u : 0);
}

void lull_filter_smooth(float *out, const lull_model *model, const float *const *rows,
                        const uint8_t *codes, size_t code_step, unsigned n)
{
    float means[LULL_FILTER_RUN * 4];
    const float *at[5];
    for (unsigned done = 0; done < n; done += LULL_FILTER_RUN) {
        unsigned count = lull_min_u(LULL_FILTER_RUN, n - done);
        for (unsigned y = 0; y < 5; y++)
            at[y] = rows[y] + 4 * (size_t)done;
        model->kernels.filter5(means, at, codes + done * code_step + LULL_HEAD_ALBEDO, code_step,
                               model->weight_table, count);
        for (unsigned i = 0; i < count; i++, out += 3)
            for (unsigned c = 0; c < 3; c++)
                out[c] = means[4 * i + 3] > 0.0f ? means[4 * i + c] + LULL_FILTER_EPSILON : 1.0f;
    }
}

void lull_filter_demodulate(float *out, const lull_model *model, const lull_encoding *from,
                            const float *smooth, const uint8_t *codes, size_t code_step, unsigned n)
{
    model->kernels.demodulate(out, from, smooth, codes + LULL_HEAD_CONFIDENCE, code_step,
                              model->weight_table, n);
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
    for (unsigned i = 0; i < n; i++)
        out[4 * i + 3] = model->blend_table[codes[i * code_step + LULL_HEAD_BLEND]];
}

/* Fine pixel i, where coarse pixels beside it may be missing. */
static void blend_pixel(float *out, unsigned channels, const float *filtered,
                        const lull_coarse *coarse, unsigned i)
{
    int x = (int)(i / 2), beside = x + (i & 1 ? 1 : -1);
    ptrdiff_t near_at, far_at;
    out += (size_t)i * channels;
    filtered += 4 * (size_t)i;
    x = x > coarse->last ? coarse->last : x;
    beside = beside > coarse->last ? coarse->last : beside;
    beside = beside < coarse->first ? coarse->first : beside;
    near_at = 4 * (ptrdiff_t)x;
    far_at = 4 * (ptrdiff_t)beside;
    for (int c = 0; c < 3; c++) {
        float here = 0.75f * coarse->near[near_at + c] + 0.25f * coarse->far[near_at + c];
        float there = 0.75f * coarse->near[far_at + c] + 0.25f * coarse->far[far_at + c];
        float up = 0.75f * here + 0.25f * there;
        out[c] = filtered[c] + filtered[3] * (up - filtered[c]);
    }
    if (channels == 4)
        out[3] = 0.0f;
}

void lull_filter_blend(float *out, const lull_model *model, unsigned channels,
                       const float *filtered, const lull_coarse *coarse, unsigned n)
{
    /* pairs of fine pixels whose coarse pixels are all there: from `first` on, before `last` */
    unsigned first = coarse->first < 0 ? 0 : (unsigned)coarse->first + 1, i;
    unsigned last = coarse->last < 0 ? 0 : lull_min_u(n / 2, (unsigned)coarse->last);
    last = lull_max_u(last, first);
    for (i = 0; i < lull_min_u(2 * first, n); i++)
        blend_pixel(out, channels, filtered, coarse, i);
    if (i < n)
        model->kernels.blend(out + 2 * (size_t)first * channels, channels,
                             filtered + 8 * (size_t)first, coarse->near + 4 * (size_t)first,
                             coarse->far + 4 * (size_t)first, last - first);
    for (i = lull_max_u(i, 2 * last); i < n; i++)
        blend_pixel(out, channels, filtered, coarse, i);
}
