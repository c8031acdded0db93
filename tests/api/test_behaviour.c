/* What executions do: order, progress, cancelling, overlapping images, memory limits, threads, lifetimes,
 * environment variables, processes. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* setenv, fork */
#endif
#include "api.h"

#include <stdint.h>
#include <sys/wait.h>
#include <unistd.h>

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 1
#endif
#if LULL_WITH_THREADS
#include <pthread.h>
#endif

#if defined(__SANITIZE_THREAD__)
#define UNDER_TSAN 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define UNDER_TSAN 1
#endif
#endif
#ifndef UNDER_TSAN
#define UNDER_TSAN 0
#endif

#define COUNT(array) (sizeof(array) / sizeof *(array))
#define F3 OIDN_FORMAT_FLOAT3

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* Largest difference of two float images. */
static float difference(const float *a, const float *b, size_t n)
{
    float most = 0;
    size_t i;

    for (i = 0; i < n; i++)
        if (!(fabsf(a[i] - b[i]) <= most))
            most = fabsf(a[i] - b[i]);
    return most;
}

/* ---- Order -------------------------------------------------------------------------------------- */

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
    float *in = noise_image(N, 5), *a = noise_image(N, 6), *b = noise_image(N, 7), *c = noise_image(N, 8);
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

/* ---- Lifetimes ---------------------------------------------------------------------------------- */

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

/* ---- Progress ----------------------------------------------------------------------------------- */

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

