#include "graph.h"

typedef struct net_row {
    const char *name, *key;
} net_row;

typedef struct layer_row {
    const char *net, *name, *source;
    uint8_t up;
    const char *skip;
    uint8_t pool;
} layer_row;

static const net_row nets[] = {
#define NET(net, family, key) {#net, #key},
#include "nets.def"
};

static const layer_row rows[] = {
#define LAYER(net, layer, source, up, skip, pool) {#net, #layer, #source, up, #skip, pool},
#include "nets.def"
};

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

const char *lull_layer_name(const lull_layer *layer) { return rows[layer->row].name; }

static int same(const char *a, const char *b)
{
    while (*a && *a == *b)
        a++, b++;
    return *a == *b;
}

/* Number of the tensor called `name` among those made so far; LULL_TENSOR_NONE if there is none. */
static uint8_t tensor_called(const lull_graph *graph, const char *name)
{
    if (same(name, "input"))
        return LULL_TENSOR_INPUT;
    for (unsigned i = 0; i < graph->layers; i++)
        if (same(lull_layer_name(&graph->layer[i]), name))
            return (uint8_t)(i + 1);
    return LULL_TENSOR_NONE;
}

unsigned lull_graph_channels(const lull_graph *graph, unsigned tensor)
{
    return tensor == LULL_TENSOR_INPUT ? graph->inputs : graph->layer[tensor - 1].outputs;
}

unsigned lull_graph_level(const lull_graph *graph, unsigned tensor)
{
    if (tensor == LULL_TENSOR_INPUT)
        return 0;
    return (unsigned)graph->layer[tensor - 1].level + graph->layer[tensor - 1].pool;
}

lull_dtype lull_graph_dtype(const lull_graph *graph, unsigned tensor)
{
    unsigned last = graph->layers;
    if (!graph->is_integer)
        return LULL_DTYPE_F32;
    if (tensor == LULL_TENSOR_INPUT || tensor == last || tensor == graph->layer[last - 1].source)
        return LULL_DTYPE_U15;
    return LULL_DTYPE_U8;
}

size_t lull_dtype_bytes(lull_dtype dtype)
{
    static const uint8_t bytes[] = {4, 1, 2};
    return bytes[dtype];
}

void lull_graph_tensors(lull_layer_tensors *tensors, const lull_layer *layer, const lull_tza *tza)
{
    const char *name = rows[layer->row].name;
    memset(tensors, 0, sizeof *tensors);
    lull_tza_find(tza, name, ".weight", &tensors->weight);
    lull_tza_find(tza, name, ".skip.weight", &tensors->skip);
    lull_tza_find(tza, name, ".bias", &tensors->bias);
    lull_tza_find(tza, name, ".scale", &tensors->scale);
    lull_tza_find(tza, name, ".shift", &tensors->shift);
}

static int has_shape(const lull_tza_tensor *tensor, char dtype, uint32_t o, uint32_t i, uint32_t side)
{
    return tensor->dtype == dtype && tensor->dims[0] == o &&
           (side == 0 ? tensor->rank == 1
                      : tensor->rank == 4 && tensor->dims[1] == i && tensor->dims[2] == side &&
                            tensor->dims[3] == side);
}

/* 1 if the layer's tensors are what its channels demand. */
static int shapes_fit(const lull_layer *layer, const lull_layer_tensors *t, int is_integer)
{
    uint32_t outputs = layer->outputs, inputs = layer->in_source;
    char dtype = t->weight.dtype;
    if (!is_integer)
        return (dtype == 'h' || dtype == 'f') && (t->bias.dtype == 'h' || t->bias.dtype == 'f') &&
               has_shape(&t->weight, dtype, outputs, inputs + layer->in_skip, 3) &&
               has_shape(&t->bias, t->bias.dtype, outputs, 0, 0);
    return has_shape(&t->weight, 'b', layer->up ? 4 * outputs : outputs, inputs,
                     layer->up ? 2 : 3) &&
           (!layer->in_skip || has_shape(&t->skip, 'b', outputs, layer->in_skip, 3)) &&
           has_shape(&t->bias, 'i', outputs, 0, 0) && has_shape(&t->scale, 'f', outputs, 0, 0) &&
           (t->shift.rank == 0 || has_shape(&t->shift, 'i', 1, 0, 0));
}

