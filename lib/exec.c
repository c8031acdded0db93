/* Runs a plan: rows in, every layer in turn, rows out. */
#include "exec.h"
#include "exposure.h"
#include "image.h"

static void parallel(const lull_plan *plan, const lull_host *host, unsigned count,
                     void (*body)(void *, unsigned, unsigned), lull_task *t)
{
    if (host && host->parallel_for && plan->threads > 1 && count > 1)
        host->parallel_for(host->user, count, body, t);
    else
        for (unsigned i = 0; i < count; i++)
            body(t, i, 0);
}

/* A loop over chunks of `rows` rows of `width` columns. */
static void make_rows(lull_task *t, const lull_host *host, unsigned rows, unsigned width,
                      void (*body)(void *, unsigned, unsigned))
{
    t->rows = rows;
    parallel(t->plan, host, rows * ((width + t->chunk - 1) / t->chunk), body, t);
}

/* Loads input rows up to `rows`, which images from row base_row on hold. */
static void load(lull_task *t, unsigned rows, unsigned base_row, const lull_host *host)
{
    t->first = lull_plan_done(t->plan, 0);
    t->base_row = base_row;
    t->chunk = lull_plan_band(t->plan);
    make_rows(t, host, rows - t->first, t->right - t->left, lull_exec_load);
    lull_plan_set_done(t->plan, LULL_TENSOR_INPUT, rows);
    lull_plan_set_done(t->plan, LULL_TENSOR_RADIANCE, rows);
    if (t->plan->keeps_rows)
        lull_plan_set_aux(t->plan, rows);
}

/* Albedo, guide and normal that are not kept come in when layer l is about to need them. */
static void load_aux(lull_task *t, unsigned l, const lull_host *host)
{
    lull_plan *plan = t->plan;
    unsigned rows;
    if (plan->keeps_rows || !lull_plan_brings(plan, l))
        return;
    rows = lull_plan_aux_rows(plan, l);
    t->chunk = lull_plan_band(plan);
    if (plan->model->graph.layer[l].op == LULL_OP_BILATERAL) {
        t->first = lull_plan_done(plan, LULL_TENSOR_GUIDE);
        make_rows(t, host, rows - t->first, t->right - t->left, lull_exec_guide);
    } else {
        t->first = lull_plan_done(plan, LULL_TENSOR_ALBEDO);
        if (lull_plan_has(plan, LULL_TENSOR_ALBEDO) || lull_plan_has(plan, LULL_TENSOR_NORMAL))
            make_rows(t, host, rows - t->first, t->right - t->left, lull_exec_spread);
    }
    lull_plan_bring(plan, l, rows);
}

/* How far the run is: the mean, over input, layers and output, of the parts of their rows that are
 * made. The choice of the scale, before them, counts as one more. */
static double fraction_done(const lull_task *t)
{
    const lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    double sum = 1 + (double)lull_plan_done(plan, 0) / plan->height;
    if (plan->stored == plan->frame.height) /* what is left of the layers is padding */
        sum = graph->layers + 3.0;
    else {
        for (unsigned l = 0; l < graph->layers; l++)
            sum += (double)lull_plan_done(plan, l + 1) /
                   (plan->height >> (graph->layer[l].level + graph->layer[l].pool));
        sum += (double)plan->stored / plan->frame.height;
    }
    return ((t->begin / plan->strip_width) + sum / (graph->layers + 3.0)) / plan->strips;
}

/* Tells the host how far the run is; 0 if it is to stop. */
static int keep_going(const lull_task *t, const lull_host *host)
{
    return !host || !host->progress || host->progress(host->user, fraction_done(t));
}

/* 1 if layer `next` needs nothing of the layers [first, next), but for the same part of those from
 * `chain` on that each of its parts may need. */
static int is_free(const lull_graph *graph, unsigned first, unsigned chain, unsigned next)
{
    const lull_layer *layer = &graph->layer[next];
    for (unsigned s = 0; s < LULL_MAX_SOURCES && layer->source[s] != LULL_TENSOR_NONE; s++)
        if (layer->source[s] > first && layer->source[s] <= next &&
            (layer->source[s] <= chain || layer->reads[s] != LULL_READS_ROW))
            return 0;
    return 1;
}

