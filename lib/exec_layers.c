/* Rows of layers: convolutions through the kernels, and the filter of family K. */
#include "exec.h"
#include "filter.h"

uint8_t *lull_exec_row(const lull_plan *plan, unsigned tensor, unsigned y)
{
    const lull_ring *ring = &plan->ring[tensor];
    return (uint8_t *)plan +
           (ring->offset + (size_t)(y % ring->rows) * ring->row_units) * LULL_ALIGN +
           lull_ring_left(ring);
}

float *lull_exec_floats(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x)
{
    size_t at = x * lull_ring_pixel(&plan->ring[tensor]);
    return (float *)(void *)(lull_exec_row(plan, tensor, y) + at);
}

size_t lull_exec_plane(const lull_plan *plan, unsigned tensor)
{
    return lull_plan_plane(plan, tensor) / sizeof(float);
}

const uint8_t *lull_exec_source(const lull_plan *plan, unsigned tensor, int y)
{
    const lull_ring *ring = &plan->ring[tensor];
    if (y < 0 || y >= (int)(plan->height >> ring->level))
        return (uint8_t *)plan + (size_t)plan->zero_row * LULL_ALIGN + lull_ring_left(ring);
    return lull_exec_row(plan, tensor, (unsigned)y);
}

/* Appends the run of `columns` pixels from column x on of row y of a tensor. */
static void add_run(lull_conv *conv, const lull_plan *plan, unsigned tensor, int y, int x,
                    unsigned columns, unsigned stride, size_t weights)
{
    const lull_ring *ring = &plan->ring[tensor];
    lull_segment *segment = &conv->segment[conv->segments++];
    segment->row = lull_exec_source(plan, tensor, y) + x * (ptrdiff_t)lull_ring_pixel(ring);
    segment->weights = (const uint8_t *)plan->model + weights;
    segment->length = lull_pack_length((lull_dtype)ring->dtype, columns * ring->channels);
    segment->step = stride * ring->channels;
    if (ring->dtype == LULL_DTYPE_U15)
        conv->wide = conv->segments;
}

/* The source of layer l around the pixels x, x + stride, ... of row y: three rows of 3x3 taps, or,
 * upsampled, the two rows of the phase's 2x2 taps; of pairs, those of the next pixel, too. */
static void add_source(lull_conv *conv, const lull_plan *plan, unsigned l, int x, int y,
                       unsigned stride)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const size_t *weights = plan->model->layer[l].weights;
    unsigned phase = 2 * ((unsigned)y & 1) + ((unsigned)x & 1);
    int is_up = lull_layer_is_up(layer);
    int rows = is_up ? 2 : layer->op == LULL_OP_HEAD ? 1 : 3;
    int before = rows == 1 ? 0 : 1;
    if (is_up) {
        x = (x + 1) / 2;
        y = (y + 1) / 2;
    }
    for (int dy = 0; dy < rows; dy++)
        add_run(conv, plan, layer->source[0], y - before + dy, x - before,
                (unsigned)rows + plan->model->layer[l].has_pairs, is_up ? 1 : stride,
                weights[lull_pack_block(layer, phase, (unsigned)dy)]);
}

/* Source s, the second or third, of layer l around the pixels x, x + stride, ... of row y. */
static void add_full(lull_conv *conv, const lull_plan *plan, unsigned l, unsigned s, int x, int y,
                     unsigned stride)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const size_t *weights =
        plan->model->layer[l].weights + (s == 1 ? LULL_PACK_SKIP : LULL_PACK_THIRD);
    if (layer->source[s] == LULL_TENSOR_NONE || layer->op == LULL_OP_HEAD)
        return;
    for (int dy = 0; dy < 3; dy++)
        add_run(conv, plan, layer->source[s], y - 1 + dy, x - 1,
                3 + plan->model->layer[l].has_pairs, stride, weights[dy]);
}

/* Codes of a head: code k of pixel p at `at` + k * plane + p * step. */
typedef struct lull_codes {
    const uint8_t *at;
    size_t step, plane;
} lull_codes;

