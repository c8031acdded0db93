/* What other files ask a graph. */
#include "graph.h"

unsigned lull_layer_own_outputs(const lull_layer *layer)
{
    int is_second = layer->op == LULL_OP_HEAD && layer->level == 0 && layer->first == 0;
    return is_second ? LULL_HEAD0_SPLIT : layer->outputs;
}

int lull_graph_is_local(const lull_graph *graph, unsigned tensor)
{
    const lull_layer *layer;
    if (tensor < 1 || tensor > graph->layers)
        return 0;
    layer = &graph->layer[tensor - 1];
    return layer->op == LULL_OP_HEAD && layer->level == 0;
}

int lull_graph_is_far(const lull_layer *layer) { return layer->reads[0] == LULL_READS_25; }

int lull_graph_has_noise(const lull_graph *graph, unsigned tensor)
{
    const lull_layer *layer;
    if (tensor < 1 || tensor > graph->layers)
        return 0;
    layer = &graph->layer[tensor - 1];
    if (layer->op == LULL_OP_FILTER || layer->op == LULL_OP_BLEND)
        return !layer->level && lull_graph_find(graph, LULL_OP_BILATERAL) != LULL_TENSOR_NONE;
    return layer->op == LULL_OP_REGRESS ||
           (layer->op == LULL_OP_BILATERAL && tensor < graph->layers);
}

unsigned lull_graph_mixed_by(const lull_graph *graph)
{
    const lull_layer *last = &graph->layer[graph->layers - 1];
    return last->op == LULL_OP_BILATERAL || last->op == LULL_OP_CORRECT ? last->source[0]
                                                                         : LULL_TENSOR_NONE;
}

int lull_layer_makes_codes(const lull_layer *layer)
{
    return lull_layer_is_conv(layer) || layer->op == LULL_OP_ENCODE;
}

int lull_graph_planes(const lull_graph *graph, unsigned tensor)
{
    const lull_layer *layer;
    if (tensor == LULL_TENSOR_ALBEDO || tensor == LULL_TENSOR_NORMAL)
        return 1;
    if (tensor < 1 || tensor > graph->layers)
        return 0;
    layer = &graph->layer[tensor - 1];
    if (lull_layer_makes_codes(layer))
        return 0;
    return 1 + (layer->op == LULL_OP_FILTER) + lull_graph_has_noise(graph, tensor);
}

uint64_t lull_graph_macs_per_pixel(const lull_graph *graph)
{
    uint64_t macs = 0; /* at the coarsest grid, summed exactly, then divided */
    for (unsigned i = 0; i < graph->layers; i++) {
        const lull_layer *layer = &graph->layer[i];
        uint64_t inputs = lull_layer_all_inputs(graph, layer);
        uint64_t taps = layer->op == LULL_OP_CONV ? 9 : layer->op == LULL_OP_HEAD ? 1 : 0;
        macs += taps * inputs * lull_layer_own_outputs(layer)
                << (2 * (graph->levels - layer->level));
    }
    return macs >> (2 * graph->levels);
}
