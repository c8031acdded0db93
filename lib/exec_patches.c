/* Rows of integer layers in patches: points of the source, products, pixels. */
#include "exec.h"

/* The points of source `s` of layer l for the patches from its pixel (x, y) on. */
static void make_points(lull_patches *image, const lull_plan *plan, unsigned l, unsigned s,
                        unsigned x, unsigned y)
{
    unsigned tensor = plan->model->graph.layer[l].source[s];
    ptrdiff_t pixel = (ptrdiff_t)lull_ring_pixel(&plan->ring[tensor]);
    image->channels = plan->ring[tensor].channels;
    image->is_wide = plan->ring[tensor].dtype == LULL_DTYPE_U15;
    for (unsigned i = 0; i < lull_patch_side(image->is_wide) + 2; i++)
        image->row[i] =
            lull_exec_source(plan, tensor, (int)(y + i) - 1) + ((ptrdiff_t)x - 1) * pixel;
    plan->model->kernels.patches_in(image);
}

/* The products at every point where weights do not vanish, summed over channels. Returns the end of
 * the weights. */
static const uint8_t *multiply(const lull_patches *in, const lull_patches *out,
                               const lull_kernels *kernels, const uint8_t *weights)
{
    size_t bytes = lull_align_up(out->channels, kernels->block_int) * in->channels * 2;
    lull_segment *segment;
    lull_conv conv;
    memset(&conv, 0, sizeof conv);
    segment = &conv.segment[0];
    conv.segments = 1;
    conv.outputs = out->channels;
    conv.out_step = out->channels;
    conv.pixels = in->patches;
    segment->length = segment->step = in->channels / 2;
    for (unsigned k = 0; k < lull_patch_points(in->is_wide); k++) {
        if (lull_patch_vanishes(out->phase, k))
            continue;
        segment->weights = weights;
        segment->row = in->points + k * in->plane;
        conv.out = out->sums + k * out->plane;
        kernels->points_int(&conv);
        weights += bytes;
    }
    return weights;
}

/* What an upsampled source adds to eight rows of pixels, with the bias, at `start`. */
static void make_phases(lull_patches *in, lull_patches *out, const lull_plan *plan, unsigned l,
                        unsigned x, unsigned y, unsigned n, int32_t *start, size_t row)
{
    const lull_kernels *kernels = &plan->model->kernels;
    const uint8_t *weights = (const uint8_t *)plan->model + plan->model->layer[l].patches[0];
    in->patches = out->patches = n / (2 * LULL_PATCH_SIDE);
    make_points(in, plan, l, 0, x / 2, y / 2);
    out->is_raw = 1;
    out->raw_step = (size_t)2 * out->channels;
    for (unsigned phase = 0; phase < LULL_PATCH_WHOLE; phase++) {
        out->phase = phase;
        weights = multiply(in, out, kernels, weights);
        for (unsigned i = 0; i < LULL_PATCH_SIDE; i++)
            out->out[i] = (uint8_t *)(start + (2 * i + (phase >> 1)) * row +
                                      (phase & 1) * out->channels);
        kernels->patches_out(out);
    }
}

/* The rows of one patch from y on (before pooling) of a source that is not upsampled: rows of the
 * layer's tensor, which start from `start` if it has phases, or else, of a skip, what its
 * convolution starts from. */
static void make_rows(lull_patches *in, lull_patches *out, const lull_plan *plan, unsigned l,
                      unsigned x, unsigned y, unsigned n, int32_t *start, size_t row)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const lull_packed_layer *packed = &plan->model->layer[l];
    int is_wide = lull_layer_has_wide_patches(&plan->model->graph, l);
    unsigned source = layer->has_patches >> 1, side = lull_patch_side(is_wide);
    size_t pixel = lull_ring_pixel(&plan->ring[l + 1]);
    in->patches = out->patches = n / side;
    make_points(in, plan, l, source, x, y);
    out->is_wide = is_wide;
    out->phase = LULL_PATCH_WHOLE;
    multiply(in, out, &plan->model->kernels,
             (const uint8_t *)plan->model + packed->patches[source]);
    out->shift = is_wide ? packed->wide_shift : 0;
    out->is_pooled = layer->pool;
    out->is_raw = source && !lull_layer_has_phases(layer);
    out->raw_step = out->channels;
    out->start = lull_layer_has_phases(layer) ? start : NULL;
    out->start_row = row;
    for (unsigned i = 0; i < side >> layer->pool; i++)
        out->out[i] = out->is_raw ? (uint8_t *)(start + i * row)
                                  : lull_exec_row(plan, l + 1, (y >> layer->pool) + i) +
                                        (x >> layer->pool) * pixel;
    plan->model->kernels.patches_out(out);
}

void lull_exec_patches(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    const lull_packed_layer *packed = &plan->model->layer[t->layer];
    uint8_t *base = (uint8_t *)plan->model;
    uint8_t *scratch = lull_exec_scratch(t, worker);
    unsigned rows = LULL_PATCH_SIDE << lull_layer_has_phases(layer);
    unsigned side = lull_patch_side(lull_layer_has_wide_patches(&plan->model->graph, t->layer));
    int32_t *start;
    lull_patches in, out;
    lull_points points;
    size_t row;
    lull_plan_points(&points, plan, t->layer);
    start = (int32_t *)(void *)(scratch + points.offset[1]);
    row = points.plane[1];
    memset(&in, 0, sizeof in);
    out = in;
    in.points = (int16_t *)(void *)(scratch + points.offset[0]);
    in.plane = points.plane[0];
    out.sums = (int32_t *)(void *)(scratch + points.offset[2]);
    out.plane = points.plane[2];
    out.room = (int32_t *)(void *)(scratch + points.room);
    out.channels = layer->outputs;
    out.bias = (const int32_t *)(const void *)(base + packed->bias);
    out.multiplier = (const int32_t *)(const void *)(base + packed->multiplier);
    out.is_small = packed->is_small;
    out.out_max = (int32_t)lull_graph_max(&plan->model->graph, t->layer + 1);
    y <<= layer->pool;
    if (lull_layer_has_phases(layer))
        make_phases(&in, &out, plan, t->layer, x, y, n, start, row);
    if (layer->has_patches > lull_layer_has_phases(layer))
        for (unsigned i = 0; i < rows; i += side)
            make_rows(&in, &out, plan, t->layer, x, y + i, n, start + i * row, row);
    if (layer->source[1] != LULL_TENSOR_NONE && layer->has_patches < 3)
        for (unsigned i = 0; i < rows; i++)
            lull_exec_conv(plan, t->layer, start + i * row, x, y + i, n);
}
