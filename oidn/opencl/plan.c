/* Plans and runs of OpenCL devices. The host loads and stores pixels through the core, as on the
 * CPU; between them the kernels work on the whole frame, or, where memory does not suffice, on
 * tiles whose overlap makes them exact. */
#include "opencl.h"

#include "../../lib/exposure.h"
#include "../../lib/image.h"

#include <string.h>

/* Working memory where nothing else limits it: more makes larger tiles than are of use. */
#define MOST_BYTES ((uint64_t)2 << 30)

struct lull_engine_plan {
    lull_plan host; /* without rings: what the core's functions for pixels ask for */
    lull_opencl *cl;
    cl_memory memory, model;
    unsigned tile_width, tile_height; /* of output, multiples of the alignment */
    unsigned tiles;
    uint64_t bytes; /* of working memory and model */
    lull_cl_weights weights[LULL_MAX_LAYERS];
    lull_cl_schedule schedule;
};

/* ---- Sizes ----------------------------------------------------------------------------------- */

/* Bytes of tiles of that much output, for the largest of which the schedule is then made. */
static uint64_t tile_bytes(lull_engine_plan *plan, unsigned width, unsigned height)
{
    const unsigned overlap = 2 * plan->host.model->graph.margin;

    lull_cl_schedule_make(&plan->schedule, lull_min_u(width + overlap, plan->host.frame.width),
                          lull_min_u(height + overlap, plan->host.frame.height));
    return plan->schedule.bytes;
}

/* Side of tiles, so many of them in a row or column. */
static unsigned tile_side(unsigned side, unsigned count, unsigned align)
{
    return (unsigned)lull_align_up(lull_cell_count(count, side), align);
}

/* As few and as equal tiles as fit: one more along their longer side until they do. */
static bool choose_tiles(lull_engine_plan *plan, uint64_t model_bytes, lull_fault *fault)
{
    const lull_frame *frame = &plan->host.frame;
    const unsigned align = 1u << plan->host.model->graph.levels;
    uint64_t most = plan->cl->most_bytes < MOST_BYTES ? plan->cl->most_bytes : MOST_BYTES;
    unsigned columns = 1, rows = 1;

    if (frame->max_bytes && frame->max_bytes < most + model_bytes)
        most = frame->max_bytes - model_bytes; /* set_limits has asked for the minimum */
    if (frame->strip_width) { /* the overlap then costs about as much again */
        columns = lull_cell_count(2 * frame->strip_width, plan->host.width);
        rows = lull_cell_count(2 * frame->strip_width, plan->host.height);
    }
    for (;;) {
        plan->tile_width = tile_side(plan->host.width, columns, align);
        plan->tile_height = tile_side(plan->host.height, rows, align);
        if (tile_bytes(plan, plan->tile_width, plan->tile_height) <= most)
            break;
        if (lull_max_u(plan->tile_width, plan->tile_height) == align)
            return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY,
                             "the OpenCL device %s needs blocks of %llu bytes for this filter",
                             plan->cl->name, (unsigned long long)plan->schedule.bytes);
        if (plan->tile_width > plan->tile_height)
            columns++;
        else
            rows++;
    }
    plan->bytes = plan->schedule.bytes + model_bytes;
    plan->tiles = lull_cell_count(plan->tile_width, plan->host.width) *
                  lull_cell_count(plan->tile_height, plan->host.height);
    return true;
}

/* ---- Plans ----------------------------------------------------------------------------------- */

/* Fills in the host's part, and what the schedule depends on beside sizes. */
static void start(lull_engine_plan *plan, lull_opencl *cl, const lull_frame *frame,
                  const lull_model *model)
{
    const unsigned align = 1u << model->graph.levels;
    const size_t end = lull_align_up(sizeof *plan, LULL_ALIGN);

    memset(plan, 0, sizeof *plan);
    plan->cl = cl;
    plan->host.model = model;
    plan->host.frame = *frame;
    plan->host.threads = lull_max_u(frame->threads, 1);
    plan->host.keeps_rows = 1;
    plan->host.width = (unsigned)lull_align_up(frame->width, align);
    plan->host.height = (unsigned)lull_align_up(frame->height, align);
    plan->host.exposure = (uint32_t)(end / LULL_ALIGN);
    plan->schedule.graph = &model->graph;
    plan->schedule.weights = plan->weights;
    if (frame->features & LULL_HAS_COLOR && frame->features & LULL_HAS_ALBEDO)
        plan->schedule.flags |= LULL_CL_ALBEDO;
    if (frame->features & LULL_HAS_NORMAL && frame->features != LULL_HAS_NORMAL)
        plan->schedule.flags |= LULL_CL_NORMAL;
    if (!lull_exec_content(&plan->host.frame).is_hdr)
        plan->schedule.flags |= LULL_CL_CLIPPED;
    if (frame->clean_aux)
        plan->schedule.flags |= LULL_CL_CLEAN;
    if (model->graph.is_alone)
        plan->schedule.flags |= LULL_CL_ALONE;
}

