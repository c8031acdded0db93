/* Runs a plan: rows in, every layer in turn, rows out. */
#include "exposure.h"
#include "filter.h"
#include "image.h"
#include "plan.h"
#include "transfer.h"

#define FLT_MAX_ 3.402823466e38f

/* What the body functions of one parallel_for see. */
typedef struct task {
    lull_plan *plan;
    const lull_images *images;
    unsigned layer, chunk;    /* chunk: columns of a task */
    unsigned first, base_row; /* first row to make; row of the frame at the start of the images */
    unsigned begin, end, left, right; /* columns: of the strip's output, and held in the rings */
} task;

/* How a frame's main image is read and written; docs/design.md section 1. */
typedef struct content_rule {
    lull_transfer transfer;
    uint8_t is_hdr, is_signed;
} content_rule;

static content_rule content_of(const lull_frame *frame)
{
    static const content_rule rules[LULL_CONTENT_COUNT] = {
        {LULL_TRANSFER_PU, 1, 0},     /* HDR */
        {LULL_TRANSFER_SRGB, 0, 0},   /* LDR */
        {LULL_TRANSFER_LINEAR, 0, 0}, /* SRGB */
        {LULL_TRANSFER_LOG, 1, 0},    /* LIGHTMAP_HDR */
        {LULL_TRANSFER_LINEAR, 0, 1}, /* LIGHTMAP_DIR */
    };
    static const content_rule normals = {LULL_TRANSFER_LINEAR, 0, 1};
    return frame->features == LULL_HAS_NORMAL ? normals : rules[frame->content];
}

static const lull_image *feature_image(const lull_images *images, unsigned feature)
{
    return feature == 0 ? &images->color : feature == 1 ? &images->albedo : &images->normal;
}

static uint8_t *row_of(const lull_plan *plan, unsigned tensor, unsigned y)
{
    const lull_ring *ring = &plan->ring[tensor];
    return (uint8_t *)plan +
           (ring->offset + (size_t)(y % ring->rows) * ring->row_units) * LULL_ALIGN +
           lull_ring_left(ring);
}

static float *floats_of(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x)
{
    return (float *)(void *)row_of(plan, tensor, y) + (size_t)x * plan->ring[tensor].channels;
}

/* Row y of a tensor for reading; rows outside are zeros. */
static const uint8_t *source_row(const lull_plan *plan, unsigned tensor, int y)
{
    const lull_ring *ring = &plan->ring[tensor];
    if (y < 0 || y >= (int)(plan->height >> ring->level))
        return (uint8_t *)plan + plan->zero_row + lull_ring_left(ring);
    return row_of(plan, tensor, (unsigned)y);
}

static void parallel(const lull_plan *plan, const lull_host *host, unsigned count,
                     void (*body)(void *, unsigned, unsigned), task *t)
{
    if (host && host->parallel_for && plan->threads > 1 && count > 1)
        host->parallel_for(host->user, count, body, t);
    else
        for (unsigned i = 0; i < count; i++)
            body(t, i, 0);
}

/* ---- Input ---------------------------------------------------------------------------------------- */

/* n pixels of one feature, sanitised and in the network's range: signed ones to [0,1] if they are the
 * main image. */
static void load_feature(float *out, const task *t, unsigned feature, int is_main, unsigned x,
                         unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    content_rule rule = content_of(&plan->frame);
    int is_signed = is_main ? rule.is_signed : feature == 2;
    float high = is_main && rule.is_hdr ? FLT_MAX_ : 1.0f;
    lull_image_load(out, feature_image(t->images, feature), plan->frame.width, x, y, n);
    lull_sanitize(out, 3 * (size_t)n, is_main ? plan->scale : 1.0f, is_signed ? -1.0f : 0.0f, high);
    for (unsigned i = 0; is_signed && i < 3 * n; i++)
        out[i] = out[i] * 0.5f + 0.5f;
}

/* Three channels of n pixels, from channel `at` on, of a U network's input row. */
static void put_input(const lull_plan *plan, uint8_t *row, const float *v, unsigned at, unsigned n)
{
    const float *scale = plan->model->input_scale + at;
    for (unsigned i = 0; i < n; i++, v += 3, row += lull_ring_pixel(&plan->ring[0])) {
        uint16_t codes[3];
        if (plan->ring[0].dtype == LULL_DTYPE_F32) {
            memcpy(row + at * sizeof *v, v, 3 * sizeof *v);
            continue;
        }
        for (unsigned c = 0; c < 3; c++) {
            float code = v[c] * scale[c] + 0.5f;
            codes[c] = code < 32767.0f ? (uint16_t)code : 32767;
        }
        memcpy(row + at * sizeof *codes, codes, sizeof codes);
    }
}

