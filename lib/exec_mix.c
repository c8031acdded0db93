/* The last step of family K's filter: some of the input where there is little noise, so that what
 * is nearly converged does not lose by denoising (docs/kernel-prediction.md, step 9). */
#include "exec.h"

enum { SUMMED = LULL_MIXED / LULL_RUN + 2 + 2 * LULL_RUNS_BESIDE };

/* The sum of n bytes, at most LULL_RUN. */
static uint32_t sum_bytes(const uint8_t *v, unsigned n)
{
    const uint64_t even = UINT64_C(0x00ff00ff00ff00ff);
    uint64_t a, b;
    uint32_t sum = 0;
    if (n == LULL_RUN) { /* four sums of 16 bits each, then all four in the uppermost */
        memcpy(&a, v, sizeof a);
        memcpy(&b, v + sizeof a, sizeof b);
        a = ((a & even) + (a >> 8 & even)) + ((b & even) + (b >> 8 & even));
        return (uint32_t)(a * UINT64_C(0x0001000100010001) >> 48);
    }
    for (unsigned i = 0; i < n; i++)
        sum += v[i];
    return sum;
}

/* The run before whose middle, or after it (next), a pixel is; the nearest at the edges. */
static int run_near(const lull_task *t, unsigned x, int next)
{
    return lull_cell_near(LULL_RUN, (int)x, next,
                          (int)((t->plan->frame.width + LULL_RUN - 1) / LULL_RUN));
}

void lull_exec_shares(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned y,
                      unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = lull_graph_mixed_by(&plan->model->graph), end = t->left + lull_exec_inside(t);
    uint32_t all_pixels = 0, all_codes = 0;
    uint16_t pixels[SUMMED], codes[SUMMED];
    const uint8_t *noise;
    float per_code;
    int count;
    shares->any = 0;
    if (tensor == LULL_TENSOR_NONE)
        return;
    noise = lull_exec_noise(plan, tensor, y, 0);
    per_code = lull_exec_has_features(plan) ? LULL_SHARE_PER_CODE : LULL_SHARE_PER_CODE_ALONE;
    shares->first = run_near(t, x, 0);
    count = run_near(t, x + n - 1, 1) - shares->first + 1;
    for (int i = 0; i < count + 2 * LULL_RUNS_BESIDE; i++) {
        int left = (shares->first + i - LULL_RUNS_BESIDE) * (int)LULL_RUN, middle;
        uint32_t here = 0, sum = 0;
        if (left >= (int)t->left && left < (int)end) {
            here = lull_min_u(LULL_RUN, end - (unsigned)left);
            sum = sum_bytes(noise + ((unsigned)left - t->left), here);
        }
        pixels[i] = (uint16_t)lull_noisy(here, here, sum);
        codes[i] = (uint16_t)lull_noisy(sum, here, sum);
        all_pixels += pixels[i];
        all_codes += codes[i];
        middle = i - 2 * LULL_RUNS_BESIDE; /* its window ends here */
        if (middle < 0)
            continue;
        shares->of[middle] = lull_run_share((float)all_pixels, (float)all_codes, per_code);
        shares->any |= shares->of[middle] > 0.0f;
        all_pixels -= pixels[middle];
        all_codes -= codes[middle];
    }
}

int lull_exec_is_mixed(const lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n)
{
    if (!shares->any)
        return 0;
    for (int i = run_near(t, x, 0); i <= run_near(t, x + n - 1, 1); i++)
        if (shares->of[i - shares->first] > 0.0f)
            return 1;
    return 0;
}

/* The shares of n pixels. */
static void find_shares(float *share, const lull_run_shares *shares, const lull_task *t, unsigned x,
                        unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = lull_graph_mixed_by(&plan->model->graph), count;
    const uint8_t *noise = lull_exec_noise(plan, tensor, y, x - t->left);
    for (unsigned end = x + n; x < end; x += count) { /* between the middles of two runs */
        float before = shares->of[run_near(t, x, 0) - shares->first];
        float after = shares->of[run_near(t, x, 1) - shares->first];
        float part = lull_cell_part(LULL_RUN, (int)x);
        count = lull_min_u(LULL_RUN - (x + LULL_RUN / 2) % LULL_RUN, end - x);
        for (unsigned i = 0; i < count; i++, part += 1.0f / LULL_RUN)
            *share++ = lull_pixel_share(before + part * (after - before), *noise++);
    }
}

void lull_exec_mix(float *v, const lull_run_shares *shares, const lull_task *t, float *block,
                   unsigned x, unsigned y, unsigned n)
{
    float share[LULL_BLOCK];
    lull_encoding from = {0};
    lull_curve sane = {LULL_TRANSFER_LINEAR, 1.0f, 0.0f, 0.0f, 0};
    find_shares(share, shares, t, x, y, n);
    lull_exec_radiance(&from, t, block, x, y, n);
    sane.scale = from.scale;
    sane.high = from.most;
    if (from.radiance != block)
        memcpy(block, from.radiance, 3 * n * sizeof *block);
    t->plan->model->kernels.curve_in(block, &sane, 3 * (size_t)n);
    for (unsigned i = 0; i < n; i++, v += 3, block += 3)
        for (unsigned c = 0; c < 3; c++)
            v[c] += share[i] * (block[c] - v[c]);
}
