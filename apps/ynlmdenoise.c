/* ynlmdenoise: the classical denoiser (non-local means with albedo and normals) behind the options
 * of Yocto/GL's program of that name. docs/apps.md. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <nlm.h>

#include "compare.h"
#include "layers.h"
#include "options.h"
#include "platform.h"
#include "report.h"

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 0
#endif
#if LULL_WITH_THREADS && !defined(_WIN32)
#define HAS_THREADS 1
#include <pthread.h>
#else
#define HAS_THREADS 0
#endif

#define MAX_THREADS 256

typedef struct settings {
    const char *files[3]; /* image_role */
    const char *output;
    float strength;
    float fixed[2]; /* sigma-s, sigma-r: taken, but not used */
    int radii[2];   /* Ds, ds: likewise */
    int threads, is_help;
} settings;

/* ---- Tiles ----------------------------------------------------------------------------------- */

typedef struct work {
    lull_nlm job;
    unsigned columns, tiles, next;
#if HAS_THREADS
    pthread_mutex_t lock;
#endif
} work;

/* Number of a tile that nobody has done yet, or `tiles`. */
static unsigned take_tile(work *w)
{
    unsigned tile;
#if HAS_THREADS
    pthread_mutex_lock(&w->lock);
#endif
    if (platform_interrupted())
        w->next = w->tiles;
    tile = w->next < w->tiles ? w->next++ : w->tiles;
#if HAS_THREADS
    pthread_mutex_unlock(&w->lock);
#endif
    return tile;
}

/* A thread's part: tiles until there are none. Returns NULL, or `user` without memory. */
static void *run_tiles(void *user)
{
    work *w = user;
    void *block = malloc(lull_nlm_bytes() + LULL_ALIGN);
    char *memory = block;
    if (!block)
        return user;
    memory += (LULL_ALIGN - (uintptr_t)block % LULL_ALIGN) % LULL_ALIGN;
    for (;;) {
        unsigned tile = take_tile(w);
        if (tile == w->tiles)
            break;
        lull_nlm_tile(&w->job, tile % w->columns, tile / w->columns, memory);
    }
    free(block);
    return NULL;
}

/* Runs all tiles; 0, or -1 without memory. The calling thread works, too, so that it goes on when
 * no other can be started. */
static int run_all(work *w, int threads)
{
    int failed;
#if HAS_THREADS
    pthread_t ids[MAX_THREADS];
    int started = 0;
    pthread_mutex_init(&w->lock, NULL);
    while (started + 1 < threads && started < MAX_THREADS &&
           !pthread_create(&ids[started], NULL, run_tiles, w))
        started++;
#endif
    (void)threads;
    failed = run_tiles(w) != NULL;
#if HAS_THREADS
    while (started > 0) {
        void *result = NULL;
        pthread_join(ids[--started], &result);
        failed |= result != NULL;
    }
    pthread_mutex_destroy(&w->lock);
#endif
    return failed ? -1 : 0;
}

/* ---- Images ---------------------------------------------------------------------------------- */

static exit_code load(image *images, const settings *s)
{
    image_beside beside[3]; /* [image_role], read along with the colour where no file is given */
    memset(beside, 0, sizeof beside);
    for (int i = 0; i < 3; i++) {
        beside[i].out = &images[i];
        beside[i].request.role = (image_role)i;
        beside[i].request.is_exact = !s->files[i];
        beside[i].request.threads = s->threads;
    }
    beside[IMAGE_COLOR].request.beside = &beside[s->files[IMAGE_ALBEDO] ? 2 : 1];
    beside[IMAGE_COLOR].request.beside_count = !s->files[IMAGE_ALBEDO] + !s->files[IMAGE_NORMAL];
    for (int i = 0; i < 3; i++) {
        image_beside *it = &beside[i];
        const char *path = s->files[i] ? s->files[i] : s->files[IMAGE_COLOR];
        int is_found = !s->files[i];
        if (is_found && !images[IMAGE_COLOR].is_layered)
            continue;
        if (!is_found)
            it->status = image_read(&images[i], path, &it->request, &it->error);
        if (is_found && it->status == IMAGE_ERROR_LAYER)
            continue;
        if (it->status)
            return report_error(EXIT_INPUT, "cannot read '%s': %s", path, it->error.text);
        if (is_found && image_is_light(&images[i], &images[IMAGE_COLOR])) {
            image_destroy(&images[i]);
            continue;
        }
        if (image_check_aligned(&images[i], layers_role_name((image_role)i), path,
                                &images[IMAGE_COLOR], s->files[IMAGE_COLOR]))
            return EXIT_INPUT;
        if (i == IMAGE_COLOR && image_check_finite(&images[i], path))
            return EXIT_INPUT;
        if (i == IMAGE_NORMAL && image_is_integer(&images[i], path))
            image_decode_signed(&images[i]);
        else if (i != IMAGE_NORMAL && !image_is_linear(&images[i], path))
            image_decode_srgb(&images[i]);
        if (images[i].is_layered)
            report_line("  %s=%s (%s ...)\n", layers_role_name((image_role)i), path,
                        images[i].names[0]);
    }
    return EXIT_OK;
}

static lull_image view(const image *img)
{
    lull_image v = {NULL, LULL_F32, 0, 0, 0};
    v.data = img->pixels;
    v.type = img->type == IMAGE_HALF ? LULL_F16 : LULL_F32;
    v.channels = img->channels;
    return v;
}

