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
    s->is_untold = 1;
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
    CALL("i input-image", set_input, 1, "FILE", "noisy image; HDR if it is exr, pfm, phm or hdr"),
    CALL("o output-image", set_output, 1, "FILE", "where to write"),
    TEXT("a albedo", files[IMAGE_ALBEDO], "FILE", "albedo"),
    TEXT("n normal", files[IMAGE_NORMAL], "FILE", "normals in [-1, 1]"),
    INT("m maxMemoryMB", max_memory, -1, INT_MAX, "MB", "memory to keep within"),
    INT("t numThreads", device.threads, -1, INT_MAX, "N", "threads (all)"),
    INT("verbose", device.verbose, -1, 4, "0-3", "messages of the library"),
    WORD("setAffinity", device.affinity, truths, "0|1", "bind threads to cores"),
    FLAG("h help", is_help, 1, "this text"),
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
