#include "plan.h"

#include "exposure.h"

/* Columns per side of a task's working set are chosen so that its source and output rows stay
 * within this many bytes (half of a small L2 cache). */
#define TASK_BYTES (192u << 10)
#define WINOGRAD_TASK_BYTES (320u << 10) /* likewise the points of a task */
#define WIDE_TASK_BYTES (160u << 10)     /* and those of wide codes */
#define NARROW_TASK_BYTES (64u << 10)    /* and those of patches of family K: as fast as more */
#define CHUNK_STEP 24u /* columns of a task are multiples of this: even, and whole kernel tiles */
#define BORDER 2u      /* pixels of zeros beside a row; on the left aligned, see lull_ring_left */
#define ROW_SLACK 16u  /* readable bytes after a row's right border */

/* Row steps. The first is for many threads, which want many rows to share; for few, 8 rows stay in
 * caches better. Models of family K that do not correct their result take 4 where they have
 * patches, for which 8 want 2.3 MB more at 1920 columns: without them 8 are 4 to 5 % faster for 0.8
 * MB. */
static const unsigned steps[] = {16, 8, 4, 2, 1};
enum { MANY_STEP, FEW_STEP, SMALL_STEP };
#define FEW_THREADS 4u
#define STEP_COUNT (sizeof steps / sizeof steps[0])
#define START_ROWS 1024u  /* by then a plan is under way, and ... */
#define PERIOD_STEPS 256u /* ... repeats itself after these */
#define MOST_ROWS (LULL_MAX_SIZE / 2) /* of a step: rings, which have some more, count in 16 bits */

int lull_plan_is_patched(const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned half = LULL_PATCH_SIDE / 2 << lull_layer_has_phases(layer);
    return layer->has_patches && plan->row_step >> layer->level >= half;
}

unsigned lull_plan_rows(const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned rows = lull_plan_is_patched(plan, l) ? LULL_PATCH_SIDE << lull_layer_has_phases(layer)
                    : layer->is_winograd          ? LULL_WINOGRAD_ROWS
                                                  : 1;
    return lull_max_u(rows >> layer->pool, 1);
}

static void grow_ring(lull_plan *plan, unsigned tensor)
{
    plan->ring[tensor].rows =
        lull_max_u(plan->ring[tensor].rows, lull_plan_alive(plan, tensor)) & 0xffffu;
}

/* One turn of each layer of a stage, and of the output. */
static void play_stage(lull_plan *plan, const lull_stage *stage)
{
    const lull_graph *graph = &plan->model->graph;
    unsigned made;
    for (unsigned l = stage->first; l < stage->end; l++) {
        if (lull_plan_brings(plan, l) && !plan->keeps_rows) {
            lull_plan_bring(plan, l, lull_plan_aux_rows(plan, l));
            grow_ring(plan, LULL_TENSOR_ALBEDO);
            grow_ring(plan, LULL_TENSOR_GUIDE);
            grow_ring(plan, LULL_TENSOR_NORMAL);
        }
        lull_plan_set_done(plan, l + 1, lull_plan_turn(plan, l));
        grow_ring(plan, l + 1);
    }
    if (stage->end < graph->layers)
        return;
    made = lull_plan_ready(plan, lull_graph_mixed_by(graph) != LULL_TENSOR_NONE);
    if (made > plan->stored)
        plan->delay_rows =
            lull_max_u(plan->delay_rows, lull_plan_done(plan, 0) - 1 - plan->stored);
    plan->stored = made;
}

/* Plays the whole frame through, but for all periods of a tall one but one, and sets the rows of
 * every ring, and the delay. These depend on the row step, not on strips. */
static void play(lull_plan *plan)
{
    const unsigned period = PERIOD_STEPS * plan->row_step;
    const unsigned periods = (lull_max_u(plan->height, START_ROWS) - START_ROWS) / period;
    const unsigned left_out = (lull_max_u(periods, 1) - 1) * period;
    lull_stage stage;
    plan->height -= left_out;
    plan->frame.height -= left_out;
    plan->played = plan->row_step;
    lull_plan_restart(plan);
    plan->delay_rows = 0;
    for (unsigned t = 0; t < LULL_TENSORS; t++)
        plan->ring[t].rows = 1;
    while (plan->stored < plan->height) {
        unsigned rows = lull_min_u(lull_plan_done(plan, 0) + plan->row_step, plan->height);
        lull_plan_set_done(plan, LULL_TENSOR_INPUT, rows);
        lull_plan_set_done(plan, LULL_TENSOR_RADIANCE, rows);
        if (plan->keeps_rows)
            lull_plan_set_aux(plan, rows);
        for (unsigned i = 0; i < LULL_LOADED; i++)
            grow_ring(plan, lull_loaded[i]);
        for (unsigned l = 0; l < plan->model->graph.layers; l = stage.end) {
            stage = lull_plan_stage(plan, l);
            for (unsigned turn = 0; turn < stage.times; turn++)
                play_stage(plan, &stage);
        }
    }
    plan->height += left_out;
    plan->frame.height += left_out;
}

