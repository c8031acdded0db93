/* Committing a filter: checks, choice of weights, plan. */
#include "internal.h"

#include "../lib/image.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Enough memory for lull_plan_init to say why there is no plan. */
#define FAILED_PLAN ((size_t)64 << 10)

static const char *const image_names[LULL_IMAGES] = {"color", "albedo", "normal", "output"};

/* ---- Checks ---------------------------------------------------------------------------------- */

static bool is_supported(OIDNFormat format)
{
    const unsigned channels = lull_format_channels(format);

    return channels >= 1 && channels <= 3;
}

/* Formats and sizes of the images; *features says which inputs there are. */
static bool check_images(OIDNFilter filter, unsigned *features, lull_fault *fault)
{
    const lull_image_param *images = filter->images, *output = &images[LULL_OUTPUT],
                           *main_image = NULL;
    unsigned i;

    *features = 0;
    for (i = LULL_NORMAL + 1; i-- > 0;)
        if (images[i].set) {
            *features |= 1u << i; /* LULL_HAS_* */
            main_image = &images[i];
        }
    if (!*features)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION, "no input image is set");
    if (!output->set)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION, "no output image is set");
    for (i = 0; i < LULL_IMAGES; i++)
        if (images[i].set && !is_supported(images[i].format))
            return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                             "unsupported format of the %s image", image_names[i]);
    if (lull_format_channels(main_image->format) != lull_format_channels(output->format))
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "input and output image differ in their number of channels");
    for (i = 0; i < LULL_OUTPUT; i++)
        if (images[i].set &&
            (images[i].width != output->width || images[i].height != output->height))
            return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                             "size of the %s image differs from "
                             "that of the output image",
                             image_names[i]);
    return true;
}

/* Which parameters and images go together. */
static bool check_combination(OIDNFilter filter, unsigned features, lull_fault *fault)
{
    const lull_value *values = filter->values;
    const bool hdr = values[lull_value_hdr].i, srgb = values[lull_value_srgb].i;
    const char *why = NULL;

    if (filter->type == LULL_LIGHTMAP && !(features & LULL_HAS_COLOR))
        why = "normals of a light map need its color image";
    else if (filter->type == LULL_LIGHTMAP)
        return true;
    else if (hdr && srgb)
        why = "hdr and srgb exclude each other";
    else if (features == LULL_HAS_ALBEDO && hdr)
        why = "an albedo image alone cannot be hdr";
    else if (features == LULL_HAS_NORMAL && (hdr || srgb))
        why = "a normal image alone can be neither hdr nor srgb";
    else if (features == (LULL_HAS_ALBEDO | LULL_HAS_NORMAL))
        why = "albedo and normal images need a color image";
    if (why)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "unsupported combination of inputs: %s", why);
    return true;
}

static lull_content content_of(OIDNFilter filter)
{
    const lull_value *values = filter->values;

    if (filter->type == LULL_LIGHTMAP)
        return values[lull_value_directional].i ? LULL_LIGHTMAP_DIR : LULL_LIGHTMAP_HDR;
    if (values[lull_value_hdr].i)
        return LULL_HDR;
    return values[lull_value_srgb].i ? LULL_SRGB : LULL_LDR;
}

/* ---- Overlap of output and inputs ------------------------------------------------------------ */

/* The image as the core sees it. */
static lull_image view_of(const lull_image_param *image)
{
    lull_image view;

    view.data = image->data;
    view.type = image->format >= OIDN_FORMAT_HALF ? LULL_F16 : LULL_F32;
    view.channels = lull_format_channels(image->format);
    view.pixel_stride = (ptrdiff_t)image->pixel_stride;
    view.row_stride = (ptrdiff_t)image->row_stride;
    return view;
}

/* Overlap is decided by addresses, so raw pointers, shared buffers and buffers within each other's
 * memory are all seen. inputs: LULL_HAS_*, those that are read where they lie. *staged: one of them
 * overlaps without lying in the same place, where a run reads each pixel before it writes it. */
