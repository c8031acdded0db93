#include "graph.h"

#include "bilateral.h"
#include "patches.h"
#include "winograd.h"

typedef struct net_row {
    const char *name, *key;
    lull_family family;
} net_row;

typedef struct layer_row {
    const char *net, *name, *source;
    uint8_t up;
    const char *skip;
    uint8_t pool;
} layer_row;

typedef struct head_row {
    const char *net, *name, *source;
    uint8_t level;
} head_row;

static const net_row nets[] = {
#define NET(net, family, key) {#net, #key, LULL_FAMILY_##family},
#include "nets.def"
};

static const layer_row rows[] = {
#define LAYER(net, layer, source, up, skip, pool) {#net, #layer, #source, up, #skip, pool},
#include "nets.def"
};

static const head_row heads[] = {
#define HEAD(net, head, source, level) {#net, #head, #source, level},
#include "nets.def"
};

#define COUNT(array) (sizeof(array) / sizeof(array)[0])
#define K_LEVELS 5u
#define K_INPUTS 12u
#define MAIN_CHANNELS 3u
#define NONE LULL_TENSOR_NONE

/* What layers of family K's filter make of each pixel, and how they read their sources. */
static const struct filter_row {
    uint16_t outputs;
    uint8_t reads[LULL_MAX_SOURCES];
} filters[LULL_OPS] = {
    [LULL_OP_SMOOTH] = {3, {LULL_READS_5, LULL_READS_ROW, LULL_READS_EIGHTH}},
    [LULL_OP_DEMODULATE] = {4, {LULL_READS_ROW, LULL_READS_ROW, LULL_READS_ROW}},
    [LULL_OP_POOL] = {4, {LULL_READS_FINE, LULL_READS_ROW}},
    [LULL_OP_FILTER] = {3, {LULL_READS_5, LULL_READS_ROW}},
    [LULL_OP_BLEND] = {3, {LULL_READS_ROW, LULL_READS_COARSE}},
    [LULL_OP_BILATERAL] = {3, {LULL_READS_5, LULL_READS_5}},
    [LULL_OP_FACE] = {3, {LULL_READS_5, LULL_READS_ROW}},
    [LULL_OP_FIT_SUMS] = {LULL_FIT_SUMS, {LULL_READS_8, LULL_READS_8, LULL_READS_8, LULL_READS_8}},
    [LULL_OP_FIT] = {LULL_FIT_COEFFICIENTS, {LULL_READS_3}},
    [LULL_OP_REGRESS] = {3, {LULL_READS_ROW, LULL_READS_ROW, LULL_READS_ROW, LULL_READS_EIGHTH}},
    [LULL_OP_RESIDUAL] = {LULL_CELL_SUMS, {LULL_READS_CELL, LULL_READS_CELL}},
    [LULL_OP_GAINS] = {1, {LULL_READS_6}},
    [LULL_OP_CORRECT] = {3, {LULL_READS_ROW, LULL_READS_16TH}},
    [LULL_OP_GRAIN_SUMS] = {LULL_GRAIN_ALL_SUMS, {LULL_READS_8}},
    [LULL_OP_GRAIN] = {LULL_GRAINY * LULL_GRAIN_VALUES, {LULL_READS_3}},
    [LULL_OP_ENCODE] = {K_INPUTS, {LULL_READS_ROW, LULL_READS_ROW, LULL_READS_EIGHTH}},
};

static int same(const char *a, const char *b)
{
    while (*a && *a == *b)
        a++, b++;
    return *a == *b;
}

const char *lull_layer_name(const lull_layer *layer)
{
    if (layer->op == LULL_OP_CONV)
        return rows[layer->row].name;
    return layer->op == LULL_OP_HEAD ? heads[layer->row].name : "";
}

int lull_layer_is_conv(const lull_layer *layer)
{
    return layer->op == LULL_OP_CONV || layer->op == LULL_OP_HEAD;
}

int lull_layer_is_up(const lull_layer *layer)
{
    return layer->op == LULL_OP_CONV && layer->reads[0] == LULL_READS_COARSE;
}

int lull_layer_has_phases(const lull_layer *layer)
{
    return layer->has_patches & 1 && lull_layer_is_up(layer);
}

int lull_layer_has_wide_patches(const lull_graph *graph, unsigned l)
{
    const lull_layer *layer = &graph->layer[l];
    return layer->has_patches == 1 && lull_graph_dtype(graph, layer->source[0]) == LULL_DTYPE_U15;
}

