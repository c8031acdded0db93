#include "pack.h"

#include "transfer.h"

/* Kernel taps that fall together when a 3x3 kernel is applied to a source upsampled by 2: for
 * output phase p and row (or column) a of the 2x2 kernel on the small source, taps first..last. */
static const struct {
    uint8_t first, last;
} folded[2][2] = {{{0, 0}, {1, 2}}, {{0, 1}, {2, 2}}};

/* One weight block: the taps of all outputs of a layer on one row of its source or skip. */
typedef struct block {
    const lull_tza_tensor *weight;
    lull_dtype dtype; /* of the elements that the taps meet */
    unsigned outputs; /* of the layer */
    unsigned inputs;  /* channels of the source or skip */
    unsigned offset;  /* its first channel in the tensor */
    unsigned first;   /* tensor's row of output 0 */
    unsigned columns; /* taps in a row of the kernel: 3, or 2 of a phase kernel */
    unsigned row;     /* of the kernel */
    unsigned has_pairs; /* lull_packed_layer's; `columns` and `outputs` are those of one pixel */
    uint8_t fold;     /* 1: sum the taps of a 3x3 kernel for phase_x, phase_y */
    uint8_t phase_x, phase_y;
} block;

unsigned lull_pack_block(const lull_layer *layer, unsigned phase, unsigned row)
{
    return LULL_PACK_SOURCE + (lull_layer_is_up(layer) ? 2 * phase + row : row);
}

/* The tensor with the taps of a layer's source s. Those of the input's auxiliary channels follow
 * those of the others. */
static const lull_tza_tensor *taps_of(const lull_graph *graph, const lull_layer *layer,
                                      const lull_layer_tensors *tensors, unsigned s)
{
    s -= layer->source[s] == LULL_TENSOR_AUX;
    return s && graph->is_integer ? &tensors->skip : &tensors->weight;
}

/* Channel of that tensor at which those of source s begin. */
static unsigned first_channel(const lull_graph *graph, const lull_layer *layer, unsigned s)
{
    if (layer->source[s] == LULL_TENSOR_AUX)
        return lull_graph_channels(graph, LULL_TENSOR_INPUT);
    return s && !graph->is_integer ? lull_layer_inputs(graph, layer, 0) : 0;
}

/* Describes block number `index` of a layer; returns 0 if the layer has no such block. Layers in
 * Winograd's form, and those that are no convolutions, have none. */
static int describe(block *b, const lull_graph *graph, unsigned l, unsigned index,
                    const lull_layer_tensors *tensors)
{
    const lull_layer *layer = &graph->layer[l];
    unsigned s = (index >= LULL_PACK_SKIP) + (index >= LULL_PACK_THIRD);
    int is_head = layer->op == LULL_OP_HEAD, is_up = lull_layer_is_up(layer);
    memset(b, 0, sizeof *b);
    b->inputs = lull_layer_is_conv(layer) ? lull_layer_inputs(graph, layer, s) : 0;
    if (layer->is_winograd || !b->inputs || (!s && !is_up && index >= (is_head ? 1u : 3u)))
        return 0;
    b->weight = taps_of(graph, layer, tensors, s);
    b->dtype = lull_graph_dtype(graph, layer->source[s]);
    b->outputs = layer->outputs;
    b->offset = first_channel(graph, layer, s);
    b->columns = is_head ? 1 : 3;
    b->first = layer->first;
    b->row = s ? (index - LULL_PACK_SKIP) % 3 : index;
    if (is_up && !s) {
        b->columns = 2;
        b->row = index & 1;
        b->phase_x = index >> 1 & 1;
        b->phase_y = (uint8_t)(index >> 2);
        b->fold = !graph->is_integer;
        b->first = graph->is_integer ? (index >> 1) * b->outputs : 0;
    }
    return 1;
}

/* The same of a block as it is packed: of pairs, blocks of even x hold those of odd x, too. */
static int describe_packed(block *b, const lull_packed_layer *packed, const lull_graph *graph,
                           unsigned l, unsigned index, const lull_layer_tensors *tensors)
{
    if (!describe(b, graph, l, index, tensors))
        return 0;
    b->has_pairs = packed->has_pairs;
    return !b->has_pairs || !b->phase_x;
}

