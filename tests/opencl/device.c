/* OpenCL devices beside their pictures: creation and its errors, weights that they refuse, work in
 * the background, progress, several at once, forks. */
#include "opencl.h"
#include "tests/api/threads.h"

#if !defined(_WIN32)
#include <sys/wait.h>
#endif

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* ---- Creation -------------------------------------------------------------------------------- */

/* Nothing but the asking for an OpenCL device loads the library: the first test of the program. */
static void others_do_not_load_it(void)
{
    FILE *maps;
    char line[4096];
    OIDNDevice device = open_cpu();
    int loaded = 0;

    CHECK_EQ(oidnGetNumPhysicalDevices(), 1);
    oidnReleaseDevice(device);
    device = oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT);
    CHECK_EQ(oidnGetDeviceInt(device, "type"), OIDN_DEVICE_TYPE_CPU);
    oidnReleaseDevice(device);
    maps = fopen("/proc/self/maps", "r");
    if (!maps)
        SKIP("optional: no list of the libraries that are loaded");
    while (fgets(line, sizeof line, maps))
        loaded += strstr(line, "libOpenCL") != NULL;
    fclose(maps);
    CHECK_EQ(loaded, 0);
}

static void expect_none(const char *variable, const char *value, const char *text)
{
    const char *found = "";

    setenv(variable, value, 1);
    CHECK(!oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL));
    CHECK_EQ(oidnGetDeviceError(NULL, &found), HARDWARE);
    if (!CHECK(strstr(found, text)))
        printf("  %s\n", found);
    unsetenv(variable);
}

static void errors_name_what_is_missing(void)
{
    const char *why = why_no_opencl();

    if (why && strstr(why, "build is without"))
        SKIP("optional: this build is without OpenCL");
    expect_none("LULL_OPENCL_LIBRARY", "/nowhere/libNone.so.1",
                "the library /nowhere/libNone.so.1 cannot be loaded");
    expect_none("LULL_OPENCL_LIBRARY", "libc.so.6",
                "the library libc.so.6 has no function clGetPlatformIDs");
    if (!why) {
        expect_none("LULL_OPENCL_DEVICE", "63", "no OpenCL device has the number 63");
        expect_none("LULL_OPENCL_DEVICE", "gpu", "no OpenCL device has the number gpu");
        expect_none("LULL_OPENCL_DEVICE", "-1", "no OpenCL device has the number -1");
    }
}

static void device_tells_what_it_is(void)
{
    OIDNDevice device;

    NEED_OPENCL();
    device = oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL);
    CHECK_EQ(oidnGetDeviceInt(device, "type"), LULL_DEVICE_TYPE_OPENCL);
    CHECK(oidnGetDeviceBool(device, "systemMemorySupported"));
    CHECK(lull_device_name(device) && *lull_device_name(device));
    ERROR(device, NONE);
    oidnReleaseDevice(device); /* never committed */
    setenv("LULL_OPENCL_DEVICE", "0", 1);
    device = open_opencl();
    unsetenv("LULL_OPENCL_DEVICE");
    oidnCommitDevice(device);
    ERROR(device, OPERATION);
    oidnReleaseDevice(device);
    CHECK(!lull_device_name(NULL));
    ERROR(NULL, ARGUMENT);
    device = open_cpu();
    CHECK_STR(lull_device_name(device), oidnGetPhysicalDeviceString(0, "name"));
    oidnReleaseDevice(device);
}

/* ---- Weights --------------------------------------------------------------------------------- */

