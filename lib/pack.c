#include "pack.h"

/* Kernel taps that fall together when a 3x3 kernel is applied to a source upsampled by 2: for output
 * phase p and row (or column) a of the 2x2 kernel on the small source, taps first..last. */
static const struct {
    uint8_t first, last;
} folded[2][2] = {{{0, 0}, {1, 2}}, {{0, 1}, {2, 2}}};

/* One weight block being written: all outputs of one row of one source. */
typedef struct block {
    const lull_tza_tensor *weight;
    unsigned outputs, inputs, offset; /* channels of the source, and its first one in the tensor */
    unsigned columns;                 /* 3, or 2 if folded */
    unsigned phase_x;
    unsigned first_row, last_row; /* taps summed */
} block;

/* Weight of output o for column `column` and channel i of a block. */
static float tap(const block *b, unsigned o, unsigned column, unsigned i)
{
    unsigned first = column, last = column;
    size_t base = ((size_t)o * b->weight->dims[1] + b->offset + i) * 9;
    float sum = 0;
    if (b->columns == 2) {
        first = folded[b->phase_x][column].first;
        last = folded[b->phase_x][column].last;
    }
    for (unsigned y = b->first_row; y <= b->last_row; y++)
        for (unsigned x = first; x <= last; x++)
            sum += lull_tza_float(b->weight, base + y * 3 + x);
    return sum;
}

static void write_f32(float *out, const block *b, unsigned lanes)
{
    for (unsigned first = 0; first < b->outputs; first += lanes)
        for (unsigned column = 0; column < b->columns; column++)
            for (unsigned i = 0; i < b->inputs; i++)
                for (unsigned o = first; o < first + lanes; o++)
                    *out++ = o < b->outputs ? tap(b, o, column, i) : 0.0f;
}

unsigned lull_pack_block(const lull_layer *layer, unsigned phase, unsigned row)
{
    return LULL_PACK_SOURCE + (layer->up ? 2 * phase + row : row);
}

/* Describes block number `index` of a layer; returns 0 if the layer has no such block. */
static int describe(block *b, const lull_layer *layer, unsigned index)
{
    b->outputs = layer->outputs;
    b->columns = 3;
    b->phase_x = 0;
    if (index >= LULL_PACK_SKIP) {
        b->inputs = layer->in_skip;
        b->offset = layer->in_source;
        b->first_row = b->last_row = index - LULL_PACK_SKIP;
        return layer->in_skip != 0;
    }
    b->inputs = layer->in_source;
    b->offset = 0;
    if (!layer->up) {
        b->first_row = b->last_row = index;
        return index < 3;
    }
    b->columns = 2;
    b->phase_x = index / 2 & 1;
    b->first_row = folded[index / 4][index & 1].first;
    b->last_row = folded[index / 4][index & 1].last;
    return 1;
}

/* Lays out one layer's blocks and bias after `total` bytes of the model; returns the new total. */
static size_t layout(lull_packed_layer *packed, const lull_layer *layer, unsigned lanes, size_t total)
{
    size_t outputs = lull_align_up(layer->outputs, lanes);
    memset(packed, 0, sizeof *packed);
    for (unsigned i = 0; i < LULL_PACK_BLOCKS; i++) {
        block b;
        if (describe(&b, layer, i))
            packed->weights[i] = lull_append(&total, outputs * b.columns * b.inputs * sizeof(float));
    }
    packed->bias = lull_append(&total, outputs * sizeof(float));
    return total;
}

