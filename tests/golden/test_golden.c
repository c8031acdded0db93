/* Golden vectors: tests/golden/<case>/ holds weights, the network's input and what an independent
 * implementation made of it. Floating-point cases (output.f32, from PyTorch) must agree within a
 * tolerance, integer ones (output.u15, from the numpy reference) exactly; every case must give
 * equal bytes for any row step, strip width and (integer) port.
 *
 * The network's input is fed through the image path as sRGB content, which leaves [0,1] values as
 * they are; normals are stored as 2v - 1. */
#define _POSIX_C_SOURCE 200809L
#include <dirent.h>
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "lull.h"
#include "plan.h"

#ifndef GOLDEN_FOLDER
#define GOLDEN_FOLDER "tests/golden"
#endif

typedef struct golden {
    char folder[512];
    void *weights, *output;
    float *input;
    size_t weights_bytes, output_bytes;
    unsigned height, width, inputs, outputs;
    int is_integer;
} golden;

static void *read_file(const char *folder, const char *name, size_t *bytes)
{
    char path[600];
    FILE *file;
    long size;
    void *data;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "rb");
    if (!file)
        return NULL;
    fseek(file, 0, SEEK_END);
    size = ftell(file);
    rewind(file);
    data = malloc((size_t)size + 1);
    *bytes = fread(data, 1, (size_t)size, file);
    ((char *)data)[*bytes] = 0;
    fclose(file);
    return data;
}

/* Little-endian words of 4 or 2 bytes to this machine's. */
static void swap_if_big(void *data, size_t bytes, size_t word)
{
    uint8_t *p = data;
    uint16_t probe = 1;
    if (*(uint8_t *)&probe == 1)
        return;
    for (size_t i = 0; i + word <= bytes; i += word)
        for (size_t k = 0; k < word / 2; k++) {
            uint8_t t = p[i + k];
            p[i + k] = p[i + word - 1 - k];
            p[i + word - 1 - k] = t;
        }
}

static int read_golden(golden *g, const char *name)
{
    size_t bytes;
    char *shape;
    snprintf(g->folder, sizeof g->folder, "%s/%s", GOLDEN_FOLDER, name);
    shape = read_file(g->folder, "shape.txt", &bytes);
    if (!shape)
        return 0;
    CHECK_EQ(sscanf(shape, "%u %u %u %u", &g->height, &g->width, &g->inputs, &g->outputs), 4);
    free(shape);
    g->weights = read_file(g->folder, "weights.tza", &g->weights_bytes);
    g->input = read_file(g->folder, "input.f32", &bytes);
    CHECK_EQ(bytes, (size_t)g->height * g->width * g->inputs * 4);
    swap_if_big(g->input, bytes, 4);
    g->output = read_file(g->folder, "output.u15", &g->output_bytes);
    g->is_integer = g->output != NULL;
    if (!g->output)
        g->output = read_file(g->folder, "output.f32", &g->output_bytes);
    swap_if_big(g->output, g->output_bytes, g->is_integer ? 2 : 4);
    return g->weights && g->input && g->output;
}

static void *aligned(size_t bytes)
{
    void *p = NULL;
    return posix_memalign(&p, LULL_ALIGN, bytes ? bytes : 1) ? NULL : p;
}

/* Layers made in patches in the run before, and how many of a net that fits its port makes so. */
static unsigned patched, expected;

