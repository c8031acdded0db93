/* Rows of integer layers in patches: points of the source, products, pixels. */
#include "exec.h"

/* The points of the source of layer l for the patches from pixel (x, y) on. */
static void make_points(lull_patches *image, const lull_plan *plan, unsigned l, unsigned x,
                        unsigned y)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned tensor = layer->source[lull_layer_patched(layer)];
    ptrdiff_t pixel = (ptrdiff_t)lull_ring_pixel(&plan->ring[tensor]);
    image->channels = plan->ring[tensor].channels;
    for (unsigned i = 0; i < 6; i++)
        image->row[i] =
            lull_exec_source(plan, tensor, (int)(y + i) - 1) + ((ptrdiff_t)x - 1) * pixel;
    plan->model->kernels.patches_in(image);
}

/* The products at every point, summed over channels. */
static void multiply(const lull_patches *in, const lull_patches *out, const lull_plan *plan,
                     unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const lull_packed_layer *packed = &plan->model->layer[l];
    const uint8_t *base = (const uint8_t *)plan->model;
    lull_segment *segment;
    lull_conv conv;
    memset(&conv, 0, sizeof conv);
    segment = &conv.segment[0];
    conv.segments = 1;
    conv.outputs = layer->outputs;
    conv.out_step = layer->outputs;
    conv.pixels = in->patches;
    segment->length = segment->step = in->channels / 2;
    segment->weights = base + packed->patches;
    for (unsigned k = 0; k < LULL_PATCH_POINTS; k++) {
        for (unsigned part = k; part <= k + (in->is_wide ? LULL_PATCH_POINTS : 0);
             part += LULL_PATCH_POINTS) {
            segment->row = in->points + part * in->plane;
            conv.out = out->sums + part * out->plane;
            plan->model->kernels.points_int(&conv);
        }
        segment->weights = (const uint8_t *)segment->weights + packed->point_bytes;
    }
}

/* Where the outputs go: rows of the layer's tensor, or, of a skip, of what its convolution starts
 * from, after which that is made. */
static void make_rows(lull_patches *out, const lull_task *t, const lull_points *points, unsigned x,
                      unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    const lull_ring *ring = &plan->ring[t->layer + 1];
    uint8_t *start = (uint8_t *)lull_exec_scratch(t, worker) + points->offset[1];
    size_t row = points->plane[1] * sizeof(int32_t);
    out->is_raw = lull_layer_patched(layer) != 0;
    for (unsigned i = 0; i < LULL_PATCH_SIDE >> layer->pool; i++)
        out->out[i] = out->is_raw ? start + i * row
                                  : lull_exec_row(plan, t->layer + 1, y + i) +
                                        (x >> layer->pool) * lull_ring_pixel(ring);
    plan->model->kernels.patches_out(out);
    for (unsigned i = 0; i < LULL_PATCH_SIDE && out->is_raw; i++)
        lull_exec_conv(plan, t->layer, (const int32_t *)(const void *)out->out[i], x, y + i, n);
}

void lull_exec_patches(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    const lull_packed_layer *packed = &plan->model->layer[t->layer];
    const lull_ring *ring = &plan->ring[t->layer + 1];
    uint8_t *base = (uint8_t *)plan->model;
    uint8_t *scratch = lull_exec_scratch(t, worker);
    lull_patches in, out;
    lull_points points;
    lull_plan_points(&points, plan, t->layer);
    memset(&in, 0, sizeof in);
    in.patches = n / LULL_PATCH_SIDE;
    in.is_wide = plan->ring[layer->source[lull_layer_patched(layer)]].dtype == LULL_DTYPE_U15;
    out = in;
    in.points = (int16_t *)(void *)(scratch + points.offset[0]);
    in.plane = points.plane[0];
    make_points(&in, plan, t->layer, x, y << layer->pool);
    out.sums = (int32_t *)(void *)(scratch + points.offset[2]);
    out.plane = points.plane[2];
    out.channels = layer->outputs;
    multiply(&in, &out, plan, t->layer);
    out.is_pooled = layer->pool;
    out.bias = (const int32_t *)(const void *)(base + packed->bias);
    out.multiplier = (const int32_t *)(const void *)(base + packed->multiplier);
    out.shift = in.is_wide ? packed->wide_shift : 0;
    out.is_small = packed->is_small;
    out.out_max = ring->dtype == LULL_DTYPE_U15 ? 32767 : 255;
    make_rows(&out, t, &points, x, y, n, worker);
}
