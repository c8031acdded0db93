/* Quality `auto`: a ladder of models, from the smallest to the largest. They all denoise a sample
 * of the frame, and the smallest that agrees with the largest there denoises the frame.
 *
 * The sample is a grid of small windows, chosen from the frame's size alone. A window is a frame of
 * its own, with the scale of the whole one, so that a model does with it what it does with the
 * whole frame, but for the context that it lacks at its edges. */
#include "internal.h"

#include "../lib/exec_difference.h"

#include <string.h>

#define WINDOW 48u /* columns and rows of a window */
#define GRID 16u   /* windows begin at multiples of it, where the networks' coarsest pixels do */
#define SPACE 240u /* about one window in so many columns and rows: 4 % of the pixels */
#define MOST 8u    /* windows side by side; more would tell no more */
#define FEWEST 4u  /* windows in a frame: fewer would tell too little */
#define TIMES 10u  /* a frame has at least so many times their pixels: else they cost too much */

/* Models agree if their results differ by fewer display codes, root mean square: 0.4 % of white, or
 * 48 dB. docs/models.md has what that costs. */
#define AGREEMENT (LULL_DISPLAY_WHITE / 250)

/* Bytes of a model's result for a window. */
#define RESULT_BYTES (sizeof(float) * 3 * WINDOW * WINDOW)

/* Part of the run, as its progress is told, that the sample is. */
#define SAMPLE_PART 0.05

/* ---- Windows --------------------------------------------------------------------------------- */

static unsigned windows_along(unsigned size)
{
    const unsigned n = (size + SPACE / 2) / SPACE;

    return size < WINDOW ? 0 : n < 1 ? 1 : n > MOST ? MOST : n;
}

static unsigned count_windows(const lull_frame *frame)
{
    return windows_along(frame->width) * windows_along(frame->height);
}

static bool is_small(const lull_frame *frame)
{
    const uint64_t pixels = (uint64_t)frame->width * frame->height;
    const unsigned n = count_windows(frame);

    return n < FEWEST || pixels < (uint64_t)TIMES * n * WINDOW * WINDOW;
}

/* Whether differences that add up to `sum` over all windows are small enough. */
static bool agrees(uint64_t sum, const lull_frame *frame)
{
    const uint64_t values = (uint64_t)count_windows(frame) * WINDOW * WINDOW * 3;

    return sum < values * AGREEMENT * AGREEMENT;
}

/* Begin of window `index` of n along `size`: in the middle of the index-th of n equal parts. */
static unsigned window_begin(unsigned index, unsigned n, unsigned size)
{
    return ((2 * index + 1) * size / (2 * n) - WINDOW / 2) / GRID * GRID;
}

static lull_frame window_frame(const lull_frame *whole)
{
    lull_frame frame = lull_frame_default(WINDOW, WINDOW, whole->content, whole->features);

    frame.threads = whole->threads;
    frame.trained_for = whole->trained_for;
    return frame;
}

/* The window of an image of the frame, which has its strides. */
static lull_image crop(const lull_image *image, unsigned x, unsigned y)
{
    lull_image part = *image;

    if (part.data)
        part.data = (char *)part.data + y * part.row_stride + x * part.pixel_stride;
    return part;
}

/* ---- The ladder, at commits ------------------------------------------------------------------ */

/* Adds the built-in model of a quality, if it is one more and takes the images of the largest. */
static bool add_rung(lull_ladder *ladder, OIDNFilter filter, OIDNQuality quality,
                     const lull_frame *frame, const lull_model *largest, lull_fault *fault)
{
    const lull_model *model;
    lull_frame own = *frame;
    size_t bytes;

    if (!lull_builtin_select(filter->device, &own, filter->values[lull_value_clean_aux].i != 0,
                             quality, &model, &bytes, fault))
        return false;
    if (model == largest || own.features != frame->features ||
        own.trained_for != frame->trained_for ||
        (ladder->rungs && model == ladder->rung[ladder->rungs - 1].model))
        return true;
    ladder->rung[ladder->rungs].quality = quality;
    ladder->rung[ladder->rungs++].model = model;
    ladder->weights_bytes += bytes;
    return true;
}

size_t lull_ladder_plan_size(const lull_ladder *ladder, const lull_frame *frame)
{
    size_t most = 0;
    unsigned i;

    for (i = 0; i < ladder->rungs; i++) {
        const size_t bytes = lull_plan_size(frame, ladder->rung[i].model);

        if (!bytes)
            return 0;
        most = bytes > most ? bytes : most;
    }
    return most;
}

bool lull_ladder_find(lull_ladder *ladder, OIDNFilter filter, const lull_frame *frame,
                      const lull_model *model, lull_fault *fault)
{
    const lull_frame window = window_frame(frame);

    memset(ladder, 0, sizeof *ladder);
    if (filter->values[lull_value_quality].i != LULL_QUALITY_AUTO || filter->weights_bytes ||
        filter->device->engine || is_small(frame))
        return true;
    if (!add_rung(ladder, filter, OIDN_QUALITY_FAST, frame, model, fault) ||
        !add_rung(ladder, filter, OIDN_QUALITY_BALANCED, frame, model, fault))
        return false;
    if (!ladder->rungs)
        return true;
    ladder->rung[ladder->rungs].quality = OIDN_QUALITY_HIGH;
    ladder->rung[ladder->rungs++].model = model;
    ladder->plan_bytes = lull_ladder_plan_size(ladder, &window);
    ladder->sample_bytes = ladder->plan_bytes + 2 * RESULT_BYTES;
    return true;
}

