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

/* Shares of the prefiltered albedo of runs, from number `first` on. */
enum { RUNS = LULL_BLOCK / LULL_RUN + 2, COUNTED = RUNS + 2 * LULL_STEADY_BESIDE };
typedef struct steady_runs {
    int first, runs; /* runs: of the whole image */
    float share[RUNS];
} steady_runs;

/* Of the pixels [left, end) of a row's codes. */
static unsigned count_steady(const uint8_t *row, unsigned left, unsigned end)
{
    enum { PIXEL = 12, GREEN = 1 };
    unsigned count = 0;
    for (const uint8_t *c = row + (size_t)left * PIXEL + GREEN; left < end; left++, c += PIXEL)
        count += lull_is_steady(c[-PIXEL], c[0], c[PIXEL]);
    return count;
}

/* Those of the runs between whose middles columns [x, x+n) of the image lie, at most LULL_BLOCK. */
static void find_shares(steady_runs *r, const lull_task *t, unsigned x, unsigned y, unsigned n)
{
    const uint8_t *row = lull_exec_row(t->plan, LULL_TENSOR_INPUT, y);
    unsigned end = t->left + lull_exec_inside(t), all_pixels = 0, all_steady = 0;
    uint8_t pixels[COUNTED], steady[COUNTED];
    int count;
    r->runs = (int)((t->plan->frame.width + LULL_RUN - 1) / LULL_RUN);
    r->first = lull_cell_near(LULL_RUN, (int)x, 0, r->runs);
    count = lull_cell_near(LULL_RUN, (int)(x + n - 1), 1, r->runs) - r->first + 1;
    for (int i = 0; i < count + 2 * LULL_STEADY_BESIDE; i++) {
        int left = (r->first + i - LULL_STEADY_BESIDE) * (int)LULL_RUN;
        int middle = i - 2 * LULL_STEADY_BESIDE; /* its window ends here */
        pixels[i] = steady[i] = 0;
        if (left >= (int)t->left && left < (int)end) {
            unsigned at = (unsigned)left - t->left;
            pixels[i] = (uint8_t)lull_min_u(LULL_RUN, end - (unsigned)left);
            steady[i] = (uint8_t)count_steady(row, at, at + pixels[i]);
        }
        all_pixels += pixels[i];
        all_steady += steady[i];
        if (middle < 0)
            continue;
        r->share[middle] = lull_unsteady_share((float)all_pixels, (float)all_steady);
        all_pixels -= pixels[middle];
        all_steady -= steady[middle];
    }
}

void lull_exec_steady(const lull_task *t, unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = plan->model->graph.layer[t->layer].source[0], count;
    const float *albedo = lull_exec_floats(plan, tensor, y, x);
    const size_t plane = lull_exec_plane(plan, tensor);
    float *filtered = lull_exec_floats(plan, t->layer + 1, y, x);
    const size_t filtered_plane = lull_exec_plane(plan, t->layer + 1);
    steady_runs r = {0};
    for (unsigned first = 0; first < n; first += count) {
        unsigned at = t->left + x + first;
        float before, after, part = lull_cell_part(LULL_RUN, (int)at);
        if (first % LULL_BLOCK == 0)
            find_shares(&r, t, at, y, lull_min_u(LULL_BLOCK, n - first));
        count = lull_min_u(LULL_RUN - (at + LULL_RUN / 2) % LULL_RUN, n - first);
        count = lull_min_u(count, LULL_BLOCK - first % LULL_BLOCK);
        before = r.share[lull_cell_near(LULL_RUN, (int)at, 0, r.runs) - r.first];
        after = r.share[lull_cell_near(LULL_RUN, (int)at, 1, r.runs) - r.first];
        for (unsigned i = first; i < first + count; i++, part += 1.0f / LULL_RUN) {
            float share = before + part * (after - before);
            for (unsigned c = 1; c < 4; c++) {
                const float *a = albedo + c * plane + i;
                float *f = filtered + c * filtered_plane + i;
                *f = *a + share * (*f - *a);
            }
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
