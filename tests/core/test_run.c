/* Plans and runs through the native API: schedules, memory, streaming, aliasing, errors. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <pthread.h>
#include <stdlib.h>

#include "models.h"

#define WEIGHTS "tests/golden/unet_9_mixed/weights.tza"
#define AUX_WEIGHTS "tests/golden/int_unet_9_aux/weights.tza"
#define COLOR_WEIGHTS "tests/golden/unet_3_eights/weights.tza"
#define ALL_FEATURES (LULL_HAS_COLOR | LULL_HAS_ALBEDO | LULL_HAS_NORMAL)

/* A frame's images: noise with some NaN, infinities and negative values; channels per feature. */
typedef struct scene {
    unsigned width, height, channels[3];
    float *feature[3], *output;
    lull_images images;
} scene;

static lull_image view(float *data, unsigned channels)
{
    lull_image image = {0};
    image.data = data;
    image.channels = channels;
    return image;
}

static scene make_scene(unsigned width, unsigned height, unsigned channels)
{
    scene s;
    uint32_t state = 12345;
    size_t pixels = (size_t)width * height;
    memset(&s, 0, sizeof s);
    s.width = width;
    s.height = height;
    for (unsigned f = 0; f < 3; f++) {
        s.channels[f] = f == 0 ? channels : 3;
        s.feature[f] = malloc((pixels + 1) * s.channels[f] * sizeof(float));
        for (size_t i = 0; i < pixels * s.channels[f]; i++) {
            state = state * 1664525u + 1013904223u;
            s.feature[f][i] = (float)(state >> 8) / 16777216.0f * (f == 0 ? 3.0f : 1.1f) - 0.05f;
            if (state % 97 == 0)
                s.feature[f][i] = state & 256 ? NAN : state & 512 ? INFINITY : -INFINITY;
        }
    }
    s.output = calloc(pixels * channels + 1, sizeof(float));
    s.images.color = view(s.feature[0], channels);
    s.images.albedo = view(s.feature[1], 3);
    s.images.normal = view(s.feature[2], 3);
    s.images.output = view(s.output, channels);
    s.images.input_scale = s.images.calm = s.images.ragged = NAN;
    return s;
}

static void free_scene(scene *s)
{
    for (unsigned f = 0; f < 3; f++)
        free(s->feature[f]);
    free(s->output);
}

static lull_plan *make_plan(const lull_frame *frame, const lull_model *model)
{
    lull_plan *plan = NULL;
    size_t bytes = lull_plan_size(frame, model);
    CHECK_EQ(lull_plan_init(&plan, aligned(bytes), bytes, frame, model), LULL_OK);
    return plan;
}

/* ---- A parallel_for with real threads -------------------------------------------------------- */

typedef struct job {
    void (*body)(void *, unsigned, unsigned);
    void *context;
    unsigned count, next, threads;
    pthread_mutex_t lock;
} job;

typedef struct worker {
    job *work;
    unsigned number;
} worker;

static void *work(void *argument)
{
    worker *w = argument;
    for (;;) {
        unsigned index;
        pthread_mutex_lock(&w->work->lock);
        index = w->work->next++;
        pthread_mutex_unlock(&w->work->lock);
        if (index >= w->work->count)
            return NULL;
        w->work->body(w->work->context, index, w->number);
    }
}

static void with_threads(void *user, unsigned count, void (*body)(void *, unsigned, unsigned),
                         void *context)
{
    job j = {body, context, count, 0, *(unsigned *)user, PTHREAD_MUTEX_INITIALIZER};
    pthread_t thread[8];
    worker workers[8];
    for (unsigned i = 0; i < j.threads; i++) {
        workers[i].work = &j;
        workers[i].number = i;
        pthread_create(&thread[i], NULL, work, &workers[i]);
    }
    for (unsigned i = 0; i < j.threads; i++)
        pthread_join(thread[i], NULL);
}

/* ---- Tests ----------------------------------------------------------------------------------- */

