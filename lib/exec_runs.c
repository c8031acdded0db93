/* Shares of runs of pixels of a row: of the input in the output (exec_mix.c). */
#include "exec.h"

/* The run before whose middle, or after it (next), a pixel is; the nearest at the edges. */
static int run_near(const lull_task *t, unsigned x, int next)
{
    return lull_cell_near(LULL_RUN, (int)x, next,
                          (int)((t->plan->frame.width + LULL_RUN - 1) / LULL_RUN));
}

unsigned lull_exec_runs(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n)
{
    shares->first = run_near(t, x, 0);
    return (unsigned)(run_near(t, x + n - 1, 1) - shares->first) + 1;
}

unsigned lull_exec_run(const lull_task *t, int run, unsigned *column)
{
    int left = run * (int)LULL_RUN, end = (int)(t->left + lull_exec_inside(t));
    if (left < (int)t->left || left >= end)
        return 0;
    *column = (unsigned)left - t->left;
    return lull_min_u(LULL_RUN, (unsigned)(end - left));
}

void lull_exec_sum_around(uint16_t *v, unsigned count, unsigned beside)
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

int lull_exec_has_share(const lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n)
{
    if (!shares->any)
        return 0;
    for (int i = run_near(t, x, 0); i <= run_near(t, x + n - 1, 1); i++)
        if (shares->of[i - shares->first] > 0.0f)
            return 1;
    return 0;
}

void lull_exec_between_runs(float *share, const lull_run_shares *shares, const lull_task *t,
                            unsigned x, unsigned n)
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