/* Number of the tensor called `name` among those made so far; NONE if there is none. */
static uint8_t tensor_called(const lull_graph *graph, const char *name)
{
    if (same(name, "input"))
        return graph->input;
    for (unsigned i = 0; i < graph->layers; i++)
        if (same(lull_layer_name(&graph->layer[i]), name))
            return (uint8_t)(i + 1);
    return NONE;
}

/* Tensor made by the layer of this op and level among those from number `first` on;
 * NONE if there is none. */
static unsigned find_from(const lull_graph *graph, unsigned first, lull_op op, unsigned level)
{
    for (unsigned i = first; i < graph->layers; i++)
        if (graph->layer[i].op == op && graph->layer[i].level == level)
            return i + 1;
    return NONE;
}

unsigned lull_graph_channels(const lull_graph *graph, unsigned tensor)
{
    if (tensor == LULL_TENSOR_RADIANCE)
        return 3;
    if (tensor == LULL_TENSOR_GUIDE)
        return graph->family == LULL_FAMILY_K ? 2 : graph->aux;
    if (tensor == LULL_TENSOR_ALBEDO || tensor == LULL_TENSOR_NORMAL)
        return 4;
    return tensor == LULL_TENSOR_INPUT ? graph->inputs - graph->aux
                                       : graph->layer[tensor - 1].outputs;
}

unsigned lull_graph_level(const lull_graph *graph, unsigned tensor)
{
    if (tensor == LULL_TENSOR_INPUT || tensor > LULL_MAX_LAYERS)
        return 0;
    return (unsigned)graph->layer[tensor - 1].level + graph->layer[tensor - 1].pool;
}

unsigned lull_graph_max(const lull_graph *graph, unsigned tensor)
{
    if (graph->family == LULL_FAMILY_K || tensor == LULL_TENSOR_AUX)
        return 255;
    return (1u << (tensor == LULL_TENSOR_INPUT ? 15 : graph->layer[tensor - 1].bits)) - 1;
}

lull_dtype lull_graph_dtype(const lull_graph *graph, unsigned tensor)
{
    if (tensor == LULL_TENSOR_GUIDE)
        return LULL_DTYPE_U8;
    if (!graph->is_integer || tensor > LULL_MAX_LAYERS)
        return LULL_DTYPE_F32;
    if (graph->family == LULL_FAMILY_K)
        return tensor == LULL_TENSOR_INPUT || lull_layer_makes_codes(&graph->layer[tensor - 1])
                   ? LULL_DTYPE_U8
                   : LULL_DTYPE_F32;
    return lull_graph_max(graph, tensor) > 255 ? LULL_DTYPE_U15 : LULL_DTYPE_U8;
}

unsigned lull_layer_inputs(const lull_graph *graph, const lull_layer *layer, unsigned index)
{
    return layer->source[index] == NONE || (layer->op == LULL_OP_HEAD && index > 0)
               ? 0
               : lull_graph_channels(graph, layer->source[index]);
}

unsigned lull_layer_all_inputs(const lull_graph *graph, const lull_layer *layer)
{
    unsigned inputs = 0;
    for (unsigned s = 0; s < LULL_MAX_SOURCES; s++)
        inputs += lull_layer_inputs(graph, layer, s);
    return inputs;
}

void lull_graph_tensors(lull_layer_tensors *tensors, const lull_layer *layer, const lull_tza *tza)
{
    const char *name = lull_layer_name(layer);
    memset(tensors, 0, sizeof *tensors);
    lull_tza_find(tza, name, ".weight", &tensors->weight);
    lull_tza_find(tza, name, ".skip.weight", &tensors->skip);
    lull_tza_find(tza, name, ".bias", &tensors->bias);
    lull_tza_find(tza, name, ".scale", &tensors->scale);
    lull_tza_find(tza, name, ".shift", &tensors->shift);
    lull_tza_find(tza, name, ".max", &tensors->max);
}

static int has_shape(const lull_tza_tensor *tensor, char dtype, uint32_t o, uint32_t i,
                     uint32_t side)
{
    return tensor->dtype == dtype && tensor->dims[0] == o &&
           (side == 0 ? tensor->rank == 1
                      : tensor->rank == 4 && tensor->dims[1] == i && tensor->dims[2] == side &&
                            tensor->dims[3] == side);
}

/* Channels that the weights of a layer's source `index` meet: the input's with the auxiliary ones.
 */
static uint32_t met_channels(const lull_graph *graph, const lull_layer *layer, unsigned index)
{
    return layer->source[index] == LULL_TENSOR_INPUT ? graph->inputs
                                                     : lull_layer_inputs(graph, layer, index);
}