static void same_bytes_for_every_schedule(void)
{
    static const struct {
        unsigned threads, row_step, strip_width;
    } variants[] = {{1, 1, 0}, {2, 0, 0}, {3, 16, 16}, {7, 4, 64}, {1, 3, 33}, {2, 1000, 0}};
    lull_model *model = load_model(WEIGHTS);
    scene s = make_scene(131, 77, 3);
    lull_frame frame = lull_frame_default(s.width, s.height, LULL_HDR, ALL_FEATURES);
    size_t bytes = (size_t)s.width * s.height * 3 * sizeof(float);
    float *first = malloc(bytes);
    lull_plan *plan = make_plan(&frame, model);
    CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
    memcpy(first, s.output, bytes);
    free(plan);
    for (size_t v = 0; v < sizeof variants / sizeof variants[0]; v++) {
        unsigned threads = variants[v].threads;
        lull_host host = {&threads, with_threads, NULL};
        frame.threads = threads;
        frame.row_step = variants[v].row_step;
        frame.strip_width = variants[v].strip_width;
        plan = make_plan(&frame, model);
        memset(s.output, 0xff, bytes);
        CHECK_EQ(lull_run(plan, &s.images, &host), LULL_OK);
        CHECK(memcmp(first, s.output, bytes) == 0);
        memset(s.output, 0xff, bytes); /* a second run of the same plan */
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        CHECK(memcmp(first, s.output, bytes) == 0);
        free(plan);
    }
    free(first);
    free(model);
    free_scene(&s);
}

/* Steps of more rows than there are are steps of all rows. */
static void row_steps_end_with_the_frame(void)
{
    static const unsigned steps[] = {80, 1000, 32768, 65535, 65536, 70000, UINT32_MAX};
    static const unsigned heights[] = {0, 1, 77, LULL_MAX_SIZE};
    lull_model *model = load_model(COLOR_WEIGHTS);
    for (size_t h = 0; h < sizeof heights / sizeof heights[0]; h++) {
        scene s = make_scene(5, heights[h], 3);
        lull_frame frame = lull_frame_default(5, heights[h], LULL_HDR, LULL_HAS_COLOR);
        size_t bytes = (size_t)5 * heights[h] * 3 * sizeof(float);
        float *first = malloc(bytes + 1);
        lull_plan *plan = make_plan(&frame, model);
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        memcpy(first, s.output, bytes);
        free(plan);
        for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
            lull_plan_info info;
            frame.row_step = steps[i];
            plan = make_plan(&frame, model);
            lull_plan_get_info(plan, &info);
            CHECK(info.row_step <= steps[i] && info.row_step <= heights[h] / 16 * 16 + 16);
            if (heights[h] < LULL_MAX_SIZE || steps[i] == UINT32_MAX) {
                memset(s.output, 0xff, bytes);
                CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
                CHECK(memcmp(first, s.output, bytes) == 0);
            }
            free(plan);
        }
        free(first);
        free_scene(&s);
    }
    free(model);
}

static void run_in_place(const char *weights)
{
    static const unsigned strips[] = {0, 16, 48, 112};
    lull_model *model = load_model(weights);
    for (unsigned target = 0; target < 3; target++)
        for (size_t v = 0; v < 4; v++) {
            scene s = make_scene(150, 60, 3), t = make_scene(150, 60, 3);
            size_t bytes = (size_t)s.width * s.height * 3 * sizeof(float);
            lull_frame frame = lull_frame_default(s.width, s.height, LULL_HDR, ALL_FEATURES);
            lull_plan *plan;
            frame.strip_width = strips[v];
            plan = make_plan(&frame, model);
            CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
            free(plan);
            frame.in_place = 1;
            plan = make_plan(&frame, model);
            t.images.output = view(t.feature[target], 3);
            CHECK_EQ(lull_run(plan, &t.images, NULL), LULL_OK);
            CHECK(memcmp(s.output, t.feature[target], bytes) == 0);
            free(plan);
            free_scene(&s);
            free_scene(&t);
        }
    free(model);
}

