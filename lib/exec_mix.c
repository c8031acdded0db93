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

void lull_exec_shares(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned y,
                      unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = lull_graph_mixed_by(&plan->model->graph), count, column = 0;
    uint16_t pixels[SUMMED], codes[SUMMED];
    const uint8_t *noise;
    float per_code;
    shares->any = 0;
    if (tensor == LULL_TENSOR_NONE)
        return;
    noise = lull_exec_noise(plan, tensor, y, 0);
    per_code = lull_exec_has_features(plan) ? LULL_SHARE_PER_CODE : LULL_SHARE_PER_CODE_ALONE;
    count = lull_exec_runs(shares, t, x, n);
    for (unsigned i = 0; i < count + 2 * LULL_RUNS_BESIDE; i++) {
        unsigned here = lull_exec_run(t, shares->first + (int)i - LULL_RUNS_BESIDE, &column);
        uint32_t sum = sum_bytes(noise + column, here);
        pixels[i] = (uint16_t)lull_noisy(here, here, sum);
        codes[i] = (uint16_t)lull_noisy(sum, here, sum);
    }
    lull_exec_sum_around(pixels, count, LULL_RUNS_BESIDE);
    lull_exec_sum_around(codes, count, LULL_RUNS_BESIDE);
    for (unsigned i = 0; i < count; i++) {
        shares->of[i] = lull_run_share((float)pixels[i], (float)codes[i], per_code);
        shares->any |= shares->of[i] > 0.0f;
    }
}

void lull_exec_mix(float *v, const lull_run_shares *shares, const lull_task *t, float *block,
                   unsigned x, unsigned y, unsigned n)
{
    float share[LULL_BLOCK];
    const uint8_t *noise = lull_exec_noise(
        t->plan, lull_graph_mixed_by(&t->plan->model->graph), y, x - t->left);
    lull_encoding from = {0};
    lull_curve sane = {LULL_TRANSFER_LINEAR, 1.0f, 0.0f, 0.0f, 0};
    lull_exec_between_runs(share, shares, t, x, n);
    lull_exec_radiance(&from, t, block, x, y, n);
    sane.scale = from.scale;
    sane.high = from.most;
    if (from.radiance != block)
        memcpy(block, from.radiance, 3 * n * sizeof *block);
    t->plan->model->kernels.curve_in(block, &sane, 3 * (size_t)n);
    for (unsigned i = 0; i < n; i++, v += 3, block += 3) {
        float own = lull_pixel_share(share[i], noise[i]);
        for (unsigned c = 0; c < 3; c++)
            v[c] += own * (block[c] - v[c]);
    }
}