/* 1 if the layer's tensors are what its channels demand. */
static int shapes_fit(const lull_graph *graph, const lull_layer *layer, const lull_layer_tensors *t)
{
    uint32_t outputs = layer->outputs, inputs = met_channels(graph, layer, 0);
    uint32_t skip = met_channels(graph, layer, 1);
    uint32_t side = layer->op == LULL_OP_HEAD ? 1 : lull_layer_is_up(layer) ? 2 : 3;
    char dtype = t->weight.dtype;
    if (!graph->is_integer)
        return (dtype == 'h' || dtype == 'f') && (t->bias.dtype == 'h' || t->bias.dtype == 'f') &&
               has_shape(&t->weight, dtype, outputs, inputs + skip, 3) &&
               has_shape(&t->bias, t->bias.dtype, outputs, 0, 0);
    return has_shape(&t->weight, 'b', side == 2 ? 4 * outputs : outputs, inputs, side) &&
           (!skip || has_shape(&t->skip, 'b', outputs, skip, 3)) &&
           has_shape(&t->bias, 'i', outputs, 0, 0) && has_shape(&t->scale, 'f', outputs, 0, 0) &&
           (t->shift.rank == 0 || has_shape(&t->shift, 'i', 1, 0, 0));
}

/* Room for one more layer, without sources; NULL if there is none. */
static lull_layer *new_layer(lull_graph *graph, lull_op op, unsigned level, unsigned outputs)
{
    lull_layer *layer = &graph->layer[graph->layers];
    if (graph->layers == LULL_MAX_LAYERS)
        return NULL;
    memset(layer, 0, sizeof *layer);
    memset(layer->source, NONE, sizeof layer->source);
    layer->op = (uint8_t)op;
    layer->level = (uint8_t)level;
    layer->outputs = (uint16_t)outputs;
    return layer;
}

static void add_source(lull_layer *layer, unsigned tensor, lull_reads reads)
{
    unsigned i = 0;
    while (layer->source[i] != NONE)
        i++;
    layer->source[i] = (uint8_t)tensor;
    layer->reads[i] = (uint8_t)reads;
}

/* Integer models of family U: how many of the input's channels, all but the main image's, are
 * narrow. */
static lull_status read_aux(lull_graph *graph, const lull_tza *tza)
{
    lull_tza_tensor max;
    if (graph->family != LULL_FAMILY_U || !graph->is_integer ||
        !lull_tza_find(tza, "input", ".max", &max))
        return LULL_OK;
    if (!has_shape(&max, 'i', graph->inputs, 0, 0))
        return LULL_ERROR_NETWORK;
    for (unsigned i = 0; i < graph->inputs; i++)
        if (lull_tza_int(&max, i) != (i < MAIN_CHANNELS ? 32767 : 255))
            return LULL_ERROR_NETWORK;
    graph->aux = graph->inputs - lull_min_u(graph->inputs, MAIN_CHANNELS);
    return LULL_OK;
}

/* Completes a convolution: its channels are the shapes of its tensors. */
static lull_status read_shapes(lull_graph *graph, lull_layer *layer, const lull_tza *tza)
{
    lull_layer_tensors tensors;
    uint32_t outputs;
    lull_graph_tensors(&tensors, layer, tza);
    outputs = tensors.bias.rank == 1 ? tensors.bias.dims[0] : 0;
    if (!outputs || outputs > LULL_MAX_CHANNELS || tensors.weight.rank != 4)
        return LULL_ERROR_NETWORK;
    layer->outputs = (uint16_t)outputs;
    if (!graph->inputs) {
        graph->is_integer = tensors.weight.dtype == 'b';
        graph->inputs = tensors.weight.dims[1];
        if (read_aux(graph, tza) != LULL_OK)
            return LULL_ERROR_NETWORK;
    }
    if (!shapes_fit(graph, layer, &tensors))
        return LULL_ERROR_NETWORK;
    graph->levels = lull_max_u(graph->levels, (unsigned)layer->level + layer->pool);
    graph->layers++;
    return LULL_OK;
}

