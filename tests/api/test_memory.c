/* Memory of the facade: every allocation fails once, every thread fails to start once, executions
 * allocate nothing, everything is freed. Linked with malloc, free and pthread_create wrapped. */
#include "api.h"

#include "OpenImageDenoise/lull_quality.h"

#include <errno.h>
#include <stdint.h>

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 1
#endif

/* ---- Wrapped functions ----------------------------------------------------------------------- */

void *__real_malloc(size_t size);
void __real_free(void *block);
void *__wrap_malloc(size_t size);
void __wrap_free(void *block);

static unsigned allocations, live, fail_at; /* fail_at: number of the allocation to fail, 0 none */

static unsigned bump(unsigned *counter, unsigned by)
{
    return __atomic_add_fetch(counter, by, __ATOMIC_SEQ_CST);
}

void *__wrap_malloc(size_t size)
{
    void *block;

    if (bump(&allocations, 1) == fail_at)
        return NULL;
    block = __real_malloc(size);
    if (block)
        bump(&live, 1);
    return block;
}

void __wrap_free(void *block)
{
    if (block)
        bump(&live, (unsigned)-1);
    __real_free(block);
}

#if LULL_WITH_THREADS
#include <pthread.h>

int __real_pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *),
                          void *arg);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *),
                          void *arg);

static unsigned threads, fail_thread;

int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *),
                          void *arg)
{
    return bump(&threads, 1) == fail_thread ? EAGAIN
                                            : __real_pthread_create(thread, attr, run, arg);
}
#endif

static void start_counting(unsigned fail)
{
    allocations = 0;
    fail_at = fail;
}

/* ---- A session with everything in it --------------------------------------------------------- */

enum { W = 20, H = 18 };

static float in[3 * W * H], out[3 * W * H];
static void *data3, *data9;
static size_t bytes3, bytes9;

static unsigned out_of_memory, other_errors;

static void count_error(OIDNError code)
{
    out_of_memory += code == MEMORY;
    other_errors += code != MEMORY && code != NONE;
}

static void on_error(void *user, OIDNError code, const char *message)
{
    (void)user;
    (void)message;
    count_error(code);
}

static bool progress(void *user, double n)
{
    (void)user;
    return n >= 0;
}

