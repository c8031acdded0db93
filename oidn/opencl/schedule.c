/* What the kernels of an OpenCL device do for a frame: their order, arguments, tensors, weights.
 * Arithmetic only, no call of OpenCL. */
#include "opencl.h"

#include <string.h>

#define CL_NONE LULL_TENSOR_NONE

/* ---- Tensors --------------------------------------------------------------------------------- */

typedef struct shape {
    uint32_t pixel;        /* bytes */
    int32_t width, height;
    int32_t border;        /* pixels of zeros around it */
} shape;

/* Size of a level: padded as the network's, or what of it is inside the image. */
static int32_t padded(int32_t size, unsigned level)
{
    return (int32_t)lull_align_up((size_t)size, LULL_CELL) >> level;
}
static int32_t inside(int32_t size, unsigned level) { return (size + (1 << level) - 1) >> level; }

/* Bytes of an element. */
static uint32_t element(const lull_graph *graph, unsigned tensor)
{
    return (uint32_t)lull_dtype_bytes(lull_graph_dtype(graph, tensor));
}

static shape shape_of(const lull_cl_schedule *s, unsigned tensor)
{
    static const uint8_t pixels[] = {12, 12, 12, 1, 4}; /* from LULL_CL_IMAGE_ALBEDO on */
    unsigned level = tensor < LULL_TENSORS ? lull_graph_level(s->graph, tensor) : 0;
    shape of = {0, padded(s->width, level), padded(s->height, level), 0};

    if (tensor >= LULL_TENSORS) {
        of.pixel = pixels[tensor - LULL_TENSORS];
    } else if (tensor == LULL_TENSOR_RADIANCE) {
        of.pixel = 12;
    } else if (tensor == LULL_TENSOR_GUIDE && s->graph->family == LULL_FAMILY_K) {
        of.pixel = 2;
    } else if (element(s->graph, tensor) == 4) { /* floats, in groups of four */
        of.pixel = (uint32_t)lull_align_up((size_t)lull_graph_channels(s->graph, tensor) * 4, 16);
    } else { /* codes */
        of.pixel = (uint32_t)lull_align_up(
            lull_graph_channels(s->graph, tensor) * element(s->graph, tensor), 4);
        of.border = LULL_CL_BORDER;
    }
    if (tensor == LULL_CL_SHARES) /* of runs */
        of.width /= (int32_t)LULL_RUN;
    if (of.pixel == 12 && !of.border) { /* an image: as large as the host's */
        of.width = s->width;
        of.height = s->height;
    }
    return of;
}

/* Turns in which a tensor is made and last used; images of the host are there before. */
static void find_life(const lull_cl_schedule *s, unsigned tensor, unsigned *first, unsigned *last)
{
    const int is_u = s->graph->family == LULL_FAMILY_U;
    unsigned i, k;

    *first = s->steps + 1;
    *last = 0;
    for (i = 0; i < s->steps; i++) {
        int uses = s->step[i].out == tensor;

        for (k = 0; k < LULL_CL_SOURCES; k++)
            uses |= s->step[i].source[k] == tensor;
        if (uses && *first > i + 1)
            *first = i + 1;
        if (uses)
            *last = i + 1;
    }
    if (tensor == LULL_TENSOR_RADIANCE || tensor == LULL_CL_IMAGE_ALBEDO ||
        tensor == LULL_CL_IMAGE_NORMAL ||
        (is_u && (tensor == LULL_TENSOR_INPUT || tensor == LULL_TENSOR_AUX)))
        *first = *first > s->steps ? *first : 0;
}

/* Where a block of memory lies, and when. */
typedef struct place {
    uint64_t begin, end;
    unsigned first, last;
} place;

/* The first gap that is large enough among the blocks there are at the same time. */
static void find_place(place *p, uint64_t bytes, const place *others, unsigned count)
{
    unsigned i = 0;

    p->begin = 0;
    while (i < count) {
        const place *o = &others[i++];

        if (o->first <= p->last && p->first <= o->last && o->begin < p->begin + bytes &&
            p->begin < o->end) {
            p->begin = o->end;
            i = 0;
        }
    }
    p->end = p->begin + bytes;
}

