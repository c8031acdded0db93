/* The last step of family K's filter: some of the input where there is little noise, so that what
 * is nearly converged does not lose by denoising (docs/kernel-prediction.md, step 9). */
#include "exec.h"

enum { SUMMED = LULL_MIXED / LULL_RUN + 2 + 2 * LULL_RUNS_BESIDE };

static lull_mixing mixing_of(const lull_plan *plan)
{
    return lull_mixing_of(plan->calm, lull_exec_has_features(plan), plan->frame.clean_aux);
}

/* The run before whose middle, or after it (next), a pixel is; the nearest at the edges. */
static int run_near(const lull_task *t, unsigned x, int next)
{
    return lull_cell_near(LULL_RUN, (int)x, next,
                          (int)lull_cell_count(LULL_RUN, t->plan->frame.width));
}

/* Sets `first` for columns [x, x+n) of the image; returns how many runs they need. */
static unsigned find_runs(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n)
{
    shares->first = run_near(t, x, 0);
    return (unsigned)(run_near(t, x + n - 1, 1) - shares->first) + 1;
}

/* Pixels of a run that are held, from *column of the strip on; 0, and *column as it was, if none
 * are. */
static unsigned held_run(const lull_task *t, int run, unsigned *column)
{
    int left = run * (int)LULL_RUN, end = (int)(t->left + lull_exec_inside(t));
    if (left < (int)t->left || left >= end)
        return 0;
    *column = (unsigned)left - t->left;
    return lull_min_u(LULL_RUN, (unsigned)(end - left));
}

/* Sums of v[i] .. v[i + 2 * beside] in the place of v[i], for i < count. */
LULL_NOINLINE static void sum_around(uint16_t *v, unsigned count, unsigned beside)
{
    unsigned sum = 0;
    for (unsigned i = 0; i < 2 * beside; i++)
        sum += v[i];
    for (unsigned i = 0; i < count; i++) {
        uint16_t leaves = v[i];
        sum += v[i + 2 * beside];
        v[i] = (uint16_t)sum;
        sum -= leaves;
    }
}

/* The shares of n pixels from column x of the image on, linear between the middles of runs. */
static void go_between(float *share, const lull_run_shares *shares, const lull_task *t, unsigned x,
                       unsigned n)
{
    unsigned count;
    for (unsigned end = x + n; x < end; x += count) { /* between the middles of two runs */
        float before = shares->of[run_near(t, x, 0) - shares->first];
        float after = shares->of[run_near(t, x, 1) - shares->first];
        float part = lull_cell_part(LULL_RUN, (int)x);
        count = lull_min_u(LULL_RUN - (x + LULL_RUN / 2) % LULL_RUN, end - x);
        for (unsigned i = 0; i < count; i++, part += 1.0f / LULL_RUN)
            *share++ = before + part * (after - before);
    }
}

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
    const lull_mixing mixing = mixing_of(plan);
    const uint8_t *noise;
    shares->any = 0;
    if (tensor == LULL_TENSOR_NONE)
        return;
    noise = lull_exec_noise(plan, tensor, y, 0);
    count = find_runs(shares, t, x, n);
    for (unsigned i = 0; i < count + 2 * LULL_RUNS_BESIDE; i++) {
        unsigned here = held_run(t, shares->first + (int)i - LULL_RUNS_BESIDE, &column);
        uint32_t sum = sum_bytes(noise + column, here);
        pixels[i] = (uint16_t)lull_noisy(here, here, sum);
        codes[i] = (uint16_t)lull_noisy(sum, here, sum);
    }
    sum_around(pixels, count, LULL_RUNS_BESIDE);
    sum_around(codes, count, LULL_RUNS_BESIDE);
    for (unsigned i = 0; i < count; i++) {
        shares->of[i] = lull_run_share((float)pixels[i], (float)codes[i], &mixing);
        shares->any |= shares->of[i] > 0.0f;
    }
}

int lull_exec_has_share(const lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n)
{
    if (!shares->any)
        return 0;
    for (int i = run_near(t, x, 0); i <= run_near(t, x + n - 1, 1); i++)
        if (shares->of[i - shares->first] > 0.0f)
            return 1;
    return 0;
}

void lull_exec_mix(float *v, const lull_run_shares *shares, const lull_task *t, float *block,
                   unsigned x, unsigned y, unsigned n)
{
    float share[LULL_BLOCK];
    const uint8_t *noise = lull_exec_noise(
        t->plan, lull_graph_mixed_by(&t->plan->model->graph), y, x - t->left);
    lull_encoding from = {0};
    lull_mixing mixing = mixing_of(t->plan);
    go_between(share, shares, t, x, n);
    lull_exec_radiance(&from, t, block, x, y, n);
    lull_exec_sane(block, &from, t, n);
    for (unsigned i = 0; i < n; i++, v += 3, block += 3) {
        float own = lull_pixel_share(share[i], noise[i], v, block, &mixing);
        for (unsigned c = 0; c < 3; c++)
            v[c] += own * (block[c] - v[c]);
    }
}