/* Rows of an image from row y on. */
static lull_image rows_from(const lull_image *image, unsigned width, unsigned y)
{
    lull_image rows = *image;
    rows.data = (float *)image->data + (size_t)y * width * image->channels;
    return rows;
}

static void in_place_equals_out_of_place(void)
{
    run_in_place(WEIGHTS);
    run_in_place(AUX_WEIGHTS);
}

static void run_streamed(const char *weights)
{
    static const unsigned pushes[] = {1, 7, 16, 40, 1000};
    lull_model *model = load_model(weights);
    for (size_t v = 0; v < sizeof pushes / sizeof pushes[0]; v++) {
        scene s = make_scene(50, 203, 3), other = make_scene(50, 203, 3);
        size_t bytes = (size_t)s.width * s.height * 3 * sizeof(float);
        float *whole = malloc(bytes);
        lull_frame frame = lull_frame_default(s.width, s.height, LULL_HDR, ALL_FEATURES);
        lull_plan *plan = make_plan(&frame, model);
        lull_plan_info info;
        unsigned in = 0, out = 0;
        lull_plan_get_info(plan, &info);
        s.images.input_scale = 0.7f;
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        memcpy(whole, s.output, bytes);
        memset(s.output, 0, bytes);
        CHECK_EQ(lull_rows_begin(plan, 0.7f, NAN, NAN), LULL_OK);
        while (in < s.height) {
            unsigned n = pushes[v] < s.height - in ? pushes[v] : s.height - in, ready = 0;
            lull_images images = s.images;
            images.color = rows_from(&s.images.color, s.width, in);
            images.albedo = rows_from(&s.images.albedo, s.width, in);
            images.normal = rows_from(&s.images.normal, s.width, in);
            images.output = rows_from(&s.images.output, s.width, out);
            CHECK_EQ(lull_rows(plan, &images, n, &ready, NULL), LULL_OK);
            CHECK(ready <= n + info.delay_rows);
            in += n;
            out += ready;
            other.images.input_scale = other.images.calm = other.images.ragged = NAN;
            CHECK_EQ(lull_measure(&other.images, plan, NULL), LULL_OK); /* changes nothing */
            CHECK(in == s.height || out + info.delay_rows + 1 >= in);
        }
        CHECK_EQ(out, s.height);
        CHECK(memcmp(whole, s.output, bytes) == 0);
        free(whole);
        free(plan);
        free_scene(&s);
        free_scene(&other);
    }
    free(model);
}

static void streamed_rows_equal_a_run(void)
{
    run_streamed(WEIGHTS);
    run_streamed(AUX_WEIGHTS);
}

static void plans_can_be_moved(void)
{
    lull_model *model = load_model(COLOR_WEIGHTS);
    scene s = make_scene(40, 40, 3);
    size_t bytes = (size_t)s.width * s.height * 3 * sizeof(float), plan_bytes;
    float *first = malloc(bytes);
    lull_frame frame = lull_frame_default(s.width, s.height, LULL_HDR, LULL_HAS_COLOR);
    lull_plan *plan = make_plan(&frame, model), *moved;
    CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
    memcpy(first, s.output, bytes);
    plan_bytes = lull_plan_size(&frame, model);
    moved = aligned(plan_bytes);
    memcpy(moved, plan, plan_bytes);
    memset(plan, 0xff, plan_bytes);
    free(plan);
    CHECK_EQ(lull_run(moved, &s.images, NULL), LULL_OK);
    CHECK(memcmp(first, s.output, bytes) == 0);
    free(moved);
    free(first);
    free(model);
    free_scene(&s);
}