/* From plane to plane of the codes of n pixels that layer l makes, if they are in planes. */
static size_t head_plane(const lull_plan *plan, unsigned l, unsigned n)
{
    return lull_graph_is_local(&plan->model->graph, l + 1)
               ? n
               : plan->row_width >> plan->model->graph.layer[l].level;
}

/* Columns [x, x+n) of row y of a layer's convolution; x and n even if the source is upsampled or
 * pixels come in pairs. start: NULL, or the bias and what the sources in patches add, for each
 * pixel. */
static void conv_row(const lull_plan *plan, unsigned l, uint8_t *out, const int32_t *start,
                     unsigned x, unsigned y, unsigned n)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    const lull_packed_layer *packed = &plan->model->layer[l];
    const lull_kernels *kernels = &plan->model->kernels;
    int skip_first = layer->source[1] != LULL_TENSOR_NONE && /* wide segments go first */
                     plan->ring[layer->source[1]].dtype == LULL_DTYPE_U15;
    int has_source = !start || !(layer->has_patches & 1);
    int has_skip = !start || !(layer->has_patches & 2);
    unsigned stride = packed->has_pairs || lull_layer_is_up(layer) ? 2 : 1;
    unsigned phases = packed->has_pairs ? 1 : stride;
    void (*kernel)(const lull_conv *) = !plan->model->graph.is_integer ? kernels->conv_f32
                                        : packed->in_planes            ? kernels->head
                                        : lull_pack_is_int3(&plan->model->graph, kernels, l)
                                            ? kernels->conv_int3
                                            : kernels->conv_int;
    lull_conv conv;
    conv.bias = (const uint8_t *)plan->model + packed->bias;
    conv.multiplier =
        (const int32_t *)(const void *)((const uint8_t *)plan->model + packed->multiplier);
    conv.wide_shift = packed->wide_shift;
    conv.out_max = (int32_t)lull_graph_max(&plan->model->graph, l + 1);
    conv.is_small = packed->is_small;
    conv.fits_words = packed->fits_words;
    conv.least = 0.0f;
    conv.outputs = (unsigned)layer->outputs << packed->has_pairs;
    conv.out_step = packed->in_planes ? head_plane(plan, l, n) : (size_t)stride * layer->outputs;
    conv.pixels = n / stride;
    conv.start_step = conv.out_step;
    for (unsigned phase = 0; phase < phases; phase++) {
        conv.out = out + phase * lull_ring_pixel(&plan->ring[l + 1]);
        conv.start = start ? start + phase * layer->outputs : NULL;
        conv.segments = conv.wide = 0;
        if (skip_first && has_skip)
            add_full(&conv, plan, l, 1, (int)(x + phase), (int)y, stride);
        if (has_source)
            add_source(&conv, plan, l, (int)(x + phase), (int)y, stride);
        if (!skip_first && has_skip)
            add_full(&conv, plan, l, 1, (int)(x + phase), (int)y, stride);
        add_full(&conv, plan, l, 2, (int)(x + phase), (int)y, stride);
        kernel(&conv);
    }
}

void lull_exec_conv(const lull_plan *plan, unsigned l, const int32_t *start, unsigned x, unsigned y,
                    unsigned n)
{
    uint8_t *out = lull_exec_row(plan, l + 1, y) + x * lull_ring_pixel(&plan->ring[l + 1]);
    conv_row(plan, l, out, start, x, y, n);
}

lull_part lull_exec_part(const lull_task *t, unsigned index, unsigned left, unsigned right)
{
    lull_part part;
    part.row = index % t->rows;
    part.left = left + index / t->rows * t->chunk;
    part.right = lull_min_u(part.left + t->chunk, right);
    return part;
}

/* Pixel x of row y of a layer's result, or where a worker has it while that part of the row is
 * made. */
