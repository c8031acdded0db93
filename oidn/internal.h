/* Inside of the facade: objects, errors, the call frame that every API function shares.
 *
 * Locking: one mutex per device, taken by lull_call_begin and released by lull_call_end; everything
 * reached from a device, filter or buffer is guarded by it unless said otherwise. It is not held
 * while a blocking call waits for the queue, so progress functions may use the API. Lifetime:
 * objects are counted; filters, buffers and semaphores hold their device, image parameters and
 * queued work hold their buffers, queued work holds its filter. Handles are counted, too: who lets
 * go of the last one of an object waits for all queued work, for it may then free what that uses,
 * or unload the library. */
#ifndef LULL_OIDN_INTERNAL_H
#define LULL_OIDN_INTERNAL_H

#if !defined(OpenImageDenoise_EXPORTS)
#define OpenImageDenoise_EXPORTS
#endif
#define OIDN_LEGACY_1X
#include "include/OpenImageDenoise/lull_quality.h"
#include "include/OpenImageDenoise/oidn.h"
#include "include/OpenImageDenoise/lull_device.h"

#include "../lib/lull.h"
#include "os.h"
#include "threads.h"

#include <stdbool.h>

/* Functions of the interface that oidn.h declares for C++ only. */
OIDN_API bool oidnIsSYCLDeviceSupported(const void *device);
OIDN_API OIDNDevice oidnNewSYCLDevice(const void *queues, int numQueues);
OIDN_API void oidnExecuteSYCLFilterAsync(OIDNFilter filter, const void *depEvents, int numDepEvents,
                                         void *doneEvent);

/* ---- Errors (error.c) ------------------------------------------------------------------------ */

#define LULL_FAULT_TEXT 256

/* An error on its way to the caller. */
typedef struct lull_fault {
    OIDNError code; /* OIDN_ERROR_NONE: no error */
    char text[LULL_FAULT_TEXT];
} lull_fault;

/* Records an error unless there is one already; returns false, so that callers can `return` it. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
bool lull_fail(lull_fault *fault, OIDNError code, const char *format, ...);

/* First unread error of one thread on one device. */
typedef struct lull_error_slot {
    size_t thread;
    lull_fault fault;
    struct lull_error_slot *next;
} lull_error_slot;

/* Errors of a device by thread, most recent thread first. Has its own mutex, so that reading an
 * error never waits for a running call. */
typedef struct lull_errors {
    lull_mutex mutex;
    lull_error_slot *slots;
    unsigned count;
    lull_fault spare; /* shared by all threads when there is no memory for a slot */
    OIDNErrorFunction function;
    void *user;
} lull_errors;

void lull_errors_init(lull_errors *errors);
void lull_errors_free(lull_errors *errors);

/* Stores a fault for this thread and returns the error function and its user, to be called when
 * nothing is left to do: it may throw an exception. `errors` NULL: no device, and no function. */
OIDNErrorFunction lull_errors_report(lull_errors *errors, const lull_fault *fault, void **user);

/* Returns and clears this thread's error; see oidnGetDeviceError. */
OIDNError lull_errors_take(lull_errors *errors, const char **text);

/* Error of a core status. `what` says what was attempted. */
bool lull_fail_status(lull_fault *fault, lull_status status, const char *what);

/* Error of a plan that the core could not make of these; true if it could. */
bool lull_check_plan(lull_fault *fault, lull_status status, const lull_frame *frame,
                     const lull_model *model);

/* ---- Parameters (params.c) ------------------------------------------------------------------- */

enum lull_owner { LULL_DEVICE = 1, LULL_RT = 2, LULL_LIGHTMAP = 4, LULL_FILTERS = 6 };
enum lull_kind { LULL_BOOL, LULL_INT, LULL_FLOAT, LULL_IMAGE, LULL_DATA };
enum lull_access { LULL_SET, LULL_GET, LULL_QUALITY };

/* lull_value_<slot> for every slot of params.def. */
enum lull_slot {
#define PARAM(owner, kind, name, slot, initial, access) lull_value_##slot,
#include "params.def"
    LULL_SLOTS
};

