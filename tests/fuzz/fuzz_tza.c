/* Weights files of any bytes: the reader, the loader and, where a model comes of it, one small
 * run. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lull.h"
#include "tza.h"

#define MODEL_LIMIT ((size_t)64 << 20) /* larger ones are loaded nowhere here */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(int holds)
{
    if (!holds)
        abort();
}

/* Memory as the library wants it; *block is to be freed. */
static void *aligned(void **block, size_t n)
{
    *block = malloc(n + LULL_ALIGN);
    require(*block != NULL);
    return (uint8_t *)*block + (LULL_ALIGN - (uintptr_t)*block % LULL_ALIGN) % LULL_ALIGN;
}

static void read_tensors(const uint8_t *data, size_t size)
{
    static const char *const suffixes[] = {".weight", ".bias", ".scale", ""};
    static const char *const prefixes[] = {"enc_conv0", "enc_conv1a", "dec_conv0", "a"};
    volatile float sink = 0;
    lull_tza_tensor tensor;
    lull_tza tza;
    size_t i, j, d, elements;
    if (lull_tza_open(&tza, data, size) != LULL_OK)
        return;
    for (i = 0; i < 4; ++i)
        for (j = 0; j < 4; ++j)
            if (lull_tza_find(&tza, prefixes[i], suffixes[j], &tensor)) {
                for (elements = 1, d = 0; d < tensor.rank; ++d)
                    elements *= tensor.dims[d];
                sink = lull_tza_float(&tensor, 0) + lull_tza_float(&tensor, elements - 1);
            }
    (void)sink;
}

static void run_model(const lull_model *model, unsigned features)
{
    float pixels[3][16 * 16 * 3], out[16 * 16 * 3];
    lull_frame frame = lull_frame_default(16, 16, LULL_HDR, features);
    lull_images images;
    lull_plan *plan;
    void *block;
    size_t i, n = lull_plan_size(&frame, model);
    if (n == 0 || n > MODEL_LIMIT)
        return;
    memset(&images, 0, sizeof images);
    for (i = 0; i < sizeof pixels / sizeof(float); ++i)
        pixels[i / (16 * 16 * 3)][i % (16 * 16 * 3)] = (float)(i % 7) * 0.5f;
    images.color.data = pixels[0];
    images.albedo.data = features & LULL_HAS_ALBEDO ? pixels[1] : NULL;
    images.normal.data = features & LULL_HAS_NORMAL ? pixels[2] : NULL;
    images.output.data = out;
    images.color.channels = images.albedo.channels = images.normal.channels = 3;
    images.output.channels = 3;
    images.input_scale = 1;
    require(lull_plan_init(&plan, aligned(&block, n), n, &frame, model) == LULL_OK);
    require(lull_run(plan, &images, NULL) == LULL_OK);
    free(block);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const unsigned features[] = {LULL_HAS_COLOR, LULL_HAS_COLOR | LULL_HAS_ALBEDO,
                                        LULL_HAS_COLOR | LULL_HAS_ALBEDO | LULL_HAS_NORMAL};
    lull_model *model = NULL;
    lull_model_info info;
    lull_status status;
    void *block;
    size_t n = lull_model_size(data, size, LULL_PORTS_ALL);
    read_tensors(data, size);
    if (n > MODEL_LIMIT)
        return 0;
    status = lull_model_init(&model, aligned(&block, n), n, data, size, LULL_PORTS_ALL);
    require(status != LULL_OK || n > 0);
    if (status == LULL_OK) {
        lull_model_get_info(model, &info);
        if (info.inputs >= 3 && info.inputs <= 9 && info.macs_per_pixel < 200000)
            run_model(model, features[info.inputs / 3 - 1]);
    }
    free(block);
    return 0;
}
