/* Family K against its numpy reference (export/golden_kernel.py), to the bit: every set of features
 * and content, port, thread count, row step, strip width, and in place. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdlib.h>

#include "models.h"

#define FOLDER "tests/golden/kernel/"
#define WIDTH 45
#define HEIGHT 37
#define VALUES ((size_t)WIDTH * HEIGHT * 3)

static void *read_file(const char *name, size_t *bytes)
{
    char path[200];
    FILE *file;
    void *data = malloc(1 << 20);
    snprintf(path, sizeof path, FOLDER "%s", name);
    file = fopen(path, "rb");
    if (!file || !data) {
        printf("FAIL cannot read %s\n", path);
        exit(1);
    }
    *bytes = fread(data, 1, 1 << 20, file);
    fclose(file);
    return data;
}

/* A picture of little-endian floats. */
static float *read_floats(const char *name)
{
    size_t bytes;
    uint8_t *data = read_file(name, &bytes);
    float *values = malloc(VALUES * sizeof *values);
    CHECK_EQ(bytes, VALUES * 4);
    for (size_t i = 0; i < VALUES; i++) {
        uint32_t u = data[4 * i] | (uint32_t)data[4 * i + 1] << 8 |
                     (uint32_t)data[4 * i + 2] << 16 | (uint32_t)data[4 * i + 3] << 24;
        memcpy(&values[i], &u, 4);
    }
    free(data);
    return values;
}

/* Threads that take turns: worker numbers are what matters here. */
static void backwards(void *user, unsigned count, void (*body)(void *, unsigned, unsigned),
                      void *context)
{
    unsigned threads = *(unsigned *)user;
    while (count--)
        body(context, count, count % threads);
}

typedef struct run_case {
    unsigned features;
    lull_content content;
    const char *expected, *weights;
    unsigned clean_aux;
} run_case;

#define ANY "weights.tza"
#define ALONE "alone.tza" /* for an albedo or normals alone */

static const run_case cases[] = {{7, LULL_HDR, "out_7_hdr.f32", ANY, 0},
                                 {7, LULL_HDR, "out_7_hdr_clean.f32", ANY, 1},
                                 {7, LULL_LDR, "out_7_ldr.f32", ANY, 0},
                                 {7, LULL_SRGB, "out_7_srgb.f32", ANY, 0},
                                 {1, LULL_HDR, "out_1_hdr.f32", ANY, 0},
                                 {3, LULL_HDR, "out_3_hdr.f32", ANY, 0},
                                 {5, LULL_LIGHTMAP_HDR, "out_5_lightmap-hdr.f32", ANY, 0},
                                 {1, LULL_LIGHTMAP_DIR, "out_1_lightmap-dir.f32", ANY, 0},
                                 {2, LULL_LDR, "out_2_ldr.f32", ANY, 0},
                                 {4, LULL_LDR, "out_4_ldr.f32", ANY, 0},
                                 {2, LULL_LDR, "out_alone_2_ldr.f32", ALONE, 0},
                                 {2, LULL_SRGB, "out_alone_2_srgb.f32", ALONE, 0},
                                 {4, LULL_LDR, "out_alone_4_ldr.f32", ALONE, 0}};

static const unsigned variants[][5] = {/* threads, row step, strip width, in place, streamed */
                                       {1, 0, 0, 0, 0},  {3, 1, 0, 0, 0},  {2, 5, 16, 0, 0},
                                       {1, 16, 32, 1, 0}, {7, 2, 16, 1, 0}, {2, 4, 0, 0, 1},
                                       {3, 2, 0, 1, 1}};

/* Asks for scale and calm of a picture of other light. */
static void measure_another(lull_plan *plan, const lull_images *images, const lull_host *host)
{
    static float dark[VALUES];
    lull_images other = *images;
    lull_image *all[] = {&other.color, &other.albedo, &other.normal, &other.output};
    for (size_t i = 0; i < VALUES; i++)
        dark[i] = (float)(i / 3 % 7) * 0.001f;
    for (unsigned i = 0; i < 4; i++)
        all[i]->data = all[i]->data ? dark : NULL;
    other.input_scale = other.calm = other.ragged = NAN;
    CHECK_EQ(lull_measure(&other, plan, host), LULL_OK);
}