/* Elements of a packed block's run. */
static unsigned run_of(const block *b) { return (b->columns + b->has_pairs) * b->inputs; }

/* Tap of output o on a channel of a column of a run. */
static float tap(const block *b, unsigned o, unsigned column, unsigned channel)
{
    unsigned side = b->fold ? 3 : b->columns;
    size_t at = ((size_t)(b->first + o) * b->weight->dims[1] + b->offset + channel) * side;
    float sum = 0;
    if (!b->fold)
        return lull_tza_float(b->weight, (at + b->row) * side + column);
    for (unsigned y = folded[b->phase_y][b->row].first; y <= folded[b->phase_y][b->row].last; y++)
        for (unsigned x = folded[b->phase_x][column].first; x <= folded[b->phase_x][column].last;
             x++)
            sum += lull_tza_float(b->weight, (at + y) * side + x);
    return sum;
}

/* Weight of output o of a packed block on a channel of a column of its run. Outputs of a right
 * pixel come after those of the left one, and see the run from its second column on. */
static float weight_of(const block *b, unsigned o, unsigned column, unsigned channel)
{
    unsigned is_right = o >= b->outputs;
    if (o >= b->outputs << b->has_pairs || column < is_right || column - is_right >= b->columns)
        return 0.0f;
    if (is_right && b->columns == 3) /* the same taps; else the tensor's next rows, a phase's */
        o -= b->outputs;
    return tap(b, o, column - is_right, channel);
}

/* Elements that a kernel multiplies at once: one float, or a dword of integers. */
static unsigned group(lull_dtype dtype) { return (unsigned)(4 / lull_dtype_bytes(dtype)); }

unsigned lull_pack_length(lull_dtype dtype, unsigned elements)
{
    return (elements + group(dtype) - 1) / group(dtype);
}

/* split: 0, or as which byte of two a wide weight is written, 1 or 2. */
static void put(uint8_t *out, lull_dtype dtype, float value, unsigned split)
{
    int is_float = dtype == LULL_DTYPE_F32; /* then the value may be outside the integers */
    int8_t narrow = is_float ? 0 : (int8_t)value;
    int16_t wide = is_float ? 0 : (int16_t)value;
    if (is_float) {
        memcpy(out, &value, sizeof value);
    } else if (dtype == LULL_DTYPE_U8) {
        memcpy(out, &narrow, sizeof narrow);
    } else if (split) {
        out[0] = out[1] = 0;
        memcpy(out + split - 1, &narrow, sizeof narrow);
    } else {
        memcpy(out, &wide, sizeof wide);
    }
}

/* [output / lanes][length][output % lanes][group]; the same number of bytes for each dtype's group.
 * Returns the end. */
LULL_NOINLINE static uint8_t *write_block(uint8_t *out, const block *b, unsigned lanes,
                                          unsigned split)
{
    unsigned together = group(b->dtype), length = lull_pack_length(b->dtype, run_of(b));
    unsigned column[4], channel[4]; /* of an element of the run: columns outer, channels inner */
    size_t bytes = 4 / together;
    for (unsigned first = 0; first < b->outputs; first += lanes)
        for (unsigned k = 0; k < length * together; k += together) {
            for (unsigned i = 0; i < together; i++) {
                column[i] = (k + i) / b->inputs;
                channel[i] = (k + i) % b->inputs;
            }
            for (unsigned o = first; o < first + lanes; o++)
                for (unsigned i = 0; i < together; i++, out += bytes)
                    put(out, b->dtype, weight_of(b, o, column[i], channel[i]), split);
        }
    return out;
}

/* 1 if a block's weights are stored twice (kernels.h). */
static unsigned is_split(const block *b, const lull_kernels *kernels)
{
    return kernels->splits_wide && b->dtype == LULL_DTYPE_U15;
}

/* ---- Checks of integer models (docs/arithmetic.md) ------------------------------------------- */

/* Sum of |taps| of output o over one block, a run; -1 if the taps break a rule. Clears *fits_words
 * if they break that of words. */