/* Fills in one layer's blocks and bias. */
static void pack_layer(lull_model *model, unsigned l, const lull_tza *tza)
{
    const lull_layer *layer = &model->graph.layer[l];
    const lull_packed_layer *packed = &model->layer[l];
    const char *name = lull_layer_name(layer);
    unsigned lanes = model->kernels.block_f32;
    uint8_t *base = (uint8_t *)model;
    lull_tza_tensor weight, bias;
    float *padded_bias = (float *)(void *)(base + packed->bias);
    block b;
    lull_tza_find(tza, name, ".weight", &weight);
    lull_tza_find(tza, name, ".bias", &bias);
    b.weight = &weight;
    for (unsigned i = 0; i < LULL_PACK_BLOCKS; i++)
        if (describe(&b, layer, i))
            write_f32((float *)(void *)(base + packed->weights[i]), &b, lanes);
    for (unsigned o = 0; o < lull_align_up(layer->outputs, lanes); o++)
        padded_bias[o] = o < layer->outputs ? lull_tza_float(&bias, o) : 0.0f;
}

/* 1 if all weights are of types that fp32 arithmetic takes. */
static int is_float(const lull_graph *graph, const lull_tza *tza)
{
    for (unsigned l = 0; l < graph->layers; l++) {
        lull_tza_tensor weight;
        lull_tza_find(tza, lull_layer_name(&graph->layer[l]), ".weight", &weight);
        if (weight.dtype != 'h' && weight.dtype != 'f')
            return 0;
    }
    return 1;
}

/* Graph, kernels and size of the model that these weights make. */
static lull_status examine(lull_graph *graph, lull_kernels *kernels, size_t *bytes,
                           const lull_tza *tza, uint32_t ports)
{
    lull_packed_layer packed;
    lull_status status = lull_graph_build(graph, tza);
    if (status != LULL_OK)
        return status;
    if (!is_float(graph, tza))
        return LULL_ERROR_NETWORK;
    lull_kernels_fill(kernels, ports);
    *bytes = lull_align_up(sizeof(lull_model), LULL_ALIGN);
    for (unsigned l = 0; l < graph->layers; l++)
        *bytes = layout(&packed, &graph->layer[l], kernels->block_f32, *bytes);
    return LULL_OK;
}

size_t lull_model_size(const void *tza_bytes, size_t size, uint32_t ports)
{
    lull_tza tza;
    lull_graph graph;
    lull_kernels kernels;
    size_t bytes;
    if (!tza_bytes || lull_tza_open(&tza, tza_bytes, size) != LULL_OK)
        return 0;
    return examine(&graph, &kernels, &bytes, &tza, ports) == LULL_OK ? bytes : 0;
}

lull_status lull_model_init(lull_model **model, void *memory, size_t memory_bytes,
                            const void *tza_bytes, size_t size, uint32_t ports)
{
    lull_tza tza;
    lull_model *made = memory;
    size_t total = lull_align_up(sizeof *made, LULL_ALIGN);
    lull_status status;
    if (!model || !memory || (uintptr_t)memory % LULL_ALIGN || !tza_bytes)
        return LULL_ERROR_ARGUMENT;
    status = lull_tza_open(&tza, tza_bytes, size);
    if (status != LULL_OK)
        return status;
    if (memory_bytes < sizeof *made)
        return LULL_ERROR_MEMORY;
    status = examine(&made->graph, &made->kernels, &made->bytes, &tza, ports);
    if (status != LULL_OK)
        return status;
    if (memory_bytes < made->bytes)
        return LULL_ERROR_MEMORY;
    made->is_integer = 0;
    for (unsigned l = 0; l < made->graph.layers; l++) {
        total = layout(&made->layer[l], &made->graph.layer[l], made->kernels.block_f32, total);
        pack_layer(made, l, &tza);
    }
    *model = made;
    return LULL_OK;
}

void lull_model_get_info(const lull_model *model, lull_model_info *info)
{
    const lull_graph *graph = &model->graph;
    info->network = graph->network;
    info->inputs = graph->inputs;
    info->is_integer = (unsigned)model->is_integer;
    info->alignment = 1u << graph->levels;
    info->overlap = graph->overlap;
    info->macs_per_pixel = lull_graph_macs_per_pixel(graph);
    info->parameters = 0;
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        info->parameters += layer->outputs * (9u * (uint64_t)(layer->in_source + layer->in_skip) + 1);
    }
}