/* The size of every tensor. */
static void measure_tensors(lull_cl_schedule *s)
{
    unsigned t;

    for (t = 0; t < LULL_CL_TENSORS; t++) {
        const shape of = shape_of(s, t);
        const size_t left = lull_align_up((size_t)of.border * of.pixel, LULL_CL_UNIT);
        const size_t row = (size_t)(of.width + of.border) * of.pixel;
        const size_t pitch = of.border ? lull_align_up(left + row, LULL_CL_UNIT) : row;

        s->extent[t].bytes = (uint64_t)pitch * (uint64_t)(of.height + 2 * of.border);
        s->extent[t].before = (uint64_t)of.border * pitch + left;
        s->tensor[t].pitch = (uint32_t)pitch;
        s->tensor[t].pixel = of.pixel;
    }
}

/* Gives every tensor that is used its place. */
static void place_tensors(lull_cl_schedule *s)
{
    place places[LULL_CL_TENSORS];
    unsigned count = 0, t;

    s->bytes = LULL_CL_UNIT;
    for (t = 0; t < LULL_CL_TENSORS; t++) {
        place *p = &places[count];

        find_life(s, t, &p->first, &p->last);
        if (p->first > s->steps)
            continue;
        find_place(p, (s->extent[t].bytes + LULL_CL_UNIT - 1) / LULL_CL_UNIT * LULL_CL_UNIT, places,
                   count++);
        s->extent[t].begin = p->begin;
        s->bytes = p->end > s->bytes ? p->end : s->bytes;
    }
}

/* ---- Steps ----------------------------------------------------------------------------------- */

/* Work items of a step, in whole groups. */
static void set_items(lull_cl_step *step, int32_t x, int32_t y, uint32_t z)
{
    step->local[0] = LULL_CL_LOCAL_X;
    step->local[1] = step->kernel == LULL_CL_residual ? 1 : LULL_CL_LOCAL_Y;
    step->local[2] = 1;
    step->global[0] = lull_align_up((size_t)x, step->local[0]);
    step->global[1] = lull_align_up((size_t)y, step->local[1]);
    step->global[2] = z;
}

/* Appends a turn of a kernel, without its arguments. */
static lull_cl_step *add_step(lull_cl_schedule *s, unsigned kernel, unsigned out,
                              const uint8_t sources[LULL_CL_SOURCES])
{
    lull_cl_step *step = &s->step[s->steps++];

    memset(step, 0, sizeof *step);
    step->kernel = kernel;
    step->out = (uint8_t)out;
    memcpy(step->source, sources, sizeof step->source);
    return step;
}

/* A kernel of the filter at a level. */
static lull_cl_step *add_filter(lull_cl_schedule *s, unsigned kernel, unsigned out, unsigned level,
                                const uint8_t sources[LULL_CL_SOURCES])
{
    lull_cl_step *step = add_step(s, kernel, out, sources);
    lull_cl_filter *args = &step->args.filter;

    step->args_bytes = sizeof *args;
    args->width = padded(s->width, level);
    args->height = padded(s->height, level);
    args->inside_width = inside(s->width, level);
    args->inside_height = inside(s->height, level);
    args->flags = s->flags;
    args->calm = s->calm;
    args->ragged = s->ragged;
    set_items(step, args->width, args->height, 1);
    return step;
}

/* Work items for the border, too, which the kernel makes. */
static void cover_border(lull_cl_step *step)
{
    set_items(step, step->args.filter.width + 2 * LULL_CL_BORDER,
              step->args.filter.height + 2 * LULL_CL_BORDER, 1);
}

/* Rows of taps of source s of a convolution, and their columns. */
static unsigned tap_rows(const lull_layer *layer, unsigned s)
{
    return layer->op == LULL_OP_HEAD ? 1 : s == 0 && lull_layer_is_up(layer) ? 8 : 3;
}
static unsigned tap_columns(const lull_layer *layer, unsigned s)
{
    return layer->op == LULL_OP_HEAD ? 1 : s == 0 && lull_layer_is_up(layer) ? 2 : 3;
}

/* 1 if grain is taken out of albedo or normals. */
static int takes_grain(const lull_cl_schedule *s)
{
    return s->graph->before && s->flags & LULL_CL_FEATURES && !(s->flags & LULL_CL_CLEAN);
}

/* 1 if a layer has nothing to work on: without normals none are filtered, and without albedo, too,
 * there is no regression. */
static int is_left_out(const lull_cl_schedule *s, const lull_layer *layer)
{
    if (layer < s->graph->layer + s->graph->before)
        return !takes_grain(s);
    if (layer->op == LULL_OP_FACE)
        return !(s->flags & LULL_CL_NORMAL);
    return (layer->op == LULL_OP_FIT_SUMS || layer->op == LULL_OP_FIT ||
            layer->op == LULL_OP_REGRESS) &&
           !(s->flags & LULL_CL_FEATURES);
}