/* n pixels from column x on of row y of a U network's input: the features in the order of their bits. */
static void load_direct(const task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    lull_plan *plan = t->plan;
    uint8_t *row = row_of(plan, 0, y) + (x - t->left) * lull_ring_pixel(&plan->ring[0]);
    unsigned at = 0;
    for (unsigned feature = 0; feature < 3; feature++) {
        if (!(plan->frame.features >> feature & 1))
            continue;
        load_feature(block, t, feature, at == 0, x, y - t->base_row, n);
        if (at == 0)
            lull_transfer_forward(content_of(&plan->frame).transfer, block, 3 * (size_t)n);
        put_input(plan, row, block, at, n);
        at += 3;
    }
}

/* The same for family K: codes, radiance and albedo. */
static void load_kernel(const task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    lull_plan *plan = t->plan;
    unsigned features = plan->frame.features, column = x - t->left;
    unsigned main_feature = features & LULL_HAS_COLOR ? 0 : features & LULL_HAS_ALBEDO ? 1 : 2;
    float *radiance = floats_of(plan, LULL_TENSOR_RADIANCE, y, column);
    float *albedo = floats_of(plan, LULL_TENSOR_ALBEDO, y, column);
    float *aux[3] = {NULL, NULL, NULL};
    load_feature(radiance, t, main_feature, 1, x, y - t->base_row, n);
    if (plan->frame.content == LULL_SRGB)
        lull_transfer_inverse(LULL_TRANSFER_SRGB, radiance, 3 * (size_t)n);
    for (unsigned feature = main_feature + 1; feature < 3; feature++) {
        if (!(features >> feature & 1))
            continue;
        aux[feature] = block + (feature - 1) * 3 * LULL_BLOCK;
        load_feature(aux[feature], t, feature, 0, x, y - t->base_row, n);
        for (unsigned i = 0; feature == 2 && i < 3 * n; i++) /* codes are of signed normals */
            aux[2][i] = aux[2][i] * 2.0f - 1.0f;
    }
    lull_filter_encode(row_of(plan, 0, y) + column * lull_ring_pixel(&plan->ring[0]), radiance,
                       aux[1], aux[2], !content_of(&plan->frame).is_hdr, n);
    for (unsigned i = 0; i < n; i++) {
        albedo[4 * i] = 1.0f;
        for (unsigned c = 0; c < 3; c++)
            albedo[4 * i + 1 + c] = aux[1] ? aux[1][3 * i + c] : 1.0f - LULL_FILTER_EPSILON;
    }
}

/* The n bytes before `from` to before `to`. */
static void copy_before(uint8_t *to, const uint8_t *from, size_t n)
{
    memcpy(to - n, from - n, n);
}

/* Copies the last `columns` columns before `column` of row y of all loaded tensors from (or to) the
 * place where they are kept for the next strip. */
static void keep_columns(const task *t, unsigned y, unsigned column, int is_store)
{
    lull_plan *plan = t->plan;
    unsigned columns = lull_min_u(plan->saved_width, column);
    uint8_t *saved = (uint8_t *)plan + plan->saved;
    for (unsigned i = 0; i < LULL_LOADED; i++) {
        size_t pixel, at;
        uint8_t *row;
        if (!lull_plan_has(plan, lull_loaded[i]))
            continue;
        pixel = lull_ring_pixel(&plan->ring[lull_loaded[i]]);
        row = row_of(plan, lull_loaded[i], y) + (column - t->left) * pixel;
        at = ((size_t)y + 1) * plan->saved_width * pixel; /* the end of row y's */
        copy_before(is_store ? saved + at : row, is_store ? row : saved + at, columns * pixel);
        saved += (size_t)plan->frame.height * plan->saved_width * pixel;
    }
}

