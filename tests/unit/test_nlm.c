/* The classical denoiser: what must stay as it is, what must get better, and that tiles are all the
 * same to it. */
#include "nlm.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "exposure.h"
#include "hash.h"
#include "image.h"

typedef struct scene {
    unsigned width, height;
    float *clean, *noisy, *albedo, *normal, *output; /* 3 floats a pixel */
} scene;

static float *floats(const scene *s) { return calloc((size_t)s->width * s->height * 3, 4); }

static size_t count(const scene *s) { return (size_t)s->width * s->height * 3; }

/* A textured wall and floor under a soft light that fades to the right; exponential noise of
 * relative deviation `noise`, and rare fireflies. */
static scene make_scene(unsigned width, unsigned height, float noise)
{
    scene s = {0};
    uint32_t seed = 12345;
    unsigned x, y, c;
    s.width = width;
    s.height = height;
    s.clean = floats(&s);
    s.noisy = floats(&s);
    s.albedo = floats(&s);
    s.normal = floats(&s);
    s.output = floats(&s);
    for (y = 0; y < height; ++y)
        for (x = 0; x < width; ++x) {
            float light = 0.2f + 3.0f * (float)x / (float)width, draw = 1 - random_float(&seed);
            int is_wall = y < height / 2, is_dark = (x / 8 + y / 8) % 2;
            float sample = 1 - noise - noise * logf(draw > 0 ? draw : 1e-7f);
            if (noise > 0 && random_bits(&seed) % 500 == 0)
                sample *= 100;
            for (c = 0; c < 3; ++c) {
                size_t i = ((size_t)y * width + x) * 3 + c;
                s.albedo[i] = is_dark ? 0.15f + 0.1f * (float)c : 0.8f;
                s.normal[i] = c == (is_wall ? 2 : 1) ? 1.0f : 0.0f;
                s.clean[i] = light * (is_wall ? 1.0f : 0.3f) * (s.albedo[i] + 0.02f);
                s.noisy[i] = s.clean[i] * (sample > 0 ? sample : 0);
            }
        }
    return s;
}

static void free_scene(scene *s)
{
    free(s->clean);
    free(s->noisy);
    free(s->albedo);
    free(s->normal);
    free(s->output);
}

static lull_image view(float *data)
{
    lull_image image = {0};
    image.data = data;
    image.channels = 3;
    return image;
}

static lull_nlm job_of(const scene *s)
{
    lull_nlm job = {0};
    job.width = s->width;
    job.height = s->height;
    job.color = view(s->noisy);
    job.albedo = view(s->albedo);
    job.normal = view(s->normal);
    job.output = view(s->output);
    job.scale = lull_autoexposure(&job.color, s->width, s->height);
    job.strength = 1;
    return job;
}

/* Memory for a worker, full of what must not matter; *block is to be freed. */
static void *worker_memory(void **block)
{
    size_t n = lull_nlm_bytes();
    uint8_t *memory = *block = malloc(n + LULL_ALIGN);
    memset(memory, 0xff, n + LULL_ALIGN);
    return memory + (LULL_ALIGN - (uintptr_t)memory % LULL_ALIGN) % LULL_ALIGN;
}

static void run(const lull_nlm *job)
{
    unsigned column, row;
    void *block, *memory = worker_memory(&block);
    CHECK_EQ(lull_nlm_check(job), LULL_OK);
    for (row = 0; row < lull_nlm_rows(job->height); ++row)
        for (column = 0; column < lull_nlm_columns(job->width); ++column)
            lull_nlm_tile(job, column, row, memory);
    free(block);
}

/* Mean squared error relative to the clean image, of values like those that metrics see. */
static double error_of(const scene *s, const float *image)
{
    double sum = 0;
    size_t i;
    for (i = 0; i < count(s); ++i) {
        double d = log1p(image[i]) - log1p(s->clean[i]);
        sum += d * d;
    }
    return sum / (double)count(s);
}

/* ---- Quality --------------------------------------------------------------------------------- */

static void removes_noise(void)
{
    static const float noises[] = {0.1f, 0.3f, 1.0f};
    int i, features;
    for (i = 0; i < 3; ++i)
        for (features = 0; features < 2; ++features) {
            scene s = make_scene(100, 66, noises[i]);
            lull_nlm job = job_of(&s);
            double before = error_of(&s, s.noisy), after;
            if (!features)
                job.albedo.data = job.normal.data = NULL;
            run(&job);
            after = error_of(&s, s.output);
            printf("     noise %.1f, %s features: error %.5f, was %.5f\n", noises[i],
                   features ? "with" : "without", after, before);
            CHECK(after < before / (features ? 15 : 4));
            free_scene(&s);
        }
}

