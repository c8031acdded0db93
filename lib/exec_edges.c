/* Step 9 of family K's filter in frames full of noise: averages along edges, which are ragged where
 * each pixel saw one place (docs/kernel-prediction.md). */
#include "exec.h"
#include "filter.h"

void lull_exec_edges(float *out, const lull_task *t, float unscale, unsigned x, unsigned y,
                     unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned result = plan->model->graph.layers, height = plan->frame.height;
    unsigned smooth = lull_graph_find(&plan->model->graph, LULL_OP_SMOOTH);
    lull_edging e;
    e.out = out;
    e.v_plane = lull_exec_plane(plan, result);
    e.smooth_plane = lull_exec_plane(plan, smooth);
    e.strength = lull_plan_edges(plan);
    e.unscale = unscale;
    e.pixels = n;
    for (unsigned k = 0; k < 3; k++) {
        unsigned row = lull_min_u(lull_max_u(y + k, 1) - 1, height - 1);
        e.v[k] = lull_exec_floats(plan, result, row, x - t->left);
        e.smooth[k] = lull_exec_floats(plan, smooth, row, x - t->left);
    }
    if (y == 0 || y + 1 == height) {
        lull_filter_product(&e, 0, n - 1);
        return;
    }
    plan->model->kernels.edges(&e);
    if (x == 0)
        lull_filter_product(&e, 0, 0);
    if (x + n == plan->frame.width)
        lull_filter_product(&e, n - 1, n - 1);
}
