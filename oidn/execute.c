/* Running a committed filter: what is queued, and what the queue's thread then does. */
#include "../lib/pack.h" /* first: Windows defines near and far */
#include "internal.h"

#include "../lib/image.h"

#include <math.h>
#include <string.h>

#define SOME 64u /* pixels copied together */

/* What lull_run gets as `user`. */
typedef struct run_state {
    const lull_job *job;
    lull_pool *pool;
    double told; /* fraction that the progress function was last told */
} run_state;

static void parallel_for(void *user, unsigned count,
                         void (*body)(void *context, unsigned index, unsigned worker),
                         void *context)
{
    lull_pool_for(((run_state *)user)->pool, count, body, context);
}

/* Passes on what comes between 0 and 1 (these two are told by run_filter), no more than about 250
 * times a frame. */
static int progress(void *user, double fraction)
{
    run_state *state = user;

    if (!(fraction >= state->told + 0.004) || !(fraction < 1))
        return 1;
    state->told = fraction;
    return state->job->progress(state->job->progress_user, fraction);
}

static void share_loop(void *user, unsigned count,
                       void (*body)(void *context, unsigned index, unsigned worker), void *context)
{
    const lull_host *whole = ((lull_host_part *)user)->whole;

    whole->parallel_for(whole->user, count, body, context);
}

static int pass_progress(void *user, double fraction)
{
    const lull_host_part *part = user;

    return part->whole->progress(part->whole->user, part->begin + part->size * fraction);
}

lull_host lull_host_of_part(lull_host_part *part, const lull_host *whole, double begin, double size)
{
    lull_host host = {part, share_loop, whole->progress ? pass_progress : NULL};

    part->whole = whole;
    part->begin = begin;
    part->size = size;
    return host;
}

/* The staged output to where it belongs. */
static void copy_stage(const lull_image *to, const lull_image *stage, unsigned width,
                       unsigned height)
{
    float block[3 * SOME];
    unsigned x, y, n;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x += n) {
            n = lull_min_u(SOME, width - x);
            lull_image_load(block, stage, width, x, y, n);
            lull_image_store(to, width, x, y, n, block);
        }
}

/* The scale that was given, but for networks of kernel prediction no farther from the automatic one
 * than two stops: they see light in 255 steps, and next to nothing of what is far too dark. What
 * comes out is divided by it again. */
#define MOST_APART 4.0f

static float visible_scale(OIDNFilter filter, const lull_images *images, const lull_host *host)
{
    const float given = images->input_scale;
    lull_images measured = *images;

    if (filter->model->graph.family != LULL_FAMILY_K || !(given > 0) ||
        (filter->frame.content != LULL_HDR && filter->frame.content != LULL_LIGHTMAP_HDR) ||
        !(filter->frame.features & LULL_HAS_COLOR))
        return given;
    measured.input_scale = NAN;
    measured.calm = measured.ragged = 0; /* not asked for */
    if (!filter->plan)
        measured.input_scale =
            lull_autoexposure(&images->color, filter->frame.width, filter->frame.height);
    else if (lull_measure(&measured, filter->plan, host) != LULL_OK)
        return given;
    if (!(measured.input_scale > 0)) /* none is small enough */
        return given;
    return given < measured.input_scale / MOST_APART   ? measured.input_scale / MOST_APART
           : given > measured.input_scale * MOST_APART ? measured.input_scale * MOST_APART
                                                       : given;
}

/* The inputs in the place of those given, where there must be others. */
static lull_status make_inputs(OIDNFilter filter, lull_images *images, const lull_host *host)
{
    const lull_pictures *pictures = &filter->pictures;
    char *memory = filter->pictures_memory;

    if (!pictures->inputs_bytes)
        return LULL_OK;
    memory += pictures->staged_bytes + pictures->turned_bytes;
    if (pictures->is_filled)
        return lull_lightmap_inputs(images, &filter->frame, memory);
    lull_panorama_inputs(images, &filter->frame, pictures->border, memory, host);
    return LULL_OK;
}

static void run_filter(const lull_job *job, lull_fault *fault)
{
    OIDNFilter filter = job->filter;
    run_state state = {job, filter->device->pool, 0};
    lull_host host = {&state, parallel_for, job->progress ? progress : NULL};
    lull_images images = job->images;
    const unsigned border = filter->pictures.border;
    OIDNQuality quality = job->quality;
    lull_status status;

    if (job->progress && !job->progress(job->progress_user, 0)) {
        lull_fail_status(fault, LULL_CANCELLED, "filter");
        return;
    }
    if (filter->pictures.staged_bytes)
        images.output = lull_tight_image(
            &images.output, filter->pictures.orientations > 1 ? LULL_F32 : images.output.type,
            &filter->frame, filter->pictures_memory);
    lull_pool_enter(state.pool);
    status = make_inputs(filter, &images, &host);
    if (status == LULL_OK) {
        images.input_scale = visible_scale(filter, &images, &host);
        status = lull_ensemble_run(filter, &images, &host, &quality, fault);
    }
    lull_pool_leave(state.pool);
    if (status == LULL_OK && filter->pictures.staged_bytes) {
        const lull_image inside = lull_panorama_inside(&images.output, &filter->frame, border);

        copy_stage(&job->images.output, &inside, filter->frame.width - 2 * border,
                   filter->frame.height - 2 * border);
    }
    if (status == LULL_OK)
        lull_atomic_store(&filter->used, (uint32_t)quality);
    if (status == LULL_OK && job->progress)
        job->progress(job->progress_user, 1);
    lull_fail_status(fault, status, "filter");
}

static void run_nothing(const lull_job *job, lull_fault *fault)
{
    (void)job;
    (void)fault;
}

bool lull_filter_make_job(OIDNFilter filter, lull_job *job, lull_fault *fault)
{
    const uint64_t number = filter->device->queue.tail + 1;
    const int quality = filter->values[lull_value_quality].i;
    unsigned i;

    if (filter->dirty)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "changes to the filter are not committed");
    memset(job, 0, sizeof *job);
    job->run = filter->frame.width && filter->frame.height ? run_filter : run_nothing;
    job->filter = filter;
    lull_atomic_add(&filter->refs, 1);
    job->images = filter->committed;
    job->quality = quality == LULL_QUALITY_AUTO ? OIDN_QUALITY_HIGH : (OIDNQuality)quality;
    job->progress = filter->progress;
    job->progress_user = filter->progress_user;
    for (i = 0; i < LULL_IMAGES; i++) {
        OIDNBuffer buffer = filter->committed_buffers[i];

        job->buffers[i] = buffer;
        lull_buffer_hold(buffer);
        if (buffer)
            buffer->last_job = number;
    }
    return true;
}
