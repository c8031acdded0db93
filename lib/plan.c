#include "plan.h"

#include "exposure.h"

/* Columns per side of a task's working set are chosen so that its source and output rows stay within
 * this many bytes (half of a small L2 cache). */
#define TASK_BYTES (192u << 10)
#define CHUNK_STEP 24u /* columns of a task are multiples of this: even, and whole kernel tiles */
#define ROW_SLACK 16u /* readable bytes after a row's right border */

/* Row steps, fastest first. A step of 1 would need more memory again: coarse layers then run ahead. */
static const unsigned steps[] = {16, 8, 4, 2};
#define STEP_COUNT (sizeof steps / sizeof steps[0])

/* Rows of a layer's output (pooled if it pools) that can be made once its source and skip have made
 * source_rows and skip_rows of theirs; `height` is the number of rows of its convolution in all. */
static unsigned rows_ready(const lull_layer *layer, unsigned source_rows, unsigned skip_rows,
                           unsigned height)
{
    unsigned source_height = layer->up ? height / 2 : height;
    unsigned rows = height;
    if (source_rows < source_height)
        rows = source_rows == 0 ? 0 : layer->up ? 2 * source_rows - 1 : source_rows - 1;
    if (layer->skip != LULL_TENSOR_NONE && skip_rows < height)
        rows = lull_min_u(rows, skip_rows == 0 ? 0 : skip_rows - 1);
    return layer->pool ? rows / 2 : rows;
}

/* The first row of a layer's source (or skip) that it still needs, having made `done` output rows. */
static unsigned rows_needed(const lull_layer *layer, int of_skip, unsigned done)
{
    unsigned row = layer->pool ? 2 * done : done; /* the next convolution row */
    if (layer->up && !of_skip)
        row = (row + 1) / 2;
    return row == 0 ? 0 : row - 1;
}

unsigned lull_plan_turn(const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned skip_rows = layer->skip == LULL_TENSOR_NONE ? 0 : plan->done[layer->skip];
    unsigned ready = rows_ready(layer, plan->done[layer->source], skip_rows,
                                plan->height >> layer->level);
    unsigned turn = lull_max_u(plan->row_step >> (layer->level + layer->pool), 1);
    return lull_min_u(ready, plan->done[l + 1] + turn);
}

/* Rows of tensor t that are still needed, given what its consumers and the output have made. */
static unsigned rows_alive(const lull_plan *plan, unsigned tensor)
{
    const lull_graph *graph = &plan->model->graph;
    unsigned needed = plan->done[tensor];
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        if (layer->source == tensor)
            needed = lull_min_u(needed, rows_needed(layer, 0, plan->done[l + 1]));
        if (layer->skip == tensor)
            needed = lull_min_u(needed, rows_needed(layer, 1, plan->done[l + 1]));
    }
    if (tensor == graph->layers)
        needed = lull_min_u(needed, plan->stored);
    return plan->done[tensor] - needed;
}

/* Plays the whole frame through and sets the rows of every ring, and the delay. */
static void play(lull_plan *plan)
{
    const lull_graph *graph = &plan->model->graph;
    memset(plan->done, 0, sizeof plan->done);
    plan->stored = 0;
    plan->delay_rows = 0;
    for (unsigned t = 0; t <= graph->layers; t++)
        plan->ring[t].rows = 1;
    while (plan->stored < plan->height) {
        plan->done[0] = lull_min_u(plan->done[0] + plan->row_step, plan->height);
        plan->ring[0].rows = lull_max_u(plan->ring[0].rows, rows_alive(plan, 0));
        for (unsigned l = 0; l < graph->layers; l++) {
            plan->done[l + 1] = lull_plan_turn(plan, l);
            plan->ring[l + 1].rows = lull_max_u(plan->ring[l + 1].rows, rows_alive(plan, l + 1));
        }
        if (plan->done[graph->layers] > plan->stored)
            plan->delay_rows = lull_max_u(plan->delay_rows, plan->done[0] - 1 - plan->stored);
        plan->stored = plan->done[graph->layers];
    }
}

size_t lull_ring_pixel(const lull_ring *ring)
{
    return ring->channels * lull_dtype_bytes((lull_dtype)ring->dtype);
}