static int64_t tap_sum(const block *b, unsigned o, int *fits_words)
{
    int positive[4] = {0}, negative[4] = {0}; /* of the first and second of two pairs, in turn */
    int before[2] = {0, 0}, most = 0, least = 0, lowest = 0; /* of a pair; of a tap */
    for (unsigned k = 0, column = 0, channel = 0; column < b->columns; k++) {
        int w = (int)tap(b, o, column, channel), up = w > 0 ? w : 0, down = w - up;
        int pair_up = k & 1 ? before[0] + up : up, pair_down = k & 1 ? before[1] + down : down;
        if (++channel == b->inputs)
            channel = 0, column++;
        positive[k & 3] += up;
        negative[k & 3] += down;
        most = pair_up > most ? pair_up : most;
        least = pair_down < least ? pair_down : least;
        lowest = w < lowest ? w : lowest;
        before[0] = up;
        before[1] = down;
    }
    if (lowest < -127 || (b->dtype == LULL_DTYPE_U8 && (most > 128 || least < -128)))
        return -1;
    for (unsigned i = 0; i < 4; i += 2)
        if (positive[i] + positive[i + 1] > 128 || negative[i] + negative[i + 1] < -128)
            *fits_words = 0;
    return (int64_t)positive[0] + positive[1] + positive[2] + positive[3] - negative[0] -
           negative[1] - negative[2] - negative[3];
}

/* The largest sum that output o in phase `phase` can have; -1 if it can leave int32, or if the taps
 * break a rule. */
static int64_t largest_sum(const lull_graph *graph, unsigned l, const lull_layer_tensors *tensors,
                           unsigned o, unsigned phase, unsigned shift, int *fits_words)
{
    const lull_layer *layer = &graph->layer[l];
    int64_t wide = 0, narrow = 0, bias = (int64_t)lull_tza_int(&tensors->bias, layer->first + o);
    for (unsigned i = 0; i < LULL_PACK_BLOCKS; i++) {
        block b;
        int64_t sum;
        if (!describe(&b, graph, l, i, tensors) ||
            (lull_layer_is_up(layer) && i < LULL_PACK_SKIP && i >> 1 != phase))
            continue;
        sum = tap_sum(&b, o, fits_words);
        if (sum < 0)
            return -1;
        *(b.dtype == LULL_DTYPE_U15 ? &wide : &narrow) += sum;
    }
    wide = wide * 32767 + (1 << shift >> 1);
    narrow = (wide >> shift) + (bias < 0 ? -bias : bias) + narrow * 255;
    return wide <= INT32_MAX && narrow <= INT32_MAX ? narrow : -1;
}

/* 1 if layer l is one for conv_int whose runs are all of narrow elements. */
static int has_words(const lull_graph *graph, const lull_kernels *kernels, unsigned l)
{
    const lull_layer *layer = &graph->layer[l];
    for (unsigned s = 0; s < LULL_MAX_SOURCES; s++)
        if (lull_layer_inputs(graph, layer, s) &&
            lull_graph_dtype(graph, layer->source[s]) != LULL_DTYPE_U8)
            return 0;
    return !lull_pack_is_int3(graph, kernels, l);
}

/* Checks one layer of an integer model. Multipliers come from floats: they have 24 bits. */
static lull_status check_integer(lull_packed_layer *packed, const lull_graph *graph,
                                 const lull_kernels *kernels, unsigned l, const lull_tza *tza)
{
    const lull_layer *layer = &graph->layer[l];
    int64_t most = 0;
    lull_layer_tensors tensors;
    int32_t shift;
    unsigned run; /* of a head */
    if (!lull_layer_is_conv(layer))
        return LULL_OK;
    lull_graph_tensors(&tensors, layer, tza);
    shift = tensors.shift.rank ? lull_tza_int(&tensors.shift, 0) : 0;
    if (shift < 0 || shift > 15 || (layer->pool && lull_graph_dtype(graph, l + 1) != LULL_DTYPE_U8))
        return LULL_ERROR_NETWORK;
    packed->fits_words = has_words(graph, kernels, l);
    for (unsigned o = 0; o < layer->outputs; o++) {
        float scale = lull_tza_float(&tensors.scale, layer->first + o);
        if (!(scale >= 0.0f && scale < 0.5f))
            return LULL_ERROR_NETWORK;
        for (unsigned phase = 0; phase < (lull_layer_is_up(layer) ? 4u : 1u); phase++) {
            int64_t sum = largest_sum(graph, l, &tensors, o, phase, (unsigned)shift,
                                      &packed->fits_words);
            if (sum < 0)
                return LULL_ERROR_NETWORK;
            most = sum > most ? sum : most;
        }
    }
    packed->is_small = most <= 1 << 24;
    packed->fits_words &= packed->is_small;
    run = lull_pack_length(LULL_DTYPE_U8, lull_layer_inputs(graph, layer, 0));
    packed->in_planes = kernels->in_planes && layer->op == LULL_OP_HEAD && packed->fits_words &&
                        run >= 2 && run <= LULL_HEAD_RUN;
    return LULL_OK;
}