/* The frame and the model, as the core checks them: of a plan that it makes only the head fits, so
 * that it gets as far as finding too little memory. */
static bool check(lull_engine_plan *plan, const lull_frame *frame, const lull_model *model,
                  lull_fault *fault)
{
    lull_plan *none;
    lull_status status;

    if (!model->graph.is_integer)
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                         "unsupported weights: OpenCL devices run integer networks only; use a "
                         "CPU device for networks in floating point");
    status = lull_plan_init(&none, &plan->host, sizeof plan->host, frame, model);
    return status == LULL_ERROR_MEMORY ||
           lull_check_plan(fault, status, frame, model);
}

static lull_engine_plan *allocate(lull_engine *engine, const lull_frame *frame,
                                  const lull_model *model, lull_fault *fault)
{
    const size_t rows = lull_exposure_rows(frame->height) * LULL_PLAN_BINS;
    lull_engine_plan *plan = lull_os_alloc_zero(lull_align_up(sizeof *plan, LULL_ALIGN) + rows);

    if (!plan) {
        lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
        return NULL;
    }
    if (check(plan, frame, model, fault)) {
        start(plan, (lull_opencl *)engine, frame, model);
        return plan;
    }
    lull_os_free(plan);
    return NULL;
}

uint64_t lull_cl_plan_minimum(lull_engine *engine, const lull_frame *frame,
                              const lull_model *model, lull_fault *fault)
{
    lull_engine_plan *plan = allocate(engine, frame, model, fault);
    uint64_t bytes = 0;

    if (plan) {
        const unsigned align = 1u << model->graph.levels;

        bytes = lull_cl_layout(plan->weights, model);
        bytes += tile_bytes(plan, align, align);
    }
    lull_os_free(plan);
    return bytes;
}

/* The device's memory, with the model in it. */
static bool make_memory(lull_engine_plan *plan, size_t model_bytes, lull_fault *fault)
{
    const lull_cl_api *api = &plan->cl->api;
    uint8_t *packed = lull_os_alloc_zero(model_bytes);
    int32_t error = CL_OUT_OF_HOST_MEMORY;

    if (packed) {
        lull_cl_pack(packed, plan->weights, plan->host.model);
        plan->model = api->clCreateBuffer(plan->cl->context,
                                          CL_MEM_READ_ONLY | CL_MEM_COPY_HOST_PTR, model_bytes,
                                          packed, &error);
    }
    lull_os_free(packed);
    if (error == CL_SUCCESS)
        plan->memory = api->clCreateBuffer(plan->cl->context, CL_MEM_READ_WRITE,
                                           (size_t)(plan->bytes - model_bytes), NULL, &error);
    return lull_cl_check(fault, error, "clCreateBuffer");
}

lull_engine_plan *lull_cl_plan_new(lull_engine *engine, const lull_frame *frame,
                                   const lull_model *model, lull_fault *fault)
{
    lull_engine_plan *plan = allocate(engine, frame, model, fault);
    size_t model_bytes;

    if (!plan)
        return NULL;
    if (!frame->width || !frame->height) /* never run */
        return plan;
    model_bytes = lull_cl_layout(plan->weights, model);
    if (lull_cl_check_process(plan->cl, fault) && choose_tiles(plan, model_bytes, fault) &&
        make_memory(plan, model_bytes, fault))
        return plan;
    lull_cl_plan_free(plan);
    return NULL;
}

void lull_cl_plan_free(lull_engine_plan *plan)
{
    if (plan && plan->cl->process == lull_process_id()) {
        if (plan->memory)
            plan->cl->api.clReleaseMemObject(plan->memory);
        if (plan->model)
            plan->cl->api.clReleaseMemObject(plan->model);
    }
    lull_os_free(plan);
}

