/* lullInfo: what lull sees. Without arguments the processor, the ports of this build and the
 * built-in models; with --opencl the OpenCL device; of weights files the network, its cost and
 * memory; of images their size, layers and values; with --compare the distance of images from a
 * reference. docs/apps.md is its manual. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <lull.h>

#include "compare.h"
#include "device.h"
#include "json.h"
#include "layers.h"
#include "platform.h"
#include "report.h"

typedef struct settings {
    const char *reference;
    const char **files; /* [argc] */
    int count;
    int width, height;
    int is_json, is_help, tells_opencl;
} settings;

/* ---- Processor ------------------------------------------------------------------------------- */

/* Ports that may be used: LULL_PORTS in the environment names the strongest. */
static uint32_t allowed_ports(void)
{
    const char *name = getenv("LULL_PORTS");
    uint32_t ports = name ? lull_ports_up_to(name, strlen(name)) : 0;
    return ports ? ports : LULL_PORTS_ALL;
}

static void tell_ports(json *report)
{
    uint32_t available = lull_ports_available();
    const char *cpu = oidnGetNumPhysicalDevices() > 0 ? oidnGetPhysicalDeviceString(0, "name") : "";
    report_line("lull %d.%d.%d\n", LULL_VERSION_MAJOR, LULL_VERSION_MINOR, LULL_VERSION_PATCH);
    report_line("CPU: %s\n", cpu ? cpu : "unknown");
    json_text(report, "cpu", cpu ? cpu : "unknown");
    json_open(report, "ports", '[');
    for (unsigned i = 0; lull_port_name(i); i++) {
        int runs = (available >> i & 1u) != 0;
        int is_allowed = (allowed_ports() >> i & 1u) != 0;
        report_line("  %-10s %s\n", lull_port_name(i),
                    !runs        ? "not on this CPU"
                    : is_allowed ? "runs here"
                                 : "not allowed by LULL_PORTS");
        json_open(report, NULL, '{');
        json_text(report, "name", lull_port_name(i));
        json_bool(report, "available", runs);
        json_bool(report, "allowed", is_allowed);
        json_close(report, '}');
    }
    json_close(report, ']');
    report_line("Kernels:\n");
    json_open(report, "kernels", '{');
    for (unsigned i = 0; lull_kernel_name(i); i++) {
        const char *port = lull_port_name(lull_kernel_port(i, allowed_ports()));
        report_line("  %-12s %s\n", lull_kernel_name(i), port);
        json_text(report, lull_kernel_name(i), port);
    }
    json_close(report, '}');
}

/* The OpenCL device that would be used, or why there is none. Asked for only: some drivers end the
 * program where they do not like the machine. */
static void tell_opencl(json *report)
{
    OIDNDevice device = oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL);
    const char *why = NULL;
    oidnGetDeviceError(device, &why);
    if (device) {
        report_line("OpenCL: %s\n", lull_device_name(device));
        json_text(report, "opencl", lull_device_name(device));
        oidnReleaseDevice(device);
    } else {
        report_line("OpenCL: none (%s)\n", why);
        json_text(report, "opencl", "");
    }
}

/* ---- Weights --------------------------------------------------------------------------------- */

static int is_weights(const char *path)
{
    unsigned char head[2] = {0, 0};
    FILE *file = platform_is_directory(path) ? NULL : fopen(path, "rb");
    /* A pipe gives its bytes once, to who reads the picture. */
    size_t n = file && platform_file_size(file) >= 0 ? fread(head, 1, 2, file) : 0;
    if (file)
        fclose(file);
    return n == 2 && head[0] == 0xd7 && head[1] == 0x41;
}

/* Aligned memory from malloc; *block is what to free. */
static void *aligned(size_t bytes, void **block)
{
    *block = malloc(bytes + LULL_ALIGN);
    if (!*block)
        return NULL;
    return (char *)*block + (LULL_ALIGN - (uintptr_t)*block % LULL_ALIGN) % LULL_ALIGN;
}

