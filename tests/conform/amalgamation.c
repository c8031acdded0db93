/* Fingerprints of frames that the core denoises, a line for each network, content and port: of
 * lull.c and of liblull.a they must be the same.
 *
 *     amalgamation FILE...        weights of direct networks; those of kernel prediction are linked
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lull.h"
#include "lull_weights.h"

#include "../unit/hash.h"

enum { WIDTH = 61, HEIGHT = 34, VALUES = WIDTH * HEIGHT * 3, MODEL = 4 << 20, PLAN = 8 << 20 };

static union {
    long double align;
    unsigned char bytes[MODEL + PLAN + LULL_ALIGN];
} memory;
static float features[3][VALUES], output[VALUES];

static lull_status denoise(const void *tza, size_t bytes, lull_content content, uint32_t ports)
{
    unsigned char *at = memory.bytes + (LULL_ALIGN - (uintptr_t)memory.bytes % LULL_ALIGN);
    lull_frame frame = lull_frame_default(WIDTH, HEIGHT, content, LULL_HAS_COLOR);
    lull_images images = {.input_scale = NAN, .calm = NAN, .ragged = NAN};
    lull_image *inputs[3];
    lull_model_info info;
    lull_model *model;
    lull_plan *plan;
    lull_status status = lull_model_init(&model, at, MODEL, tza, bytes, ports);
    if (status != LULL_OK)
        return status;
    lull_model_get_info(model, &info);
    inputs[0] = &images.color;
    inputs[1] = &images.albedo;
    inputs[2] = &images.normal;
    for (unsigned f = 0; f < info.inputs / 3 && f < 3; f++) {
        frame.features |= 1u << f;
        inputs[f]->data = features[f];
        inputs[f]->channels = 3;
    }
    images.output.data = output;
    images.output.channels = 3;
    memset(output, 0, sizeof output);
    status = lull_plan_init(&plan, at + MODEL, PLAN - LULL_ALIGN, &frame, model);
    return status == LULL_OK ? lull_run(plan, &images, NULL) : status;
}

/* Of every port that is here. */
static void print_lines(const char *name, const void *tza, size_t bytes)
{
    static const lull_content contents[] = {LULL_HDR, LULL_LDR, LULL_LIGHTMAP_DIR};
    for (unsigned port = 0; lull_port_name(port); port++)
        for (unsigned c = 0; lull_ports_available() >> port & 1 && c < 3; c++) {
            lull_status status = denoise(tza, bytes, contents[c], (2u << port) - 1);
            uint64_t hash = hash_floats(HASH_START, output, VALUES);
            printf("%s %u %s %s %08lx%08lx\n", name, c, lull_port_name(port),
                   lull_status_text(status), (unsigned long)(hash >> 32),
                   (unsigned long)(hash & 0xffffffffu));
        }
}

int main(int argc, char **argv)
{
    static unsigned char tza[1 << 20];
    uint32_t state = 5;
    lull_ports_request();
    for (unsigned f = 0; f < 3; f++)
        for (unsigned i = 0; i < VALUES; i++)
            features[f][i] = (float)(random_bits(&state) >> 16) / (f == 0 ? 16384.0f : 65536.0f);
    for (int i = 1; i < argc; i++) {
        FILE *file = fopen(argv[i], "rb");
        size_t bytes = file ? fread(tza, 1, sizeof tza, file) : 0;
        if (!bytes)
            return 1;
        fclose(file);
        print_lines(argv[i], tza, bytes);
    }
    print_lines("kernel5_8", lull_weights_kernel5_8, lull_weights_kernel5_8_bytes);
    print_lines("kernel5_32", lull_weights_kernel5_32, lull_weights_kernel5_32_bytes);
    return 0;
}