static lull_status add_layer(lull_graph *graph, const layer_row *row, const lull_tza *tza)
{
    lull_layer *layer = new_layer(graph, LULL_OP_CONV, 0, 0);
    unsigned source = tensor_called(graph, row->source), up = row->up == 2;
    lull_status status;
    if (!layer)
        return LULL_ERROR_NETWORK;
    layer->row = (uint8_t)(row - rows);
    layer->level = (uint8_t)(lull_graph_level(graph, source) - up);
    layer->pool = row->pool == 2;
    add_source(layer, source, up ? LULL_READS_COARSE : LULL_READS_3);
    if (!same(row->skip, "none"))
        add_source(layer, tensor_called(graph, row->skip), LULL_READS_3);
    status = read_shapes(graph, layer, tza);
    if (status == LULL_OK && graph->aux &&
        (layer->source[0] == LULL_TENSOR_INPUT || layer->source[1] == LULL_TENSOR_INPUT))
        add_source(layer, LULL_TENSOR_AUX, LULL_READS_3);
    return status;
}

static lull_status add_head(lull_graph *graph, const head_row *row, const lull_tza *tza)
{
    lull_layer *layer = new_layer(graph, LULL_OP_HEAD, row->level, 0);
    lull_status status;
    if (!layer)
        return LULL_ERROR_NETWORK;
    layer->row = (uint8_t)(row - heads);
    add_source(layer, tensor_called(graph, row->source), LULL_READS_ROW);
    status = read_shapes(graph, layer, tza);
    if (status == LULL_OK && layer->outputs != (row->level ? 27 : 52))
        status = LULL_ERROR_NETWORK;
    if (row->level == 0) { /* the filter's part of it: add_filters */
        layer->first = LULL_HEAD0_SPLIT;
        layer->outputs = (uint16_t)(layer->outputs - LULL_HEAD0_SPLIT);
    }
    return status;
}

/* Appends a layer of the filter, of the sources a to d or, before the first NONE, fewer. Returns
 * its tensor. */
static unsigned add_filter(lull_graph *graph, lull_op op, unsigned level, unsigned a, unsigned b,
                           unsigned c, unsigned d)
{
    const unsigned sources[LULL_MAX_SOURCES] = {a, b, c, d};
    lull_layer *layer = new_layer(graph, op, level, filters[op].outputs);
    if (!layer)
        return NONE;
    for (unsigned i = 0; i < LULL_MAX_SOURCES && sources[i] != NONE; i++)
        add_source(layer, sources[i], (lull_reads)filters[op].reads[i]);
    return ++graph->layers;
}

/* The second part of level 0's head, of radiance `v`: filter and blend logits. Returns its tensor.
 */
static unsigned add_second_head(lull_graph *graph, unsigned head, unsigned v)
{
    const lull_layer *first = &graph->layer[head - 1];
    lull_layer *layer = new_layer(graph, LULL_OP_HEAD, 0, LULL_HEAD0_SPLIT + 2);
    if (!layer)
        return NONE;
    layer->row = first->row;
    add_source(layer, first->source[0], LULL_READS_ROW);
    add_source(layer, v, LULL_READS_5);
    return ++graph->layers;
}

/* Values of the tensor bilateral.scale, and 0 where there is none. */
enum { NO_STEPS, SMOOTH_AND_CORRECT, SMOOTH, ALL_STEPS, ALONE, CLEAN_AND_SMOOTH };

/* That of a file; NETWORK if it is none. */
static lull_status read_steps(int *steps, const lull_tza *tza)
{
    lull_tza_tensor tensor;
    float value;
    *steps = NO_STEPS;
    if (!lull_tza_find(tza, "bilateral", ".scale", &tensor))
        return LULL_OK;
    value = has_shape(&tensor, 'f', 1, 0, 0) ? lull_tza_float(&tensor, 0) : 0.0f;
    while (*steps < CLEAN_AND_SMOOTH && value != (float)*steps)
        ++*steps;
    return *steps != NO_STEPS && value == (float)*steps ? LULL_OK : LULL_ERROR_NETWORK;
}