size_t lull_ring_pixel(const lull_ring *ring)
{
    return (ring->has_planes ? 1u : ring->channels) * lull_dtype_bytes((lull_dtype)ring->dtype);
}

size_t lull_plan_pixel(const lull_plan *plan, unsigned tensor)
{
    const lull_ring *ring = &plan->ring[tensor];
    return ring->channels * lull_dtype_bytes((lull_dtype)ring->dtype);
}

size_t lull_ring_left(const lull_ring *ring)
{
    return lull_align_up(BORDER * lull_ring_pixel(ring), LULL_ALIGN);
}

size_t lull_plan_plane(const lull_plan *plan, unsigned tensor)
{
    return (size_t)plan->plane_units[plan->ring[tensor].level] * LULL_ALIGN;
}

/* Bytes of a row, or of one of its planes. An odd number of lines: they fall into different cache
 * sets. */
static size_t row_bytes(const lull_plan *plan, const lull_ring *ring)
{
    size_t columns = (plan->row_width >> ring->level) + BORDER;
    size_t bytes = lull_ring_left(ring) + ROW_SLACK + lull_ring_pixel(ring) * columns;
    return lull_align_up(bytes, LULL_ALIGN) | LULL_ALIGN;
}

/* Pieces, at least `count`, that rows are cut in so that threads can share `rows` of them. Few
 * threads get whole bands of columns, much the same ones in every loop. */
static unsigned pieces(const lull_plan *plan, unsigned rows, unsigned count)
{
    count = lull_max_u(count, 1);
    if (plan->threads == 1)
        return count;
    if (plan->threads <= FEW_THREADS)
        return (unsigned)lull_align_up(count, plan->threads);
    return lull_max_u(count, (2 * plan->threads + rows - 1) / rows);
}

unsigned lull_plan_bands(const lull_plan *plan)
{
    return plan->threads <= FEW_THREADS ? plan->threads : 1;
}

unsigned lull_plan_band(const lull_plan *plan)
{
    unsigned count = plan->saved_width ? 1 : pieces(plan, plan->row_step, 1);
    return (unsigned)lull_align_up((plan->row_width + count - 1) / count, LULL_BLOCK);
}

/* Planes of `columns` columns of a layer in Winograd's form, as in lull_points: how many there are,
 * and their bytes. */
static void winograd_planes(unsigned count[3], size_t bytes[3], const lull_plan *plan, unsigned l,
                            unsigned columns)
{
    const lull_graph *graph = &plan->model->graph;
    const lull_layer *layer = &graph->layer[l];
    size_t patches = columns / LULL_WINOGRAD_COLUMNS;
    for (unsigned s = 0; s < 3; s++) {
        count[s] = LULL_WINOGRAD_POINTS;
        bytes[s] = patches * sizeof(float) *
                   (s < 2 ? lull_layer_inputs(graph, layer, s) : layer->outputs);
    }
}

/* The same of a layer in patches: points and sums of one source after the other. */
static void patch_planes(unsigned count[3], size_t bytes[3], const lull_plan *plan, unsigned l,
                         unsigned columns)
{
    const lull_graph *graph = &plan->model->graph;
    const lull_layer *layer = &graph->layer[l];
    unsigned has_phases = lull_layer_has_phases(layer);
    int is_wide = lull_layer_has_wide_patches(graph, l);
    memset(bytes, 0, 3 * sizeof *bytes);
    for (unsigned s = 0; s < 2; s++) {
        size_t patches = columns / lull_patch_side(is_wide) >> (s == 0 && has_phases);
        size_t points = patches * lull_layer_inputs(graph, layer, s) * sizeof(int16_t);
        size_t sums = patches * layer->outputs * sizeof(int32_t);
        if (!(layer->has_patches >> s & 1))
            continue;
        bytes[0] = bytes[0] > points ? bytes[0] : points;
        bytes[2] = bytes[2] > sums ? bytes[2] : sums;
    }
    if (has_phases || layer->has_patches > 1)
        bytes[1] = (size_t)columns * layer->outputs * sizeof(int32_t);
    count[0] = count[2] = lull_patch_points(is_wide);
    count[1] = LULL_PATCH_SIDE << has_phases;
}

