/* --split: the light of the colour's file, pass by pass. The mean of two ways to the same picture,
 * as a whole and by its shares, is nearer to the truth than either: noise of one pass is seen apart
 * from the edges of others, and what each way gets wrong differs. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "compare.h"
#include "denoise_job.h"
#include "platform.h"

/* Of the light in the colour, what passes may have beyond it, and a share that is worth no run; and
 * of a value what is no rest of it but rounded: of halves, products and sums of them. */
#define MAX_EXCESS 0.02
#define MIN_SHARE 1e-5
#define ROUNDING 0.002f

void denoise_split_free(frame_job *job)
{
    denoise_split *split = &job->split;
    for (int i = 0; i < LAYERS_LIGHTS; i++) {
        device_image_free(&split->views[i]);
        image_destroy(&split->lights[i]);
        image_destroy(&split->colors[i]);
    }
    image_destroy(&split->rest);
}

/* Row whose color that of a light is; -1: none. */
static int color_of(int light)
{
    const char *name = layers_lights[light].color;
    if (!name)
        return -1;
    while (light && layers_lights[light - 1].color && !strcmp(layers_lights[light - 1].color, name))
        light--;
    return light;
}

/* ---- Loading --------------------------------------------------------------------------------- */

/* What is read in one go, and the names of the layers. */
typedef struct wanted {
    image_beside list[2 * LAYERS_LIGHTS];
    char names[2 * LAYERS_LIGHTS][2 * IMAGE_NAME_SIZE];
    unsigned count;
} wanted;

/* Adds a layer beside the colour: of its view layer. */
static void want(wanted *all, image *out, const char *layer, const frame_job *job)
{
    const char *color = job->inputs.images[IMAGE_COLOR].names[0], *end = strrchr(color, '.');
    image_beside *beside = &all->list[all->count];
    char *name = all->names[all->count++];
    while (end && end > color && end[-1] != '.') /* of "View.Combined.R" all but the last two */
        end--;
    snprintf(name, sizeof all->names[0], "%.*s%s", end ? (int)(end - color) : 0, color, layer);
    memset(beside, 0, sizeof *beside);
    beside->out = out;
    beside->request.role = IMAGE_COLOR;
    beside->request.layer = name;
    beside->request.type = (image_type)job->settings->type;
}

/* Reads all layers that there are. */
static exit_code read_layers(frame_job *job, wanted *all)
{
    const image *color = &job->inputs.images[IMAGE_COLOR];
    const char *path = job->inputs.paths[IMAGE_COLOR];
    char again[3 * IMAGE_NAME_SIZE];
    image_request request = {.role = IMAGE_COLOR, .layer = again};
    image ignored;
    image_error error;

    all->count = 0;
    for (int i = 0; i < LAYERS_LIGHTS; i++) {
        want(all, &job->split.lights[i], layers_lights[i].light, job);
        if (color_of(i) == i)
            want(all, &job->split.colors[i], layers_lights[i].color, job);
    }
    snprintf(again, sizeof again, "%s,%s,%s", color->names[0], color->names[1], color->names[2]);
    request.threads = job->settings->device.threads;
    request.beside = all->list;
    request.beside_count = all->count;
    if (image_read(&ignored, path, &request, &error))
        return report_error(EXIT_INPUT, "cannot read '%s': %s", path, error.text);
    image_destroy(&ignored);
    for (unsigned i = 0; i < all->count; i++) {
        const image_beside *found = &all->list[i];
        exit_code code;
        if (found->status == IMAGE_ERROR_LAYER)
            continue;
        if (found->status)
            return report_error(EXIT_INPUT, "cannot read '%s': %s", path, found->error.text);
        code = image_check_aligned(found->out, all->names[i], path, color, path);
        if (!code && found->out->channels != color->channels)
            code = report_error(EXIT_INPUT, "--split: %s of '%s' has %u channels, the colour %u",
                                all->names[i], path, found->out->channels, color->channels);
        if (code)
            return code;
    }
    return EXIT_OK;
}

