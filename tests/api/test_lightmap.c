/* Light maps with normals: charts are told apart by them, and do not darken where they end. In Open
 * Image Denoise light maps have a colour alone, so all of this is skipped there. */
#include "api.h"

#define OURS()                                                                                     \
    do {                                                                                           \
        OURS_ALONE("has no normals of light maps");                                                \
        WANTS_BUILTIN();                                                                           \
    } while (0)

/* Two charts, and GAP columns of no surface between and around them. */
enum { W = 92, H = 50, VALUES = 3 * W * H, GAP = 4, CHART = (W - 3 * GAP) / 2 };

static float light[VALUES], normal[VALUES], result[VALUES], expected[VALUES];

/* Column of a chart that is nearest to x. */
static int nearest(int x)
{
    const int second = 2 * GAP + CHART;
    const int begin = x < second - GAP / 2 ? GAP : second;

    return x < begin ? begin : x >= begin + CHART ? begin + CHART - 1 : x;
}

/* Noise in the charts, and `outside` elsewhere; they face upwards and to the right. */
static void fill_inputs(unsigned seed, float outside)
{
    int i, c;

    for (i = 0; i < W * H; i++) {
        const int x = i % W, is_inside = nearest(x) == x;

        for (c = 0; c < 3; c++) {
            const float value = noise(&seed);

            light[3 * i + c] = is_inside ? (x < W / 2 ? value : 0.2f * value) : outside;
            normal[3 * i + c] = is_inside && c == (x < W / 2 ? 2 : 0);
        }
    }
}

/* The light by hand as it shall be denoised. */
static void fill_texels(void)
{
    int i;

    for (i = 0; i < W * H; i++)
        memcpy(light + 3 * i, light + 3 * (i - i % W + nearest(i % W)), 3 * sizeof *light);
}

static OIDNFilter new_lightmap(OIDNDevice device, const char *flags, float *output)
{
    return new_flagged(device, flags, (float *[]){light, NULL, normal}, output, W, H);
}

static void run(OIDNDevice device, const char *flags, int ensemble, float *output)
{
    OIDNFilter filter = new_lightmap(device, flags, output);

    oidnSetFilterInt(filter, "ensemble", ensemble);
    run_filter(device, filter);
    oidnReleaseFilter(filter);
}

/* ---- Results --------------------------------------------------------------------------------- */

static void what_is_outside_of_charts_does_not_matter(void)
{
    static const char *const kinds[] = {"Ln", "Lnd"};
    OIDNDevice device;
    size_t i;
    int n;

    OURS();
    device = new_device();
    for (i = 0; i < COUNT(kinds); i++)
        for (n = 1; n <= 4; n *= 2) {
            fill_inputs(1, 0);
            run(device, kinds[i], n, result);
            fill_texels();
            run(device, kinds[i], n, expected);
            if (!CHECK(memcmp(result, expected, sizeof result) == 0))
                printf("  %s, %d\n", kinds[i], n);
            fill_inputs(1, 7);
            run(device, kinds[i], n, result);
            CHECK(memcmp(result, expected, sizeof result) == 0);
        }
    oidnReleaseDevice(device);
}

/* Even light stays as it is, to the edges and beyond, where without normals it darkens. */
static void charts_do_not_darken_where_they_end(void)
{
    OIDNDevice device;
    int i, k;

    OURS();
    device = new_device();
    for (k = 0; k < 2; k++) {
        int wrong = 0;

        fill_inputs(2, 0);
        for (i = 0; i < VALUES; i++)
            light[i] = nearest(i / 3 % W) == i / 3 % W ? 0.5f : 0;
        run(device, k ? "Ln" : "L", 1, result);
        for (i = 0; i < VALUES; i++)
            wrong += fabs((double)result[i] - 0.5) > 1e-3;
        CHECK(k ? wrong == 0 : wrong > 0);
    }
    oidnReleaseDevice(device);
}

static void normals_are_seen(void)
{
    OIDNDevice device;

    OURS();
    device = new_device();
    fill_inputs(3, 0);
    fill_texels();
    run(device, "Ln", 1, result);
    run(device, "L", 1, expected);
    CHECK(memcmp(result, expected, sizeof result) != 0);
    oidnReleaseDevice(device);
}

/* ---- Images ---------------------------------------------------------------------------------- */