static bool find_overlap(OIDNFilter filter, const lull_frame *frame, unsigned inputs, bool *staged)
{
    const lull_image output = view_of(&filter->images[LULL_OUTPUT]);
    bool overlap = false;
    unsigned i;

    *staged = false;
    for (i = 0; i < LULL_OUTPUT && frame->width && frame->height; i++) {
        const lull_image input = view_of(&filter->images[i]);

        if (!(inputs >> i & 1) ||
            !lull_image_overlaps(&output, &input, frame->width, frame->height))
            continue;
        overlap = true;
        if (!lull_image_is_in_place(&output, &input, frame->width, frame->height))
            *staged = true;
    }
    return overlap;
}

/* Pixels around a panorama: as far as what lies there shows in the result (docs/models.md). */
#define PANORAMA_BORDER 64u

/* Bytes of the inputs of a panorama; frame: with its border. */
static size_t bordered_bytes(OIDNFilter filter, const lull_frame *frame)
{
    size_t bytes = 0;
    unsigned i;

    for (i = 0; i < LULL_OUTPUT; i++)
        if (frame->features >> i & 1)
            bytes += lull_panorama_bytes(lull_format_bytes(filter->images[i].format), frame);
    return bytes;
}

/* What executions need beside the plan, and whether they may write the output while they read. The
 * frame of a panorama gets its border. */
static bool find_pictures(lull_pictures *pictures, OIDNFilter filter, lull_frame *frame,
                          lull_fault *fault)
{
    const lull_image_param *output = &filter->images[LULL_OUTPUT];
    const int n = filter->values[lull_value_ensemble].i;
    const bool is_panorama = filter->values[lull_value_panorama].i && frame->width && frame->height;
    const bool is_filled = filter->type == LULL_LIGHTMAP && (frame->features & LULL_HAS_NORMAL) &&
                           frame->width && frame->height;
    uint64_t pixels;
    size_t sum_bytes;
    bool staged;

    memset(pictures, 0, sizeof *pictures);
    if (n != 1 && n != 2 && n != 4)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT,
                         "ensemble is %d; it must be 1, 2 or 4", n);
    pictures->orientations = (unsigned)n;
    frame->in_place = find_overlap(
        filter, frame, frame->features & (is_filled ? LULL_HAS_NORMAL : ~0u), &staged);
    if (is_panorama) {
        if (lull_max_u(frame->width, frame->height) > LULL_MAX_SIZE - 2 * PANORAMA_BORDER)
            return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT,
                             "a panorama of %ux%u pixels; at most %u are supported, and as many "
                             "down",
                             frame->width, frame->height, LULL_MAX_SIZE - 2 * PANORAMA_BORDER);
        pictures->border = PANORAMA_BORDER;
        frame->width += 2 * PANORAMA_BORDER;
        frame->height += 2 * PANORAMA_BORDER;
        frame->in_place = 0;
        staged = true;
    }
    pixels = (uint64_t)frame->width * frame->height;
    if ((n > 1 || is_panorama || is_filled) && pixels * 3 * sizeof(float) > SIZE_MAX / 8)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory: pictures of %llu pixels",
                         (unsigned long long)pixels);
    sum_bytes = (size_t)pixels * lull_format_channels(output->format) * sizeof(float);
    if (n > 1) {
        staged = staged || frame->in_place || output->format >= OIDN_FORMAT_HALF;
        pictures->turned_bytes = sum_bytes;
    }
    if (staged || (frame->in_place && filter->device->engine)) {
        frame->in_place = 0;
        pictures->staged_bytes =
            n > 1 ? sum_bytes : (size_t)pixels * lull_format_bytes(output->format);
    }
    if (is_panorama) {
        pictures->inputs_bytes = bordered_bytes(filter, frame);
    }
    if (is_filled) {
        pictures->is_filled = true;
        pictures->inputs_bytes = lull_lightmap_bytes(
            lull_format_bytes(filter->images[LULL_COLOR].format), frame);
    }
    if (pictures->inputs_bytes) {
        pictures->staged_bytes = lull_align_up(pictures->staged_bytes, LULL_ALIGN);
        pictures->turned_bytes = lull_align_up(pictures->turned_bytes, LULL_ALIGN);
    }
    return true;
}