static void progress_calls(void)
{
    static const int limits[] = {-1, 0};
    enum { SIZE = 512 };
    OIDNDevice device = new_device();
    float *in = noise_image(3 * SIZE * SIZE, 11), *out = noise_image(3 * SIZE * SIZE, 12);
    OIDNFilter filter = new_identity(device, in, out, SIZE, SIZE);
    size_t i;

    for (i = 0; i < COUNT(limits); i++) {
        watch w = new_watch(2);

        oidnSetFilterInt(filter, "maxMemoryMB", limits[i]);
        oidnSetFilterProgressMonitorFunction(filter, watch_progress, &w);
        oidnCommitFilter(filter);
        CHECK_EQ(w.calls, 0);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK(w.calls >= 20);
        CHECK(w.first == 0);
        CHECK(w.last == 1);
        CHECK_EQ(w.wrong, 0);
#if LULL_WITH_THREADS
        CHECK_EQ(w.on_caller, 0);
#endif
    }
    oidnReleaseFilter(filter);
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

/* A cancellation in the background is told at the next point that waits: sync, blocking execution or
 * copy, or a commit that makes a new plan. */
static void cancel_is_told_once(void)
{
    OIDNDevice device = new_device();
    float *in = noise_image(N, 15), *out = noise_image(N, 16);
    OIDNFilter filter = new_identity(device, in, out, W, H), other = new_identity(device, in, out, W, H);
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
        else if (i == 2)
            oidnReadBuffer(buffer, 0, 4, bytes);
        else {
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

/* ---- Calls from a progress function ------------------------------------------------------------- */

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

    if (is_peer()) {
        SKIP("optional: Open Image Denoise deadlocks");
        return;
    }
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

    if (is_peer()) {
        SKIP("optional: Open Image Denoise deadlocks");
        return;
    }
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

/* ---- Overlapping images ------------------------------------------------------------------------- */

/* Colour at `from`, output at `to` bytes into one block, with the given strides and formats; as raw
 * pointers or through buffers. Returns the output as floats. */
typedef struct overlap_row {
    size_t from, to;
    OIDNFormat in, out;
    size_t in_pixel, in_row, out_pixel, out_row;
} overlap_row;

static size_t pixel_bytes(OIDNFormat f) { return f == OIDN_FORMAT_FLOAT3 ? 12 : f == OIDN_FORMAT_HALF3 ? 6 : 4; }

static void run_overlap(OIDNDevice device, const overlap_row *row, char *block, size_t bytes, char *apart,
                        int through_buffer, int memory)
{
    OIDNFilter filter = oidnNewFilter(device, "RT");
    OIDNBuffer a = oidnNewSharedBuffer(device, block, bytes), b = oidnNewSharedBuffer(device, block, bytes);

    use_identity(filter, 3);
    oidnSetFilterBool(filter, "srgb", true);
    oidnSetFilterInt(filter, "maxMemoryMB", memory);
    if (through_buffer)
        oidnSetFilterImage(filter, "color", a, row->in, W, H, row->from, row->in_pixel, row->in_row);
    else
        oidnSetSharedFilterImage(filter, "color", block, row->in, W, H, row->from, row->in_pixel,
                                 row->in_row);
    if (apart)
        oidnSetSharedFilterImage(filter, "output", apart, row->out, W, H, row->to, row->out_pixel,
                                 row->out_row);
    else
        oidnSetFilterImage(filter, "output", b, row->out, W, H, row->to, row->out_pixel, row->out_row);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseBuffer(a);
    oidnReleaseBuffer(b);
}

static void in_place(void)
{
    enum { H3 = OIDN_FORMAT_HALF3, ROW = 12 * W, BYTES = 3 * 16 * W * H };
    static const overlap_row rows[] = {
        {0, 0, F3, F3, 0, 0, 0, 0},              /* exactly */
        {0, 0, F3, F3, 16, 0, 16, 0},            /* with gaps between pixels */
        {0, 0, F3, F3, 0, 2 * ROW, 0, 2 * ROW},  /* and between rows */
        {0, 12, F3, F3, 0, 0, 0, 0},             /* shifted by a pixel */
        {12, 0, F3, F3, 0, 0, 0, 0},
        {0, 40 * ROW, F3, F3, 0, 0, 0, 0},       /* by rows */
        {40 * ROW, 0, F3, F3, 0, 0, 0, 0},
        {0, 0, F3, F3, 0, 0, 16, 0},             /* other strides */
        {0, 0, F3, F3, 16, 0, 0, 0},
        {0, 0, F3, F3, 0, 2 * ROW, 0, 0},
        {0, 0, F3, F3, 0, 0, 0, 2 * ROW},
        {0, 0, F3, (OIDNFormat)H3, 0, 0, 12, 0}, /* other formats */
        {0, 0, F3, (OIDNFormat)H3, 0, 0, 0, 0},
        {0, 0, (OIDNFormat)H3, F3, 0, 0, 0, 0},
        {0, 12, F3, F3, 24, 0, 24, 0},           /* interleaved: bytes overlap, pixels do not */
    };
    OIDNDevice device = new_device();
    char *block = malloc(BYTES), *input = malloc(BYTES), *apart = malloc(BYTES);
    unsigned seed = 21;
    size_t i, x, y;
    int k;

    for (i = 0; i < BYTES / 4; i++) { /* valid as floats and as pairs of halves */
        const uint32_t v = 0x38003800u + ((uint32_t)(noise(&seed) * 1000) << 16) +
                           (uint32_t)(noise(&seed) * 1000);

        memcpy(input + 4 * i, &v, 4);
    }
    for (i = 0; i < COUNT(rows); i++)
        for (k = 0; k < 4; k++) {
            const overlap_row *row = &rows[i];
            const size_t pixel = row->out_pixel ? row->out_pixel : pixel_bytes(row->out);
            const size_t line = row->out_row ? row->out_row : W * pixel;
            unsigned wrong = 0;

            memcpy(block, input, BYTES);
            memset(apart, 0, BYTES);
            run_overlap(device, row, block, BYTES, apart, k & 1, k & 2 ? 0 : -1);
            CHECK(!memcmp(block, input, BYTES));
            run_overlap(device, row, block, BYTES, NULL, k & 1, k & 2 ? 0 : -1);
            for (y = 0; y < H; y++)
                for (x = 0; x < W; x++) {
                    const size_t at = row->to + y * line + x * pixel;

                    wrong += memcmp(block + at, apart + at, pixel_bytes(row->out)) != 0;
                }
            if (!CHECK_EQ(wrong, 0))
                printf("  row %u, variant %d\n", (unsigned)i, k);
        }
    oidnReleaseDevice(device);
    free(block);
    free(input);
    free(apart);
}

/* Bytes between pixels, between rows and around the image stay as they are. */
static void padding_untouched(void)
{
    enum { PIXEL = 21, ROW = PIXEL * W + 13, BYTES = 100 + ROW * H + 100 };
    OIDNDevice device = new_device();
    float *in = noise_image(N, 22);
    unsigned char *out = malloc(BYTES);
    OIDNFilter filter = new_identity(device, in, in, W, H);
    unsigned touched = 0, wrong = 0;
    size_t i;

    memset(out, 0xa5, BYTES);
    oidnSetSharedFilterImage(filter, "output", out, F3, W, H, 100, PIXEL, ROW);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    for (i = 0; i < BYTES; i++) {
        const size_t at = i - 100, x = at % ROW / PIXEL;
        const int inside = i >= 100 && at < (size_t)ROW * H && x < W && at % ROW % PIXEL < 12;

        if (!inside)
            touched += out[i] != 0xa5;
        else if (at % ROW % PIXEL % 4 == 0) {
            float v;

            memcpy(&v, out + i, 4);
            wrong += fabsf(v - in[3 * (at / ROW * W + x) + at % ROW % PIXEL / 4]) > 1e-3f;
        }
    }
    CHECK_EQ(touched, 0);
    CHECK_EQ(wrong, 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(in);
    free(out);
}

/* ---- Memory limit ------------------------------------------------------------------------------- */

/* A limit that cannot be met is an error that names what could; from there on commits succeed, and every
 * limit gives the same bytes. */
static void memory_limit(void)
{
    enum { WIDTH = 700, HEIGHT = 9 };
    OIDNDevice device;
    float *in, *out, *first;
    OIDNFilter filter;
    size_t bytes;
    void *data;
    const char *text;
    unsigned long long floor_bytes = 0;
    int mb, refused = 0, accepted = 0;

    if (is_peer()) {
        SKIP("optional: Open Image Denoise takes maxMemoryMB as a wish");
        return;
    }
    device = new_device();
    in = noise_image(3 * WIDTH * HEIGHT, 23);
    out = noise_image(3 * WIDTH * HEIGHT, 24);
    first = noise_image(3 * WIDTH * HEIGHT, 25);
    data = identity_weights(3, 64, 0, &bytes);
    filter = new_identity(device, in, first, WIDTH, HEIGHT);
    oidnSetSharedFilterData(filter, "weights", data, bytes);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnSetSharedFilterImage(filter, "output", out, F3, WIDTH, HEIGHT, 0, 0, 0);
    for (mb = 0; mb < 200; mb += mb < 12 ? 1 : 94) {
        OIDNError error;

        oidnSetFilterInt(filter, "maxMemoryMB", mb);
        oidnCommitFilter(filter);
        error = oidnGetDeviceError(device, &text);
        if (mb == 0 || floor_bytes)
            CHECK_EQ(error, mb == 0 || (unsigned long long)mb << 20 >= floor_bytes ? NONE : MEMORY);
        if (error == MEMORY) {
            const char *at = strstr(text, "at least ");

            refused++;
            if (CHECK(at != NULL))
                floor_bytes = strtoull(at + 9, NULL, 10);
            CHECK(floor_bytes > (unsigned long long)mb << 20 && floor_bytes < 20u << 20);
            oidnExecuteFilter(filter);
            ERROR(device, OPERATION);
            continue;
        }
        accepted++;
        memset(out, 0, 12 * WIDTH * HEIGHT);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK(!memcmp(out, first, 12 * WIDTH * HEIGHT));
    }
    CHECK(refused > 0);
    CHECK(accepted > 5);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(data);
    free(in);
    free(out);
    free(first);
}

/* ---- Threads ------------------------------------------------------------------------------------ */

static void thread_counts(void)
{
    float *in = noise_image(N, 26), *first = noise_image(N, 27), *out = noise_image(N, 28);
    int threads;

    for (threads = 1; threads <= 4; threads++) {
        OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
        OIDNFilter filter;

        oidnSetDeviceInt(device, "numThreads", threads);
        oidnSetDeviceBool(device, "setAffinity", threads == 2);
        oidnCommitDevice(device);
        filter = new_identity(device, in, threads == 1 ? first : out, W, H);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK(threads == 1 || !memcmp(first, out, N * sizeof(float)));
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
    }
    free(in);
    free(first);
    free(out);
}

#if LULL_WITH_THREADS

typedef struct job {
    OIDNDevice device;
    unsigned seed, failed;
} job;

/* Errors of this thread only; then some work on the shared device. */
static void *work_beside(void *user)
{
    job *j = user;
    float *in = noise_image(N, j->seed), *out = noise_image(N, j->seed + 1);
    OIDNFilter filter;
    int i;

    j->failed += oidnGetDeviceError(j->device, NULL) != NONE;
    oidnNewDeviceByID(-1);
    j->failed += oidnGetDeviceError(NULL, NULL) != ARGUMENT;
    filter = oidnNewFilter(j->device, "RT");
    use_identity(filter, 3);
    oidnSetFilterBool(filter, "srgb", true);
    for (i = 0; i < 6; i++) {
        const size_t height = H - (unsigned)i % 3;

        oidnSetSharedFilterImage(filter, "color", in, F3, W, height, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", out, F3, W, height, 0, 0, 0);
        oidnCommitFilter(filter);
        (i % 2 ? oidnExecuteFilterAsync : oidnExecuteFilter)(filter);
        oidnNewFilter(j->device, "*");
        oidnSyncDevice(j->device);
        j->failed += oidnGetDeviceError(j->device, NULL) != ARGUMENT;
        j->failed += oidnGetDeviceError(j->device, NULL) != NONE;
        j->failed += !(difference(in, out, 3 * W * height) < 1e-3f);
    }
    oidnReleaseFilter(filter);
    oidnNewFilter(j->device, "*"); /* left behind unread, for nobody else to see */
    free(in);
    free(out);
    return NULL;
}

static void threads_share_a_device(void)
{
    OIDNDevice device = new_device();
    pthread_t threads[4];
    job jobs[4];
    int i;

    identity(3);
    oidnNewFilter(device, "*");
    for (i = 0; i < 4; i++) {
        jobs[i].device = device;
        jobs[i].seed = 100 + 2 * (unsigned)i;
        jobs[i].failed = 0;
        pthread_create(&threads[i], NULL, work_beside, &jobs[i]);
    }
    for (i = 0; i < 4; i++) {
        pthread_join(threads[i], NULL);
        CHECK_EQ(jobs[i].failed, 0);
    }
    ERROR(device, ARGUMENT);
    oidnReleaseDevice(device);
}

static void *own_device(void *user)
{
    job *j = user;

    j->device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    oidnSetDeviceInt(j->device, "numThreads", 2);
    oidnCommitDevice(j->device);
    work_beside(j);
    oidnReleaseDevice(j->device);
    return NULL;
}

static void devices_side_by_side(void)
{
    pthread_t threads[3];
    job jobs[3];
    int i;

    identity(3);
    for (i = 0; i < 3; i++) {
        jobs[i].seed = 200 + 2 * (unsigned)i;
        jobs[i].failed = 0;
        pthread_create(&threads[i], NULL, own_device, &jobs[i]);
    }
    for (i = 0; i < 3; i++) {
        pthread_join(threads[i], NULL);
        CHECK_EQ(jobs[i].failed, 0);
    }
}

/* More threads with unread errors than a device keeps. */
static void *leave_error(void *user)
{
    oidnNewFilter(user, "*");
    return NULL;
}

static void errors_of_many_threads(void)
{
    OIDNDevice device = new_device();
    pthread_t thread;
    int i;

    for (i = 0; i < 600; i++) {
        pthread_create(&thread, NULL, leave_error, device);
        pthread_join(thread, NULL);
    }
    ERROR(device, NONE);
    leave_error(device);
    ERROR(device, ARGUMENT);
    oidnReleaseDevice(device);
}

#endif

/* ---- Environment and processes ------------------------------------------------------------------ */

/* Runs a check in a child process with a variable set. Returns its exit status, 0 if all is well. */
static int in_child(const char *name, const char *value, int (*check)(void))
{
    int status = -1;
    pid_t pid;

    fflush(stdout);
    pid = fork();
    if (pid == 0) {
        if (name)
            setenv(name, value, 1);
        _exit(check());
    }
    if (pid < 0 || waitpid(pid, &status, 0) != pid || !WIFEXITED(status))
        return -1;
    return WEXITSTATUS(status);
}

static int one_thread(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int ok = oidnGetDeviceInt(device, "numThreads") == 1;

    oidnSetDeviceInt(device, "numThreads", 2);
    ok &= oidnGetDeviceInt(device, "numThreads") == 1;
    oidnCommitDevice(device);
    ok &= oidnGetDeviceInt(device, "numThreads") == 1;
    ok &= oidnGetDeviceError(device, NULL) == NONE;
    oidnReleaseDevice(device);
    return !ok;
}

static int no_affinity(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    int ok = !oidnGetDeviceBool(device, "setAffinity");

    oidnSetDeviceBool(device, "setAffinity", true);
    ok &= !oidnGetDeviceBool(device, "setAffinity");
    oidnReleaseDevice(device);
    return !ok;
}

static int verbose_two(void)
{
    OIDNDevice device;
    int ok;

    if (!freopen("/dev/null", "w", stdout))
        return 2;
    device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    ok = oidnGetDeviceInt(device, "verbose") == 2;
    oidnSetDeviceInt(device, "verbose", 0);
    ok &= oidnGetDeviceInt(device, "verbose") == 2;
    oidnCommitDevice(device);
    ok &= oidnGetDeviceError(device, NULL) == NONE;
    oidnReleaseDevice(device);
    return !ok;
}

static int no_cpu(void)
{
    int ok = oidnGetNumPhysicalDevices() == 0 && !oidnIsCPUDeviceSupported();

    ok &= !oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT) && oidnGetDeviceError(NULL, NULL) == HARDWARE;
    ok &= !oidnNewDevice(OIDN_DEVICE_TYPE_CPU) && oidnGetDeviceError(NULL, NULL) == HARDWARE;
    ok &= !oidnNewDeviceByID(0) && oidnGetDeviceError(NULL, NULL) == ARGUMENT;
    return !ok;
}

static int default_device(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_DEFAULT);
    int ok = device && oidnGetDeviceInt(device, "type") == OIDN_DEVICE_TYPE_CPU;

    if (device)
        oidnReleaseDevice(device);
    return !ok;
}

static void environment(void)
{
    static const char *const defaults[] = {"cpu", "CPU", "0", "cuda", "7", "nonsense", ""};
    size_t i;

    CHECK_EQ(in_child("OIDN_NUM_THREADS", "1", one_thread), 0);
    CHECK_EQ(in_child("OIDN_SET_AFFINITY", "0", no_affinity), 0);
    CHECK_EQ(in_child("OIDN_VERBOSE", "2", verbose_two), 0);
    for (i = 0; i < COUNT(defaults); i++)
        CHECK_EQ(in_child("OIDN_DEFAULT_DEVICE", defaults[i], default_device), 0);
    if (!is_peer()) /* reads this once per process, which is too late here */
        CHECK_EQ(in_child("OIDN_DEVICE_CPU", "0", no_cpu), 0);
}

/* A device made before a fork works in the child, too, and in the parent afterwards. */
static struct {
    OIDNDevice device;
    OIDNFilter filter;
    float *in, *out;
} forked;

static int run_forked(void)
{
    int ok;

    memset(forked.out, 0, N * sizeof(float));
    oidnExecuteFilterAsync(forked.filter);
    oidnExecuteFilter(forked.filter);
    ok = oidnGetDeviceError(forked.device, NULL) == NONE;
    ok &= difference(forked.in, forked.out, N) < 1e-3f;
    return !ok;
}

static int release_forked(void)
{
    oidnReleaseFilter(forked.filter);
    oidnReleaseDevice(forked.device);
    return 0;
}

static int run_and_release_forked(void) { return run_forked() || release_forked(); }

static void fork_and_go_on(void)
{
    if (is_peer()) {
        SKIP("optional: Open Image Denoise hangs in forked children");
        return;
    }
    if (UNDER_TSAN) {
        SKIP("optional: the thread sanitizer allows no threads in forked children");
        return;
    }
    forked.device = new_device();
    forked.in = noise_image(N, 29);
    forked.out = noise_image(N, 30);
    forked.filter = new_identity(forked.device, forked.in, forked.out, W, H);
    CHECK_EQ(run_forked(), 0);
    CHECK_EQ(in_child(NULL, NULL, run_and_release_forked), 0);
    CHECK_EQ(in_child(NULL, NULL, release_forked), 0);
    CHECK_EQ(run_forked(), 0);
    release_forked();
    free(forked.in);
    free(forked.out);
}

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
    RUN(in_place);
    RUN(padding_untouched);
    RUN(memory_limit);
    RUN(thread_counts);
#if LULL_WITH_THREADS
    RUN(progress_releases_all);
    RUN(threads_share_a_device);
    RUN(devices_side_by_side);
    RUN(errors_of_many_threads);
#endif
    RUN(environment);
    RUN(fork_and_go_on);
    free_identity();
    return check_report();
}
