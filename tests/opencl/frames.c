/* Frames of OpenCL devices: the bytes of the CPU, for every model, feature set, content, size and
 * format, in tiles, in place, and those of the numpy reference. */
#include "opencl.h"

static OIDNDevice opencl, cpu;

/* ---- Frames ---------------------------------------------------------------------------------- */

/* A frame of three images, and how it is denoised. */
typedef struct frame {
    size_t width, height;
    unsigned features; /* bits of color, albedo, normal */
    const char *type, *content, *more; /* of filter; boolean parameters that are set, or NULL */
    OIDNQuality quality;
    int memory;   /* maxMemoryMB */
    int ensemble; /* orientations */
    float scale; /* inputScale */
    const void *weights;
    size_t weights_bytes;
    unsigned *calls; /* OpenCL's of the progress monitor are counted here; NULL: there is none */
} frame;

static bool count_call(void *calls, double progress)
{
    (void)progress;
    ++*(unsigned *)calls;
    return true;
}

static const frame plain = {93, 61, 7, "RT", "hdr", NULL, OIDN_QUALITY_FAST, -1, 1, NAN, NULL, 0,
                            NULL};

static void run(OIDNDevice device, const frame *f, float *const images[3], float *out)
{
    static const char *const names[] = {"color", "albedo", "normal"};
    OIDNFilter filter = oidnNewFilter(device, f->type);
    unsigned i;

    for (i = 0; i < 3; i++)
        if (f->features >> i & 1)
            oidnSetSharedFilterImage(filter, names[i], images[i], F3, f->width, f->height, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", out, F3, f->width, f->height, 0, 0, 0);
    if (f->content)
        oidnSetFilterBool(filter, f->content, true);
    if (f->more)
        oidnSetFilterBool(filter, f->more, true);
    if (f->weights)
        oidnSetSharedFilterData(filter, "weights", (void *)(size_t)f->weights, f->weights_bytes);
    oidnSetFilterInt(filter, "quality", f->quality);
    oidnSetFilterInt(filter, "maxMemoryMB", f->memory);
    oidnSetFilterInt(filter, "ensemble", f->ensemble);
    oidnSetFilterFloat(filter, "inputScale", f->scale);
    if (f->calls)
        oidnSetFilterProgressMonitorFunction(filter, count_call, f->calls);
    oidnCommitFilter(filter);
    ERROR(device, NONE);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
}

/* 1 if both devices give the same bytes. */
static int same(const frame *f, float *const images[3])
{
    const size_t values = 3 * f->width * f->height;
    float *expected = noise_image(values, 1), *out = noise_image(values, 2);
    frame uncounted = *f;
    int equal;

    uncounted.calls = NULL;
    run(cpu, &uncounted, images, expected);
    run(opencl, f, images, out);
    equal = !memcmp(expected, out, values * sizeof *out);
    if (!equal)
        printf("  %ux%u, %s %s, features %u, quality %d, %d MB, %d, scale %g\n", (unsigned)f->width,
               (unsigned)f->height, f->type, f->content ? f->content : "", f->features, f->quality,
               f->memory, f->ensemble, (double)f->scale);
    free(expected);
    free(out);
    return equal;
}

static void make_images(float *images[3], size_t width, size_t height)
{
    const size_t values = 3 * width * height;
    size_t i;

    images[0] = picture(values, 11);
    images[1] = noise_image(values, 12);
    images[2] = noise_image(values, 13);
    for (i = 0; i < values; i++)
        images[2][i] = 2.0f * images[2][i] - 1.0f;
    for (i = 0; i < values / 9; i++) /* black: lamps, mirrors, the sky */
        images[1][i] = 0.0f;
    for (i = values / 2; i < values; i++) /* little noise: some of the input is mixed in */
        images[0][i] = 0.7f + 0.02f * images[1][i];
}

static void free_images(float *images[3])
{
    unsigned i;

    for (i = 0; i < 3; i++)
        free(images[i]);
}

/* A file of a golden test. */
static void *read_golden(const char *test, const char *name, size_t *bytes)
{
    const char *root = getenv("LULL_ROOT");
    char path[1024];
    void *data = malloc(1 << 20);
    FILE *file;

    snprintf(path, sizeof path, "%s/tests/golden/%s/%s", root ? root : ".", test, name);
    file = fopen(path, "rb");
    *bytes = file && data ? fread(data, 1, 1 << 20, file) : 0;
    if (file)
        fclose(file);
    CHECK(*bytes > 0);
    return data;
}

/* The model of the golden test of family K with another value of its tensor `bilateral.scale`, 1 to
 * 4, which says what the last steps are, or that it is for an albedo or normals alone. In the
 * file's table its name is followed by a rank, a dimension, two letters and the offset of the
 * value, a float of little endian. */
static void *model_with_steps(unsigned steps, size_t *bytes)
{
    static const char name[] = "bilateral.scale";
    static const unsigned char values[][4] = {
        {0, 0, 0x80, 0x3f}, {0, 0, 0, 0x40}, {0, 0, 0x40, 0x40}, {0, 0, 0x80, 0x40}};
    unsigned char *model = read_golden("kernel", "weights.tza", bytes);
    const size_t length = sizeof name - 1, row = length + 7 + 8;
    size_t at = 0, offset;

    while (at + row < *bytes && memcmp(model + at, name, length) != 0)
        at++;
    if (!CHECK(at + row <= *bytes))
        return model;
    at += length + 7;
    offset = model[at] | (size_t)model[at + 1] << 8 | (size_t)model[at + 2] << 16;
    CHECK(offset + 4 <= *bytes);
    memcpy(model + offset, values[steps - 1], 4);
    return model;
}

/* A plain frame of another width and height, and its images. */
static frame frame_of(const size_t size[2], float *images[3])
{
    frame f = plain;

    f.width = size[0];
    f.height = size[1];
    make_images(images, f.width, f.height);
    return f;
}

static void all_models_features_and_contents(void)
{
    static const struct {
        const char *type, *content;
        unsigned features;
    } rows[] = {{"RT", "hdr", 7},  {"RT", "hdr", 1},  {"RT", "hdr", 3}, {"RT", "hdr", 5},
                {"RT", NULL, 7},   {"RT", NULL, 1},   {"RT", NULL, 2},  {"RT", NULL, 4},
                {"RT", "srgb", 7}, {"RT", "srgb", 1}, {"RT", "srgb", 2}, {"RTLightmap", NULL, 1},
                {"RTLightmap", "directional", 1}, {"RTLightmap", NULL, 5}};
    static const size_t sizes[][2] = {{1, 1}, {3, 5}, {17, 33}, {16, 16}, {133, 71}};
    size_t i, s;

    NEED_OPENCL();
    for (s = 0; s < COUNT(sizes); s++) {
        float *images[3];
        frame f = frame_of(sizes[s], images);

        for (i = 0; i < COUNT(rows); i++)
            for (f.quality = OIDN_QUALITY_FAST; f.quality <= OIDN_QUALITY_HIGH; f.quality++) {
                f.type = rows[i].type;
                f.content = rows[i].content;
                f.features = rows[i].features;
                CHECK(same(&f, images));
            }
        free_images(images);
    }
}

/* Models with all steps after the blend and with some: with albedo, normals, both and neither,
 * which leaves nothing to regress on but lets some of the input in; of clipped radiance, which is
 * not corrected; and cells of all sizes at the borders. */
static void all_last_steps(void)
{
    static const struct {
        const char *content;
        unsigned features;
    } rows[] = {{"hdr", 7}, {"hdr", 3}, {"hdr", 5}, {"hdr", 1},  {NULL, 7},   {NULL, 3},
                {NULL, 5},  {NULL, 1},  {NULL, 2},  {"srgb", 7}, {"srgb", 2}, {NULL, 4}};
    static const size_t sizes[][2] = {{1, 1}, {8, 8}, {9, 17}, {31, 4}, {133, 71}};
    size_t i, s;
    unsigned steps;

    NEED_OPENCL();
    for (s = 0; s < COUNT(sizes); s++) {
        float *images[3];
        frame f = frame_of(sizes[s], images);

        for (steps = 1; steps <= 4; steps++) {
            void *model = model_with_steps(steps, &f.weights_bytes);

            f.weights = model;
            for (i = 0; i < COUNT(rows); i++) {
                f.content = rows[i].content;
                f.features = rows[i].features;
                if (steps == 4 && f.features != 2 && f.features != 4)
                    continue;
                if (!CHECK(same(&f, images)))
                    printf("  bilateral.scale %u\n", steps);
            }
            free(model);
        }
        free_images(images);
    }
}

/* Values that are no colours, and scales. */
static void odd_values(void)
{
    static const float odd[] = {NAN,      INFINITY, -INFINITY, -1.0f, 1e38f, -1e38f, 1e-38f,
                                1e-40f,   -1e-40f,  0.0f,      -0.0f, 65504.0f, 7e4f,
                                1.1754944e-38f};
    static const float scales[] = {NAN, 1.0f, 0.0f, -1.0f, 1e-30f, 1e30f, 1e-38f, INFINITY};
    frame f = plain;
    float *images[3];
    size_t i;
    void *model;

    NEED_OPENCL();
    make_images(images, f.width, f.height);
    for (i = 0; i < 3 * f.width * f.height; i++) {
        if (i % 31 == 7)
            images[0][i] = odd[i / 31 % COUNT(odd)];
        if (i % 37 == 5)
            images[1][i] = odd[i / 37 % COUNT(odd)];
        if (i % 41 == 3)
            images[2][i] = odd[i / 41 % COUNT(odd)];
    }
    for (f.quality = OIDN_QUALITY_FAST; f.quality <= OIDN_QUALITY_HIGH; f.quality++)
        for (i = 0; i < COUNT(scales); i++) {
            f.scale = scales[i];
            CHECK(same(&f, images));
        }
    f.quality = OIDN_QUALITY_BALANCED;
    f.weights = model = model_with_steps(3, &f.weights_bytes);
    for (i = 0; i < COUNT(scales); i++) {
        f.scale = scales[i];
        CHECK(same(&f, images));
    }
    free(model);
    f.weights = NULL;
    f.content = "srgb";
    f.scale = NAN;
    CHECK(same(&f, images));
    free_images(images);
}

/* The same bytes; calls of the progress monitor, some for each tile, while OpenCL makes them. */
static unsigned calls_of(frame f, float *const images[3])
{
    unsigned calls = 0;

    f.calls = &calls;
    CHECK(same(&f, images));
    return calls;
}

/* The same bytes with that little memory, in more than one tile: a whole frame has `whole` calls of
 * the progress monitor. */
static void check_tiles(frame *f, float *const images[3], int megabytes, unsigned whole)
{
    f->memory = megabytes;
    if (!CHECK(calls_of(*f, images) > whole))
        printf("  %ux%u, %d MB: whole\n", (unsigned)f->width, (unsigned)f->height, megabytes);
}

/* Less memory than the whole frame takes: tiles. What larger models look at is so wide that only
 * long frames make few of them. */
static void tiles_change_nothing(void)
{
    static const size_t sizes[][2] = {{1500, 100}, {100, 1500}};
    static const struct {
        unsigned features;
        int megabytes;
    } steps[] = {{7, 17}, {3, 16}, {5, 17}, {1, 16}}; /* of a model with all steps */
    frame f;
    float *images[3];
    size_t i, s;
    void *model;

    NEED_OPENCL();
    f = frame_of((const size_t[]){710, 790}, images);
    check_tiles(&f, images, 50, calls_of(f, images));
    free_images(images);
    for (s = 0; s < COUNT(sizes); s++) {
        unsigned whole;

        f = frame_of(sizes[s], images);
        f.quality = OIDN_QUALITY_HIGH;
        check_tiles(&f, images, 20, calls_of(f, images));
        f.weights = model = model_with_steps(3, &f.weights_bytes);
        f.memory = plain.memory;
        whole = calls_of(f, images);
        check_tiles(&f, images, 0, whole);
        for (i = 0; i < COUNT(steps); i++) {
            f.features = steps[i].features;
            check_tiles(&f, images, steps[i].megabytes, whole);
        }
        free(model);
        free_images(images);
    }
}

/* A frame of 4 by 3 tiles, of which those at the edges take more memory than the others, were their
 * tensors put elsewhere. */
static void smaller_tiles_fit(void)
{
    float *images[3];
    frame f;

    NEED_OPENCL();
    f = frame_of((const size_t[]){848, 688}, images);
    f.quality = OIDN_QUALITY_BALANCED;
    f.features = 1;
    check_tiles(&f, images, 47, calls_of(f, images));
    free_images(images);
}

/* The mean of several orientations, whole and in tiles, and of a panorama. */
static void ensembles(void)
{
    float *images[3];
    frame f;

    NEED_OPENCL();
    f = frame_of((const size_t[]){131, 77}, images);
    for (f.ensemble = 1; f.ensemble <= 4; f.ensemble *= 2) {
        f.features = 7, f.more = NULL;
        CHECK(same(&f, images));
        f.features = 1, f.more = "panorama";
        CHECK(same(&f, images));
    }
    free_images(images);
    f = frame_of((const size_t[]){848, 688}, images);
    f.ensemble = 2;
    CHECK(same(&f, images));
    f.memory = 100;
    CHECK(same(&f, images));
    free_images(images);
}

static void too_little_memory(void)
{
    enum { W = 200, H = 150 };
    float *in = picture(3 * W * H, 1), *out = picture(3 * W * H, 2);
    OIDNFilter filter;
    const char *text = "";

    NEED_OPENCL();
    filter = new_hdr(opencl, in, out, W, H);
    oidnSetFilterInt(filter, "maxMemoryMB", 1);
    oidnCommitFilter(filter);
    CHECK_EQ(oidnGetDeviceError(opencl, &text), MEMORY);
    CHECK(text && strstr(text, "maxMemoryMB is 1, but this filter needs at least") != NULL);
    oidnSetFilterInt(filter, "maxMemoryMB", -1);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(opencl, NONE);
    oidnReleaseFilter(filter);
    free(in);
    free(out);
}

/* ---- Formats --------------------------------------------------------------------------------- */

/* Images in one block of memory with gaps; bytes beside the pixels must not change. */
static void formats_and_strides(void)
{
    enum { W = 37, H = 21, PIXEL = 28, ROW = PIXEL * W + 52, BYTES = 3 * ROW * H };
    static const OIDNFormat formats[] = {
        F3, F1, F2, H3, H1, OIDN_FORMAT_HALF2,
    };
    OIDNDevice devices[2];
    unsigned char *block[2] = {malloc(BYTES), malloc(BYTES)};
    size_t i, k, stride;
    int d;

    NEED_OPENCL();
    devices[0] = cpu;
    devices[1] = opencl;
    for (stride = 0; stride < 2; stride++)
        for (k = 0; k < COUNT(formats); k++) {
            for (d = 0; d < 2; d++) {
                OIDNFilter filter = oidnNewFilter(devices[d], "RT");
                unsigned seed = 5;

                for (i = 0; i < BYTES; i++) /* halves and floats from 2^-15 to 2 */
                    block[d][i] = i % 2 ? (unsigned char)(60 - (i / 2) % 3)
                                        : (unsigned char)(noise(&seed) * 255.0f);
                oidnSetFilterBool(filter, "hdr", true);
                oidnSetSharedFilterImage(filter, "color", block[d] + 4, formats[k], W, H, 0,
                                         stride * PIXEL, stride * ROW);
                oidnSetSharedFilterImage(filter, "albedo", block[d] + 12 + ROW * H, F1, W, H, 0,
                                         PIXEL, ROW);
                oidnSetSharedFilterImage(filter, "normal", block[d] + 16 + ROW * H, H3, W, H, 0,
                                         PIXEL, ROW);
                oidnSetSharedFilterImage(filter, "output", block[d] + 2 + 2 * ROW * H, formats[k],
                                         W, H, 0, stride * PIXEL, stride * ROW);
                oidnCommitFilter(filter);
                oidnExecuteFilter(filter);
                ERROR(devices[d], NONE);
                oidnReleaseFilter(filter);
            }
            CHECK(!memcmp(block[0], block[1], BYTES));
        }
    free(block[0]);
    free(block[1]);
}

/* Output in the place of an input, exactly and shifted. */
static void in_place(void)
{
    enum { W = 93, H = 61, VALUES = 3 * W * H };
    static const size_t shifts[] = {0, 3, 5 * 3 * W};
    OIDNDevice devices[2];
    float *block[2];
    size_t i;
    int d;

    NEED_OPENCL();
    devices[0] = cpu;
    devices[1] = opencl;
    for (i = 0; i < COUNT(shifts); i++) {
        for (d = 0; d < 2; d++) {
            OIDNFilter filter;

            block[d] = picture(2 * VALUES, 7);
            filter = new_hdr(devices[d], block[d], block[d] + shifts[i], W, H);
            oidnExecuteFilter(filter);
            ERROR(devices[d], NONE);
            oidnReleaseFilter(filter);
        }
        CHECK(!memcmp(block[0], block[1], 2 * VALUES * sizeof(float)));
        free(block[0]);
        free(block[1]);
    }
}

/* ---- The numpy reference --------------------------------------------------------------------- */

/* A model of odd widths, whose layers the CPU packs in other ways (export/golden_kernel.py). */
static void equals_the_reference(void)
{
    static const struct {
        unsigned features;
        const char *type, *content, *expected, *weights; /* the last NULL: weights.tza */
    } rows[] = {{7, "RT", "hdr", "out_7_hdr.f32", NULL},
                {7, "RT", "hdr", "out_7_hdr_clean.f32", NULL},
                {7, "RT", NULL, "out_7_ldr.f32", NULL},
                {7, "RT", "srgb", "out_7_srgb.f32", NULL},
                {1, "RT", "hdr", "out_1_hdr.f32", NULL},
                {3, "RT", "hdr", "out_3_hdr.f32", NULL},
                {1, "RTLightmap", "directional", "out_1_lightmap-dir.f32", NULL},
                {2, "RT", NULL, "out_2_ldr.f32", NULL},
                {4, "RT", NULL, "out_4_ldr.f32", NULL},
                {2, "RT", NULL, "out_alone_2_ldr.f32", "alone.tza"},
                {2, "RT", "srgb", "out_alone_2_srgb.f32", "alone.tza"},
                {4, "RT", NULL, "out_alone_4_ldr.f32", "alone.tza"}};
    frame f = plain;
    float *images[3], *expected, *out;
    const int one = 1;
    size_t bytes, i;

    NEED_OPENCL();
    if (!*(const char *)&one)
        SKIP("optional: the vectors are little-endian");
    f.width = 45, f.height = 37;
    images[0] = read_golden("kernel", "color.f32", &bytes);
    images[1] = read_golden("kernel", "albedo.f32", &bytes);
    images[2] = read_golden("kernel", "normal.f32", &bytes);
    out = malloc(bytes);
    for (i = 0; i < COUNT(rows); i++) {
        const char *file = rows[i].weights ? rows[i].weights : "weights.tza";
        void *model = read_golden("kernel", file, &f.weights_bytes);

        f.weights = model;
        f.features = rows[i].features;
        f.type = rows[i].type;
        f.content = rows[i].content;
        f.more = strstr(rows[i].expected, "_clean") ? "cleanAux" : NULL;
        expected = read_golden("kernel", rows[i].expected, &bytes);
        run(opencl, &f, images, out);
        if (!CHECK(!memcmp(out, expected, bytes)))
            printf("  %s\n", rows[i].expected);
        free(expected);
        free(model);
    }
    free(out);
    free_images(images);
}

/* Integer U-Nets: wide and narrow layers, auxiliary images of words and of bytes, both nets. */
static void integer_unets(void)
{
    static const struct {
        const char *test;
        unsigned features;
    } rows[] = {{"int_unet_3_eights", 1},       {"int_unet_3_narrow", 1},
                {"int_unet_3_widest", 1},       {"int_unet_3_patches_extreme", 1},
                {"int_unet_6_aux_extreme", 3},  {"int_unet_6_wide", 3},
                {"int_unet_9_aux", 7},          {"int_unet_9_extreme", 7},
                {"int_unet_9_mixed", 7},        {"int_unet_9_patches", 7},
                {"int_unet_large_3_wide", 1},   {"int_unet_large_6_narrow", 3},
                {"int_unet_large_9_mixed", 7}};
    static const char *const contents[] = {"srgb", "hdr", NULL};
    static const size_t sizes[][2] = {{1, 1}, {17, 33}, {93, 61}};
    size_t i, k, s;

    NEED_OPENCL();
    for (s = 0; s < COUNT(sizes); s++) {
        float *images[3];
        frame f = frame_of(sizes[s], images);

        for (i = 0; i < COUNT(rows); i++) {
            void *model = read_golden(rows[i].test, "weights.tza", &f.weights_bytes);

            f.weights = model;
            f.features = rows[i].features;
            for (k = 0; k < COUNT(contents); k++) {
                f.content = contents[k];
                if (!CHECK(same(&f, images)))
                    printf("  %s\n", rows[i].test);
            }
            free(model);
        }
        free_images(images);
    }
}

/* Both devices say alike which images the weights take. */
static void weights_for_other_images(void)
{
    const OIDNDevice devices[] = {opencl, cpu};
    size_t bytes, d;
    float *images[3];
    frame f = frame_of((const size_t[]){9, 5}, images);
    void *model;

    NEED_OPENCL();
    model = read_golden("int_unet_9_aux", "weights.tza", &bytes);
    for (d = 0; d < COUNT(devices); d++) {
        OIDNFilter filter = oidnNewFilter(devices[d], "RT");
        const char *text = "";

        oidnSetSharedFilterImage(filter, "color", images[0], F3, f.width, f.height, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", images[1], F3, f.width, f.height, 0, 0, 0);
        oidnSetSharedFilterData(filter, "weights", model, bytes);
        oidnCommitFilter(filter);
        CHECK_EQ(oidnGetDeviceError(devices[d], &text), OIDN_ERROR_UNKNOWN);
        if (!CHECK(strstr(text, "take 9 channels, the images have 3")))
            printf("  %s\n", text);
        oidnReleaseFilter(filter);
    }
    free(model);
    free_images(images);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    keep_kernels_in_build();
    if (!why_no_opencl()) {
        opencl = open_opencl();
        cpu = open_cpu();
    }
    RUN(all_models_features_and_contents);
    RUN(all_last_steps);
    RUN(odd_values);
    RUN(tiles_change_nothing);
    RUN(smaller_tiles_fit);
    RUN(ensembles);
    RUN(too_little_memory);
    RUN(formats_and_strides);
    RUN(in_place);
    RUN(equals_the_reference);
    RUN(integer_unets);
    RUN(weights_for_other_images);
    if (opencl) {
        oidnReleaseDevice(opencl);
        oidnReleaseDevice(cpu);
    }
    return check_report();
}