void lull_cl_plan_get_info(const lull_engine_plan *plan, lull_plan_info *info)
{
    memset(info, 0, sizeof *info);
    info->bytes = (size_t)plan->bytes;
    info->row_step = plan->tile_height;
    info->strip_width = plan->tile_width;
    info->strips = plan->tiles;
}

/* ---- Runs ------------------------------------------------------------------------------------ */

/* What is under way: a tile. */
typedef struct run {
    lull_engine_plan *plan;
    lull_task task;
    const lull_images *images;
    const lull_host *host;
    lull_fault *fault;
    unsigned tile;                    /* number of it */
    unsigned left, top;               /* of all that it needs */
    unsigned begin_x, end_x, begin_y; /* of its output */
    unsigned feature;                 /* the image that is loaded */
    uint8_t tensor[2];                /* those that the host sees, and ... */
    uint8_t *pixels[2];               /* ... their pixels (0, 0) */
} run;

/* Pixel (x, y) of one of the two tensors. */
static uint8_t *pixel_at(const run *r, unsigned i, long x, long y)
{
    const lull_cl_tensor *t = &r->plan->schedule.tensor[r->tensor[i]];

    return r->pixels[i] + y * (long)t->pitch + x * (long)t->pixel;
}

static float *floats_at(const run *r, unsigned x, unsigned y)
{
    return (float *)(void *)pixel_at(r, 0, (long)x, (long)y);
}

/* ---- Rows of tensors ------------------------------------------------------------------------- */

/* Of an image for a network of family K. */
static void load_image(void *context, unsigned y, unsigned worker)
{
    const run *r = context;
    const unsigned n = (unsigned)r->plan->schedule.width;
    float *to = floats_at(r, 0, y);
    lull_encoding from;

    (void)worker;
    if (r->feature == 0) {
        lull_exec_main(&from, &r->task, to, r->left, r->top + y, n);
    } else {
        const float *pixels = lull_exec_aux(&r->task, r->feature, to, r->left, r->top + y, n);

        if (pixels != to)
            memcpy(to, pixels, n * 3 * sizeof *to);
    }
}

static void store_image(void *context, unsigned index, unsigned worker)
{
    const run *r = context;
    const unsigned y = r->begin_y + index, n = r->end_x - r->begin_x;
    float *from = floats_at(r, r->begin_x - r->left, y - r->top);

    (void)worker;
    lull_exec_finish(from, &r->plan->host, r->images->output.channels, n);
    lull_image_store(&r->images->output, r->plan->host.frame.width, r->begin_x, y, n, from);
}

/* Of the input of a U network, its border included: zeros all around. */
static void load_codes(void *context, unsigned index, unsigned worker)
{
    const run *r = context;
    const lull_cl_schedule *s = &r->plan->schedule;
    const long y = (long)index - LULL_CL_BORDER;
    float block[3 * LULL_BLOCK];
    lull_direct row;
    int32_t x, n;
    unsigned i;

    (void)worker;
    for (i = 0; i < 2 && r->pixels[i]; i++) {
        const size_t pitch = s->tensor[r->tensor[i]].pitch;

        memset(pixel_at(r, i, 0, y) - s->extent[r->tensor[i]].before % pitch, 0, pitch);
    }
    for (x = 0; y >= 0 && y < s->height && x < s->width; x += n) {
        n = (int32_t)lull_min_u(LULL_BLOCK, (unsigned)(s->width - x));
        for (i = 0; i < 2; i++) {
            row.pixel[i] = s->tensor[r->tensor[i]].pixel;
            row.to[i] = r->pixels[i] ? pixel_at(r, i, x, y) : NULL;
        }
        lull_exec_direct(&r->task, &row, block, r->left + (unsigned)x, r->top + (unsigned)y,
                         (unsigned)n);
    }
}

static void store_codes(void *context, unsigned index, unsigned worker)
{
    const run *r = context;
    const unsigned y = r->begin_y + index;
    float block[3 * LULL_BLOCK];
    unsigned x, n;

    (void)worker;
    for (x = r->begin_x; x < r->end_x; x += n) {
        n = lull_min_u(LULL_BLOCK, r->end_x - x);
        lull_exec_output(r->plan->host.model, block,
                         pixel_at(r, 0, (long)(x - r->left), (long)(y - r->top)),
                         r->plan->schedule.tensor[r->tensor[0]].pixel, n);
        lull_exec_finish(block, &r->plan->host, r->images->output.channels, n);
        lull_image_store(&r->images->output, r->plan->host.frame.width, x, y, n, block);
    }
}