/* The same image through lull_rows, seven rows at a time, with measurements between them, which
 * change nothing. */
static void push_rows(lull_plan *plan, const lull_images *images, const lull_host *host)
{
    lull_images part = *images;
    lull_image *all[] = {&part.color, &part.albedo, &part.normal};
    CHECK_EQ(lull_measure(&part, plan, host), LULL_OK);
    CHECK_EQ(lull_rows_begin(plan, part.input_scale, part.calm, part.ragged), LULL_OK);
    for (unsigned y = 0, rows, ready; y < HEIGHT; y += rows) {
        rows = HEIGHT - y < 7 ? HEIGHT - y : 7;
        CHECK_EQ(lull_rows(plan, &part, rows, &ready, host), LULL_OK);
        measure_another(plan, images, host);
        for (unsigned f = 0; f < 3; f++)
            if (all[f]->data)
                all[f]->data = (float *)all[f]->data + 3 * (size_t)WIDTH * rows;
        part.output.data = (float *)part.output.data + 3 * (size_t)WIDTH * ready;
    }
}

static void run_one(const run_case *c, const void *weights, size_t bytes, uint32_t ports,
                    const unsigned *variant, const float *expected)
{
    float *feature[3] = {read_floats("color.f32"), read_floats("albedo.f32"),
                         read_floats("normal.f32")};
    float *out = malloc(VALUES * sizeof *out);
    size_t model_bytes = lull_model_size(weights, bytes, ports), plan_bytes;
    void *model_memory = aligned(model_bytes), *plan_memory;
    lull_frame frame = lull_frame_default(WIDTH, HEIGHT, c->content, c->features);
    unsigned threads = variant[0], main_feature = c->features & 1 ? 0 : c->features & 2 ? 1 : 2;
    lull_host host = {&threads, backwards, NULL};
    lull_images images;
    lull_model *model;
    lull_plan *plan;
    memset(&images, 0, sizeof images);
    images.input_scale = images.calm = images.ragged = NAN;
    for (unsigned f = 0; f < 3; f++) {
        lull_image image = {feature[f], LULL_F32, 3, 0, 0};
        if (c->features >> f & 1)
            *(f == 0 ? &images.color : f == 1 ? &images.albedo : &images.normal) = image;
    }
    frame.threads = threads;
    frame.clean_aux = c->clean_aux;
    frame.row_step = variant[1];
    frame.strip_width = variant[2];
    frame.in_place = variant[3];
    frame.streamed = variant[4];
    images.output.data = variant[3] ? feature[main_feature] : out;
    images.output.channels = 3;
    CHECK_EQ(lull_model_init(&model, model_memory, model_bytes, weights, bytes, ports), LULL_OK);
    plan_bytes = lull_plan_size(&frame, model);
    plan_memory = aligned(plan_bytes);
    CHECK_EQ(lull_plan_init(&plan, plan_memory, plan_bytes, &frame, model), LULL_OK);
    if (variant[4]) {
        push_rows(plan, &images, &host);
    } else {
        if (!variant[3])
            CHECK_EQ(lull_rows_begin(plan, 1.0f, 0.0f, 0.0f), LULL_ERROR_UNSUPPORTED);
        CHECK_EQ(lull_run(plan, &images, &host), LULL_OK);
    }
    if (!CHECK(memcmp(images.output.data, expected, VALUES * sizeof *out) == 0))
        printf("  ports %x, %u threads, row step %u, strips of %u%s%s\n", (unsigned)ports,
               variant[0], variant[1], variant[2], variant[3] ? ", in place" : "",
               variant[4] ? ", streamed" : "");
    free(plan_memory);
    free(model_memory);
    free(out);
    for (unsigned f = 0; f < 3; f++)
        free(feature[f]);
}