static size_t picture_bytes(const lull_pictures *pictures)
{
    return pictures->staged_bytes + pictures->turned_bytes + pictures->inputs_bytes;
}

static bool same_pictures(const lull_pictures *a, const lull_pictures *b)
{
    return a->orientations == b->orientations && a->staged_bytes == b->staged_bytes &&
           a->turned_bytes == b->turned_bytes && a->border == b->border &&
           a->is_filled == b->is_filled && a->inputs_bytes == b->inputs_bytes;
}

/* ---- Plan ------------------------------------------------------------------------------------ */

void lull_filter_free_plan(OIDNFilter filter)
{
    unsigned i;

    for (i = 0; i < 2; i++) {
        if (filter->engine_plan[i])
            filter->device->engine->free_plan(filter->engine_plan[i]);
        filter->engine_plan[i] = NULL;
    }
    lull_os_free(filter->plan_memory);
    lull_os_free(filter->pictures_memory);
    lull_os_free(filter->ladder.memory);
    memset(&filter->ladder, 0, sizeof filter->ladder);
    memset(&filter->pictures, 0, sizeof filter->pictures);
    filter->plan_memory = NULL;
    filter->plan = NULL;
    filter->pictures_memory = NULL;
}

/* Whether plans for the two frames are the same. */
static bool same_frame(const lull_frame *a, const lull_frame *b)
{
    return a->width == b->width && a->height == b->height && a->content == b->content &&
           a->features == b->features && a->threads == b->threads && a->in_place == b->in_place &&
           a->streamed == b->streamed &&
           a->max_bytes == b->max_bytes && a->row_step == b->row_step &&
           a->strip_width == b->strip_width && a->trained_for == b->trained_for &&
           a->clean_aux == b->clean_aux;
}

/* Bytes of the smallest plan: the core's has one orientation at a time, the engine's has both kinds
 * beside each other. A fault where there can be none. */
static size_t least_bytes(OIDNFilter filter, const lull_model *model, unsigned orientations,
                          const lull_frame *frame, lull_fault *fault)
{
    lull_engine *engine = filter->device->engine;
    size_t most = 0, sum = 0;
    unsigned i;

    for (i = 0; i < orientations && i < 2; i++) {
        const lull_frame turned = lull_frame_turned(frame, i);
        const size_t bytes = engine ? (size_t)engine->minimum(engine, &turned, model, fault)
                                    : lull_plan_minimum(&turned, model);

        most = bytes > most ? bytes : most;
        sum += bytes;
    }
    return engine ? sum : most;
}

/* Turns maxMemoryMB into limits of the plan, and drops the ladder where it has no room beside it.
 * The megabytes count weights, plan, sample and pictures; fixed: weights and pictures without the
 * ladder's. 0 cannot be met; it asks for the least memory at no more than about twice the work,
 * which is strips as wide as their overlaps. */