static void tell_model(const settings *s, const char *path, const lull_model *model,
                       size_t file_bytes, size_t model_bytes, json *report)
{
    static const unsigned features[] = {0, LULL_HAS_COLOR, LULL_HAS_COLOR | LULL_HAS_ALBEDO,
                                        LULL_HAS_COLOR | LULL_HAS_ALBEDO | LULL_HAS_NORMAL};
    lull_model_info info;
    lull_frame frame;
    size_t plan, least, streamed;
    lull_model_get_info(model, &info);
    frame = lull_frame_default((unsigned)s->width, (unsigned)s->height, LULL_HDR,
                               features[info.inputs / 3 <= 3 ? info.inputs / 3 : 3]);
    if (info.is_alone)
        frame = lull_frame_default((unsigned)s->width, (unsigned)s->height, LULL_LDR,
                                   LULL_HAS_ALBEDO);
    plan = lull_plan_size(&frame, model);
    least = lull_plan_minimum(&frame, model);
    frame.row_step = 1;
    frame.strip_width = frame.width; /* in one strip: nothing is computed twice */
    streamed = lull_plan_size(&frame, model);
    report_line("%s: %s, %u inputs, %s%s\n", path, info.network, info.inputs,
                info.is_integer ? "int8" : "fp16",
                info.is_alone ? ", for an albedo or normals alone" : "");
    report_line("  %.1f kMAC/pixel, %llu parameters, %zu bytes in the file, %zu in memory\n",
                (double)info.macs_per_pixel / 1000, (unsigned long long)info.parameters, file_bytes,
                model_bytes);
    report_line("  %dx%d: %.1f MB of working memory, %.1f MB row by row, %.1f MB in strips\n",
                s->width, s->height, (double)plan / 1e6, (double)streamed / 1e6,
                (double)least / 1e6);
    json_text(report, "network", info.network);
    json_number(report, "inputs", info.inputs);
    json_bool(report, "integer", (int)info.is_integer);
    json_bool(report, "alone", (int)info.is_alone);
    json_number(report, "macs_per_pixel", (double)info.macs_per_pixel);
    json_number(report, "parameters", (double)info.parameters);
    json_number(report, "file_bytes", (double)file_bytes);
    json_number(report, "model_bytes", (double)model_bytes);
    json_number(report, "width", s->width);
    json_number(report, "height", s->height);
    json_number(report, "plan_bytes", (double)plan);
    json_number(report, "plan_streamed_bytes", (double)streamed);
    json_number(report, "plan_minimum_bytes", (double)least);
}

static exit_code tell_tza(const settings *s, const char *name, const void *tza, size_t bytes,
                          json *report)
{
    size_t model_bytes = lull_model_size(tza, bytes, allowed_ports());
    void *block = NULL, *memory;
    lull_model *model = NULL;
    lull_status status;
    exit_code code = EXIT_OK;
    /* Without a size lull_model_init says what is wrong; 64 KiB are enough for that. */
    memory = aligned(model_bytes ? model_bytes : 65536, &block);
    status = memory ? lull_model_init(&model, memory, model_bytes ? model_bytes : 65536, tza, bytes,
                                      allowed_ports())
                    : LULL_ERROR_MEMORY;
    if (status)
        code = report_error(EXIT_INPUT, "cannot use the weights '%s': %s", name,
                            lull_status_text(status));
    else
        tell_model(s, name, model, bytes, model_bytes, report);
    free(block);
    return code;
}

static exit_code tell_weights(const settings *s, const char *path, json *report)
{
    size_t bytes = 0;
    void *tza = device_load_weights(path, &bytes);
    exit_code code = tza ? tell_tza(s, path, tza, bytes, report) : EXIT_INPUT;
    free(tza);
    return code;
}

/* The weights that the build put into the library. */
#define BUILTIN(id, file, content, features, clean_aux, qualities) \
    extern const unsigned char lull_weights_##id[];                \
    extern const size_t lull_weights_##id##_bytes;
#include "builtin.def"
#undef BUILTIN