/* The tensor that stands for another, mostly itself: the input for that without grain, as it is
 * taken out in place, and where there is no regression the result before it for its result; for
 * others that are left out, none. */
static uint8_t stand_in(const lull_cl_schedule *s, uint8_t tensor)
{
    const lull_layer *layer;

    if (tensor < 1 || tensor > s->graph->layers)
        return tensor;
    layer = &s->graph->layer[tensor - 1];
    if (layer->op == LULL_OP_ENCODE)
        return LULL_TENSOR_INPUT;
    if (!is_left_out(s, layer))
        return tensor;
    return layer->op == LULL_OP_REGRESS ? layer->source[0] : CL_NONE;
}

/* A convolution: squares of 2x2 pixels, those of the border included. */
static void add_conv(lull_cl_schedule *s, unsigned l)
{
    const lull_layer *layer = &s->graph->layer[l];
    const int32_t border = LULL_CL_BORDER;
    uint8_t sources[LULL_CL_SOURCES] = {CL_NONE, CL_NONE, CL_NONE, CL_NONE};
    lull_cl_step *step;
    lull_cl_conv *args;
    unsigned i;

    for (i = 0; i < LULL_MAX_SOURCES; i++)
        if (lull_layer_inputs(s->graph, layer, i))
            sources[i] = stand_in(s, layer->source[i]);
    step = add_step(s, LULL_CL_conv, l + 1, sources);
    args = &step->args.conv;
    step->args_bytes = sizeof *args;
    args->width = padded(s->width, layer->level);
    args->height = padded(s->height, layer->level);
    args->outputs = layer->outputs;
    args->most = (int32_t)lull_graph_max(s->graph, l + 1);
    args->shift = s->weights[l].shift;
    args->form = (layer->op == LULL_OP_HEAD ? LULL_CL_HEAD : 0) |
                 (lull_layer_is_up(layer) ? LULL_CL_UP : 0) | (layer->pool ? LULL_CL_POOL : 0);
    for (i = 0; i < LULL_CL_CONV_SOURCES && sources[i] != CL_NONE; i++) {
        args->sources = i + 1;
        args->wide |= (uint32_t)(element(s->graph, sources[i]) == 2) << i;
        args->length[i] = tap_columns(layer, i) * shape_of(s, sources[i]).pixel / 4;
        args->weights[i] = s->weights[l].taps[i];
    }
    args->bias = s->weights[l].bias;
    args->multiplier = s->weights[l].multiplier;
    set_items(step, layer->pool ? args->width / 2 + 2 * border : (args->width + 1) / 2 + border,
              layer->pool ? args->height / 2 + 2 * border : (args->height + 1) / 2 + border,
              (args->outputs + LULL_CL_BLOCK - 1) / LULL_CL_BLOCK);
}

/* What the kernel of a layer of the filter reads. */
static void filter_sources(uint8_t sources[LULL_CL_SOURCES], const lull_cl_schedule *s, unsigned l)
{
    const lull_layer *layer = &s->graph->layer[l];
    unsigned i;

    for (i = 0; i < LULL_CL_SOURCES; i++)
        sources[i] = i < LULL_MAX_SOURCES ? stand_in(s, layer->source[i]) : CL_NONE;
    if (layer->op == LULL_OP_SMOOTH && !(s->flags & LULL_CL_ALBEDO))
        sources[0] = CL_NONE;
    if (layer->op == LULL_OP_ENCODE) {
        sources[0] = s->flags & LULL_CL_ALBEDO ? LULL_TENSOR_ALBEDO : CL_NONE;
        sources[1] = s->flags & LULL_CL_NORMAL ? LULL_TENSOR_NORMAL : CL_NONE;
        sources[3] = LULL_TENSOR_RADIANCE;
    }
    if (layer->op == LULL_OP_BILATERAL || layer->op == LULL_OP_CORRECT ||
        (layer->op == LULL_OP_FILTER && lull_graph_has_noise(s->graph, l + 1)))
        sources[2] = LULL_CL_NOISE_CODES;
    if (layer->op == LULL_OP_RESIDUAL) {
        sources[2] = (uint8_t)lull_graph_find(s->graph, LULL_OP_SMOOTH);
        sources[3] = LULL_CL_NOISE_CODES;
    }
}

/* The first of a head's codes that a layer of the filter reads; heads may begin with a later one
 * than the first. */