static exit_code denoise(image *images, image *output, const settings *s)
{
    work w;
    double start = platform_clock();
    lull_status status;
    int is_hdr = image_is_linear(&images[IMAGE_COLOR], s->files[IMAGE_COLOR]);
    memset(&w, 0, sizeof w);
    w.job.width = (unsigned)images[0].width;
    w.job.height = (unsigned)images[0].height;
    w.job.color = view(&images[IMAGE_COLOR]);
    w.job.albedo = view(&images[IMAGE_ALBEDO]);
    w.job.normal = view(&images[IMAGE_NORMAL]);
    w.job.output = view(output);
    w.job.scale = is_hdr ? lull_autoexposure(&w.job.color, w.job.width, w.job.height) : 1;
    if (!(w.job.scale > 0))
        w.job.scale = 1;
    w.job.strength = s->strength;
    w.columns = lull_nlm_columns(w.job.width);
    w.tiles = w.columns * lull_nlm_rows(w.job.height);
    status = lull_nlm_check(&w.job);
    if (!status && run_all(&w, s->threads))
        status = LULL_ERROR_MEMORY;
    if (status)
        return report_error(EXIT_DENOISE, "%s: %s", s->files[IMAGE_COLOR],
                            lull_status_text(status));
    if (platform_interrupted())
        return report_error(EXIT_INTERRUPTED, "interrupted");
    report_line("  msec=%g, hash=%08x\n", 1000 * (platform_clock() - start),
                (unsigned)image_hash(output));
    return EXIT_OK;
}

static exit_code save(const image *source, image *output, const settings *s)
{
    image_target target = {source->is_layered ? s->files[IMAGE_COLOR] : NULL, s->threads, NULL,
                           0};
    image whole;
    image_error error;
    image_convert_alpha(output, source->alpha,
                        source->is_layered ? IMAGE_MULTIPLIED : IMAGE_STRAIGHT,
                        image_path_alpha(s->output));
    if (!image_path_is_linear(s->output))
        image_encode_srgb(output);
    whole = *output; /* borrows pixels and alpha */
    whole.alpha = source->alpha;
    whole.bits = source->bits;
    whole.is_layered = source->is_layered;
    whole.part = source->part;
    memcpy(whole.names, source->names, sizeof whole.names);
    if (!image_write(s->output, &whole, &target, &error))
        return EXIT_OK;
    if (platform_interrupted())
        return report_error(EXIT_INTERRUPTED, "interrupted");
    return report_error(EXIT_OUTPUT, "cannot write '%s': %s", s->output, error.text);
}

static exit_code run(const settings *s)
{
    image images[3], output;
    image_error error;
    exit_code code;
    memset(images, 0, sizeof images);
    memset(&output, 0, sizeof output);
    platform_catch_interrupt();
    report_line("Loading input\n");
    code = load(images, s);
    if (!code && image_create(&output, images[0].width, images[0].height, images[0].channels,
                              images[0].type, &error))
        code = report_error(EXIT_DENOISE, "%s", error.text);
    if (!code) {
        report_line("Resolution: %zux%zu\nDenoising\n", output.width, output.height);
        code = denoise(images, &output, s);
    }
    if (!code) {
        report_line("Saving output\n");
        code = save(&images[IMAGE_COLOR], &output, s);
    }
    for (int i = 0; i < 3; i++)
        image_destroy(&images[i]);
    image_destroy(&output);
    return code;
}

/* ---- Options --------------------------------------------------------------------------------- */

#define AT(field) offsetof(settings, field)
static const option table[] = {
    TEXT("i input-image", files[0], "FILE", "noisy image; HDR if it is exr, pfm, phm or hdr"),
    TEXT("o output-image", output, "FILE", "where to write"),
    TEXT("a albedo", files[1], "FILE", "albedo"),
    TEXT("n normal", files[2], "FILE", "normals in [-1, 1]"),
    FLOAT("k strength", strength, "K", "strength of the filter (1)"),
    INT("t numThreads", threads, 1, MAX_THREADS, "N", "threads (all)"),
    INT("Ds", radii[0], 0, INT_MAX, "N", "accepted, not used: windows have 17x17 pixels"),
    INT("ds", radii[1], 0, INT_MAX, "N", "accepted, not used: patches have 5x5 pixels"),
    FLOAT("sigma-s", fixed[0], "X",
          "accepted, not used: distances are weighed by the noise that is found"),
    FLOAT("sigma-r", fixed[1], "X", "likewise"),
    FLAG("h help", is_help, 1, "this text"),
};
#define OPTIONS (sizeof table / sizeof table[0])

int main(int argc, char **argv)
{
    settings s;
    image_error error;
    memset(&s, 0, sizeof s);
    s.strength = 1;
    s.threads = platform_processors();
    if (options_parse(table, OPTIONS, &s, NULL, argc, argv))
        return EXIT_USAGE;
    if (s.is_help || argc <= 1) {
        printf("ynlmdenoise: removes noise from path-traced images by non-local means\n"
               "usage: ynlmdenoise -i IMAGE -o OUTPUT [-a ALBEDO] [-n NORMAL] [-k STRENGTH]\n\n");
        options_print(table, OPTIONS);
        return EXIT_USAGE;
    }
    if (!s.files[IMAGE_COLOR] || !s.output)
        return report_error(EXIT_USAGE, "--input-image and --output-image are needed");
    if (!(s.strength > 0 && s.strength <= 1000)) /* as lull_nlm_check */
        return report_error(EXIT_USAGE, "the strength must be above 0, and at most 1000");
    if (image_check_writable(s.output, &error))
        return report_error(EXIT_OUTPUT, "cannot write '%s': %s", s.output, error.text);
    return run(&s);
}
