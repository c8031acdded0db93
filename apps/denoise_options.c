#include "denoise.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef denoise_settings S;

static int set_device(void *settings, const char *const *v)
{
    return device_parse(&((S *)settings)->device, v[0]);
}

static int set_hdr(void *settings, const char *const *v)
{
    S *s = settings;
    s->files[IMAGE_COLOR] = v[0];
    s->is_hdr = 1;
    s->is_untold = 0;
    return 0;
}

static int set_ldr(void *settings, const char *const *v)
{
    S *s = settings;
    s->files[IMAGE_COLOR] = v[0];
    s->is_hdr = s->is_untold = 0;
    return 0;
}

static int set_directional(void *settings, const char *const *v)
{
    S *s = settings;
    s->files[IMAGE_COLOR] = v[0];
    s->is_directional = 1;
    return 0;
}

/* An argument without dashes: the image to denoise. */
static int set_positional(void *settings, const char *path)
{
    S *s = settings;
    if (s->files[IMAGE_COLOR])
        return 1;
    s->files[IMAGE_COLOR] = path;
    s->is_hdr = image_path_is_linear(path);
    s->is_untold = 1;
    return 0;
}

static int add_output(void *settings, const char *const *v)
{
    S *s = settings;
    if (s->output_count < MAX_OUTPUTS)
        s->outputs[s->output_count] = v[0];
    s->output_count++;
    return !v[0][0];
}

static int add_layer(S *s, const char *name, int is_part)
{
    if (s->pass_count < MAX_PASSES) {
        s->passes[s->pass_count] = name;
        s->is_part[s->pass_count] = is_part;
    }
    s->pass_count++;
    s->part_count += is_part;
    return !name[0];
}

static int add_pass(void *settings, const char *const *v) { return add_layer(settings, v[0], 0); }
static int add_part(void *settings, const char *const *v) { return add_layer(settings, v[0], 1); }

/* ROLE=LAYER */
static int set_layer(void *settings, const char *const *v)
{
    static const option_word roles[] = {{"color colour hdr ldr", IMAGE_COLOR},
                                        {"albedo alb", IMAGE_ALBEDO},
                                        {"normal nrm", IMAGE_NORMAL},
                                        {"motion", IMAGE_MOTION},
                                        {NULL, 0}};
    S *s = settings;
    char role[16];
    size_t length = strcspn(v[0], "=");
    int index;
    if (length >= sizeof role || !v[0][length] || !v[0][length + 1])
        return 1;
    memcpy(role, v[0], length);
    role[length] = 0;
    index = option_word_value(roles, role);
    if (index < 0)
        return 1;
    s->layers[index] = v[0] + length + 1;
    return 0;
}

/* ACROSS,DOWN */
static int set_motion_scale(void *settings, const char *const *v)
{
    S *s = settings;
    char *end;
    s->motion_scale[0] = strtof(v[0], &end);
    if (end == v[0] || *end != ',')
        return 1;
    s->motion_scale[1] = strtof(end + 1, &end);
    s->has_motion_scale = 1;
    return *end || !isfinite(s->motion_scale[0]) || !isfinite(s->motion_scale[1]);
}

