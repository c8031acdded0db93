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

int lull_exec_has_features(const lull_plan *plan)
{
    return (plan->frame.features & (plan->frame.features - 1)) != 0; /* the main image is one bit */
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

/* n pixels of one feature as network values: sanitised, signed ones to [0,1] (of auxiliary images
 * only normals are), then through the curve of this transfer function. */
static void load_feature(float *out, const lull_task *t, unsigned feature, int is_main,
                         lull_transfer transfer, unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    lull_content_rule rule = lull_exec_content(&plan->frame);
    lull_curve curve;
    curve.transfer = transfer;
    curve.is_signed = is_main ? rule.is_signed : feature == 2;
    curve.scale = is_main ? plan->scale : 1.0f;
    curve.low = curve.is_signed ? -1.0f : 0.0f;
    curve.high = is_main && rule.is_hdr ? LULL_FLT_MAX : 1.0f;
    lull_image_load(out, lull_exec_feature(t->images, feature), plan->frame.width, x, y, n);
    plan->model->kernels.curve_in(out, &curve, 3 * (size_t)n);
}

/* n values, three channels in turn, as codes. */
static void to_codes(uint16_t *codes, const float *v, const float *scale, float max, unsigned n)
{
    for (unsigned i = 0; i < n; i++) {
        float code = v[i] * scale[i] + 0.5f;
        codes[i] = (uint16_t)(int)(code < max ? code : max);
    }
}

/* Three channels of n pixels, from channel `at` on, of a U network's input. */
static void put_input(const lull_plan *plan, const float *v, unsigned at, const lull_direct *row,
                      unsigned n)
{
    enum { SOME = 16 };
    const lull_graph *graph = &plan->model->graph;
    const unsigned main_channels = lull_graph_channels(graph, LULL_TENSOR_INPUT);
    const int is_aux = at >= main_channels;
    const unsigned tensor = is_aux ? LULL_TENSOR_AUX : LULL_TENSOR_INPUT;
    const size_t pixel = row->pixel[is_aux];
    uint8_t *to = row->to[is_aux];
    uint16_t codes[3 * SOME];
    float scale[3 * SOME];
    if (lull_graph_dtype(graph, tensor) == LULL_DTYPE_F32) {
        to += at * sizeof *v;
        for (unsigned i = 0; i < n; i++, to += pixel)
            memcpy(to, v + 3 * i, 3 * sizeof *v);
        return;
    }
    to += is_aux ? at - main_channels : at * sizeof *codes;
    for (unsigned i = 0; i < 3 * SOME; i++)
        scale[i] = plan->model->input_scale[at + i % 3];
    for (unsigned first = 0; first < n; first += SOME) {
        unsigned count = lull_min_u(SOME, n - first);
        to_codes(codes, v + 3 * first, scale, (float)lull_graph_max(graph, tensor), 3 * count);
        for (unsigned i = 0; i < count; i++, to += pixel) {
            if (is_aux)
                for (unsigned c = 0; c < 3; c++)
                    to[c] = (uint8_t)codes[3 * i + c];
            else
                memcpy(to, codes + 3 * i, 3 * sizeof *codes);
        }
    }
}

/* The features in the order of their bits. */
void lull_exec_direct(const lull_task *t, const lull_direct *row, float *block, unsigned x,
                      unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    lull_transfer transfer;
    unsigned at = 0;
    for (unsigned feature = 0; feature < 3; feature++) {
        if (!(plan->frame.features >> feature & 1))
            continue;
        transfer = at ? LULL_TRANSFER_LINEAR : lull_exec_content(&plan->frame).transfer;
        if (at == 0 && is_decoded(plan)) {
            load_feature(block, t, feature, 1, LULL_TRANSFER_LINEAR, x, y, n);
            lull_transfer_inverse(LULL_TRANSFER_SRGB, block, 3 * (size_t)n);
            lull_transfer_forward(transfer, block, 3 * (size_t)n);
        } else {
            load_feature(block, t, feature, at == 0, transfer, x, y, n);
        }
        put_input(plan, block, at, row, n);
        at += 3;
    }
}

/* n pixels from column x on of row y of a U network's input. */
static void load_direct(const lull_task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    static const uint8_t tensors[2] = {LULL_TENSOR_INPUT, LULL_TENSOR_AUX};
    lull_direct row;
    for (unsigned i = 0; i < 2; i++) {
        row.pixel[i] = lull_ring_pixel(&t->plan->ring[tensors[i]]);
        row.to[i] = lull_plan_has(t->plan, tensors[i])
                        ? lull_exec_row(t->plan, tensors[i], y) + (x - t->left) * row.pixel[i]
                        : NULL;
    }
    lull_exec_direct(t, &row, block, x, y - t->base_row, n);
}

/* 1 if of n pixels none whose albedo is black has light: these show nothing. */
static int shows_nothing(const float *albedo, const float *light, float scale, unsigned n)
{
    for (unsigned i = 0; i < 3 * n; i += 3)
        if (lull_is_black(albedo + i, 1.0f) && !lull_is_black(light + i, scale))
            return 0;
    return 1;
}

/* The same of the run of pixels of row y that begins at column x. */
static int is_empty_run(const lull_task *t, unsigned x, unsigned y)
{
    const unsigned width = t->plan->frame.width, n = lull_min_u(LULL_EMPTY_RUN, width - x);
    float albedo[3 * LULL_EMPTY_RUN], light[3 * LULL_EMPTY_RUN];

    lull_image_load(albedo, &t->images->albedo, width, x, y, n);
    lull_image_load(light, &t->images->color, width, x, y, n);
    return shows_nothing(albedo, light, t->plan->scale, n);
}

/* 1 if all is above 0, and 1 at most. */
static int is_plain(const float *albedo, unsigned n)
{
    int is_within = 1;
    for (unsigned i = 0; i < 3 * n; i++)
        is_within &= (albedo[i] > 1.17549435e-38f) & (albedo[i] <= 1.0f);
    return is_within;
}

/* 1 if anything is above 1. */
static int is_bright(const float *albedo, unsigned n)
{
    for (unsigned i = 0; i < 3 * n; i++)
        if (albedo[i] > 1.0f)
            return 1;
    return 0;
}

/* Dims pixels i to `last` of `block`, of the run that begins with pixel `first`, which may lie
 * before it; the block's is pixel x of the row. */
static void dim_lamps(float *block, const lull_task *t, unsigned x, unsigned y, unsigned first,
                      unsigned i, unsigned last)
{
    const unsigned width = t->plan->frame.width;
    const unsigned n = lull_min_u(LULL_EMPTY_RUN, width - (x + first));
    float run[3 * LULL_EMPTY_RUN];
    lull_image_load(run, &t->images->albedo, width, x + first, y, n);
    for (; i < last; i++)
        lull_dim_lamps(block + 3 * (size_t)i, run, n, i - first);
}

/* n pixels of the albedo as they count, but for what kernels sanitise, then in `block`. */
static const float *count_albedo(const float *albedo, const lull_task *t, float *block, unsigned x,
                                 unsigned y, unsigned n)
{
    const float *light = lull_image_floats(&t->images->color, t->plan->frame.width, x, y);
    unsigned last = is_plain(albedo, n) ? n : 0;

    for (unsigned i = last; i < n; i = last) {
        unsigned first = i - (x + i) % LULL_EMPTY_RUN, black = i; /* wraps before the block */
        last = lull_min_u(first + LULL_EMPTY_RUN, n);
        if (is_bright(albedo + 3 * (size_t)i, last - i)) {
            if (albedo != block)
                albedo = memcpy(block, albedo, 3 * (size_t)n * sizeof *block);
            dim_lamps(block, t, x, y, first, i, last);
        }
        if (t->plan->frame.clean_aux)
            continue;
        while (black < last && !lull_is_black(albedo + 3 * (size_t)black, 1.0f))
            black++;
        if (black == last)
            continue;
        if (light && first == i && last - i == LULL_EMPTY_RUN
                ? !shows_nothing(albedo + 3 * (size_t)i, light + 3 * (size_t)i, t->plan->scale,
                                 LULL_EMPTY_RUN)
                : !is_empty_run(t, x + first, y))
            continue;
        if (albedo != block)
            albedo = memcpy(block, albedo, 3 * (size_t)n * sizeof *block);
        for (; black < last; black++)
            if (lull_is_black(albedo + 3 * (size_t)black, 1.0f))
                for (unsigned c = 0; c < 3; c++)
                    block[3 * (size_t)black + c] = LULL_EMPTY_ALBEDO;
    }
    return albedo;
}

const float *lull_exec_aux(const lull_task *t, unsigned feature, float *block, unsigned x,
                           unsigned y, unsigned n)
{
    const lull_image *image = lull_exec_feature(t->images, feature);
    const lull_frame *frame = &t->plan->frame;
    const float *pixels;
    if (!(frame->features >> feature & 1) || !(frame->features & ((1u << feature) - 1)))
        return NULL;
    pixels = lull_image_floats(image, frame->width, x, y);
    if (!pixels)
        lull_image_load(block, image, frame->width, x, y, n);
    pixels = pixels ? pixels : block;
    return feature == 1 ? count_albedo(pixels, t, block, x, y, n) : pixels;
}

/* What the kernels cannot do is done before, in `block`. */
void lull_exec_main(lull_encoding *from, const lull_task *t, float *block, unsigned x, unsigned y,
                    unsigned n)
{
    const lull_plan *plan = t->plan;
    lull_content_rule rule = lull_exec_content(&plan->frame);
    unsigned features = plan->frame.features;
    unsigned feature = features & LULL_HAS_COLOR ? 0 : features & LULL_HAS_ALBEDO ? 1 : 2;
    const lull_image *image = lull_exec_feature(t->images, feature);
    from->radiance = lull_image_floats(image, plan->frame.width, x, y);
    from->scale = plan->scale;
    from->most = rule.is_hdr ? LULL_RADIANCE_MAX : 1.0f;
    if (from->radiance && !plan->keeps_rows && !rule.is_signed && !is_decoded(plan) &&
        plan->scale >= 0.0f && !plan->model->graph.is_alone)
        return;
    load_feature(block, t, feature, 1, LULL_TRANSFER_LINEAR, x, y, n);
    if (is_decoded(plan))
        lull_transfer_inverse(LULL_TRANSFER_SRGB, block, 3 * (size_t)n);
    from->radiance = block;
    from->scale = 1.0f;
    from->most = LULL_RADIANCE_MAX;
}

void lull_exec_radiance(lull_encoding *from, const lull_task *t, float *block, unsigned x,
                        unsigned y, unsigned n)
{
    if (!t->plan->keeps_rows) {
        lull_exec_main(from, t, block, x, y - t->base_row, n);
        return;
    }
    from->radiance = lull_exec_floats(t->plan, LULL_TENSOR_RADIANCE, y, x - t->left);
    from->scale = 1.0f;
    from->most = LULL_RADIANCE_MAX;
}

void lull_exec_sane(float *block, const lull_encoding *from, const lull_task *t, unsigned n)
{
    lull_curve sane = {LULL_TRANSFER_LINEAR, from->scale, 0.0f, from->most, 0};
    if (from->radiance != block)
        memcpy(block, from->radiance, 3 * n * sizeof *block);
    t->plan->model->kernels.curve_in(block, &sane, 3 * (size_t)n);
}

/* n pixels from column x on of row y of the tensors of albedo and normal. */
static void load_aux(const lull_task *t, const float *albedo, const float *normal, unsigned x,
                     unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned column = x - t->left;
    if (albedo && lull_plan_has(plan, LULL_TENSOR_ALBEDO))
        plan->model->kernels.spread(lull_exec_floats(plan, LULL_TENSOR_ALBEDO, y, column),
                                    lull_exec_plane(plan, LULL_TENSOR_ALBEDO), albedo, n);
    if (normal && lull_plan_has(plan, LULL_TENSOR_NORMAL))
        plan->model->kernels.spread_xyz(lull_exec_floats(plan, LULL_TENSOR_NORMAL, y, column),
                                        lull_exec_plane(plan, LULL_TENSOR_NORMAL), normal, n);
}

/* The same of the guide. */
static void load_guide(const lull_task *t, const float *albedo, const float *normal, unsigned x,
                       unsigned y, unsigned n)
{
    uint8_t *row = lull_exec_row(t->plan, LULL_TENSOR_GUIDE, y) + 2 * (size_t)(x - t->left);
    t->plan->model->kernels.guide(row, albedo, normal, n);
}

/* n pixels of the main image, in [0,1], in the place of normals. */
static const float *as_normals(float *block, const float *main_image, unsigned n)
{
    for (unsigned i = 0; i < 3 * n; i++)
        block[i] = 2.0f * main_image[i] - 1.0f;
    return block;
}

/* The same for family K: codes, and the other tensors if they are kept from now on. */
static void load_kernel(const lull_task *t, float *block, unsigned x, unsigned y, unsigned n)
{
    lull_plan *plan = t->plan;
    unsigned column = x - t->left, row = y - t->base_row;
    uint8_t *codes = lull_exec_row(plan, 0, y) + column * lull_ring_pixel(&plan->ring[0]);
    lull_encoding from;
    lull_exec_main(
        &from, t,
        plan->keeps_rows ? lull_exec_floats(plan, LULL_TENSOR_RADIANCE, y, column) : block, x, row,
        n);
    from.albedo = lull_exec_aux(t, 1, block + 3 * LULL_BLOCK, x, row, n);
    from.normal = plan->model->graph.is_alone
                      ? as_normals(block + 6 * LULL_BLOCK, from.radiance, n)
                      : lull_exec_aux(t, 2, block + 6 * LULL_BLOCK, x, row, n);
    from.flags = lull_filter_flags(&from, !lull_exec_content(&plan->frame).is_hdr);
    plan->model->kernels.encode(codes, &from, n);
    if (plan->keeps_rows)
        load_aux(t, from.albedo, from.normal, x, y, n);
    if (plan->keeps_rows && lull_plan_has(plan, LULL_TENSOR_GUIDE))
        load_guide(t, from.albedo, from.normal, x, y, n);
}

/* Pixels of a row from one to the last that begins at most so many bytes from it, at least 1. */
static unsigned pixels_within(const lull_image *image, ptrdiff_t bytes)
{
    ptrdiff_t stride = lull_image_pixel_stride(image);
    stride = stride < 0 ? -stride : stride;
    return stride < bytes ? (unsigned)(bytes / stride) : 1;
}

void lull_exec_fetch(const lull_task *t, unsigned index)
{
    enum { LINE = 64 };
    const lull_frame *frame = &t->plan->frame;
    unsigned right = lull_min_u(t->right, frame->width), columns = right - t->left;
    for (unsigned i = t->ahead; i < t->ahead + LULL_FETCH && i < 3 * t->plan->row_step; i++) {
        const lull_image *image = lull_exec_feature(t->images, i % 3);
        unsigned y = lull_plan_done(t->plan, 0) + i / 3;
        unsigned x = t->left + columns * index / t->parts, step;
        unsigned end = t->left + columns * (index + 1) / t->parts;
        if (y >= frame->height || !(frame->features >> (i % 3) & 1))
            continue;
        step = pixels_within(image, LINE);
        for (; x < end; x += step)
            LULL_PREFETCH(lull_image_pixel(image, frame->width, x, y));
    }
}

void *lull_exec_scratch(const lull_task *t, unsigned worker)
{
    return (uint8_t *)t->plan + t->plan->scratch + t->plan->scratch_bytes * worker;
}

/* Zeros in the columns of a part of row y of a tensor. */
static void clear_part(const lull_task *t, unsigned tensor, unsigned y, const lull_part *part)
{
    const lull_ring *ring = &t->plan->ring[tensor];
    size_t pixel = lull_ring_pixel(ring);
    uint8_t *row = lull_exec_row(t->plan, tensor, y) + (part->left - t->left) * pixel;
    for (unsigned i = 0; i < (ring->has_planes ? ring->channels : 1u); i++)
        memset(row + i * lull_plan_plane(t->plan, tensor), 0, (part->right - part->left) * pixel);
}

void lull_exec_spread(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    const lull_plan *plan = t->plan;
    lull_part part = lull_exec_part(t, index, t->left, t->right);
    unsigned y = t->first + part.row, right = lull_min_u(part.right, plan->frame.width);
    if (y >= plan->frame.height && lull_plan_has(plan, LULL_TENSOR_ALBEDO))
        clear_part(t, LULL_TENSOR_ALBEDO, y, &part);
    if (y >= plan->frame.height && lull_plan_has(plan, LULL_TENSOR_NORMAL))
        clear_part(t, LULL_TENSOR_NORMAL, y, &part);
    for (unsigned x = part.left; y < plan->frame.height && x < right; x += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, right - x);
        float *block = lull_exec_scratch(t, worker);
        const float *albedo = lull_exec_aux(t, 1, block, x, y - t->base_row, n), *normal = NULL;
        if (lull_plan_has(plan, LULL_TENSOR_NORMAL))
            normal = lull_exec_aux(t, 2, block + 3 * LULL_BLOCK, x, y - t->base_row, n);
        load_aux(t, albedo, normal, x, y, n);
    }
    if (lull_plan_takes_grain(plan) && y < plan->frame.height && part.left < right)
        lull_exec_clean(t, part.left - t->left, y, right - part.left, worker);
}