size_t lull_ring_left(const lull_ring *ring)
{
    return lull_align_up(lull_ring_pixel(ring), LULL_ALIGN);
}

/* Columns of a layer's task. */
static unsigned choose_chunk(const lull_plan *plan, const lull_layer *layer)
{
    size_t element = plan->model->graph.is_integer ? 1 : sizeof(float);
    size_t column = (layer->outputs + 3 * ((size_t)layer->in_source + layer->in_skip)) * element;
    unsigned width = plan->row_width >> layer->level;
    unsigned rows = lull_max_u(plan->row_step >> layer->level, 1);
    unsigned count = (unsigned)((width * column + TASK_BYTES - 1) / TASK_BYTES);
    if (plan->threads > 1)
        count = lull_max_u(count, (2 * plan->threads + rows - 1) / rows);
    count = lull_max_u(count, 1);
    return lull_min_u((unsigned)lull_align_up((width + count - 1) / count, CHUNK_STEP),
                      LULL_MAX_SIZE - CHUNK_STEP);
}

/* Sizes the rings and everything else for the strip width and row step set in the plan. */
static void layout(lull_plan *plan)
{
    const lull_graph *graph = &plan->model->graph;
    size_t total = lull_align_up(sizeof *plan, LULL_ALIGN), longest = 0;
    unsigned overlap = graph->overlap;
    plan->strips = plan->width ? (plan->width + plan->strip_width - 1) / plan->strip_width : 0;
    plan->row_width = lull_min_u(plan->strip_width + 2 * overlap, plan->width);
    play(plan);
    for (unsigned t = 0; t <= graph->layers; t++) {
        lull_ring *ring = &plan->ring[t];
        size_t pixel;
        ring->dtype = (uint8_t)lull_graph_dtype(graph, t);
        ring->channels = (uint16_t)lull_graph_channels(graph, t);
        ring->level = (uint8_t)lull_graph_level(graph, t);
        pixel = lull_ring_pixel(ring);
        ring->row_bytes = lull_align_up(lull_ring_left(ring) + ROW_SLACK +
                                            pixel * ((plan->row_width >> ring->level) + 1),
                                        LULL_ALIGN);
        ring->row_bytes |= LULL_ALIGN; /* an odd number of lines: rows fall into different cache sets */
        ring->offset = lull_append(&total, ring->row_bytes * ring->rows);
        longest = longest > ring->row_bytes ? longest : ring->row_bytes;
    }
    plan->zero_row = lull_append(&total, longest);
    plan->scratch_bytes = 64 * 9 * sizeof(float);
    for (unsigned l = 0; l < graph->layers; l++) {
        const lull_layer *layer = &graph->layer[l];
        size_t bytes = 2 * lull_ring_pixel(&plan->ring[l + 1]);
        plan->chunk[l] = (uint16_t)choose_chunk(plan, layer);
        bytes *= plan->chunk[l];
        if (layer->pool && bytes > plan->scratch_bytes)
            plan->scratch_bytes = bytes;
    }
    plan->scratch_bytes = lull_align_up(plan->scratch_bytes, LULL_ALIGN);
    plan->scratch = lull_append(&total, plan->scratch_bytes * plan->threads);
    plan->exposure = lull_append(&total, lull_exposure_rows(plan->frame.height) *
                                        sizeof(lull_exposure_row));
    plan->saved_width = plan->frame.in_place && plan->strips > 1 ? overlap : 0;
    plan->saved = lull_append(&total, (size_t)plan->frame.height * plan->saved_width *
                                     graph->inputs *
                                     lull_dtype_bytes((lull_dtype)plan->ring[0].dtype));
    plan->bytes = total;
}

/* The narrowest and slowest plan. */
static void layout_minimum(lull_plan *plan)
{
    plan->row_step = steps[STEP_COUNT - 1];
    plan->strip_width = 1u << plan->model->graph.levels;
    layout(plan);
}