/* Goes on after failures, as far as objects exist. Returns whether the last execution worked. */
static int run_session(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    OIDNBuffer buffer = NULL, shared = NULL;
    OIDNFilter filter = NULL;
    int ok = 0;

    count_error(oidnGetDeviceError(NULL, NULL));
    if (!device)
        return 0;
    oidnSetDeviceErrorFunction(device, on_error, NULL);
    oidnSetDeviceInt(device, "numThreads", 2);
    oidnCommitDevice(device);
    if (oidnGetDeviceError(device, NULL) == NONE) {
        buffer = oidnNewBuffer(device, sizeof in);
        shared = oidnNewSharedBuffer(device, in, sizeof in);
        filter = oidnNewFilter(device, "RT");
    }
    if (buffer && shared && filter) {
        oidnWriteBufferAsync(buffer, 0, sizeof in, in);
        oidnSetFilterBool(filter, "srgb", true);
        oidnSetFilterProgressMonitorFunction(filter, progress, NULL);
        oidnSetFilterImage(filter, "color", shared, F3, W, H, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", out, F3, W, H, 0, 0, 0);
        oidnSetSharedFilterData(filter, "weights", data3, bytes3);
        oidnCommitFilter(filter);
        oidnSetSharedFilterImage(filter, "output", in + 3, F3, W, H - 1, 0, 0, 0); /* needs a copy
                                                                                    */
        oidnSetFilterImage(filter, "color", shared, F3, W, H - 1, 0, 0, 0);
        oidnCommitFilter(filter);
        oidnSetSharedFilterImage(filter, "output", out, F3, W, H, 0, 0, 0);
        oidnSetFilterImage(filter, "color", shared, F3, W, H, 0, 0, 0);
        oidnSetFilterImage(filter, "albedo", buffer, F3, W, H, 0, 0, 0);
        oidnSetFilterImage(filter, "normal", buffer, F3, W, H, 0, 0, 0);
        oidnSetSharedFilterData(filter, "weights", data9, bytes9);
        oidnCommitFilter(filter);
        oidnGetDeviceError(device, NULL);
        oidnCommitFilter(filter); /* again, should the first one have failed */
        if (oidnGetDeviceError(device, NULL) == NONE) {
            memset(out, 0, sizeof out);
            oidnExecuteFilterAsync(filter);
            oidnExecuteFilter(filter);
            ok = oidnGetDeviceError(device, NULL) == NONE && fabsf(out[7] - in[7]) < 1e-3f;
        }
    }
    if (filter)
        oidnReleaseFilter(filter);
    if (buffer)
        oidnReleaseBuffer(buffer);
    if (shared)
        oidnReleaseBuffer(shared);
    oidnReleaseDevice(device);
    return ok;
}

static void every_allocation_fails(void)
{
    const unsigned before = live;
    unsigned n, total;
    int ok;

    start_counting(0);
    out_of_memory = other_errors = 0;
    CHECK(run_session());
    CHECK_EQ(out_of_memory + other_errors, 0);
    CHECK_EQ(live, before);
    total = allocations;
    CHECK(total > 10);
    for (n = 1; n <= total; n++) {
        start_counting(n);
        out_of_memory = other_errors = 0;
        ok = run_session();
        if (!CHECK_EQ(live, before) || !CHECK(out_of_memory > 0 || ok)) /* told, unless done without
                                                                         */
            printf("  allocation %u of %u\n", n, total);
        CHECK_EQ(other_errors, 0);
    }
    start_counting(0);
}

/* The text of an error needs memory, too: without, it is still told. */
static void error_without_memory(void)
{
    OIDNDevice device = new_device();
    const char *text = NULL;

    start_counting(1);
    oidnNewFilter(device, "*");
    CHECK_EQ(oidnGetDeviceError(device, &text), ARGUMENT);
    CHECK(text && *text);
    CHECK_EQ(oidnGetDeviceError(device, &text), NONE);
    start_counting(0);
    oidnReleaseDevice(device);
}

/* ---- Executions ------------------------------------------------------------------------------ */

static void executions_allocate_nothing(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = new_identity(device, in, out, W, H);
    OIDNBuffer buffer = oidnNewBuffer(device, sizeof in);
    int i;

    oidnSetFilterProgressMonitorFunction(filter, progress, NULL);
    start_counting(0);
    for (i = 0; i < 5; i++) {
        oidnExecuteFilter(filter);
        oidnExecuteFilterAsync(filter);
        oidnWriteBufferAsync(buffer, 0, sizeof in, in);
        oidnReadBuffer(buffer, 0, sizeof out, out);
        oidnSyncDevice(device);
    }
    ERROR(device, NONE);
    CHECK_EQ(allocations, 0);
    oidnReleaseBuffer(buffer);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* Quality `auto`: a frame that is sampled, denoised by one model and then by another. */
static void auto_allocates_at_commits(void)
{
    enum { SIZE = 361 };
    static float image[3 * SIZE * SIZE];
    OIDNDevice device;
    OIDNFilter filter;
    unsigned n, seed = 5, before;
    int i;

    OURS_ALONE("has no quality 'auto'");
    WANTS_BUILTIN();
    before = live;
    for (n = 1;; n++) { /* until one allocation after the other has failed */
        start_counting(0);
        device = new_device();
        filter = oidnNewFilter(device, "RT");
        oidnSetSharedFilterImage(filter, "output", image + 3, F3, SIZE, SIZE - 1, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "color", image, F3, SIZE, SIZE - 1, 0, 0, 0);
        oidnSetFilterBool(filter, "hdr", true);
        oidnSetFilterInt(filter, "quality", LULL_QUALITY_AUTO);
        start_counting(n);
        oidnCommitFilter(filter);
        if (allocations < n)
            break;
        ERROR(device, MEMORY);
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
        CHECK_EQ(live, before);
    }
    CHECK(n > 6); /* three models, plan, copy and sample */
    start_counting(0);
    oidnExecuteFilter(filter);
    CHECK_EQ(oidnGetFilterInt(filter, "usedQuality"), OIDN_QUALITY_FAST);
    for (i = 0; i < 3 * SIZE * SIZE; i++)
        image[i] = noise(&seed) < 0.95f ? 0 : 20 * noise(&seed);
    oidnExecuteFilter(filter);
    CHECK_EQ(oidnGetFilterInt(filter, "usedQuality"), OIDN_QUALITY_HIGH);
    ERROR(device, NONE);
    CHECK_EQ(allocations, 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    CHECK_EQ(live, before);
}

/* A failed commit leaves other filters as they were. */
static void failed_commit_spares_others(void)
{
    OIDNDevice device = new_device();
    OIDNFilter good = new_identity(device, in, out, W, H),
               bad = new_identity(device, in, out, W, H);
    unsigned n;

    for (n = 1; n < 4; n++) {
        oidnUpdateFilterData(bad, "weights");
        start_counting(n);
        oidnCommitFilter(bad);
        if (fail_at <= allocations)
            CHECK_EQ(oidnGetDeviceError(device, NULL), MEMORY);
        start_counting(0);
        memset(out, 0, sizeof out);
        oidnExecuteFilter(good);
        ERROR(device, NONE);
        CHECK(fabsf(out[7] - in[7]) < 1e-3f);
    }
    oidnCommitFilter(bad);
    oidnExecuteFilter(bad);
    ERROR(device, NONE);
    oidnReleaseFilter(good);
    oidnReleaseFilter(bad);
    oidnReleaseDevice(device);
}

/* ---- Threads --------------------------------------------------------------------------------- */

#if LULL_WITH_THREADS

/* Fewer workers are fine; without a thread for the queue the commit fails. */
static void threads_fail_to_start(void)
{
    const unsigned before = live;
    unsigned n, total;

    threads = fail_thread = 0;
    CHECK(run_session());
    total = threads;
    CHECK(total >= 1);
    for (n = 1; n <= total; n++) {
        threads = 0;
        fail_thread = n;
        out_of_memory = other_errors = 0;
        CHECK_EQ(run_session(), n < total); /* the queue's is the last */
        CHECK_EQ(out_of_memory > 0, n == total);
        CHECK_EQ(live, before);
    }
    fail_thread = 0;
    CHECK(run_session());
}

#endif

int main(int argc, char **argv)
{
    unsigned seed = 1;
    size_t i;

    CHECK_MAIN(argc, argv);
    for (i = 0; i < sizeof in / sizeof *in; i++)
        in[i] = noise(&seed);
    data3 = identity_weights(3, 8, 0, &bytes3);
    data9 = identity_weights(9, 8, 0, &bytes9);
    RUN(every_allocation_fails);
    RUN(error_without_memory);
    RUN(executions_allocate_nothing);
    RUN(auto_allocates_at_commits);
    RUN(failed_commit_spares_others);
#if LULL_WITH_THREADS
    RUN(threads_fail_to_start);
#endif
    free(data3);
    free(data9);
    free_identity();
    return check_report();
}
