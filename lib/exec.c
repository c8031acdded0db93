/* Runs a plan: rows in, every layer in turn, rows out. */
#include "exposure.h"
#include "image.h"
#include "plan.h"
#include "transfer.h"

#define BLOCK 64u /* pixels converted together */
#define FLT_MAX_ 3.402823466e38f

/* What the body functions of one parallel_for see. */
typedef struct task {
    lull_plan *plan;
    const lull_images *images;
    unsigned layer;
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
    return (uint8_t *)plan + ring->offset + (y % ring->rows) * ring->row_bytes +
           lull_ring_left(ring);
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

/* n pixels of one feature to network values. */
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
    if (is_main)
        lull_transfer_forward(rule.transfer, out, 3 * (size_t)n);
}

/* The n bytes before `from` to before `to`. */
static void copy_before(uint8_t *to, const uint8_t *from, size_t n)
{
    memcpy(to - n, from - n, n);
}

/* Three channels of n pixels, from channel `at` on, of the network's input row. */
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

/* One row of the network's input, columns [t->left, t->right). */
static void load_row(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    lull_plan *plan = t->plan;
    const lull_frame *frame = &plan->frame;
    unsigned y = t->first + index, x = t->left, right = lull_min_u(t->right, frame->width);
    uint8_t *row = row_of(plan, 0, y), *saved = (uint8_t *)plan + plan->saved;
    size_t pixel = lull_ring_pixel(&plan->ring[0]);
    float *block = (float *)(void *)((uint8_t *)plan + plan->scratch +
                                     plan->scratch_bytes * worker);
    memset(row, 0, (t->right - t->left) * pixel);
    if (y >= frame->height)
        return;
    saved += ((size_t)y + 1) * plan->saved_width * pixel; /* the end of row y's */
    if (plan->saved_width && t->begin > 0) { /* overwritten by the strips before */
        x = t->begin;
        copy_before(row + (x - t->left) * pixel, saved, lull_min_u(plan->saved_width, x) * pixel);
    }
    for (; x < right; x += BLOCK) {
        unsigned n = lull_min_u(BLOCK, right - x), at = 0;
        for (unsigned feature = 0; feature < 3; feature++) {
            if (!(frame->features >> feature & 1))
                continue;
            load_feature(block, t, feature, at == 0, x, y - t->base_row, n);
            put_input(plan, row + (x - t->left) * pixel, block, at, n);
            at += 3;
        }
    }
    if (plan->saved_width)
        copy_before(saved, row + (t->end - t->left) * pixel,
                    lull_min_u(plan->saved_width, t->end) * pixel);
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
    int rows = layer->up ? 2 : 3;
    if (layer->up) {
        x = (x + 1) / 2;
        y = (y + 1) / 2;
    }
    for (int dy = 0; dy < rows; dy++)
        add_run(conv, plan, layer->source, y - 1 + dy, x - 1, (unsigned)rows, 1,
                weights[lull_pack_block(layer, phase, (unsigned)dy)]);
}

/* The skip of layer l around the pixels x, x + stride, ... of row y. */
static void add_skip(lull_conv *conv, const lull_plan *plan, unsigned l, int x, int y,
                     unsigned stride)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    if (layer->skip == LULL_TENSOR_NONE)
        return;
    for (int dy = 0; dy < 3; dy++)
        add_run(conv, plan, layer->skip, y - 1 + dy, x - 1, 3, stride,
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
    int skip_first = layer->skip != LULL_TENSOR_NONE &&
                     plan->ring[layer->skip].dtype == LULL_DTYPE_U15; /* wide segments go first */
    unsigned phases = layer->up ? 2 : 1;
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
    return (width + t->plan->chunk[t->layer] - 1) / t->plan->chunk[t->layer];
}

/* One chunk of columns of one row of a layer. */
static void layer_chunk(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned chunks = chunks_of(t), y = t->first + index / chunks;
    unsigned x = index % chunks * plan->chunk[t->layer];
    unsigned n = lull_min_u(plan->chunk[t->layer], ((t->right - t->left) >> layer->level) - x);
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

/* ---- Output --------------------------------------------------------------------------------------- */

/* n network pixels (r,g,b) to image values. */
static void finish(float *v, const lull_plan *plan, unsigned channels, unsigned n)
{
    content_rule rule = content_of(&plan->frame);
    float unscale = plan->scale != 0.0f ? 1.0f / plan->scale : 0.0f;
    lull_sanitize(v, 3 * (size_t)n, 1.0f, 0.0f, FLT_MAX_);
    lull_transfer_inverse(rule.transfer, v, 3 * (size_t)n);
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

/* One row of the output image, columns [t->begin, t->end). */
static void store_row(void *context, unsigned index, unsigned worker)
{
    const task *t = context;
    lull_plan *plan = t->plan;
    unsigned y = t->first + index, last = plan->model->graph.layers;
    const uint8_t *row = row_of(plan, last, y);
    float *block = (float *)(void *)((uint8_t *)plan + plan->scratch +
                                     plan->scratch_bytes * worker);
    for (unsigned x = t->begin; x < t->end; x += BLOCK) {
        unsigned n = lull_min_u(BLOCK, t->end - x);
        get_output(plan, block, row + (x - t->left) * lull_ring_pixel(&plan->ring[last]), n);
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
    t->plan->done[0] = rows;
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
        for (unsigned i = 0; i <= graph->layers; i++)
            memset((uint8_t *)plan + plan->ring[i].offset, 0,
                   plan->ring[i].row_bytes * plan->ring[i].rows);
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
