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

enum { ROWS = LULL_CELLS_ABOVE + 2, SOME = 16 }; /* of a window; cells at once */

/* The two rows of cells whose centres lie around a row of pixels, and where it lies between. */
typedef struct cell_rows {
    const float *rows[ROWS + 1]; /* sums of cells of the rows above the first, ... */
    size_t plane;
    int next;    /* 1: the second is the one after the first, 0: it is the same */
    int columns; /* that are held */
    float part;
} cell_rows;

/* Sums of SOME times `count` columns, from the left. */
static void sum_windows(float *sums, const float *column, unsigned count)
{
    memcpy(sums, column, SOME * sizeof *sums);
    for (unsigned i = 1; i < count; i++)
        for (unsigned k = 0; k < SOME; k++)
            sums[k] += column[k + i];
}

/* Gains of at most SOME cells from column x on of one of the two rows, from the sums around
 * them. */
static void find_row(float *gain, const cell_rows *cells, int row, int x, unsigned n)
{
    float near[LULL_CELL_SUMS][SOME], far[LULL_CELL_SUMS][SOME];
    int first = x - LULL_CELLS_BESIDE, skipped = first < 0 ? -first : 0;
    int end = SOME + 2 * LULL_CELLS_BESIDE;
    end = end < cells->columns - first ? end : cells->columns - first;
    for (unsigned c = 0; c < LULL_CELL_SUMS; c++) {
        float three[SOME + 2 * LULL_CELLS_BESIDE] = {0}, all[SOME + 2 * LULL_CELLS_BESIDE] = {0};
        const float *rows[ROWS];
        for (int i = 0; i < ROWS; i++)
            rows[i] = cells->rows[row + i] + c * cells->plane;
        for (int k = skipped; k < end; k++) {
            int at = first + k;
            three[k] = (rows[3][at] + rows[4][at]) + rows[5][at];
            all[k] = three[k] + ((rows[0][at] + rows[1][at]) + rows[2][at]);
        }
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

/* Gains of n cells, between those of both rows, for a row of pixels. */
static void find_gains(float *gain, const cell_rows *cells, int x, unsigned n)
{
    float below[SOME];
    find_row(gain, cells, 0, x, n);
    find_row(below, cells, cells->next, x, n);
    for (unsigned k = 0; k < n; k++)
        gain[k] += cells->part * (below[k] - gain[k]);
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
    unsigned tensor = layer->source[0], sums = layer->source[1], width = lull_exec_inside(t);
    unsigned down = lull_cell_count(LULL_CELL, plan->frame.height);
    int across = (int)lull_cell_count(LULL_CELL, t->left + width);
    size_t plane = lull_exec_plane(plan, tensor), out_plane = lull_exec_plane(plan, t->layer + 1);
    unsigned end = y < plan->frame.height ? lull_min_u(x + n, width) : 0;
    int held = (int)(t->left / LULL_CELL); /* the first cell that is */
    int near_row = lull_cell_near(LULL_CELL, (int)y, 0, (int)down);
    float *out = lull_exec_floats(plan, t->layer + 1, y, 0);
    const float *v = lull_exec_floats(plan, tensor, y, 0);
    const uint8_t *noise = lull_exec_noise(plan, tensor, y, 0);
    cell_rows cells;
    (void)worker;
    cells.plane = lull_exec_plane(plan, sums);
    cells.part = lull_cell_part(LULL_CELL, (int)y);
    cells.columns = across - held;
    cells.next = lull_cell_near(LULL_CELL, (int)y, 1, (int)down) - near_row;
    for (int k = 0; k < ROWS + 1; k++)
        cells.rows[k] = (const float *)(const void *)lull_exec_source(
            plan, sums, near_row + k - LULL_CELLS_ABOVE);
    while (x < end) {
        unsigned stop = lull_min_u(x + (SOME - 2) * LULL_CELL, end);
        int first = lull_cell_near(LULL_CELL, (int)(t->left + x), 0, across), last;
        float gain[SOME];
        first = first < held ? held : first;
        last = lull_cell_near(LULL_CELL, (int)(t->left + stop) - 1, 1, across);
        find_gains(gain, &cells, first - held, (unsigned)(last - first) + 1);
        while (x < stop) {
            unsigned at = t->left + x;
            unsigned count = LULL_CELL - (at + LULL_CELL / 2) % LULL_CELL;
            int near = lull_cell_near(LULL_CELL, (int)at, 0, across);
            int next = lull_cell_near(LULL_CELL, (int)at, 1, across);
            count = lull_min_u(count, stop - x);
            near = near < first ? first : near;
            correct(out + x, out_plane, v + x, plane, noise + x, gain[near - first],
                    gain[next - first], at, count);
            x += count;
        }
    }
}