static uint32_t first_code(const lull_graph *graph, const lull_layer *layer)
{
    switch (layer->op) {
    case LULL_OP_SMOOTH:
    case LULL_OP_FACE:
        return LULL_HEAD_ALBEDO - graph->layer[layer->source[1] - 1].first;
    case LULL_OP_DEMODULATE:
        return LULL_HEAD_CONFIDENCE - graph->layer[layer->source[2] - 1].first;
    case LULL_OP_POOL:
        return LULL_HEAD_CONFIDENCE;
    default:
        return LULL_HEAD_BLEND;
    }
}

/* What a kernel makes of runs of pixels of a tensor. */
static void add_runs(lull_cl_schedule *s, unsigned kernel, unsigned out, unsigned tensor)
{
    const uint8_t sources[LULL_CL_SOURCES] = {(uint8_t)tensor, CL_NONE, CL_NONE, CL_NONE, CL_NONE};
    lull_cl_step *step = add_filter(s, kernel, out, 0, sources);

    set_items(step, step->args.filter.width / (int32_t)LULL_RUN, step->args.filter.height, 1);
}

/* A layer of the filter, unless it is left out. */
static void add_layer(lull_cl_schedule *s, unsigned l)
{
    static const uint8_t kernels[] = {[LULL_OP_SMOOTH] = LULL_CL_smooth,
                                      [LULL_OP_GRAIN_SUMS] = LULL_CL_grain_sums,
                                      [LULL_OP_GRAIN] = LULL_CL_grain,
                                      [LULL_OP_ENCODE] = LULL_CL_take_grain,
                                      [LULL_OP_FACE] = LULL_CL_face,
                                      [LULL_OP_DEMODULATE] = LULL_CL_demodulate,
                                      [LULL_OP_POOL] = LULL_CL_shrink,
                                      [LULL_OP_FILTER] = LULL_CL_filter,
                                      [LULL_OP_BLEND] = LULL_CL_blend,
                                      [LULL_OP_BILATERAL] = LULL_CL_bilateral,
                                      [LULL_OP_FIT_SUMS] = LULL_CL_fit_sums,
                                      [LULL_OP_FIT] = LULL_CL_fit,
                                      [LULL_OP_REGRESS] = LULL_CL_regress,
                                      [LULL_OP_RESIDUAL] = LULL_CL_residual,
                                      [LULL_OP_GAINS] = LULL_CL_gains,
                                      [LULL_OP_CORRECT] = LULL_CL_correct};
    const lull_layer *layer = &s->graph->layer[l];
    uint8_t sources[LULL_CL_SOURCES];
    lull_cl_filter *args;
    lull_cl_step *step;

    if (is_left_out(s, layer))
        return;
    filter_sources(sources, s, l);
    step = add_filter(s, kernels[layer->op],
                      layer->op == LULL_OP_ENCODE ? LULL_TENSOR_INPUT : l + 1, layer->level,
                      sources);
    args = &step->args.filter;
    args->code = first_code(s->graph, layer);
    if (layer->op == LULL_OP_FILTER && sources[2] == LULL_CL_NOISE_CODES)
        args->flags |= LULL_CL_NOISE;
    if (layer->op == LULL_OP_BILATERAL && lull_graph_is_far(layer))
        args->flags |= LULL_CL_FAR;
    if (layer->op == LULL_OP_BLEND) { /* what there is of the coarser level */
        args->inside_width = inside(s->width, layer->level + 1u);
        args->inside_height = inside(s->height, layer->level + 1u);
    }
    if (layer->op == LULL_OP_GRAIN_SUMS) { /* of pixels */
        args->inside_width = s->width;
        args->inside_height = s->height;
    }
    if (layer->op == LULL_OP_RESIDUAL || layer->op == LULL_OP_FIT_SUMS) {
        /* a work item for each column of pixels */
        args->inside_width = s->width;
        args->inside_height = s->height;
        set_items(step, padded(s->width, 0), args->height, 1);
    }
}

