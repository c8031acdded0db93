/* Rows of the caller's images to rows of the network and back. */
#include "exec.h"
#include "filter.h"
#include "image.h"

lull_content_rule lull_exec_content(const lull_frame *frame)
{
    static const lull_content_rule rules[LULL_CONTENT_COUNT] = {
        {LULL_TRANSFER_PU, 1, 0},     /* HDR */
        {LULL_TRANSFER_SRGB, 0, 0},   /* LDR */
        {LULL_TRANSFER_LINEAR, 0, 0}, /* SRGB */
        {LULL_TRANSFER_LOG, 1, 0},    /* LIGHTMAP_HDR */
        {LULL_TRANSFER_LINEAR, 0, 1}, /* LIGHTMAP_DIR */
    };
    static const lull_content_rule normals = {LULL_TRANSFER_LINEAR, 0, 1};
    lull_content_rule rule = frame->features == LULL_HAS_NORMAL ? normals : rules[frame->content];
    if (frame->trained_for)
        rule.transfer = rules[frame->trained_for - 1].transfer;
    return rule;
}

/* The network sees linear light, but the main image is sRGB-encoded. */
static int is_decoded(const lull_plan *plan)
{
    return plan->frame.content == LULL_SRGB &&
           (plan->frame.trained_for || plan->model->graph.family == LULL_FAMILY_K);
}

const lull_image *lull_exec_feature(const lull_images *images, unsigned feature)
{
    return feature == 0 ? &images->color : feature == 1 ? &images->albedo : &images->normal;
}

/* n pixels of one feature, sanitised and in the network's range: signed ones to [0,1] if they are
 * the main image. */
static void load_feature(float *out, const lull_task *t, unsigned feature, int is_main, unsigned x,
                         unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    lull_content_rule rule = lull_exec_content(&plan->frame);
    int is_signed = is_main ? rule.is_signed : feature == 2;
    float high = is_main && rule.is_hdr ? LULL_FLT_MAX : 1.0f;
    lull_image_load(out, lull_exec_feature(t->images, feature), plan->frame.width, x, y, n);
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

/* n pixels from column x on of row y of a U network's input: the features in the order of their
 * bits. */
static void load_direct(const lull_task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    lull_plan *plan = t->plan;
    uint8_t *row = lull_exec_row(plan, 0, y) + (x - t->left) * lull_ring_pixel(&plan->ring[0]);
    unsigned at = 0;
    for (unsigned feature = 0; feature < 3; feature++) {
        if (!(plan->frame.features >> feature & 1))
            continue;
        load_feature(block, t, feature, at == 0, x, y - t->base_row, n);
        if (at == 0 && is_decoded(plan))
            lull_transfer_inverse(LULL_TRANSFER_SRGB, block, 3 * (size_t)n);
        if (at == 0)
            lull_transfer_forward(lull_exec_content(&plan->frame).transfer, block, 3 * (size_t)n);
        put_input(plan, row, block, at, n);
        at += 3;
    }
}

/* The same for family K: codes, radiance and albedo. */
static void load_kernel(const lull_task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    lull_plan *plan = t->plan;
    unsigned features = plan->frame.features, column = x - t->left;
    unsigned main_feature = features & LULL_HAS_COLOR ? 0 : features & LULL_HAS_ALBEDO ? 1 : 2;
    float *radiance = lull_exec_floats(plan, LULL_TENSOR_RADIANCE, y, column);
    float *albedo = lull_exec_floats(plan, LULL_TENSOR_ALBEDO, y, column);
    float *aux[3] = {NULL, NULL, NULL};
    load_feature(radiance, t, main_feature, 1, x, y - t->base_row, n);
    if (is_decoded(plan))
        lull_transfer_inverse(LULL_TRANSFER_SRGB, radiance, 3 * (size_t)n);
    for (unsigned feature = main_feature + 1; feature < 3; feature++) {
        if (!(features >> feature & 1))
            continue;
        aux[feature] = block + (feature - 1) * 3 * LULL_BLOCK;
        load_feature(aux[feature], t, feature, 0, x, y - t->base_row, n);
        for (unsigned i = 0; feature == 2 && i < 3 * n; i++) /* codes are of signed normals */
            aux[2][i] = aux[2][i] * 2.0f - 1.0f;
    }
    lull_filter_encode(lull_exec_row(plan, 0, y) + column * lull_ring_pixel(&plan->ring[0]),
                       radiance, aux[1], aux[2], !lull_exec_content(&plan->frame).is_hdr, n);
    for (unsigned i = 0; i < n; i++) {
        albedo[4 * i] = 1.0f;
        for (unsigned c = 0; c < 3; c++)
            albedo[4 * i + 1 + c] = aux[1] ? aux[1][3 * i + c] : 1.0f - LULL_FILTER_EPSILON;
    }
}

/* The n bytes before `from` to before `to`. */
static void copy_before(uint8_t *to, const uint8_t *from, size_t n) { memcpy(to - n, from - n, n); }

/* Copies the last `columns` columns before `column` of row y of all loaded tensors from (or to) the
 * place where they are kept for the next strip. */
static void keep_columns(const lull_task *t, unsigned y, unsigned column, int is_store)
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
        row = lull_exec_row(plan, lull_loaded[i], y) + (column - t->left) * pixel;
        at = ((size_t)y + 1) * plan->saved_width * pixel; /* the end of row y's */
        copy_before(is_store ? saved + at : row, is_store ? row : saved + at, columns * pixel);
        saved += (size_t)plan->frame.height * plan->saved_width * pixel;
    }
}