static void every_size_runs(void)
{
    lull_model *model = load_model(WEIGHTS);
    for (unsigned channels = 1; channels <= 3; channels++)
        for (unsigned w = 0; w < 36; w += w < 4 ? 1 : 15)
            for (unsigned h = 0; h < 36; h += h < 4 ? 1 : 15)
                for (unsigned content = 0; content < LULL_CONTENT_COUNT; content++) {
                    scene s = make_scene(w, h, channels);
                    lull_frame frame =
                        lull_frame_default(w, h, (lull_content)content, ALL_FEATURES);
                    lull_plan *plan = make_plan(&frame, model);
                    int hdr = content == LULL_HDR || content == LULL_LIGHTMAP_HDR;
                    float low = content == LULL_LIGHTMAP_DIR ? -1.0f : 0.0f;
                    CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
                    for (size_t i = 0; i < (size_t)w * h * channels; i++)
                        if (!(s.output[i] >= low && s.output[i] <= (hdr ? 3.402823466e38f : 1.0f)))
                            CHECK(s.output[i] == 0.0f); /* reports */
                    free(plan);
                    free_scene(&s);
                }
    free(model);
}

/* The scale that a run takes can be asked for, and given to it. */
static void scale_is_the_run_s(void)
{
    lull_model *model = load_model(WEIGHTS);
    for (unsigned content = 0; content < LULL_CONTENT_COUNT; content++) {
        scene s = make_scene(50, 37, 3);
        size_t bytes = (size_t)s.width * s.height * 3 * sizeof(float);
        float *own = malloc(bytes), scale = 0;
        lull_frame frame =
            lull_frame_default(s.width, s.height, (lull_content)content, ALL_FEATURES);
        lull_plan *plan = make_plan(&frame, model);
        int is_hdr = content == LULL_HDR || content == LULL_LIGHTMAP_HDR;
        int is_lightmap = content == LULL_LIGHTMAP_DIR || content == LULL_LIGHTMAP_HDR;
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        memcpy(own, s.output, bytes);
        CHECK_EQ(lull_measure(&s.images, plan, NULL), LULL_OK);
        scale = s.images.input_scale;
        CHECK(scale == (is_hdr ? lull_autoexposure(&s.images.color, s.width, s.height) : 1));
        CHECK(!is_hdr || scale != 1);
        CHECK(s.images.calm == (is_lightmap ? -1.0f : 0)); /* direct networks do not ask */
        CHECK(s.images.ragged == 0);
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        CHECK(memcmp(own, s.output, bytes) == 0);
        s.images.input_scale = 0.7f;
        s.images.calm = 0.2f;
        CHECK_EQ(lull_measure(&s.images, plan, NULL), LULL_OK);
        CHECK(s.images.input_scale == 0.7f && s.images.calm == 0.2f);
        CHECK_EQ(lull_measure(&s.images, NULL, NULL), LULL_ERROR_ARGUMENT);
        CHECK_EQ(lull_measure(NULL, plan, NULL), LULL_ERROR_ARGUMENT);
        s.images.color.data = NULL;
        CHECK_EQ(lull_measure(&s.images, plan, NULL), LULL_ERROR_IMAGE);
        free(own);
        free(plan);
        free_scene(&s);
    }
    free(model);
}

/* Plan memory is what was asked for, is filled with a pattern around it, and does not grow with
 * height. */
static void memory_is_known_beforehand(void)
{
    lull_model *model = load_model(WEIGHTS);
    lull_frame frame = lull_frame_default(320, 400, LULL_HDR, ALL_FEATURES);
    lull_frame tall = frame;
    size_t bytes = lull_plan_size(&frame, model), minimum = lull_plan_minimum(&frame, model);
    scene s = make_scene(320, 400, 3);
    uint8_t *memory;
    lull_plan *plan;
    tall.height = 8000;
    CHECK(lull_plan_size(&tall, model) <= bytes + 8000);
    CHECK(minimum < bytes);
    for (size_t limit = minimum; limit <= bytes; limit += (bytes - minimum) / 5 + 1) {
        lull_plan_info info;
        size_t n;
        frame.max_bytes = limit;
        n = lull_plan_size(&frame, model);
        CHECK(n && n <= limit);
        memory = aligned(n + 128);
        memset(memory, 0xa5, n + 128);
        CHECK_EQ(lull_plan_init(&plan, memory, n - 1, &frame, model), LULL_ERROR_MEMORY);
        CHECK_EQ(lull_plan_init(&plan, memory, n, &frame, model), LULL_OK);
        CHECK_EQ(lull_run(plan, &s.images, NULL), LULL_OK);
        lull_plan_get_info(plan, &info);
        CHECK_EQ(info.bytes, n);
        for (size_t i = 0; i + 64 <= n; i += 64) { /* all of it is touched */
            unsigned same = 0;
            while (same < 64 && memory[i + same] == 0xa5)
                same++;
            CHECK(same < 64);
        }
        for (unsigned i = 0; i < 128; i++)
            CHECK_EQ(memory[n + i], 0xa5);
        free(memory);
    }
    frame.max_bytes = minimum - 1;
    CHECK_EQ(lull_plan_size(&frame, model), 0);
    memory = aligned(bytes);
    CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_ERROR_MEMORY);
    free(memory);
    free(model);
    free_scene(&s);
}