/* One row of the network's input, columns [t->left, t->right). */
static void load_row(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    lull_plan *plan = t->plan;
    const lull_frame *frame = &plan->frame;
    unsigned y = t->first + index, x = t->left, right = lull_min_u(t->right, frame->width);
    float *block = (float *)(void *)((uint8_t *)plan + plan->scratch +
                                     plan->scratch_bytes * worker);
    for (unsigned i = 0; i < LULL_LOADED; i++)
        if (lull_plan_has(plan, lull_loaded[i]))
            memset(row_of(plan, lull_loaded[i], y), 0,
                   (t->right - t->left) * lull_ring_pixel(&plan->ring[lull_loaded[i]]));
    if (y >= frame->height)
        return;
    if (plan->saved_width && t->begin > 0) { /* overwritten by the strips before */
        x = t->begin;
        keep_columns(t, y, x, 0);
    }
    for (; x < right; x += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, right - x);
        if (plan->model->graph.family == LULL_FAMILY_K)
            load_kernel(t, block, x, y, n);
        else
            load_direct(t, block, x, y, n);
    }
    if (plan->saved_width)
        keep_columns(t, y, t->end, 1);
}

/* ---- Layers --------------------------------------------------------------------------------------- */

/* Appends the run of `columns` pixels from column x on of row y of a tensor. */
static void add_run(lull_conv *conv, const lull_plan *plan, unsigned tensor, int y, int x,
                    unsigned columns, unsigned stride, size_t weights)
{
    const lull_ring *ring = &plan->ring[tensor];
    lull_segment *segment = &conv->segment[conv->segments++];
    segment->row = source_row(plan, tensor, y) + x * (ptrdiff_t)lull_ring_pixel(ring);
    segment->weights = (const uint8_t *)plan->model + weights;
    segment->length = lull_pack_length((lull_dtype)ring->dtype, columns * ring->channels);
    segment->step = stride * ring->channels;
    if (ring->dtype == LULL_DTYPE_U15)
        conv->wide = conv->segments;
}

/* The source of layer l around pixel (x, y): three rows of 3x3 taps, or, upsampled, the two rows of the
 * phase's 2x2 taps for the pixels x, x + 2, ... */
static void add_source(lull_conv *conv, const lull_plan *plan, unsigned l, int x, int y)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const size_t *weights = plan->model->layer[l].weights;
    unsigned phase = 2 * ((unsigned)y & 1) + ((unsigned)x & 1);
    int rows = lull_layer_is_up(layer) ? 2 : layer->op == LULL_OP_HEAD ? 1 : 3;
    int before = rows == 1 ? 0 : 1;
    if (lull_layer_is_up(layer)) {
        x = (x + 1) / 2;
        y = (y + 1) / 2;
    }
    for (int dy = 0; dy < rows; dy++)
        add_run(conv, plan, layer->source[0], y - before + dy, x - before, (unsigned)rows, 1,
                weights[lull_pack_block(layer, phase, (unsigned)dy)]);
}

/* The skip of layer l around the pixels x, x + stride, ... of row y. */
static void add_skip(lull_conv *conv, const lull_plan *plan, unsigned l, int x, int y,
                     unsigned stride)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    if (layer->source[1] == LULL_TENSOR_NONE)
        return;
    for (int dy = 0; dy < 3; dy++)
        add_run(conv, plan, layer->source[1], y - 1 + dy, x - 1, 3, stride,
                plan->model->layer[l].weights[LULL_PACK_SKIP + dy]);
}

/* Columns [x, x+n) of row y of a layer's convolution; x and n even if the source is upsampled. */
static void conv_row(const lull_plan *plan, unsigned l, uint8_t *out, unsigned x, unsigned y,
                     unsigned n)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const lull_packed_layer *packed = &plan->model->layer[l];
    const lull_kernels *kernels = &plan->model->kernels;
    int is_wide = plan->ring[l + 1].dtype == LULL_DTYPE_U15;
    int skip_first = layer->source[1] != LULL_TENSOR_NONE && /* wide segments go first */
                     plan->ring[layer->source[1]].dtype == LULL_DTYPE_U15;
    unsigned phases = lull_layer_is_up(layer) ? 2 : 1;
    lull_conv conv;
    conv.bias = (const uint8_t *)plan->model + packed->bias;
    conv.multiplier =
        (const int32_t *)(const void *)((const uint8_t *)plan->model + packed->multiplier);
    conv.wide_shift = packed->wide_shift;
    conv.out_max = is_wide ? 32767 : 255;
    conv.outputs = layer->outputs;
    conv.out_step = (size_t)phases * layer->outputs;
    conv.pixels = n / phases;
    for (unsigned phase = 0; phase < phases; phase++) {
        conv.out = out + phase * lull_ring_pixel(&plan->ring[l + 1]);
        conv.segments = conv.wide = 0;
        if (skip_first)
            add_skip(&conv, plan, l, (int)(x + phase), (int)y, phases);
        add_source(&conv, plan, l, (int)(x + phase), (int)y);
        if (!skip_first)
            add_skip(&conv, plan, l, (int)(x + phase), (int)y, phases);
        (plan->model->graph.is_integer ? kernels->conv_int : kernels->conv_f32)(&conv);
    }
}