/* 1 if layer `next` can be made part by part after layer l, in the batch that began with `first`.
 */
static int is_local(const lull_plan *plan, unsigned first, unsigned l, unsigned next)
{
    const lull_graph *graph = &plan->model->graph;
    const lull_layer *a = &graph->layer[l], *b = &graph->layer[next];
    return a->level == b->level && !a->pool && !b->pool && lull_plan_rows(plan, l) == 1 &&
           lull_plan_rows(plan, next) == 1 && is_free(graph, first, l, next);
}

/* Takes the turn of layer l, and of those after it, before `end`, that can be made together with
 * it: their parts are then still in caches. Notes what will be done. */
static void take_turns(lull_group *g, lull_task *t, unsigned batch, unsigned l, unsigned end,
                       unsigned ready, const lull_host *host)
{
    lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    unsigned next = l + 1, width = (t->right - t->left) >> graph->layer[l].level;
    g->layer = l;
    g->first = lull_plan_done(plan, l + 1);
    g->rows = (ready - g->first) / lull_plan_rows(plan, l);
    g->chunk = lull_plan_chunk(plan, l);
    lull_plan_set_done(plan, l + 1, ready);
    for (; next < end && is_local(plan, batch, l, next); next++) {
        load_aux(t, next, host);
        if (lull_plan_done(plan, next + 1) != g->first || lull_plan_turn(plan, next) != ready)
            break;
        lull_plan_set_done(plan, next + 1, ready);
        g->chunk = lull_min_u(g->chunk, lull_plan_chunk(plan, next));
    }
    g->layers = next - l;
    g->chunks = (width + g->chunk - 1) / g->chunk;
    g->stores = next == graph->layers && plan->strips == 1 && plan->stored == g->first &&
                lull_plan_rows(plan, l) == 1 && !(lull_plan_edges(plan) > 0.0f);
}

/* Handing a loop to threads and waiting for them takes about as long as the blending of so many
 * pixels; a 5x5 mean takes as long as MEAN_COST of them, and coefficients or gains of a cell as
 * FIT_COST. */
#define SHORT_LOOP 2500u
#define MEAN_COST 4u
#define FIT_COST 32u

/* 1 if the groups are a few pixels of the filter, which one thread makes as fast as many. */
static int is_short(const lull_task *t)
{
    static const uint16_t cost_of[] = {[LULL_READS_ROW] = 1,
                                       [LULL_READS_3] = FIT_COST,
                                       [LULL_READS_5] = MEAN_COST,
                                       [LULL_READS_25] = 1,
                                       [LULL_READS_6] = FIT_COST,
                                       [LULL_READS_FINE] = 1,
                                       [LULL_READS_CELL] = LULL_CELL * LULL_CELL,
                                       [LULL_READS_8] = LULL_FIT_SIDE * LULL_FIT_SIDE};
    const lull_graph *graph = &t->plan->model->graph;
    unsigned cost = 0;
    for (const lull_group *g = t->group; g < t->group + t->groups; g++)
        for (unsigned l = g->layer; l < g->layer + g->layers; l++) {
            const lull_layer *layer = &graph->layer[l];
            if (lull_layer_is_conv(layer) || g->stores)
                return 0;
            cost += g->rows * ((t->right - t->left) >> layer->level) *
                    cost_of[layer->reads[0]];
        }
    return cost < SHORT_LOOP;
}

/* The turns of layers from l on, before `end`, that do not need each other, in one loop. Returns
 * the layer after them; graph->layers + 1 if the host cancels. */
