/* Ensembles: the mean of what a filter makes of a frame upright and turned. Open Image Denoise has
 * nothing like it, so all of this is skipped there. */
#define _GNU_SOURCE /* setenv */
#include "api.h"

#include "OpenImageDenoise/lull_quality.h"

#define OURS()                                                                                     \
    do {                                                                                           \
        OURS_ALONE("has no ensembles");                                                            \
        WANTS_BUILTIN();                                                                           \
    } while (0)

enum { W = 61, H = 43, VALUES = 3 * W * H };

static float color[VALUES], albedo[VALUES], normal[VALUES], result[VALUES], expected[VALUES];

/* ---- Frames ---------------------------------------------------------------------------------- */

static void fill_inputs(unsigned seed)
{
    fill_frame(color, albedo, normal, W, H, seed);
}

/* Columns of a frame after so many quarter turns. */
static size_t columns(unsigned turns) { return turns & 1 ? H : W; }

/* Index of the pixel that pixel (x, y) of the turned frame is. */
static size_t source_of(size_t x, size_t y, unsigned turns)
{
    switch (turns) {
    case 1: return x * W + (W - 1 - y);
    case 2: return (H - 1 - y) * W + (W - 1 - x);
    case 3: return (H - 1 - x) * W + y;
    default: return y * W + x;
    }
}

static void turn(float *to, const float *from, unsigned turns)
{
    size_t i;

    for (i = 0; i < W * H; i++)
        memcpy(to + 3 * i,
               from + 3 * source_of(i % columns(turns), i / columns(turns), turns),
               3 * sizeof *to);
}

/* ---- Filters --------------------------------------------------------------------------------- */

static OIDNFilter new_upright(OIDNDevice device, const char *flags, float *output)
{
    return new_flagged(device, flags, (float *[]){color, albedo, normal}, output, W, H);
}

/* What an ensemble of n gives, made by hand of filters of one orientation, to `expected`. */
static void make_expected(OIDNDevice device, const char *flags, unsigned n)
{
    static float inputs[3][VALUES], output[VALUES];
    const float *const upright[3] = {color, albedo, normal};
    float *const turned[3] = {inputs[0], inputs[1], inputs[2]};
    unsigned turns;
    size_t i, c;

    for (turns = 0; turns < n; turns++) {
        OIDNFilter filter = new_flagged(device, flags, turned, output, columns(turns),
                                        W * H / columns(turns));

        for (i = 0; i < 3; i++)
            turn(inputs[i], upright[i], turns);
        run_filter(device, filter);
        oidnReleaseFilter(filter);
        for (i = 0; i < W * H; i++)
            for (c = 0; c < 3; c++) {
                float *to = &expected[3 * source_of(i % columns(turns), i / columns(turns), turns) +
                                      c];

                *to = (turns ? *to : 0) + output[3 * i + c] / (float)n;
            }
    }
}

static void expect_ensemble(OIDNDevice device, const char *flags, unsigned n)
{
    OIDNFilter filter = new_upright(device, flags, result);

    make_expected(device, flags, n);
    memset(result, 0x5a, sizeof result);
    oidnSetFilterInt(filter, "ensemble", (int)n);
    run_filter(device, filter);
    if (!CHECK(memcmp(result, expected, sizeof result) == 0))
        printf("  %s, %u\n", flags, n);
    oidnReleaseFilter(filter);
}

/* ---- Results --------------------------------------------------------------------------------- */

static void is_the_mean_of_orientations(void)
{
    static const char *const kinds[] = {"h", "", "s", "ha", "han", "an", "L", "Ld"};
    OIDNDevice device;
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(1);
    for (i = 0; i < COUNT(kinds); i++) {
        expect_ensemble(device, kinds[i], 1);
        expect_ensemble(device, kinds[i], 2);
        expect_ensemble(device, kinds[i], 4);
    }
    oidnReleaseDevice(device);
}

static void differs_from_one_orientation(void)
{
    OIDNDevice device;

    OURS();
    device = new_device();
    fill_inputs(2);
    make_expected(device, "han", 1);
    memcpy(result, expected, sizeof result);
    make_expected(device, "han", 2);
    CHECK(memcmp(result, expected, sizeof result) != 0);
    memcpy(result, expected, sizeof result);
    make_expected(device, "han", 4);
    CHECK(memcmp(result, expected, sizeof result) != 0);
    oidnReleaseDevice(device);
}