static unsigned chunks_of(const task *t)
{
    unsigned level = t->plan->model->graph.layer[t->layer].level;
    unsigned width = (t->right - t->left) >> level;
    return (width + t->chunk - 1) / t->chunk;
}

/* Columns [x, x+n) of row y of a convolution, pooled if it pools (x and n are before pooling). */
static void make_conv(const task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    uint8_t *row = row_of(plan, t->layer + 1, y), *above, *below;
    size_t pixel = lull_ring_pixel(&plan->ring[t->layer + 1]);
    if (!layer->pool) {
        conv_row(plan, t->layer, row + x * pixel, x, y, n);
        return;
    }
    above = (uint8_t *)plan + plan->scratch + plan->scratch_bytes * worker;
    below = above + n * pixel;
    conv_row(plan, t->layer, above, x, 2 * y, n);
    conv_row(plan, t->layer, below, x, 2 * y + 1, n);
    row += x / 2 * pixel;
    if (plan->model->graph.is_integer)
        plan->model->kernels.pool_u8(row, above, below, layer->outputs, n / 2);
    else
        plan->model->kernels.pool_f32((float *)(void *)row, (const float *)(const void *)above,
                                      (const float *)(const void *)below, layer->outputs, n / 2);
}

/* ---- The filter of family K ---------------------------------------------------------------------- */

/* The five rows around row y of a tensor of 4-vectors, at column x. */
static void five_rows(const lull_plan *plan, const float **rows, unsigned tensor, unsigned y,
                      unsigned x)
{
    for (int dy = 0; dy < 5; dy++)
        rows[dy] = (const float *)(const void *)source_row(plan, tensor, (int)y + dy - 2) +
                   4 * (size_t)x;
}

static void make_smooth(const task *t, unsigned x, unsigned y, unsigned n, const uint8_t *codes,
                        size_t step)
{
    const lull_layer *layer = &t->plan->model->graph.layer[t->layer];
    float *out = floats_of(t->plan, t->layer + 1, y, x);
    const float *rows[5];
    if (t->plan->frame.features & LULL_HAS_COLOR && t->plan->frame.features & LULL_HAS_ALBEDO) {
        five_rows(t->plan, rows, layer->source[0], y, x);
        lull_filter_smooth(out, t->plan->model, rows, codes, step, n);
        return;
    }
    for (unsigned i = 0; i < 3 * n; i++)
        out[i] = 1.0f;
}

static void make_demodulated(const task *t, unsigned x, unsigned y, unsigned n,
                             const uint8_t *codes, size_t step)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned width = plan->frame.width - t->left; /* columns inside the image */
    unsigned inside = y < plan->frame.height && x < width ? width - x : 0;
    lull_filter_demodulate(floats_of(plan, t->layer + 1, y, x), plan->model,
                           floats_of(plan, layer->source[0], y, x),
                           floats_of(plan, layer->source[1], y, x), codes, step, n, inside);
}

static void make_pooled(const task *t, unsigned x, unsigned y, unsigned n, const uint8_t *codes,
                        size_t step)
{
    unsigned source = t->plan->model->graph.layer[t->layer].source[0];
    lull_filter_pool(floats_of(t->plan, t->layer + 1, y, x), t->plan->model,
                     floats_of(t->plan, source, 2 * y, 2 * x),
                     floats_of(t->plan, source, 2 * y + 1, 2 * x), codes, step, n);
}

static void make_filtered(const task *t, unsigned x, unsigned y, unsigned n, const uint8_t *codes,
                          size_t step)
{
    const float *rows[5];
    five_rows(t->plan, rows, t->plan->model->graph.layer[t->layer].source[0], y, x);
    lull_filter_apply(floats_of(t->plan, t->layer + 1, y, x), t->plan->model, rows, codes, step, n);
}