/* What is made of the images. */
static void add_inputs(lull_cl_schedule *s)
{
    const uint8_t albedo = s->flags & LULL_CL_ALBEDO ? LULL_CL_IMAGE_ALBEDO : CL_NONE;
    const uint8_t normal = s->flags & LULL_CL_NORMAL ? LULL_CL_IMAGE_NORMAL : CL_NONE;
    const uint8_t all[LULL_CL_SOURCES] = {LULL_TENSOR_RADIANCE, albedo, normal, CL_NONE, CL_NONE};
    const uint8_t aux[LULL_CL_SOURCES] = {albedo, normal, CL_NONE, CL_NONE, CL_NONE};
    const uint8_t facing[LULL_CL_SOURCES] = {normal, CL_NONE, CL_NONE, CL_NONE, CL_NONE};

    cover_border(add_filter(s, LULL_CL_encode, LULL_TENSOR_INPUT, 0, all));
    if (s->flags & LULL_CL_ALBEDO)
        add_filter(s, LULL_CL_spread, LULL_TENSOR_ALBEDO, 0, aux);
    if (s->flags & LULL_CL_NORMAL &&
        (takes_grain(s) || lull_graph_find(s->graph, LULL_OP_FACE) != CL_NONE))
        add_filter(s, LULL_CL_spread_normal, LULL_TENSOR_NORMAL, 0, facing);
    if (lull_graph_find(s->graph, LULL_OP_BILATERAL) != CL_NONE)
        add_filter(s, LULL_CL_guide, LULL_TENSOR_GUIDE, 0, aux);
}

/* The output: exposed result, with some of the input where there is little noise. */
static void add_output(lull_cl_schedule *s)
{
    const int mixes = lull_graph_mixed_by(s->graph) != CL_NONE;
    const uint8_t sources[LULL_CL_SOURCES] = {
        stand_in(s, (uint8_t)s->graph->layers),
        (uint8_t)lull_graph_find(s->graph, LULL_OP_SMOOTH), mixes ? LULL_CL_SHARES : CL_NONE,
        mixes ? LULL_TENSOR_RADIANCE : CL_NONE, mixes ? LULL_CL_NOISE_CODES : CL_NONE};
    lull_cl_step *step;

    if (mixes)
        add_runs(s, LULL_CL_shares, LULL_CL_SHARES, LULL_CL_NOISE_CODES);
    step = add_filter(s, LULL_CL_modulate, LULL_CL_IMAGE_RESULT, 0, sources);
    step->args.filter.flags |= mixes ? LULL_CL_NOISE : 0;
}

/* Steps and sizes of tensors. */
static void make_steps(lull_cl_schedule *s, unsigned width, unsigned height)
{
    const lull_graph *graph = s->graph;
    unsigned l;

    s->width = (int32_t)width;
    s->height = (int32_t)height;
    s->steps = 0;
    if (graph->family == LULL_FAMILY_K)
        add_inputs(s);
    for (l = 0; l < graph->layers; l++)
        if (!lull_layer_is_conv(&graph->layer[l]))
            add_layer(s, l);
        else if (!is_left_out(s, &graph->layer[l]))
            add_conv(s, l);
    if (graph->family == LULL_FAMILY_K)
        add_output(s);
    measure_tensors(s);
}

/* Tells the kernels where their tensors are. */
static void link_steps(lull_cl_schedule *s)
{
    unsigned i, k, t;

    for (t = 0; t < LULL_CL_TENSORS; t++)
        s->tensor[t].at = (uint32_t)((s->extent[t].begin + s->extent[t].before) / LULL_CL_UNIT);
    for (i = 0; i < s->steps; i++) {
        lull_cl_step *step = &s->step[i];
        const int is_conv = step->kernel == LULL_CL_conv;
        lull_cl_tensor *sources = is_conv ? step->args.conv.source : step->args.filter.source;

        *(is_conv ? &step->args.conv.out : &step->args.filter.out) = s->tensor[step->out];
        for (k = 0; k < (is_conv ? step->args.conv.sources : LULL_CL_SOURCES); k++)
            if (step->source[k] != CL_NONE)
                sources[k] = s->tensor[step->source[k]];
    }
}

void lull_cl_schedule_make(lull_cl_schedule *s, unsigned width, unsigned height)
{
    make_steps(s, width, height);
    place_tensors(s);
    link_steps(s);
}

void lull_cl_schedule_resize(lull_cl_schedule *s, unsigned width, unsigned height)
{
    make_steps(s, width, height);
    link_steps(s);
}

/* ---- Weights --------------------------------------------------------------------------------- */

/* Tap of output o on channel c of a column in a row of taps, as the CPU's kernels have it
 * (kernels.h, lull_packed_layer). */
