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

/* 1 if a role's layer is looked for in the colour's file. */
static int is_sought(const denoise_settings *settings, image_role role)
{
    if (settings->files[role] || is_none(settings->layers[role]) || settings->is_directional ||
        strcmp(settings->filter, "RT"))
        return 0;
    if (role == IMAGE_MOTION)
        return settings->is_temporal;
    return !settings->only_given || settings->layers[role];
}

/* What is looked for beside the colour, read along with it. */
typedef struct companions {
    image_beside list[IMAGE_MAX_BESIDE];
    unsigned count;
} companions;

static image_request make_request(const denoise_settings *settings, image_role role)
{
    image_request request = {.role = role};
    request.layer = settings->layers[role];
    request.type = type_of(settings, role);
    request.threads = settings->device.threads;
    return request;
}

static void seek_companions(companions *found, denoise_inputs *inputs,
                            const denoise_settings *settings)
{
    found->count = 0;
    for (int i = 0; i < IMAGE_ROLES; i++) {
        image_beside *beside = &found->list[found->count];
        if (i == IMAGE_COLOR || !is_sought(settings, (image_role)i))
            continue;
        beside->out = &inputs->images[i];
        beside->request = make_request(settings, (image_role)i);
        beside->request.is_exact = 1;
        found->count++;
    }
}

/* Loads the file given for a role, and with the colour what is found beside it. */
static exit_code load_given(denoise_inputs *inputs, const denoise_settings *settings,
                            image_role role, int frame, companions *found)
{
    image_error error;
    image_request request = make_request(settings, role);
    if (role == IMAGE_COLOR) {
        request.beside = found->list;
        request.beside_count = found->count;
    }
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

/* Takes an auxiliary layer of the colour's file. A file without one is no error, unless the layer
 * was named. */
static exit_code take_found(denoise_inputs *inputs, const denoise_settings *settings,
                            const image_beside *beside, int frame)
{
    image_role role = beside->request.role;
    if (beside->status && (beside->status != IMAGE_ERROR_LAYER || beside->request.layer))
        return fail(inputs->paths[IMAGE_COLOR], beside->error.text);
    if (beside->status)
        return EXIT_OK;
    inputs->has_light |= image_is_light(&inputs->images[role], &inputs->images[IMAGE_COLOR]);
    if (role == IMAGE_ALBEDO && inputs->has_light) {
        image_destroy(&inputs->images[role]);
        return EXIT_OK;
    }
    inputs->is_found[role] = !beside->request.layer;
    inputs->paths[role] = sequence_path(settings->files[IMAGE_COLOR], frame);
    return inputs->paths[role] ? EXIT_OK : fail(settings->files[IMAGE_COLOR], "not enough memory");
}

/* All images of the frame. */
static exit_code load_all(denoise_inputs *inputs, const denoise_settings *settings, int frame)
{
    companions found;
    unsigned taken = 0;
    seek_companions(&found, inputs, settings);
    for (int i = 0; i < IMAGE_ROLES; i++) {
        image_role role = (image_role)i;
        exit_code code = EXIT_OK;
        if (settings->files[role])
            code = load_given(inputs, settings, role, frame, &found);
        else if (taken < found.count && found.list[taken].request.role == role &&
                 inputs->images[IMAGE_COLOR].is_layered)
            code = take_found(inputs, settings, &found.list[taken++], frame);
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
    image_request request = make_request(settings, inputs->main);
    image_error error;
    image_status status;
    exit_code code = EXIT_OK;
    char *path = sequence_path(settings->reference, frame);
    if (!path)
        return fail(settings->reference, "not enough memory");
    request.type = IMAGE_FLOAT;
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
    } else {
        code = image_check_aligned(reference, "reference", path, main, inputs->paths[inputs->main]);
    }
    if (code) {
        image_destroy(reference);
    } else {
        linearise(reference, settings, inputs->main, path);
    }
    free(path);
    return code;
}
