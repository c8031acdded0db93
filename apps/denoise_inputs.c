#include "denoise.h"

#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "doctor.h"
#include "layers.h"

int denoise_is_signed(const denoise_settings *settings, image_role role)
{
    return role == IMAGE_NORMAL || (role == IMAGE_COLOR && settings->is_directional);
}

void denoise_inputs_free(denoise_inputs *inputs)
{
    for (int i = 0; i < IMAGE_ROLES; i++) {
        image_destroy(&inputs->images[i]);
        free(inputs->paths[i]);
    }
    memset(inputs, 0, sizeof *inputs);
}

static exit_code fail(const char *path, const char *text)
{
    return report_error(EXIT_INPUT, "cannot read '%s': %s", path, text);
}

/* In requests: motion is of pixels, which halves do not count well. */
static image_type type_of(const denoise_settings *settings, image_role role)
{
    return role == IMAGE_MOTION ? IMAGE_FLOAT : (image_type)settings->type;
}

/* Brings the values to what the denoiser takes. Integer files hold signed values as 0.5 v + 0.5,
 * and others by the sRGB curve. */
static void linearise(image *img, const denoise_settings *settings, image_role role,
                      const char *path)
{
    if (denoise_is_signed(settings, role)) {
        if (image_is_integer(img, path))
            image_decode_signed(img);
    } else if (!image_is_linear(img, path) && (role == IMAGE_ALBEDO || !settings->is_srgb)) {
        image_decode_srgb(img);
    }
}

static int is_none(const char *layer) { return layer && !strcmp(layer, "none"); }

/* Loads the file given for a role. */
static exit_code load_given(denoise_inputs *inputs, const denoise_settings *settings,
                            image_role role, int frame)
{
    image_error error;
    image_request request = {role, settings->layers[role],
                             0,    type_of(settings, role),
                             0,    NULL,
                             settings->device.threads};
    inputs->paths[role] = sequence_path(settings->files[role], frame);
    if (!inputs->paths[role])
        return fail(settings->files[role], "not enough memory");
    if (image_read(&inputs->images[role], inputs->paths[role], &request, &error))
        return fail(inputs->paths[role], error.text);
    if (role == IMAGE_MOTION && image_is_integer(&inputs->images[role], inputs->paths[role]))
        return fail(inputs->paths[role],
                    "motion vectors are signed numbers of pixels, which files of "
                    "integers do not hold");
    linearise(&inputs->images[role], settings, role, inputs->paths[role]);
    return EXIT_OK;
}

/* Looks for an auxiliary layer in the colour's file. A file without one is no error, unless the
 * layer was named. */
static exit_code load_found(denoise_inputs *inputs, const denoise_settings *settings,
                            image_role role, int frame)
{
    image_error error;
    image_request request = {role,
                             settings->layers[role],
                             1,
                             type_of(settings, role),
                             0,
                             &inputs->images[IMAGE_COLOR],
                             settings->device.threads};
    char *path = sequence_path(settings->files[IMAGE_COLOR], frame);
    image_status status;
    if (!path)
        return fail(settings->files[IMAGE_COLOR], "not enough memory");
    status = image_read(&inputs->images[role], path, &request, &error);
    inputs->paths[role] = path;
    inputs->is_found[role] = !request.layer;
    inputs->has_light |=
        !status && image_is_light(&inputs->images[role], &inputs->images[IMAGE_COLOR]);
    if (!status && !(role == IMAGE_ALBEDO && inputs->has_light))
        return EXIT_OK;
    inputs->is_found[role] = 0;
    if (!status || (status == IMAGE_ERROR_LAYER && !request.layer)) {
        image_destroy(&inputs->images[role]);
        free(path);
        inputs->paths[role] = NULL;
        return EXIT_OK;
    }
    return fail(path, error.text);
}

/* 1 if a role's layer is looked for in the colour's file. */
static int is_sought(const denoise_settings *settings, image_role role)
{
    if (is_none(settings->layers[role]) || settings->is_directional ||
        strcmp(settings->filter, "RT"))
        return 0;
    if (role == IMAGE_MOTION)
        return settings->is_temporal;
    return !settings->only_given || settings->layers[role];
}

