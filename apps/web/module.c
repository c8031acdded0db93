/* lull.wasm: the core as a WebAssembly module of its own, without imports but `progress`. Its
 * memory holds the program, then the model, then what belongs to one frame; lull.mjs, beside it,
 * is the interface for JavaScript and the only caller of what is exported here.
 *
 * lull-threads.wasm is the same with LULL_WEB_THREADS and pool.c: its memory is imported, and
 * shared with the instances of its workers. */
#include <math.h>

#include "lull.h"
#include "pool.h"

/* Returns 0 to cancel. */
__attribute__((import_module("lull"), import_name("progress"))) int progress(double fraction);

#if LULL_WEB_THREADS
#define THREADS pool_threads()
#define PARALLEL_FOR pool_for
#define FAILED pool_failed()
#else
#define THREADS 1
#define PARALLEL_FOR NULL
#define FAILED 0
#endif

#define PAGE 65536u

extern unsigned char __heap_base; /* where the linker ends */
static uintptr_t top;             /* all below is in use */
static uintptr_t frame_base;      /* ... by the program and the model */
static lull_model *model;
static lull_images images;
static lull_frame frame;

/* `bytes` more of memory, aligned to LULL_ALIGN, or 0 if there is no more. */
EXPORT(uintptr_t, allocate, (size_t bytes))
{
    uintptr_t at = (top ? top : (uintptr_t)&__heap_base) + (LULL_ALIGN - 1);
    size_t have = __builtin_wasm_memory_size(0);
    uint64_t pages;
    at -= at % LULL_ALIGN;
    pages = ((uint64_t)at + bytes + PAGE - 1) / PAGE;
    if (pages > PAGE || (pages > have && __builtin_wasm_memory_grow(0, (size_t)pages - have) ==
                                             (size_t)-1))
        return 0;
    top = at + bytes;
    return at;
}

/* Takes the weights, a TZA file that was put at the end of the memory in use by `allocate`: packs
 * them behind it. Before anything else, and once. */
EXPORT(lull_status, load, (const void *tza, size_t bytes))
{
    size_t size = lull_model_size(tza, bytes, LULL_PORTS_ALL);
    void *memory = (void *)(size ? allocate(size) : 0);
    lull_status status;
    if (size && !memory)
        return LULL_ERROR_MEMORY;
    status = lull_model_init(&model, memory, size, tza, bytes, LULL_PORTS_ALL);
    frame_base = top;
    return status;
}

/* Begins a frame: what belonged to the one before is no longer in use. The images follow: put them
 * where `allocate` says, and name them by `set_image`. */
EXPORT(void, begin, (unsigned width, unsigned height, unsigned content))
{
    top = frame_base;
    frame = lull_frame_default(width, height, (lull_content)content, 0);
    frame.in_place = 1;
    frame.threads = THREADS;
    images = (lull_images){.calm = NAN, .ragged = NAN};
}

/* Image `feature` (LULL_HAS_*), 3 floats a pixel. The main image becomes the output. */
EXPORT(void, set_image, (unsigned feature, float *data))
{
    lull_image image = {data, LULL_F32, 3, 0, 0};
    frame.features |= feature;
    if (feature == LULL_HAS_COLOR)
        images.color = image;
    else if (feature == LULL_HAS_ALBEDO)
        images.albedo = image;
    else
        images.normal = image;
}

/* What belongs to no surface gets the light of what does, if normals tell. */
static lull_status fill_charts(void)
{
    const size_t bytes = lull_fill_size(frame.width, frame.height), begin = top;
    const int is_map = frame.content == LULL_LIGHTMAP_HDR || frame.content == LULL_LIGHTMAP_DIR;
    lull_status status = LULL_OK;
    if (is_map && images.color.data && images.normal.data && bytes) {
        void *memory = (void *)allocate(bytes);
        status = memory ? lull_fill(&images.color, &images.color, &images.normal, frame.width,
                                    frame.height, memory, bytes)
                        : LULL_ERROR_MEMORY;
        top = begin;
    }
    return status;
}

static int tell(void *user, double fraction)
{
    (void)user;
    return !FAILED && progress(fraction);
}

/* Denoises the frame. `input_scale` as in lull_images. */
EXPORT(lull_status, run, (float input_scale))
{
    const lull_host host = {NULL, PARALLEL_FOR, tell};
    size_t size = lull_plan_size(&frame, model);
    void *memory = (void *)(size ? allocate(size) : 0);
    lull_plan *plan;
    lull_status status;
    if (size && !memory)
        return LULL_ERROR_MEMORY;
    status = lull_plan_init(&plan, memory, size, &frame, model);
    if (status != LULL_OK)
        return status;
    images.output = images.color.data ? images.color
                    : images.albedo.data ? images.albedo : images.normal;
    images.input_scale = input_scale;
    status = fill_charts();
    if (status != LULL_OK)
        return status;
    return lull_run(plan, &images, &host);
}

EXPORT(const char *, status_text, (lull_status status)) { return lull_status_text(status); }