static exit_code tell_builtin(const settings *s, json *report)
{
    static const struct {
        const char *file;
        const unsigned char *data;
        const size_t *bytes;
    } models[] = {
#define BUILTIN(id, file, content, features, clean_aux, qualities) \
    {file, lull_weights_##id, &lull_weights_##id##_bytes},
#include "builtin.def"
        {NULL, NULL, NULL}};
    exit_code code = EXIT_OK;
    report_line("Built-in models:\n");
    json_open(report, "models", '[');
    for (unsigned i = 0; models[i].file && !code; i++) {
        json_open(report, NULL, '{');
        json_text(report, "file", models[i].file);
        code = tell_tza(s, models[i].file, models[i].data, *models[i].bytes, report);
        json_close(report, '}');
    }
    json_close(report, ']');
    return code;
}

/* ---- Images ---------------------------------------------------------------------------------- */

static void tell_values(const image *img, json *report)
{
    size_t n = image_count(img), finite = 0;
    float least = INFINITY, most = -INFINITY;
    double sum = 0;
    char text[16];
    for (size_t i = 0; i < n; i++) {
        float v = image_get(img, i);
        if (!isfinite(v))
            continue;
        finite++;
        sum += v;
        least = v < least ? v : least;
        most = v > most ? v : most;
    }
    snprintf(text, sizeof text, "%08x", (unsigned)image_hash(img));
    report_line(" min=%g, max=%g, mean=%g, nonfinite=%zu, hash=%s\n", (double)least, (double)most,
                finite ? sum / (double)finite : 0, n - finite, text);
    json_number(report, "min", (double)least);
    json_number(report, "max", (double)most);
    json_number(report, "mean", finite ? sum / (double)finite : 0);
    json_number(report, "nonfinite", (double)(n - finite));
    json_text(report, "hash", text);
}

static void tell_layer(const image *img, image_role role, json *report)
{
    report_line("  %s", layers_role_name(role));
    json_open(report, layers_role_name(role), '{');
    if (img->is_layered) {
        report_line(" (");
        json_open(report, "layer", '[');
        for (unsigned c = 0; c < img->channels; c++) {
            report_line("%s%s", c ? " " : "", img->names[c]);
            json_text(report, NULL, img->names[c]);
        }
        report_line(")");
        json_close(report, ']');
    }
    json_text(report, "type", img->type == IMAGE_HALF ? "half" : "float");
    report_line(": %s,", img->type == IMAGE_HALF ? "half" : "float");
    tell_values(img, report);
    json_close(report, '}');
}

/* Reads colour, albedo and normals of a file, each with its status: those beside a colour along
 * with it. */
static void read_layers(image_beside *layers, const char *path)
{
    for (int i = 0; i < 3; i++) {
        image_beside *layer = &layers[i];
        layer->request.role = (image_role)i;
        layer->request.is_exact = i > 0;
        layer->request.beside = i ? NULL : layers + 1;
        layer->request.beside_count = i ? 0 : 2;
    }
    for (int i = 0; i < 3; i++) {
        image_beside *layer = &layers[i];
        layer->status = image_read(layer->out, path, &layer->request, &layer->error);
        if (layers[0].out->pixels || (layer->status && layer->status != IMAGE_ERROR_LAYER))
            break;
    }
}

/* What a file has of colour, albedo and normals. Values are as stored. */
static exit_code tell_layers(const image_beside *layers, const char *path, json *report)
{
    int is_told = 0, is_alone = layers[0].out->pixels && !layers[0].out->is_layered;
    for (int i = 0; i < (is_alone ? 1 : 3); i++) {
        const image *img = layers[i].out;
        if (layers[i].status && layers[i].status != IMAGE_ERROR_LAYER)
            return report_error(EXIT_INPUT, "cannot read '%s': %s", path, layers[i].error.text);
        if (layers[i].status || (layers[0].out->pixels && image_is_light(img, layers[0].out)))
            continue;
        if (!is_told++) {
            report_line("%s: %zux%zu, %u channels%s\n", path, img->width, img->height,
                        img->channels, img->alpha ? " and alpha" : "");
            json_number(report, "width", (double)img->width);
            json_number(report, "height", (double)img->height);
            json_number(report, "channels", img->channels);
        }
        tell_layer(img, (image_role)i, report);
    }
    return is_told ? EXIT_OK
                   : report_error(EXIT_INPUT, "cannot read '%s': %s", path, layers[0].error.text);
}

static exit_code tell_image(const char *path, json *report)
{
    image images[3];
    image_beside layers[3];
    exit_code code;
    memset(images, 0, sizeof images);
    memset(layers, 0, sizeof layers);
    for (int i = 0; i < 3; i++)
        layers[i].out = &images[i];
    read_layers(layers, path);
    code = tell_layers(layers, path, report);
    for (int i = 0; i < 3; i++)
        image_destroy(&images[i]);
    return code;
}

/* ---- Comparison ------------------------------------------------------------------------------ */

static float luminance_at(const image *img, size_t pixel)
{
    static const float weights[3] = {0.2127f, 0.7152f, 0.0722f};
    float sum = 0;
    if (img->channels != 3)
        return image_get(img, pixel * img->channels);
    for (unsigned c = 0; c < 3; c++)
        sum += weights[c] * image_get(img, pixel * 3 + c);
    return sum;
}

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Factor that brings the 97th percentile of the luminance to 0.8; 1 if that is not possible. */
static float display_scale(const image *img)
{
    size_t n = img->width * img->height;
    float *values = malloc(n * sizeof *values), high = 0;
    for (size_t i = 0; values && i < n; i++) {
        values[i] = luminance_at(img, i);
        values[i] = isfinite(values[i]) ? values[i] : 0;
    }
    if (values) {
        qsort(values, n, sizeof *values, ascending);
        high = values[(size_t)(0.97 * (double)(n - 1))];
    }
    free(values);
    return high > 0 ? 0.8f / high : 1;
}

static float display(float v, float scale)
{
    v *= scale;
    return srgb_encode(v > 0 ? v < 1 ? v : 1 : 0);
}

/* Peak signal to noise ratio in dB of the images as they would be shown: scaled, clipped, sRGB. */
static double find_psnr(const image *reference, const image *img, float scale)
{
    double sum = 0;
    size_t n = image_count(img);
    for (size_t i = 0; i < n; i++) {
        double d = display(image_get(img, i), scale) - display(image_get(reference, i), scale);
        sum += d * d;
    }
    return sum > 0 ? -10 * log10(sum / (double)n) : INFINITY;
}

/* The main image of a file with linear values. */
static exit_code load_linear(image *img, const char *path)
{
    image_request request = {.role = IMAGE_COLOR, .type = IMAGE_FLOAT};
    image_error error;
    if (image_read(img, path, &request, &error))
        return report_error(EXIT_INPUT, "cannot read '%s': %s", path, error.text);
    if (!image_is_linear(img, path))
        image_decode_srgb(img);
    return EXIT_OK;
}

static exit_code tell_comparison(const settings *s, const image *reference, float scale,
                                 const char *path, json *report)
{
    image img;
    comparison result;
    double psnr;
    exit_code code = load_linear(&img, path);
    if (code)
        return code;
    if (img.width != reference->width || img.height != reference->height ||
        img.channels != reference->channels) {
        image_destroy(&img);
        return report_error(EXIT_INPUT, "'%s' and '%s' differ in size or channels", path,
                            s->reference);
    }
    image_compare(&result, reference, &img, COMPARE_MAX_ERROR);
    psnr = find_psnr(reference, &img, scale);
    report_line("%s: psnr=%.2f, values=%zu, errors=%zu, avgerror=%g\n", path, psnr, result.values,
                result.errors, result.average);
    json_number(report, "psnr", psnr);
    json_number(report, "values", (double)result.values);
    json_number(report, "errors", (double)result.errors);
    json_number(report, "avgerror", result.average);
    image_destroy(&img);
    return EXIT_OK;
}

/* ---- Main ------------------------------------------------------------------------------------ */

static int add_file(void *user, const char *path)
{
    settings *s = user;
    s->files[s->count++] = path;
    return 0;
}

static int set_size(void *user, const char *const *v)
{
    settings *s = user;
    return !option_parse_int(v[0], 1, IMAGE_MAX_SIZE, &s->width) ||
           !option_parse_int(v[1], 1, IMAGE_MAX_SIZE, &s->height);
}

#define AT(field) offsetof(settings, field)
static const option table[] = {
    TEXT("compare", reference, "REFERENCE", "distance of the images from this one"),
    CALL("s size", set_size, 2, "W H", "frame whose memory is told of weights (1920 1080)"),
    FLAG("opencl", tells_opencl, 1, "name the OpenCL device, too"),
    FLAG("json", is_json, 1, "print one JSON object instead of text"),
    FLAG("h help", is_help, 1, "this text"),
};
#define OPTIONS (sizeof table / sizeof table[0])

static exit_code run(const settings *s, json *report)
{
    image reference = {0};
    float scale = 1;
    exit_code code = EXIT_OK;
    if (!s->count && !s->reference) {
        tell_ports(report);
        if (s->tells_opencl)
            tell_opencl(report);
        return tell_builtin(s, report);
    }
    if (!s->count)
        return report_error(EXIT_USAGE, "--compare: there is no image to compare with '%s'",
                            s->reference);
    if (s->reference) {
        code = load_linear(&reference, s->reference);
        scale = code ? 1 : display_scale(&reference);
    }
    json_open(report, "files", '[');
    for (int i = 0; i < s->count && !code; i++) {
        json_open(report, NULL, '{');
        json_text(report, "file", s->files[i]);
        if (s->reference)
            code = tell_comparison(s, &reference, scale, s->files[i], report);
        else if (is_weights(s->files[i]))
            code = tell_weights(s, s->files[i], report);
        else
            code = tell_image(s->files[i], report);
        json_close(report, '}');
    }
    json_close(report, ']');
    image_destroy(&reference);
    return code;
}

int main(int argc, char **argv)
{
    settings s;
    json report;
    exit_code code;
    memset(&s, 0, sizeof s);
    memset(&report, 0, sizeof report);
    lull_ports_request(); /* before anything asks which ports there are */
    s.width = 1920;
    s.height = 1080;
    s.files = calloc((size_t)argc + 1, sizeof *s.files);
    if (!s.files)
        return report_error(EXIT_INPUT, "not enough memory");
    if (options_parse(table, OPTIONS, &s, add_file, argc, argv)) {
        free(s.files);
        return report_refusal(EXIT_USAGE, argc, argv);
    }
    if (s.is_help) {
        printf("lullInfo: processor and ports; weights; images\n"
               "usage: lullInfo [WEIGHTS.tza | IMAGE]...\n"
               "       lullInfo --compare REFERENCE IMAGE...\n\n");
        options_print(table, OPTIONS);
        free(s.files);
        return EXIT_USAGE;
    }
    if (s.is_json)
        report_be_quiet();
    json_open(&report, NULL, '{');
    code = run(&s, &report);
    if (!code && !s.is_json)
        code = report_check_text();
    code = report_end(&report, code, s.is_json);
    free(s.files);
    return code;
}
