/* Rows of layers in Winograd's form: points of the sources, products, pixels. */
#include "exec.h"

/* Points of source `index` of layer l for the patches from pixel (x, y) on. */
static void make_points(lull_winograd *image, const lull_plan *plan, unsigned l, unsigned index,
                        unsigned x, unsigned y)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned tensor = layer->source[index];
    image->channels = plan->ring[tensor].channels;
    image->is_up = index == 0 && lull_layer_is_up(layer);
    for (unsigned i = 0; i < 4; i++) {
        int row = image->is_up ? (int)(y + i + 1) / 2 - 1 : (int)(y + i) - 1;
        ptrdiff_t column = (ptrdiff_t)(image->is_up ? x / 2 : x) - 1;
        image->row[i] = (const float *)(const void *)lull_exec_source(plan, tensor, row) +
                        column * (ptrdiff_t)image->channels;
    }
    plan->model->kernels.winograd_in(image);
}

/* The products at every point of patches of layer l, summed over the sources' channels. in[0],
 * in[1]: points of the sources, in[2]: of the outputs. */
static void multiply(const lull_winograd *in, const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const lull_packed_layer *packed = &plan->model->layer[l];
    const uint8_t *base = (const uint8_t *)plan->model;
    const uint8_t *weights[2];
    lull_conv conv;
    memset(&conv, 0, sizeof conv);
    conv.outputs = layer->outputs;
    conv.out_step = layer->outputs;
    conv.pixels = in[2].patches;
    conv.least = -LULL_FLT_MAX;
    weights[0] = base + packed->weights[LULL_PACK_SOURCE];
    weights[1] = base + packed->weights[LULL_PACK_SKIP];
    for (unsigned k = 0; k < LULL_WINOGRAD_POINTS; k++) {
        conv.out = in[2].points + k * in[2].plane;
        conv.bias = base + (k == LULL_WINOGRAD_BIAS ? packed->bias : packed->zeros);
        conv.segments = 0;
        for (unsigned s = 0; s < 2; s++) {
            lull_segment *segment = &conv.segment[conv.segments];
            if (!in[s].channels || (in[s].is_up && lull_winograd_vanishes(k)))
                continue;
            segment->row = in[s].points + k * in[s].plane;
            segment->weights = weights[s];
            segment->length = segment->step = in[s].channels;
            weights[s] += packed->point_bytes * in[s].channels;
            conv.segments++;
        }
        plan->model->kernels.conv_f32(&conv);
    }
}

void lull_exec_winograd(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    lull_winograd image[3];
    lull_points points;
    uint8_t *scratch = lull_exec_scratch(t, worker);
    lull_plan_points(&points, plan, t->layer);
    memset(image, 0, sizeof image);
    for (unsigned s = 0; s < 3; s++) {
        image[s].points = (float *)(void *)(scratch + points.offset[s]);
        image[s].plane = points.plane[s];
        image[s].patches = n / LULL_WINOGRAD_COLUMNS;
        if (s < 2 && layer->source[s] != LULL_TENSOR_NONE)
            make_points(&image[s], plan, t->layer, s, x, y << layer->pool);
    }
    image[2].channels = layer->outputs;
    multiply(image, plan, t->layer);
    image[2].out[0] = lull_exec_floats(plan, t->layer + 1, y, x >> layer->pool);
    if (!layer->pool)
        image[2].out[1] = lull_exec_floats(plan, t->layer + 1, y + 1, x);
    plan->model->kernels.winograd_out(&image[2]);
}
