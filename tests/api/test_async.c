/* Work in the background: order, changes meanwhile, lifetimes, progress, cancelling. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* setenv, fork, usleep */
#endif
#include "api.h"
#include "threads.h"

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* ---- Order ----------------------------------------------------------------------------------- */

static void async_order(void)
{
    OIDNDevice device = new_device();
    float *in = noise_image(N, 1), *middle = noise_image(N, 2), *out = noise_image(N, 3);
    float *copy = noise_image(N, 4);
    OIDNBuffer buffer = oidnNewBuffer(device, N * sizeof(float));
    OIDNFilter first = new_identity(device, in, middle, W, H);
    OIDNFilter second = oidnNewFilter(device, "RT");

    use_identity(second, 3);
    oidnSetFilterBool(second, "srgb", true);
    oidnSetFilterImage(second, "color", buffer, F3, W, H, 0, 0, 0);
    oidnSetSharedFilterImage(second, "output", out, F3, W, H, 0, 0, 0);
    oidnCommitFilter(second);
    ERROR(device, NONE);
    oidnExecuteFilterAsync(first);
    oidnWriteBufferAsync(buffer, 0, N * sizeof(float), middle);
    oidnExecuteFilterAsync(second);
    oidnReadBufferAsync(buffer, 0, N * sizeof(float), copy);
    oidnSyncDevice(device);
    ERROR(device, NONE);
    CHECK(difference(in, middle, N) < 1e-3f);
    CHECK(!memcmp(middle, copy, N * sizeof(float)));
    CHECK(difference(in, out, N) < 1e-3f);
    oidnReleaseFilter(first);
    oidnReleaseFilter(second);
    oidnReleaseBuffer(buffer);
    oidnReleaseDevice(device);
    free(in);
    free(middle);
    free(out);
    free(copy);
}