static unsigned take_batch(lull_task *t, unsigned l, unsigned end, const lull_host *host)
{
    lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    unsigned batch = l, count = 0;
    t->groups = 0;
    while (l < end && t->groups < LULL_GROUPS && is_free(graph, batch, l, l)) {
        unsigned ready;
        lull_group *g = &t->group[t->groups];
        load_aux(t, l, host);
        ready = lull_plan_turn(plan, l);
        if (lull_plan_done(plan, l + 1) == ready) {
            l++;
            continue;
        }
        if (!t->groups && !keep_going(t, host))
            return graph->layers + 1;
        take_turns(g, t, batch, l, end, ready, host);
        count += g->rows * g->chunks;
        t->groups++;
        l += g->layers;
    }
    t->parts = count;
    parallel(plan, is_short(t) ? NULL : host, count, lull_exec_chunk, t);
    t->ahead += LULL_FETCH;
    if (t->groups && t->group[t->groups - 1].stores)
        plan->stored = lull_min_u(lull_plan_done(plan, graph->layers), plan->frame.height);
    return l;
}

/* Stores the rows of the frame that became ready. */
static void store(lull_task *t, const lull_host *host)
{
    lull_plan *plan = t->plan;
    unsigned ready = lull_plan_ready(plan, lull_plan_edges(plan) > 0.0f);
    ready = lull_min_u(ready, plan->frame.height);
    t->first = plan->stored;
    t->chunk = lull_plan_band(plan);
    make_rows(t, host, ready - t->first, t->end - t->begin, lull_exec_store);
    plan->stored = ready;
}

/* One turn of each layer of a stage, and of the output. Returns 0 if the host cancels. */
static int take_stage(lull_task *t, const lull_stage *stage, const lull_host *host)
{
    const unsigned layers = t->plan->model->graph.layers;
    for (unsigned l = stage->first; l < stage->end;) {
        l = take_batch(t, l, stage->end, host);
        if (l > layers)
            return 0;
    }
    if (stage->end < layers)
        return 1;
    if (!keep_going(t, host))
        return 0;
    store(t, host);
    return 1;
}

/* A step's turns of every layer; the output image begins with row base_row. Returns 0 if the host
 * cancels. */
static int advance(lull_task *t, unsigned base_row, const lull_host *host)
{
    lull_stage stage;
    t->base_row = base_row;
    for (unsigned l = 0; l < t->plan->model->graph.layers; l = stage.end) {
        stage = lull_plan_stage(t->plan, l);
        for (unsigned turn = 0; turn < stage.times; turn++)
            if (!take_stage(t, &stage, host))
                return 0;
    }
    return keep_going(t, host);
}

static void begin_strip(lull_plan *plan, lull_task *t, unsigned strip)
{
    const lull_graph *graph = &plan->model->graph;
    unsigned margin = graph->margin;
    t->begin = strip * plan->strip_width;
    t->end = lull_min_u(t->begin + plan->strip_width, plan->frame.width);
    t->left = t->begin > margin ? t->begin - margin : 0;
    t->right = lull_min_u((strip + 1) * plan->strip_width + margin, plan->width);
    t->base_row = 0;
    if (plan->strips > 1) /* rows of the strip before may have been longer */
        for (unsigned i = 0; i < LULL_TENSORS; i++)
            memset((uint8_t *)plan + (size_t)plan->ring[i].offset * LULL_ALIGN, 0,
                   (size_t)plan->ring[i].row_units * plan->ring[i].rows * LULL_ALIGN);
    lull_plan_restart(plan);
}

/* The images that the frame needs are there, with channel counts that fit. */
static lull_status check_images(const lull_plan *plan, const lull_images *images)
{
    unsigned main_channels = 0;
    for (unsigned feature = 0; feature < 3; feature++) {
        const lull_image *image = lull_exec_feature(images, feature);
        if (!(plan->frame.features >> feature & 1))
            continue;
        if (!image->data || image->channels < 1 || image->channels > 3 ||
            (unsigned)image->type > LULL_F16)
            return LULL_ERROR_IMAGE;
        if (!main_channels)
            main_channels = image->channels;
    }
    if (!images->output.data || images->output.channels != main_channels ||
        (unsigned)images->output.type > LULL_F16)
        return LULL_ERROR_IMAGE;
    return LULL_OK;
}

/* The output lies apart from the inputs, or in the place of some if the plan is made for that: each
 * pixel is then read, once and for all, before it is written. */
