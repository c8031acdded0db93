/* Memory: a frame runs in the least that is told, and not in less; height makes no difference. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "models.h"

static const char *const networks[] = {
    "weights/kernel5_32.tza", "tests/golden/kernel/weights.tza",
    "tests/golden/int_unet_9_aux/weights.tza", "tests/golden/unet_9_mixed/weights.tza"};
static const unsigned sizes[][2] = {{1, 1}, {33, 79}, {48, 1500}, {400, 40}, {700, 300}};

/* Plans of a frame, in place and streamed or not: the least is no more than the usual one, is
 * enough, and a byte less is too little. */
static void check_least(const lull_model *model, unsigned width, unsigned height)
{
    for (unsigned variant = 0; variant < 8; variant++) {
        lull_frame frame = lull_frame_default(width, height, LULL_HDR, 7);
        lull_plan *plan;
        size_t usual, least, limited;
        int is_right;
        frame.in_place = variant & 1;
        frame.streamed = variant >> 1 & 1;
        frame.threads = variant >> 2 ? 7 : 1;
        usual = lull_plan_size(&frame, model);
        least = lull_plan_minimum(&frame, model);
        is_right = CHECK(usual > 0) & CHECK(least <= usual);
        frame.max_bytes = least;
        limited = lull_plan_size(&frame, model);
        is_right &= CHECK(limited > 0 && limited <= least);
        frame.max_bytes = least - 1;
        is_right &= CHECK_EQ(lull_plan_size(&frame, model), 0);
        is_right &= CHECK_EQ(lull_plan_init(&plan, NULL, 0, &frame, model), LULL_ERROR_MEMORY);
        if (!is_right)
            printf("  %ux%u, variant %u: %lu bytes at least, %lu usually, %lu within that\n", width,
                   height, variant, (unsigned long)least, (unsigned long)usual,
                   (unsigned long)limited);
    }
}

static void least_memory_is_the_least(void)
{
    for (size_t n = 0; n < sizeof networks / sizeof networks[0]; n++) {
        lull_model *model = load_model(networks[n]);
        for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
            check_least(model, sizes[i][0], sizes[i][1]);
        free(model);
    }
}

/* Neither memory nor delay grow with the height, whatever the row step. */
static void no_row_step_falls_behind(void)
{
    static const unsigned steps[] = {0, 1, 2, 3, 5, 6, 7, 8, 12, 15, 17, 24, 33, 48, 100};
    for (size_t n = 0; n < sizeof networks / sizeof networks[0]; n++) {
        lull_model *model = load_model(networks[n]);
        for (size_t i = 0; i < 2 * (sizeof steps / sizeof steps[0]); i++) {
            lull_frame low = lull_frame_default(100, 1600, LULL_HDR, 7), tall = low;
            lull_plan_info info[2];
            lull_plan *plan;
            tall.height = 8000;
            low.row_step = tall.row_step = steps[i / 2];
            low.streamed = tall.streamed = i & 1;
            for (unsigned j = 0; j < 2; j++) {
                const lull_frame *frame = j ? &tall : &low;
                size_t bytes = lull_plan_size(frame, model);
                void *memory = aligned(bytes);
                CHECK_EQ(lull_plan_init(&plan, memory, bytes, frame, model), LULL_OK);
                lull_plan_get_info(plan, &info[j]);
                free(memory);
            }
            if (!CHECK(info[1].bytes < info[0].bytes + info[0].bytes / 8) ||
                !CHECK(info[1].delay_rows < info[0].delay_rows + 100))
                printf("  %s, row step %u: %lu and %lu bytes, delays of %u and %u rows\n",
                       networks[n], steps[i / 2], (unsigned long)info[0].bytes,
                       (unsigned long)info[1].bytes, info[0].delay_rows, info[1].delay_rows);
        }
        free(model);
    }
}

/* Limits are met by trying many strips, and rows repeat themselves. Frames come out as one that is
 * made all rows together. */
static void tall_frames_are_planned_at_once(void)
{
    static const unsigned steps[] = {4096, 1, 2};
    for (size_t n = 0; n < sizeof networks / sizeof networks[0]; n++) {
        lull_model *model = load_model(networks[n]);
        lull_frame frame = lull_frame_default(1920, LULL_MAX_SIZE, LULL_HDR, 7);
        const clock_t start = clock();
        const size_t pixels = 16 * 2400;
        float *pictures = malloc(5 * 3 * pixels * sizeof(float));
        lull_images images = {0};
        frame.max_bytes = lull_plan_minimum(&frame, model) + (1 << 20);
        CHECK(lull_plan_size(&frame, model) > 0);
        CHECK((clock() - start) / CLOCKS_PER_SEC < 3); /* without repetition 12 and more */
        for (size_t i = 0; i < 3 * 3 * pixels; i++)
            pictures[i] = (float)(i * 2654435761u >> 12 & 1023) / 1023.0f;
        images.color.data = pictures;
        images.albedo.data = pictures + 3 * pixels;
        images.normal.data = pictures + 6 * pixels;
        images.color.channels = images.albedo.channels = images.normal.channels = 3;
        images.output.channels = 3;
        images.input_scale = images.calm = images.ragged = NAN;
        for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
            size_t bytes;
            void *memory;
            lull_plan *plan;
            frame = lull_frame_default(16, 2400, LULL_HDR, 7);
            frame.row_step = steps[i];
            bytes = lull_plan_size(&frame, model);
            memory = aligned(bytes);
            images.output.data = pictures + (9 + 3 * (i > 0)) * pixels;
            CHECK_EQ(lull_plan_init(&plan, memory, bytes, &frame, model), LULL_OK);
            CHECK_EQ(lull_run(plan, &images, NULL), LULL_OK);
            CHECK(memcmp(pictures + 9 * pixels, images.output.data, 12 * pixels) == 0);
            free(memory);
        }
        free(pictures);
        free(model);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(least_memory_is_the_least);
    RUN(no_row_step_falls_behind);
    RUN(tall_frames_are_planned_at_once);
    return check_report();
}