static uint8_t *part_at(const lull_task *t, unsigned tensor, unsigned x, unsigned y,
                        unsigned worker)
{
    size_t pixel = lull_ring_pixel(&t->plan->ring[tensor]);
    if (lull_graph_is_local(&t->plan->model->graph, tensor))
        return (uint8_t *)lull_exec_scratch(t, worker) + LULL_SCRATCH_LOCAL;
    if (t->plan->model->layer[tensor - 1].in_planes)
        pixel = 1;
    return lull_exec_row(t->plan, tensor, y) + x * pixel;
}

/* Codes of n pixels from pixel x of row y on of a head, numbered as if it had all of them. */
static lull_codes codes_of(const lull_task *t, unsigned head, unsigned x, unsigned y, unsigned n,
                           unsigned worker)
{
    const int in_planes = t->plan->model->layer[head - 1].in_planes;
    lull_codes codes;
    codes.step = in_planes ? 1 : t->plan->ring[head].channels;
    codes.plane = in_planes ? head_plane(t->plan, head - 1, n) : 1;
    codes.at = part_at(t, head, x, y, worker) -
               t->plan->model->graph.layer[head - 1].first * codes.plane;
    return codes;
}

/* Columns [x, x+n) of row y of a convolution, pooled if it pools (x and n are before pooling). */
static void make_conv(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    uint8_t *row, *above, *below;
    size_t pixel = lull_ring_pixel(&plan->ring[t->layer + 1]);
    if (!layer->pool) {
        conv_row(plan, t->layer, part_at(t, t->layer + 1, x, y, worker), NULL, x, y, n);
        return;
    }
    row = lull_exec_row(plan, t->layer + 1, y);
    above = lull_exec_scratch(t, worker);
    below = above + n * pixel;
    conv_row(plan, t->layer, above, NULL, x, 2 * y, n);
    conv_row(plan, t->layer, below, NULL, x, 2 * y + 1, n);
    row += x / 2 * pixel;
    if (plan->model->graph.is_integer)
        plan->model->kernels.pool_u8(row, above, below, layer->outputs, n / 2);
    else
        plan->model->kernels.pool_f32((float *)(void *)row, (const float *)(const void *)above,
                                      (const float *)(const void *)below, layer->outputs, n / 2);
}

/* Bytes from plane to plane of the codes that a layer of the filter keeps beside its result. */
static size_t code_plane(const lull_plan *plan, unsigned tensor)
{
    return lull_align_up(plan->row_width >> plan->ring[tensor].level, LULL_ALIGN);
}

uint8_t *lull_exec_codes(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x)
{
    const lull_ring *ring = &plan->ring[tensor];
    return lull_exec_row(plan, tensor, y) - lull_ring_left(ring) +
           ring->channels * lull_plan_plane(plan, tensor) + x;
}

uint8_t *lull_exec_noise(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x)
{
    int before = lull_graph_planes(&plan->model->graph, tensor) - 2;
    return lull_exec_codes(plan, tensor, y, x) + (unsigned)before * code_plane(plan, tensor);
}

/* 5x5 means of n pixels of the layer's first source, from column x on: its last three planes. Codes
 * from number `first` on. */
static void make_means(const lull_task *t, unsigned x, unsigned y, unsigned n, float more,
                       float none, const lull_codes *codes, unsigned first)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[0];
    lull_window window;
    for (int dy = 0; dy < 5; dy++)
        window.rows[dy] =
            (const float *)(const void *)lull_exec_source(plan, source, (int)y + dy - 2) + x;
    window.plane = lull_exec_plane(plan, source);
    window.out_plane = lull_exec_plane(plan, t->layer + 1);
    window.out = lull_exec_floats(plan, t->layer + 1, y, x) +
                 (plan->model->graph.layer[t->layer].outputs - 3u) * window.out_plane;
    window.codes = codes->at + first * codes->plane;
    window.code_step = codes->step;
    window.code_plane = codes->plane;
    window.table = plan->model->weight_table;
    window.more = more;
    window.none = none;
    window.pixels = n;
    plan->model->kernels.filter5(&window);
}