static void planes_of(unsigned count[3], size_t bytes[3], const lull_plan *plan, unsigned l,
                      unsigned columns)
{
    if (plan->model->graph.layer[l].is_winograd)
        winograd_planes(count, bytes, plan, l, columns);
    else
        patch_planes(count, bytes, plan, l, columns);
}

/* Bytes of points that a task of layer l should have. */
static unsigned points_bytes(const lull_graph *graph, unsigned l)
{
    if (lull_layer_has_wide_patches(graph, l))
        return WIDE_TASK_BYTES;
    return graph->is_integer && graph->family == LULL_FAMILY_K ? NARROW_TASK_BYTES
                                                               : WINOGRAD_TASK_BYTES;
}

unsigned lull_plan_chunk(const lull_plan *plan, unsigned l)
{
    const lull_graph *graph = &plan->model->graph;
    const lull_layer *layer = &graph->layer[l];
    size_t element = lull_layer_is_conv(layer) && graph->is_integer ? 1 : sizeof(float);
    size_t inputs = lull_layer_inputs(graph, layer, 0) + lull_layer_inputs(graph, layer, 1);
    unsigned width = plan->row_width >> layer->level, step = CHUNK_STEP;
    unsigned rows = lull_max_u(plan->row_step >> layer->level, 1);
    unsigned count =
        (unsigned)((width * (layer->outputs + 3 * inputs) * element + TASK_BYTES - 1) / TASK_BYTES);
    if (layer->is_winograd || lull_plan_is_patched(plan, l)) {
        unsigned planes[3], patch = 0, most;
        size_t bytes[3];
        step = 12 * LULL_WINOGRAD_COLUMNS << lull_layer_has_phases(layer); /* as in patches */
        planes_of(planes, bytes, plan, l, step / 12);
        for (unsigned i = 0; i < 3; i++)
            patch += planes[i] * (unsigned)bytes[i];
        most = lull_max_u(points_bytes(graph, l) / 12 / patch, 1) * step;
        count = (width + most - 1) / most;
        rows = lull_max_u(rows / (lull_plan_rows(plan, l) << layer->pool), 1);
    }
    count = pieces(plan, rows, count);
    return (unsigned)lull_align_up((width + count - 1) / count, step);
}

size_t lull_plan_points(lull_points *points, const lull_plan *plan, unsigned l)
{
    const lull_layer *layer = &plan->model->graph.layer[l];
    unsigned columns = lull_min_u(lull_plan_chunk(plan, l), plan->row_width >> layer->level);
    unsigned count[3];
    size_t bytes[3], total = 0;
    planes_of(count, bytes, plan, l, columns);
    for (unsigned s = 0; s < 3; s++) {
        size_t plane = lull_align_up(bytes[s], LULL_ALIGN);
        plane |= LULL_ALIGN; /* an odd number of lines */
        points->offset[s] = total;
        points->plane[s] = plane / (s == 0 && !layer->is_winograd ? sizeof(int16_t) : 4);
        total += bytes[s] ? count[s] * plane : 0;
    }
    points->room = total;
    if (!layer->is_winograd && !lull_layer_has_wide_patches(&plan->model->graph, l))
        total += LULL_PATCH_ROOM * sizeof(int32_t);
    return total;
}

/* Sizes the rings for the row width set in the plan; returns the bytes of the longest row. */
static size_t layout_rings(lull_plan *plan, size_t *total)
{
    const lull_graph *graph = &plan->model->graph;
    size_t longest = 0;
    for (unsigned t = 0; t < LULL_TENSORS; t++) {
        lull_ring *ring = &plan->ring[t];
        size_t row, width;
        int planes = lull_graph_planes(graph, t);
        if (!lull_plan_has(plan, t) || (graph->before && t == graph->input))
            continue;
        if (lull_graph_is_local(graph, t))
            ring->rows = 0;
        ring->dtype = (unsigned)lull_graph_dtype(graph, t) & 3u;
        ring->channels = lull_graph_channels(graph, t) & 0x7ffu;
        ring->level = lull_graph_level(graph, t) & 7u;
        ring->has_planes = planes != 0;
        width = plan->row_width >> ring->level;
        row = row_bytes(plan, ring);
        if (planes) { /* of floats */
            plan->plane_units[ring->level] = (uint16_t)(row / LULL_ALIGN);
            row = row * ring->channels + (size_t)(planes - 1) * lull_align_up(width, LULL_ALIGN);
            row |= LULL_ALIGN;
        }
        ring->row_units = (uint32_t)(row / LULL_ALIGN) & 0x3fffffffu;
        ring->offset = (uint32_t)(lull_append(total, row * ring->rows) / LULL_ALIGN);
        longest = longest > row || !ring->rows ? longest : row;
    }
    plan->ring[graph->input] = plan->ring[LULL_TENSOR_INPUT]; /* the same memory */
    return longest;
}