/* ---- Tiles ----------------------------------------------------------------------------------- */

/* Calls body for each of `count` rows, on several threads if the host has them. */
static void for_rows(run *r, unsigned count, void (*body)(void *, unsigned, unsigned))
{
    unsigned i;

    if (r->host->parallel_for)
        r->host->parallel_for(r->host->user, count, body, r);
    else
        for (i = 0; i < count; i++)
            body(r, i, 0);
}

/* Lets the host fill a tensor, or take one, row by row; or two, unless the second is NONE. */
static bool with_tensors(run *r, unsigned first, unsigned second, unsigned rows, uint64_t flags,
                         void (*body)(void *, unsigned, unsigned))
{
    const lull_cl_api *api = &r->plan->cl->api;
    const lull_cl_schedule *s = &r->plan->schedule;
    const unsigned tensors[2] = {first, second};
    uint8_t *mapped[2] = {NULL, NULL};
    int32_t error = CL_SUCCESS;
    unsigned i;

    for (i = 0; i < 2; i++) {
        r->tensor[i] = 0;
        r->pixels[i] = NULL;
        if (tensors[i] == LULL_TENSOR_NONE || error != CL_SUCCESS)
            continue;
        mapped[i] = api->clEnqueueMapBuffer(
            r->plan->cl->queue, r->plan->memory, 1, flags,
            (size_t)(s->tensor[tensors[i]].at * (uint64_t)LULL_CL_UNIT -
                     s->extent[tensors[i]].before),
            (size_t)s->extent[tensors[i]].bytes, 0, NULL, NULL, &error);
        if (error != CL_SUCCESS)
            continue;
        r->tensor[i] = (uint8_t)tensors[i];
        r->pixels[i] = mapped[i] + s->extent[tensors[i]].before;
    }
    if (error == CL_SUCCESS)
        for_rows(r, rows, body);
    for (i = 0; i < 2; i++)
        if (r->pixels[i]) {
            const int32_t unmapped = api->clEnqueueUnmapMemObject(
                r->plan->cl->queue, r->plan->memory, mapped[i], 0, NULL, NULL);

            error = error == CL_SUCCESS ? unmapped : error;
        }
    return lull_cl_check(r->fault, error, "access to the device's memory");
}

static bool load_images(run *r)
{
    static const uint8_t tensors[3] = {LULL_TENSOR_RADIANCE, LULL_CL_IMAGE_ALBEDO,
                                       LULL_CL_IMAGE_NORMAL};
    static const uint32_t needs[3] = {0, LULL_CL_ALBEDO, LULL_CL_NORMAL};
    const lull_graph *graph = &r->plan->host.model->graph;
    const unsigned rows = (unsigned)r->plan->schedule.height;
    const unsigned all_rows = (unsigned)(r->plan->schedule.extent[LULL_TENSOR_INPUT].bytes /
                                         r->plan->schedule.tensor[LULL_TENSOR_INPUT].pitch);
    const uint32_t flags = r->plan->schedule.flags;

    if (graph->family == LULL_FAMILY_U)
        return with_tensors(r, LULL_TENSOR_INPUT, graph->aux ? LULL_TENSOR_AUX : LULL_TENSOR_NONE,
                            all_rows,
                            CL_MAP_WRITE_INVALIDATE_REGION, load_codes);
    for (r->feature = 0; r->feature < 3; r->feature++)
        if ((flags & needs[r->feature]) == needs[r->feature] &&
            !with_tensors(r, tensors[r->feature], LULL_TENSOR_NONE, rows,
                          CL_MAP_WRITE_INVALIDATE_REGION, load_image))
            return false;
    return true;
}

static bool store_result(run *r, unsigned rows)
{
    const lull_graph *graph = &r->plan->host.model->graph;

    if (graph->family == LULL_FAMILY_U)
        return with_tensors(r, graph->layers, LULL_TENSOR_NONE, rows, CL_MAP_READ, store_codes);
    return with_tensors(r, LULL_CL_IMAGE_RESULT, LULL_TENSOR_NONE, rows, CL_MAP_READ | CL_MAP_WRITE,
                        store_image);
}