static bool set_limits(OIDNFilter filter, const lull_model *model, size_t fixed,
                       unsigned orientations, lull_ladder *ladder, lull_frame *frame,
                       lull_fault *fault)
{
    const size_t more = ladder->weights_bytes + ladder->sample_bytes;
    const int megabytes = filter->values[lull_value_max_memory_mb].i;
    lull_model_info info;
    size_t floor;

    if (megabytes < 0)
        return true;
    if (megabytes == 0) {
        memset(ladder, 0, sizeof *ladder);
        lull_model_get_info(model, &info);
        frame->strip_width = 2 * info.overlap;
        frame->row_step = 2;
        return true;
    }
    floor = least_bytes(filter, model, orientations, frame, fault);
    if (fault->code != OIDN_ERROR_NONE)
        return false;
    if ((uint64_t)fixed + floor > (uint64_t)megabytes << 20)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY,
                         "maxMemoryMB is %d, but this filter needs at least %llu bytes (%llu MB)",
                         megabytes, (unsigned long long)(fixed + floor),
                         (unsigned long long)(((uint64_t)fixed + floor + (1u << 20) - 1) >> 20));
    if ((uint64_t)fixed + more + floor > (uint64_t)megabytes << 20)
        memset(ladder, 0, sizeof *ladder);
    else
        fixed += more;
    if ((uint64_t)megabytes << 20 <= SIZE_MAX)
        frame->max_bytes = ((size_t)megabytes << 20) - fixed;
    if (filter->device->engine && orientations > 1)
        frame->max_bytes /= 2; /* of two plans */
    return true;
}

/* Memory for the core's plan, if that is what there will be, and for what goes with it. */
static bool allocate(OIDNFilter filter, size_t plan_bytes, const lull_pictures *pictures,
                     const lull_ladder *ladder, lull_fault *fault)
{
    const size_t bytes = picture_bytes(pictures);

    lull_filter_free_plan(filter);
    filter->plan_memory = plan_bytes ? lull_os_alloc(plan_bytes) : NULL;
    if (plan_bytes && !filter->plan_memory)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory: plan of %llu bytes",
                         (unsigned long long)plan_bytes);
    if (bytes) {
        filter->pictures_memory = lull_os_alloc(bytes);
        if (!filter->pictures_memory)
            return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY,
                             "out of memory: pictures of %llu bytes",
                             (unsigned long long)bytes);
    }
    if (ladder->rungs) {
        filter->ladder = *ladder;
        filter->ladder.memory = lull_os_alloc(ladder->sample_bytes);
        if (!filter->ladder.memory)
            return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY,
                             "out of memory: sample of %llu bytes",
                             (unsigned long long)ladder->sample_bytes);
    }
    return true;
}

/* The core's plan. */
static bool make_core_plan(OIDNFilter filter, const lull_frame *frame, const lull_model *model,
                           const lull_pictures *pictures, const lull_ladder *ladder,
                           lull_fault *fault)
{
    size_t bytes = 0;
    lull_status status;
    unsigned i;

    for (i = 0; i < pictures->orientations && i < 2; i++) {
        const lull_frame turned = lull_frame_turned(frame, i);
        const size_t size = ladder->rungs ? lull_ladder_plan_size(ladder, &turned)
                                          : lull_plan_size(&turned, model);

        bytes = size > bytes ? size : bytes;
    }
    bytes = bytes ? bytes : FAILED_PLAN;
    if (!allocate(filter, bytes, pictures, ladder, fault))
        return false;
    status = lull_plan_init(&filter->plan, filter->plan_memory, bytes, frame, model);
    if (status != LULL_OK)
        filter->plan = NULL;
    if (!lull_check_plan(fault, status, frame, model))
        return false;
    lull_plan_get_info(filter->plan, &filter->plan_info);
    filter->plan_bytes = bytes;
    filter->ladder.at = ladder->rungs ? ladder->rungs - 1 : 0;
    return true;
}

/* The engine's. */
static bool make_engine_plan(OIDNFilter filter, const lull_frame *frame, const lull_model *model,
                             const lull_pictures *pictures, const lull_ladder *ladder,
                             lull_fault *fault)
{
    lull_engine *engine = filter->device->engine;
    unsigned i;

    if (!allocate(filter, 0, pictures, ladder, fault))
        return false;
    filter->plan_bytes = 0;
    for (i = pictures->orientations > 1 ? 2 : 1; i-- > 0;) {
        const lull_frame turned = lull_frame_turned(frame, i);

        filter->engine_plan[i] = engine->new_plan(engine, &turned, model, fault);
        if (!filter->engine_plan[i])
            return false;
        engine->get_info(filter->engine_plan[i], &filter->plan_info);
        filter->plan_bytes += filter->plan_info.bytes;
    }
    return true;
}

