/* Which rows of which tensor a plan makes, and how long they are needed. */
#include "plan.h"

/* Rows of a layer (before pooling) that `rows` of a source's `height` rows allow; `all` is the
 * number of rows of the layer. */
static unsigned rows_ready(lull_reads reads, unsigned rows, unsigned height, unsigned all)
{
    static const uint8_t below[] = {0, 1, 2, LULL_BILATERAL_FAR, 1}; /* rows read after y */
    if (rows >= height)
        return all;
    if (reads == LULL_READS_CELL)
        return rows / LULL_CELL;
    if (reads == LULL_READS_16TH)
        return rows ? LULL_CELL * rows - LULL_CELL / 2 : 0;
    if (reads == LULL_READS_8)
        return rows / LULL_FIT_SIDE;
    if (reads == LULL_READS_EIGHTH)
        return rows ? LULL_FIT_SIDE * rows - LULL_FIT_SIDE / 2 : 0;
    if (reads == LULL_READS_COARSE)
        return rows ? 2 * rows - 1 : 0;
    if (reads == LULL_READS_FINE)
        return rows / 2;
    return rows > below[reads] ? rows - below[reads] : 0;
}

/* The first row of a source that a layer still needs whose next row (before pooling) is `row`. */
static unsigned rows_needed(lull_reads reads, unsigned row)
{
    static const uint8_t above[] = {
        0, 1, 2, LULL_BILATERAL_FAR, LULL_CELLS_ABOVE, 1, 0, 0, 1, 0, 1};
    if (reads == LULL_READS_CELL)
        row = LULL_CELL * row;
    if (reads == LULL_READS_16TH)
        row = (row + LULL_CELL / 2) / LULL_CELL;
    if (reads == LULL_READS_8)
        row = LULL_FIT_SIDE * row;
    if (reads == LULL_READS_EIGHTH)
        row = (row + LULL_FIT_SIDE / 2) / LULL_FIT_SIDE;
    if (reads == LULL_READS_COARSE)
        row = (row + 1) / 2;
    if (reads == LULL_READS_FINE)
        row = 2 * row;
    return row > above[reads] ? row - above[reads] : 0;
}

int lull_plan_has_feature(const lull_plan *plan, unsigned feature)
{
    if (feature == LULL_GRAIN_ALBEDO)
        return !(~plan->frame.features & 3u);
    return plan->frame.features & 4u && plan->frame.features & 3u;
}

int lull_plan_has(const lull_plan *plan, unsigned tensor)
{
    const lull_graph *graph = &plan->model->graph;
    if (tensor <= LULL_MAX_LAYERS)
        return tensor <= graph->layers && !(tensor && lull_plan_is_idle(plan, tensor - 1));
    if (graph->family != LULL_FAMILY_K)
        return tensor == LULL_TENSOR_AUX && graph->aux;
    if (tensor == LULL_TENSOR_ALBEDO)
        return lull_plan_has_feature(plan, LULL_GRAIN_ALBEDO);
    if (tensor == LULL_TENSOR_GUIDE)
        return lull_graph_find(graph, LULL_OP_BILATERAL) != LULL_TENSOR_NONE;
    if (tensor == LULL_TENSOR_NORMAL)
        return lull_plan_has_feature(plan, LULL_GRAIN_NORMAL) &&
               ((plan->keeps_rows && lull_plan_takes_grain(plan)) ||
                lull_graph_find(graph, LULL_OP_FACE) != LULL_TENSOR_NONE);
    return (int)plan->keeps_rows;
}

float lull_plan_edges(const lull_plan *plan)
{
    int has_steps = lull_graph_mixed_by(&plan->model->graph) != LULL_TENSOR_NONE;
    return has_steps ? plan->ragged * LULL_EDGE_SHARE : 0.0f;
}

unsigned lull_plan_ready(const lull_plan *plan, int are_averaged)
{
    unsigned made = lull_plan_done(plan, plan->model->graph.layers);
    return made < plan->frame.height && are_averaged ? lull_max_u(made, 1) - 1 : made;
}

void lull_plan_restart(lull_plan *plan)
{
    for (unsigned tensor = 0; tensor < LULL_TENSORS; tensor++)
        lull_plan_set_done(plan, tensor, 0);
    plan->stored = 0;
}

int lull_plan_takes_grain(const lull_plan *plan)
{
    return plan->model->graph.before && !plan->frame.clean_aux &&
           (lull_plan_has_feature(plan, LULL_GRAIN_ALBEDO) ||
            lull_plan_has_feature(plan, LULL_GRAIN_NORMAL));
}

int lull_plan_is_idle(const lull_plan *plan, unsigned l)
{
    return l < plan->model->graph.before && !lull_plan_takes_grain(plan);
}

int lull_plan_brings(const lull_plan *plan, unsigned l)
{
    const lull_op op = plan->model->graph.layer[l].op;
    return op == LULL_OP_SMOOTH || op == LULL_OP_BILATERAL;
}

void lull_plan_set_aux(lull_plan *plan, unsigned rows)
{
    lull_plan_set_done(plan, LULL_TENSOR_ALBEDO, rows);
    lull_plan_set_done(plan, LULL_TENSOR_GUIDE, rows);
    lull_plan_set_done(plan, LULL_TENSOR_NORMAL, rows);
}

void lull_plan_bring(lull_plan *plan, unsigned l, unsigned rows)
{
    if (plan->model->graph.layer[l].op == LULL_OP_BILATERAL) {
        lull_plan_set_done(plan, LULL_TENSOR_GUIDE, rows);
        return;
    }
    lull_plan_set_done(plan, LULL_TENSOR_ALBEDO, rows);
    lull_plan_set_done(plan, LULL_TENSOR_NORMAL, rows);
}

