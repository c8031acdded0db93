/* oidnBenchmark: times the filters on random images, with the options, the list and the result
 * lines of Open Image Denoise's program of that name. docs/apps.md is its manual. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "device.h"
#include "json.h"
#include "pattern.h"
#include "platform.h"
#include "report.h"

/* Where images are kept; the copying ones move inputs and outputs at each run. */
typedef struct storage {
    OIDNStorage kind;
    int is_copied;
} storage;

static const storage storages[] = {
    {OIDN_STORAGE_HOST, 0},   {OIDN_STORAGE_HOST, 1},    {OIDN_STORAGE_DEVICE, 0},
    {OIDN_STORAGE_DEVICE, 1}, {OIDN_STORAGE_MANAGED, 0}, {OIDN_STORAGE_MANAGED, 1},
};

static const option_word storage_words[] = {
    {"host", 0},    {"hostcopy", 1},    {"device", 2}, {"devicecopy", 3},
    {"managed", 4}, {"managedcopy", 5}, {NULL, 0},
};

typedef struct settings {
    device_settings device;
    const char *pattern, *weights;
    int width, height; /* 0: the standard sizes */
    int runs;          /* 0: as many as fit in half a second, 3 at least */
    int type, quality, storage, max_memory, ensemble;
    int is_in_place, is_json, is_list, is_device_list, is_help;
} settings;

/* ---- What there is to run -------------------------------------------------------------------- */

typedef struct benchmark {
    const char *name, *filter;
    const char *inputs[4]; /* color must be the first */
    int is_hdr, is_aux_clean;
} benchmark;

static const benchmark path_traced[] = {
    {"hdr_alb_nrm", "RT", {"color", "albedo", "normal", NULL}, 1, 0},
    {"ldr_alb_nrm", "RT", {"color", "albedo", "normal", NULL}, 0, 0},
    {"hdr_calb_cnrm", "RT", {"color", "albedo", "normal", NULL}, 1, 1},
    {"ldr_calb_cnrm", "RT", {"color", "albedo", "normal", NULL}, 0, 1},
};

static const benchmark light_maps[] = {{"hdr", "RTLightmap", {"color", NULL}, 1, 0}};

typedef struct frame_size {
    int width, height;
} frame_size;

static const frame_size path_traced_sizes[] = {{1920, 1080}, {3840, 2160}, {1280, 720}};
static const frame_size light_map_sizes[] = {{2048, 2048}, {4096, 4096}, {1024, 1024}};
#define SIZES 3

/* Calls `visit` for each benchmark with its full name until one returns not 0. */
static exit_code for_each(const settings *s, void *user,
                          exit_code (*visit)(void *user, const benchmark *b, frame_size size,
                                             const char *name))
{
    static const struct {
        const benchmark *list;
        size_t count;
        const frame_size *sizes;
    } groups[] = {
        {path_traced, sizeof path_traced / sizeof path_traced[0], path_traced_sizes},
        {light_maps, sizeof light_maps / sizeof light_maps[0], light_map_sizes},
    };
    for (size_t g = 0; g < sizeof groups / sizeof groups[0]; g++)
        for (size_t k = 0; k < (s->width ? 1 : SIZES); k++)
            for (size_t i = 0; i < groups[g].count; i++) {
                const benchmark *b = &groups[g].list[i];
                frame_size size = groups[g].sizes[k];
                char name[96];
                exit_code code;
                if (s->width) {
                    size.width = s->width;
                    size.height = s->height;
                }
                snprintf(name, sizeof name, "%s.%s.%dx%d", b->filter, b->name, size.width,
                         size.height);
                if (s->pattern && !pattern_matches(s->pattern, name))
                    continue;
                code = visit(user, b, size, name);
                if (code)
                    return code;
            }
    return EXIT_OK;
}

static exit_code print_name(void *user, const benchmark *b, frame_size size, const char *name)
{
    (void)user;
    (void)b;
    (void)size;
    printf("%s\n", name);
    return EXIT_OK;
}

