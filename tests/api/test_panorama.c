/* Panoramas: results as if the frame continued at its edges as the sphere does. Open Image Denoise
 * has no such parameter, so all of this is skipped there. */
#include "api.h"

#define OURS()                                                                                     \
    do {                                                                                           \
        OURS_ALONE("has no panoramas");                                                            \
        WANTS_BUILTIN();                                                                           \
    } while (0)

/* The border is larger than the frame is high, so that it reaches beyond both poles and back. */
enum { W = 61, H = 37, VALUES = 3 * W * H, BORDER = 64, OUTER_W = W + 2 * BORDER,
       OUTER_H = H + 2 * BORDER, OUTER_VALUES = 3 * OUTER_W * OUTER_H };

static float inputs[3][VALUES], result[VALUES], expected[VALUES];

/* ---- By hand --------------------------------------------------------------------------------- */

static void fill_inputs(unsigned seed)
{
    fill_frame(inputs[0], inputs[1], inputs[2], W, H, seed);
}

/* Index of the pixel seen at (x, y), which may lie outside: around the sphere, and over a pole on
 * the other side of it, where rows are met in reverse, up to the other pole. */
static size_t seen_at(int x, int y)
{
    int row = (y + 8 * H) % (2 * H);

    if (row >= H) {
        row = 2 * H - 1 - row;
        x += W / 2;
    }
    return (size_t)(row * W + (x + 8 * W) % W);
}

/* What a plain filter makes of a picture with a border, without it, to `expected`. */
static void make_expected(OIDNDevice device, const char *flags, int ensemble)
{
    static float outer[3][OUTER_VALUES], output[OUTER_VALUES];
    OIDNFilter filter;
    int i, x, y;

    for (i = 0; i < 3; i++)
        for (y = 0; y < OUTER_H; y++)
            for (x = 0; x < OUTER_W; x++)
                memcpy(outer[i] + 3 * (y * OUTER_W + x),
                       inputs[i] + 3 * seen_at(x - BORDER, y - BORDER), 3 * sizeof(float));
    filter = new_flagged(device, flags, (float *[]){outer[0], outer[1], outer[2]}, output, OUTER_W,
                         OUTER_H);
    oidnSetFilterInt(filter, "ensemble", ensemble);
    run_filter(device, filter);
    for (y = 0; y < H; y++)
        memcpy(expected + 3 * W * y, output + 3 * ((y + BORDER) * OUTER_W + BORDER),
               3 * W * sizeof(float));
    oidnReleaseFilter(filter);
}

static OIDNFilter new_panorama(OIDNDevice device, const char *flags, float *output)
{
    OIDNFilter filter = new_flagged(device, flags, (float *[]){inputs[0], inputs[1], inputs[2]},
                                    output, W, H);

    oidnSetFilterBool(filter, "panorama", true);
    return filter;
}

/* ---- Results --------------------------------------------------------------------------------- */

static void is_what_lies_inside_a_border(void)
{
    static const char *const kinds[] = {"h", "", "s", "ha", "han", "an"};
    OIDNDevice device;
    size_t i;
    int n;

    OURS();
    device = new_device();
    fill_inputs(1);
    for (i = 0; i < COUNT(kinds); i++)
        for (n = 1; n <= 4; n *= 2) {
            OIDNFilter filter = new_panorama(device, kinds[i], result);

            make_expected(device, kinds[i], n);
            memset(result, 0x5a, sizeof result);
            oidnSetFilterInt(filter, "ensemble", n);
            run_filter(device, filter);
            if (!CHECK(memcmp(result, expected, sizeof result) == 0))
                printf("  %s, %d\n", kinds[i], n);
            oidnReleaseFilter(filter);
        }
    oidnReleaseDevice(device);
}

/* Of sparks, much noise, pixels on either side of the cut become much more alike where a filter
 * sees both. */
static void has_no_seam(void)
{
    double step[2] = {0, 0};
    OIDNDevice device;
    unsigned seed = 3;
    int k, y;
    size_t i;

    OURS();
    device = new_device();
    for (i = 0; i < VALUES; i++)
        inputs[0][i] = noise(&seed) < 0.1f ? 5 : 0;
    for (k = 0; k < 2; k++) {
        OIDNFilter filter = new_panorama(device, "h", result);

        oidnSetFilterBool(filter, "panorama", k != 0);
        CHECK_EQ(oidnGetFilterBool(filter, "panorama"), k != 0);
        run_filter(device, filter);
        for (y = 0; y < H; y++)
            step[k] += fabs((double)result[3 * W * y] - (double)result[3 * (W * y + W - 1)]);
        oidnReleaseFilter(filter);
    }
    CHECK(step[1] < 0.5 * step[0]);
    oidnReleaseDevice(device);
}

