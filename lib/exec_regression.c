/* The regression of family K's filter: what normals and albedo explain of the difference between
 * input and result, by cells of pixels (bilateral.h). */
#include "exec.h"

/* Sums of `count` cells from sums of their columns. */
static void sum_columns(float *out, const float *v, unsigned count)
{
    for (unsigned i = 0; i < count; i++, v += LULL_FIT_SIDE)
        out[i] = ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

/* Adds row y of columns [x, end), at most LULL_FIT_BLOCK, to sums of columns. */
static void add_row(float *sums, const lull_task *t, unsigned x, unsigned end, unsigned y,
                    float *block)
{
    const lull_plan *plan = t->plan;
    const uint8_t *source = plan->model->graph.layer[t->layer].source;
    lull_encoding from = {0};
    lull_fitting at;
    at.v = lull_exec_floats(plan, source[0], y, x);
    at.smooth = lull_exec_floats(plan, source[1], y, x);
    at.normal = lull_exec_floats(plan, source[2], y, x);
    at.sum_plane = LULL_FIT_BLOCK;
    at.v_plane = lull_exec_plane(plan, source[0]);
    at.smooth_plane = lull_exec_plane(plan, source[1]);
    at.normal_plane = lull_exec_plane(plan, source[2]);
    for (; x < end; x += at.pixels) {
        at.sums = sums;
        at.pixels = lull_min_u(LULL_BLOCK, end - x);
        lull_exec_radiance(&from, t, block, t->left + x, y, at.pixels);
        plan->model->kernels.fit_sums(&at, &from);
        sums += at.pixels, at.v += at.pixels, at.smooth += at.pixels, at.normal += at.pixels;
    }
}

void lull_exec_fit_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned left = LULL_FIT_SIDE * x;
    unsigned end = lull_min_u(left + LULL_FIT_SIDE * n, lull_exec_inside(t));
    unsigned bottom = lull_min_u(LULL_FIT_SIDE * (y + 1), plan->frame.height);
    float *block = lull_exec_scratch(t, worker), *sums = block + 3 * LULL_BLOCK;
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    size_t plane = lull_exec_plane(plan, t->layer + 1);
    if (!lull_exec_has_features(plan))
        return;
    for (unsigned c = 0; c < LULL_FIT_SUMS; c++)
        memset(out + c * plane, 0, n * sizeof *out);
    for (; left < end; left += LULL_FIT_BLOCK, out += LULL_FIT_BLOCK / LULL_FIT_SIDE) {
        unsigned right = lull_min_u(left + LULL_FIT_BLOCK, end);
        memset(sums, 0, LULL_FIT_SUMS * LULL_FIT_BLOCK * sizeof *sums);
        for (unsigned row = LULL_FIT_SIDE * y; row < bottom; row++)
            add_row(sums, t, left, right, row, block);
        for (unsigned c = 0; c < LULL_FIT_SUMS; c++)
            sum_columns(out + c * plane, sums + c * LULL_FIT_BLOCK,
                        lull_cell_count(LULL_FIT_SIDE, right - left));
    }
}

void lull_exec_fit(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[0];
    unsigned cells = lull_cell_count(LULL_FIT_SIDE, lull_exec_inside(t));
    const float *rows[3];
    unsigned down = lull_cell_count(LULL_FIT_SIDE, plan->frame.height);
    if (!lull_exec_has_features(plan) || y >= down || x >= cells)
        return;
    for (int k = 0; k < 3; k++)
        rows[k] = (const float *)(const void *)lull_exec_source(plan, source, (int)y + k - 1) + x;
    plan->model->kernels.fit(lull_exec_floats(plan, t->layer + 1, y, x),
                             lull_exec_plane(plan, t->layer + 1), rows,
                             lull_exec_plane(plan, source), lull_min_u(n, cells - x),
                             lull_exec_scratch(t, worker));
}

#define SOME 32u /* cells at once: their coefficients fit into a worker's memory */
#define SOME_ROOM LULL_FIT_ROOM(SOME * LULL_FIT_SIDE)

/* Coefficients of the cells from the one before cell x on, SOME_ROOM at most, for row y of pixels:
 * between those of two rows of cells. The nearest ones stand for cells that there are not. */
static void find_coefficients(float *out, const lull_task *t, int x, unsigned y, unsigned room)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[3];
    int down = (int)lull_cell_count(LULL_FIT_SIDE, plan->frame.height);
    int cells = (int)lull_cell_count(LULL_FIT_SIDE, lull_exec_inside(t));
    unsigned near = (unsigned)lull_cell_near(LULL_FIT_SIDE, (int)y, 0, down);
    unsigned next = (unsigned)lull_cell_near(LULL_FIT_SIDE, (int)y, 1, down);
    const float *above = lull_exec_floats(plan, source, near, 0);
    const float *below = lull_exec_floats(plan, source, next, 0);
    float part = lull_cell_part(LULL_FIT_SIDE, (int)y);
    int begin = x == 0, end = cells + 1 - x < (int)room ? cells + 1 - x : (int)room;
    for (unsigned c = 0; c < LULL_FIT_COEFFICIENTS; c++, out += SOME_ROOM) {
        for (int i = begin; i < end; i++) {
            float first = above[x - 1 + i];
            out[i] = first + part * (below[x - 1 + i] - first);
        }
        if (begin)
            out[0] = out[1];
        for (int i = end; i < (int)room; i++)
            out[i] = out[end - 1];
        above += lull_exec_plane(plan, source);
        below += lull_exec_plane(plan, source);
    }
}

void lull_exec_regress(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const uint8_t *source = plan->model->graph.layer[t->layer].source;
    unsigned end = y < plan->frame.height ? lull_min_u(x + n, lull_exec_inside(t)) : 0;
    float *coefficients = lull_exec_scratch(t, worker);
    lull_regression r;
    if (x >= end)
        return;
    memcpy(lull_exec_noise(plan, t->layer + 1, y, x), lull_exec_noise(plan, source[0], y, x),
           end - x);
    r.out_plane = lull_exec_plane(plan, t->layer + 1);
    r.v_plane = lull_exec_plane(plan, source[0]);
    r.smooth_plane = lull_exec_plane(plan, source[1]);
    r.normal_plane = lull_exec_plane(plan, source[2]);
    r.coefficients = coefficients;
    r.plane = SOME_ROOM;
    for (; x < end; x += SOME * LULL_FIT_SIDE) {
        r.out = lull_exec_floats(plan, t->layer + 1, y, x);
        r.v = lull_exec_floats(plan, source[0], y, x);
        r.smooth = lull_exec_floats(plan, source[1], y, x);
        r.normal = lull_exec_floats(plan, source[2], y, x);
        r.pixels = lull_min_u(SOME * LULL_FIT_SIDE, end - x);
        if (lull_exec_has_features(plan)) {
            find_coefficients(coefficients, t, (int)(x / LULL_FIT_SIDE), y,
                              LULL_FIT_ROOM(r.pixels));
            plan->model->kernels.regress(&r);
        } else {
            for (unsigned c = 0; c < 3; c++)
                memcpy(r.out + c * r.out_plane, r.v + c * r.v_plane, r.pixels * sizeof *r.out);
        }
    }
}