typedef union lull_value {
    int i;
    float f;
} lull_value;

typedef struct lull_param {
    enum lull_owner owner;
    enum lull_kind kind;
    const char *name;
    enum lull_slot slot;
    enum lull_access access;
} lull_param;

/* The parameter of that name, or NULL. */
const lull_param *lull_param_find(enum lull_owner owner, const char *name);

/* Sets all values to their initial ones. */
void lull_params_reset(lull_value values[LULL_SLOTS]);

/* Set and get parameters by name: of BOOL or INT kind, or of FLOAT kind. Setting an unknown,
 * read-only or mistyped one only gives a warning; getting it, or setting an impossible value, is
 * INVALID_ARGUMENT. */
bool lull_param_set_int(lull_value values[], enum lull_owner owner, const char *name, int value,
                        int verbose, lull_fault *fault);
void lull_param_set_float(lull_value values[], enum lull_owner owner, const char *name, float value,
                          int verbose);
bool lull_param_get(const lull_value values[], enum lull_owner owner, const char *name,
                    bool is_float, lull_value *value, lull_fault *fault);

/* Integer value of an environment variable, 0 for words ("off") and nothing, as in OIDN, or
 * `otherwise` where it is not set. */
int lull_env_int(const char *name, int otherwise);
int lull_env_is_set(const char *name);

/* Prints a line to stderr if `verbose` >= 1. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
void lull_warn(int verbose, const char *format, ...);

/* ---- Queue of asynchronous work (queue.c) ---------------------------------------------------- */

typedef struct lull_job {
    void (*run)(const struct lull_job *job, lull_fault *fault);
    OIDNFilter filter;     /* executed; held until done */
    OIDNBuffer buffers[4]; /* used; held until done */
    lull_images images;    /* what to denoise */
    OIDNQuality quality;   /* the filter's; high for `auto`, which may take another one */
    OIDNProgressMonitorFunction progress;
    void *progress_user;
    void *target; /* a copy of `bytes` */
    const void *source;
    size_t bytes;
} lull_job;

/* Jobs that may wait at once; submitting more blocks until one is done. */
#define LULL_QUEUE_SIZE 64

/* A thread that runs jobs in the order of submission. Jobs are numbered from 1 on. Has its own
 * mutex; the thread never takes the device's lock. Without threads jobs run inside
 * lull_queue_submit. */
typedef struct lull_queue {
    lull_mutex mutex;
    lull_cond submitted, finished;
    lull_thread thread;
    bool started, stop;
    bool running;        /* a job is */
    bool abandoned;      /* the device died inside a job: the thread frees it */
    long process;        /* that started the thread */
    uint64_t head, tail; /* jobs finished, jobs submitted */
    lull_fault fault;    /* first error of asynchronous work, for the next synchronisation */
    lull_job jobs[LULL_QUEUE_SIZE];
} lull_queue;

/* Starts the thread of the device's queue. */
bool lull_queue_start(OIDNDevice device);

/* Makes room for a job, with the device unlocked meanwhile, so before looking at any state; in a
 * forked child also starts the threads anew. False inside a progress function if there is
 * no room. */
bool lull_queue_reserve(OIDNDevice device, lull_fault *fault);

/* Appends a job, taking over its references; returns its number. */
uint64_t lull_queue_submit(OIDNDevice device, const lull_job *job);

/* Whether job `number` is done. */
bool lull_queue_is_done(OIDNDevice device, uint64_t number);

/* Waits for job `number` with the device unlocked. False inside a progress function, unless the job
 * is done already. */
bool lull_queue_wait(OIDNDevice device, uint64_t number, lull_fault *fault);

/* Moves the error of asynchronous work, if there is one, to `fault`; then false. */
bool lull_queue_take_fault(OIDNDevice device, lull_fault *fault);

/* Waits for all jobs and takes their error. */
bool lull_queue_sync(OIDNDevice device, lull_fault *fault);

/* Waits for all jobs before an object is let go of. A progress function goes on at once: its work
 * holds what it needs. */