static bool make_plan(OIDNFilter filter, const lull_frame *frame, const lull_model *model,
                      const lull_pictures *pictures, const lull_ladder *ladder, lull_fault *fault)
{
    if (!(filter->device->engine
              ? make_engine_plan(filter, frame, model, pictures, ladder, fault)
              : make_core_plan(filter, frame, model, pictures, ladder, fault)))
        return false;
    filter->frame = *frame;
    filter->model = model;
    filter->pictures = *pictures;
    return true;
}

/* ---- Commit ---------------------------------------------------------------------------------- */

/* What `execute` will hand to the core. Images that the plan does not use stay empty. */
static void publish_images(OIDNFilter filter)
{
    lull_image *views[LULL_IMAGES];
    unsigned i;

    memset(&filter->committed, 0, sizeof filter->committed);
    views[LULL_COLOR] = &filter->committed.color;
    views[LULL_ALBEDO] = &filter->committed.albedo;
    views[LULL_NORMAL] = &filter->committed.normal;
    views[LULL_OUTPUT] = &filter->committed.output;
    for (i = 0; i < LULL_IMAGES; i++) {
        const lull_image_param *image = &filter->images[i];
        const bool used = i == LULL_OUTPUT || filter->frame.features >> i & 1;

        lull_buffer_attach(used ? image->buffer : NULL);
        lull_buffer_detach(filter->committed_buffers[i]);
        filter->committed_buffers[i] = used ? image->buffer : NULL;
        if (used)
            *views[i] = view_of(image);
    }
    filter->committed.input_scale = filter->values[lull_value_input_scale].f;
    filter->committed.calm = filter->committed.ragged = NAN;
}

static void print_summary(OIDNFilter filter, size_t model_bytes)
{
    const lull_plan_info plan = filter->plan_info;
    const lull_ladder *ladder = &filter->ladder;
    const size_t copies = picture_bytes(&filter->pictures);
    lull_model_info model;
    unsigned i;

    lull_model_get_info(filter->model, &model);
    printf("%s filter\n  Inputs :", filter->type == LULL_RT ? "RT" : "RTLightmap");
    for (i = 0; i < LULL_IMAGES; i++)
        if (filter->images[i].set)
            printf("%s %s:%c%u%s", i == LULL_OUTPUT ? "\n  Output :" : "", image_names[i],
                   filter->images[i].format >= OIDN_FORMAT_HALF ? 'h' : 'f',
                   lull_format_channels(filter->images[i].format),
                   i == LULL_OUTPUT || filter->frame.features >> i & 1 ? "" : " (not used)");
    printf("\n  Network: %s, %u inputs, %llu parameters, %s\n", model.network, model.inputs,
           (unsigned long long)model.parameters, model.is_integer ? "int8" : "fp32");
    if (ladder->rungs)
        printf("  Quality: auto, this network or one of %u smaller ones\n", ladder->rungs - 1);
    printf("  Image  : %ux%u%s\n", filter->frame.width, filter->frame.height,
           filter->pictures.border         ? ", a panorama, its border included"
           : filter->pictures.is_filled    ? ", a light map, filled by its normals"
           : filter->pictures.staged_bytes ? ", in place with a copy"
           : filter->frame.in_place      ? ", in place"
                                         : "");
    if (filter->pictures.orientations > 1)
        printf("  Mean   : of %u orientations\n", filter->pictures.orientations);
    printf("  Strips : %u of %u columns, steps of %u rows\n", plan.strips, plan.strip_width,
           plan.row_step);
    printf("  Memory : %llu bytes (weights %llu, plan %llu, copy %llu, sample %llu)\n",
           (unsigned long long)(model_bytes + filter->plan_bytes + copies +
                                ladder->sample_bytes),
           (unsigned long long)model_bytes, (unsigned long long)filter->plan_bytes,
           (unsigned long long)copies, (unsigned long long)ladder->sample_bytes);
    fflush(stdout);
}