static void leaves_flat_images_as_they_are(void)
{
    static const float levels[] = {0, 1e-30f, 0.003f, 0.18f, 1, 777.7f, 60000, 1e20f};
    size_t l, i;
    int features;
    for (l = 0; l < sizeof levels / sizeof *levels; ++l)
        for (features = 0; features < 2; ++features) {
            scene s = make_scene(66, 34, 0);
            lull_nlm job;
            for (i = 0; i < count(&s); ++i) {
                s.noisy[i] = levels[l] * (float)(1 + i % 3);
                s.albedo[i] = 0.3f;
            }
            job = job_of(&s);
            if (!features)
                job.albedo.data = job.normal.data = NULL;
            run(&job);
            CHECK(memcmp(s.output, s.noisy, count(&s) * 4) == 0);
            free_scene(&s);
        }
}

static void keeps_clean_images(void)
{
    scene s = make_scene(150, 100, 0);
    lull_nlm job = job_of(&s);
    double worst = 0;
    size_t i;
    run(&job);
    for (i = 0; i < count(&s); ++i)
        if (fabs(s.output[i] / s.clean[i] - 1) > worst)
            worst = fabs(s.output[i] / s.clean[i] - 1);
    printf("     a clean image changes by %.4f at most\n", worst);
    CHECK(worst < 0.002);
    free_scene(&s);
}

static void removes_a_firefly(void)
{
    scene s = make_scene(64, 64, 0.1f);
    lull_nlm job = job_of(&s);
    size_t at = (20 * 64 + 30) * 3, i;
    s.noisy[at] = s.noisy[at + 1] = s.noisy[at + 2] = 1e7f;
    s.noisy[0] = s.noisy[1] = s.noisy[2] = 1e7f; /* in the corner */
    run(&job);
    for (i = 0; i < 3; ++i) {
        CHECK(s.output[at + i] < 3 * s.clean[at + i]);
        CHECK(s.output[i] < 3 * s.clean[i]);
    }
    free_scene(&s);
}

static void strength_matters(void)
{
    scene s = make_scene(64, 64, 0.3f);
    lull_nlm job = job_of(&s);
    double weak, strong;
    job.strength = 0.3f;
    run(&job);
    weak = error_of(&s, s.output);
    job.strength = 1;
    run(&job);
    strong = error_of(&s, s.output);
    CHECK(strong < weak && weak < error_of(&s, s.noisy));
    free_scene(&s);
}

/* ---- Input of any kind ----------------------------------------------------------------------- */

static void survives_any_values(void)
{
    scene s = make_scene(70, 40, 0.3f);
    lull_nlm job = job_of(&s);
    uint32_t seed = 3;
    size_t i;
    for (i = 0; i < count(&s); ++i) {
        s.noisy[i] = lull_float(random_bits(&seed));
        s.albedo[i] = lull_float(random_bits(&seed));
        s.normal[i] = lull_float(random_bits(&seed));
    }
    run(&job);
    for (i = 0; i < count(&s); ++i)
        if (!CHECK(s.output[i] >= 0 && s.output[i] <= FLT_MAX))
            return;
    free_scene(&s);
}

/* Every size, into rows with gaps: all pixels written, and no byte beside them. */
static void handles_every_size(void)
{
    static const unsigned sizes[] = {1, 2, 3, 14, 16, 17, 31, 33, 64, 65, 66, 81};
    const unsigned n = sizeof sizes / sizeof *sizes;
    unsigned i, j, x, y;
    for (i = 0; i < n; ++i)
        for (j = (i * 5) % 3; j < n; j += 3) {
            scene s = make_scene(sizes[i], sizes[j], 0.3f);
            lull_nlm job = job_of(&s);
            size_t row = 16 * (size_t)s.width + 5, bytes = row * s.height;
            uint8_t *wide = malloc(bytes);
            int untouched = 1, written = 1;
            memset(wide, 0xff, bytes);
            job.output.data = wide;
            job.output.pixel_stride = 16;
            job.output.row_stride = row;
            run(&job);
            for (y = 0; y < s.height; ++y)
                for (x = 0; x < row; ++x) {
                    int is_pixel = x < 16 * s.width && x % 16 < 12;
                    if (!is_pixel)
                        untouched &= wide[y * row + x] == 0xff;
                    else if (x % 16 == 0)
                        written &= memcmp(wide + y * row + x, "\xff\xff\xff\xff", 4) != 0;
                }
            CHECK(untouched);
            CHECK(written);
            free(wide);
            free_scene(&s);
        }
}

/* ---- Tiles ----------------------------------------------------------------------------------- */

static void tiles_may_come_in_any_order(void)
{
    scene s = make_scene(150, 100, 0.5f);
    lull_nlm job = job_of(&s);
    float *backwards = floats(&s);
    unsigned column, row;
    run(&job);
    job.output.data = backwards;
    for (column = lull_nlm_columns(s.width); column-- > 0;)
        for (row = lull_nlm_rows(s.height); row-- > 0;) {
            void *block, *memory = worker_memory(&block);
            lull_nlm_tile(&job, column, row, memory);
            free(block);
        }
    CHECK_EQ(lull_nlm_columns(s.width), 3);
    CHECK_EQ(lull_nlm_rows(s.height), 4);
    CHECK(memcmp(backwards, s.output, count(&s) * 4) == 0);
    free(backwards);
    free_scene(&s);
}