/* The sum of all values' sizes, but those that are infinite or no numbers. */
static double size_of(const image *img)
{
    double size = 0;
    for (size_t i = 0, n = image_count(img); i < n; i++) {
        float v = image_get(img, i);
        size += isfinite(v) ? (double)fabsf(v) : 0;
    }
    return size;
}

/* Makes a light, whatever its type, the share of the colour that it is, in floats. */
static exit_code make_share(frame_job *job, image *light, const image *color)
{
    image share;
    image_error error;
    if (image_create(&share, light->width, light->height, light->channels, IMAGE_FLOAT, &error))
        return report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[IMAGE_COLOR], error.text);
    for (size_t i = 0, n = image_count(light); i < n; i++)
        image_set(&share, i, image_get(light, i) * (color ? image_get(color, i) : 1));
    image_destroy(light);
    *light = share;
    return EXIT_OK;
}

/* Shares of all light that says something: not without its color, and not next to none. *count:
 * those that there are. */
static exit_code make_shares(frame_job *job, int *count)
{
    denoise_split *split = &job->split;
    const double whole = size_of(&job->inputs.images[IMAGE_COLOR]);
    exit_code code = EXIT_OK;
    *count = 0;
    for (int i = 0; i < LAYERS_LIGHTS && !code; i++) {
        const int color = color_of(i);
        image *light = &split->lights[i];
        if (!light->pixels)
            continue;
        if (color >= 0 && !split->colors[color].pixels) {
            image_destroy(light);
            continue;
        }
        *count += 1;
        code = make_share(job, light, color < 0 ? NULL : &split->colors[color]);
        if (!code && size_of(light) <= MIN_SHARE * whole)
            image_destroy(light);
    }
    return code;
}

/* What the passes lack of the colour. */
static exit_code make_rest(frame_job *job)
{
    denoise_split *split = &job->split;
    const image *color = &job->inputs.images[IMAGE_COLOR];
    double light = 0, excess = 0;
    image_error error;

    if (image_create(&split->rest, color->width, color->height, color->channels, IMAGE_FLOAT,
                     &error))
        return report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[IMAGE_COLOR], error.text);
    for (size_t i = 0, n = image_count(color); i < n; i++) {
        float whole = image_get(color, i), rest = whole, size = fabsf(whole);
        for (int k = 0; k < LAYERS_LIGHTS; k++)
            if (split->lights[k].pixels) {
                float share = image_get(&split->lights[k], i);
                rest -= share;
                size += fabsf(share);
            }
        if (!isfinite(rest) || !isfinite(size) || fabsf(rest) <= ROUNDING * size)
            rest = 0;
        image_set(&split->rest, i, rest);
        light += isfinite(size) ? (double)fabsf(whole) : 0;
        excess += rest < 0 ? -(double)rest : 0;
    }
    if (excess > MAX_EXCESS * light)
        return report_error(EXIT_INPUT,
                            "--split: the passes of light in '%s' are no shares of the colour, but "
                            "have %.3g %% of its light more",
                            job->inputs.paths[IMAGE_COLOR], 100 * excess / light);
    if (size_of(&split->rest) <= MIN_SHARE * light)
        image_destroy(&split->rest);
    return EXIT_OK;
}

exit_code denoise_split_load(frame_job *job)
{
    const image *color = &job->inputs.images[IMAGE_COLOR];
    const char *path = job->inputs.paths[IMAGE_COLOR];
    wanted all;
    int count;
    exit_code code;
    if (!job->settings->is_split)
        return EXIT_OK;
    if (!job->is_hdr)
        return report_error(EXIT_USAGE, "--split is for HDR colours, whose light adds up");
    if (!color->is_layered || color->channels != 3)
        return report_error(EXIT_INPUT, "--split: '%s' has no passes of light beside a colour",
                            path);
    code = read_layers(job, &all);
    if (!code)
        code = make_shares(job, &count);
    if (code)
        return code;
    if (!count)
        return report_error(EXIT_INPUT,
                            "--split: '%s' has no passes of light beside the colour, such as '%s' "
                            "with '%s'",
                            path, layers_lights[0].light, layers_lights[0].color);
    return make_rest(job);
}