/* Weights to use: the caller's if there are any, else built-in ones. *bytes: their
 * size unpacked. */
static bool choose_model(OIDNFilter filter, lull_frame *frame, const lull_model **model,
                         size_t *bytes, lull_fault *fault)
{
    if (filter->weights_dirty) {
        lull_filter_free_plan(filter);
        lull_weights_free(&filter->weights);
        if (filter->weights_data &&
            !lull_weights_load(&filter->weights, filter->weights_data, filter->weights_bytes,
                               filter->device->ports, fault))
            return false;
        filter->weights_dirty = false;
    }
    if (filter->weights_data) {
        *model = filter->weights.model;
        *bytes = filter->weights.bytes;
        return true;
    }
    return lull_builtin_select(filter->device, frame,
                               (OIDNQuality)filter->values[lull_value_quality].i, model, bytes,
                               fault);
}

/* Everything but waiting. Sets *busy and does nothing more if the plan would have to change while
 * queued work uses it. */
static bool prepare(OIDNFilter filter, bool may_change, bool *busy, lull_fault *fault)
{
    const lull_image_param *output = &filter->images[LULL_OUTPUT];
    const lull_model *model;
    lull_model_info info;
    lull_ladder ladder;
    lull_frame frame;
    lull_pictures pictures;
    size_t model_bytes;
    unsigned features;

    *busy = false;
    if (!check_images(filter, &features, fault) || !check_combination(filter, features, fault))
        return false;
    if (filter->weights_dirty && !may_change) {
        *busy = true;
        return true;
    }
    frame = lull_frame_default((unsigned)output->width, (unsigned)output->height,
                               content_of(filter), features);
    frame.threads = lull_pool_size(filter->device->pool);
    frame.clean_aux = filter->values[lull_value_clean_aux].i != 0;
    if (!choose_model(filter, &frame, &model, &model_bytes, fault))
        return false;
    lull_model_get_info(model, &info);
    if (filter->type == LULL_LIGHTMAP && info.inputs == 3)
        frame.features = LULL_HAS_COLOR; /* all that such weights see */
    if (!find_pictures(&pictures, filter, &frame, fault))
        return false;
    if (!lull_ladder_find(&ladder, filter, &frame, model, fault))
        return false;
    if (!set_limits(filter, model, model_bytes + picture_bytes(&pictures), pictures.orientations,
                    &ladder, &frame, fault))
        return false;
    model_bytes += ladder.weights_bytes;
    if ((!filter->plan && !filter->engine_plan[0]) || filter->model != model ||
        !same_pictures(&filter->pictures, &pictures) || !same_frame(&filter->frame, &frame) ||
        !lull_ladder_same(&filter->ladder, &ladder)) {
        *busy = !may_change;
        if (!may_change)
            return true;
        if (!make_plan(filter, &frame, model, &pictures, &ladder, fault))
            return false;
        lull_queue_take_fault(filter->device, fault); /* of earlier work; this commit holds */
    }
    publish_images(filter);
    filter->values[lull_value_tile_alignment].i = (int)info.alignment;
    filter->values[lull_value_tile_overlap].i = (int)info.overlap;
    filter->dirty = false;
    if (filter->device->values[lull_value_verbose].i >= 2)
        print_summary(filter, model_bytes);
    return true;
}

bool lull_filter_commit(OIDNFilter filter, lull_fault *fault)
{
    bool busy;

    if (!filter->dirty)
        return true;
    for (;;) {
        const bool idle = lull_queue_is_done(filter->device, filter->last_job);

        if (!prepare(filter, idle, &busy, fault))
            return false;
        if (!busy)
            return true;
        if (!lull_queue_wait(filter->device, filter->last_job, fault))
            return false;
    }
}