/* Runs the network; returns H*W*3 floats. */
static float *run(const golden *g, uint32_t ports, unsigned row_step, unsigned strip_width,
                  float *output_scale)
{
    unsigned pixels = g->width * g->height;
    lull_frame frame = lull_frame_default(g->width, g->height, LULL_SRGB, 0);
    size_t model_bytes = lull_model_size(g->weights, g->weights_bytes, ports), plan_bytes;
    void *model_memory = aligned(model_bytes), *plan_memory;
    float *planes = malloc((size_t)pixels * 9 * sizeof *planes);
    float *out = calloc((size_t)pixels * 3, sizeof *out);
    lull_images images;
    lull_model *model;
    lull_plan *plan;
    lull_status status =
        lull_model_init(&model, model_memory, model_bytes, g->weights, g->weights_bytes, ports);
    if (!CHECK_EQ(status, LULL_OK)) {
        printf("%s: %s\n", g->folder, lull_status_text(status));
        exit(1);
    }
    frame.features = g->inputs == 3 ? 1 : g->inputs == 6 ? 3 : 7;
    frame.row_step = row_step;
    frame.strip_width = strip_width;
    plan_bytes = lull_plan_size(&frame, model);
    plan_memory = aligned(plan_bytes);
    CHECK_EQ(lull_plan_init(&plan, plan_memory, plan_bytes, &frame, model), LULL_OK);
    expected = model->kernels.patches_u == LULL_PATCHES_UP     ? 9
               : model->kernels.patches_u == LULL_PATCHES_OWN  ? 8
               : model->kernels.patches_u == LULL_PATCHES_WIDE ? 1
                                                               : 0;
    patched = 0;
    for (unsigned l = 0; l < model->graph.layers; l++)
        patched += lull_plan_is_patched(plan, l) != 0;
    for (unsigned f = 0; f < g->inputs / 3; f++)
        for (unsigned i = 0; i < pixels; i++)
            for (unsigned c = 0; c < 3; c++) {
                float v = g->input[i * g->inputs + 3 * f + c];
                planes[(f * pixels + i) * 3 + c] = f == 2 ? v * 2.0f - 1.0f : v;
            }
    memset(&images, 0, sizeof images);
    images.input_scale = 1.0f;
    for (unsigned f = 0; f < g->inputs / 3; f++) {
        lull_image image = {planes + (size_t)f * pixels * 3, LULL_F32, 3, 0, 0};
        *(f == 0 ? &images.color : f == 1 ? &images.albedo : &images.normal) = image;
    }
    images.output.data = out;
    images.output.channels = 3;
    CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
    *output_scale = model->output_scale;
    free(planes);
    free(plan_memory);
    free(model_memory);
    return out;
}

/* Largest difference from the golden output, clamped to [0,1] like the image path does. */
static void compare(const golden *g, const float *out, float output_scale)
{
    double worst = 0;
    for (unsigned i = 0; i < g->width * g->height; i++)
        for (unsigned c = 0; c < 3; c++) {
            float want = g->is_integer
                             ? (float)((uint16_t *)g->output)[i * g->outputs + c] * output_scale
                             : ((float *)g->output)[i * g->outputs + c];
            double difference = fabs((double)out[3 * i + c] - (want < 1.0f ? want : 1.0f));
            worst = difference > worst ? difference : worst;
        }
    if (worst > (g->is_integer ? 0.0 : 2e-5))
        printf("%s: largest difference %g\n", g->folder, worst);
    CHECK(worst <= (g->is_integer ? 0.0 : 2e-5));
}

static void check_case(const char *name)
{
    static const unsigned variants[][2] = {{16, 16}, {1, 0}, {1, 16}, {5, 32}, {64, 0}, {2, 48}};
    golden g;
    float scale, *first;
    size_t bytes;
    memset(&g, 0, sizeof g);
    if (!CHECK(read_golden(&g, name)))
        return;
    bytes = (size_t)g.width * g.height * 12;
    for (unsigned port = 0; lull_port_name(port); port++) {
        uint32_t mask = (2u << port) - 1;
        if (!(lull_ports_available() >> port & 1))
            continue;
        first = run(&g, mask, 0, 0, &scale);
        if (!expected || strstr(name, "patches"))
            CHECK_EQ(patched, expected);
        compare(&g, first, scale);
        for (size_t v = 0; v < sizeof variants / sizeof variants[0]; v++) {
            float *again = run(&g, mask, variants[v][0], variants[v][1], &scale);
            CHECK(memcmp(first, again, bytes) == 0);
            free(again);
        }
        free(first);
    }
    free(g.weights);
    free(g.input);
    free(g.output);
}

static int is_integer_case;

static void all_cases(void)
{
    DIR *folder = opendir(GOLDEN_FOLDER);
    struct dirent *entry;
    unsigned cases = 0;
    if (!CHECK(folder != NULL))
        return;
    while ((entry = readdir(folder)) != NULL) {
        char path[600];
        FILE *file;
        if (entry->d_name[0] == '.' || (strncmp(entry->d_name, "int_", 4) == 0) != is_integer_case)
            continue;
        snprintf(path, sizeof path, "%s/%s/shape.txt", GOLDEN_FOLDER, entry->d_name);
        file = fopen(path, "r");
        if (!file)
            continue;
        fclose(file);
        check_case(entry->d_name);
        cases++;
    }
    closedir(folder);
    CHECK(cases >= 4);
}

static void float_networks(void)
{
    is_integer_case = 0;
    all_cases();
}

static void integer_networks(void)
{
    is_integer_case = 1;
    all_cases();
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    lull_ports_request();
    RUN(float_networks);
    RUN(integer_networks);
    return check_report();
}
