/* Ensembles: the mean of what a network makes of a frame in several orientations. A network sees a
 * picture that is turned as another one, and errs in another way (geometric self-ensemble; Lim et
 * al. 2017, Enhanced Deep Residual Networks for Single Image Super-Resolution, 3.3).
 *
 * The frame is turned by its strides, where it lies. All results are stored upright: the first
 * where their sum is kept, each other one in a picture of its own, and then added. */
#include "internal.h"

#include "../lib/image.h"

#include <string.h>

#define SOME 32u /* pixels added together */

/* ---- Orientations ---------------------------------------------------------------------------- */

/* Quarter turns of orientation `index`: 0 and 1, or 0 to 3. */
static bool is_on_its_side(unsigned index) { return index & 1; }

static void swap(unsigned *a, unsigned *b)
{
    const unsigned c = *a;

    *a = *b;
    *b = c;
}

lull_frame lull_frame_turned(const lull_frame *frame, unsigned index)
{
    lull_frame turned = *frame;

    if (is_on_its_side(index))
        swap(&turned.width, &turned.height);
    return turned;
}

/* An image of the upright frame, all strides given, in orientation `index`: its rows run up the
 * columns, from the right one on, then from the right to the left, then down the columns. */
static lull_image turned_image(const lull_image *image, const lull_frame *frame, unsigned index)
{
    lull_image turned = *image;

    if (!image->data)
        return turned;
    turned.data = lull_image_pixel(image, frame->width,
                                   index == 1 || index == 2 ? frame->width - 1 : 0,
                                   index == 2 || index == 3 ? frame->height - 1 : 0);
    if (is_on_its_side(index)) {
        turned.pixel_stride = index == 1 ? image->row_stride : -image->row_stride;
        turned.row_stride = index == 1 ? -image->pixel_stride : image->pixel_stride;
    } else if (index == 2) {
        turned.pixel_stride = -image->pixel_stride;
        turned.row_stride = -image->row_stride;
    }
    return turned;
}

static lull_images turned_images(const lull_images *images, const lull_frame *frame, unsigned index)
{
    lull_images turned = *images;

    turned.color = turned_image(&images->color, frame, index);
    turned.albedo = turned_image(&images->albedo, frame, index);
    turned.normal = turned_image(&images->normal, frame, index);
    turned.output = turned_image(&images->output, frame, index);
    return turned;
}

/* ---- Sums ------------------------------------------------------------------------------------ */

typedef struct addition {
    const lull_image *sum, *more;
    unsigned width;
    float scales[2]; /* sum becomes sum · [0] + more · [1] */
} addition;

static void add_row(void *context, unsigned y, unsigned worker)
{
    const addition *a = context;
    float sums[3 * SOME], more[3 * SOME];
    unsigned x, n, i;

    (void)worker;
    for (x = 0; x < a->width; x += n) {
        n = lull_min_u(SOME, a->width - x);
        lull_image_load(sums, a->sum, a->width, x, y, n);
        lull_image_load(more, a->more, a->width, x, y, n);
        for (i = 0; i < 3 * n; i++)
            sums[i] = sums[i] * a->scales[0] + more[i] * a->scales[1];
        lull_image_store(a->sum, a->width, x, y, n, sums);
    }
}

lull_image lull_tight_image(const lull_image *output, lull_type type, const lull_frame *frame,
                            void *data)
{
    lull_image image = *output;

    image.data = data;
    image.type = type;
    image.pixel_stride = (ptrdiff_t)lull_image_pixel_bytes(&image);
    image.row_stride = (ptrdiff_t)frame->width * image.pixel_stride;
    return image;
}

/* ---- Executions ------------------------------------------------------------------------------ */

/* The core's plan for orientation `index`, in the place of the one there was. */
static lull_status plan_for(OIDNFilter filter, unsigned index)
{
    const lull_ladder *ladder = &filter->ladder;
    const lull_frame frame = lull_frame_turned(&filter->frame, index);

    return lull_plan_init(&filter->plan, filter->plan_memory, filter->plan_bytes, &frame,
                          ladder->rungs ? ladder->rung[ladder->at].model : filter->model);
}

static lull_status run_orientation(OIDNFilter filter, unsigned index, const lull_images *images,
                                   const lull_host *host, OIDNQuality *taken, lull_fault *fault)
{
    lull_status status;

    if (filter->engine_plan[0])
        return filter->device->engine->run(filter->engine_plan[is_on_its_side(index)], images, host,
                                           fault);
    if (!index)
        return filter->ladder.rungs ? lull_ladder_run(filter, images, host, taken)
                                    : lull_run(filter->plan, images, host);
    status = plan_for(filter, index);
    return status == LULL_OK ? lull_run(filter->plan, images, host) : status;
}

lull_status lull_ensemble_run(OIDNFilter filter, const lull_images *images, const lull_host *host,
                              OIDNQuality *taken, lull_fault *fault)
{
    const lull_frame *frame = &filter->frame;
    const unsigned n = filter->pictures.orientations;
    const float part_of_mean = 1.0f / (float)n;
    const lull_image turned_result =
        lull_tight_image(&images->output, LULL_F32, frame,
                         (char *)filter->pictures_memory + filter->pictures.staged_bytes);
    addition a = {&images->output, &turned_result, frame->width, {part_of_mean, part_of_mean}};
    lull_images upright = *images;
    lull_status status = LULL_OK, restored;
    unsigned i;

    for (i = 0; i < n && status == LULL_OK; i++) {
        lull_host_part part;
        const lull_host share = lull_host_of_part(&part, host, (double)i / n, 1.0 / n);
        const lull_images turned = turned_images(&upright, frame, i);

        status = run_orientation(filter, i, &turned, &share, taken, fault);
        if (i && status == LULL_OK)
            host->parallel_for(host->user, frame->height, add_row, &a);
        if (i)
            a.scales[0] = 1;
        upright.output = turned_result;
    }
    restored = n > 1 && filter->plan ? plan_for(filter, 0) : LULL_OK;
    return status == LULL_OK ? restored : status;
}