static void images_may_have_strides_and_halves(void)
{
    enum { STEP = 7, ROW = STEP * W + 5, ALL = ROW * H };
    static float block[ALL], output[ALL];
    static uint16_t half[VALUES];
    OIDNDevice device;
    OIDNFilter filter;
    size_t i;

    OURS();
    device = new_device();
    fill_inputs(5, 0);
    run(device, "Ln", 1, expected);
    for (i = 0; i < ALL; i++)
        block[i] = output[i] = (float)i;
    for (i = 0; i < W * H; i++)
        memcpy(block + i / W * ROW + i % W * STEP, light + 3 * i, 3 * sizeof *block);
    for (i = 0; i < VALUES; i++)
        half[i] = normal[i] > 0 ? 0x3c00 : 0;
    filter = new_lightmap(device, "Ln", result);
    oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, STEP * sizeof(float),
                             ROW * sizeof(float));
    oidnSetSharedFilterImage(filter, "normal", half, H3, W, H, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", output, F3, W, H, 2 * sizeof(float),
                             STEP * sizeof(float), ROW * sizeof(float));
    run_filter(device, filter);
    check_strided(output, expected, W, H, STEP, ROW);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* In the place of either input, and a texel behind it. */
static void output_may_overlap_inputs(void)
{
    static float block[VALUES + 3];
    OIDNDevice device;
    size_t shift;
    int is_normal;

    OURS();
    device = new_device();
    fill_inputs(6, 0);
    run(device, "Ln", 1, expected);
    for (is_normal = 0; is_normal < 2; is_normal++)
        for (shift = 0; shift <= 3; shift += 3) {
            OIDNFilter filter = new_lightmap(device, "Ln", block + shift);

            oidnSetSharedFilterImage(filter, is_normal ? "normal" : "color", block, F3, W, H, 0, 0,
                                     0);
            memcpy(block, is_normal ? normal : light, sizeof light);
            run_filter(device, filter);
            CHECK(memcmp(block + shift, expected, sizeof expected) == 0);
            oidnReleaseFilter(filter);
        }
    oidnReleaseDevice(device);
}

static void normals_may_come_and_go(void)
{
    static float alone[VALUES];
    OIDNDevice device;
    OIDNFilter filter;
    int i;

    OURS();
    device = new_device();
    fill_inputs(7, 0);
    run(device, "Ln", 1, expected);
    run(device, "L", 1, alone);
    filter = new_lightmap(device, "L", result);
    for (i = 0; i < 4; i++) {
        if (i & 1)
            oidnSetSharedFilterImage(filter, "normal", normal, F3, W, H, 0, 0, 0);
        else
            oidnUnsetFilterImage(filter, "normal");
        run_filter(device, filter);
        CHECK(memcmp(result, i & 1 ? expected : alone, sizeof result) == 0);
    }
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void maps_may_be_thin_or_empty(void)
{
    static const size_t sizes[][2] = {{1, 1}, {W, 1}, {1, H}, {0, 0}, {0, 5}};
    OIDNDevice device;
    size_t i, k;

    OURS();
    device = new_device();
    fill_inputs(8, 0);
    for (i = 0; i < COUNT(sizes); i++) {
        const size_t width = sizes[i][0], height = sizes[i][1];
        OIDNFilter filter = new_flagged(device, "Ln", (float *[]){light, NULL, normal}, result,
                                        width, height);

        result[3 * width * height] = 5;
        run_filter(device, filter);
        for (k = 0; k < 3 * width * height; k++)
            CHECK(isfinite(result[k]));
        CHECK(result[3 * width * height] == 5);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* ---- With other parameters ------------------------------------------------------------------- */

static void memory_is_limited(void)
{
    OIDNDevice device;
    OIDNFilter filter;
    int least;

    OURS();
    device = new_device();
    fill_inputs(9, 0);
    run(device, "Ln", 1, expected);
    filter = new_lightmap(device, "Ln", result);
    least = least_megabytes(device, filter);
    oidnSetFilterInt(filter, "maxMemoryMB", least - 1);
    oidnCommitFilter(filter);
    ERROR(device, MEMORY);
    oidnSetFilterInt(filter, "maxMemoryMB", least);
    run_filter(device, filter);
    CHECK(memcmp(result, expected, sizeof result) == 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* Weights for a colour alone see no normals, and get what they would without. */
static void weights_may_know_none(void)
{
    OIDNDevice device;
    OIDNFilter filter;
    int k;

    OURS();
    device = new_device();
    fill_inputs(10, 0);
    for (k = 0; k < 2; k++) {
        filter = new_lightmap(device, k ? "Ln" : "L", k ? result : expected);
        use_identity(filter, 3);
        run_filter(device, filter);
        oidnReleaseFilter(filter);
    }
    CHECK(memcmp(result, expected, sizeof result) == 0);
    free_identity();
    oidnReleaseDevice(device);
}

static void normals_alone_are_no_light_map(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    filter = new_lightmap(device, "Ln", result);
    oidnUnsetFilterImage(filter, "color");
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(what_is_outside_of_charts_does_not_matter);
    RUN(charts_do_not_darken_where_they_end);
    RUN(normals_are_seen);
    RUN(images_may_have_strides_and_halves);
    RUN(output_may_overlap_inputs);
    RUN(normals_may_come_and_go);
    RUN(maps_may_be_thin_or_empty);
    RUN(memory_is_limited);
    RUN(weights_may_know_none);
    RUN(normals_alone_are_no_light_map);
    return check_report();
}