/* ---- One benchmark --------------------------------------------------------------------------- */

#define IMAGES 4 /* three inputs and the output */

typedef struct bench {
    const settings *s;
    OIDNDevice device;
    OIDNFilter filter;
    OIDNBuffer buffers[IMAGES];
    image images[IMAGES]; /* in host memory */
    unsigned count;       /* inputs */
    void *weights;
    size_t weights_size;
    json *report;
    double last_total; /* seconds that the benchmark before took; 0: there was none */
    unsigned done;
} bench;

static exit_code device_error(const bench *b)
{
    const char *text = NULL;
    OIDNError error = oidnGetDeviceError(b->device, &text);
    return error == OIDN_ERROR_NONE        ? EXIT_OK
           : error == OIDN_ERROR_CANCELLED ? EXIT_INTERRUPTED
                                           : report_error(EXIT_DENOISE, "%s", text);
}

/* Uniform noise; the same in every run and on every machine. */
static void fill(image *img, uint32_t seed, float low, float high)
{
    for (size_t i = 0, n = image_count(img); i < n; i++) {
        seed = seed * 1664525u + 1013904223u;
        image_set(img, i, low + (high - low) * ((float)(seed >> 8) / 16777216.0f));
    }
}

static exit_code make_images(bench *b, const benchmark *what, frame_size size)
{
    static const float low[3] = {0, 0, -1};
    float high[3] = {1, 1, 1};
    image_error error;
    unsigned output;
    high[0] = what->is_hdr ? 100 : 1;
    b->count = 0;
    while (what->inputs[b->count])
        b->count++;
    output = b->s->is_in_place ? 0 : b->count;
    for (unsigned i = 0; i < b->count + !b->s->is_in_place; i++) {
        image_type type = b->s->type == IMAGE_HALF ? IMAGE_HALF : IMAGE_FLOAT;
        if (image_create(&b->images[i], (size_t)size.width, (size_t)size.height, 3, type, &error))
            return report_error(EXIT_DENOISE, "%s", error.text);
        if (i < b->count)
            fill(&b->images[i], i + 1, low[i], high[i]);
        b->buffers[i] = oidnNewBufferWithStorage(b->device, image_bytes(&b->images[i]),
                                                 storages[b->s->storage].kind);
        if (!b->buffers[i])
            return device_error(b);
        if (i < b->count)
            oidnWriteBuffer(b->buffers[i], 0, image_bytes(&b->images[i]), b->images[i].pixels);
        oidnSetFilterImage(b->filter, i < b->count ? what->inputs[i] : "output", b->buffers[i],
                           device_format(&b->images[i]), b->images[i].width, b->images[i].height, 0,
                           0, 0);
    }
    if (b->s->is_in_place)
        oidnSetFilterImage(b->filter, "output", b->buffers[output], device_format(&b->images[0]),
                           b->images[0].width, b->images[0].height, 0, 0, 0);
    return device_error(b);
}

static bool on_progress(void *user, double n)
{
    (void)user;
    (void)n;
    return !platform_interrupted();
}

static exit_code make_filter(bench *b, const benchmark *what, frame_size size)
{
    exit_code code;
    b->filter = oidnNewFilter(b->device, what->filter);
    code = b->filter ? make_images(b, what, size) : device_error(b);
    if (code)
        return code;
    if (!strcmp(what->filter, "RT")) {
        oidnSetFilterBool(b->filter, "hdr", what->is_hdr != 0);
        oidnSetFilterBool(b->filter, "cleanAux", what->is_aux_clean != 0);
    }
    if (b->s->quality >= 0)
        oidnSetFilterInt(b->filter, "quality", b->s->quality);
    if (b->s->ensemble > 1)
        oidnSetFilterInt(b->filter, "ensemble", b->s->ensemble);
    if (b->s->max_memory >= 0)
        oidnSetFilterInt(b->filter, "maxMemoryMB", b->s->max_memory);
    if (b->weights)
        oidnSetSharedFilterData(b->filter, "weights", b->weights, b->weights_size);
    oidnSetFilterProgressMonitorFunction(b->filter, on_progress, NULL);
    oidnCommitFilter(b->filter);
    return device_error(b);
}