/* The scales of the input and output codes. */
static lull_status read_scales(lull_model *model, const lull_tza *tza)
{
    lull_tza_tensor input, output;
    if (!model->graph.is_integer || model->graph.family == LULL_FAMILY_K)
        return LULL_OK;
    if (!lull_tza_find(tza, "input", ".scale", &input) || input.rank != 1 || input.dtype != 'f' ||
        input.dims[0] != model->graph.inputs || !lull_tza_find(tza, "output", ".scale", &output) ||
        output.rank != 1 || output.dtype != 'f' || output.dims[0] != 1)
        return LULL_ERROR_NETWORK;
    for (unsigned i = 0; i < model->graph.inputs; i++) {
        model->input_scale[i] = lull_tza_float(&input, i);
        if (!(model->input_scale[i] >= 0.0f && model->input_scale[i] <= 1e6f))
            return LULL_ERROR_NETWORK;
    }
    model->output_scale = lull_tza_float(&output, 0);
    return model->output_scale >= 0.0f && model->output_scale <= 1e6f ? LULL_OK
                                                                      : LULL_ERROR_NETWORK;
}

/* E and beta of docs/kernel-prediction.md. */
static void fill_tables(lull_model *model)
{
    const float per_code = 0.0901684401f; /* log2(e) / 16 */
    for (int q = 0; q < 256; q++) {
        model->weight_table[q] =
            lull_exp2((float)((q | 15) - 255) * per_code) *
            lull_exp2((float)((q & 15) - 15) * per_code);
        model->blend_table[q] = 1.0f / (1.0f + lull_exp2((float)(128 - q) * per_code));
    }
}

/* ---- Models ---------------------------------------------------------------------------------- */

int lull_pack_is_int3(const lull_graph *graph, const lull_kernels *kernels, unsigned l)
{
    return graph->is_integer && graph->layer[l].outputs == 3 && !kernels->splits_wide;
}

/* 1 if layer l is made in pairs of pixels: two of them fit a weight block (half a one would not be
 * cheaper), rows have an even number of them, and pairs of narrow weights stay together. */
static int has_pairs(const lull_graph *graph, const lull_kernels *kernels, unsigned l)
{
    const lull_layer *layer = &graph->layer[l];
    if (!graph->is_integer || layer->op != LULL_OP_CONV || layer->level >= graph->levels ||
        2 * layer->outputs > kernels->block_int || kernels->has_halves || kernels->splits_wide ||
        lull_pack_is_int3(graph, kernels, l))
        return 0;
    for (unsigned s = 0; s < LULL_MAX_SOURCES; s++)
        if (lull_layer_inputs(graph, layer, s) % 2)
            return 0;
    return 1;
}

/* Outputs in a weight block of layer l. */
static unsigned lanes_of(const lull_graph *graph, const lull_kernels *kernels, unsigned l)
{
    if (lull_pack_is_int3(graph, kernels, l))
        return 1;
    return graph->is_integer ? kernels->block_int : kernels->block_f32;
}

/* The points of a layer's source and skip, and zeros for the bias of all points but one. */
static void layout_winograd(lull_packed_layer *packed, const lull_graph *graph, unsigned l,
                            size_t outputs, size_t *total)
{
    const lull_layer *layer = &graph->layer[l];
    packed->point_bytes = outputs * sizeof(float);
    packed->zeros = lull_append(total, packed->point_bytes);
    for (unsigned s = 0; s < 2; s++) {
        unsigned points = LULL_WINOGRAD_POINTS, channels = lull_layer_inputs(graph, layer, s);
        for (unsigned k = 0; k < LULL_WINOGRAD_POINTS; k++)
            points -= s == 0 && lull_layer_is_up(layer) && lull_winograd_vanishes(k);
        if (channels)
            packed->weights[s ? LULL_PACK_SKIP : LULL_PACK_SOURCE] =
                lull_append(total, packed->point_bytes * channels * points);
    }
}