static bool enqueue(run *r, const lull_cl_step *step)
{
    const lull_engine_plan *plan = r->plan;
    const lull_cl_api *api = &plan->cl->api;
    const cl_kernel kernel = plan->cl->kernel[step->kernel];

    return lull_cl_check(r->fault,
                         api->clSetKernelArg(kernel, 0, sizeof plan->memory, &plan->memory),
                         "clSetKernelArg") &&
           lull_cl_check(r->fault,
                         api->clSetKernelArg(kernel, 1, sizeof plan->model, &plan->model),
                         "clSetKernelArg") &&
           lull_cl_check(r->fault, api->clSetKernelArg(kernel, 2, step->args_bytes, &step->args),
                         "clSetKernelArg") &&
           lull_cl_check(r->fault,
                         api->clEnqueueNDRangeKernel(plan->cl->queue, kernel, 3, NULL, step->global,
                                                     step->local, 0, NULL, NULL),
                         "clEnqueueNDRangeKernel");
}

/* Tells the host that a part of the present tile is done. Returns 0 if it is to stop. */
static int keep_going(const run *r, double part)
{
    return !r->host->progress ||
           r->host->progress(r->host->user, (r->tile + part) / r->plan->tiles);
}

/* All kernels; where somebody watches, one after the other. */
static lull_status run_steps(run *r)
{
    const lull_cl_schedule *s = &r->plan->schedule;
    const lull_cl_api *api = &r->plan->cl->api;
    unsigned i;

    for (i = 0; i < s->steps; i++) {
        if (!keep_going(r, (i + 1.0) / (s->steps + 2.0)))
            return LULL_CANCELLED;
        if (!enqueue(r, &s->step[i]) ||
            (r->host->progress &&
             !lull_cl_check(r->fault, api->clFinish(r->plan->cl->queue), "clFinish")))
            return LULL_ERROR_UNSUPPORTED;
    }
    return keep_going(r, (s->steps + 1.0) / (s->steps + 2.0)) ? LULL_OK : LULL_CANCELLED;
}

static lull_status run_tile(run *r, unsigned x, unsigned y)
{
    lull_engine_plan *plan = r->plan;
    const lull_frame *frame = &plan->host.frame;
    const unsigned margin = plan->host.model->graph.margin;
    const unsigned end_y = lull_min_u(y + plan->tile_height, frame->height);
    lull_status status;

    r->begin_x = x;
    r->begin_y = y;
    r->end_x = lull_min_u(x + plan->tile_width, frame->width);
    r->left = x > margin ? x - margin : 0;
    r->top = y > margin ? y - margin : 0;
    lull_cl_schedule_resize(&plan->schedule,
                            lull_min_u(x + plan->tile_width + margin, frame->width) - r->left,
                            lull_min_u(y + plan->tile_height + margin, frame->height) - r->top);
    if (!load_images(r))
        return LULL_ERROR_UNSUPPORTED;
    status = run_steps(r);
    if (status == LULL_OK && !store_result(r, end_y - y))
        return LULL_ERROR_UNSUPPORTED;
    return status;
}

lull_status lull_cl_run(lull_engine_plan *plan, const lull_images *images, const lull_host *host,
                        lull_fault *fault)
{
    run r = {0};
    lull_images known = *images;
    lull_status status;
    unsigned x, y;

    if (!lull_cl_check_process(plan->cl, fault))
        return LULL_ERROR_UNSUPPORTED;
    r.plan = plan;
    r.images = &known;
    r.host = host;
    r.fault = fault;
    r.task.plan = &plan->host;
    r.task.images = &known;
    status = lull_measure(&known, &plan->host, host);
    plan->host.scale = known.input_scale; /* what the core loads and stores pixels with */
    plan->host.calm = plan->schedule.calm = known.calm;
    plan->host.ragged = plan->schedule.ragged = known.ragged;
    for (y = 0; y < plan->host.frame.height && status == LULL_OK; y += plan->tile_height)
        for (x = 0; x < plan->host.frame.width && status == LULL_OK; x += plan->tile_width) {
            status = run_tile(&r, x, y);
            r.tile++;
        }
    if (!lull_cl_check(fault, plan->cl->api.clFinish(plan->cl->queue), "clFinish"))
        return LULL_ERROR_UNSUPPORTED;
    return status;
}