static void make_smooth(const lull_task *t, unsigned x, unsigned y, unsigned n,
                        const lull_codes *codes, unsigned worker)
{
    float *out = lull_exec_floats(t->plan, t->layer + 1, y, x);
    size_t plane = lull_exec_plane(t->plan, t->layer + 1);
    (void)worker;
    if (t->plan->frame.features & LULL_HAS_COLOR && t->plan->frame.features & LULL_HAS_ALBEDO) {
        make_means(t, x, y, n, LULL_FILTER_EPSILON, 1.0f, codes, LULL_HEAD_ALBEDO);
        return;
    }
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < n; i++)
            out[c * plane + i] = 1.0f;
}

/* Filtered normals, by the albedo's kernel. */
static void make_facing(const lull_task *t, unsigned x, unsigned y, unsigned n,
                        const lull_codes *codes, unsigned worker)
{
    float *out = lull_exec_floats(t->plan, t->layer + 1, y, x);
    size_t plane = lull_exec_plane(t->plan, t->layer + 1);
    (void)worker;
    if (lull_plan_has(t->plan, LULL_TENSOR_NORMAL)) {
        make_means(t, x, y, n, 0.0f, 0.0f, codes, LULL_HEAD_ALBEDO);
        return;
    }
    for (unsigned c = 0; c < 3; c++)
        memset(out + c * plane, 0, n * sizeof *out);
}

static void make_demodulated(const lull_task *t, unsigned x, unsigned y, unsigned n,
                             const lull_codes *codes, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned width = plan->frame.width - t->left; /* columns inside the image */
    unsigned inside = y < plan->frame.height && x < width ? lull_min_u(width - x, n) : 0;
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    const float *smooth = lull_exec_floats(plan, layer->source[1], y, x);
    size_t plane = lull_exec_plane(plan, t->layer + 1);
    const uint8_t *confidence = codes->at + LULL_HEAD_CONFIDENCE * codes->plane;
    for (unsigned done = 0; done < inside; done += LULL_BLOCK) {
        unsigned count = lull_min_u(LULL_BLOCK, inside - done);
        lull_encoding from;
        lull_exec_radiance(&from, t, lull_exec_scratch(t, worker), t->left + x + done, y, count);
        plan->model->kernels.demodulate(
            out + done, plane, &from, smooth + done, lull_exec_plane(plan, layer->source[1]),
            confidence + done * codes->step, codes->step, plan->model->weight_table, count);
    }
    for (unsigned c = 0; c < 4; c++)
        memset(out + c * plane + inside, 0, (size_t)(n - inside) * sizeof *out);
}

static void make_pooled(const lull_task *t, unsigned x, unsigned y, unsigned n,
                        const lull_codes *codes, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[0];
    (void)worker;
    plan->model->kernels.shrink(
        lull_exec_floats(plan, t->layer + 1, y, x), lull_exec_plane(plan, t->layer + 1),
        lull_exec_floats(plan, source, 2 * y, 2 * x),
        lull_exec_floats(plan, source, 2 * y + 1, 2 * x), lull_exec_plane(plan, source),
        codes->at + LULL_HEAD_CONFIDENCE * codes->plane, codes->step, plan->model->weight_table, n);
}

static void make_filtered(const lull_task *t, unsigned x, unsigned y, unsigned n,
                          const lull_codes *codes, unsigned worker)
{
    const lull_plan *plan = t->plan;
    unsigned source = plan->model->graph.layer[t->layer].source[0];
    uint8_t *kept = lull_exec_codes(plan, t->layer + 1, y, x);
    const uint8_t *blend = codes->at + LULL_HEAD_BLEND * codes->plane;
    (void)worker;
    make_means(t, x, y, n, 0.0f, 0.0f, codes, 0);
    if (codes->step == 1)
        memcpy(kept, blend, n);
    else
        for (unsigned i = 0; i < n; i++)
            kept[i] = blend[i * codes->step];
    if (lull_graph_has_noise(&plan->model->graph, t->layer + 1))
        plan->model->kernels.noise(
            lull_exec_noise(plan, t->layer + 1, y, x), lull_exec_floats(plan, source, y, x),
            lull_exec_plane(plan, source), lull_exec_floats(plan, t->layer + 1, y, x),
            lull_exec_plane(plan, t->layer + 1), n);
}