bool lull_ladder_same(const lull_ladder *a, const lull_ladder *b)
{
    unsigned i;

    for (i = 0; i < a->rungs && i < b->rungs; i++)
        if (a->rung[i].model != b->rung[i].model)
            return false;
    return a->rungs == b->rungs;
}

/* ---- The choice, at executions --------------------------------------------------------------- */

/* An execution, and which part of its progress the present run of a model is. */
typedef struct climb {
    OIDNFilter filter;
    const lull_host *host;
    double begin, part;
} climb;

static void share_loop(void *user, unsigned count,
                       void (*body)(void *context, unsigned index, unsigned worker), void *context)
{
    const lull_host *host = ((climb *)user)->host;

    host->parallel_for(host->user, count, body, context);
}

static int pass_progress(void *user, double fraction)
{
    const climb *c = user;

    return c->host->progress(c->host->user, c->begin + c->part * fraction);
}

/* lull_run as a part of the execution. */
static lull_status run_part(climb *c, lull_plan *plan, const lull_images *images)
{
    const lull_host host = {c, share_loop, c->host->progress ? pass_progress : NULL};
    const lull_status status = lull_run(plan, images, &host);

    c->begin += c->part;
    return status;
}

/* What a model makes of a window. */
static lull_status run_window(climb *c, const lull_images *window, const lull_model *model)
{
    const lull_frame frame = window_frame(&c->filter->frame);
    lull_plan *plan;
    lull_status status = lull_plan_init(&plan, c->filter->ladder.memory,
                                        c->filter->ladder.plan_bytes, &frame, model);

    return status == LULL_OK ? run_part(c, plan, window) : status;
}

/* Adds what sets each model that still agrees apart from the largest in a window. *agreeing: how
 * many of them still do after it. */
static lull_status compare(climb *c, uint64_t sums[LULL_RUNGS], const lull_images *window,
                           unsigned *agreeing)
{
    const lull_ladder *ladder = &c->filter->ladder;
    const lull_frame frame = window_frame(&c->filter->frame);
    const unsigned largest = ladder->rungs - 1;
    lull_images theirs = *window, best = *window;
    lull_status status;
    unsigned i;

    best.output.data = (char *)ladder->memory + ladder->plan_bytes;
    theirs.output.data = (char *)best.output.data + RESULT_BYTES;
    status = run_window(c, &best, ladder->rung[largest].model);
    *agreeing = 0;
    for (i = 0; i < largest && status == LULL_OK; i++) {
        if (!agrees(sums[i], &c->filter->frame))
            continue;
        status = run_window(c, &theirs, ladder->rung[i].model);
        if (status == LULL_OK)
            sums[i] += lull_difference(&theirs.output, &best.output, &frame, window->input_scale);
        *agreeing += agrees(sums[i], &c->filter->frame);
    }
    return status;
}

/* Finds the smallest model that agrees with the largest on all windows together. */
static lull_status choose(climb *c, const lull_images *images, unsigned *rung)
{
    const lull_ladder *ladder = &c->filter->ladder;
    const lull_frame *frame = &c->filter->frame;
    const unsigned across = windows_along(frame->width), n = count_windows(frame);
    uint64_t sums[LULL_RUNGS] = {0};
    unsigned i, first = 0, agreeing = 1;

    c->part = SAMPLE_PART / (n * ladder->rungs);
    for (i = 0; i < n && agreeing; i++) {
        const unsigned x = window_begin(i % across, across, frame->width);
        const unsigned y = window_begin(i / across, n / across, frame->height);
        lull_images window = *images;
        lull_status status;

        window.color = crop(&images->color, x, y);
        window.albedo = crop(&images->albedo, x, y);
        window.normal = crop(&images->normal, x, y);
        window.output.type = LULL_F32;
        window.output.pixel_stride = window.output.row_stride = 0;
        status = compare(c, sums, &window, &agreeing);
        if (status != LULL_OK)
            return status;
    }
    while (first + 1 < ladder->rungs && !agrees(sums[first], frame))
        first++;
    *rung = first;
    return LULL_OK;
}

lull_status lull_ladder_run(OIDNFilter filter, const lull_images *images, const lull_host *host,
                            OIDNQuality *taken)
{
    lull_ladder *ladder = &filter->ladder;
    climb c = {filter, host, 0, 0};
    lull_images scaled = *images;
    lull_plan *plan = filter->plan;
    unsigned rung;
    lull_status status = lull_choose_scale(&scaled.input_scale, plan, images, host);

    if (status == LULL_OK)
        status = choose(&c, &scaled, &rung);
    if (status == LULL_OK && rung != ladder->at) {
        status = lull_plan_init(&plan, filter->plan_memory, filter->plan_bytes, &filter->frame,
                                ladder->rung[rung].model);
        ladder->at = rung;
    }
    if (status != LULL_OK)
        return status;
    *taken = ladder->rung[rung].quality;
    c.begin = SAMPLE_PART;
    c.part = 1 - SAMPLE_PART;
    return run_part(&c, plan, &scaled);
}