static lull_status check_overlap(const lull_plan *plan, const lull_images *images)
{
    unsigned width = plan->frame.width, height = plan->frame.height;
    for (unsigned feature = 0; feature < 3; feature++) {
        const lull_image *image = lull_exec_feature(images, feature);
        if (!(plan->frame.features >> feature & 1) ||
            !lull_image_overlaps(&images->output, image, width, height))
            continue;
        if (!plan->frame.in_place || !lull_image_is_in_place(&images->output, image, width, height))
            return LULL_ERROR_IMAGE;
    }
    return LULL_OK;
}

/* The rows of auto-exposure bins; afterwards those of calm cells are in their place. */
static void *exposure_rows(const lull_plan *plan)
{
    return (uint8_t *)plan + (size_t)plan->exposure * LULL_ALIGN;
}

static void exposure_task(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    const lull_plan *plan = t->plan;
    (void)worker;
    lull_exposure_bin_row((lull_exposure_row *)exposure_rows(plan) + index, &t->images->color,
                          plan->frame.width, plan->frame.height, index,
                          plan->model->kernels.luminance);
}

static float choose_scale(lull_task *t, const lull_host *host)
{
    lull_plan *plan = t->plan;
    unsigned rows = lull_exposure_rows(plan->frame.height);
    if (!lull_is_nan(t->images->input_scale))
        return t->images->input_scale;
    if (!lull_exec_content(&plan->frame).is_hdr)
        return 1.0f;
    parallel(plan, host, rows, exposure_task, t);
    return lull_exposure_scale(exposure_rows(plan), rows);
}

static void calm_task(void *context, unsigned index, unsigned worker)
{
    const lull_task *t = context;
    (void)worker;
    lull_exec_calm_row((lull_calm_row *)exposure_rows(t->plan) + index, t, index);
}

/* How calm the frame is, if that is given or known; NaN of pictures: there it is measured. What
 * is calm in other frames says nothing of the rest: light alone has no textures, and albedos and
 * normals are without noise where they are even, however few samples. */
static float known_calm(const lull_plan *plan, float given)
{
    const lull_content content = plan->frame.content;
    if (!lull_is_nan(given))
        return given;
    if (content == LULL_LIGHTMAP_HDR || content == LULL_LIGHTMAP_DIR)
        return -1.0f;
    return plan->frame.features & LULL_HAS_COLOR ? given : 0.0f;
}

static float zero_for_nan(float v) { return lull_is_nan(v) ? 0.0f : v; }

/* After the scale. */
static void choose_calm(lull_task *t, const lull_host *host)
{
    lull_plan *plan = t->plan;
    const lull_images *images = t->images;
    unsigned rows = lull_exposure_rows(plan->frame.height);
    int mixes = lull_graph_mixed_by(&plan->model->graph) != LULL_TENSOR_NONE;
    float calm = known_calm(plan, images->calm), ragged = images->ragged;
    int wants_calm = mixes && lull_is_nan(calm);
    int wants_ragged = mixes && lull_is_nan(ragged) && lull_plan_has(plan, LULL_TENSOR_ALBEDO);
    if (wants_calm || wants_ragged)
        parallel(plan, host, rows, calm_task, t);
    if (wants_calm)
        calm = lull_calm_share(exposure_rows(plan), rows);
    if (wants_ragged)
        ragged = lull_ragged_share(exposure_rows(plan), rows);
    plan->calm = zero_for_nan(calm);
    plan->ragged = zero_for_nan(ragged);
}

/* What is known of the whole frame: into the plan, which what looks at pixels goes by. */
static void look_over(lull_task *t, const lull_host *host)
{
    t->plan->scale = choose_scale(t, host);
    choose_calm(t, host);
}

/* Checks what a run is given; of an empty frame no image is needed. */
static lull_status begin(lull_task *t, lull_plan *plan, const lull_images *images)
{
    if (!plan || !images)
        return LULL_ERROR_ARGUMENT;
    t->plan = plan;
    t->images = images;
    return plan->frame.width && plan->frame.height ? check_images(plan, images) : LULL_OK;
}