unsigned lull_exec_inside(const lull_task *t)
{
    return lull_min_u(t->plan->frame.width, t->right) - t->left;
}

static void make_blended(const lull_task *t, unsigned x, unsigned y, unsigned n,
                         unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned level = layer->level + 1u, tensor = layer->source[1];
    unsigned bottom = (plan->frame.height + (1u << level) - 1) >> level; /* coarse rows that exist
                                                                          */
    unsigned right = (plan->frame.width + (1u << level) - 1) >> level;
    unsigned row = y / 2, beside = y & 1 ? row + 1 : row == 0 ? 0 : row - 1;
    lull_blending blending;
    (void)worker;
    blending.out = lull_exec_floats(plan, t->layer + 1, y, x);
    blending.out_plane = lull_exec_plane(plan, t->layer + 1);
    blending.fine = lull_exec_floats(plan, layer->source[0], y, x);
    blending.fine_plane = lull_exec_plane(plan, layer->source[0]);
    blending.near = lull_exec_floats(plan, tensor, lull_min_u(row, bottom - 1), x / 2);
    blending.far = lull_exec_floats(plan, tensor, lull_min_u(beside, bottom - 1), x / 2);
    blending.coarse_plane = lull_exec_plane(plan, tensor);
    blending.codes = lull_exec_codes(plan, layer->source[0], y, x);
    blending.table = plan->model->blend_table;
    blending.pairs = 0;
    lull_filter_blend(
        &plan->model->kernels, &blending, -(int)(x / 2),
        (int)(lull_min_u(right, t->right >> level) - 1 - (t->left >> level)) - (int)(x / 2), n);
    if (lull_graph_has_noise(&plan->model->graph, t->layer + 1))
        memcpy(lull_exec_noise(plan, t->layer + 1, y, x),
               lull_exec_noise(plan, layer->source[0], y, x), n);
}

/* Row y of the smoothing's first two sources at pixel x. */
static lull_surface get_surface(const lull_plan *plan, const lull_layer *layer, unsigned x,
                                unsigned y)
{
    lull_surface at;
    at.v = lull_exec_floats(plan, layer->source[0], y, x);
    at.plane = lull_exec_plane(plan, layer->source[0]);
    at.guide = lull_exec_row(plan, layer->source[1], y) + 2 * (size_t)x;
    return at;
}

static void make_bilateral(const lull_task *t, unsigned x, unsigned y, unsigned n,
                           unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_layer *layer = &plan->model->graph.layer[t->layer];
    unsigned width = lull_exec_inside(t), last = plan->frame.height - 1;
    lull_smoothing s;
    (void)worker;
    if (y >= plan->frame.height || x >= width)
        return;
    s.out = lull_exec_floats(plan, t->layer + 1, y, x);
    s.out_plane = lull_exec_plane(plan, t->layer + 1);
    s.noise = lull_exec_noise(plan, layer->source[0], y, x);
    s.row = get_surface(plan, layer, x, y);
    s.is_far = lull_graph_is_far(layer);
    for (unsigned k = 0; k < lull_bilateral_rows(s.is_far); k += 2) {
        unsigned away = lull_bilateral_away[k / 2];
        s.beside[k] = get_surface(plan, layer, x, y < away ? 0 : y - away);
        s.beside[k + 1] = get_surface(plan, layer, x, lull_min_u(y + away, last));
    }
    n = lull_min_u(n, width - x);
    lull_filter_bilateral(&plan->model->kernels, &s, -(int)x, (int)(width - 1) - (int)x, n);
    if (lull_graph_has_noise(&plan->model->graph, t->layer + 1))
        memcpy(lull_exec_noise(plan, t->layer + 1, y, x), s.noise, n);
}