/* Widest strips that keep within `limit` bytes at the plan's row step; 0 if none do. */
static int fit_strips(lull_plan *plan, size_t limit)
{
    unsigned align = 1u << plan->model->graph.levels;
    unsigned low = 1, high = plan->width / align, best = 0;
    while (low <= high) {
        unsigned middle = (low + high) / 2;
        plan->strip_width = middle * align;
        layout(plan);
        if (plan->bytes <= limit) {
            best = middle;
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    if (!best)
        return 0;
    plan->strip_width = best * align;
    layout(plan);
    return 1;
}

/* Chooses row step and strip width: as asked for, else the fastest that fits. Strips compute their
 * overlaps twice, so small row steps are tried first. */
static lull_status choose(lull_plan *plan)
{
    const lull_frame *frame = &plan->frame;
    unsigned align = 1u << plan->model->graph.levels;
    size_t limit = frame->max_bytes ? frame->max_bytes : (size_t)-1;
    unsigned whole = lull_max_u(plan->width, align);
    for (unsigned i = 0; i < STEP_COUNT; i++) {
        plan->row_step = frame->row_step ? frame->row_step : steps[i];
        plan->strip_width = whole;
        if (frame->strip_width)
            plan->strip_width =
                lull_min_u((unsigned)lull_align_up(frame->strip_width, align), whole);
        layout(plan);
        if (plan->bytes <= limit)
            return LULL_OK;
    }
    if (!frame->strip_width && fit_strips(plan, limit))
        return LULL_OK;
    return LULL_ERROR_MEMORY;
}

static lull_status start(lull_plan *plan, const lull_frame *frame, const lull_model *model)
{
    unsigned align, features = 0;
    if (!frame || !model || frame->width > LULL_MAX_SIZE || frame->height > LULL_MAX_SIZE ||
        (unsigned)frame->content >= LULL_CONTENT_COUNT || !(frame->features & 7) ||
        frame->features > 7 || frame->threads > 65536 || frame->strip_width > LULL_MAX_SIZE)
        return LULL_ERROR_ARGUMENT;
    for (unsigned i = 0; i < 3; i++)
        features += frame->features >> i & 1;
    if (3 * features != model->graph.inputs)
        return LULL_ERROR_FEATURES;
    align = 1u << model->graph.levels;
    memset(plan, 0, sizeof *plan);
    plan->model = model;
    plan->frame = *frame;
    plan->threads = lull_max_u(frame->threads, 1);
    plan->width = (unsigned)lull_align_up(frame->width, align);
    plan->height = (unsigned)lull_align_up(frame->height, align);
    return LULL_OK;
}

size_t lull_plan_size(const lull_frame *frame, const lull_model *model)
{
    lull_plan plan;
    if (start(&plan, frame, model) != LULL_OK || choose(&plan) != LULL_OK)
        return 0;
    return plan.bytes;
}

size_t lull_plan_minimum(const lull_frame *frame, const lull_model *model)
{
    lull_plan plan;
    if (start(&plan, frame, model) != LULL_OK)
        return 0;
    layout_minimum(&plan);
    return plan.bytes;
}

lull_status lull_plan_init(lull_plan **plan, void *memory, size_t memory_bytes,
                           const lull_frame *frame, const lull_model *model)
{
    lull_plan *made = memory;
    lull_status status;
    if (!plan || !memory || (uintptr_t)memory % LULL_ALIGN)
        return LULL_ERROR_ARGUMENT;
    if (memory_bytes < sizeof *made)
        return LULL_ERROR_MEMORY;
    status = start(made, frame, model);
    if (status == LULL_OK)
        status = choose(made);
    if (status != LULL_OK)
        return status;
    if (memory_bytes < made->bytes)
        return LULL_ERROR_MEMORY;
    memset((uint8_t *)memory + sizeof *made, 0, made->bytes - sizeof *made);
    made->done[0] = LULL_ROWS_IDLE;
    *plan = made;
    return LULL_OK;
}

void lull_plan_get_info(const lull_plan *plan, lull_plan_info *info)
{
    info->bytes = plan->bytes;
    info->minimum_bytes = lull_plan_minimum(&plan->frame, plan->model);
    info->row_step = plan->row_step;
    info->strip_width = plan->strip_width;
    info->strips = plan->strips;
    info->delay_rows = plan->delay_rows;
}

lull_frame lull_frame_default(unsigned width, unsigned height, lull_content content,
                              unsigned features)
{
    lull_frame frame;
    memset(&frame, 0, sizeof frame);
    frame.width = width;
    frame.height = height;
    frame.content = content;
    frame.features = features;
    return frame;
}