static void make_blended(const task *t, unsigned x, unsigned y, unsigned n, const uint8_t *codes,
                         size_t step)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned level = layer->level + 1u, tensor = layer->source[1];
    unsigned bottom = (plan->frame.height + (1u << level) - 1) >> level; /* coarse rows that exist */
    unsigned right = (plan->frame.width + (1u << level) - 1) >> level;
    unsigned row = y / 2, beside = y & 1 ? row + 1 : row == 0 ? 0 : row - 1;
    lull_coarse coarse;
    (void)codes;
    (void)step;
    coarse.near = floats_of(plan, tensor, lull_min_u(row, bottom - 1), x / 2);
    coarse.far = floats_of(plan, tensor, lull_min_u(beside, bottom - 1), x / 2);
    coarse.channels = plan->ring[tensor].channels;
    coarse.first = -(int)(x / 2);
    coarse.last = (int)(lull_min_u(right, t->right >> level) - 1 - (t->left >> level)) -
                  (int)(x / 2);
    lull_filter_blend(floats_of(plan, t->layer + 1, y, x), layer->outputs,
                      floats_of(plan, layer->source[0], y, x), &coarse, n);
}

/* Columns [x, x+n) of row y of a layer of the filter; its codes are those of the last head it reads. */
static void make_filter(const task *t, unsigned x, unsigned y, unsigned n)
{
    static void (*const make[])(const task *, unsigned, unsigned, unsigned, const uint8_t *,
                                size_t) = {NULL, NULL, make_smooth, make_demodulated, make_pooled,
                                           make_filtered, make_blended};
    const lull_layer *layer = &t->plan->model->graph.layer[t->layer];
    unsigned head = layer->op == LULL_OP_DEMODULATE ? layer->source[2] : layer->source[1];
    size_t step = t->plan->ring[head].channels;
    const uint8_t *codes = layer->op == LULL_OP_BLEND ? NULL : row_of(t->plan, head, y) + x * step;
    make[layer->op](t, x, y, n, codes, step);
}

/* One chunk of columns of one row of a layer. */
static void layer_chunk(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    const lull_layer *layer = &t->plan->model->graph.layer[t->layer];
    unsigned chunks = chunks_of(t), y = t->first + index / chunks, x = index % chunks * t->chunk;
    unsigned n = lull_min_u(t->chunk, ((t->right - t->left) >> layer->level) - x);
    if (lull_layer_is_conv(layer))
        make_conv(t, x, y, n, worker);
    else
        make_filter(t, x, y, n);
}

/* ---- Output --------------------------------------------------------------------------------------- */

/* n pixels (r,g,b) of the result to image values: network values of family U, exposed radiance of K. */
static void finish(float *v, const lull_plan *plan, unsigned channels, unsigned n)
{
    content_rule rule = content_of(&plan->frame);
    float unscale = plan->scale != 0.0f ? 1.0f / plan->scale : 0.0f;
    lull_sanitize(v, 3 * (size_t)n, 1.0f, 0.0f, FLT_MAX_);
    if (plan->model->graph.family == LULL_FAMILY_U)
        lull_transfer_inverse(rule.transfer, v, 3 * (size_t)n);
    else if (plan->frame.content == LULL_SRGB)
        lull_transfer_forward(LULL_TRANSFER_SRGB, v, 3 * (size_t)n);
    for (unsigned i = 0; channels == 1 && i < n; i++)
        v[3 * i] = (v[3 * i] + v[3 * i + 1] + v[3 * i + 2]) / 3.0f;
    for (unsigned i = 0; i < 3 * n; i++) {
        float x = v[i];
        if (rule.is_signed) {
            x = x * 2.0f - 1.0f;
            x = x < -1.0f ? -1.0f : x;
        }
        if (!rule.is_hdr)
            x = x > 1.0f ? 1.0f : x;
        v[i] = x * unscale;
    }
}

/* The first three channels of n pixels of the network's output as floats. */
static void get_output(const lull_plan *plan, float *out, const uint8_t *row, unsigned n)
{
    const lull_ring *ring = &plan->ring[plan->model->graph.layers];
    for (unsigned i = 0; i < n; i++, out += 3, row += lull_ring_pixel(ring)) {
        uint16_t codes[3];
        if (ring->dtype == LULL_DTYPE_F32) {
            memcpy(out, row, 3 * sizeof *out);
            continue;
        }
        memcpy(codes, row, sizeof codes);
        for (unsigned c = 0; c < 3; c++)
            out[c] = (float)codes[c] * plan->model->output_scale;
    }
}