static void free_images(bench *b)
{
    for (unsigned i = 0; i < IMAGES; i++) {
        if (b->buffers[i])
            oidnReleaseBuffer(b->buffers[i]);
        b->buffers[i] = NULL;
        image_destroy(&b->images[i]);
    }
    if (b->filter)
        oidnReleaseFilter(b->filter);
    b->filter = NULL;
}

/* One run; adds the seconds it took, and those until it was submitted. */
static exit_code run_once(bench *b, double *total, double *host)
{
    double start = platform_clock();
    int is_copied = storages[b->s->storage].is_copied;
    unsigned output = b->s->is_in_place ? 0 : b->count;
    if (platform_interrupted())
        return EXIT_INTERRUPTED;
    for (unsigned i = 0; i < b->count && is_copied; i++)
        oidnWriteBufferAsync(b->buffers[i], 0, image_bytes(&b->images[i]), b->images[i].pixels);
    oidnExecuteFilterAsync(b->filter);
    if (is_copied)
        oidnReadBufferAsync(b->buffers[output], 0, image_bytes(&b->images[output]),
                            b->images[output].pixels);
    *host += platform_clock() - start;
    oidnSyncDevice(b->device);
    *total += platform_clock() - start;
    return device_error(b);
}

static exit_code run_all(bench *b, double *total, double *host, int *runs)
{
    double warm_up = 0, ignored = 0;
    exit_code code = EXIT_OK;
    *total = *host = 0;
    *runs = b->s->runs > 1 ? b->s->runs - 1 : 1;
    if (b->s->runs != 1)
        code = run_once(b, &warm_up, &ignored);
    if (!code && !b->s->runs) {
        warm_up = 0;
        code = run_once(b, &warm_up, &ignored);
        *runs = warm_up > 0.5 / 3 ? 3 : warm_up > 1e-6 ? (int)(0.5 / warm_up) : 500000;
    }
    for (int i = 0; i < *runs && !code; i++)
        code = run_once(b, total, host);
    return code;
}

static exit_code run_benchmark(void *user, const benchmark *what, frame_size size, const char *name)
{
    bench *b = user;
    double total = 0, host = 0;
    int runs = 0;
    exit_code code;
    if (b->last_total > 0) /* let the machine cool down */
        platform_sleep((unsigned)ceil(b->last_total / 2));
    if (platform_interrupted())
        return EXIT_INTERRUPTED;
    report_line("%s ...", name);
    code = make_filter(b, what, size);
    if (!code)
        code = run_all(b, &total, &host, &runs);
    free_images(b);
    if (code) {
        report_line("\n");
        return code;
    }
    report_line(" %g msec/image (host %g msec/image)\n", 1000 * total / runs, 1000 * host / runs);
    json_open(b->report, NULL, '{');
    json_text(b->report, "name", name);
    json_number(b->report, "width", size.width);
    json_number(b->report, "height", size.height);
    json_number(b->report, "runs", runs);
    json_number(b->report, "msec", 1000 * total / runs);
    json_number(b->report, "host_msec", 1000 * host / runs);
    json_close(b->report, '}');
    b->last_total = total;
    b->done++;
    return EXIT_OK;
}