/* Appends a layer: its channels are the shapes of its tensors, which must suit the layers before. */
static lull_status add_layer(lull_graph *graph, const layer_row *row, const lull_tza *tza)
{
    lull_layer_tensors tensors;
    lull_layer *layer = &graph->layer[graph->layers];
    uint32_t outputs;
    if (graph->layers == LULL_MAX_LAYERS)
        return LULL_ERROR_NETWORK;
    layer->row = (uint8_t)(row - rows);
    lull_graph_tensors(&tensors, layer, tza);
    outputs = tensors.bias.rank == 1 ? tensors.bias.dims[0] : 0;
    if (!outputs || outputs > LULL_MAX_CHANNELS || tensors.weight.rank != 4)
        return LULL_ERROR_NETWORK;
    if (graph->layers == 0) {
        graph->is_integer = tensors.weight.dtype == 'b';
        graph->inputs = tensors.weight.dims[1];
        if (graph->inputs > 9 || graph->inputs % 3)
            return LULL_ERROR_NETWORK;
    }
    layer->source = tensor_called(graph, row->source);
    layer->skip = tensor_called(graph, row->skip);
    layer->up = row->up == 2;
    layer->pool = row->pool == 2;
    layer->outputs = (uint16_t)outputs;
    layer->in_source = (uint16_t)lull_graph_channels(graph, layer->source);
    layer->in_skip = 0;
    if (layer->skip != LULL_TENSOR_NONE)
        layer->in_skip = (uint16_t)lull_graph_channels(graph, layer->skip);
    layer->level = (uint8_t)(lull_graph_level(graph, layer->source) - layer->up);
    if (!shapes_fit(layer, &tensors, graph->is_integer))
        return LULL_ERROR_NETWORK;
    graph->levels = lull_max_u(graph->levels, (unsigned)layer->level + layer->pool);
    graph->layers++;
    return LULL_OK;
}

/* How far the output looks: half the receptive field, rounded up to the alignment. A convolution at
 * level l adds 2^l pixels a side; pooling and nearest upsampling move its grid by up to 2^l - 1. */
static unsigned reach(const lull_graph *graph)
{
    unsigned field = 0, align = 1u << graph->levels;
    for (unsigned i = 0; i < graph->layers; i++)
        field += 1u << graph->layer[i].level;
    field += align - 1; /* phase of the pixel inside its coarsest cell */
    return (unsigned)lull_align_up(field, align);
}

lull_status lull_graph_build(lull_graph *graph, const lull_tza *tza)
{
    lull_tza_tensor tensor;
    size_t n = 0;
    while (n < COUNT(nets) && !lull_tza_find(tza, nets[n].key, ".weight", &tensor))
        n++;
    if (n == COUNT(nets))
        return LULL_ERROR_NETWORK;
    memset(graph, 0, sizeof *graph);
    graph->network = nets[n].name;
    for (size_t i = 0; i < COUNT(rows); i++) {
        lull_status status;
        if (!same(rows[i].net, nets[n].name))
            continue;
        status = add_layer(graph, &rows[i], tza);
        if (status != LULL_OK)
            return status;
    }
    graph->overlap = reach(graph);
    if (graph->layer[graph->layers - 1].outputs < 3)
        return LULL_ERROR_NETWORK;
    return LULL_OK;
}

uint64_t lull_graph_macs_per_pixel(const lull_graph *graph)
{
    uint64_t macs = 0; /* at the coarsest grid, summed exactly, then divided */
    for (unsigned i = 0; i < graph->layers; i++) {
        const lull_layer *layer = &graph->layer[i];
        uint64_t taps = 9u * (uint64_t)(layer->in_source + layer->in_skip) * layer->outputs;
        macs += taps << (2 * (graph->levels - layer->level));
    }
    return macs >> (2 * graph->levels);
}