static void equals_the_reference(void)
{
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        size_t bytes;
        void *weights = read_file(cases[i].weights, &bytes);
        float *expected = read_floats(cases[i].expected);
        for (unsigned port = 0; lull_port_name(port); port++)
            for (size_t v = 0; v < sizeof variants / sizeof variants[0]; v++)
                if (lull_ports_available() >> port & 1)
                    run_one(&cases[i], weights, bytes, (2u << port) - 1, variants[v], expected);
        free(expected);
        free(weights);
    }
}

/* Models for an albedo or normals alone take no other frames, but empty ones. */
static void models_for_features_refuse_colour(void)
{
    size_t bytes;
    void *weights = read_file(ALONE, &bytes);
    size_t model_bytes = lull_model_size(weights, bytes, LULL_PORTS_ALL);
    void *memory = aligned(model_bytes);
    lull_model *model;
    lull_model_info info;
    lull_plan *plan;
    char none[LULL_ALIGN];
    CHECK_EQ(lull_model_init(&model, memory, model_bytes, weights, bytes, LULL_PORTS_ALL),
             LULL_OK);
    lull_model_get_info(model, &info);
    CHECK_EQ(info.is_alone, 1);
    for (unsigned features = 1; features < 8; features++) {
        lull_frame frame = lull_frame_default(WIDTH, HEIGHT, LULL_LDR, features);
        int fits = features == LULL_HAS_ALBEDO || features == LULL_HAS_NORMAL;
        CHECK_EQ(lull_plan_size(&frame, model) > 0, fits);
        CHECK_EQ(lull_plan_init(&plan, none, 0, &frame, model),
                 fits ? LULL_ERROR_MEMORY : LULL_ERROR_FEATURES);
        frame.width = 0;
        CHECK(lull_plan_size(&frame, model) > 0);
    }
    free(memory);
    free(weights);
}

/* A frame so wide that loops over the filter's small levels are shared, too, and that strips do not
 * hold all of it. */
static void wide_frames_do_not_depend_on_threads_and_strips(void)
{
    enum { WIDE = 700, ROWS = 64, RUNS = 4 };
    static const unsigned forms[RUNS][4] = {/* threads, strip width, in place, ports */
                                            {1, 0, 0, LULL_PORTS_ALL},
                                            {3, 0, 0, LULL_PORTS_ALL},
                                            {1, 48, 0, LULL_PORTS_ALL},
                                            {2, 64, 1, LULL_PORTS_SCALAR}};
    size_t values = (size_t)WIDE * ROWS * 3, bytes;
    void *weights = read_file("weights.tza", &bytes);
    float *in = malloc(values * sizeof *in), *out[RUNS];
    for (size_t i = 0; i < values; i++)
        in[i] = (float)(i * 2654435761u >> 7 & 1023u) / 512.0f;
    for (unsigned i = 0; i < RUNS; i++) {
        unsigned threads = forms[i][0], ports = forms[i][3];
        lull_frame frame = lull_frame_default(WIDE, ROWS, LULL_HDR, 7);
        lull_image image = {in, LULL_F32, 3, 0, 0};
        lull_images images = {0};
        lull_host host = {&threads, backwards, NULL};
        size_t model_bytes = lull_model_size(weights, bytes, ports), plan_bytes;
        void *model_memory = aligned(model_bytes), *plan_memory;
        lull_model *model;
        lull_plan *plan;
        CHECK_EQ(lull_model_init(&model, model_memory, model_bytes, weights, bytes, ports),
                 LULL_OK);
        frame.threads = threads;
        frame.row_step = 8;
        frame.strip_width = forms[i][1];
        frame.in_place = forms[i][2];
        plan_bytes = lull_plan_size(&frame, model);
        plan_memory = aligned(plan_bytes);
        CHECK_EQ(lull_plan_init(&plan, plan_memory, plan_bytes, &frame, model), LULL_OK);
        images.color = images.albedo = images.normal = images.output = image;
        images.output.data = out[i] = malloc(values * sizeof *in);
        if (frame.in_place)
            images.color.data = memcpy(out[i], in, values * sizeof *in);
        images.input_scale = images.calm = images.ragged = NAN;
        CHECK_EQ(lull_run(plan, &images, &host), LULL_OK);
        if (!CHECK(memcmp(out[0], out[i], values * sizeof *in) == 0))
            printf("  %u threads, strips of %u\n", threads, forms[i][1]);
        free(plan_memory);
        free(model_memory);
    }
    for (unsigned i = 0; i < RUNS; i++)
        free(out[i]);
    free(in);
    free(weights);
}