void lull_queue_finish(OIDNDevice device);

/* Whether the caller is inside a job, i.e. in a progress function. */
bool lull_queue_is_self(const lull_queue *queue);

/* Stops the thread after all jobs. */
void lull_queue_stop(OIDNDevice device);

/* ---- Engines --------------------------------------------------------------------------------- */

/* Hardware of its own that executes filters in the core's place: what the core calls lull_plan_...
 * and lull_run. Its plans run on the queue's thread, one at a time; the rest is called with the
 * device locked. */
typedef struct lull_engine_plan lull_engine_plan;
typedef struct lull_engine lull_engine;
struct lull_engine {
    const char *name; /* of the hardware */
    bool (*build)(lull_engine *engine, lull_fault *fault); /* by the device's commit */
    void (*close)(lull_engine *engine);
    /* 0: a fault */
    uint64_t (*minimum)(lull_engine *engine, const lull_frame *frame, const lull_model *model,
                        lull_fault *fault);
    /* NULL: a fault */
    lull_engine_plan *(*new_plan)(lull_engine *engine, const lull_frame *frame,
                                  const lull_model *model, lull_fault *fault);
    void (*free_plan)(lull_engine_plan *plan);
    void (*get_info)(const lull_engine_plan *plan, lull_plan_info *info);
    /* The output must not overlap inputs. Faults of its own come with any status but LULL_OK. */
    lull_status (*run)(lull_engine_plan *plan, const lull_images *images, const lull_host *host,
                       lull_fault *fault);
};

/* The engine of OpenCL devices (opencl/device.c), where the build has it; NULL: a fault. */
lull_engine *lull_opencl_open(lull_fault *fault);

/* ---- Objects --------------------------------------------------------------------------------- */

/* Weights ready to run: a core model in memory of its own. */
typedef struct lull_weights {
    lull_model *model; /* NULL: none */
    void *memory;
    size_t bytes;
} lull_weights;

/* Number of built-in models, at least 1 so that arrays can have that size. */
#define LULL_MAX_BUILTIN 32

struct OIDNDeviceImpl {
    lull_atomic refs;
    lull_atomic users; /* handles of the device, and filters and buffers that have handles */
    lull_mutex lock;
    lull_errors errors;
    lull_value values[LULL_SLOTS];
    bool committed, dirty;
    bool affinity_asked; /* setAffinity was set, not left at its default */
    uint32_t ports;
    lull_engine *engine; /* NULL: the core */
    lull_pool *pool;
    lull_queue queue;
    lull_weights builtin[LULL_MAX_BUILTIN]; /* filled when first used */
};

struct OIDNBufferImpl {
    lull_atomic refs;
    OIDNDevice device;
    char *data;
    size_t bytes;
    OIDNStorage storage;
    bool owned;
    lull_atomic users;    /* handles; `refs` counts these, image parameters and queued work */
    lull_atomic attached; /* image parameters that have it, set or committed */
    uint64_t last_job;    /* number of the last job that uses it */
};

typedef struct lull_image_param {
    bool set;
    OIDNBuffer buffer; /* held; NULL for the caller's own memory */
    char *data;        /* first pixel */
    OIDNFormat format;
    size_t width, height;
    size_t pixel_stride, row_stride;
    size_t span; /* bytes from the first pixel to the end of the last, 0 for an empty image */
} lull_image_param;

enum { LULL_COLOR, LULL_ALBEDO, LULL_NORMAL, LULL_OUTPUT, LULL_IMAGES };

/* Models that quality `auto` chooses from, from the smallest to the largest, and the memory that it
 * samples a frame in (auto.c). */
#define LULL_RUNGS 3

typedef struct lull_ladder {
    struct {
        OIDNQuality quality;
        const lull_model *model;
    } rung[LULL_RUNGS];
    unsigned rungs;       /* 0: there is nothing to choose */
    unsigned at;          /* the one that the plan is made for now; used by executions only */
    size_t weights_bytes; /* of all models but the largest */
    unsigned lanes;       /* windows looked at together, in as many equal parts of `memory` */
    size_t plan_bytes;    /* of a window, a multiple of LULL_ALIGN */
    size_t sample_bytes;  /* of memory */
    void *memory;
} lull_ladder;

