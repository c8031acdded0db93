/* OpenCL devices: an executor of whole frames (docs/design.md, seam 3) for integer networks.
 * Kernels: ports/opencl. The library is loaded when a device is asked for, and stays loaded. */
#ifndef LULL_OIDN_OPENCL_H
#define LULL_OIDN_OPENCL_H

#include "../../lib/exec.h"
#include "../../ports/opencl/args.h"
#include "../internal.h"
#include "api.h"

/* ---- Devices (device.c) ---------------------------------------------------------------------- */

/* The kernels, which are functions of ports/opencl. */
#define LULL_CL_KERNELS(KERNEL)                                                                    \
    KERNEL(conv) KERNEL(encode) KERNEL(spread) KERNEL(spread_normal) KERNEL(guide) KERNEL(smooth)  \
    KERNEL(grain_sums) KERNEL(grain) KERNEL(take_grain) KERNEL(face) KERNEL(demodulate)            \
    KERNEL(shrink) KERNEL(filter) KERNEL(blend) KERNEL(bilateral) KERNEL(fit_sums) KERNEL(fit)     \
    KERNEL(regress) KERNEL(residual) KERNEL(gains) KERNEL(correct) KERNEL(shares)                  \
    KERNEL(modulate)
enum {
#define LULL_CL_NUMBER(name) LULL_CL_##name,
    LULL_CL_KERNELS(LULL_CL_NUMBER)
#undef LULL_CL_NUMBER
    LULL_CL_KERNEL_COUNT
};

typedef struct lull_opencl {
    lull_engine engine; /* first: each is the other's address */
    lull_cl_api api;
    cl_device device;
    cl_context context;
    cl_queue queue;
    cl_program program;
    cl_kernel kernel[LULL_CL_KERNEL_COUNT]; /* their arguments belong to the queue's thread */
    uint64_t most_bytes;                    /* of one block of memory */
    long process;                           /* that opened it: it does not survive a fork */
    char name[256];
} lull_opencl;

/* Error of an OpenCL function; returns whether there is none. */
bool lull_cl_check(lull_fault *fault, int32_t error, const char *what);

/* False and a fault in a forked child of the process that opened the device. */
bool lull_cl_check_process(const lull_opencl *cl, lull_fault *fault);

/* False and a fault if the device, whose program is built, gives other bits than it should
 * (probe.c). */
bool lull_cl_probe_device(lull_opencl *cl, lull_fault *fault);

/* ---- Schedules (schedule.c) ----------------------------------------------------------- */

/* Tensors beside the graph's: images as the host loads and stores them, and what one kernel leaves
 * for others. LULL_TENSOR_RADIANCE is the main image. */
enum {
    LULL_CL_IMAGE_ALBEDO = LULL_TENSORS,
    LULL_CL_IMAGE_NORMAL,
    LULL_CL_IMAGE_RESULT,
    LULL_CL_NOISE_CODES,
    LULL_CL_SHARES,
    LULL_CL_TENSORS
};

/* One kernel's turn. */
typedef struct lull_cl_step {
    unsigned kernel, args_bytes;
    uint8_t out, source[LULL_CL_SOURCES]; /* tensors, LULL_TENSOR_NONE where there are fewer */
    union {
        lull_cl_conv conv;
        lull_cl_filter filter;
    } args;
    size_t global[3], local[3];
} lull_cl_step;

/* Layers, what is made of images, shares, result. */
#define LULL_CL_STEPS (LULL_MAX_LAYERS + 6)

/* Where a convolution's weights are in the model's memory; its shift. */
typedef struct lull_cl_weights {
    uint32_t shift;
    uint32_t bias, multiplier, taps[LULL_CL_CONV_SOURCES];
} lull_cl_weights;

/* All kernels of a frame, or of a tile as if it were one, and the working memory: tensors share it
 * where they are not needed at the same time. */
typedef struct lull_cl_schedule {
    const lull_graph *graph;
    const lull_cl_weights *weights;  /* one for each layer */
    int32_t width, height;           /* of the tile, without padding */
    uint32_t flags;                  /* LULL_CL_ALBEDO, ... */
    float calm, ragged;                /* of lull_images */
    uint64_t bytes;                  /* of working memory */
    unsigned steps;
    lull_cl_step step[LULL_CL_STEPS];
    lull_cl_tensor tensor[LULL_CL_TENSORS];
    struct {
        uint64_t bytes, before; /* of the whole tensor, and of what is before pixel (0, 0) */
        uint64_t begin;         /* where it lies */
    } extent[LULL_CL_TENSORS];
} lull_cl_schedule;

/* Fills in what depends on the size. graph, weights and flags are set. */
void lull_cl_schedule_make(lull_cl_schedule *schedule, unsigned width, unsigned height);

/* The same for a tile that is no wider and no higher than the one that the schedule was made for,
 * in its memory: tensors begin where they did. Placed anew, those of a smaller tile may take more
 * memory, as they are put into the first gap where they fit. */
void lull_cl_schedule_resize(lull_cl_schedule *schedule, unsigned width, unsigned height);

/* The model for the kernels: its bytes, with the places in weights[], and the bytes themselves. */
size_t lull_cl_layout(lull_cl_weights *weights, const lull_model *model);
void lull_cl_pack(uint8_t *out, const lull_cl_weights *weights, const lull_model *model);

/* ---- Plans (plan.c) ------------------------------------------------------------------- */

/* The functions of lull_engine. */
uint64_t lull_cl_plan_minimum(lull_engine *engine, const lull_frame *frame,
                              const lull_model *model, lull_fault *fault);
lull_engine_plan *lull_cl_plan_new(lull_engine *engine, const lull_frame *frame,
                                   const lull_model *model, lull_fault *fault);
void lull_cl_plan_free(lull_engine_plan *plan);
void lull_cl_plan_get_info(const lull_engine_plan *plan, lull_plan_info *info);
lull_status lull_cl_run(lull_engine_plan *plan, const lull_images *images, const lull_host *host,
                        lull_fault *fault);

#endif
