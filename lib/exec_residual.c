/* The last step of family K's filter: what the result lacks, by cells of pixels (bilateral.h), and,
 * in images without features, a share of the input where it has little noise. */
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
    unsigned smooth = lull_graph_find(&plan->model->graph, LULL_OP_SMOOTH, 0);
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

/* Pixels of n cells and sums of their noise codes, of those that have noise. */
static void sum_noise(float *out, const lull_task *t, unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned tensor = plan->model->graph.layer[t->layer].source[0], top = LULL_CELL * y;
    unsigned bottom = lull_min_u(top + LULL_CELL, plan->frame.height);
    size_t plane = lull_exec_plane(plan, t->layer + 1);
    for (unsigned i = 0; i < n; i++) {
        unsigned left = LULL_CELL * (x + i), sum = 0, pixels = 0;
        unsigned right = lull_min_u(left + LULL_CELL, lull_exec_inside(t));
        for (unsigned row = top; row < bottom && left < right; row++, pixels += right - left) {
            const uint8_t *noise = lull_exec_noise(plan, tensor, row, left);
            for (unsigned k = 0; k < right - left; k++)
                sum += noise[k];
        }
        out[LULL_CELL_PIXELS * plane + i] = (float)lull_noisy(pixels, pixels, sum);
        out[LULL_CELL_NOISE * plane + i] = (float)lull_noisy(sum, pixels, sum);
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
    if (!lull_exec_has_features(plan))
        sum_noise(out, t, x, y, n);
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

/* The two rows of cells whose centres lie around a row of pixels, and where it lies between. */
typedef struct cell_rows {
    const float *rows[2][3]; /* sums of cells of the row above, of it, and of the one below */
    size_t plane;
    float part;
} cell_rows;

enum { SOME = 16 }; /* cells at once */

/* Sums over each three rows by five columns of cells around n of them from column x on of one of
 * the two rows: `count` planes from `plane` on. */
static void sum_around(float (*sums)[SOME], unsigned plane, unsigned count, const cell_rows *cells,
                       unsigned row, int x, unsigned n)
{
    float column[SOME + 4];
    for (unsigned c = 0; c < count; c++) {
        size_t at = (plane + c) * cells->plane;
        const float *above = cells->rows[row][0] + at + x, *here = cells->rows[row][1] + at + x;
        const float *below = cells->rows[row][2] + at + x;
        for (int k = 0; k < (int)n + 4; k++)
            column[k] = (above[k - 2] + here[k - 2]) + below[k - 2];
        for (unsigned k = 0; k < n; k++)
            sums[c][k] = (((column[k] + column[k + 1]) + column[k + 2]) + column[k + 3]) +
                         column[k + 4];
    }
}

typedef void find_row_fn(float *values, const cell_rows *cells, unsigned row, int x, unsigned n);

/* Gains of these cells. */
static void find_row_gains(float *gain, const cell_rows *cells, unsigned row, int x, unsigned n)
{
    float sums[LULL_CELL_SUMS][SOME];
    sum_around(sums, 0, LULL_CELL_SUMS, cells, row, x, n);
    for (unsigned k = 0; k < n; k++)
        gain[k] = lull_cell_gain(sums[0][k], sums[1][k], sums[2][k], sums[3][k]);
}

/* Their shares of the input. */
static void find_row_shares(float *share, const cell_rows *cells, unsigned row, int x, unsigned n)
{
    float sums[2][SOME];
    sum_around(sums, LULL_CELL_PIXELS, 2, cells, row, x, n);
    for (unsigned k = 0; k < n; k++)
        share[k] = lull_input_share(sums[0][k], sums[1][k]);
}

/* Gains or shares of n cells, between those of both rows, for a row of pixels. */
static void find_cells(float *values, find_row_fn *find, const cell_rows *cells, int x, unsigned n)
{
    float below[SOME];
    find(values, cells, 0, x, n);
    find(below, cells, 1, x, n);
    for (unsigned k = 0; k < n; k++)
        values[k] += cells->part * (below[k] - values[k]);
}

/* A value of pixel i between the centres of two cells; pixel 0 lies at `first` on the way. */
static float value_at(float before, float after, float first, unsigned i)
{
    return before + (first + (float)i * (1.0f / LULL_CELL)) * (after - before);
}

/* n pixels between the centres of two cells whose gains are given. */
static void correct(float *out, size_t out_plane, const float *v, size_t plane,
                    const uint8_t *noise, float before, float after, unsigned x, unsigned n)
{
    float first = lull_cell_part(LULL_CELL, (int)x), g[LULL_CELL];
    for (unsigned i = 0; i < n; i++) {
        float w = noise[i] * LULL_NOISE_SHARE;
        g[i] = value_at(before, after, first, i) * (w < 1.0f ? w : 1.0f);
    }
    for (unsigned c = 0; c < 3; c++, out += out_plane, v += plane)
        for (unsigned i = 0; i < n; i++)
            out[i] = v[i] + v[i] * g[i];
}

/* Mixes the input into them alike. */
static void mix(float *out, size_t plane, const lull_encoding *from, float before, float after,
                unsigned x, unsigned n)
{
    float first = lull_cell_part(LULL_CELL, (int)x);
    for (unsigned i = 0; i < n; i++) {
        float share = value_at(before, after, first, i);
        for (unsigned c = 0; c < 3; c++) {
            float *v = out + c * plane + i;
            float r = lull_sane(from->radiance[3 * i + c], from->scale, 0.0f, from->most);
            *v = *v + share * (r - *v);
        }
    }
}

void lull_exec_correct(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned tensor = layer->source[0], sums = layer->source[1], width = lull_exec_inside(t);
    unsigned down = (plan->frame.height + LULL_CELL - 1) / LULL_CELL;
    int across = (int)((t->left + width + LULL_CELL - 1) / LULL_CELL);
    size_t plane = lull_exec_plane(plan, tensor), out_plane = lull_exec_plane(plan, t->layer + 1);
    unsigned end = y < plan->frame.height ? lull_min_u(x + n, width) : 0;
    int held = (int)(t->left / LULL_CELL); /* the first cell that is */
    int mixes = !lull_exec_has_features(plan);
    float *out = lull_exec_floats(plan, t->layer + 1, y, 0);
    const float *v = lull_exec_floats(plan, tensor, y, 0);
    const uint8_t *noise = lull_exec_noise(plan, tensor, y, 0);
    lull_encoding from = {0};
    cell_rows cells;
    cells.plane = lull_exec_plane(plan, sums);
    cells.part = lull_cell_part(LULL_CELL, (int)y);
    for (unsigned k = 0; k < 6; k++) {
        int row = lull_cell_near(LULL_CELL, (int)y, (int)k / 3, (int)down) + (int)(k % 3) - 1;
        cells.rows[k / 3][k % 3] = (const float *)(const void *)lull_exec_source(plan, sums, row);
    }
    while (x < end) {
        unsigned stop = lull_min_u(x + (SOME - 2) * LULL_CELL, end);
        int first = lull_cell_near(LULL_CELL, (int)(t->left + x), 0, across), last;
        float gain[SOME], share[SOME];
        first = first < held ? held : first;
        last = lull_cell_near(LULL_CELL, (int)(t->left + stop) - 1, 1, across);
        find_cells(gain, find_row_gains, &cells, first - held, (unsigned)(last - first) + 1);
        if (mixes)
            find_cells(share, find_row_shares, &cells, first - held, (unsigned)(last - first) + 1);
        while (x < stop) {
            unsigned at = t->left + x;
            unsigned count = LULL_CELL - (at + LULL_CELL / 2) % LULL_CELL;
            int near = lull_cell_near(LULL_CELL, (int)at, 0, across);
            int next = lull_cell_near(LULL_CELL, (int)at, 1, across);
            count = lull_min_u(count, stop - x);
            near = near < first ? first : near;
            correct(out + x, out_plane, v + x, plane, noise + x, gain[near - first],
                    gain[next - first], at, count);
            if (mixes && share[near - first] + share[next - first] > 0.0f) {
                lull_exec_radiance(&from, t, lull_exec_scratch(t, worker), at, y, count);
                mix(out + x, out_plane, &from, share[near - first], share[next - first], at, count);
            }
            x += count;
        }
    }
}