/* Tight pictures that executions need beside the plan. */
typedef struct lull_pictures {
    unsigned orientations; /* that the frame is denoised in, 1 if it is only once */
    size_t staged_bytes;   /* for the output, if it overlaps an input other than exactly, or cannot
                            * hold sums of orientations */
    size_t turned_bytes;   /* for the result of all orientations but the first */
    unsigned border;       /* pixels around a panorama, part of the frame; 0 of other images */
    bool is_filled;        /* a light map whose charts are told by normals */
    size_t inputs_bytes;   /* for inputs that are made first: of a panorama with the border, and the
                            * light of all texels */
} lull_pictures;

struct OIDNFilterImpl {
    lull_atomic refs;  /* queued work and handles together */
    lull_atomic users; /* handles */
    OIDNDevice device;
    enum lull_owner type;
    lull_value values[LULL_SLOTS];
    lull_image_param images[LULL_IMAGES];
    const void *weights_data;
    size_t weights_bytes;
    bool weights_dirty;
    OIDNProgressMonitorFunction progress;
    void *progress_user;

    bool dirty;           /* needs a commit */
    uint64_t last_job;    /* number of the last execution submitted */
    lull_atomic used;     /* OIDNQuality of the last execution completed */
    lull_weights weights; /* of `weights` */
    lull_plan *plan;      /* NULL: none; made for `frame` and `model` */
    void *plan_memory;
    lull_engine_plan *engine_plan[2]; /* in its place, if the device has an engine; and turned */
    size_t plan_bytes;
    lull_plan_info plan_info;
    lull_frame frame;
    const lull_model *model;
    lull_ladder ladder; /* its executions make the plan anew, in the same place */
    lull_pictures pictures;
    void *pictures_memory;
    lull_images committed; /* images as executed */
    OIDNBuffer committed_buffers[LULL_IMAGES];
};

struct OIDNSemaphoreImpl {
    lull_atomic refs;
};

/* ---- Calls ----------------------------------------------------------------------------------- */

/* Frame of an API function:
 *     lull_call call;
 *     if (lull_call_begin(&call, object ? object->device : NULL))
 *         do_it(..., &call.fault);
 *     lull_call_end(&call);
 */
typedef struct lull_call {
    OIDNDevice device;
    lull_fault fault;
    uint64_t floats; /* the host's mode of floating point, which weights do not depend on */
} lull_call;

/* Locks and holds the device; NULL is an error of no device and returns false. */
bool lull_call_begin(lull_call *call, OIDNDevice device);

/* Unlocks, reports the fault if there is one, and lets the device go. Returns true if there was
 * none. */
bool lull_call_end(lull_call *call);

/* Error of no device, from functions that have none. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
void lull_global_error(OIDNError code, const char *format, ...);

/* False and INVALID_OPERATION unless the device is committed and clean. */
bool lull_device_ready(OIDNDevice device, lull_fault *fault);

void lull_device_hold(OIDNDevice device);
void lull_device_drop(OIDNDevice device);
void lull_device_destroy(OIDNDevice device); /* by the queue's thread, once abandoned */
void lull_buffer_hold(OIDNBuffer buffer);    /* here and in the next three NULL is allowed */
void lull_buffer_drop(OIDNBuffer buffer);
void lull_buffer_attach(OIDNBuffer buffer); /* holds it for an image parameter */
void lull_buffer_detach(OIDNBuffer buffer);
void lull_filter_drop(OIDNFilter filter); /* one of `refs` */

/* ---- Filters --------------------------------------------------------------------------------- */

/* Checks an image (contract of oidnSetFilterImage) and describes it. `buffer` NULL: `pointer`. */
bool lull_image_param_make(lull_image_param *image, OIDNBuffer buffer, void *pointer,
                           OIDNFormat format, size_t width, size_t height, size_t offset,
                           size_t pixel_stride, size_t row_stride, lull_fault *fault);