void lull_exec_guide(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    lull_part part = lull_exec_part(t, index, t->left, t->right);
    unsigned y = t->first + part.row, right = lull_min_u(part.right, t->plan->frame.width);
    for (unsigned x = part.left; y < t->plan->frame.height && x < right; x += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, right - x);
        float *block = lull_exec_scratch(t, worker);
        const float *normal = lull_exec_aux(t, 2, block, x, y - t->base_row, n);
        const float *albedo = normal ? NULL : lull_exec_aux(t, 1, block, x, y - t->base_row, n);
        load_guide(t, albedo, normal, x, y, n);
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
        const lull_ring *ring = &plan->ring[lull_loaded[i]];
        size_t pixel = lull_ring_pixel(ring), kept = plan->saved_width * pixel;
        unsigned planes = ring->has_planes ? ring->channels : 1u;
        uint8_t *row;
        if (!lull_plan_has(plan, lull_loaded[i]))
            continue;
        row = lull_exec_row(plan, lull_loaded[i], y) + (column - t->left) * pixel;
        for (unsigned p = 0; p < planes; p++, row += lull_plan_plane(plan, lull_loaded[i])) {
            uint8_t *end = saved + ((size_t)y * planes + p + 1) * kept;
            copy_before(is_store ? end : row, is_store ? row : end, columns * pixel);
        }
        saved += plan->frame.height * planes * kept;
    }
}

