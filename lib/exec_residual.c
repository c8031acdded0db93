/* Step 8 of family K's filter: what the result lacks, by cells of pixels (bilateral.h). */
#include "exec.h"

/* The sum of 16 columns. */
static float sum_columns(float *v)
{
    for (unsigned half = LULL_CELL / 2; half; half /= 2)
        for (unsigned i = 0; i < half; i++)
            v[i] += v[i + half];
    return v[0];
}

/* Sums of the cells that begin at columns [x, end) of the image's rows from y on, at most
 * LULL_BLOCK columns, as columns. */
static void add_rows(float *sums, const lull_task *t, unsigned x, unsigned end, unsigned y,
                     float *block)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = plan->model->graph.layer[t->layer].source[0];
    unsigned smooth = lull_graph_find(&plan->model->graph, LULL_OP_SMOOTH);
    unsigned bottom = lull_min_u(y + LULL_CELL, plan->frame.height);
    lull_encoding from = {0};
    lull_balance b;
    b.sums = sums;
    b.sum_plane = LULL_BLOCK;
    b.v_plane = lull_exec_plane(plan, tensor);
    b.smooth_plane = lull_exec_plane(plan, smooth);
    b.pixels = end - x;
    for (; y < bottom; y++) {
        b.v = lull_exec_floats(plan, tensor, y, x);
        b.smooth = lull_exec_floats(plan, smooth, y, x);
        b.noise = lull_exec_noise(plan, tensor, y, x);
        lull_exec_radiance(&from, t, block, t->left + x, y, b.pixels);
        plan->model->kernels.residual(&b, &from);
    }
}

void lull_exec_residual(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned width = lull_exec_inside(t), left = LULL_CELL * x;
    unsigned end = lull_min_u(left + LULL_CELL * n, width);
    float *block = lull_exec_scratch(t, worker), *sums = block + 3 * LULL_BLOCK;
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    size_t plane = lull_exec_plane(plan, t->layer + 1);
    for (unsigned c = 0; c < LULL_CELL_SUMS; c++)
        memset(out + c * plane, 0, n * sizeof *out);
    if (!lull_exec_content(&plan->frame).is_hdr) /* clipped input lacks light itself */
        return;
    for (; left < end; left += LULL_BLOCK) {
        memset(sums, 0, LULL_CELL_SUMS * LULL_BLOCK * sizeof *sums);
        add_rows(sums, t, left, lull_min_u(left + LULL_BLOCK, end), LULL_CELL * y, block);
        for (unsigned i = 0; i < LULL_BLOCK && left + i < end; i += LULL_CELL, out++)
            for (unsigned c = 0; c < LULL_CELL_SUMS; c++)
                out[c * plane] = sum_columns(sums + c * LULL_BLOCK + i);
    }
}

enum {
    ROWS = LULL_CELLS_ABOVE + 2, /* of a window, and columns beside some cells at once */
    SOME = 16,
    WIDE = SOME + 2 * LULL_CELLS_BESIDE
};

/* Sums of cells from column first on, 0 where there are none: of the three last rows, and of
 * all. */
static void sum_rows(float *three, float *all, const float *const *rows, int first, int columns)
{
    for (int k = 0; k < WIDE; k++) {
        int at = first + k;
        three[k] = all[k] = 0.0f;
        if (at < 0 || at >= columns)
            continue;
        three[k] = (rows[ROWS - 3][at] + rows[ROWS - 2][at]) + rows[ROWS - 1][at];
        all[k] = three[k] + ((rows[0][at] + rows[1][at]) + rows[2][at]);
    }
}

/* Sums of SOME times `count` columns, from the left. */
static void sum_windows(float *sums, const float *column, unsigned count)
{
    memcpy(sums, column, SOME * sizeof *sums);
    for (unsigned i = 1; i < count; i++)
        for (unsigned k = 0; k < SOME; k++)
            sums[k] += column[k + i];
}

