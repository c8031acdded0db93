/* Releasing objects while work is queued: what waits for it, and what does not. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* usleep */
#endif
#include "api.h"
#include "threads.h"

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* Whoever lets go of a last handle waits for all that is queued: copies from and to the caller's
 * memory, and work of other objects. */
static void release_waits_for_all(void)
{
    enum { FILTER, BUFFER, SHARED, OTHER_FILTER, OTHER_BUFFER, WAYS };
    const size_t bytes = N * sizeof(float);
    int way;

    for (way = 0; way < WAYS; way++) {
        OIDNDevice device = new_device();
        float *in = noise_image(N, 21), *out = noise_image(N, 22), *copy = noise_image(N, 23);
        OIDNFilter filter = new_identity(device, in, out, W, H),
                   other = oidnNewFilter(device, "RT");
        OIDNBuffer buffer =
            way == SHARED ? oidnNewSharedBuffer(device, out, bytes) : oidnNewBuffer(device, bytes);
        OIDNBuffer unused = oidnNewBuffer(device, 16);

        oidnSetFilterProgressMonitorFunction(filter, take_time, NULL);
        oidnExecuteFilterAsync(filter);
        if (way != SHARED)
            oidnWriteBufferAsync(buffer, 0, bytes, out);
        oidnReadBufferAsync(buffer, 0, bytes, copy);
        if (way == FILTER)
            oidnReleaseFilter(filter);
        else if (way == OTHER_FILTER)
            oidnReleaseFilter(other);
        else
            oidnReleaseBuffer(way == OTHER_BUFFER ? unused : buffer);
        if (!CHECK(difference(in, out, N) < 1e-3f && !memcmp(out, copy, bytes)))
            printf("  way %d\n", way);
        oidnSyncDevice(device);
        ERROR(device, NONE);
        if (way != FILTER)
            oidnReleaseFilter(filter);
        if (way != OTHER_FILTER)
            oidnReleaseFilter(other);
        if (way != BUFFER && way != SHARED)
            oidnReleaseBuffer(buffer);
        if (way != OTHER_BUFFER)
            oidnReleaseBuffer(unused);
        oidnReleaseDevice(device);
        free(in);
        free(out);
        free(copy);
    }
}

/* Every object released with a copy queued, nothing else known to the caller. */
static void release_of_all_waits(void)
{
    enum { BYTES = 3000000 };
    char *memory = calloc(BYTES, 1);
    int first, i, wrong = 0;

    for (first = 0; first < 2; first++)
        for (i = 1; i <= 20; i++) {
            OIDNDevice device = new_device();
            OIDNBuffer buffer = oidnNewBuffer(device, BYTES);

            memset(oidnGetBufferData(buffer), i, BYTES);
            oidnReadBufferAsync(buffer, 0, BYTES, memory);
            if (first)
                oidnReleaseDevice(device);
            oidnReleaseBuffer(buffer);
            if (!first)
                oidnReleaseDevice(device);
            wrong += memory[BYTES - 1] != i;
        }
    CHECK_EQ(wrong, 0);
    free(memory);
}

#if LULL_WITH_THREADS

/* Work that waits for what the test does. */
typedef struct waiting {
    gate gate;
    bool timed_out;
} waiting;

static bool wait_for_gate(void *user, double n)
{
    waiting *w = user;
    int i;

    for (i = 0; n == 0 && i < 10000 && !is_open(&w->gate); i++)
        usleep(1000);
    w->timed_out |= n == 0 && i == 10000;
    return true;
}

/* What others still have is let go of at once. */
static void release_of_shared_handles_does_not_wait(void)
{
    OIDNDevice device = new_device();
    float *in = noise_image(N, 24), *out = noise_image(N, 25);
    OIDNBuffer buffer = oidnNewBuffer(device, N * sizeof(float));
    OIDNBuffer kept = oidnNewBuffer(device, 16);
    OIDNFilter filter = new_identity(device, in, out, W, H);
    waiting w = {GATE_CLOSED, false};

    oidnSetFilterImage(filter, "output", buffer, F3, W, H, 0, 0, 0);
    oidnCommitFilter(filter);
    oidnSetFilterProgressMonitorFunction(filter, wait_for_gate, &w);
    oidnRetainFilter(filter);
    oidnRetainBuffer(kept);
    oidnExecuteFilterAsync(filter);
    oidnReadBufferAsync(buffer, 0, N * sizeof(float), out);
    oidnReleaseFilter(filter); /* retained */
    oidnReleaseBuffer(kept);
    oidnReleaseBuffer(buffer); /* the filter's output */
    oidnReleaseDevice(device); /* that of objects with handles */
    open_gate(&w.gate);
    oidnReleaseFilter(filter);
    CHECK(!w.timed_out);
    CHECK(difference(in, out, N) < 1e-3f);
    oidnReleaseBuffer(kept);
    free(in);
    free(out);
}

/* Work that lets go of its filter and says so. */
typedef struct releasing {
    gate gate;
    OIDNFilter filter;
} releasing;

static bool release_at_gate(void *user, double n)
{
    releasing *r = user;

    if (n == 0) {
        oidnReleaseFilter(r->filter);
        open_gate(&r->gate);
        usleep(50000);
    }
    return true;
}

/* The last handle of all waits for work whose filter went inside its progress function. */
static void release_of_device_waits(void)
{
    float *in, *out;
    OIDNDevice device;
    releasing r = {GATE_CLOSED, NULL};
    int i;

    OURS_ALONE("deadlocks");
    in = noise_image(N, 26);
    out = noise_image(N, 27);
    device = new_device();
    r.filter = new_identity(device, in, out, W, H);
    oidnSetFilterProgressMonitorFunction(r.filter, release_at_gate, &r);
    oidnExecuteFilterAsync(r.filter);
    for (i = 0; i < 10000 && !is_open(&r.gate); i++)
        usleep(1000);
    oidnReleaseDevice(device);
    CHECK(difference(in, out, N) < 1e-3f);
    free(in);
    free(out);
}

#endif

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(release_waits_for_all);
    RUN(release_of_all_waits);
#if LULL_WITH_THREADS
    RUN(release_of_shared_handles_does_not_wait);
    RUN(release_of_device_waits);
#endif
    free_identity();
    return check_report();
}