static unsigned calls;
static double last_fraction;

static int count_calls(void *user, double fraction)
{
    CHECK(fraction >= last_fraction && fraction <= 1.0);
    last_fraction = fraction;
    return ++calls < *(unsigned *)user;
}

static void progress_is_monotone_and_cancels(void)
{
    lull_model *model = load_model(COLOR_WEIGHTS);
    scene s = make_scene(64, 400, 3);
    lull_frame frame = lull_frame_default(s.width, s.height, LULL_HDR, LULL_HAS_COLOR);
    lull_plan *plan = make_plan(&frame, model);
    unsigned limit = 1000000;
    lull_host host = {&limit, NULL, count_calls};
    CHECK_EQ(lull_run(plan, &s.images, &host), LULL_OK);
    CHECK(calls >= 20);
    CHECK(last_fraction == 1.0);
    for (limit = 1; limit < 5; limit++) {
        calls = 0;
        last_fraction = 0;
        CHECK_EQ(lull_run(plan, &s.images, &host), LULL_CANCELLED);
        CHECK_EQ(calls, limit);
    }
    calls = 0;
    last_fraction = 0;
    limit = 1000000;
    CHECK_EQ(lull_run(plan, &s.images, &host), LULL_OK);
    free(plan);
    free(model);
    free_scene(&s);
}

/* Without a colour there is no radiance to expose. */
static void content_suits_the_main_image(void)
{
    static const unsigned features[] = {LULL_HAS_COLOR, LULL_HAS_ALBEDO, LULL_HAS_NORMAL};
    static const lull_status expected[3][LULL_CONTENT_COUNT] = {
        {LULL_OK, LULL_OK, LULL_OK, LULL_OK, LULL_OK},
        {LULL_ERROR_ARGUMENT, LULL_OK, LULL_OK, LULL_ERROR_ARGUMENT, LULL_ERROR_ARGUMENT},
        {LULL_ERROR_ARGUMENT, LULL_OK, LULL_ERROR_ARGUMENT, LULL_ERROR_ARGUMENT,
         LULL_ERROR_ARGUMENT}};
    lull_model *model = load_model(COLOR_WEIGHTS);
    scene s = make_scene(20, 20, 3);
    uint8_t *memory = aligned(1 << 22);
    for (unsigned f = 0; f < 3; f++)
        for (unsigned content = 0; content < LULL_CONTENT_COUNT; content++) {
            const lull_status status = expected[f][content];
            lull_frame frame = lull_frame_default(20, 20, (lull_content)content, features[f]);
            lull_images images = {0};
            lull_plan *plan;
            CHECK_EQ(lull_plan_size(&frame, model) > 0, status == LULL_OK);
            CHECK_EQ(lull_plan_minimum(&frame, model) > 0, status == LULL_OK);
            CHECK_EQ(lull_plan_init(&plan, NULL, 0, &frame, model),
                     status == LULL_OK ? LULL_ERROR_MEMORY : status);
            CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &frame, model), status);
            if (status != LULL_OK)
                continue;
            *(f == 0 ? &images.color : f == 1 ? &images.albedo : &images.normal) =
                view(s.feature[f], 3);
            images.output = s.images.output;
            images.input_scale = images.calm = images.ragged = NAN;
            CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
        }
    free(memory);
    free(model);
    free_scene(&s);
}