/* ---- Denoising ------------------------------------------------------------------------------- */

static const char *name_of(int light)
{
    return light < LAYERS_LIGHTS ? layers_lights[light].light : "the rest";
}

/* The colors of surfaces as the device sees them; made once. */
static exit_code make_views(frame_job *job)
{
    denoise_split *split = &job->split;
    exit_code code = EXIT_OK;
    for (int i = 0; i < LAYERS_LIGHTS && !code; i++) {
        if (!split->colors[i].pixels || split->views[i].img)
            continue;
        code = denoise_make_view(job, &split->views[i], &split->colors[i]);
        if (!code && job->settings->is_prefiltering)
            code = denoise_prefilter(job, &split->views[i]);
    }
    return code;
}

/* Denoises a share, a light or the rest after them, in its place and adds it to a sum. */
static exit_code add_share(frame_job *job, int light, image *share, const device_image *albedo,
                           image *sum)
{
    double *msec = &job->split.msec[light], start = platform_clock();
    exit_code code;
    report_line("  %s\n", name_of(light));
    code = denoise_layer(job, share, albedo);
    if (code)
        return code;
    for (size_t i = 0, n = image_count(sum); i < n; i++)
        image_set(sum, i, image_get(sum, i) + image_get(share, i));
    *msec = 1000 * (platform_clock() - start);
    report_line("    msec=%g\n", *msec);
    return EXIT_OK;
}

/* What a share has for an albedo. */
static const device_image *albedo_of(const frame_job *job, int light)
{
    const device_image *all = &job->views[IMAGE_ALBEDO];
    const int color = color_of(light);
    if (color < 0 || (layers_lights[light].is_seen_through && all->img))
        return all;
    return &job->split.views[color];
}

/* The sum of what the shares give. */
static exit_code add_shares(frame_job *job, image *share, image *sum)
{
    denoise_split *split = &job->split;
    exit_code code = make_views(job);
    memset(sum->pixels, 0, image_bytes(sum));
    for (int k = 0; k < LAYERS_LIGHTS && !code; k++) {
        if (!split->lights[k].pixels)
            continue;
        memcpy(share->pixels, split->lights[k].pixels, image_bytes(share));
        code = add_share(job, k, share, albedo_of(job, k), sum);
    }
    if (!code && split->rest.pixels) {
        memcpy(share->pixels, split->rest.pixels, image_bytes(share));
        code = add_share(job, LAYERS_LIGHTS, share, &job->views[IMAGE_ALBEDO], sum);
    }
    return code;
}

exit_code denoise_split_run(frame_job *job)
{
    image *result = denoise_result(job), share = {0}, sum = {0};
    const size_t w = result->width, h = result->height;
    image_error error;
    exit_code code;
    if (image_create(&share, w, h, result->channels, IMAGE_FLOAT, &error) ||
        image_create(&sum, w, h, result->channels, IMAGE_FLOAT, &error))
        code = report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[IMAGE_COLOR], error.text);
    else
        code = add_shares(job, &share, &sum);
    for (size_t i = 0, n = image_count(result); i < n && !code; i++)
        image_set(result, i, 0.5f * (image_get(result, i) + image_get(&sum, i)));
    image_destroy(&share);
    image_destroy(&sum);
    return code;
}

void denoise_split_tell(const frame_job *job)
{
    const denoise_split *split = &job->split;
    json *report = job->session->report;
    if (!job->settings->is_split)
        return;
    json_open(report, "split", '[');
    for (int k = 0; k <= LAYERS_LIGHTS; k++) {
        if (!(k < LAYERS_LIGHTS ? &split->lights[k] : &split->rest)->pixels)
            continue;
        json_open(report, NULL, '{');
        json_text(report, "layer", name_of(k));
        json_number(report, "msec", split->msec[k]);
        json_close(report, '}');
    }
    json_close(report, ']');
}