#define AT(field) offsetof(S, field)
static const option table[] = {
    HEADING("images"),
    CALL("hdr", set_hdr, 1, "FILE", "colour with high dynamic range"),
    CALL("ldr", set_ldr, 1, "FILE", "colour in [0, 1]"),
    CALL("dir", set_directional, 1, "FILE", "directional light map in [-1, 1]"),
    FLAG("srgb", is_srgb, 1, "--ldr is sRGB-encoded: values are taken and written as they are"),
    TEXT("alb albedo", files[IMAGE_ALBEDO], "FILE", "albedo in [0, 1]"),
    TEXT("nrm normal", files[IMAGE_NORMAL], "FILE", "normals in [-1, 1]"),
    FLAG("clean_aux clean-aux cleanAux cleanaux", is_aux_clean, 1,
         "albedo and normals have no noise"),
    FLAG("panorama", is_panorama, 1, "of a whole sphere (equirectangular): no seam is left"),
    FLAG("prefilter", is_prefiltering, 1,
         "denoise the albedo first: may help at 1 to 4 samples of fine textures"),
    CALL("layer layers", set_layer, 1, "ROLE=NAME",
         "layer that is color, albedo, normal or motion: its name, channels a,b,c, or none"),
    FLAG("no_aux no-aux noAux noaux", only_given, 1,
         "use no albedo and normals but those of --alb and --nrm"),
    CALL("pass", add_pass, 1, "NAME",
         "another layer to denoise, or A, the alpha; may be given several times"),
    CALL("part", add_part, 1, "NAME",
         "likewise, of those that add up to the colour: its result is the sum of theirs"),
    CALL("o out output", add_output, 1, "FILE", "where to write; may be given several times"),
    TEXT("frames", frames, "LIST", "1-240 or 1,5,10-20x2: for names with #### or %04d"),
    FLAG("temporal", is_temporal, 1, "with --frames: less noise and flicker, by the frames before"),
    TEXT("motion", files[IMAGE_MOTION], "FILE",
         "with --temporal: where pixels were in the frame before, less where they are"),
    CALL("motion_scale motion-scale", set_motion_scale, 1, "X,Y",
         "what these are multiplied by, to the right and down (signs are found)"),

    HEADING("denoising"),
    TEXT("f filter", filter, "RT|RTLightmap", "filter (RT)"),
    WORD("q quality", quality, device_qualities, "default|h|high|b|balanced|f|fast|auto",
         "quality (high); auto: the least that the image needs"),
    WORD("ensemble", ensemble, device_ensembles, "1|2|4",
         "denoise it upright and turned, and take the mean: better, takes as many times as long"),
    FLAG("split", is_split, 1,
         "also by the passes of light in the colour's file, and take the mean: better, slower"),
    FLOAT("is input_scale input-scale inputScale inputscale", input_scale, "X",
          "scale of the colour (chosen from the image)"),
    FLOAT("strength", strength, "0-1", "how much of the noise goes (1: what the filter removes)"),
    WORD("t type", type, device_types, "float|half", "values in memory (as in the file)"),
    DEVICE_OPTIONS(set_device),
    WORD("buffer", storage, device_storages, "host|device|managed", "where images are kept"),

    HEADING("checks and reports"),
    TEXT("r ref reference", reference, "FILE", "compare the result with this image"),
    FLOAT("maxerror maxError max_error maxerr max-error", max_error, "E",
          "average error that --ref allows (0.003; 0.05 for normals)"),
    INT("n", runs, 1, INT_MAX, "N", "denoise N times; all must give the same bytes"),
    FLAG("check", is_checking, 1,
         "say what looks wrong with the inputs; without -o do nothing else"),
    FLAG("repair", is_repairing, 1, "mend what --check finds and can be mended"),
    FLAG("json", is_json, 1, "print one JSON object instead of text"),
    INT("v verbose", device.verbose, 0, 4, "0-3", "messages of the library"),
    FLAG("ld list_devices list-devices listDevices listdevices", is_list, 1, "list the devices"),
    FLAG("h help", is_help, 1, "this text"),
};
#define OPTIONS (sizeof table / sizeof table[0])

void denoise_print_help(void)
{
    printf(
        "oidnDenoise: removes noise from path-traced images\n"
        "usage: oidnDenoise [IMAGE] [--hdr IMAGE] [--alb ALBEDO] [--nrm NORMAL] [-o OUTPUT] ...\n"
        "\n"
        "Reads and writes OpenEXR, PFM, PHM, PNG, Radiance HDR, PPM and PGM. Albedo and normals "
        "are taken\n"
        "from the layers of a multilayer EXR; its other layers and metadata are kept in an EXR "
        "output.\n");
    options_print(table, OPTIONS);
    printf("\nExit codes: 0 done, 1 usage, 2 input, 3 denoising or comparison, 4 output, 130 "
           "interrupted.\n");
}

void denoise_set_defaults(S *s)
{
    memset(s, 0, sizeof *s);
    s->device = device_settings_default();
    s->filter = "RT";
    s->runs = 1;
    s->max_memory = -1;
    s->storage = STORAGE_SHARED;
    s->quality = -1;
    s->ensemble = 1;
    s->input_scale = s->max_error = NAN;
    s->strength = 1;
}

/* 1 if an output holds layers: those are the formats whose colours are multiplied by alpha. */
static int has_layered_output(const S *s)
{
    for (int i = 0; i < s->output_count; i++)
        if (image_path_alpha(s->outputs[i]) == IMAGE_MULTIPLIED)
            return 1;
    return 0;
}