static void copy_rows(float *to, const float *from, unsigned width, unsigned first, unsigned last)
{
    size_t row = (size_t)width * 3;
    memcpy(to + first * row, from + first * row, (last - first) * row * sizeof *to);
}

/* A row of tiles reads LULL_NLM_HALO rows beyond itself, no more. */
static void a_row_of_tiles_reads_its_halo_only(void)
{
    scene s = make_scene(66, 130, 0.5f), part = make_scene(66, 130, 0.5f);
    lull_nlm job = job_of(&s), partial = job_of(&part);
    unsigned row, column;
    void *block, *memory = worker_memory(&block);
    run(&job);
    for (row = 0; row < lull_nlm_rows(s.height); ++row) {
        unsigned y = row * LULL_NLM_TILE_HEIGHT, first, last = y + LULL_NLM_TILE_HEIGHT;
        first = y < LULL_NLM_HALO ? 0 : y - LULL_NLM_HALO;
        last = last + LULL_NLM_HALO < s.height ? last + LULL_NLM_HALO : s.height;
        memset(part.noisy, 0x60, count(&s) * 4);
        memset(part.albedo, 0x60, count(&s) * 4);
        memset(part.normal, 0x60, count(&s) * 4);
        copy_rows(part.noisy, s.noisy, s.width, first, last);
        copy_rows(part.albedo, s.albedo, s.width, first, last);
        copy_rows(part.normal, s.normal, s.width, first, last);
        for (column = 0; column < lull_nlm_columns(s.width); ++column)
            lull_nlm_tile(&partial, column, row, memory);
    }
    CHECK(memcmp(part.output, s.output, count(&s) * 4) == 0);
    free(block);
    free_scene(&s);
    free_scene(&part);
}

static void gives_the_recorded_bits(void)
{
    /* Values without a logarithm of the C library, which is not the same everywhere. */
    scene s = make_scene(97, 61, 0);
    lull_nlm job;
    uint32_t seed = 9;
    uint64_t hash = HASH_START;
    size_t i;
    for (i = 0; i < count(&s); ++i)
        s.noisy[i] = s.clean[i] * (0.5f + random_float(&seed));
    job = job_of(&s);
    run(&job);
    hash = hash_floats(hash, s.output, count(&s));
    job.albedo.data = job.normal.data = NULL;
    run(&job);
    hash = hash_floats(hash, s.output, count(&s));
    if (!CHECK(hash == UINT64_C(0x98d20d971bcef426)))
        printf("     0x%08lx%08lx\n", (unsigned long)(hash >> 32),
               (unsigned long)(hash & 0xffffffffu));
    free_scene(&s);
}

/* ---- Arguments ------------------------------------------------------------------------------- */

static void checks_its_job(void)
{
    scene s = make_scene(8, 8, 0);
    lull_nlm good = job_of(&s), job;
    CHECK_EQ(lull_nlm_check(&good), LULL_OK);
    CHECK_EQ(lull_nlm_check(NULL), LULL_ERROR_ARGUMENT);
#define BAD(change, status)                      \
    do {                                         \
        job = good;                              \
        change;                                  \
        CHECK_EQ(lull_nlm_check(&job), status);  \
    } while (0)
    BAD(job.width = LULL_MAX_SIZE + 1, LULL_ERROR_ARGUMENT);
    BAD(job.height = LULL_MAX_SIZE + 1, LULL_ERROR_ARGUMENT);
    BAD(job.scale = 0, LULL_ERROR_ARGUMENT);
    BAD(job.scale = lull_float(0x7fc00000u), LULL_ERROR_ARGUMENT);
    BAD(job.scale = lull_float(0x7f800000u), LULL_ERROR_ARGUMENT);
    BAD(job.strength = -1, LULL_ERROR_ARGUMENT);
    BAD(job.strength = lull_float(0x7fc00000u), LULL_ERROR_ARGUMENT);
    BAD(job.color.data = NULL, LULL_ERROR_IMAGE);
    BAD(job.output.data = NULL, LULL_ERROR_IMAGE);
    BAD(job.color.channels = 0, LULL_ERROR_IMAGE);
    BAD(job.normal.channels = 4, LULL_ERROR_IMAGE);
    BAD(job.albedo.type = (lull_type)2, LULL_ERROR_IMAGE);
    BAD(job.albedo.data = NULL, LULL_OK);
    BAD(job.width = 0, LULL_OK);
    free_scene(&s);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(removes_noise);
    RUN(leaves_flat_images_as_they_are);
    RUN(keeps_clean_images);
    RUN(removes_a_firefly);
    RUN(strength_matters);
    RUN(survives_any_values);
    RUN(handles_every_size);
    RUN(tiles_may_come_in_any_order);
    RUN(a_row_of_tiles_reads_its_halo_only);
    RUN(gives_the_recorded_bits);
    RUN(checks_its_job);
    return check_report();
}
