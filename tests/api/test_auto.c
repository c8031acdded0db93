/* Quality `auto`: which model a frame gets, and that the frame then is what that model makes of it.
 * Open Image Denoise has nothing like it, so all of this is skipped there. */
#define _GNU_SOURCE /* setenv */
#include "api.h"

#include "OpenImageDenoise/lull_quality.h"

#define OURS()                                                                                     \
    do {                                                                                           \
        OURS_ALONE("has no quality 'auto'");                                                       \
        WANTS_BUILTIN();                                                                           \
    } while (0)

#define FAST OIDN_QUALITY_FAST
#define BALANCED OIDN_QUALITY_BALANCED
#define HIGH OIDN_QUALITY_HIGH
#define AUTO LULL_QUALITY_AUTO

/* Not many pixels more than the smallest frame that is sampled. */
enum { W = 371, H = 366, VALUES = 3 * W * H };

static float color[VALUES], albedo[VALUES], normal[VALUES], result[VALUES], expected[VALUES];

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Nothing to remove: all models give it back. */
static void fill_smooth(float *to, float level)
{
    size_t i;

    for (i = 0; i < VALUES; i++)
        to[i] = level * (0.3f + 0.4f * (float)(i / 3 / W) / H);
}

/* Black with bright pixels here and there: no two models make the same of it. */
static void fill_hard(float *to, float level)
{
    unsigned state = 7;
    size_t i;

    for (i = 0; i < VALUES; i++)
        to[i] = noise(&state) < 0.95f ? 0 : level * 20 * noise(&state);
}

static void fill_inputs(void (*fill)(float *to, float level), float level)
{
    fill(color, level);
    fill(albedo, 1);
    fill(normal, 1);
}

/* ---- Filters --------------------------------------------------------------------------------- */

static OIDNFilter new_filter(OIDNDevice device, const char *flags, float *output, int quality)
{
    OIDNFilter filter =
        new_flagged(device, flags, (float *[]){color, albedo, normal}, output, W, H);

    oidnSetFilterInt(filter, "quality", quality);
    ERROR(device, NONE);
    return filter;
}

static int used(OIDNFilter filter) { return oidnGetFilterInt(filter, "usedQuality"); }

/* The frame as a filter of this quality makes it. */
static void run(OIDNDevice device, const char *flags, float *output, int quality)
{
    OIDNFilter filter = new_filter(device, flags, output, quality);

    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    if (quality != AUTO)
        CHECK_EQ(used(filter), quality);
    oidnReleaseFilter(filter);
}

/* Executes a filter of quality `auto`: it takes `quality` and gives what that would give. */
static void execute_and_compare(OIDNDevice device, OIDNFilter filter, const char *flags,
                                int quality)
{
    memset(result, 0x5a, sizeof result);
    run(device, flags, expected, quality);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK_EQ(used(filter), quality);
    CHECK(memcmp(result, expected, sizeof result) == 0);
}

static void expect_quality(OIDNDevice device, const char *flags, int quality)
{
    OIDNFilter filter = new_filter(device, flags, result, AUTO);

    oidnCommitFilter(filter);
    ERROR(device, NONE);
    execute_and_compare(device, filter, flags, quality);
    oidnReleaseFilter(filter);
}

/* ---- Which model ----------------------------------------------------------------------------- */

static void takes_what_the_frame_needs(void)
{
    static const char *const kinds[] = {"h", "", "s", "han", "L", "Ld"};
    OIDNDevice device;
    size_t i;

    OURS();
    device = new_device();
    for (i = 0; i < COUNT(kinds); i++) {
        fill_inputs(fill_smooth, 1);
        expect_quality(device, kinds[i], FAST);
        fill_inputs(fill_hard, 1);
        expect_quality(device, kinds[i], HIGH);
    }
    oidnReleaseDevice(device);
}

/* Models that agree about a frame as it is displayed need not agree about one that is brighter:
 * what decides is the scale of the whole frame, measured as for every other quality. */