/* In steps of HALVED rows the layers of full resolution of family K's filter, whose rows take 12 to
 * 16 bytes a pixel, and the next level's radiance take two turns: their rings hold fewer rows. */
#define HALVED 8u

/* 1 if layer l takes two turns in a step. */
static unsigned is_halved(const lull_plan *plan, unsigned l)
{
    enum { FULL = 1, HALF }; /* one more than the level */
    static const uint8_t resolution[LULL_OPS] = {
        [LULL_OP_HEAD] = FULL,      [LULL_OP_SMOOTH] = FULL, [LULL_OP_DEMODULATE] = FULL,
        [LULL_OP_POOL] = HALF,      [LULL_OP_FILTER] = FULL, [LULL_OP_BLEND] = FULL,
        [LULL_OP_BILATERAL] = FULL, [LULL_OP_FACE] = FULL};
    const lull_layer *layer = &plan->model->graph.layer[l];
    return plan->row_step == HALVED && resolution[layer->op] == layer->level + 1;
}

lull_stage lull_plan_stage(const lull_plan *plan, unsigned first)
{
    const unsigned halved = is_halved(plan, first);
    lull_stage stage = {first, first + 1, 1 + halved};
    while (stage.end < plan->model->graph.layers && is_halved(plan, stage.end) == halved)
        stage.end++;
    return stage;
}

/* Rows of layer l in a turn, after pooling: as many as a step brings, rounded up, lest a layer fall
 * behind more with every step that is no multiple of its rows; half of them if it takes two. */
static unsigned turn_rows(const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned shift = layer->level + layer->pool;
    unsigned turn = (plan->row_step + (1u << shift) - 1) >> shift;
    return (unsigned)lull_align_up(turn >> is_halved(plan, l), lull_plan_rows(plan, l));
}

unsigned lull_plan_aux_rows(const lull_plan *plan, unsigned l)
{
    unsigned done = lull_plan_done(plan, l + 1), rows;
    if (plan->model->graph.layer[l].op == LULL_OP_BILATERAL)
        return lull_plan_done(plan, plan->model->graph.layer[l].source[0]);
    rows = lull_min_u(lull_plan_done(plan, plan->model->graph.layer[l].source[1]),
                      done + turn_rows(plan, l));
    rows = rows > done ? rows + 2 : 0; /* not before the turn: grain is known then */
    return lull_max_u(lull_min_u(rows, plan->height), lull_plan_done(plan, LULL_TENSOR_ALBEDO));
}

/* 1 if every layer that reads a tensor could take a whole turn with the rows that are made. A layer
 * without readers makes the output. */
static int is_ahead(const lull_plan *plan, unsigned tensor)
{
    const lull_graph *graph = &plan->model->graph;
    unsigned height = plan->height >> lull_graph_level(graph, tensor), readers = 0;
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        unsigned all = plan->height >> layer->level;
        unsigned wanted = (lull_plan_done(plan, l + 1) + turn_rows(plan, l)) << layer->pool;
        for (unsigned s = 0; s < LULL_MAX_SOURCES; s++) {
            if (layer->source[s] != tensor)
                continue;
            if (rows_ready((lull_reads)layer->reads[s], lull_plan_done(plan, tensor), height, all) <
                lull_min_u(wanted, all))
                return 0;
            readers++;
        }
    }
    return readers > 0;
}

unsigned lull_plan_turn(const lull_plan *plan, unsigned l)
{
    const lull_graph *graph = &plan->model->graph;
    const lull_layer *layer = &graph->layer[l];
    unsigned all = plan->height >> layer->level, ready = all;
    unsigned rows = lull_plan_rows(plan, l), done = lull_plan_done(plan, l + 1);
    if (graph->family == LULL_FAMILY_U && is_ahead(plan, l + 1))
        return done;
    for (unsigned s = 0; s < LULL_MAX_SOURCES && layer->source[s] != LULL_TENSOR_NONE; s++)
        ready = lull_min_u(
            ready, rows_ready((lull_reads)layer->reads[s], lull_plan_done(plan, layer->source[s]),
                              plan->height >> lull_graph_level(graph, layer->source[s]), all));
    return lull_min_u((ready >> layer->pool) / rows * rows, done + turn_rows(plan, l));
}

unsigned lull_plan_alive(const lull_plan *plan, unsigned tensor)
{
    const lull_graph *graph = &plan->model->graph;
    const unsigned mixed_by = lull_graph_mixed_by(graph), above = mixed_by != LULL_TENSOR_NONE;
    unsigned needed = lull_plan_done(plan, tensor);
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        for (unsigned s = 0; s < LULL_MAX_SOURCES; s++)
            if (layer->source[s] == tensor ||
                (tensor == LULL_TENSOR_INPUT && layer->source[s] == graph->input))
                needed = lull_min_u(needed,
                                    rows_needed((lull_reads)layer->reads[s],
                                                lull_plan_done(plan, l + 1) << layer->pool));
    }
    /* what the output is made of */
    if (tensor == mixed_by || (tensor == LULL_TENSOR_RADIANCE && mixed_by != LULL_TENSOR_NONE))
        needed = lull_min_u(needed, plan->stored);
    if (tensor == LULL_TENSOR_NORMAL && plan->keeps_rows) /* what the input's grain is taken of */
        needed = lull_min_u(needed, lull_plan_done(plan, graph->input));
    if (tensor == graph->layers || tensor == lull_graph_find(graph, LULL_OP_SMOOTH))
        needed = lull_min_u(needed, lull_max_u(plan->stored, above) - above);
    return lull_plan_done(plan, tensor) - needed;
}
