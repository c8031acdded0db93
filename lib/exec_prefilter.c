/* What filters the albedo before the network proper (docs/kernel-prediction.md, Prefilter). */
#include "exec.h"

void lull_exec_pick(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    enum { FROM = 12, TO = 4, ALBEDO = 3, PRESENT = 9 };
    const lull_plan *plan = t->plan;
    const uint8_t *in = lull_exec_row(plan, LULL_TENSOR_INPUT, y) + (size_t)x * FROM;
    uint8_t *out = lull_exec_row(plan, t->layer + 1, y) + (size_t)x * TO;
    (void)worker;
    for (unsigned i = 0; i < n; i++, in += FROM, out += TO) {
        memcpy(out, in + ALBEDO, 3);
        out[3] = in[PRESENT];
    }
}

/* Of the pixels [left, end) of a row's codes. */
static unsigned count_steady(const uint8_t *row, unsigned left, unsigned end)
{
    enum { PIXEL = 12, GREEN = 1 };
    unsigned count = 0;
    for (const uint8_t *c = row + (size_t)left * PIXEL + GREEN; left < end; left++, c += PIXEL)
        count += lull_is_steady(c[-PIXEL], c[0], c[PIXEL]);
    return count;
}

/* The shares of the prefiltered albedo of the runs around columns [x, x+n) of row y of the image,
 * at most LULL_BLOCK. */
static void find_shares(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned y,
                        unsigned n)
{
    enum { COUNTED = LULL_BLOCK / LULL_RUN + 2 + 2 * LULL_STEADY_BESIDE };
    const uint8_t *row = lull_exec_row(t->plan, LULL_TENSOR_INPUT, y);
    unsigned count = lull_exec_runs(shares, t, x, n), column = 0;
    uint16_t pixels[COUNTED], steady[COUNTED];
    for (unsigned i = 0; i < count + 2 * LULL_STEADY_BESIDE; i++) {
        unsigned here = lull_exec_run(t, shares->first + (int)i - LULL_STEADY_BESIDE, &column);
        pixels[i] = (uint16_t)here;
        steady[i] = (uint16_t)count_steady(row, column, column + here);
    }
    lull_exec_sum_around(pixels, count, LULL_STEADY_BESIDE);
    lull_exec_sum_around(steady, count, LULL_STEADY_BESIDE);
    for (unsigned i = 0; i < count; i++)
        shares->of[i] = lull_unsteady_share((float)pixels[i], (float)steady[i]);
}

void lull_exec_steady(const lull_task *t, unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = plan->model->graph.layer[t->layer].source[0], count;
    const float *albedo = lull_exec_floats(plan, tensor, y, x);
    const size_t plane = lull_exec_plane(plan, tensor);
    float *filtered = lull_exec_floats(plan, t->layer + 1, y, x);
    const size_t filtered_plane = lull_exec_plane(plan, t->layer + 1);
    float share[LULL_BLOCK];
    lull_run_shares shares;
    for (unsigned first = 0; first < n; first += count, albedo += count, filtered += count) {
        count = lull_min_u(LULL_BLOCK, n - first);
        find_shares(&shares, t, t->left + x + first, y, count);
        lull_exec_between_runs(share, &shares, t, t->left + x + first, count);
        for (unsigned i = 0; i < count; i++)
            for (unsigned c = 1; c < 4; c++) {
                const float a = albedo[c * plane + i];
                float *f = &filtered[c * filtered_plane + i];
                *f = a + share[i] * (*f - a);
            }
    }
}

/* Codes of the normal and the flags stay as they are in the input. */
void lull_exec_encode(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    enum { PIXEL = 12, KEPT = 6 };
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    const uint8_t *input = lull_exec_row(plan, layer->source[0], y) + (size_t)x * PIXEL;
    uint8_t *codes = lull_exec_row(plan, t->layer + 1, y) + (size_t)x * PIXEL;
    const unsigned inside = y < plan->frame.height ? lull_min_u(lull_exec_inside(t), x + n) : 0;
    const float *albedo = lull_exec_floats(plan, layer->source[2], y, x);
    const size_t plane = lull_exec_plane(plan, layer->source[2]);
    float *block = lull_exec_scratch(t, worker), *pixels = block + 3 * LULL_BLOCK;
    memcpy(codes, input, (size_t)n * PIXEL);
    if (lull_plan_is_idle(plan, layer->source[2] - 1u))
        return;
    for (unsigned first = x; first < inside; first += LULL_BLOCK) {
        unsigned count = lull_min_u(LULL_BLOCK, inside - first);
        uint8_t *made = codes + (size_t)(first - x) * PIXEL;
        lull_encoding from;
        lull_exec_radiance(&from, t, block, t->left + first, y, count);
        for (unsigned i = 0; i < count; i++)
            for (unsigned c = 0; c < 3; c++)
                pixels[3 * i + c] = albedo[(c + 1) * plane + first - x + i];
        from.albedo = pixels;
        from.normal = NULL;
        from.flags = 0;
        plan->model->kernels.encode(made, &from, count);
        for (unsigned i = 0; i < count; i++)
            memcpy(made + i * PIXEL + KEPT, input + (first - x + i) * PIXEL + KEPT, PIXEL - KEPT);
    }
}