/* Gains of n cells, at most SOME, from column x on, from the rows of sums around them. */
static void find_gains(float *gain, const float *const *rows, size_t plane, int x, int columns,
                       unsigned n)
{
    float near[LULL_CELL_SUMS][SOME], far[LULL_CELL_SUMS][SOME];
    for (unsigned c = 0; c < LULL_CELL_SUMS; c++) {
        float three[WIDE], all[WIDE];
        const float *of[ROWS];
        for (int i = 0; i < ROWS; i++)
            of[i] = rows[i] + c * plane;
        sum_rows(three, all, of, x - LULL_CELLS_BESIDE, columns);
        sum_windows(near[c], three + LULL_CELLS_BESIDE - 2, 5);
        sum_windows(far[c], all, 2 * LULL_CELLS_BESIDE + 1);
    }
    for (unsigned k = 0; k < n; k++) {
        float beside[LULL_CELL_SUMS], around[LULL_CELL_SUMS];
        for (unsigned c = 0; c < LULL_CELL_SUMS; c++) {
            beside[c] = near[c][k];
            around[c] = far[c][k];
        }
        gain[k] = lull_cell_gain(beside, around);
    }
}

void lull_exec_gains(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[0];
    unsigned columns = lull_cell_count(LULL_CELL, lull_exec_inside(t));
    unsigned end = y * LULL_CELL < plan->frame.height ? lull_min_u(x + n, columns) : 0;
    const float *rows[ROWS];
    (void)worker;
    for (int k = 0; k < ROWS; k++)
        rows[k] = (const float *)(const void *)lull_exec_source(plan, source,
                                                                (int)y + k - LULL_CELLS_ABOVE);
    for (; x < end; x += SOME)
        find_gains(lull_exec_floats(plan, t->layer + 1, y, x), rows, lull_exec_plane(plan, source),
                   (int)x, (int)columns, lull_min_u(SOME, end - x));
}

/* n pixels between the centres of two cells whose gains are given. */
static void correct(float *out, size_t out_plane, const float *v, size_t plane,
                    const uint8_t *noise, float before, float after, unsigned x, unsigned n)
{
    float first = lull_cell_part(LULL_CELL, (int)x), g[LULL_CELL];
    for (unsigned i = 0; i < n; i++) {
        float part = first + (float)i * (1.0f / LULL_CELL), w = noise[i] * LULL_NOISE_SHARE;
        g[i] = (before + part * (after - before)) * (w < 1.0f ? w : 1.0f);
    }
    for (unsigned c = 0; c < 3; c++, out += out_plane, v += plane)
        for (unsigned i = 0; i < n; i++)
            out[i] = v[i] + v[i] * g[i];
}

void lull_exec_correct(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned tensor = layer->source[0], gains = layer->source[1], width = lull_exec_inside(t);
    int down = (int)lull_cell_count(LULL_CELL, plan->frame.height);
    int across = (int)lull_cell_count(LULL_CELL, width);
    size_t plane = lull_exec_plane(plan, tensor), out_plane = lull_exec_plane(plan, t->layer + 1);
    unsigned end = y < plan->frame.height ? lull_min_u(x + n, width) : 0, count;
    float *out = lull_exec_floats(plan, t->layer + 1, y, 0);
    const float *v = lull_exec_floats(plan, tensor, y, 0), *above, *below;
    const uint8_t *noise = lull_exec_noise(plan, tensor, y, 0);
    float part = lull_cell_part(LULL_CELL, (int)y);
    (void)worker;
    if (x >= end)
        return;
    above = lull_exec_floats(plan, gains, (unsigned)lull_cell_near(LULL_CELL, (int)y, 0, down), 0);
    below = lull_exec_floats(plan, gains, (unsigned)lull_cell_near(LULL_CELL, (int)y, 1, down), 0);
    for (; x < end; x += count) { /* between the centres of two cells */
        int near = lull_cell_near(LULL_CELL, (int)x, 0, across);
        int next = lull_cell_near(LULL_CELL, (int)x, 1, across);
        count = lull_min_u(LULL_CELL - (x + LULL_CELL / 2) % LULL_CELL, end - x);
        correct(out + x, out_plane, v + x, plane, noise + x,
                above[near] + part * (below[near] - above[near]),
                above[next] + part * (below[next] - above[next]), x, count);
    }
}
