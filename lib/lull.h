/* lull: denoising of Monte Carlo renders with small neural networks. Native API.
 *
 * The core allocates nothing, starts no threads, reads no files, prints nothing and keeps no global
 * state. The caller gives it memory of a size asked for beforehand. Three steps:
 *
 *     model   a weights file (TZA) unpacked and packed for the CPU; read-only afterwards, so it is
 *             shared freely
 *     plan    the schedule and working memory for one frame size and one model; one run at a time
 *     run     denoise a frame, or stream it by rows
 *
 *     size_t n = lull_model_size(tza, tza_bytes, LULL_PORTS_ALL);
 *     lull_model *model;
 *     status = lull_model_init(&model, memalign(64, n), n, tza, tza_bytes, LULL_PORTS_ALL);
 *     lull_frame frame = lull_frame_default(width, height, LULL_HDR, LULL_HAS_COLOR);
 *     n = lull_plan_size(&frame, model);
 *     lull_plan *plan;
 *     status = lull_plan_init(&plan, memalign(64, n), n, &frame, model);
 *     status = lull_run(plan, &images, NULL);
 *
 * All memory given to the library must be aligned to LULL_ALIGN bytes and stays the caller's: it is
 * released by freeing it, there is no destroy. Every function may be called from any thread; one
 * plan must not be used by two calls at the same time. Threads must round to nearest and trap no
 * floating-point exceptions, as C does by default. Output bytes do not depend on the number of
 * threads, on strips or on the row step; for integer networks they do not depend on the CPU either.
 */
#ifndef LULL_H
#define LULL_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LULL_VERSION_MAJOR 0
#define LULL_VERSION_MINOR 1
#define LULL_VERSION_PATCH 0

/* Alignment in bytes of every memory block given to the library. */
#define LULL_ALIGN 64u

/* Largest width and height of a frame in pixels. */
#define LULL_MAX_SIZE 65536u

/* ---- Errors ---------------------------------------------------------------------------------- */

typedef enum lull_status {
    LULL_OK = 0,
    LULL_CANCELLED,         /* the progress function asked to stop */
    LULL_ERROR_ARGUMENT,    /* a NULL, misaligned or out-of-range argument */
    LULL_ERROR_MEMORY,      /* the memory given is too small, or the frame does not fit max_bytes */
    LULL_ERROR_WEIGHTS,     /* the TZA file is truncated or malformed */
    LULL_ERROR_VERSION,     /* the TZA file has an unknown major version */
    LULL_ERROR_NETWORK,     /* tensors missing, of wrong shape or type, or of no known network */
    LULL_ERROR_FEATURES,    /* the model was trained for other inputs than the frame has */
    LULL_ERROR_IMAGE,       /* an image is missing, its format does not suit the frame, or the
                             * output overlaps an input otherwise than in_place allows */
    LULL_ERROR_UNSUPPORTED, /* valid, but not available here (e.g. rows of a plan with strips) */
    LULL_STATUS_COUNT
} lull_status;

/* Static English text of a status, never NULL, for any value. */
const char *lull_status_text(lull_status status);

/* ---- Ports ----------------------------------------------------------------------------------- */

/* Sets of ports (implementations for instruction sets) are bit masks, one bit per row of ports.def.
 */
#define LULL_PORTS_SCALAR 1u
#define LULL_PORTS_ALL 0xffffffffu

/* Ports that this build contains and this CPU can run; always includes LULL_PORTS_SCALAR. */
uint32_t lull_ports_available(void);

/* Asks the operating system for registers that it keeps back until a process asks: the tiles of AMX
 * on Linux. The ports that need them are available afterwards, if it agrees. For the whole process
 * and for good; the core never does it by itself. */
void lull_ports_request(void);

/* Name ("scalar", "avx2", ...) of bit number `index`, or NULL past the last one. */
const char *lull_port_name(unsigned index);

/* Mask that allows every port up to and including the one called `name` in ports.def's order of
 * strength; 0 if there is none of that name. `name` need not be NUL-terminated. */
uint32_t lull_ports_up_to(const char *name, size_t length);

/* Name of kernel number `index` ("conv_int", ...), or NULL past the last one; and the bit number of
 * the port that fills it where `ports` are allowed. */
const char *lull_kernel_name(unsigned index);
unsigned lull_kernel_port(unsigned index, uint32_t ports);

/* ---- Models ---------------------------------------------------------------------------------- */

typedef struct lull_model lull_model; /* lives at the start of the caller's memory */

typedef struct lull_model_info {
    const char *network; /* topology, a NET name of nets.def; static */
    unsigned inputs;     /* input channels of the network: 3 per image feature of direct ones; 12 of
                          * kernel prediction, which takes any features */
    unsigned is_integer; /* 1: int8 weights, integer arithmetic; 0: fp16 weights, fp32 arithmetic */
    unsigned alignment;  /* frame sizes are padded to multiples of this inside (16); parts of a
                          * frame that a host denoises by themselves begin at multiples of it */
    unsigned overlap;    /* pixels of context beside a strip that it depends on (96 to 352) */
    uint64_t parameters; /* weights and biases */
    uint64_t macs_per_pixel; /* multiply-adds per pixel of the network as written, unfolded */
    unsigned is_alone;   /* 1: for frames of an albedo or of normals alone; 0: for all others */
} lull_model_info;