/* All images of the frame. */
static exit_code load_all(denoise_inputs *inputs, const denoise_settings *settings, int frame)
{
    for (int i = 0; i < IMAGE_ROLES; i++) {
        image_role role = (image_role)i;
        exit_code code = EXIT_OK;
        if (settings->files[role])
            code = load_given(inputs, settings, role, frame);
        else if (inputs->images[IMAGE_COLOR].is_layered && is_sought(settings, role))
            code = load_found(inputs, settings, role, frame);
        if (code)
            return code;
    }
    if (inputs->images[IMAGE_MOTION].pixels && inputs->images[IMAGE_MOTION].channels < 2)
        return fail(inputs->paths[IMAGE_MOTION], "motion vectors have two channels");
    if (settings->is_temporal && !inputs->images[IMAGE_MOTION].pixels &&
        !is_none(settings->layers[IMAGE_MOTION]))
        return report_error(EXIT_INPUT,
                            "'%s' has no motion vectors: --motion names a file of them; "
                            "where the camera stands still, --layer motion=none does without",
                            inputs->paths[IMAGE_COLOR]);
    inputs->main = settings->files[IMAGE_COLOR]    ? IMAGE_COLOR
                   : settings->files[IMAGE_ALBEDO] ? IMAGE_ALBEDO
                                                   : IMAGE_NORMAL;
    return EXIT_OK;
}

static exit_code check_aligned(const denoise_inputs *inputs)
{
    exit_code code = EXIT_OK;
    for (int i = 0; i < IMAGE_ROLES && !code; i++)
        if (inputs->images[i].pixels)
            code = image_check_aligned(&inputs->images[i], layers_role_name((image_role)i),
                                       inputs->paths[i], &inputs->images[inputs->main],
                                       inputs->paths[inputs->main]);
    return code;
}

static void tell(const denoise_inputs *inputs, json *report)
{
    const image *main = &inputs->images[inputs->main];
    for (int i = 0; i < IMAGE_ROLES; i++) {
        const image *img = &inputs->images[i];
        const char *role = layers_role_name((image_role)i);
        if (!img->pixels)
            continue;
        json_open(report, role, '{');
        json_text(report, "file", inputs->paths[i]);
        if (img->is_layered) {
            report_line("  %s=%s (%s", role, inputs->paths[i], img->names[0]);
            for (unsigned c = 1; c < img->channels; c++)
                report_line(" %s", img->names[c]);
            report_line(")\n");
            json_open(report, "layer", '[');
            for (unsigned c = 0; c < img->channels; c++)
                json_text(report, NULL, img->names[c]);
            json_close(report, ']');
        }
        json_text(report, "type", img->type == IMAGE_HALF ? "half" : "float");
        json_close(report, '}');
    }
    if (inputs->has_light) {
        report_line("  diffuse is left out: it is light, not albedo\n");
        json_bool(report, "diffuse_left_out", 1);
    }
    report_line("Resolution: %zux%zu\n", main->width, main->height);
    json_number(report, "width", (double)main->width);
    json_number(report, "height", (double)main->height);
    json_number(report, "channels", main->channels);
}

exit_code denoise_load(denoise_inputs *inputs, const denoise_settings *settings, int frame,
                       json *report)
{
    exit_code code;
    memset(inputs, 0, sizeof *inputs);
    code = load_all(inputs, settings, frame);
    if (!code)
        code = check_aligned(inputs);
    if (!code)
        code = image_check_finite(&inputs->images[inputs->main], inputs->paths[inputs->main]);
    if (code)
        denoise_inputs_free(inputs);
    else
        tell(inputs, report);
    return code;
}

exit_code denoise_load_reference(image *reference, const denoise_settings *settings,
                                 const denoise_inputs *inputs, int frame)
{
    const image *main = &inputs->images[inputs->main];
    image_request request = {
        inputs->main, settings->layers[inputs->main], 0, IMAGE_FLOAT, 0, NULL,
        settings->device.threads};
    image_error error;
    image_status status;
    exit_code code = EXIT_OK;
    char *path = sequence_path(settings->reference, frame);
    if (!path)
        return fail(settings->reference, "not enough memory");
    status = image_read(reference, path, &request, &error);
    if (status == IMAGE_ERROR_LAYER && request.layer) { /* a file of another renderer, or plain */
        request.layer = NULL;
        status = image_read(reference, path, &request, &error);
    }
    if (status) {
        code = fail(path, error.text);
    } else if (reference->width != main->width || reference->height != main->height ||
               reference->channels != main->channels) {
        code = report_error(
            EXIT_INPUT,
            "the reference '%s' has %zux%zu pixels of %u channels, but '%s' has %zux%zu of %u",
            path, reference->width, reference->height, reference->channels,
            inputs->paths[inputs->main], main->width, main->height, main->channels);
        image_destroy(reference);
    } else {
        linearise(reference, settings, inputs->main, path);
    }
    free(path);
    return code;
}