/* Result of family K: times the filtered albedo. */
static void modulate(float *v, const float *smooth, unsigned n)
{
    for (unsigned i = 0; i < 3 * n; i++)
        v[i] *= smooth[i];
}

/* One row of the output image, columns [t->begin, t->end). */
static void store_row(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    lull_plan *plan = t->plan;
    unsigned y = t->first + index, last = plan->model->graph.layers;
    unsigned smooth = lull_graph_find(&plan->model->graph, LULL_OP_SMOOTH, 0);
    const uint8_t *row = row_of(plan, last, y);
    float *block = (float *)(void *)((uint8_t *)plan + plan->scratch +
                                     plan->scratch_bytes * worker);
    for (unsigned x = t->begin; x < t->end; x += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, t->end - x);
        get_output(plan, block, row + (x - t->left) * lull_ring_pixel(&plan->ring[last]), n);
        if (smooth != LULL_TENSOR_NONE)
            modulate(block, floats_of(plan, smooth, y, x - t->left), n);
        finish(block, plan, t->images->output.channels, n);
        lull_image_store(&t->images->output, plan->frame.width, x, y - t->base_row, n, block);
    }
}

/* ---- Steps ---------------------------------------------------------------------------------------- */

/* Loads input rows up to `rows`, which images from row base_row on hold. */
static void load(task *t, unsigned rows, unsigned base_row, const lull_host *host)
{
    t->first = t->plan->done[0];
    t->base_row = base_row;
    parallel(t->plan, host, rows - t->first, load_row, t);
    t->plan->done[LULL_TENSOR_INPUT] = rows;
    t->plan->done[LULL_TENSOR_RADIANCE] = t->plan->done[LULL_TENSOR_ALBEDO] = rows;
}

/* Every layer's turn; then stores the rows of the frame that became ready, in an output image that
 * begins with row base_row. */
static void advance(task *t, unsigned base_row, const lull_host *host)
{
    lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    unsigned ready;
    for (unsigned l = 0; l < graph->layers; l++) {
        ready = lull_plan_turn(plan, l);
        t->layer = l;
        t->chunk = lull_plan_chunk(plan, l);
        t->first = plan->done[l + 1];
        parallel(plan, host, (ready - t->first) * chunks_of(t), layer_chunk, t);
        plan->done[l + 1] = ready;
    }
    ready = lull_min_u(plan->done[graph->layers], plan->frame.height);
    t->first = plan->stored;
    t->base_row = base_row;
    parallel(plan, host, ready - t->first, store_row, t);
    plan->stored = ready;
}

static void begin_strip(lull_plan *plan, task *t, unsigned strip)
{
    const lull_graph *graph = &plan->model->graph;
    unsigned overlap = graph->overlap;
    t->begin = strip * plan->strip_width;
    t->end = lull_min_u(t->begin + plan->strip_width, plan->frame.width);
    t->left = t->begin > overlap ? t->begin - overlap : 0;
    t->right = lull_min_u((strip + 1) * plan->strip_width + overlap, plan->width);
    t->base_row = 0;
    if (plan->strips > 1) /* rows of the strip before may have been longer */
        for (unsigned i = 0; i < LULL_TENSORS; i++)
            memset((uint8_t *)plan + (size_t)plan->ring[i].offset * LULL_ALIGN, 0,
                   (size_t)plan->ring[i].row_units * plan->ring[i].rows * LULL_ALIGN);
    memset(plan->done, 0, sizeof plan->done);
    plan->stored = 0;
}

/* The images that the frame needs are there, with channel counts that fit. */
static lull_status check_images(const lull_plan *plan, const lull_images *images)
{
    unsigned main_channels = 0;
    for (unsigned feature = 0; feature < 3; feature++) {
        const lull_image *image = feature_image(images, feature);
        if (!(plan->frame.features >> feature & 1))
            continue;
        if (!image->data || image->channels < 1 || image->channels > 3 ||
            (unsigned)image->type > LULL_F16)
            return LULL_ERROR_IMAGE;
        if (!main_channels)
            main_channels = image->channels;
    }
    if (!images->output.data || images->output.channels != main_channels ||
        (unsigned)images->output.type > LULL_F16)
        return LULL_ERROR_IMAGE;
    return LULL_OK;
}

/* ---- Auto-exposure -------------------------------------------------------------------------------- */

