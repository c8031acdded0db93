/* What becomes of a frame: its files. */
#include <stdlib.h>
#include <string.h>

#include "denoise_job.h"
#include "platform.h"

/* A copy for a format that holds integers or sRGB, or another kind of alpha than the input's, or
 * NULL if the values can go as they are. */
static image *display_copy(const frame_job *job, const image *result, const char *path, image *copy,
                           image_error *error)
{
    const image *main = &job->inputs.images[job->inputs.main];
    image_alpha from = main->is_layered ? IMAGE_MULTIPLIED : IMAGE_STRAIGHT;
    image_alpha to = image_path_alpha(path);
    int is_signed = denoise_is_signed(job->settings, job->inputs.main);
    int is_encoded =
        is_signed ? image_path_is_integer(path) : !image_path_is_linear(path) && !job->is_srgb;
    int has_alpha = main->alpha && !is_signed && to != IMAGE_OPAQUE && to != from;
    if (!is_encoded && !has_alpha)
        return NULL;
    if (image_create(copy, result->width, result->height, result->channels, IMAGE_FLOAT, error))
        return NULL;
    for (size_t i = 0, n = image_count(result); i < n; i++)
        image_set(copy, i, image_get(result, i));
    if (has_alpha)
        image_convert_alpha(copy, main->alpha, from, to);
    if (is_encoded && is_signed)
        image_encode_signed(copy);
    else if (is_encoded)
        image_encode_srgb(copy);
    return copy;
}

static exit_code write_output(frame_job *job, const char *pattern)
{
    const image *main = &job->inputs.images[job->inputs.main];
    image *result = denoise_result(job);
    char *path = sequence_path(pattern, job->frame);
    const image *passes[MAX_PASSES];
    image_target target = {main->is_layered ? job->inputs.paths[job->inputs.main] : NULL,
                           job->settings->device.threads, passes,
                           (unsigned)job->settings->pass_count};
    image copy = {0}, *shown;
    image_error error = {IMAGE_OK, ""};
    exit_code code = EXIT_OK;

    if (!path)
        return report_error(EXIT_OUTPUT, "cannot write '%s': not enough memory", pattern);
    for (int i = 0; i < job->settings->pass_count; i++)
        passes[i] = &job->passes[i].img;
    shown = display_copy(job, result, path, &copy, &error);
    if (!error.status) {
        image whole = shown ? *shown : *result; /* borrows pixels and alpha */
        whole.alpha = main->alpha;
        whole.bits = main->bits;
        whole.is_layered = main->is_layered;
        whole.part = main->part;
        memcpy(whole.names, main->names, sizeof whole.names);
        image_write(path, &whole, &target, &error);
    }
    image_destroy(&copy);
    if (error.status && platform_interrupted())
        code = EXIT_INTERRUPTED;
    else if (error.status)
        code = report_error(EXIT_OUTPUT, "cannot write '%s': %s", path, error.text);
    else
        json_text(job->session->report, NULL, path);
    free(path);
    return code;
}

exit_code denoise_write_outputs(frame_job *job)
{
    exit_code code = EXIT_OK;
    if (!job->settings->output_count)
        return EXIT_OK;
    report_line("Saving output\n");
    json_open(job->session->report, "outputs", '[');
    for (int i = 0; i < job->settings->output_count && !code; i++)
        code = platform_interrupted() ? EXIT_INTERRUPTED
                                      : write_output(job, job->settings->outputs[i]);
    json_close(job->session->report, ']');
    return code;
}

exit_code denoise_check_outputs(const frame_job *job)
{
    const denoise_settings *s = job->settings;
    exit_code code = EXIT_OK;
    for (int i = 0; i < s->output_count && s->frames && !code; i++) {
        image_error error;
        char *path = sequence_path(s->outputs[i], job->frame);
        if (!path)
            code = report_error(EXIT_OUTPUT, "cannot write '%s': not enough memory", s->outputs[i]);
        else if (image_check_writable(path, &error))
            code = report_error(EXIT_OUTPUT, "cannot write '%s': %s", path, error.text);
        free(path);
    }
    return code;
}