/* Combinations that no filter could make sense of. */
static exit_code validate(const S *s)
{
    image_error error;
    if (!s->files[0] && !s->files[1] && !s->files[2])
        return report_error(EXIT_USAGE, "no input image specified");
    if (s->output_count > MAX_OUTPUTS)
        return report_error(EXIT_USAGE, "-o is given %d times; at most %d are supported",
                            s->output_count, MAX_OUTPUTS);
    if (strcmp(s->filter, "RT") && strcmp(s->filter, "RTLightmap"))
        return report_error(EXIT_USAGE,
                            "option -f does not take '%s'; RT or RTLightmap is expected",
                            s->filter);
    if (s->is_hdr && s->is_srgb && !strcmp(s->filter, "RT"))
        return report_error(EXIT_USAGE, "--srgb does not go with --hdr: HDR images are linear");
    if (s->is_panorama && strcmp(s->filter, "RT"))
        return report_error(EXIT_USAGE, "--panorama is for the filter RT");
    if (!s->files[IMAGE_COLOR] && s->files[IMAGE_ALBEDO] && s->files[IMAGE_NORMAL])
        return report_error(EXIT_USAGE,
                            "albedo and normals cannot be denoised together without a colour");
    if (s->input_scale < 0)
        return report_error(EXIT_USAGE, "--is %g: the scale of light is not negative",
                            (double)s->input_scale);
    if (!(s->strength >= 0 && s->strength <= 1))
        return report_error(EXIT_USAGE, "--strength %g: a number from 0 to 1 is expected",
                            (double)s->strength);
    if (!s->is_temporal &&
        (s->files[IMAGE_MOTION] || s->layers[IMAGE_MOTION] || s->has_motion_scale))
        return report_error(EXIT_USAGE, "motion is of use with --temporal only");
    if (s->is_temporal && !s->frames)
        return report_error(EXIT_USAGE, "--temporal wants a sequence: --frames");
    if (s->is_temporal &&
        (!s->files[IMAGE_COLOR] || s->is_directional || s->runs > 1 || strcmp(s->filter, "RT")))
        return report_error(EXIT_USAGE, "--temporal is for colours, the filter RT and one run");
    if (s->pass_count > MAX_PASSES)
        return report_error(EXIT_USAGE,
                            "--pass and --part are given %d times; at most %d are supported",
                            s->pass_count, MAX_PASSES);
    if (s->pass_count && (!s->files[IMAGE_COLOR] || s->is_directional || s->is_temporal ||
                          strcmp(s->filter, "RT")))
        return report_error(EXIT_USAGE,
                            "--pass and --part are for layers beside a colour, the filter RT, and "
                            "frames one by one");
    if (s->part_count && s->runs > 1)
        return report_error(EXIT_USAGE,
                            "--part does not go with -n: each is denoised in its place");
    if (s->pass_count && s->output_count && !has_layered_output(s))
        return report_error(EXIT_USAGE,
                            "--pass and --part: '%s' holds no layers, an .exr file does",
                            s->outputs[0]);
    if (s->is_split && (!s->files[IMAGE_COLOR] || s->is_directional || s->is_temporal ||
                        s->part_count || strcmp(s->filter, "RT")))
        return report_error(EXIT_USAGE, "--split is for colours, the filter RT, frames one by one, "
                                        "and without --part");
    if (s->frames) {
        for (int i = 0; i < s->output_count; i++)
            if (!sequence_is_pattern(s->outputs[i]))
                return report_error(
                    EXIT_USAGE, "with --frames, the output '%s' needs #### or %%04d in its name",
                    s->outputs[i]);
    }
    for (int i = 0; i < s->output_count; i++)
        if (image_check_writable(s->outputs[i], &error))
            return report_error(EXIT_OUTPUT, "cannot write '%s': %s", s->outputs[i], error.text);
    return EXIT_OK;
}

exit_code denoise_parse(denoise_settings *settings, int argc, char **argv)
{
    denoise_set_defaults(settings);
    if (options_parse(table, OPTIONS, settings, set_positional, argc, argv))
        return EXIT_USAGE;
    return settings->is_help || settings->is_list ? EXIT_OK : validate(settings);
}