static exit_code run(const settings *s)
{
    bench b;
    json report;
    char version[32];
    exit_code code = EXIT_OK;

    memset(&b, 0, sizeof b);
    memset(&report, 0, sizeof report);
    b.s = s;
    b.report = &report;
    platform_catch_interrupt();
    json_open(&report, NULL, '{');
    if (s->weights)
        b.weights = device_load_weights(s->weights, &b.weights_size);
    if (s->weights && !b.weights)
        code = EXIT_INPUT;
    b.device = code ? NULL : device_open(&s->device);
    if (!code && !b.device)
        code = EXIT_DENOISE;
    if (!code) {
        json_text(&report, "device", device_type_name(b.device));
        json_text(&report, "version", device_version(b.device, version));
        json_number(&report, "threads", oidnGetDeviceInt(b.device, "numThreads"));
        oidnGetDeviceError(b.device, NULL); /* devices without threads */
        json_open(&report, "benchmarks", '[');
        code = for_each(s, &b, run_benchmark);
        json_close(&report, ']');
    }
    if (!code && !b.done)
        code = report_error(EXIT_USAGE, "no benchmark is called '%s'; --list shows them",
                            s->pattern);
    if (b.device)
        oidnReleaseDevice(b.device);
    free(b.weights);
    if (code == EXIT_INTERRUPTED)
        report_error(code, "interrupted");
    if (!code && !s->is_json)
        code = report_check_text();
    json_number(&report, "peak_memory_bytes", (double)platform_peak_memory());
    return report_end(&report, code, s->is_json);
}

/* ---- Options --------------------------------------------------------------------------------- */

static int set_device(void *user, const char *const *v)
{
    return device_parse(&((settings *)user)->device, v[0]);
}

static int set_size(void *user, const char *const *v)
{
    settings *s = user;
    return !option_parse_int(v[0], 1, IMAGE_MAX_SIZE, &s->width) ||
           !option_parse_int(v[1], 1, IMAGE_MAX_SIZE, &s->height);
}

static int set_pattern(void *user, const char *const *v)
{
    ((settings *)user)->pattern = v[0];
    return pattern_error(v[0]) != NULL;
}

#define AT(field) offsetof(settings, field)
static const option table[] = {
    CALL("r run", set_pattern, 1, "REGEX", "run those whose whole name matches"),
    FLAG("l list", is_list, 1, "list the names"),
    INT("n", runs, 1, INT_MAX, "N", "runs, the first a warm-up (as many as fit in half a second)"),
    CALL("s size", set_size, 2, "W H", "another image size"),
    WORD("t type", type, device_types, "float|half", "values (float)"),
    WORD("q quality", quality, device_qualities, "default|h|high|b|balanced|f|fast|auto",
         "quality (high)"),
    WORD("ensemble", ensemble, device_ensembles, "1|2|4", "mean of so many orientations (1)"),
    DEVICE_OPTIONS(set_device),
    WORD("buffer", storage, storage_words, "host|hostcopy|device|devicecopy|managed|managedcopy",
         "where images are kept (device); copy: moved there and back at each run"),
    FLAG("json", is_json, 1, "print one JSON object instead of text"),
    INT("v verbose", device.verbose, 0, 4, "0-3", "messages of the library"),
    FLAG("ld list_devices list-devices listDevices listdevices", is_device_list, 1,
         "list the devices"),
    FLAG("h help", is_help, 1, "this text"),
};
#define OPTIONS (sizeof table / sizeof table[0])

int main(int argc, char **argv)
{
    settings s;
    memset(&s, 0, sizeof s);
    s.device = device_settings_default();
    s.storage = 2;
    s.quality = s.max_memory = -1;
    s.ensemble = 1;
    if (options_parse(table, OPTIONS, &s, NULL, argc, argv))
        return report_refusal(EXIT_USAGE, argc, argv);
    if (s.is_help) {
        printf("oidnBenchmark: times the denoising of random images\nusage: oidnBenchmark ...\n\n");
        options_print(table, OPTIONS);
        return EXIT_USAGE;
    }
    if (s.is_list) {
        for_each(&s, NULL, print_name);
        return report_check_text();
    }
    if (s.is_device_list) {
        device_print_list();
        return report_check_text();
    }
    if (s.is_json)
        report_be_quiet();
    return run(&s);
}