/* One row of the network's input, columns [t->left, t->right). */
void lull_exec_load(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    lull_plan *plan = t->plan;
    const lull_frame *frame = &plan->frame;
    unsigned y = t->first + index, x = t->left, right = lull_min_u(t->right, frame->width);
    float *block =
        (float *)(void *)((uint8_t *)plan + plan->scratch + plan->scratch_bytes * worker);
    for (unsigned i = 0; i < LULL_LOADED; i++)
        if (lull_plan_has(plan, lull_loaded[i]))
            memset(lull_exec_row(plan, lull_loaded[i], y), 0,
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

/* n pixels (r,g,b) of the result to image values: network values of family U, exposed radiance of
 * K. */
static void finish(float *v, const lull_plan *plan, unsigned channels, unsigned n)
{
    lull_content_rule rule = lull_exec_content(&plan->frame);
    float unscale = plan->scale != 0.0f ? 1.0f / plan->scale : 0.0f;
    lull_sanitize(v, 3 * (size_t)n, 1.0f, 0.0f, LULL_FLT_MAX);
    if (plan->model->graph.family == LULL_FAMILY_U)
        lull_transfer_inverse(rule.transfer, v, 3 * (size_t)n);
    if (is_decoded(plan))
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
void lull_exec_store(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    lull_plan *plan = t->plan;
    unsigned y = t->first + index, last = plan->model->graph.layers;
    unsigned smooth = lull_graph_find(&plan->model->graph, LULL_OP_SMOOTH, 0);
    const uint8_t *row = lull_exec_row(plan, last, y);
    float *block =
        (float *)(void *)((uint8_t *)plan + plan->scratch + plan->scratch_bytes * worker);
    for (unsigned x = t->begin; x < t->end; x += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, t->end - x);
        get_output(plan, block, row + (x - t->left) * lull_ring_pixel(&plan->ring[last]), n);
        if (smooth != LULL_TENSOR_NONE)
            modulate(block, lull_exec_floats(plan, smooth, y, x - t->left), n);
        finish(block, plan, t->images->output.channels, n);
        lull_image_store(&t->images->output, plan->frame.width, x, y - t->base_row, n, block);
    }
}