/* Columns [x, x+n) of row y of a layer of the filter. */
void lull_exec_filter(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    static void (*const by_codes[])(const lull_task *, unsigned, unsigned, unsigned,
                                    const lull_codes *, unsigned) = {
        [LULL_OP_SMOOTH] = make_smooth, [LULL_OP_DEMODULATE] = make_demodulated,
        [LULL_OP_POOL] = make_pooled,   [LULL_OP_FILTER] = make_filtered,
        [LULL_OP_FACE] = make_facing,   [LULL_OP_ENCODE] = NULL};
    static void (*const make[])(const lull_task *, unsigned, unsigned, unsigned, unsigned) = {
        [LULL_OP_GRAIN_SUMS] = lull_exec_grain_sums, [LULL_OP_GRAIN] = lull_exec_find_grain,
        [LULL_OP_BLEND] = make_blended,          [LULL_OP_BILATERAL] = make_bilateral,
        [LULL_OP_FIT_SUMS] = lull_exec_fit_sums, [LULL_OP_FIT] = lull_exec_fit,
        [LULL_OP_REGRESS] = lull_exec_regress,   [LULL_OP_RESIDUAL] = lull_exec_residual,
        [LULL_OP_GAINS] = lull_exec_gains,       [LULL_OP_CORRECT] = lull_exec_correct,
        [LULL_OP_ENCODE] = lull_exec_encode};
    const lull_layer *layer = &t->plan->model->graph.layer[t->layer];
    if (by_codes[layer->op]) { /* those of the last head that it reads */
        unsigned head = layer->op == LULL_OP_DEMODULATE ? layer->source[2] : layer->source[1];
        lull_codes codes = codes_of(t, head, x, y, n, worker);
        by_codes[layer->op](t, x, y, n, &codes, worker);
    } else {
        make[layer->op](t, x, y, n, worker);
    }
}

/* Turns the index of a loop into one of a group: bands outside, then groups, chunks, rows. */
static const lull_group *find_group(const lull_task *t, unsigned *index)
{
    unsigned bands = lull_plan_bands(t->plan);
    for (unsigned band = 0;; band++)
        for (const lull_group *g = t->group; g < t->group + t->groups; g++) {
            unsigned begin = g->chunks * band / bands, end = g->chunks * (band + 1) / bands;
            unsigned count = (end - begin) * g->rows;
            if (*index < count) {
                *index += begin * g->rows;
                return g;
            }
            *index -= count;
        }
}

/* One chunk of columns of a row, or two rows, of the layers of a group. */
void lull_exec_chunk(void *context, unsigned index, unsigned worker)
{
    const unsigned part = index;
    lull_task t = *(const lull_task *)context;
    const lull_group *g = find_group(context, &index);
    const lull_layer *layer = &t.plan->model->graph.layer[g->layer];
    unsigned x = index / g->rows * g->chunk;
    unsigned y = g->first + index % g->rows * lull_plan_rows(t.plan, g->layer);
    unsigned n = lull_min_u(g->chunk, ((t.right - t.left) >> layer->level) - x);
    lull_exec_fetch(&t, part);
    for (t.layer = g->layer; t.layer < g->layer + g->layers; t.layer++, layer++) {
        if (lull_plan_is_idle(t.plan, t.layer))
            continue;
        if (layer->is_winograd)
            lull_exec_winograd(&t, x, y, n, worker);
        else if (lull_plan_is_patched(t.plan, t.layer))
            lull_exec_patches(&t, x, y, n, worker);
        else if (lull_layer_is_conv(layer))
            make_conv(&t, x, y, n, worker);
        else
            lull_exec_filter(&t, x, y, n, worker);
    }
    if (g->stores && y < t.plan->frame.height && x < t.end)
        lull_exec_store_part(&t, x, y, lull_min_u(n, t.end - x), worker);
}