/* Channels and bytes of a pixel, 0 for OIDN_FORMAT_UNDEFINED. */
unsigned lull_format_channels(OIDNFormat format);
size_t lull_format_bytes(OIDNFormat format);

/* Checks everything and prepares execution (commit.c). */
bool lull_filter_commit(OIDNFilter filter, lull_fault *fault);

/* The execution of a committed filter as a job (execute.c). INVALID_OPERATION if it is not
 * committed. */
bool lull_filter_make_job(OIDNFilter filter, lull_job *job, lull_fault *fault);

/* Frees the plan, which no queued work may use. */
void lull_filter_free_plan(OIDNFilter filter);

/* A built-in model for the frame: loads it into the device's cache, tells its size unpacked, and
 * takes from frame->features the images that it cannot use. Quality `auto` has the model of high
 * quality. INVALID_OPERATION if there is none (builtin.c). */
bool lull_builtin_select(OIDNDevice device, lull_frame *frame, OIDNQuality quality,
                         const lull_model **model, size_t *bytes, lull_fault *fault);

/* The models that `auto` chooses from for a frame whose largest model is `model`: loads the others,
 * and says how much memory they and a sample need. ladder->rungs is 0 if the filter's quality is
 * another one, if it has weights of its own, or if the frame is small. */
bool lull_ladder_find(lull_ladder *ladder, OIDNFilter filter, const lull_frame *frame,
                      const lull_model *model, lull_fault *fault);

/* Whether both choose from the same models. */
bool lull_ladder_same(const lull_ladder *a, const lull_ladder *b);

/* Bytes that hold the plan of any of the models, one at a time; 0 if one of them can have none. */
size_t lull_ladder_plan_size(const lull_ladder *ladder, const lull_frame *frame);

/* A part of a run as a run of its own, for progress functions: from `begin` on, of `size`. */
typedef struct lull_host_part {
    const lull_host *whole;
    double begin, size;
} lull_host_part;

lull_host lull_host_of_part(lull_host_part *part, const lull_host *whole, double begin,
                            double size);

/* A tight picture of `type` for what `output` has. */
lull_image lull_tight_image(const lull_image *output, lull_type type, const lull_frame *frame,
                            void *data);

/* The mean of all orientations of the frame, with the model that it needs (ensemble.c). The output
 * of `images` must be able to hold sums if there are several. *taken: as lull_ladder_run. */
lull_status lull_ensemble_run(OIDNFilter filter, const lull_images *images, const lull_host *host,
                              OIDNQuality *taken, lull_fault *fault);

/* Bytes of an input of a panorama; frame: with the border. */
size_t lull_panorama_bytes(size_t pixel_bytes, const lull_frame *frame);

/* Replaces the inputs by copies with a border, in memory of as many bytes one after the other. */
void lull_panorama_inputs(lull_images *images, const lull_frame *frame, unsigned border,
                          void *memory, const lull_host *host);

/* Of an image with a border what is inside. */
lull_image lull_panorama_inside(const lull_image *image, const lull_frame *frame, unsigned border);

/* Bytes that a light map with normals is filled in (lightmap.c). */
size_t lull_lightmap_bytes(size_t pixel_bytes, const lull_frame *frame);

/* Puts the light of all texels, in memory of that many bytes, in the place of the colour. */
lull_status lull_lightmap_inputs(lull_images *images, const lull_frame *frame, void *memory);

/* The frame in orientation `index`, from 0 on. */
lull_frame lull_frame_turned(const lull_frame *frame, unsigned index);

/* lull_run with the model that the frame needs, for a filter with a ladder. *taken: its quality. */
lull_status lull_ladder_run(OIDNFilter filter, const lull_images *images, const lull_host *host,
                            OIDNQuality *taken);

/* Unpacks weights into new memory. */
bool lull_weights_load(lull_weights *weights, const void *data, size_t bytes, uint32_t ports,
                       lull_fault *fault);
void lull_weights_free(lull_weights *weights);

#endif