/* Sizes everything for the strip width and row step set in the plan. */
static void layout(lull_plan *plan)
{
    const lull_graph *graph = &plan->model->graph;
    size_t total = lull_align_up(sizeof *plan, LULL_ALIGN), saved = 0, longest, bins;
    plan->strips = plan->width ? (plan->width + plan->strip_width - 1) / plan->strip_width : 0;
    plan->row_width = lull_min_u(plan->strip_width + 2 * graph->margin, plan->width);
    if (plan->played != plan->row_step)
        play(plan);
    longest = layout_rings(plan, &total);
    plan->zero_row = (uint32_t)(lull_append(&total, longest) / LULL_ALIGN);
    plan->scratch_bytes = graph->before ? LULL_GRAIN_WORK : LULL_BLOCK * 9 * sizeof(float);
    for (unsigned l = 0; l < graph->layers; l++) {
        size_t bytes = 0;
        lull_points points;
        if (graph->layer[l].is_winograd || lull_plan_is_patched(plan, l))
            bytes = lull_plan_points(&points, plan, l);
        else if (lull_graph_is_local(graph, l + 1))
            bytes =
                LULL_SCRATCH_LOCAL + lull_ring_pixel(&plan->ring[l + 1]) * lull_plan_chunk(plan, l);
        else if (graph->layer[l].op == LULL_OP_FIT_SUMS)
            bytes = (3 * LULL_BLOCK + LULL_FIT_SUMS * LULL_FIT_BLOCK) * sizeof(float);
        else if (graph->layer[l].pool)
            bytes = 2 * lull_ring_pixel(&plan->ring[l + 1]) * lull_plan_chunk(plan, l);
        if (bytes > plan->scratch_bytes)
            plan->scratch_bytes = bytes;
    }
    plan->scratch_bytes = lull_align_up(plan->scratch_bytes, LULL_ALIGN);
    plan->scratch = lull_append(&total, plan->scratch_bytes * plan->threads);
    bins = lull_exposure_rows(plan->frame.height) * LULL_PLAN_BINS;
    plan->exposure = (uint32_t)(lull_append(&total, bins) / LULL_ALIGN);
    plan->saved_width = (uint16_t)(plan->frame.in_place && plan->strips > 1 ? graph->margin : 0);
    for (unsigned i = 0; i < LULL_LOADED; i++)
        if (lull_plan_has(plan, lull_loaded[i]))
            saved += lull_plan_pixel(plan, lull_loaded[i]);
    plan->saved = lull_append(&total, saved * plan->frame.height * plan->saved_width);
    plan->bytes = total;
}

/* The plan that needs least: in the narrowest strips or, as those of a plan in place keep columns
 * of the whole height, in one; with the row step that then needs least. */