/* A number in [-1, 1] that looks like chance. */
static float chance(uint32_t i)
{
    uint32_t v = i * 2654435761u;
    v = (v ^ v >> 15) * 2246822519u;
    return (float)(v >> 22) / 512.0f - 1.0f;
}

/* Stripes of eight pixels, and between them one that is like either side, or between both. */
static float stripe(unsigned x, int is_sharp)
{
    float sides[2] = {x / 9 % 2 ? 0.8f : 0.2f, x / 9 % 2 ? 0.2f : 0.8f};
    return x % 9 < 8 ? sides[0] : is_sharp ? sides[x / 9 % 3 > 0] : 0.5f;
}

/* How calm a frame is: 1 of faint noise, 0 of much, or none, or in too few pixels; and how ragged:
 * of much noise, if the albedo's edges are sharp, or too few; whatever the threads, and however the
 * pixels are stored. */
static void calm_and_ragged_are_the_picture_s(void)
{
    enum { SHARP, BLENDED, EVEN, NONE };
    static const struct {
        unsigned width, height;
        float noise, least, most;
        unsigned albedo;
        float ragged;
    } rows[] = {{93, 61, 0.02f, 0.98f, 1, SHARP, 0}, {93, 61, 0.3f, 0, 0.02f, SHARP, 0},
                {93, 61, 0, 0, 0, SHARP, 0},         {93, 61, 3, 0, 0, SHARP, 1},
                {93, 61, 3, 0, 0, BLENDED, 0},       {93, 61, 3, 0, 0, EVEN, 1},
                {93, 61, 3, 0, 0, NONE, 0},          {700, 300, 3, 0, 0, SHARP, 1},
                {700, 300, 3, 0, 0, BLENDED, 0},     {700, 300, 0.02f, 0.98f, 1, SHARP, 0},
                {4, 300, 3, 0, 0, SHARP, 0},         {4, 300, 0.02f, 0, 0, SHARP, 0},
                {5, 5, 0.02f, 1, 1, SHARP, 0}};
    size_t bytes, model_bytes, plan_bytes;
    void *weights = read_file("weights.tza", &bytes), *model_memory, *plan_memory;
    lull_model *model;
    lull_plan *plan;
    model_bytes = lull_model_size(weights, bytes, LULL_PORTS_ALL);
    model_memory = aligned(model_bytes);
    CHECK_EQ(lull_model_init(&model, model_memory, model_bytes, weights, bytes, LULL_PORTS_ALL),
             LULL_OK);
    for (unsigned row = 0; row < sizeof rows / sizeof rows[0]; row++) {
        lull_frame frame = lull_frame_default(
            rows[row].width, rows[row].height, LULL_HDR,
            LULL_HAS_COLOR | (rows[row].albedo == NONE ? 0u : (unsigned)LULL_HAS_ALBEDO));
        size_t pixels = (size_t)frame.width * frame.height;
        float *in = malloc(4 * pixels * sizeof *in), *albedo = malloc(3 * pixels * sizeof *in);
        lull_image image = {in, LULL_F32, 3, 4 * sizeof *in, 0}; /* not tight */
        unsigned threads = 3;
        lull_host host = {&threads, backwards, NULL};
        lull_images images = {0}, again;
        frame.threads = threads;
        for (size_t i = 0; i < 4 * pixels; i++)
            in[i] = 1.0f + rows[row].noise * chance((uint32_t)i);
        for (size_t i = 0; i < 3 * pixels; i++)
            albedo[i] = rows[row].albedo == EVEN
                            ? 0.5f
                            : stripe((unsigned)(i / 3 % frame.width), rows[row].albedo == SHARP);
        for (size_t i = 0; rows[row].albedo != NONE && i < 3 * pixels; i++)
            in[i / 3 * 4 + i % 3] *= albedo[i] + 0.02f; /* its texture is no detail */
        in[0] = rows[row].noise > 0 ? NAN : in[0];
        plan_bytes = lull_plan_size(&frame, model);
        plan_memory = aligned(plan_bytes);
        CHECK_EQ(lull_plan_init(&plan, plan_memory, plan_bytes, &frame, model), LULL_OK);
        images.color = images.output = image;
        images.albedo = (lull_image){albedo, LULL_F32, 3, 0, 0};
        images.input_scale = images.calm = images.ragged = NAN;
        again = images;
        CHECK_EQ(lull_measure(&images, plan, &host), LULL_OK);
        CHECK_EQ(lull_measure(&again, plan, NULL), LULL_OK);
        CHECK(images.calm == again.calm && images.ragged == again.ragged &&
              images.input_scale == again.input_scale);
        if (!CHECK(images.calm >= rows[row].least && images.calm <= rows[row].most) ||
            !CHECK(fabsf(images.ragged - rows[row].ragged) < 0.02f))
            printf("  row %u: %g, %g\n", row, (double)images.calm, (double)images.ragged);
        frame.content = LULL_LIGHTMAP_HDR; /* is ragged as pictures are */
        again.calm = again.ragged = NAN;
        CHECK_EQ(lull_plan_init(&plan, plan_memory, plan_bytes, &frame, model), LULL_OK);
        CHECK_EQ(lull_measure(&again, plan, &host), LULL_OK);
        CHECK(again.calm == -1 && again.ragged == images.ragged);
        again.calm = again.ragged = 0.2f; /* known */
        CHECK_EQ(lull_measure(&again, plan, NULL), LULL_OK);
        CHECK(again.calm == 0.2f && again.ragged == 0.2f);
        free(plan_memory);
        free(in);
        free(albedo);
    }
    free(model_memory);
    free(weights);
}