static void one_filter_may_change(void)
{
    static float plain[VALUES];
    OIDNDevice device;
    OIDNFilter filter;
    int i;

    OURS();
    device = new_device();
    fill_inputs(2);
    filter = new_panorama(device, "han", plain);
    oidnSetFilterBool(filter, "panorama", false);
    run_filter(device, filter);
    oidnSetSharedFilterImage(filter, "output", result, F3, W, H, 0, 0, 0);
    for (i = 0; i < 4; i++) {
        fill_inputs(2);
        make_expected(device, "han", 1);
        oidnSetFilterBool(filter, "panorama", i & 1);
        run_filter(device, filter);
        CHECK(memcmp(result, i & 1 ? expected : plain, sizeof result) == 0);
        oidnExecuteFilter(filter); /* and again */
        CHECK(memcmp(result, i & 1 ? expected : plain, sizeof result) == 0);
    }
    CHECK(memcmp(expected, plain, sizeof plain) != 0);
    oidnReleaseFilter(filter);
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
    fill_inputs(5);
    for (i = 0; i < VALUES; i++) { /* halves that are no less than floats: 1 to 2 */
        half[i] = (uint16_t)(0x3c00 + (uint16_t)(1023 * inputs[1][i] * noise(&(unsigned){i})));
        inputs[1][i] = 1 + (float)(half[i] - 0x3c00) / 1024;
    }
    make_expected(device, "ha", 1);
    for (i = 0; i < ALL; i++)
        block[i] = output[i] = (float)i;
    for (i = 0; i < W * H; i++)
        memcpy(block + i / W * ROW + i % W * STEP, inputs[0] + 3 * i, 3 * sizeof *block);
    filter = new_panorama(device, "ha", result);
    oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, STEP * sizeof(float),
                             ROW * sizeof(float));
    oidnSetSharedFilterImage(filter, "albedo", half, H3, W, H, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", output, F3, W, H, 2 * sizeof(float),
                             STEP * sizeof(float), ROW * sizeof(float));
    run_filter(device, filter);
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
    make_expected(device, "h", 1);
    for (shift = 0; shift <= 3; shift += 3) {
        OIDNFilter filter = new_panorama(device, "h", block + shift);

        oidnSetSharedFilterImage(filter, "color", block, F3, W, H, 0, 0, 0);
        memcpy(block, inputs[0], sizeof inputs[0]);
        run_filter(device, filter);
        CHECK(memcmp(block + shift, expected, sizeof expected) == 0);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

static void frames_may_be_thin_or_empty(void)
{
    OIDNDevice device;

    OURS();
    device = new_device();
    check_thin_frames(device, "panorama", 1);
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
    fill_inputs(7);
    make_expected(device, "han", 1);
    filter = new_panorama(device, "han", result);
    least = least_megabytes(device, filter);
    oidnSetFilterInt(filter, "maxMemoryMB", least - 1);
    oidnCommitFilter(filter);
    ERROR(device, MEMORY);
    oidnSetFilterInt(filter, "maxMemoryMB", least);
    run_filter(device, filter);
    CHECK(memcmp(result, expected, sizeof result) == 0);
    memset(result, 0, sizeof result);
    oidnSetFilterInt(filter, "maxMemoryMB", 0);
    run_filter(device, filter);
    CHECK(memcmp(result, expected, sizeof result) == 0);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void has_room_for_a_border(void)
{
    enum { WIDEST = 65536 - 2 * BORDER };
    static float wide[3 * (WIDEST + 1)];
    OIDNDevice device;
    size_t more;

    OURS();
    device = new_device();
    for (more = 0; more < 2; more++) {
        OIDNFilter filter = new_panorama(device, "", result);
        const char *text = NULL;

        oidnSetSharedFilterImage(filter, "color", wide, F3, WIDEST + more, 1, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", wide, F3, WIDEST + more, 1, 0, 0, 0);
        oidnCommitFilter(filter);
        CHECK_EQ(oidnGetDeviceError(device, &text), more ? ARGUMENT : NONE);
        CHECK(!more || strstr(text, "a panorama of 65409x1 pixels"));
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

static void light_maps_have_none(void)
{
    OIDNDevice device;
    OIDNFilter filter;

    OURS();
    device = new_device();
    filter = new_flagged(device, "L", (float *[]){inputs[0], NULL, NULL}, result, W, H);
    oidnSetFilterBool(filter, "panorama", true);
    CHECK(!oidnGetFilterBool(filter, "panorama"));
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(is_what_lies_inside_a_border);
    RUN(has_no_seam);
    RUN(one_filter_may_change);
    RUN(images_may_have_strides_and_halves);
    RUN(output_may_overlap_inputs);
    RUN(frames_may_be_thin_or_empty);
    RUN(memory_is_limited);
    RUN(has_room_for_a_border);
    RUN(light_maps_have_none);
    return check_report();
}