static void exposure_task(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    const lull_plan *plan = t->plan;
    lull_exposure_row *rows =
        (lull_exposure_row *)(void *)((uint8_t *)t->plan + plan->exposure);
    (void)worker;
    lull_exposure_bin_row(&rows[index], &t->images->color, plan->frame.width, plan->frame.height,
                          index);
}

static float choose_scale(task *t, const lull_host *host)
{
    lull_plan *plan = t->plan;
    unsigned rows = lull_exposure_rows(plan->frame.height);
    if (!lull_is_nan(t->images->input_scale))
        return t->images->input_scale;
    if (!content_of(&plan->frame).is_hdr)
        return 1.0f;
    parallel(plan, host, rows, exposure_task, t);
    return lull_exposure_scale((lull_exposure_row *)(void *)((uint8_t *)plan + plan->exposure),
                               rows);
}

/* ---- Entry points --------------------------------------------------------------------------------- */

static int keep_going(const lull_host *host, double fraction)
{
    return !host || !host->progress || host->progress(host->user, fraction);
}

lull_status lull_run(lull_plan *plan, const lull_images *images, const lull_host *host)
{
    task t = {0};
    lull_status status;
    if (!plan || !images)
        return LULL_ERROR_ARGUMENT;
    if (!plan->frame.width || !plan->frame.height)
        return LULL_OK;
    status = check_images(plan, images);
    if (status != LULL_OK)
        return status;
    t.plan = plan;
    t.images = images;
    if (!keep_going(host, 0.0))
        return LULL_CANCELLED;
    plan->scale = choose_scale(&t, host);
    for (unsigned strip = 0; strip < plan->strips; strip++) {
        begin_strip(plan, &t, strip);
        while (plan->stored < plan->frame.height) {
            double made;
            load(&t, lull_min_u(plan->done[0] + plan->row_step, plan->height), 0, host);
            advance(&t, 0, host);
            made = strip + ((double)plan->done[0] / plan->height +
                            (double)plan->stored / plan->frame.height) / 2;
            if (!keep_going(host, made / plan->strips)) {
                plan->done[0] = LULL_ROWS_IDLE;
                return LULL_CANCELLED;
            }
        }
    }
    plan->done[0] = LULL_ROWS_IDLE;
    return LULL_OK;
}

lull_status lull_rows_begin(lull_plan *plan, float input_scale)
{
    task t = {0};
    if (!plan)
        return LULL_ERROR_ARGUMENT;
    if (plan->strips > 1)
        return LULL_ERROR_UNSUPPORTED;
    t.plan = plan;
    begin_strip(plan, &t, 0);
    plan->scale = lull_is_nan(input_scale) ? 1.0f : input_scale;
    return LULL_OK;
}

lull_status lull_rows(lull_plan *plan, const lull_images *images, unsigned rows, unsigned *ready,
                      const lull_host *host)
{
    task t = {0};
    unsigned input_base, store_base, last;
    lull_status status;
    if (!plan || !images || !ready || plan->done[0] == LULL_ROWS_IDLE ||
        plan->done[0] > plan->frame.height || rows > plan->frame.height - plan->done[0])
        return LULL_ERROR_ARGUMENT;
    *ready = 0;
    if (!plan->frame.width || !rows)
        return LULL_OK;
    status = check_images(plan, images);
    if (status != LULL_OK)
        return status;
    t.plan = plan;
    t.images = images;
    t.end = plan->frame.width;
    t.right = plan->width;
    input_base = plan->done[0];
    store_base = plan->stored;
    last = input_base + rows == plan->frame.height ? plan->height : input_base + rows;
    do { /* turns are taken where lull_run's are: the rings were sized for those */
        unsigned next = (plan->done[0] / plan->row_step + 1) * plan->row_step;
        load(&t, lull_min_u(next, last), input_base, host);
        if (plan->done[0] % plan->row_step == 0 || plan->done[0] == plan->height)
            advance(&t, store_base, host);
        if (!keep_going(host, (double)plan->done[0] / plan->height)) {
            plan->done[0] = LULL_ROWS_IDLE;
            return LULL_CANCELLED;
        }
    } while (plan->done[0] < last ||
             (last == plan->height && plan->stored < plan->frame.height));
    *ready = plan->stored - store_base;
    if (last == plan->height)
        plan->done[0] = LULL_ROWS_IDLE;
    return LULL_OK;
}