LULL_NOINLINE static void layout_minimum(lull_plan *plan)
{
    const unsigned narrow = 1u << plan->model->graph.levels;
    unsigned best_step = 0, best_width = 0;
    size_t least = (size_t)-1;
    for (unsigned i = 0; i < (plan->frame.in_place ? 2 * STEP_COUNT : STEP_COUNT); i++) {
        plan->row_step = steps[i % STEP_COUNT];
        plan->strip_width = i < STEP_COUNT ? narrow : lull_max_u(plan->width, narrow);
        layout(plan);
        if (plan->bytes < least) {
            least = plan->bytes;
            best_step = plan->row_step;
            best_width = plan->strip_width;
        }
    }
    plan->row_step = best_step;
    plan->strip_width = best_width;
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

/* The first of `steps` to try. */
static unsigned first_step(const lull_plan *plan)
{
    const lull_graph *graph = &plan->model->graph;
    if (plan->threads > FEW_THREADS)
        return MANY_STEP;
    return graph->family == LULL_FAMILY_K && plan->model->kernels.patches_k != LULL_PATCHES_NONE &&
                   lull_graph_find(graph, LULL_OP_CORRECT) == LULL_TENSOR_NONE
               ? SMALL_STEP
               : FEW_STEP;
}

/* The row step asked for, but for what a frame has no rows for. */
static unsigned given_step(const lull_plan *plan)
{
    unsigned rows = lull_min_u(plan->frame.row_step, lull_min_u(plan->height, MOST_ROWS));
    return lull_max_u(rows, 1); /* of an empty frame */
}

/* Chooses row step and strip width: as asked for, else the fastest that fits. Strips compute their
 * overlaps twice, so small row steps are tried first. */
static lull_status choose(lull_plan *plan)
{
    const lull_frame *frame = &plan->frame;
    unsigned align = 1u << plan->model->graph.levels;
    size_t limit = frame->max_bytes ? frame->max_bytes : (size_t)-1;
    unsigned whole = lull_max_u(plan->width, align);
    for (unsigned i = first_step(plan); i < STEP_COUNT; i++) {
        plan->row_step = frame->row_step ? given_step(plan) : steps[i];
        plan->strip_width = whole;
        if (frame->strip_width)
            plan->strip_width =
                lull_min_u((unsigned)lull_align_up(frame->strip_width, align), whole);
        layout(plan);
        if (plan->bytes <= limit)
            return LULL_OK;
    }
    if (!frame->row_step)
        layout_minimum(plan); /* for its row step */
    if (!frame->strip_width && fit_strips(plan, limit))
        return LULL_OK;
    return LULL_ERROR_MEMORY;
}

/* 1 if the main image can be of that content: radiance is that of a colour, which alone has an
 * exposure; albedos may be encoded; normals are what they are. */
static int is_possible(lull_content content, unsigned features)
{
    if (features & LULL_HAS_COLOR || content == LULL_LDR)
        return 1;
    return content == LULL_SRGB && features & LULL_HAS_ALBEDO;
}

static lull_status start(lull_plan *plan, const lull_frame *frame, const lull_model *model)
{
    unsigned align, features = 0;
    if (!frame || !model || frame->width > LULL_MAX_SIZE || frame->height > LULL_MAX_SIZE ||
        (unsigned)frame->content >= LULL_CONTENT_COUNT || !(frame->features & 7) ||
        frame->features > 7 || frame->threads > 65536 || frame->strip_width > LULL_MAX_SIZE ||
        frame->trained_for > LULL_CONTENT_COUNT || !is_possible(frame->content, frame->features))
        return LULL_ERROR_ARGUMENT;
    for (unsigned i = 0; i < 3; i++)
        features += frame->features >> i & 1;
    if (frame->width && frame->height &&
        (model->graph.is_alone ? features > 1 || frame->features & LULL_HAS_COLOR
                               : model->graph.family == LULL_FAMILY_U &&
                                     3 * features != model->graph.inputs))
        return LULL_ERROR_FEATURES;
    align = 1u << model->graph.levels;
    memset(plan, 0, sizeof *plan);
    plan->model = model;
    plan->frame = *frame;
    plan->threads = lull_max_u(frame->threads, 1);
    plan->keeps_rows =
        model->graph.family == LULL_FAMILY_U || frame->in_place || frame->streamed;
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

/* What is wrong with a frame and a model; MEMORY if nothing is. */
LULL_NOINLINE static lull_status find_fault(const lull_frame *frame, const lull_model *model)
{
    lull_plan plan;
    lull_status status = start(&plan, frame, model);
    return status == LULL_OK ? LULL_ERROR_MEMORY : status;
}

lull_status lull_plan_init(lull_plan **plan, void *memory, size_t memory_bytes,
                           const lull_frame *frame, const lull_model *model)
{
    lull_plan *made = memory;
    lull_status status;
    if (!plan || (memory_bytes >= sizeof *made && (!memory || (uintptr_t)memory % LULL_ALIGN)))
        return LULL_ERROR_ARGUMENT;
    if (memory_bytes < sizeof *made) /* says why lull_plan_size is 0, whatever the memory */
        return find_fault(frame, model);
    status = start(made, frame, model);
    if (status == LULL_OK)
        status = choose(made);
    if (status != LULL_OK)
        return status;
    if (memory_bytes < made->bytes)
        return LULL_ERROR_MEMORY;
    memset((uint8_t *)memory + sizeof *made, 0, made->bytes - sizeof *made);
    lull_plan_set_done(made, 0, LULL_ROWS_IDLE);
    *plan = made;
    return LULL_OK;
}

void lull_plan_get_info(const lull_plan *plan, lull_plan_info *info)
{
    info->bytes = plan->bytes;
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