/* Only of pictures is it measured: light maps are not mixed with their input at all, and albedo or
 * normals that are even say nothing of their edges. */
static void calm_is_of_pictures(void)
{
    static const struct {
        lull_content content;
        unsigned features;
        float least, most;
    } rows[] = {{LULL_HDR, LULL_HAS_COLOR, 0.98f, 1},
                {LULL_HDR, LULL_HAS_COLOR | LULL_HAS_NORMAL, 0.98f, 1},
                {LULL_LDR, LULL_HAS_COLOR, 0.98f, 1},
                {LULL_LIGHTMAP_HDR, LULL_HAS_COLOR, -1, -1},
                {LULL_LIGHTMAP_DIR, LULL_HAS_COLOR, -1, -1},
                {LULL_LDR, LULL_HAS_ALBEDO, 0, 0},
                {LULL_LDR, LULL_HAS_NORMAL, 0, 0}};
    lull_model *model = load_model("weights/kernel5_8.tza");
    float *in = malloc(VALUES * sizeof *in);
    for (unsigned i = 0; i < VALUES; i++)
        in[i] = 0.5f + 0.01f * chance(i);
    for (unsigned row = 0; row < sizeof rows / sizeof rows[0]; row++) {
        lull_frame frame =
            lull_frame_default(WIDTH, HEIGHT, rows[row].content, rows[row].features);
        size_t bytes = lull_plan_size(&frame, model);
        void *memory = aligned(bytes);
        lull_images images = {.input_scale = NAN, .calm = NAN, .ragged = NAN};
        lull_plan *plan;
        CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_OK);
        images.color = images.albedo = images.normal = images.output =
            (lull_image){in, LULL_F32, 3, 0, 0};
        CHECK_EQ(lull_measure(&images, plan, NULL), LULL_OK);
        if (!CHECK(images.calm >= rows[row].least && images.calm <= rows[row].most))
            printf("  row %u: %g\n", row, (double)images.calm);
        free(memory);
    }
    free(model);
    free(in);
}