static void pack_winograd(lull_model *model, unsigned l, const lull_layer_tensors *tensors,
                          unsigned lanes)
{
    const lull_layer *layer = &model->graph.layer[l];
    const lull_packed_layer *packed = &model->layer[l];
    uint8_t *base = (uint8_t *)model;
    unsigned inputs = lull_layer_inputs(&model->graph, layer, 0);
    unsigned skip = lull_layer_inputs(&model->graph, layer, 1);
    memset(base + packed->zeros, 0, packed->point_bytes);
    lull_pack_winograd((float *)(void *)(base + packed->weights[LULL_PACK_SOURCE]),
                       &tensors->weight, layer->outputs, inputs, 0, lanes, lull_layer_is_up(layer));
    if (skip)
        lull_pack_winograd((float *)(void *)(base + packed->weights[LULL_PACK_SKIP]),
                           &tensors->weight, layer->outputs, skip, inputs, lanes, 0);
}

/* Lays out the blocks, bias and multipliers of layer l after `total` bytes; returns the new total.
 */
static size_t layout(lull_packed_layer *packed, const lull_graph *graph,
                     const lull_kernels *kernels, unsigned l, size_t total)
{
    size_t outputs = lull_align_up(graph->layer[l].outputs, lanes_of(graph, kernels, l));
    lull_layer_tensors none;
    block b;
    memset(packed, 0, sizeof *packed);
    memset(&none, 0, sizeof none);
    if (!lull_layer_is_conv(&graph->layer[l]))
        return total;
    if (graph->layer[l].is_winograd)
        layout_winograd(packed, graph, l, outputs, &total);
    packed->has_pairs = has_pairs(graph, kernels, l);
    for (unsigned i = 0; i < LULL_PACK_BLOCKS; i++)
        if (describe_packed(&b, packed, graph, l, i, &none))
            packed->weights[i] =
                lull_append(&total, (is_split(&b, kernels) + 1) * outputs * 4 *
                                        lull_pack_length(b.dtype, run_of(&b)));
    packed->bias = lull_append(&total, outputs * 4);
    if (graph->is_integer)
        packed->multiplier = lull_append(&total, outputs * 4);
    for (unsigned s = 0; s < 2; s++)
        if (graph->layer[l].has_patches >> s & 1) {
            unsigned points = lull_patch_points(lull_layer_has_wide_patches(graph, l));
            if (s == 0 && lull_layer_has_phases(&graph->layer[l]))
                points = LULL_PATCH_WHOLE * LULL_PATCH_PHASE_POINTS;
            packed->patches[s] =
                lull_append(&total, points * outputs * sizeof(int16_t) *
                                        lull_layer_inputs(graph, &graph->layer[l], s));
        }
    return total;
}

