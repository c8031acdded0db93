/* Further layers of the colour's file, denoised alike: --pass and --part. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "compare.h"
#include "denoise_job.h"
#include "layers.h"
#include "platform.h"

/* Of the light in the colour, what parts that add up to it may differ by. They were rounded to
 * halves, and renderers clamp the colour of a sample, not that of its parts. */
#define MAX_MISSING 0.02

void denoise_passes_free(frame_job *job)
{
    for (int i = 0; i < MAX_PASSES; i++)
        image_destroy(&job->passes[i].img);
}

/* ---- Loading --------------------------------------------------------------------------------- */

/* 1 if two images of one file have a channel in common. */
static int overlap(const image *a, const image *b)
{
    if (a->part != b->part)
        return 0;
    for (unsigned i = 0; i < a->channels; i++)
        for (unsigned j = 0; j < b->channels; j++)
            if (!strcmp(a->names[i], b->names[j]))
                return 1;
    return 0;
}

/* Reads a layer; A is first the alpha of the colour's own layer. */
static image_status read_layer(image *out, const char *path, const image *color,
                               image_request *request, image_error *error)
{
    char name[2 * IMAGE_NAME_SIZE];
    const char *dot = strrchr(color->names[0], '.'), *layer = request->layer;
    if (layers_is_alpha(layer) && dot) {
        snprintf(name, sizeof name, "%.*s.%s", (int)(dot - color->names[0]), color->names[0],
                 layer);
        request->layer = name;
        if (!image_read(out, path, request, error))
            return IMAGE_OK;
        request->layer = layer;
    }
    return image_read(out, path, request, error);
}

static exit_code load_pass(frame_job *job, int index)
{
    const char *layer = job->settings->passes[index];
    const char *path = job->inputs.paths[IMAGE_COLOR];
    const image *color = &job->inputs.images[IMAGE_COLOR];
    denoise_pass *pass = &job->passes[index];
    image_request request = {.role = IMAGE_COLOR};
    const char *dot;
    image_error error;
    exit_code code;

    request.layer = layer;
    request.type = (image_type)job->settings->type;
    request.threads = job->settings->device.threads;
    if (read_layer(&pass->img, path, color, &request, &error))
        return report_error(EXIT_INPUT, "cannot read '%s': %s", path, error.text);
    code = image_check_aligned(&pass->img, layer, path, color, path);
    if (!code && !image_is_finite(&pass->img))
        code = report_error(EXIT_INPUT, "cannot read '%s': %s has no finite value", path, layer);
    for (int i = -1; i < index && !code; i++)
        if (overlap(&pass->img, i < 0 ? color : &job->passes[i].img))
            code = report_error(EXIT_USAGE, "%s has the same channels as %s", layer,
                                i < 0 ? "the colour" : job->settings->passes[i]);
    dot = strrchr(pass->img.names[0], '.');
    pass->is_alpha = pass->img.channels == 1 &&
                     layers_is_alpha(dot ? dot + 1 : pass->img.names[0]);
    pass->is_bare = pass->is_alpha || layers_is_bare_light(pass->img.names[0]);
    return code;
}

/* Sum of the parts of the colour at one of its values. */
static float sum_at(const frame_job *job, size_t value)
{
    float sum = 0;
    for (int i = 0; i < job->settings->pass_count; i++)
        if (job->settings->is_part[i])
            sum += image_get(&job->passes[i].img, value);
    return sum;
}

static exit_code check_sum(const frame_job *job)
{
    const image *color = &job->inputs.images[IMAGE_COLOR];
    double light = 0, missing = 0;

    for (int i = 0; i < job->settings->pass_count; i++)
        if (job->settings->is_part[i] && job->passes[i].img.channels != color->channels)
            return report_error(EXIT_INPUT, "--part %s: it has %u channels, the colour %u",
                                job->settings->passes[i], job->passes[i].img.channels,
                                color->channels);
    for (size_t i = 0, n = image_count(color); i < n; i++) {
        double whole = (double)image_get(color, i), sum = (double)sum_at(job, i);
        if (!isfinite(whole) || !isfinite(sum))
            continue;
        light += fabs(whole);
        missing += fabs(whole - sum);
    }
    if (missing > MAX_MISSING * light)
        return report_error(EXIT_INPUT,
                            "--part: those of '%s' do not add up to the colour, but differ from it "
                            "by %.3g %% of its light",
                            job->inputs.paths[IMAGE_COLOR], 100 * missing / light);
    return EXIT_OK;
}