static void refuses_other_networks(void)
{
    OIDNDevice device;
    OIDNFilter filter;
    float *in = picture(N, 1), *out = picture(N, 2);
    const char *text = "";

    NEED_OPENCL();
    device = open_opencl();
    filter = new_hdr(device, in, out, W, H);
    use_identity(filter, 3);
    oidnCommitFilter(filter);
    CHECK_EQ(oidnGetDeviceError(device, &text), HARDWARE);
    CHECK(strstr(text, "CPU device") != NULL);
    oidnExecuteFilter(filter);
    ERROR(device, OPERATION);
    oidnSetSharedFilterData(filter, "weights", "nonsense", 8);
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnUnsetFilterData(filter, "weights");
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

/* Samples are the CPU device's. */
static void auto_is_high(void)
{
    enum { SIDE = 800, VALUES = 3 * SIDE * SIDE }; /* large enough for a sample */
    static const int qualities[] = {LULL_QUALITY_AUTO, OIDN_QUALITY_HIGH};
    float *in, *out[2];
    OIDNDevice device;
    int i;

    NEED_OPENCL();
    in = picture(VALUES, 1);
    device = open_opencl();
    for (i = 0; i < 2; i++) {
        OIDNFilter filter;

        out[i] = picture(VALUES, 2);
        filter = new_hdr(device, in, out[i], SIDE, SIDE);
        oidnSetFilterInt(filter, "quality", qualities[i]);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        CHECK_EQ(oidnGetFilterInt(filter, "usedQuality"), OIDN_QUALITY_HIGH);
        ERROR(device, NONE);
        oidnReleaseFilter(filter);
    }
    CHECK(!memcmp(out[0], out[1], VALUES * sizeof(float)));
    oidnReleaseDevice(device);
    free(in);
    free(out[0]);
    free(out[1]);
}

/* ---- Background work ------------------------------------------------------------------------- */

/* A picture from one filter to the next through buffers, all of it queued. */
static void run_chain(OIDNDevice device, const float *in, float *out)
{
    const size_t bytes = N * sizeof(float);
    OIDNBuffer a = oidnNewBuffer(device, bytes), b = oidnNewBuffer(device, bytes);
    OIDNFilter first = oidnNewFilter(device, "RT"), second = oidnNewFilter(device, "RT");
    int i;

    for (i = 0; i < 2; i++) {
        OIDNFilter filter = i ? second : first;

        oidnSetFilterBool(filter, "hdr", true);
        oidnSetFilterImage(filter, "color", i ? b : a, F3, W, H, 0, 0, 0);
        oidnSetFilterImage(filter, "output", i ? a : b, F3, W, H, 0, 0, 0);
        oidnSetFilterInt(filter, "quality", i ? OIDN_QUALITY_FAST : OIDN_QUALITY_BALANCED);
        oidnCommitFilter(filter);
    }
    oidnWriteBufferAsync(a, 0, bytes, in);
    oidnExecuteFilterAsync(first);
    oidnExecuteFilterAsync(second);
    oidnReadBufferAsync(a, 0, bytes, out);
    oidnSetFilterBool(first, "hdr", false); /* of the next commit only */
    oidnSyncDevice(device);
    ERROR(device, NONE);
    oidnReleaseBuffer(a);
    oidnReleaseFilter(first);
    oidnReleaseBuffer(b);
    oidnReleaseFilter(second);
}

static void queued_work(void)
{
    float *in = picture(N, 3), *out[2] = {picture(N, 4), picture(N, 5)};
    OIDNDevice device;
    int i;

    NEED_OPENCL();
    for (i = 0; i < 2; i++) {
        device = i ? open_opencl() : open_cpu();
        run_chain(device, in, out[i]);
        oidnReleaseDevice(device);
    }
    CHECK(!memcmp(out[0], out[1], N * sizeof(float)));
    free(in);
    free(out[0]);
    free(out[1]);
}

/* What a progress function was told, and when it says no. */
typedef struct watch {
    double last;
    int calls, stop_at, is_ordered;
} watch;

static bool watch_progress(void *user, double n)
{
    watch *w = user;

    w->is_ordered &= n >= w->last && n <= 1.0 && (w->calls > 0 || n == 0.0);
    w->last = n;
    return ++w->calls != w->stop_at;
}

static void progress_and_cancelling(void)
{
    float *in = picture(N, 6), *first = picture(N, 7), *out = picture(N, 8);
    watch w = {0, 0, 0, 1};
    OIDNDevice device;
    OIDNFilter filter;
    int calls, stop;

    NEED_OPENCL();
    device = open_opencl();
    filter = new_hdr(device, in, first, W, H);
    oidnExecuteFilter(filter);
    oidnSetSharedFilterImage(filter, "output", out, F3, W, H, 0, 0, 0);
    oidnSetFilterProgressMonitorFunction(filter, watch_progress, &w);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK(w.is_ordered && w.last == 1.0);
    CHECK(!memcmp(first, out, N * sizeof(float)));
    calls = w.calls;
    CHECK(calls > 10);
    for (stop = 1; stop < calls; stop += stop < 4 ? 1 : 7) {
        const watch again = {0, 0, stop, 1};

        w = again;
        oidnExecuteFilterAsync(filter);
        oidnSyncDevice(device);
        ERROR(device, CANCELLED);
        CHECK_EQ(w.calls, stop);
    }
    oidnSetFilterProgressMonitorFunction(filter, NULL, NULL);
    memset(out, 0, N * sizeof(float));
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK(!memcmp(first, out, N * sizeof(float)));
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(first);
    free(out);
}

/* Every order of releasing, with work still queued. */
static void release_orders(void)
{
    float *in = picture(N, 9), *out = picture(N, 10);
    int order;

    NEED_OPENCL();
    for (order = 0; order < 4; order++) {
        OIDNDevice device = open_opencl();
        OIDNFilter filter = new_hdr(device, in, out, W, H);

        if (order & 1)
            oidnExecuteFilterAsync(filter);
        if (order & 2)
            oidnReleaseDevice(device);
        oidnReleaseFilter(filter);
        if (!(order & 2))
            oidnReleaseDevice(device);
        CHECK_EQ(oidnGetDeviceError(NULL, NULL), NONE);
    }
    free(in);
    free(out);
}

/* Last handles wait for copies from and to the caller's memory. */
static void releasing_waits(void)
{
    const size_t bytes = N * sizeof(float);
    float *in = picture(N, 15), *out = picture(N, 16), *copy = picture(N, 17);
    OIDNDevice device;
    OIDNFilter filter;
    OIDNBuffer buffer;

    NEED_OPENCL();
    device = open_opencl();
    filter = new_hdr(device, in, out, W, H);
    buffer = oidnNewBuffer(device, bytes);
    oidnSetFilterProgressMonitorFunction(filter, take_time, NULL);
    oidnExecuteFilterAsync(filter);
    oidnWriteBufferAsync(buffer, 0, bytes, out);
    oidnReadBufferAsync(buffer, 0, bytes, copy);
    oidnReleaseBuffer(buffer);
    CHECK(!memcmp(out, copy, bytes));
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(out);
    free(copy);
}

/* ---- Several at once ------------------------------------------------------------------------- */

#if LULL_WITH_THREADS
static float *shared_in, *shared_out[4], *shared_noise; /* what is in the outputs before */
static OIDNDevice shared_device;

/* Odd threads share a device, the others have one of their own. Checks are not for threads: errors
 * show in the pictures. */
static void *use_devices(void *arg)
{
    const size_t i = (size_t)arg;
    OIDNDevice device =
        i % 2 ? shared_device : oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL);
    OIDNFilter filter;
    int k;

    if (i % 2 == 0)
        oidnCommitDevice(device);
    filter = oidnNewFilter(device, "RT");
    oidnSetFilterBool(filter, "hdr", true);
    oidnSetSharedFilterImage(filter, "color", shared_in, F3, W, H, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", shared_out[i], F3, W, H, 0, 0, 0);
    oidnCommitFilter(filter);
    for (k = 0; k < 3; k++)
        oidnExecuteFilter(filter);
    oidnReleaseFilter(filter);
    if (i % 2 == 0)
        oidnReleaseDevice(device);
    return NULL;
}

static void threads_and_devices(void)
{
    pthread_t threads[4];
    size_t i;

    NEED_OPENCL();
    shared_device = open_opencl();
    shared_in = picture(N, 11);
    shared_noise = picture(N, 12);
    for (i = 0; i < 4; i++) {
        shared_out[i] = picture(N, 12);
        pthread_create(&threads[i], NULL, use_devices, (void *)i);
    }
    for (i = 0; i < 4; i++)
        pthread_join(threads[i], NULL);
    ERROR(shared_device, NONE);
    for (i = 0; i < 4; i++) {
        CHECK(!memcmp(shared_out[0], shared_out[i], N * sizeof(float)));
        CHECK(memcmp(shared_noise, shared_out[i], N * sizeof(float)));
    }
    for (i = 0; i < 4; i++)
        free(shared_out[i]);
    free(shared_in);
    free(shared_noise);
    oidnReleaseDevice(shared_device);
}

/* What a forked child may do with its parent's filter and with a device that its parent has not
 * committed, and whether it can have one of its own: 0 if each is refused with the right error. */
static int use_after_fork(OIDNDevice device, OIDNFilter filter, OIDNDevice uncommitted)
{
    const char *text = "";
    int wrong = 0;

    oidnExecuteFilter(filter);
    wrong |= oidnGetDeviceError(device, &text) != OPERATION || !strstr(text, "fork");
    oidnSetFilterInt(filter, "quality", OIDN_QUALITY_FAST);
    oidnCommitFilter(filter);
    wrong |= oidnGetDeviceError(device, &text) != OPERATION || !strstr(text, "fork");
    oidnCommitDevice(uncommitted);
    wrong |= oidnGetDeviceError(uncommitted, &text) != OPERATION || !strstr(text, "fork");
    wrong |= oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL) != NULL;
    wrong |= oidnGetDeviceError(NULL, &text) != HARDWARE || !strstr(text, "fork");
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    oidnReleaseDevice(uncommitted);
    return wrong;
}