static void scale_is_that_of_the_frame(void)
{
    static const char *const kinds[] = {"h", "L"};
    OIDNDevice device;
    OIDNFilter filter;
    size_t i, k;

    OURS();
    device = new_device();
    for (i = 0; i < COUNT(kinds); i++) {
        fill_inputs(fill_hard, 1e-6f);
        expect_quality(device, kinds[i], HIGH); /* by itself it is exposed to be seen */
        filter = new_filter(device, kinds[i], result, AUTO);
        oidnSetFilterFloat(filter, "inputScale", 1);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK_EQ(used(filter), HIGH); /* a scale that would hide it is not taken */
        oidnReleaseFilter(filter);
        for (k = 0; k < VALUES; k++)
            color[k] = k / 3 % W < W / 2 ? 1 : color[k];
        expect_quality(device, kinds[i], FAST); /* black beside the rest of the frame */
    }
    oidnReleaseDevice(device);
}

static void content_may_change(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    filter = new_filter(device, "h", result, AUTO);
    oidnCommitFilter(filter);
    CHECK_EQ(used(filter), OIDN_QUALITY_DEFAULT);
    fill_inputs(fill_smooth, 1);
    execute_and_compare(device, filter, "h", FAST);
    fill_inputs(fill_hard, 1);
    execute_and_compare(device, filter, "h", HIGH);
    fill_inputs(fill_smooth, 1);
    execute_and_compare(device, filter, "h", FAST);
    oidnSetFilterInt(filter, "quality", BALANCED); /* and back again */
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "h", BALANCED);
    oidnSetFilterInt(filter, "quality", AUTO);
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "h", FAST);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void small_frames_are_not_sampled(void)
{
    static const struct {
        size_t width, height;
        int quality;
    } rows[] = {
        {W, H, FAST}, {W, 100, HIGH}, {60, H, HIGH}, {W, 330, HIGH}, {1, 1, HIGH}, {0, 0, 0},
    };
    OIDNDevice device;
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(fill_smooth, 1);
    for (i = 0; i < COUNT(rows); i++) {
        OIDNFilter filter = new_filter(device, "h", result, AUTO);

        oidnSetSharedFilterImage(filter, "color", color, F3, rows[i].width, rows[i].height, 0, 0,
                                 0);
        oidnSetSharedFilterImage(filter, "output", result, F3, rows[i].width, rows[i].height, 0, 0,
                                 0);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        if (!CHECK_EQ(used(filter), rows[i].quality))
            printf("  row %u\n", (unsigned)i);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* With weights of the caller there is one model. */
static void user_weights_are_used(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    fill_inputs(fill_smooth, 1);
    filter = new_filter(device, "s", result, AUTO);
    use_identity(filter, 3);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK_EQ(used(filter), HIGH);
    CHECK(difference(result, color, VALUES) < 1e-3f);
    oidnUnsetFilterData(filter, "weights");
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "s", FAST);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Whatever runs it ------------------------------------------------------------------------ */

static void same_on_all_threads_and_ports(void)
{
    static const struct {
        int threads;
        const char *ports;
    } rows[] = {{1, NULL}, {3, NULL}, {5, NULL}, {2, "scalar"}};
    OIDNDevice device;
    OIDNFilter filter;
    size_t i;
    int is_hard;

    OURS();
    for (i = 0; i < 2 * COUNT(rows); i++) {
        is_hard = i >= COUNT(rows);
        fill_inputs(is_hard ? fill_hard : fill_smooth, 1);
        device = new_device();
        run(device, "han", expected, is_hard ? HIGH : FAST);
        oidnReleaseDevice(device);
        if (rows[i % COUNT(rows)].ports)
            setenv("LULL_PORTS", rows[i % COUNT(rows)].ports, 1);
        device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
        oidnSetDeviceInt(device, "numThreads", rows[i % COUNT(rows)].threads);
        oidnCommitDevice(device);
        filter = new_filter(device, "han", result, AUTO);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK_EQ(used(filter), is_hard ? HIGH : FAST);
        CHECK(memcmp(result, expected, sizeof result) == 0);
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
        unsetenv("LULL_PORTS");
    }
}

/* Megabytes that high quality needs at least. */
static int least_of_high(OIDNDevice device, const char *flags)
{
    OIDNFilter filter = new_filter(device, flags, result, HIGH);
    const int megabytes = least_megabytes(device, filter);

    oidnReleaseFilter(filter);
    return megabytes;
}

/* What `auto` takes of a smooth frame with the least memory for high quality. */
static int used_with_least(OIDNDevice device, const char *flags)
{
    OIDNFilter filter = new_filter(device, flags, result, AUTO);
    int quality;

    oidnSetFilterInt(filter, "maxMemoryMB", least_of_high(device, flags));
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    quality = used(filter);
    oidnReleaseFilter(filter);
    return quality;
}

/* All models and the sample count. Where there is no room for them, a frame is denoised as by high
 * quality, which needs no more than ever. */
static void memory_is_limited(void)
{
    static const char *const kinds[] = {"h", "han", "ha", "", "an", "a"};
    OIDNDevice device;
    OIDNFilter filter;
    int limit, least, quality = FAST, without_sample = 0;

    OURS();
    device = new_device();
    fill_inputs(fill_smooth, 1);
    least = least_of_high(device, "h");
    for (limit = least + 8; limit >= least; limit--) {
        filter = new_filter(device, "h", result, AUTO);
        oidnSetFilterInt(filter, "maxMemoryMB", limit);
        oidnCommitFilter(filter);
        ERROR(device, NONE);
        oidnExecuteFilter(filter);
        if (used(filter) != FAST)
            quality = HIGH; /* from here on */
        execute_and_compare(device, filter, "h", quality);
        if (limit == least + 8)
            CHECK_EQ(quality, FAST);
        oidnReleaseFilter(filter);
    }
    /* Limits are rounded up: of one kind or the other there is room for a small sample. */
    for (size_t i = 0; i < COUNT(kinds); i++)
        without_sample += used_with_least(device, kinds[i]) == HIGH;
    CHECK(without_sample > 0);
    filter = new_filter(device, "h", result, AUTO);
    oidnSetFilterInt(filter, "maxMemoryMB", least - 1);
    oidnCommitFilter(filter);
    ERROR(device, MEMORY);
    oidnSetFilterInt(filter, "maxMemoryMB", 0);
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "h", HIGH);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* The output in the place of the input, and a pixel behind it, where it needs a copy. */
static void in_place(void)
{
    static float block[VALUES + 3];
    OIDNDevice device;
    size_t shift;

    OURS();
    device = new_device();
    for (shift = 0; shift <= 3; shift += 3) {
        OIDNFilter filter = new_filter(device, "h", result, AUTO);

        oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", block + shift, F3, W, H, 0, 0, 0);
        oidnCommitFilter(filter);
        fill_inputs(fill_smooth, 1);
        run(device, "h", expected, FAST);
        memcpy(block, color, sizeof color);
        oidnExecuteFilter(filter);
        CHECK_EQ(used(filter), FAST);
        CHECK(memcmp(block + shift, expected, sizeof expected) == 0);
        fill_inputs(fill_hard, 1);
        run(device, "h", expected, HIGH);
        memcpy(block, color, sizeof color);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK_EQ(used(filter), HIGH);
        CHECK(memcmp(block + shift, expected, sizeof expected) == 0);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* Executions queue up; each looks at the frame as it finds it. */
static void in_the_background(void)
{
    OIDNDevice device;
    OIDNFilter first, second;

    OURS();
    device = new_device();
    fill_inputs(fill_hard, 1);
    first = new_filter(device, "h", color, AUTO); /* in place */
    second = new_filter(device, "h", result, AUTO);
    oidnCommitFilter(first);
    oidnCommitFilter(second);
    oidnExecuteFilterAsync(second); /* of the noise */
    oidnExecuteFilterAsync(first);  /* takes the noise away */
    oidnSyncDevice(device);
    ERROR(device, NONE);
    CHECK_EQ(used(first), HIGH);
    CHECK_EQ(used(second), HIGH);
    CHECK(memcmp(color, result, sizeof result) == 0);
    fill_inputs(fill_smooth, 1);
    oidnExecuteFilterAsync(second);
    oidnCommitFilter(second); /* nothing changed: may be done meanwhile */
    oidnExecuteFilterAsync(second);
    oidnReleaseFilter(first);
    oidnSyncDevice(device);
    ERROR(device, NONE);
    CHECK_EQ(used(second), FAST);
    oidnReleaseFilter(second);
    oidnReleaseDevice(device);
}

/* ---- Progress -------------------------------------------------------------------------------- */

typedef struct watch {
    double last, stop_at; /* fraction told last; the one to cancel at */
    unsigned calls, backwards;
} watch;

static bool on_progress(void *user, double n)
{
    watch *w = user;

    w->backwards += n < w->last || n > 1;
    w->last = n;
    w->calls++;
    return n < w->stop_at;
}

static void progress_and_cancel(void)
{
    static const double stops[] = {0, 1e-6, 0.02, 0.06, 0.5};
    OIDNDevice device;
    OIDNFilter filter;
    watch w = {0, 2, 0, 0};
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(fill_smooth, 1);
    filter = new_filter(device, "h", result, AUTO);
    oidnSetFilterProgressMonitorFunction(filter, on_progress, &w);
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "h", FAST);
    CHECK(w.last == 1 && w.calls > 20 && !w.backwards);
    fill_inputs(fill_hard, 1);
    for (i = 0; i < COUNT(stops); i++) {
        memset(&w, 0, sizeof w);
        w.stop_at = stops[i];
        oidnExecuteFilter(filter);
        ERROR(device, CANCELLED);
        CHECK_EQ(used(filter), FAST); /* of the last one that was completed */
        CHECK(w.last < 0.6 && !w.backwards);
    }
    w.stop_at = 2;
    w.last = 0;
    execute_and_compare(device, filter, "h", HIGH);
    CHECK(w.last == 1 && !w.backwards);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Parameters ------------------------------------------------------------------------------ */

static void parameters(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    fill_inputs(fill_smooth, 1);
    filter = new_filter(device, "h", result, AUTO);
    CHECK_EQ(oidnGetFilterInt(filter, "quality"), AUTO);
    oidnSetFilterInt(filter, "quality", AUTO + 1);
    ERROR(device, ARGUMENT);
    oidnSetFilterInt(filter, "quality", AUTO - 1);
    ERROR(device, ARGUMENT);
    CHECK_EQ(oidnGetFilterInt(filter, "quality"), AUTO);
    oidnSetFilterInt(filter, "usedQuality", FAST); /* read only */
    ERROR(device, NONE);
    CHECK_EQ(used(filter), OIDN_QUALITY_DEFAULT);
    CHECK(oidnGetFilterFloat(filter, "usedQuality") == 0);
    ERROR(device, ARGUMENT);
    oidnExecuteFilter(filter); /* not committed */
    ERROR(device, OPERATION);
    oidnSetFilterBool(filter, "srgb", true); /* with hdr */
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnSetFilterBool(filter, "srgb", false);
    oidnCommitFilter(filter);
    execute_and_compare(device, filter, "h", FAST);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(takes_what_the_frame_needs);
    RUN(scale_is_that_of_the_frame);
    RUN(content_may_change);
    RUN(small_frames_are_not_sampled);
    RUN(user_weights_are_used);
    RUN(same_on_all_threads_and_ports);
    RUN(memory_is_limited);
    RUN(in_place);
    RUN(in_the_background);
    RUN(progress_and_cancel);
    RUN(parameters);
    free_identity();
    return check_report();
}