exit_code denoise_passes_load(frame_job *job)
{
    const denoise_settings *s = job->settings;
    exit_code code = EXIT_OK;
    if (!s->pass_count)
        return EXIT_OK;
    if (!job->inputs.images[IMAGE_COLOR].is_layered)
        return report_error(EXIT_INPUT, "%s: '%s' has no layers, as it is no OpenEXR file",
                            s->passes[0], job->inputs.paths[IMAGE_COLOR]);
    for (int i = 0; i < s->pass_count && !code; i++)
        code = platform_interrupted() ? EXIT_INTERRUPTED : load_pass(job, i);
    return code || !s->part_count ? code : check_sum(job);
}

/* ---- Denoising ------------------------------------------------------------------------------- */

/* Sets the images of a layer, which its result replaces, and commits. */
static exit_code configure(frame_job *job, const device_image *view, const device_image *albedo)
{
    OIDNFilter filter = job->session->filter;
    const int has_albedo = albedo && albedo->img;
    const int has_normal = job->inputs.images[IMAGE_NORMAL].pixels != NULL;

    device_image_set(view, filter, "color");
    device_image_set(view, filter, "output");
    if (has_albedo)
        device_image_set(albedo, filter, "albedo");
    else
        oidnUnsetFilterImage(filter, "albedo");
    if (has_normal)
        device_image_set(&job->views[IMAGE_NORMAL], filter, "normal");
    denoise_commit(job, filter);
    if (has_normal && !has_albedo &&
        oidnGetDeviceError(job->session->device, NULL) != OIDN_ERROR_NONE) {
        oidnUnsetFilterImage(filter, "normal"); /* other libraries take it beside an albedo only */
        denoise_commit(job, filter);
    }
    return denoise_device_error(job, 1);
}

exit_code denoise_layer(frame_job *job, image *img, const device_image *albedo)
{
    device_image view = {0};
    exit_code code = denoise_make_view(job, &view, img);
    if (!code)
        code = configure(job, &view, albedo);
    if (!code)
        code = denoise_run_filter(job, job->session->filter);
    if (!code)
        device_image_download(&view);
    device_image_free(&view);
    return code;
}

static void clamp_to_one(image *img)
{
    for (size_t i = 0, n = image_count(img); i < n; i++)
        if (image_get(img, i) > 1)
            image_set(img, i, 1);
}

static exit_code run_pass(frame_job *job, denoise_pass *pass)
{
    const denoise_settings *s = job->settings;
    image noisy = {0};
    image_error error;
    exit_code code;

    if (s->strength < 1) {
        if (image_create(&noisy, pass->img.width, pass->img.height, pass->img.channels,
                         pass->img.type, &error))
            return report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[IMAGE_COLOR], error.text);
        memcpy(noisy.pixels, pass->img.pixels, image_bytes(&noisy));
    }
    code = denoise_layer(job, &pass->img, pass->is_bare ? NULL : &job->views[IMAGE_ALBEDO]);
    if (!code) {
        if (noisy.pixels)
            denoise_weaken(&pass->img, &noisy, s->strength);
        if (pass->is_alpha)
            clamp_to_one(&pass->img);
    }
    image_destroy(&noisy);
    return code;
}

/* Denoises the passes that are parts of the colour, or those that are not. */
static exit_code run_passes(frame_job *job, int are_parts)
{
    const denoise_settings *s = job->settings;
    exit_code code = EXIT_OK;
    for (int i = 0; i < s->pass_count && !code; i++) {
        denoise_pass *pass = &job->passes[i];
        double start = platform_clock();
        if (s->is_part[i] != are_parts)
            continue;
        report_line("Denoising %s%s\n", s->passes[i], pass->is_bare ? ", without the albedo" : "");
        code = run_pass(job, pass);
        pass->msec = 1000 * (platform_clock() - start);
        if (!code)
            report_line("  msec=%g\n", pass->msec);
    }
    return code;
}

exit_code denoise_parts_run(frame_job *job)
{
    image *result = denoise_result(job);
    exit_code code = run_passes(job, 1);
    for (size_t i = 0, n = image_count(result); i < n && !code; i++)
        image_set(result, i, sum_at(job, i));
    return code;
}

exit_code denoise_passes_run(frame_job *job) { return run_passes(job, 0); }

void denoise_passes_tell(const frame_job *job)
{
    const denoise_settings *s = job->settings;
    json *report = job->session->report;
    if (!s->pass_count)
        return;
    json_open(report, "passes", '[');
    for (int i = 0; i < s->pass_count; i++) {
        const denoise_pass *pass = &job->passes[i];
        json_open(report, NULL, '{');
        json_text(report, "layer", s->passes[i]);
        json_bool(report, "part", s->is_part[i]);
        json_bool(report, "albedo", !pass->is_bare && job->inputs.images[IMAGE_ALBEDO].pixels);
        json_number(report, "msec", pass->msec);
        json_close(report, '}');
    }
    json_close(report, ']');
}