/* A forked child cannot go on using the driver, is told so, and may release what it has. */
static void does_not_outlive_a_fork(void)
{
    float *in = picture(N, 13), *out = picture(N, 14);
    OIDNDevice device, uncommitted;
    OIDNFilter filter;
    int status = 1;
    pid_t child;

    NEED_OPENCL();
#if defined(__SANITIZE_THREAD__)
    SKIP("optional: the thread sanitizer does not survive a fork");
#endif
    device = open_opencl();
    uncommitted = oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL);
    filter = new_hdr(device, in, out, W, H);
    oidnExecuteFilter(filter);
    child = fork();
    if (child == 0) {
        alarm(60);
        _exit(use_after_fork(device, filter, uncommitted));
    }
    waitpid(child, &status, 0);
    CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    oidnReleaseDevice(uncommitted);
    free(in);
    free(out);
}
#endif

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    keep_kernels_in_build();
    RUN(others_do_not_load_it);
    RUN(errors_name_what_is_missing);
    RUN(device_tells_what_it_is);
    RUN(refuses_other_networks);
    RUN(auto_is_high);
    RUN(queued_work);
    RUN(progress_and_cancelling);
    RUN(release_orders);
    RUN(releasing_waits);
#if LULL_WITH_THREADS
    RUN(threads_and_devices);
    RUN(does_not_outlive_a_fork);
#endif
    free_identity();
    return check_report();
}