/* Bytes that lull_model_init needs for these weights, or 0 if the weights are not valid (then
 * lull_model_init says why). `ports`: ports that may be used; the packing depends on them. */
size_t lull_model_size(const void *tza, size_t tza_bytes, uint32_t ports);

/* Checks the weights, and packs them into `memory` for the strongest allowed port. `tza` is not
 * needed afterwards. On success *model points into `memory`. Errors: ARGUMENT, MEMORY, WEIGHTS,
 * VERSION, NETWORK. */
lull_status lull_model_init(lull_model **model, void *memory, size_t memory_bytes, const void *tza,
                            size_t tza_bytes, uint32_t ports);

void lull_model_get_info(const lull_model *model, lull_model_info *info);

/* ---- Frames and plans ------------------------------------------------------------------------ */

/* What the main image holds. It fixes transfer function and clamping (docs/arithmetic.md,
 * Pixels). */
typedef enum lull_content {
    LULL_HDR,          /* linear radiance, [0, inf) */
    LULL_LDR,          /* linear, [0, 1] */
    LULL_SRGB,         /* sRGB-encoded, [0, 1] */
    LULL_LIGHTMAP_HDR, /* linear radiance of a light map */
    LULL_LIGHTMAP_DIR, /* directional light map, [-1, 1] */
    LULL_CONTENT_COUNT
} lull_content;

/* Images that a frame has. The main image is the colour; without one the albedo; without both the
 * normals. The others are auxiliary. The content of a frame without a colour is LULL_LDR, or, if it
 * has an albedo, LULL_SRGB: lull_plan_init refuses others (ARGUMENT). */
#define LULL_HAS_COLOR 1u
#define LULL_HAS_ALBEDO 2u
#define LULL_HAS_NORMAL 4u

typedef struct lull_frame {
    unsigned width, height; /* pixels; 0 is legal and makes an empty frame */
    lull_content content;
    unsigned features; /* LULL_HAS_* */
    unsigned threads;  /* workers that run() may use at once; 0 is 1 */
    unsigned in_place; /* 1: the output may be in the place of input images: with the same first
                        * pixel and the same strides. Kernel-prediction models then keep input rows
                        * that else they read a second time. No other overlap is allowed; pixels or
                        * rows between those of an input do not overlap it */
    unsigned streamed; /* 1: lull_rows will be used. Kernel-prediction models then keep input rows,
                        * too; others do not mind */
    size_t max_bytes;  /* plan memory to keep within; 0: no limit */
    unsigned row_step; /* rows computed together; 0: chosen. Larger is faster and needs more memory.
                        * More than the frame has are all of them, but 32768 at most */
    unsigned strip_width; /* columns computed together; 0: chosen (all if max_bytes permits) */
    unsigned trained_for; /* 0: direct networks see the content's own transfer function; else that
                           * of the content trained_for - 1, for weights made for other content */
    unsigned clean_aux;   /* 1: albedo and normals have no noise */
} lull_frame;

/* A frame with everything else zero. */
lull_frame lull_frame_default(unsigned width, unsigned height, lull_content content,
                              unsigned features);

typedef struct lull_plan lull_plan; /* lives at the start of the caller's memory; holds offsets
                                     * only, so it may be moved or copied between runs (to
                                     * LULL_ALIGN alignment) */

typedef struct lull_plan_info {
    size_t bytes; /* all memory of the plan, the only memory that run() writes besides images */
    unsigned row_step, strip_width, strips;
    unsigned delay_rows; /* output row y is stored after input row min(y + delay_rows, height-1) */
} lull_plan_info;

/* Bytes that lull_plan_init needs, or 0 on error (then lull_plan_init says which). */
size_t lull_plan_size(const lull_frame *frame, const lull_model *model);

/* Bytes of the smallest plan for this frame, most often the narrowest and slowest, whatever
 * row_step and strip_width it asks for: the floor of max_bytes where these are 0. 0 on error. */
size_t lull_plan_minimum(const lull_frame *frame, const lull_model *model);

/* Makes a plan in `memory`. `model` must outlive it.
 * Errors: ARGUMENT; MEMORY (also if max_bytes is below the minimum); FEATURES if, of a frame that
 * is not empty, the inputs of a direct network are not 3 per feature, or a network of kernel
 * prediction is for an albedo or normals alone, and the frame has more or a colour. */
lull_status lull_plan_init(lull_plan **plan, void *memory, size_t memory_bytes,
                           const lull_frame *frame, const lull_model *model);

void lull_plan_get_info(const lull_plan *plan, lull_plan_info *info);

/* ---- Running --------------------------------------------------------------------------------- */

typedef enum lull_type { LULL_F32 = 0, LULL_F16 = 1 } lull_type;