static void one_filter_may_change(void)
{
    static const int numbers[] = {1, 2, 4, 2, 1, 4, 1};
    OIDNDevice device;
    OIDNFilter filter;
    size_t i;

    OURS();
    device = new_device();
    filter = new_upright(device, "han", result);
    for (i = 0; i < COUNT(numbers); i++) {
        fill_inputs((unsigned)i + 3);
        make_expected(device, "han", (unsigned)numbers[i]);
        oidnSetFilterInt(filter, "ensemble", numbers[i]);
        CHECK_EQ(oidnGetFilterInt(filter, "ensemble"), numbers[i]);
        run_filter(device, filter);
        CHECK(memcmp(result, expected, sizeof result) == 0);
        oidnExecuteFilter(filter); /* and again */
        CHECK(memcmp(result, expected, sizeof result) == 0);
    }
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void same_on_all_threads_and_ports(void)
{
    static const struct {
        int threads;
        const char *ports;
    } rows[] = {{1, NULL}, {3, NULL}, {2, "scalar"}};
    OIDNDevice device;
    OIDNFilter filter;
    size_t i;

    OURS();
    fill_inputs(4);
    device = new_device();
    make_expected(device, "han", 4);
    oidnReleaseDevice(device);
    for (i = 0; i < COUNT(rows); i++) {
        if (rows[i].ports)
            setenv("LULL_PORTS", rows[i].ports, 1);
        device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
        oidnSetDeviceInt(device, "numThreads", rows[i].threads);
        oidnCommitDevice(device);
        filter = new_upright(device, "han", result);
        oidnSetFilterInt(filter, "ensemble", 4);
        run_filter(device, filter);
        CHECK(memcmp(result, expected, sizeof result) == 0);
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
        unsetenv("LULL_PORTS");
    }
}

/* ---- Images ---------------------------------------------------------------------------------- */

/* Pixels of seven floats in rows that are longer still, as a renderer has its layers; what lies
 * between them stays. */
static void images_may_have_strides(void)
{
    enum { STEP = 7, ROW = STEP * W + 5, ALL = ROW * H };
    static float block[ALL], before[ALL], output[ALL];
    OIDNDevice device;
    OIDNFilter filter;
    size_t i, c;

    OURS();
    device = new_device();
    fill_inputs(5);
    make_expected(device, "ha", 4);
    filter = oidnNewFilter(device, "RT");
    for (i = 0; i < ALL; i++)
        block[i] = before[i] = output[i] = (float)i;
    for (i = 0; i < W * H; i++)
        for (c = 0; c < 3; c++) {
            block[i / W * ROW + i % W * STEP + c] = color[3 * i + c];
            block[i / W * ROW + i % W * STEP + 3 + c] = albedo[3 * i + c];
        }
    memcpy(before, block, sizeof block);
    oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, STEP * sizeof(float),
                             ROW * sizeof(float));
    oidnSetSharedFilterImage(filter, "albedo", block, F3, W, H, 3 * sizeof(float),
                             STEP * sizeof(float), ROW * sizeof(float));
    oidnSetSharedFilterImage(filter, "output", output, F3, W, H, 2 * sizeof(float),
                             STEP * sizeof(float), ROW * sizeof(float));
    oidnSetFilterBool(filter, "hdr", true);
    oidnSetFilterInt(filter, "ensemble", 4);
    run_filter(device, filter);
    CHECK(memcmp(block, before, sizeof block) == 0);
    check_strided(output, expected, W, H, STEP, ROW);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* In the place of an input, and a pixel behind it. */
static void output_may_overlap_inputs(void)
{
    static float block[VALUES + 3];
    OIDNDevice device;
    size_t shift;

    OURS();
    device = new_device();
    fill_inputs(6);
    make_expected(device, "h", 2);
    for (shift = 0; shift <= 3; shift += 3) {
        OIDNFilter filter = new_upright(device, "h", block + shift);

        oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, 0, 0);
        oidnSetFilterInt(filter, "ensemble", 2);
        memcpy(block, color, sizeof color);
        run_filter(device, filter);
        CHECK(memcmp(block + shift, expected, sizeof expected) == 0);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* 1 if no half is nearer to the value. */
static int is_rounded(uint16_t half, float value)
{
    const int exponent = half >> 10 & 31, scale = exponent ? exponent : 1;
    const float found = ldexpf((float)(half & 1023) + (exponent ? 1024 : 0), scale - 25);

    return fabsf(found - value) <= ldexpf(1, scale - 26);
}

/* Sums are made in single precision, whatever the output has: what is rounded is their mean. */
static void half_outputs_are_rounded_once(void)
{
    static uint16_t half[VALUES];
    OIDNDevice device;
    OIDNFilter filter, narrow;
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(7);
    make_expected(device, "h", 4);
    filter = new_upright(device, "h", result);
    oidnSetSharedFilterImage(filter, "output", half, H3, W, H, 0, 0, 0);
    oidnSetFilterInt(filter, "ensemble", 4);
    run_filter(device, filter);
    for (i = 0; i < VALUES; i++)
        CHECK(is_rounded(half[i], expected[i]));
    oidnReleaseFilter(filter);
    narrow = oidnNewFilter(device, "RT"); /* grey ones */
    for (i = 0; i < W * H; i++)
        color[i] = color[3 * i];
    oidnSetSharedFilterImage(narrow, "color", color, F1, W, H, 0, 0, 0);
    oidnSetSharedFilterImage(narrow, "output", half, H1, W, H, 0, 0, 0);
    oidnSetFilterBool(narrow, "hdr", true);
    oidnSetFilterInt(narrow, "ensemble", 2);
    run_filter(device, narrow);
    oidnSetSharedFilterImage(narrow, "output", result, F1, W, H, 0, 0, 0);
    run_filter(device, narrow);
    for (i = 0; i < W * H; i++)
        CHECK(is_rounded(half[i], result[i]));
    oidnReleaseFilter(narrow);
    oidnReleaseDevice(device);
}

static void frames_may_be_thin_or_empty(void)
{
    OIDNDevice device;

    OURS();
    device = new_device();
    check_thin_frames(device, "ensemble", 4);
    oidnReleaseDevice(device);
}

/* ---- With other parameters ------------------------------------------------------------------- */

static void takes_one_two_or_four(void)
{
    static const int wrong[] = {0, 3, 5, 8, -1, 2147483647};
    OIDNDevice device;
    OIDNFilter filter;
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(8);
    make_expected(device, "h", 2);
    filter = new_upright(device, "h", result);
    CHECK_EQ(oidnGetFilterInt(filter, "ensemble"), 1);
    for (i = 0; i < COUNT(wrong); i++) {
        const char *text = NULL;

        oidnSetFilterInt(filter, "ensemble", wrong[i]);
        oidnCommitFilter(filter);
        CHECK_EQ(oidnGetDeviceError(device, &text), ARGUMENT);
        CHECK(text && strstr(text, "ensemble"));
        oidnExecuteFilter(filter);
        ERROR(device, OPERATION);
    }
    oidnSetFilterInt(filter, "ensemble", 2);
    run_filter(device, filter);
    CHECK(memcmp(result, expected, sizeof result) == 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void weights_may_be_the_callers(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    fill_inputs(9);
    filter = new_upright(device, "s", result);
    use_identity(filter, 3);
    oidnSetFilterInt(filter, "ensemble", 4);
    run_filter(device, filter);
    CHECK(difference(result, color, VALUES) < 1e-3f);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* A frame that is large enough for a sample, half of it flat: the quality is found once. */
static void goes_with_quality_auto(void)
{
    enum { SIDE = 384, ALL = 3 * SIDE * SIDE };
    static float large[ALL], outputs[2][ALL];
    unsigned state = 10;
    OIDNDevice device;
    size_t i, k;

    OURS();
    device = new_device();
    for (k = 0; k < 2; k++) {
        int used = 0;

        for (i = 0; i < ALL; i++)
            large[i] = k == 0                     ? 0.5f
                       : noise(&state) < 0.95f ? 0
                                               : 20 * noise(&state);
        for (i = 0; i < 2; i++) {
            OIDNFilter filter = new_upright(device, "h", result);

            oidnSetSharedFilterImage(filter, "color", large, F3, SIDE, SIDE, 0, 0, 0);
            oidnSetSharedFilterImage(filter, "output", outputs[i], F3, SIDE, SIDE, 0, 0, 0);
            oidnSetFilterInt(filter, "ensemble", 2);
            oidnSetFilterInt(filter, "quality", i ? used : LULL_QUALITY_AUTO);
            run_filter(device, filter);
            oidnExecuteFilter(filter);
            used = oidnGetFilterInt(filter, "usedQuality");
            CHECK_EQ(used, k ? OIDN_QUALITY_HIGH : OIDN_QUALITY_FAST);
            oidnReleaseFilter(filter);
        }
        CHECK(memcmp(outputs[0], outputs[1], sizeof outputs[0]) == 0);
    }
    oidnReleaseDevice(device);
}

static void memory_is_limited(void)
{
    enum { WIDE = 3000, HIGH = 40, ALL = 3 * WIDE * HIGH };
    static float large[ALL], free_result[ALL], limited[ALL];
    unsigned state = 11;
    OIDNDevice device;
    OIDNFilter filter;
    int least;
    size_t i;

    OURS();
    for (i = 0; i < ALL; i++)
        large[i] = noise(&state);
    device = new_device();
    filter = new_upright(device, "h", result);
    oidnSetSharedFilterImage(filter, "color", large, F3, WIDE, HIGH, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", free_result, F3, WIDE, HIGH, 0, 0, 0);
    oidnSetFilterInt(filter, "ensemble", 2);
    run_filter(device, filter);
    oidnSetSharedFilterImage(filter, "output", limited, F3, WIDE, HIGH, 0, 0, 0);
    least = least_megabytes(device, filter);
    oidnSetFilterInt(filter, "maxMemoryMB", least - 1);
    oidnCommitFilter(filter);
    ERROR(device, MEMORY);
    oidnSetFilterInt(filter, "maxMemoryMB", least);
    run_filter(device, filter);
    CHECK(memcmp(limited, free_result, sizeof limited) == 0);
    memset(limited, 0, sizeof limited);
    oidnSetFilterInt(filter, "maxMemoryMB", 0);
    run_filter(device, filter);
    CHECK(memcmp(limited, free_result, sizeof limited) == 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Progress -------------------------------------------------------------------------------- */

typedef struct watcher {
    double last, stop; /* cancels from `stop` on */
    int calls, went_back;
} watcher;

static bool watch(void *user, double fraction)
{
    watcher *w = user;

    w->went_back |= fraction < w->last;
    w->last = fraction;
    w->calls++;
    return fraction < w->stop;
}

static void progress_is_of_the_whole(void)
{
    static const double stops[] = {0, 0.1, 0.3, 0.6, 0.9};
    OIDNDevice device;
    OIDNFilter filter;
    watcher w = {0, 2, 0, 0};
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(12);
    make_expected(device, "han", 4);
    filter = new_upright(device, "han", result);
    oidnSetFilterInt(filter, "ensemble", 4);
    oidnSetFilterProgressMonitorFunction(filter, watch, &w);
    run_filter(device, filter);
    CHECK(w.last == 1 && !w.went_back && w.calls > 40);
    for (i = 0; i < COUNT(stops); i++) {
        watcher stopping = {0, stops[i], 0, 0};

        oidnSetFilterProgressMonitorFunction(filter, watch, &stopping);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, CANCELLED);
        oidnSetFilterProgressMonitorFunction(filter, NULL, NULL); /* and then as ever */
        run_filter(device, filter);
        CHECK(memcmp(result, expected, sizeof result) == 0);
    }
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(is_the_mean_of_orientations);
    RUN(differs_from_one_orientation);
    RUN(one_filter_may_change);
    RUN(same_on_all_threads_and_ports);
    RUN(images_may_have_strides);
    RUN(output_may_overlap_inputs);
    RUN(half_outputs_are_rounded_once);
    RUN(frames_may_be_thin_or_empty);
    RUN(takes_one_two_or_four);
    RUN(weights_may_be_the_callers);
    RUN(goes_with_quality_auto);
    RUN(memory_is_limited);
    RUN(progress_is_of_the_whole);
    free_identity();
    return check_report();
}