/* More jobs than the queue has room for. */
static void async_many(void)
{
    OIDNDevice device = new_device();
    float in[3] = {0.25f, 0.5f, 0.75f}, out[3] = {0, 0, 0};
    OIDNFilter filter = new_identity(device, in, out, 1, 1);
    int i;

    for (i = 0; i < 300; i++)
        oidnExecuteFilterAsync(filter);
    oidnSyncDevice(device);
    ERROR(device, NONE);
    CHECK(difference(in, out, 3) < 1e-3f);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* Parameters and images may change, and commits happen, while work is under way. */
static void async_changes(void)
{
    OIDNDevice device = new_device();
    float *in = noise_image(N, 5), *a = noise_image(N, 6), *b = noise_image(N, 7),
          *c = noise_image(N, 8);
    OIDNFilter filter = new_identity(device, in, a, W, H);

    oidnExecuteFilterAsync(filter);
    oidnSetSharedFilterImage(filter, "output", b, F3, W, H, 0, 0, 0);
    oidnCommitFilter(filter);
    oidnExecuteFilterAsync(filter);
    oidnSetSharedFilterImage(filter, "output", c, F3, W, H / 2, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "color", in, F3, W, H / 2, 0, 0, 0);
    oidnCommitFilter(filter);
    oidnExecuteFilterAsync(filter);
    oidnUnsetFilterImage(filter, "color");
    oidnSyncDevice(device);
    ERROR(device, NONE);
    CHECK(difference(in, a, N) < 1e-3f);
    CHECK(!memcmp(a, b, sizeof(float) * N));
    CHECK(difference(in, c, 3 * W * (H / 2)) < 1e-3f);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(a);
    free(b);
    free(c);
}

/* ---- Lifetimes ------------------------------------------------------------------------------- */

/* Every order of releasing device, filter and buffers, with work still queued. */
static void release_orders(void)
{
    int order, i;

    for (order = 0; order < 24; order++) {
        OIDNDevice device = new_device();
        OIDNBuffer in = oidnNewBuffer(device, N * sizeof(float));
        OIDNBuffer out = oidnNewBuffer(device, N * sizeof(float));
        OIDNFilter filter = oidnNewFilter(device, "RT");
        unsigned left[4] = {0, 1, 2, 3}, picks = (unsigned)order, n = 4;

        memset(oidnGetBufferData(in), 0, N * sizeof(float));
        use_identity(filter, 3);
        oidnSetFilterImage(filter, "color", in, F3, W, H, 0, 0, 0);
        oidnSetFilterImage(filter, "output", out, F3, W, H, 0, 0, 0);
        oidnCommitFilter(filter);
        ERROR(device, NONE);
        oidnRetainDevice(device);
        oidnReleaseDevice(device);
        if (order % 2)
            oidnExecuteFilterAsync(filter);
        for (i = 0; i < 4; i++, n--) {
            const unsigned k = picks % n, what = left[k];

            picks /= n;
            left[k] = left[n - 1];
            if (what == 0)
                oidnReleaseDevice(device);
            else if (what == 1)
                oidnReleaseFilter(filter);
            else
                oidnReleaseBuffer(what == 2 ? in : out);
        }
        CHECK_EQ(oidnGetDeviceError(NULL, NULL), NONE);
    }
}

/* Releasing a filter waits for its work, so the images may be freed right after. */
static void release_waits(void)
{
    OIDNDevice device = new_device();
    int i;

    for (i = 0; i < 5; i++) {
        float *in = noise_image(N, 9), *out = noise_image(N, 10);
        OIDNFilter filter = new_identity(device, in, out, W, H);

        oidnExecuteFilterAsync(filter);
        oidnReleaseFilter(filter);
        CHECK(difference(in, out, N) < 1e-3f);
        free(in);
        free(out);
    }
    oidnSyncDevice(device);
    ERROR(device, NONE);
    oidnReleaseDevice(device);
}

/* ---- Progress -------------------------------------------------------------------------------- */

typedef struct watch {
    unsigned calls, after_stop, wrong;
    double first, last, stop_at; /* stop_at > 1: never */
    int stopped;
#if LULL_WITH_THREADS
    pthread_t caller;
    unsigned on_caller;
#endif
} watch;

static bool watch_progress(void *user, double n)
{
    watch *w = user;

    if (!w->calls)
        w->first = n;
    else if (n < w->last)
        w->wrong++;
    if (!(n >= 0 && n <= 1))
        w->wrong++;
    w->after_stop += (unsigned)w->stopped;
    w->calls++;
    w->last = n;
#if LULL_WITH_THREADS
    w->on_caller += pthread_equal(w->caller, pthread_self()) != 0;
#endif
    w->stopped = n >= w->stop_at;
    return !w->stopped;
}

static watch new_watch(double stop_at)
{
    watch w;

    memset(&w, 0, sizeof w);
    w.stop_at = stop_at;
#if LULL_WITH_THREADS
    w.caller = pthread_self();
#endif
    return w;
}

/* At least 20 calls on a quarter of a million pixels of any shape, and no flood of them. */
static void progress_calls(void)
{
    static const struct {
        size_t width, height;
        int limit;
    } rows[] = {
        {512, 512, -1}, {512, 512, 0},  {8192, 32, -1},
        {32, 8192, -1}, {2048, 128, 0}, {16384, 16, -1},
    };
    enum { MOST = 512 * 512 };
    OIDNDevice device = new_device();
    float *in = noise_image(3 * MOST, 11), *out = noise_image(3 * MOST, 12);
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        OIDNFilter filter = new_identity(device, in, out, rows[i].width, rows[i].height);
        watch w = new_watch(2);

        oidnSetFilterInt(filter, "maxMemoryMB", rows[i].limit);
        oidnSetFilterProgressMonitorFunction(filter, watch_progress, &w);
        oidnCommitFilter(filter);
        CHECK_EQ(w.calls, 0);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        if (!CHECK(w.calls >= 20 && w.calls <= 260))
            printf("  row %u: %u calls\n", (unsigned)i, w.calls);
        CHECK(w.first == 0);
        CHECK(w.last == 1);
        CHECK_EQ(w.wrong, 0);
#if LULL_WITH_THREADS
        CHECK_EQ(w.on_caller, 0);
#endif
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

static void progress_cancel(void)
{
    static const double stops[] = {0, 0.1, 0.5, 0.9, 1, 2};
    enum { SIZE = 256 };
    OIDNDevice device = new_device();
    float *in = noise_image(3 * SIZE * SIZE, 13), *out = noise_image(3 * SIZE * SIZE, 14);
    OIDNFilter filter = new_identity(device, in, out, SIZE, SIZE);
    size_t i;
    int async;

    for (i = 0; i < 2 * COUNT(stops); i++) {
        const double stop = stops[i / 2];
        watch w = new_watch(stop);

        async = i % 2;
        oidnSetFilterProgressMonitorFunction(filter, watch_progress, &w);
        (async ? oidnExecuteFilterAsync : oidnExecuteFilter)(filter);
        if (async) {
            ERROR(device, NONE);
            oidnSyncDevice(device);
        }
        ERROR(device, stop < 1 ? CANCELLED : NONE); /* at 1 nothing is left to cancel */
        CHECK_EQ(w.after_stop, 0);
        CHECK(stop >= 1 ? w.last == 1 : w.last >= stop);
        if (stop == 0)
            CHECK_EQ(w.calls, 1);
        oidnSyncDevice(device); /* the error was told once */
        ERROR(device, NONE);
    }
    oidnSetFilterProgressMonitorFunction(filter, NULL, NULL);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK(difference(in, out, 3 * SIZE * SIZE) < 1e-3f);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

/* A cancellation in the background is told at the next sync, blocking execution, or commit that
 * makes a new plan; not by a copy, which waits and succeeds. */
static void cancel_is_told_once(void)
{
    OIDNDevice device = new_device();
    float *in = noise_image(N, 15), *out = noise_image(N, 16);
    OIDNFilter filter = new_identity(device, in, out, W, H),
               other = new_identity(device, in, out, W, H);
    OIDNBuffer buffer = oidnNewBuffer(device, 4);
    char bytes[4];
    int i;

    for (i = 0; i < 4; i++) {
        watch w = new_watch(0);

        oidnSetFilterProgressMonitorFunction(filter, watch_progress, &w);
        oidnExecuteFilterAsync(filter);
        ERROR(device, NONE);
        if (i == 0)
            oidnSyncDevice(device);
        else if (i == 1)
            oidnExecuteFilter(other);
        else if (i == 2) {
            oidnReadBuffer(buffer, 0, 4, bytes);
            ERROR(device, NONE);
            oidnWriteBuffer(buffer, 0, 4, bytes);
            ERROR(device, NONE);
            oidnSyncDevice(device);
        } else {
            oidnSetFilterBool(filter, "srgb", false);
            oidnCommitFilter(filter);
        }
        CHECK_EQ(oidnGetDeviceError(device, NULL), CANCELLED);
        if (is_peer())
            break; /* leaves the filter uncommitted, and tells of one cancellation twice */
        oidnSyncDevice(device);
        ERROR(device, NONE);
    }
    oidnSetFilterProgressMonitorFunction(filter, NULL, NULL);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseBuffer(buffer);
    oidnReleaseFilter(filter);
    oidnReleaseFilter(other);
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

/* ---- Calls from a progress function ---------------------------------------------------------- */

typedef struct reentry {
    OIDNDevice device;
    OIDNFilter filter;
    unsigned refused, calls;
    int version;
} reentry;

static bool call_back(void *user, double n)
{
    reentry *r = user;

    if (r->calls++)
        return true;
    r->version = oidnGetDeviceInt(r->device, "version");
    oidnGetFilterInt(r->filter, "quality");
    oidnSetFilterInt(r->filter, "quality", 5);
    oidnExecuteFilter(r->filter);
    r->refused += oidnGetDeviceError(r->device, NULL) == OPERATION;
    oidnSyncDevice(r->device);
    r->refused += oidnGetDeviceError(r->device, NULL) == OPERATION;
    oidnReleaseFilter(r->filter); /* retained by the test for this */
    return n >= 0;
}

static void progress_calls_back(void)
{
    OIDNDevice device;
    float *in, *out;
    reentry r;
    int async;

    OURS_ALONE("deadlocks");
    device = new_device();
    in = noise_image(N, 17);
    out = noise_image(N, 18);
    for (async = 0; async < 2; async++) {
        memset(&r, 0, sizeof r);
        r.device = device;
        r.filter = new_identity(device, in, out, W, H);
        if (!async)
            oidnRetainFilter(r.filter);
        oidnSetFilterProgressMonitorFunction(r.filter, call_back, &r);
        (async ? oidnExecuteFilterAsync : oidnExecuteFilter)(r.filter);
        oidnSyncDevice(device);
        ERROR(device, NONE);
        CHECK_EQ(r.version, 20501);
        CHECK_EQ(r.refused, 2);
        if (!async)
            oidnReleaseFilter(r.filter);
    }
    CHECK(difference(in, out, N) < 1e-3f);
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

/* The last handles of everything go inside the progress function: work ends, then all is freed. */
#if LULL_WITH_THREADS

typedef struct last_handles {
    OIDNDevice device;
    OIDNFilter filter;
    pthread_mutex_t mutex;
    pthread_cond_t over;
    bool done;
} last_handles;

static bool let_go(void *user, double n)
{
    last_handles *l = user;

    if (l->filter) {
        oidnReleaseFilter(l->filter);
        oidnReleaseDevice(l->device);
        l->filter = NULL;
    }
    pthread_mutex_lock(&l->mutex);
    l->done = n == 1;
    pthread_cond_signal(&l->over);
    pthread_mutex_unlock(&l->mutex);
    return true;
}

static void progress_releases_all(void)
{
    float *in, *out;
    last_handles l;

    OURS_ALONE("deadlocks");
    in = noise_image(N, 19);
    out = noise_image(N, 20);
    l.device = new_device();
    l.filter = new_identity(l.device, in, out, W, H);
    l.done = false;
    pthread_mutex_init(&l.mutex, NULL);
    pthread_cond_init(&l.over, NULL);
    oidnSetFilterProgressMonitorFunction(l.filter, let_go, &l);
    oidnExecuteFilterAsync(l.filter);
    pthread_mutex_lock(&l.mutex);
    while (!l.done)
        pthread_cond_wait(&l.over, &l.mutex);
    pthread_mutex_unlock(&l.mutex);
    usleep(100000); /* for the threads to end before a leak checker looks */
    CHECK(difference(in, out, N) < 1e-3f);
    free(in);
    free(out);
}

#endif

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(async_order);
    RUN(async_many);
    RUN(async_changes);
    RUN(release_orders);
    RUN(release_waits);
    RUN(progress_calls);
    RUN(progress_cancel);
    RUN(cancel_is_told_once);
    RUN(progress_calls_back);
#if LULL_WITH_THREADS
    RUN(progress_releases_all);
#endif
    free_identity();
    return check_report();
}
