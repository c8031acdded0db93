/* Quality `auto`: a ladder of models, from the smallest to the largest. They all denoise a sample
 * of the frame, and the smallest that agrees with the largest there denoises the frame.
 *
 * The sample is a grid of small windows, chosen from the frame's size alone. A window is a frame of
 * its own, with the scale of the whole one and as calm, so that a model does with it what it does
 * with the whole frame, but for the context that it lacks at its edges. Threads look at one window
 * each.
 */
#include "internal.h"

#include "../lib/exec_difference.h"

#include <string.h>

#define WINDOW 48u /* columns and rows of a window */
#define GRID 16u   /* windows begin at multiples of it, where the networks' coarsest pixels do */
#define SPACE 240u /* about one window in so many columns and rows: 4 % of the pixels */
#define MOST 8u    /* windows side by side; more would tell no more */
#define FEWEST 4u  /* windows in a frame: fewer would tell too little */
#define TIMES 10u  /* a frame has at least so many times their pixels: else they cost too much */
#define LANES 16u  /* windows looked at together at most: half a megabyte each */

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

    frame.trained_for = whole->trained_for;
    frame.clean_aux = whole->clean_aux;
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

    if (!lull_builtin_select(filter->device, &own, quality, &model, &bytes, fault))
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

/* A plan, and the results of two models. */
static size_t lane_bytes(const lull_ladder *ladder)
{
    return ladder->plan_bytes + 2 * RESULT_BYTES;
}

bool lull_ladder_find(lull_ladder *ladder, OIDNFilter filter, const lull_frame *frame,
                      const lull_model *model, lull_fault *fault)
{
    const lull_frame window = window_frame(frame);

    memset(ladder, 0, sizeof *ladder);
    if (filter->values[lull_value_quality].i != LULL_QUALITY_AUTO || filter->weights_data ||
        filter->device->engine || is_small(frame))
        return true;
    if (!add_rung(ladder, filter, OIDN_QUALITY_FAST, frame, model, fault) ||
        !add_rung(ladder, filter, OIDN_QUALITY_BALANCED, frame, model, fault))
        return false;
    if (!ladder->rungs)
        return true;
    ladder->rung[ladder->rungs].quality = OIDN_QUALITY_HIGH;
    ladder->rung[ladder->rungs++].model = model;
    ladder->plan_bytes = lull_align_up(lull_ladder_plan_size(ladder, &window), LULL_ALIGN);
    ladder->lanes = lull_min_u(lull_min_u(count_windows(frame), frame->threads), LANES);
    ladder->sample_bytes = ladder->lanes * lane_bytes(ladder);
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

/* Windows that are looked at together, each in a lane of its own, and what comes of them. */
typedef struct look {
    const lull_ladder *ladder;
    const lull_frame *frame;
    const lull_images *images;
    unsigned first;            /* window */
    uint64_t sums[LULL_RUNGS]; /* what sets models apart from the largest in all windows before */
    lull_status status[LANES];
    uint64_t more[LANES][LULL_RUNGS]; /* and in these, for models that still agree with it */
} look;

/* Window `index` of the frame, as what a model is given; the result goes to `result`. */
static lull_images get_window(const look *l, unsigned index, void *result)
{
    const unsigned across = windows_along(l->frame->width), n = count_windows(l->frame);
    const unsigned x = window_begin(index % across, across, l->frame->width);
    const unsigned y = window_begin(index / across, n / across, l->frame->height);
    lull_images window = *l->images;

    window.color = crop(&l->images->color, x, y);
    window.albedo = crop(&l->images->albedo, x, y);
    window.normal = crop(&l->images->normal, x, y);
    window.output.data = result;
    window.output.type = LULL_F32;
    window.output.pixel_stride = window.output.row_stride = 0;
    return window;
}

static lull_status run_window(const look *l, unsigned rung, const lull_images *window, void *memory)
{
    const lull_frame frame = window_frame(l->frame);
    lull_plan *plan;
    const lull_status status = lull_plan_init(&plan, memory, l->ladder->plan_bytes, &frame,
                                              l->ladder->rung[rung].model);

    return status == LULL_OK ? lull_run(plan, window, NULL) : status;
}

static void look_at(void *context, unsigned lane, unsigned worker)
{
    look *l = context;
    const lull_frame frame = window_frame(l->frame);
    const unsigned largest = l->ladder->rungs - 1;
    char *memory = (char *)l->ladder->memory + lane * lane_bytes(l->ladder);
    char *results = memory + l->ladder->plan_bytes;
    const lull_images best = get_window(l, l->first + lane, results);
    lull_images other = best;
    lull_status status = run_window(l, largest, &best, memory);
    unsigned i;

    (void)worker;
    other.output.data = results + RESULT_BYTES;
    for (i = 0; i < largest && status == LULL_OK; i++) {
        l->more[lane][i] = 0;
        if (!agrees(l->sums[i], l->frame))
            continue;
        status = run_window(l, i, &other, memory);
        if (status == LULL_OK)
            l->more[lane][i] =
                lull_difference(&other.output, &best.output, &frame, other.input_scale);
    }
    l->status[lane] = status;
}

/* Finds the smallest model that agrees with the largest on all windows together. Once too much sets
 * one apart from it more windows cannot change that, so how many are looked at together, which
 * depends on the threads, does not matter. */
static lull_status choose(OIDNFilter filter, const lull_images *images, const lull_host *host,
                          unsigned *rung)
{
    const lull_ladder *ladder = &filter->ladder;
    const unsigned n = count_windows(&filter->frame), largest = ladder->rungs - 1;
    look l = {ladder, &filter->frame, images, 0, {0}, {LULL_OK}, {{0}}};
    unsigned i, lane, lanes;

    for (*rung = 0; *rung < largest && l.first < n; l.first += lanes) {
        lanes = lull_min_u(n - l.first, ladder->lanes);
        host->parallel_for(host->user, lanes, look_at, &l);
        for (lane = 0; lane < lanes; lane++) {
            if (l.status[lane] != LULL_OK)
                return l.status[lane];
            for (i = 0; i < largest; i++)
                l.sums[i] += l.more[lane][i];
        }
        while (*rung < largest && !agrees(l.sums[*rung], l.frame))
            ++*rung;
        if (host->progress && !host->progress(host->user, SAMPLE_PART * (l.first + lanes) / n))
            return LULL_CANCELLED;
    }
    return LULL_OK;
}

lull_status lull_ladder_run(OIDNFilter filter, const lull_images *images, const lull_host *host,
                            OIDNQuality *taken)
{
    lull_ladder *ladder = &filter->ladder;
    lull_host_part part;
    const lull_host rest = lull_host_of_part(&part, host, SAMPLE_PART, 1 - SAMPLE_PART);
    lull_images scaled = *images;
    lull_plan *plan = filter->plan;
    unsigned rung;
    lull_status status = lull_measure(&scaled, plan, host);

    if (status == LULL_OK)
        status = choose(filter, &scaled, host, &rung);
    if (status == LULL_OK && rung != ladder->at) {
        status = lull_plan_init(&plan, filter->plan_memory, filter->plan_bytes, &filter->frame,
                                ladder->rung[rung].model);
        ladder->at = rung;
    }
    if (status != LULL_OK)
        return status;
    *taken = ladder->rung[rung].quality;
    return lull_run(plan, &scaled, &rest);
}