/* Columns [begin, end) of a frame that is tight, denoised with `overlap` more on either side. */
static void run_tile(const lull_model *model, lull_images images, const lull_frame *whole,
                     unsigned begin, unsigned end, unsigned overlap)
{
    const unsigned left = begin < overlap ? begin : overlap;
    const unsigned right = whole->width - end < overlap ? whole->width - end : overlap;
    lull_frame frame = *whole;
    size_t bytes, row = (size_t)3 * sizeof(float);
    float *output = images.output.data, *tile;
    lull_plan *plan;
    void *memory;
    frame.width = left + (end - begin) + right;
    bytes = lull_plan_size(&frame, model);
    memory = aligned(bytes);
    tile = malloc(frame.height * frame.width * row);
    CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_OK);
    images.color.data = (float *)images.color.data + 3 * (size_t)(begin - left);
    images.color.row_stride = (ptrdiff_t)(whole->width * row);
    images.output.data = tile;
    CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
    for (unsigned y = 0; y < frame.height; y++)
        memcpy(output + 3 * ((size_t)y * whole->width + begin),
               tile + 3 * ((size_t)y * frame.width + left), (end - begin) * row);
    free(tile);
    free(memory);
}

/* A host's tiles make the whole frame if they overlap by as much as is told and begin at multiples
 * of the alignment. */
static void tiles_make_the_frame(void)
{
    static const char *const networks[] = {"weights/kernel5_8.tza", "weights/rt_hdr_w16.tza"};
    for (unsigned n = 0; n < 2; n++) {
        lull_model *model = load_model(networks[n]);
        const lull_frame frame = lull_frame_default(530, 40, LULL_HDR, LULL_HAS_COLOR);
        const size_t values = 530 * 40 * 3;
        float *in = malloc(values * sizeof *in), *out = malloc(values * sizeof *in);
        float *tiled = malloc(values * sizeof *in);
        const size_t bytes = lull_plan_size(&frame, model);
        void *memory = aligned(bytes);
        lull_images images = {0};
        lull_model_info info;
        lull_plan *plan;
        for (size_t i = 0; i < values; i++)
            in[i] = 0.2f + chance((uint32_t)i);
        images.color = (lull_image){in, LULL_F32, 3, 0, 0};
        images.output = (lull_image){out, LULL_F32, 3, 0, 0};
        images.input_scale = images.calm = images.ragged = NAN;
        lull_model_get_info(model, &info);
        CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_OK);
        CHECK_EQ(lull_measure(&images, plan, NULL), LULL_OK);
        CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
        images.output.data = tiled;
        run_tile(model, images, &frame, 0, 15 * info.alignment, info.overlap);
        run_tile(model, images, &frame, 15 * info.alignment, 530, info.overlap);
        CHECK(memcmp(out, tiled, values * sizeof *out) == 0);
        free(memory);
        free(tiled);
        free(out);
        free(in);
        free(model);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    lull_ports_request();
    RUN(equals_the_reference);
    RUN(models_for_features_refuse_colour);
    RUN(wide_frames_do_not_depend_on_threads_and_strips);
    RUN(calm_and_ragged_are_the_picture_s);
    RUN(calm_is_of_pictures);
    RUN(tiles_make_the_frame);
    return check_report();
}