/* The filter of family K, docs/kernel-prediction.md; the last steps for files that ask for them. */
static lull_status add_filters(lull_graph *graph, int steps)
{
    const unsigned grain = find_from(graph, 0, LULL_OP_GRAIN, LULL_GRAIN_LEVEL);
    const int has_fit = steps == ALL_STEPS, has_residual = has_fit || steps == SMOOTH_AND_CORRECT;
    unsigned head[K_LEVELS], filtered[K_LEVELS], v, even, facing = NONE, result;
    for (unsigned s = 0; s < K_LEVELS; s++) {
        head[s] = find_from(graph, 0, LULL_OP_HEAD, s);
        if (head[s] == NONE)
            return LULL_ERROR_NETWORK;
    }
    if (!graph->is_integer || graph->inputs != K_INPUTS || graph->levels != K_LEVELS - 1)
        return LULL_ERROR_NETWORK;
    even = add_filter(graph, LULL_OP_SMOOTH, 0, LULL_TENSOR_ALBEDO, head[0], grain, NONE);
    if (has_fit)
        facing = add_filter(graph, LULL_OP_FACE, 0, LULL_TENSOR_NORMAL, head[0], NONE, NONE);
    v = add_filter(graph, LULL_OP_DEMODULATE, 0, LULL_TENSOR_RADIANCE, even, head[0], NONE);
    head[0] = add_second_head(graph, head[0], v);
    for (unsigned s = 0; s < K_LEVELS; s++) {
        if (s > 0)
            v = add_filter(graph, LULL_OP_POOL, s, v, head[s], NONE, NONE);
        filtered[s] = add_filter(graph, LULL_OP_FILTER, s, v, head[s], NONE, NONE);
    }
    result = filtered[K_LEVELS - 1];
    for (unsigned s = K_LEVELS - 1; s-- > 0;)
        result = add_filter(graph, LULL_OP_BLEND, s, filtered[s], result, NONE, NONE);
    if (steps != NO_STEPS && steps != ALONE)
        result = add_filter(graph, LULL_OP_BILATERAL, 0, result, LULL_TENSOR_GUIDE, NONE, NONE);
    if (has_residual && result != NONE) /* looks far */
        memset(graph->layer[result - 1].reads, LULL_READS_25, 2);
    if (has_fit) {
        v = add_filter(graph, LULL_OP_FIT_SUMS, LULL_FIT_LEVEL, result, even, facing,
                       LULL_TENSOR_RADIANCE);
        v = add_filter(graph, LULL_OP_FIT, LULL_FIT_LEVEL, v, NONE, NONE, NONE);
        result = add_filter(graph, LULL_OP_REGRESS, 0, result, even, facing, v);
    }
    if (has_residual) {
        v = add_filter(graph, LULL_OP_RESIDUAL, LULL_CELL_LEVEL, result, LULL_TENSOR_RADIANCE, NONE,
                       NONE);
        v = add_filter(graph, LULL_OP_GAINS, LULL_CELL_LEVEL, v, NONE, NONE, NONE);
        result = add_filter(graph, LULL_OP_CORRECT, 0, result, v, NONE, NONE);
    }
    return result == NONE ? LULL_ERROR_NETWORK : LULL_OK;
}

/* fp32 convolutions take Winograd's form where patches lie the same in every strip: strips begin at
 * multiples of 1 << levels pixels. */
static void choose_forms(lull_graph *graph)
{
    for (unsigned i = 0; i < graph->layers; i++) {
        lull_layer *layer = &graph->layer[i];
        unsigned step = 1u << (graph->levels - layer->level);
        layer->is_winograd =
            layer->op == LULL_OP_CONV && !graph->is_integer && step % LULL_WINOGRAD_COLUMNS == 0;
    }
}

/* How far the output looks, rounded up to the alignment. A kernel of radius r at level l adds r *
 * 2^l pixels a side; pooling and upsampling move its grid by up to 2^l - 1. To the bit (is_exact),
 * all pixels of a patch depend on all that its points are made of. */
static unsigned reach(const lull_graph *graph, int is_exact)
{
    static const uint8_t radius[] = {0, 1, 2, LULL_BILATERAL_FAR, LULL_CELLS_BESIDE, 1,
                                     0, 0, LULL_GAIN_REACH, 0, LULL_FIT_REACH};
    unsigned field = 0, noise = 0, align = 1u << graph->levels;
    for (unsigned i = 0; i < graph->layers; i++) {
        const lull_layer *layer = &graph->layer[i];
        unsigned most = 0;
        for (unsigned s = 0; s < LULL_MAX_SOURCES && layer->source[s] != NONE; s++)
            if ((layer->op != LULL_OP_HEAD && layer->op != LULL_OP_SMOOTH) || s == 0)
                most = lull_max_u(most, radius[layer->reads[s]]);
        if (is_exact && layer->is_winograd)
            most = LULL_WINOGRAD_COLUMNS;
        if (layer->op == LULL_OP_BILATERAL)
            most = (unsigned)lull_bilateral_reach(lull_graph_is_far(layer));
        field += most << layer->level;
        if (layer->op == LULL_OP_FILTER && layer->level == 0)
            noise = field + LULL_MIX_REACH;
    }
    if (lull_graph_mixed_by(graph) != NONE)
        field = lull_max_u(field + LULL_EDGE_REACH, noise);
    field += align - 1; /* phase of the pixel inside its coarsest cell */
    return (unsigned)lull_align_up(field, align);
}