static void errors_are_reported(void)
{
    lull_model *model = load_model(WEIGHTS);
    scene s = make_scene(20, 20, 3);
    lull_frame frame = lull_frame_default(20, 20, LULL_HDR, LULL_HAS_COLOR), good;
    uint8_t *memory = aligned(1 << 22);
    lull_plan *plan;
    lull_images images = s.images;
    CHECK_EQ(lull_plan_size(&frame, model), 0);
    CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &frame, model), LULL_ERROR_FEATURES);
    good = lull_frame_default(20, 20, LULL_HDR, ALL_FEATURES);
    frame.height = 0; /* takes any */
    CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &frame, model), LULL_OK);
    CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
    frame.height = 20;
    /* what made the size 0 is said without any memory, as a caller without sizes has none */
    CHECK_EQ(lull_plan_init(&plan, NULL, 0, &frame, model), LULL_ERROR_FEATURES);
    CHECK_EQ(lull_plan_init(&plan, NULL, 0, &good, model), LULL_ERROR_MEMORY);
    CHECK_EQ(lull_plan_init(&plan, memory + 1, 1 << 20, &good, model), LULL_ERROR_ARGUMENT);
    CHECK_EQ(lull_plan_init(&plan, NULL, 1 << 20, &good, model), LULL_ERROR_ARGUMENT);
    frame = good;
    frame.width = LULL_MAX_SIZE + 1;
    CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &frame, model), LULL_ERROR_ARGUMENT);
    frame = good;
    frame.content = LULL_CONTENT_COUNT;
    CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &frame, model), LULL_ERROR_ARGUMENT);
    CHECK_EQ(lull_plan_init(&plan, memory, 1 << 22, &good, model), LULL_OK);
    CHECK_EQ(lull_run(NULL, &images, NULL), LULL_ERROR_ARGUMENT);
    images.normal.data = NULL;
    CHECK_EQ(lull_run(plan, &images, NULL), LULL_ERROR_IMAGE);
    images = s.images;
    images.output.channels = 2;
    CHECK_EQ(lull_run(plan, &images, NULL), LULL_ERROR_IMAGE);
    for (unsigned i = 0; i <= LULL_STATUS_COUNT; i++)
        CHECK(strlen(lull_status_text((lull_status)i)) > 3);
    CHECK_EQ(lull_ports_up_to("scalar", 6), LULL_PORTS_SCALAR);
    CHECK_EQ(lull_ports_up_to("scal", 4), 0);
    free(memory);
    free(model);
    free_scene(&s);
}

/* The largest and the smallest overlap of the models that ship are those that lull.h names. */
static void overlaps_are_as_told(void)
{
    static const char *const paths[] = {"weights/kernel5_32.tza", "weights/rt_hdr_w16.tza"};
    unsigned told[2] = {0, 0}; /* least and most */
    char line[200];
    FILE *file = fopen("lib/lull.h", "rb");
    while (file && told[1] == 0 && fgets(line, sizeof line, file))
        if (strstr(line, "unsigned overlap;"))
            CHECK_EQ(sscanf(strchr(line, '('), "(%u to %u)", &told[0], &told[1]), 2);
    if (file)
        fclose(file);
    for (unsigned i = 0; i < 2; i++) {
        lull_model *model = load_model(paths[i]);
        lull_model_info info;
        lull_model_get_info(model, &info);
        CHECK_EQ(info.overlap, told[1 - i]);
        free(model);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(same_bytes_for_every_schedule);
    RUN(row_steps_end_with_the_frame);
    RUN(in_place_equals_out_of_place);
    RUN(streamed_rows_equal_a_run);
    RUN(plans_can_be_moved);
    RUN(every_size_runs);
    RUN(scale_is_the_run_s);
    RUN(memory_is_known_beforehand);
    RUN(progress_is_monotone_and_cancels);
    RUN(content_suits_the_main_image);
    RUN(errors_are_reported);
    RUN(overlaps_are_as_told);
    return check_report();
}
