/* yimgdenoise: the denoiser behind the options of Yocto/GL's program of that name, for scripts that
 * use it. docs/apps.md. */
#include <limits.h>
#include <stdio.h>

#include "denoise.h"

typedef denoise_settings S;

static int set_input(void *settings, const char *const *v)
{
    S *s = settings;
    s->files[IMAGE_COLOR] = v[0];
    s->is_hdr = image_path_is_linear(v[0]);
    return 0;
}

static int set_output(void *settings, const char *const *v)
{
    S *s = settings;
    s->outputs[0] = v[0];
    s->output_count = 1;
    return 0;
}

/* Yocto's programs take true and false where others take 1 and 0. */
static const option_word truths[] = {{"1 true", 1}, {"0 false", 0}, {NULL, 0}};

#define AT(field) offsetof(S, field)
static const option table[] = {
    {OPTION_CALL, "i input-image", 0, 0, 0, NULL, set_input, 1, "FILE",
     "noisy image; HDR if it is exr, pfm, phm or hdr"},
    {OPTION_CALL, "o output-image", 0, 0, 0, NULL, set_output, 1, "FILE", "where to write"},
    {OPTION_TEXT, "a albedo", AT(files[IMAGE_ALBEDO]), 0, 0, NULL, NULL, 1, "FILE", "albedo"},
    {OPTION_TEXT, "n normal", AT(files[IMAGE_NORMAL]), 0, 0, NULL, NULL, 1, "FILE",
     "normals in [-1, 1]"},
    {OPTION_INT, "m maxMemoryMB", AT(max_memory), -1, INT_MAX, NULL, NULL, 1, "MB",
     "memory to keep within"},
    {OPTION_INT, "t numThreads", AT(device.threads), -1, INT_MAX, NULL, NULL, 1, "N",
     "threads (all)"},
    {OPTION_INT, "verbose", AT(device.verbose), -1, 4, NULL, NULL, 1, "0-3",
     "messages of the library"},
    {OPTION_WORD, "setAffinity", AT(device.affinity), 0, 0, truths, NULL, 1, "0|1",
     "bind threads to cores"},
    {OPTION_FLAG, "h help", AT(is_help), 1, 0, NULL, NULL, 0, NULL, "this text"},
};
#define OPTIONS (sizeof table / sizeof table[0])

int main(int argc, char **argv)
{
    S settings;
    image_error error;
    denoise_set_defaults(&settings);
    if (options_parse(table, OPTIONS, &settings, NULL, argc, argv))
        return EXIT_USAGE;
    if (settings.is_help || argc <= 1) {
        printf("yimgdenoise: removes noise from path-traced images\n"
               "usage: yimgdenoise -i IMAGE -o OUTPUT [-a ALBEDO] [-n NORMAL] ...\n\n");
        options_print(table, OPTIONS);
        return EXIT_USAGE;
    }
    if (!settings.files[IMAGE_COLOR] || !settings.output_count)
        return report_error(EXIT_USAGE, "--input-image and --output-image are needed");
    if (image_check_writable(settings.outputs[0], &error))
        return report_error(EXIT_OUTPUT, "cannot write '%s': %s", settings.outputs[0], error.text);
    return denoise_run(&settings);
}