/* A part of a row of the network's input; the whole row if columns are kept for the next strip. */
void lull_exec_load(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    lull_plan *plan = t->plan;
    const lull_frame *frame = &plan->frame;
    lull_part part = lull_exec_part(t, index, t->left, t->right);
    unsigned y = t->first + part.row, x = part.left, right = lull_min_u(part.right, frame->width);
    float *block = lull_exec_scratch(t, worker);
    unsigned tensors = plan->keeps_rows ? LULL_LOADED : 1;
    for (unsigned i = 0; y >= frame->height && i < tensors; i++) /* others: zeros since the start */
        if (lull_plan_has(plan, lull_loaded[i]))
            clear_part(t, lull_loaded[i], y, &part);
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

static float unscale_of(const lull_plan *plan)
{
    return plan->scale != 0.0f ? 1.0f / plan->scale : 0.0f;
}

void lull_exec_finish(float *v, const lull_plan *plan, unsigned channels, unsigned n)
{
    lull_content_rule rule = lull_exec_content(&plan->frame);
    int is_family_u = plan->model->graph.family == LULL_FAMILY_U;
    int has_more = is_decoded(plan) || channels == 1; /* before the range is set */
    lull_curve first = {LULL_TRANSFER_LINEAR, 1.0f, 0.0f, lull_float(0x7f800000u), 0}, last = first;
    last.scale = unscale_of(plan);
    last.low = rule.is_signed ? -1.0f : 0.0f;
    last.high = rule.is_hdr ? first.high : 1.0f;
    last.is_signed = rule.is_signed;
    if (!has_more)
        first = last;
    first.transfer = is_family_u ? rule.transfer : LULL_TRANSFER_LINEAR;
    plan->model->kernels.curve_out(v, &first, 3 * (size_t)n);
    if (is_decoded(plan))
        lull_transfer_forward(LULL_TRANSFER_SRGB, v, 3 * (size_t)n);
    for (unsigned i = 0; channels == 1 && i < n; i++)
        v[3 * i] = (v[3 * i] + v[3 * i + 1] + v[3 * i + 2]) / 3.0f;
    for (unsigned i = 0; has_more && i < 3 * n; i++) {
        float x = last.is_signed ? v[i] * 2.0f - 1.0f : v[i];
        x = x < last.low ? last.low : x;
        v[i] = (x > last.high ? last.high : x) * last.scale;
    }
}

void lull_exec_output(const lull_model *model, float *out, const uint8_t *row, size_t pixel,
                      unsigned n)
{
    const float scale = model->output_scale;
    const size_t words = pixel / sizeof(uint16_t);
    if (!model->graph.is_integer && pixel == 3 * sizeof *out) {
        memcpy(out, row, n * pixel);
    } else if (!model->graph.is_integer) {
        for (unsigned i = 0; i < n; i++)
            memcpy(out + 3 * i, row + i * pixel, 3 * sizeof *out);
    } else {
        const uint16_t *codes = (const uint16_t *)(const void *)row;
        for (unsigned i = 0; words == 3 && i < 3 * n; i++)
            out[i] = (float)(int)codes[i] * scale;
        for (unsigned i = 0; words > 3 && i < 3 * n; i++)
            out[i] = (float)(int)codes[i / 3 * words + i % 3] * scale;
    }
}

/* The same of the result of family K, which is given for exposed radiance by albedo: to the output
 * image itself if that is what the kernel makes. */
static int store_modulated(const lull_task *t, const lull_run_shares *shares, float *block,
                           unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    unsigned smooth = lull_graph_find(graph, LULL_OP_SMOOTH);
    float *to = lull_image_floats(&t->images->output, plan->frame.width, x, y - t->base_row);
    float unscale = unscale_of(plan);
    int is_direct = to && lull_exec_content(&plan->frame).is_hdr;
    int mixes = lull_exec_has_share(shares, t, x, n);
    float *made = is_direct && !mixes ? to : block;
    if (lull_plan_edges(plan) > 0.0f)
        lull_exec_edges(made, t, made == to ? unscale : 1.0f, x, y, n);
    else
        plan->model->kernels.modulate(
            made, lull_exec_floats(plan, graph->layers, y, x - t->left),
            lull_exec_plane(plan, graph->layers), lull_exec_floats(plan, smooth, y, x - t->left),
            lull_exec_plane(plan, smooth), made == to ? unscale : 1.0f, n);
    if (mixes)
        lull_exec_mix(block, shares, t, block + 3 * LULL_BLOCK, x, y, n);
    for (unsigned i = 0; mixes && is_direct && i < 3 * n; i++)
        to[i] = block[i] * unscale;
    return is_direct;
}

void lull_exec_store_part(const lull_task *t, unsigned x, unsigned y, unsigned columns,
                          unsigned worker)
{
    lull_plan *plan = t->plan;
    unsigned last = plan->model->graph.layers, end = x + columns;
    const uint8_t *row = lull_exec_row(plan, last, y);
    size_t pixel = lull_ring_pixel(&plan->ring[last]);
    float *block = lull_exec_scratch(t, worker);
    lull_run_shares shares;
    for (unsigned done = 0; x < end; x += LULL_BLOCK, done += LULL_BLOCK) {
        unsigned n = lull_min_u(LULL_BLOCK, end - x);
        if (plan->model->graph.family == LULL_FAMILY_K && done % LULL_MIXED == 0)
            lull_exec_shares(&shares, t, x, y, lull_min_u(LULL_MIXED, end - x));
        if (plan->model->graph.family == LULL_FAMILY_U)
            lull_exec_output(plan->model, block, row + (x - t->left) * pixel, pixel, n);
        else if (store_modulated(t, &shares, block, x, y, n))
            continue;
        lull_exec_finish(block, plan, t->images->output.channels, n);
        lull_image_store(&t->images->output, plan->frame.width, x, y - t->base_row, n, block);
    }
}

void lull_exec_store(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    lull_part part = lull_exec_part(t, index, t->begin, t->end);
    lull_exec_store_part(t, part.left, t->first + part.row, part.right - part.left, worker);
}