lull_status lull_measure(lull_images *images, lull_plan *plan, const lull_host *host)
{
    lull_task t = {0};
    lull_status status = begin(&t, plan, images);
    float scale, calm, ragged; /* of the stream that may be under way */
    if (status != LULL_OK)
        return status;
    scale = plan->scale;
    calm = plan->calm;
    ragged = plan->ragged;
    look_over(&t, host);
    images->input_scale = plan->scale;
    images->calm = plan->calm;
    images->ragged = plan->ragged;
    plan->scale = scale;
    plan->calm = calm;
    plan->ragged = ragged;
    return LULL_OK;
}

lull_status lull_run(lull_plan *plan, const lull_images *images, const lull_host *host)
{
    lull_task t = {0};
    lull_status status = begin(&t, plan, images);
    if (status != LULL_OK || !plan->frame.width || !plan->frame.height)
        return status;
    status = check_overlap(plan, images);
    if (status != LULL_OK)
        return status;
    if (host && host->progress && !host->progress(host->user, 0.0))
        return LULL_CANCELLED;
    look_over(&t, host);
    for (unsigned strip = 0; strip < plan->strips; strip++) {
        begin_strip(plan, &t, strip);
        while (plan->stored < plan->frame.height) {
            const int loads = keep_going(&t, host);
            if (loads)
                load(&t, lull_min_u(lull_plan_done(plan, 0) + plan->row_step, plan->height), 0,
                     host);
            t.ahead = 0;
            if (!loads || !advance(&t, 0, host)) {
                lull_plan_set_done(plan, 0, LULL_ROWS_IDLE);
                return LULL_CANCELLED;
            }
        }
    }
    lull_plan_set_done(plan, 0, LULL_ROWS_IDLE);
    return LULL_OK;
}

lull_status lull_rows_begin(lull_plan *plan, float input_scale, float calm, float ragged)
{
    lull_task t = {0};
    if (!plan)
        return LULL_ERROR_ARGUMENT;
    if (plan->strips > 1 || !plan->keeps_rows)
        return LULL_ERROR_UNSUPPORTED;
    t.plan = plan;
    begin_strip(plan, &t, 0);
    plan->scale = lull_is_nan(input_scale) ? 1.0f : input_scale;
    plan->calm = zero_for_nan(known_calm(plan, calm));
    plan->ragged = zero_for_nan(ragged);
    return LULL_OK;
}

lull_status lull_rows(lull_plan *plan, const lull_images *images, unsigned rows, unsigned *ready,
                      const lull_host *host)
{
    lull_task t = {0};
    unsigned input_base, store_base, last, loaded;
    lull_status status;
    if (!plan || !images || !ready)
        return LULL_ERROR_ARGUMENT;
    input_base = lull_plan_done(plan, 0);
    if (input_base == LULL_ROWS_IDLE || input_base > plan->frame.height ||
        rows > plan->frame.height - input_base)
        return LULL_ERROR_ARGUMENT;
    *ready = 0;
    if (!plan->frame.width || !rows)
        return LULL_OK;
    status = check_images(plan, images);
    if (status != LULL_OK)
        return status;
    t.plan = plan;
    t.images = images;
    t.end = plan->frame.width;
    t.right = plan->width;
    t.ahead = LULL_NOT_AHEAD; /* the next rows are not here yet */
    store_base = plan->stored;
    last = input_base + rows == plan->frame.height ? plan->height : input_base + rows;
    do { /* turns are taken where lull_run's are: the rings were sized for those */
        unsigned next = (lull_plan_done(plan, 0) / plan->row_step + 1) * plan->row_step;
        load(&t, lull_min_u(next, last), input_base, host);
        loaded = lull_plan_done(plan, 0);
        if ((loaded % plan->row_step == 0 || loaded == plan->height) &&
            !advance(&t, store_base, host)) {
            lull_plan_set_done(plan, 0, LULL_ROWS_IDLE);
            return LULL_CANCELLED;
        }
    } while (loaded < last || (last == plan->height && plan->stored < plan->frame.height));
    *ready = plan->stored - store_base;
    if (last == plan->height)
        lull_plan_set_done(plan, 0, LULL_ROWS_IDLE);
    return LULL_OK;
}