/* Fills in layer l. */
static void pack_layer(lull_model *model, unsigned l, const lull_tza *tza)
{
    const lull_layer *layer = &model->graph.layer[l];
    lull_packed_layer *packed = &model->layer[l];
    unsigned lanes = lanes_of(&model->graph, &model->kernels, l);
    uint8_t *base = (uint8_t *)model;
    lull_layer_tensors tensors;
    block b;
    if (!lull_layer_is_conv(layer))
        return;
    lull_graph_tensors(&tensors, layer, tza);
    if (layer->is_winograd)
        pack_winograd(model, l, &tensors, lanes);
    for (unsigned s = 0; s < 2; s++) {
        int16_t *to = (int16_t *)(void *)(base + packed->patches[s]);
        int phases = s == 0 && lull_layer_has_phases(layer);
        if (layer->has_patches >> s & 1)
            for (unsigned phase = phases ? 0 : LULL_PATCH_WHOLE;
                 phase < LULL_PATCH_WHOLE + !phases; phase++)
                to = lull_pack_patches(to, taps_of(&model->graph, layer, &tensors, s),
                                       layer->outputs, lull_layer_inputs(&model->graph, layer, s),
                                       lanes, phase,
                                       lull_layer_has_wide_patches(&model->graph, l));
    }
    for (unsigned i = 0; i < LULL_PACK_BLOCKS; i++)
        if (describe_packed(&b, packed, &model->graph, l, i, &tensors)) {
            unsigned split = is_split(&b, &model->kernels) ? 2 : 0;
            uint8_t *end = write_block(base + packed->weights[i], &b, lanes, split);
            if (split)
                write_block(end, &b, lanes, 1);
        }
    for (unsigned o = 0; o < lull_align_up(layer->outputs, lanes); o++) {
        int is_there = o < (unsigned)layer->outputs << packed->has_pairs;
        unsigned at = layer->first + o % layer->outputs;
        float bias = is_there ? lull_tza_float(&tensors.bias, at) : 0.0f;
        int32_t words[2] = {0, 0};
        if (model->graph.is_integer && is_there) {
            words[0] = lull_tza_int(&tensors.bias, at);
            words[1] = (int32_t)((double)lull_tza_float(&tensors.scale, at) * 2147483648.0 + 0.5);
        }
        if (model->graph.is_integer)
            memcpy(base + packed->multiplier + 4 * (size_t)o, &words[1], 4);
        memcpy(base + packed->bias + 4 * (size_t)o,
               model->graph.is_integer ? (const void *)&words[0] : (const void *)&bias, 4);
    }
    if (tensors.shift.rank)
        packed->wide_shift = (unsigned)lull_tza_int(&tensors.shift, 0);
}

/* 1 if source `s` of a convolution of an integer model can be made in patches, which must lie the
 * same in every strip. */
LULL_NOINLINE static int fits_patches(const lull_graph *graph, const lull_layer *layer, unsigned s,
                                      const lull_tza *tza)
{
    unsigned is_up = s == 0 && lull_layer_is_up(layer);
    unsigned inputs = lull_layer_inputs(graph, layer, s);
    unsigned step = 1u << (graph->levels - layer->level), side = LULL_PATCH_SIDE << is_up;
    int is_wide = lull_graph_dtype(graph, layer->source[s]) == LULL_DTYPE_U15;
    lull_layer_tensors tensors;
    if (is_wide &&
        (layer->pool || lull_graph_max(graph, layer->source[s]) > LULL_PATCH_WIDE_MAX))
        return 0;
    if (!inputs || inputs % LULL_PATCH_CHANNELS || layer->outputs % LULL_PATCH_CHANNELS ||
        step % side)
        return 0;
    lull_graph_tensors(&tensors, layer, tza);
    return lull_pack_fits_patches(taps_of(graph, layer, &tensors, s),
                                  (is_up ? 4 : 1) * layer->outputs, (is_up ? 4 : 9) * inputs,
                                  is_wide);
}

/* Marks the sources of integer layers to pack for patches: the first if it is a layer's only one,
 * or upsampled and narrow, and the second if it is narrow. */
static void choose_patches(lull_graph *graph, const lull_kernels *kernels, const lull_tza *tza)
{
    unsigned takes = graph->family == LULL_FAMILY_U ? kernels->patches_u : kernels->patches_k;
    for (unsigned l = 0; l < graph->layers; l++) {
        lull_layer *layer = &graph->layer[l];
        int is_up = lull_layer_is_up(layer), has_skip = layer->source[1] != LULL_TENSOR_NONE;
        int is_narrow = lull_graph_dtype(graph, layer->source[0]) == LULL_DTYPE_U8, takes_source;
        if (takes == LULL_PATCHES_NONE || !graph->is_integer || layer->op != LULL_OP_CONV)
            continue;
        if (is_up)
            takes_source = is_narrow && takes >= LULL_PATCHES_UP;
        else
            takes_source = !has_skip && (!is_narrow || takes >= LULL_PATCHES_OWN);
        if (takes_source && fits_patches(graph, layer, 0, tza))
            layer->has_patches = 1;
        if (has_skip && takes >= LULL_PATCHES_OWN &&
            lull_graph_dtype(graph, layer->source[1]) == LULL_DTYPE_U8 &&
            fits_patches(graph, layer, 1, tza))
            layer->has_patches |= 2;
    }
}