/* Family U: the outputs' largest codes. Wide are those of the last layer and its source, unless the
 * file says otherwise, and those that it names. */
static lull_status read_maxima(lull_graph *graph, const lull_tza *tza)
{
    unsigned last = graph->layers;
    for (unsigned i = 0; i < last; i++) {
        lull_layer *layer = &graph->layer[i];
        lull_layer_tensors tensors;
        int32_t max = i + 1 == last || i + 1 == graph->layer[last - 1].source[0] ? 32767 : 255;
        lull_graph_tensors(&tensors, layer, tza);
        if (tensors.max.rank && !has_shape(&tensors.max, 'i', 1, 0, 0))
            return LULL_ERROR_NETWORK;
        if (tensors.max.rank)
            max = lull_tza_int(&tensors.max, 0);
        if (max != 255 && ((max != LULL_PATCH_WIDE_MAX && max != 32767) || layer->pool))
            return LULL_ERROR_NETWORK;
        layer->bits = max == 255 ? 8 : max == LULL_PATCH_WIDE_MAX ? 13 : 15;
    }
    return LULL_OK;
}

/* The layers and heads of a net. */
static lull_status add_net(lull_graph *graph, const net_row *net, const lull_tza *tza)
{
    lull_status status = LULL_OK;
    for (size_t i = 0; i < COUNT(rows) && status == LULL_OK; i++)
        if (same(rows[i].net, net->name))
            status = add_layer(graph, &rows[i], tza);
    for (size_t i = 0; i < COUNT(heads) && status == LULL_OK; i++)
        if (same(heads[i].net, net->name))
            status = add_head(graph, &heads[i], tza);
    return status;
}

/* What takes grain out of albedo and normals; the input of the network that follows. */
static void add_grain(lull_graph *graph)
{
    unsigned v = add_filter(graph, LULL_OP_GRAIN_SUMS, LULL_GRAIN_LEVEL, LULL_TENSOR_INPUT, NONE,
                            NONE, NONE);
    v = add_filter(graph, LULL_OP_GRAIN, LULL_GRAIN_LEVEL, v, NONE, NONE, NONE);
    graph->inputs = K_INPUTS;
    graph->is_integer = 1;
    graph->input = (uint8_t)add_filter(graph, LULL_OP_ENCODE, 0, LULL_TENSOR_INPUT,
                                       LULL_TENSOR_RADIANCE, v, NONE);
    graph->before = graph->layers;
}

/* The first net whose tensors the file has; NULL if there is none. */
static const net_row *find_net(const lull_tza *tza)
{
    lull_tza_tensor tensor;
    for (size_t n = 0; n < COUNT(nets); n++)
        if (lull_tza_find(tza, nets[n].key, ".weight", &tensor))
            return &nets[n];
    return NULL;
}

lull_status lull_graph_build(lull_graph *graph, const lull_tza *tza)
{
    const net_row *net = find_net(tza);
    int steps = NO_STEPS;
    lull_status status = LULL_OK;
    if (!net)
        return LULL_ERROR_NETWORK;
    memset(graph, 0, sizeof *graph);
    graph->network = net->name;
    graph->family = net->family;
    if (net->family == LULL_FAMILY_K)
        status = read_steps(&steps, tza);
    graph->is_alone = steps == ALONE;
    if (steps == ALL_STEPS || steps == CLEAN_AND_SMOOTH)
        add_grain(graph);
    if (status == LULL_OK)
        status = add_net(graph, net, tza);
    if (status == LULL_OK && graph->family == LULL_FAMILY_K)
        status = add_filters(graph, steps);
    if (status == LULL_OK && graph->family == LULL_FAMILY_U && graph->is_integer)
        status = read_maxima(graph, tza);
    if (status != LULL_OK)
        return status;
    for (unsigned op = 0; op < LULL_OPS; op++)
        graph->made_by[op] = (uint8_t)find_from(graph, 0, (lull_op)op, 0);
    choose_forms(graph);
    graph->overlap = reach(graph, 0);
    graph->margin = reach(graph, 1);
    if (graph->family == LULL_FAMILY_U &&
        (graph->layer[graph->layers - 1].outputs < 3 || graph->inputs > 9 || graph->inputs % 3))
        return LULL_ERROR_NETWORK;
    return LULL_OK;
}