/* A view of the caller's pixels. Strides are in bytes and need not be multiples of the element
 * size; pixels must not overlap. They may be negative, and those of pixels longer than those of
 * rows, so that a picture is seen turned or mirrored where it lies. Bytes between pixels and rows
 * are never written. One channel stands for grey (x,x,x), two for (x,y,y); a grey output is the
 * mean of the three that come of it. */
typedef struct lull_image {
    void *data; /* first pixel, or NULL: no such image */
    lull_type type;
    unsigned channels;      /* 1 to 3 */
    ptrdiff_t pixel_stride; /* 0: tight */
    ptrdiff_t row_stride;   /* 0: width * pixel stride */
} lull_image;

typedef struct lull_images {
    lull_image color, albedo, normal; /* inputs, linear (but see LULL_SRGB); normals in [-1,1] */
    lull_image output;                /* as many channels as the main image */
    float input_scale; /* factor that brings the main image to the range the network knows; NaN:
                        * auto-exposure for LULL_HDR and LULL_LIGHTMAP_HDR, else 1. The output is
                        * divided by it again. */
    float calm; /* part of the main image, by the albedo if there is one, in [0, 1], that shows next
                 * to no noise; NaN: measured. Where it is large, kernel-prediction models leave
                 * some of the input in the output even where there seems to be noise: it is texture
                 * then. -1: none of the input. NaN is 0 for albedos and normals, -1 for light maps.
                 * Direct models ignore it. */
    float ragged; /* how much kernel-prediction models average along edges, in [0, 1]: 1 where each
                   * pixel saw one place, for edges are ragged then; NaN: measured in noise and
                   * albedo, 0 without an albedo. Direct ones ignore it. */
} lull_images;

/* What the host lends to a run; every member may be NULL. */
typedef struct lull_host {
    void *user;
    /* Must call body(context, index, worker) exactly once for each index in [0, count), in any
     * order and from any thread, with worker < threads of the frame and no two calls at a time with
     * the same worker, and return when all are done. NULL: the calling thread does it. */
    void (*parallel_for)(void *user, unsigned count,
                         void (*body)(void *context, unsigned index, unsigned worker),
                         void *context);
    /* Told the fraction done, in [0, 1], never decreasing, before every layer's turn in every row
     * step, by the thread that called run: often, so do little. Returns 0 to cancel. */
    int (*progress)(void *user, double fraction);
} lull_host;

/* The scale that lull_run uses for a NaN input_scale: 0.18 over the geometric mean luminance of the
 * image's 16x16 bins (Open Image Denoise's auto-exposure); 1 for a black image, 0 if it overflows.
 */
float lull_autoexposure(const lull_image *color, unsigned width, unsigned height);

/* Replaces what of input_scale, calm and ragged is NaN by those that lull_run would use for these
 * images, which must be whole. For hosts that denoise parts of a frame, or one frame several times:
 * all of them then get what the whole would have got. Asks for no progress, and leaves a stream
 * that the plan is in the middle of as it is. Errors: ARGUMENT, IMAGE. */
lull_status lull_measure(lull_images *images, lull_plan *plan, const lull_host *host);

/* Denoises a frame. Sanitises NaN, infinities and out-of-range values as the content demands.
 * Errors: ARGUMENT, IMAGE, CANCELLED (the output is then undefined, but only inside its pixels). */
lull_status lull_run(lull_plan *plan, const lull_images *images, const lull_host *host);

/* Streaming. lull_rows_begin resets the plan (which must have one strip, and be made for streaming
 * if the model predicts kernels: else UNSUPPORTED) and sets what is known of the whole frame, as in
 * lull_images (NaN: scale 1, calm and ragged 0). Each lull_rows call then takes the next `rows`
 * rows of the inputs, at the start of the images given, and stores at the start of images->output
 * the output rows that became ready: *ready of them, at most rows + delay_rows. The last input row
 * releases all the remaining output rows. Output rows must not overlap input rows of the same call,
 * unless both are in one picture, where output row y is in the place of input row y (not checked).
 */
lull_status lull_rows_begin(lull_plan *plan, float input_scale, float calm,
                            float ragged);
lull_status lull_rows(lull_plan *plan, const lull_images *images, unsigned rows, unsigned *ready,
                      const lull_host *host);

/* ---- Light maps ------------------------------------------------------------------------------ */

/* Gives the texels of a light map that belong to no surface, whose normal is 0 in all channels, the
 * light of the nearest that do: light does not end where a chart does, and denoisers take what is
 * black there for dark. Keep the normals as they are; with LULL_HAS_NORMAL they tell charts apart.
 *
 * output: as many channels as color, and either color itself or no part of any input. memory:
 * lull_fill_size(width, height) bytes, 4 for each texel (0: no such image). The result does not
 * depend on the CPU. Errors: ARGUMENT, IMAGE, MEMORY. */
size_t lull_fill_size(unsigned width, unsigned height);
lull_status lull_fill(const lull_image *output, const lull_image *color, const lull_image *normal,
                      unsigned width, unsigned height, void *memory, size_t memory_bytes);

#ifdef __cplusplus
}
#endif
#endif