/* Graph, kernels and size of the model that these weights make. */
LULL_NOINLINE static lull_status examine(lull_graph *graph, lull_kernels *kernels, size_t *bytes,
                                         const lull_tza *tza, uint32_t ports)
{
    lull_packed_layer packed;
    lull_status status = lull_graph_build(graph, tza);
    if (status != LULL_OK)
        return status;
    lull_kernels_fill(kernels, ports);
    choose_patches(graph, kernels, tza);
    *bytes = lull_align_up(sizeof(lull_model), LULL_ALIGN);
    for (unsigned l = 0; l < graph->layers; l++)
        *bytes = layout(&packed, graph, kernels, l, *bytes);
    return LULL_OK;
}

/* Bytes of a model; 0 if its file is not a network's. On a stack of its own beside the graph. */
LULL_NOINLINE static size_t size_of(lull_graph *graph, const lull_tza *tza, uint32_t ports)
{
    lull_kernels kernels;
    size_t bytes;
    return examine(graph, &kernels, &bytes, tza, ports) == LULL_OK ? bytes : 0;
}

/* What is wrong with the weights of a network; MEMORY if nothing is. */
LULL_NOINLINE static lull_status find_fault(const lull_tza *tza)
{
    lull_graph graph;
    lull_status status = lull_graph_build(&graph, tza);
    return status == LULL_OK ? LULL_ERROR_MEMORY : status;
}

size_t lull_model_size(const void *tza_bytes, size_t size, uint32_t ports)
{
    lull_tza tza;
    lull_graph graph;
    if (!tza_bytes || lull_tza_open(&tza, tza_bytes, size) != LULL_OK)
        return 0;
    return size_of(&graph, &tza, ports);
}

lull_status lull_model_init(lull_model **model, void *memory, size_t memory_bytes,
                            const void *tza_bytes, size_t size, uint32_t ports)
{
    lull_tza tza;
    lull_model *made = memory;
    size_t total = lull_align_up(sizeof *made, LULL_ALIGN);
    lull_status status;
    if (!model || !tza_bytes ||
        (memory_bytes >= sizeof *made && (!memory || (uintptr_t)memory % LULL_ALIGN)))
        return LULL_ERROR_ARGUMENT;
    status = lull_tza_open(&tza, tza_bytes, size);
    if (status != LULL_OK)
        return status;
    if (memory_bytes < sizeof *made) /* says why lull_model_size is 0, whatever the memory */
        return find_fault(&tza);
    memset(made, 0, sizeof *made);
    status = examine(&made->graph, &made->kernels, &made->bytes, &tza, ports);
    if (status == LULL_OK)
        status = read_scales(made, &tza);
    if (status == LULL_OK && memory_bytes < made->bytes)
        status = LULL_ERROR_MEMORY;
    for (unsigned l = 0; status == LULL_OK && l < made->graph.layers; l++) {
        total = layout(&made->layer[l], &made->graph, &made->kernels, l, total);
        if (made->graph.is_integer)
            status = check_integer(&made->layer[l], &made->graph, &made->kernels, l, &tza);
        if (status == LULL_OK)
            pack_layer(made, l, &tza);
    }
    fill_tables(made);
    if (status == LULL_OK)
        *model = made;
    return status;
}

void lull_model_get_info(const lull_model *model, lull_model_info *info)
{
    const lull_graph *graph = &model->graph;
    info->network = graph->network;
    info->inputs = graph->inputs;
    info->is_integer = (unsigned)graph->is_integer;
    info->alignment = 1u << graph->levels;
    info->overlap = graph->overlap;
    info->macs_per_pixel = lull_graph_macs_per_pixel(graph);
    info->is_alone = (unsigned)graph->is_alone;
    info->parameters = 0;
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        unsigned inputs = lull_layer_all_inputs(graph, layer);
        if (lull_layer_is_conv(layer))
            info->parameters +=
                lull_layer_own_outputs(layer) *
                ((layer->op == LULL_OP_HEAD ? 1u : 9u) * (uint64_t)inputs + 1);
    }
}