static int8_t get_tap(const lull_model *model, unsigned l, unsigned s, unsigned row,
                      unsigned column, unsigned c, unsigned o)
{
    static const uint8_t blocks[] = {LULL_PACK_SOURCE, LULL_PACK_SKIP, LULL_PACK_THIRD};
    const lull_layer *layer = &model->graph.layer[l];
    const lull_packed_layer *packed = &model->layer[l];
    const lull_dtype dtype = lull_graph_dtype(&model->graph, layer->source[s]);
    const unsigned inputs = lull_layer_inputs(&model->graph, layer, s);
    const unsigned lanes =
        lull_pack_is_int3(&model->graph, &model->kernels, l) ? 1 : model->kernels.block_int;
    const unsigned length =
        lull_pack_length(dtype, (tap_columns(layer, s) + packed->has_pairs) * inputs);
    const unsigned together = dtype == LULL_DTYPE_U8 ? 4 : 2; /* elements of a dword */
    unsigned block = blocks[s] + row, k;
    const int8_t *dword;
    int16_t word;

    if (s == 0 && lull_layer_is_up(layer)) {
        unsigned phase = row / 2, is_right = packed->has_pairs & phase;

        o += is_right * layer->outputs;
        column += is_right;
        block = lull_pack_block(layer, phase - is_right, row % 2);
    }
    k = column * inputs + c;
    dword = (const int8_t *)model + packed->weights[block] +
            ((size_t)(o / lanes * length + k / together) * lanes + o % lanes) * 4;
    if (dtype == LULL_DTYPE_U8)
        return dword[k % 4];
    if (model->kernels.splits_wide)
        return dword[2 * (k % 2) + 1];
    memcpy(&word, dword + 2 * (k % 2), sizeof word);
    return (int8_t)word;
}

/* Channels of a pixel of source s, those that fill its last dword included. */
static unsigned whole_channels(const lull_graph *graph, const lull_layer *layer, unsigned s)
{
    const unsigned inputs = lull_layer_inputs(graph, layer, s);

    return inputs ? (unsigned)lull_align_up(inputs, 4 / element(graph, layer->source[s])) : 0;
}

size_t lull_cl_layout(lull_cl_weights *weights, const lull_model *model)
{
    const lull_graph *graph = &model->graph;
    size_t total = LULL_CL_TABLES;
    unsigned l, s;

    for (l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        const size_t outputs = lull_align_up(layer->outputs, LULL_CL_BLOCK);

        if (!lull_layer_is_conv(layer))
            continue;
        weights[l].bias = (uint32_t)lull_append(&total, outputs * 4);
        weights[l].multiplier = (uint32_t)lull_append(&total, outputs * 4);
        weights[l].shift = model->layer[l].wide_shift;
        for (s = 0; s < LULL_CL_CONV_SOURCES; s++)
            weights[l].taps[s] =
                (uint32_t)lull_append(&total, outputs * tap_rows(layer, s) * tap_columns(layer, s) *
                                                  whole_channels(graph, layer, s));
    }
    return total;
}

/* Taps of source s of layer l, in the order of lull_cl_conv. */
static void pack_taps(uint8_t *out, const lull_model *model, unsigned l, unsigned s)
{
    const lull_layer *layer = &model->graph.layer[l];
    const unsigned inputs = lull_layer_inputs(&model->graph, layer, s), outputs = layer->outputs;
    unsigned row, first, column, c, o;

    for (row = 0; row < tap_rows(layer, s); row++)
        for (first = 0; first < outputs; first += LULL_CL_BLOCK)
            for (column = 0; column < tap_columns(layer, s); column++)
                for (c = 0; c < whole_channels(&model->graph, layer, s); c++)
                    for (o = first; o < first + LULL_CL_BLOCK; o++)
                        *out++ = c < inputs && o < outputs
                                     ? (uint8_t)get_tap(model, l, s, row, column, c, o)
                                     : 0;
}

void lull_cl_pack(uint8_t *out, const lull_cl_weights *weights, const lull_model *model)
{
    const lull_graph *graph = &model->graph;
    unsigned l, s;

    memcpy(out, model->weight_table, LULL_CL_TABLES / 2);
    memcpy(out + LULL_CL_TABLES / 2, model->blend_table, LULL_CL_TABLES / 2);
    for (l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        const uint8_t *packed = (const uint8_t *)model;

        if (!lull_layer_is_conv(layer))
            continue;
        memcpy(out + weights[l].bias, packed + model->layer[l].bias, 4 * (size_t)layer->outputs);
        memcpy(out + weights[l].multiplier, packed + model->layer[l].multiplier,
               4 * (size_t)layer->outputs);
        for (s = 0; s < LULL_CL_CONV_SOURCES; s++)
            if (lull_layer_inputs(graph, layer, s))
                pack_taps(out + weights[l].taps[s], model, l, s);
    }
}
