/* Integer networks make the same bytes on every port, with any number of workers, strip width and
 * memory limit: one fingerprint each, written down here, for every compiler, optimisation and CPU.
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdlib.h>

#include "../check.h"
#include "../unit/hash.h"
#include "lull.h"

/* No multiple of a vector's width; three rows of the coarsest level. Most of the time goes into the
 * narrowest strips, of 16 columns. */
#define WIDTH 252u
#define HEIGHT 33u

static const struct {
    const char *weights;
    uint64_t fingerprint;
} networks[] = {
    {"tests/golden/int_unet_9_mixed/weights.tza", UINT64_C(0x9f2f2a6a87902e5b)},
    /* in patches; albedo and normals are narrow */
    {"tests/golden/int_unet_9_aux/weights.tza", UINT64_C(0xef6350109007385f)},
};

static const struct {
    unsigned workers, strip_width;
    int is_least; /* within the least memory */
} schedules[] = {{1, 0, 0}, {2, 64, 0}, {3, 160, 0}, {7, 0, 0}, {1, 0, 1}, {7, 0, 1}, {2, 160, 0}};

static float *features[3], *output;

static void *aligned(size_t bytes)
{
    void *p = NULL;
    return posix_memalign(&p, LULL_ALIGN, bytes) ? NULL : p;
}

/* Calls in reverse, as any order is allowed, by workers in turn. */
static void in_reverse(void *user, unsigned count, void (*body)(void *, unsigned, unsigned),
                       void *context)
{
    for (unsigned i = count; i-- > 0;)
        body(context, i, i % *(unsigned *)user);
}

static uint64_t run(const lull_model *model, unsigned workers, unsigned strip_width, int is_least)
{
    lull_frame frame = lull_frame_default(WIDTH, HEIGHT, LULL_HDR, 7);
    lull_host host = {&workers, in_reverse, NULL};
    lull_images images;
    lull_plan *plan = NULL;
    size_t bytes;
    void *memory;
    frame.threads = workers;
    frame.strip_width = strip_width;
    frame.max_bytes = is_least ? lull_plan_minimum(&frame, model) : 0;
    bytes = lull_plan_size(&frame, model);
    memory = aligned(bytes);
    if (!CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_OK))
        exit(1);
    memset(&images, 0, sizeof images);
    for (unsigned f = 0; f < 3; f++) {
        lull_image image = {features[f], LULL_F32, 3, 0, 0};
        *(f == 0 ? &images.color : f == 1 ? &images.albedo : &images.normal) = image;
    }
    images.output.data = output;
    images.output.channels = 3;
    images.input_scale = images.calm = images.ragged = NAN;
    memset(output, 0xff, (size_t)WIDTH * HEIGHT * 3 * sizeof *output);
    CHECK_EQ(lull_run(plan, &images, &host), LULL_OK);
    free(memory);
    return hash_floats(HASH_START, output, (size_t)WIDTH * HEIGHT * 3);
}

static void on_port(const void *tza, size_t tza_bytes, unsigned port, uint64_t fingerprint)
{
    uint32_t mask = (2u << port) - 1;
    size_t bytes = lull_model_size(tza, tza_bytes, mask);
    void *memory = aligned(bytes);
    lull_model *model = NULL;
    if (!CHECK_EQ(lull_model_init(&model, memory, bytes, tza, tza_bytes, mask), LULL_OK))
        exit(1);
    for (size_t s = 0; s < sizeof schedules / sizeof schedules[0]; s++) {
        uint64_t hash =
            run(model, schedules[s].workers, schedules[s].strip_width, schedules[s].is_least);
        if (!CHECK(hash == fingerprint))
            printf("  %s, %u workers, strips of %u%s: %08lx%08lx\n", lull_port_name(port),
                   schedules[s].workers, schedules[s].strip_width,
                   schedules[s].is_least ? ", least memory" : "", (unsigned long)(hash >> 32),
                   (unsigned long)(hash & 0xffffffffu));
    }
    free(memory);
}

static void on_ports(const char *weights, uint64_t fingerprint)
{
    static uint8_t tza[1 << 20];
    FILE *file = fopen(weights, "rb");
    size_t bytes = file ? fread(tza, 1, sizeof tza, file) : 0;
    if (!CHECK(bytes > 0))
        return;
    fclose(file);
    for (unsigned port = 0; lull_port_name(port); port++)
        if (lull_ports_available() >> port & 1)
            on_port(tza, bytes, port, fingerprint);
}

static void same_bytes_everywhere(void)
{
    uint32_t state = 77;
    output = malloc((size_t)WIDTH * HEIGHT * 3 * sizeof *output);
    for (unsigned f = 0; f < 3; f++) {
        features[f] = malloc((size_t)WIDTH * HEIGHT * 3 * sizeof **features);
        for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 3; i++)
            features[f][i] = (float)(random_bits(&state) >> 16) / (f == 0 ? 16384.0f : 65536.0f);
    }
    for (size_t i = 0; i < sizeof networks / sizeof networks[0]; i++)
        on_ports(networks[i].weights, networks[i].fingerprint);
    for (unsigned f = 0; f < 3; f++)
        free(features[f]);
    free(output);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    lull_ports_request();
    RUN(same_bytes_everywhere);
    return check_report();
}
