/* Images and memory: overlapping images, bytes around pixels, limits of memory. */
#include "api.h"

#include <stdint.h>

enum { W = 93, H = 61, N = 3 * W * H }; /* odd on purpose */

/* ---- Overlapping images ---------------------------------------------------------------------- */

/* Colour at `from`, output at `to` bytes into one block, with the given strides and formats; as raw
 * pointers or through buffers. Returns the output as floats. */
typedef struct overlap_row {
    size_t from, to;
    OIDNFormat in, out;
    size_t in_pixel, in_row, out_pixel, out_row;
} overlap_row;

static size_t pixel_bytes(OIDNFormat f)
{
    return f == OIDN_FORMAT_FLOAT3 ? 12 : f == OIDN_FORMAT_HALF3 ? 6 : 4;
}

static void run_overlap(OIDNDevice device, const overlap_row *row, char *block, size_t bytes,
                        char *apart, int through_buffer, int memory)
{
    OIDNFilter filter = oidnNewFilter(device, "RT");
    OIDNBuffer a = oidnNewSharedBuffer(device, block, bytes),
               b = oidnNewSharedBuffer(device, block, bytes);

    use_identity(filter, 3);
    oidnSetFilterBool(filter, "srgb", true);
    oidnSetFilterInt(filter, "maxMemoryMB", memory);
    if (through_buffer)
        oidnSetFilterImage(filter, "color", a, row->in, W, H, row->from, row->in_pixel,
                           row->in_row);
    else
        oidnSetSharedFilterImage(filter, "color", block, row->in, W, H, row->from, row->in_pixel,
                                 row->in_row);
    if (apart)
        oidnSetSharedFilterImage(filter, "output", apart, row->out, W, H, row->to, row->out_pixel,
                                 row->out_row);
    else
        oidnSetFilterImage(filter, "output", b, row->out, W, H, row->to, row->out_pixel,
                           row->out_row);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseBuffer(a);
    oidnReleaseBuffer(b);
}

static void in_place(void)
{
    enum { ROW = 12 * W, BYTES = 3 * 16 * W * H };
    static const overlap_row rows[] = {
        {0, 0, F3, F3, 0, 0, 0, 0},             /* exactly */
        {0, 0, F3, F3, 16, 0, 16, 0},           /* with gaps between pixels */
        {0, 0, F3, F3, 0, 2 * ROW, 0, 2 * ROW}, /* and between rows */
        {0, 12, F3, F3, 0, 0, 0, 0},            /* shifted by a pixel */
        {12, 0, F3, F3, 0, 0, 0, 0},
        {0, 40 * ROW, F3, F3, 0, 0, 0, 0}, /* by rows */
        {40 * ROW, 0, F3, F3, 0, 0, 0, 0},
        {0, 0, F3, F3, 0, 0, 16, 0}, /* other strides */
        {0, 0, F3, F3, 16, 0, 0, 0},
        {0, 0, F3, F3, 0, 2 * ROW, 0, 0},
        {0, 0, F3, F3, 0, 0, 0, 2 * ROW},
        {0, 0, F3, H3, 0, 0, 12, 0}, /* other formats */
        {0, 0, F3, H3, 0, 0, 0, 0},
        {0, 0, H3, F3, 0, 0, 0, 0},
        {0, 12, F3, F3, 24, 0, 24, 0}, /* interleaved: bytes overlap, pixels do not */
    };
    OIDNDevice device = new_device();
    char *block = malloc(BYTES), *input = malloc(BYTES), *apart = malloc(BYTES);
    unsigned seed = 21;
    size_t i, x, y;
    int k;

    for (i = 0; i < BYTES / 4; i++) { /* valid as floats and as pairs of halves */
        const uint32_t v =
            0x38003800u + ((uint32_t)(noise(&seed) * 1000) << 16) + (uint32_t)(noise(&seed) * 1000);

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

/* ---- Values ---------------------------------------------------------------------------------- */

/* Identity weights whose last layer adds 0, 1/8 and 1/4 to the three channels. */
static void *biased_weights(size_t *bytes)
{
    static const unsigned char biases[6] = {0, 0, 0, 0x30, 0, 0x34};
    unsigned char *data = identity_weights(3, is_peer() ? 32 : 8, 0, bytes);
    uint64_t table = 0;
    int i;

    for (i = 7; i >= 0; i--)
        table = table << 8 | data[4 + i];
    memcpy(data + table - 64, biases, sizeof biases); /* the last tensor before the table */
    return data;
}

static double from_srgb(double x)
{
    return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
}
static double to_srgb(double y)
{
    return y <= 0.0031308 ? 12.92 * y : 1.055 * pow(y, 1 / 2.4) - 0.055;
}

/* One channel: the network sees three equal ones, and the mean of its answers is taken in linear
 * values. Two: the second one twice, and the first two answers. */
static void few_channels(void)
{
    static const OIDNFormat formats[] = {F1, OIDN_FORMAT_FLOAT2, F3};
    OIDNDevice device = new_device();
    float in[3 * 5], out[3 * 5];
    size_t bytes, c, k;
    void *data = biased_weights(&bytes);

    for (c = 1; c <= 3; c++) {
        OIDNFilter filter = oidnNewFilter(device, "RT");
        double worst = 0;

        for (k = 0; k < 5 * c; k++)
            in[k] = 0.05f + 0.03f * (float)k;
        oidnSetSharedFilterData(filter, "weights", data, bytes);
        oidnSetSharedFilterImage(filter, "color", in, formats[c - 1], 5, 1, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", out, formats[c - 1], 5, 1, 0, 0, 0);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        for (k = 0; k < 5 * c; k++) {
            const double x = to_srgb(in[k]);
            const double want =
                c == 1 ? (from_srgb(x) + from_srgb(x + 0.125) + from_srgb(x + 0.25)) / 3
                       : from_srgb(x + 0.125 * (double)(k % c));

            worst = fmax(worst, fabs(out[k] - want));
        }
        if (!CHECK(worst < 1e-3))
            printf("  %u channels: off by %g\n", (unsigned)c, worst);
        oidnReleaseFilter(filter);
    }
    free(data);
    oidnReleaseDevice(device);
}

/* A scale of 0 blackens the image: nothing is divided by it. */
static void input_scales(void)
{
    static const float scales[] = {0, 1e-3f, 1, 64, NAN};
    enum { FLOATS = 3 * 16 * 16 };
    OIDNDevice device = new_device();
    float *in = noise_image(FLOATS, 31), *out = noise_image(FLOATS, 32);
    size_t i, k;

    for (i = 0; i < COUNT(scales); i++) {
        OIDNFilter filter = oidnNewFilter(device, "RT");
        unsigned wrong = 0;

        use_identity(filter, 3);
        oidnSetFilterBool(filter, "hdr", true);
        oidnSetFilterFloat(filter, "inputScale", scales[i]);
        oidnSetSharedFilterImage(filter, "color", in, F3, 16, 16, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", out, F3, 16, 16, 0, 0, 0);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        for (k = 0; k < FLOATS; k++)
            wrong +=
                scales[i] == 0 ? out[k] != 0 : !(fabsf(out[k] - in[k]) <= 2e-3f * (in[k] + 0.1f));
        if (!CHECK_EQ(wrong, 0))
            printf("  scale %g\n", (double)scales[i]);
        oidnReleaseFilter(filter);
    }
    free(in);
    free(out);
    oidnReleaseDevice(device);
}

/* ---- Memory limit ---------------------------------------------------------------------------- */

/* A limit that cannot be met is an error that names what could; from there on commits succeed, and
 * every limit gives the same bytes. */
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

    OURS_ALONE("takes maxMemoryMB as a wish");
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

/* An output between the pixels of the input, as renderers have their passes, needs no copy. */
static void interleaved_images_are_not_copied(void)
{
    enum { SIDE = 600, PASSES = 7 };
    OIDNDevice device = new_device();
    float *passes = noise_image(PASSES * SIDE * SIDE, 26);
    OIDNFilter filter = oidnNewFilter(device, "RT");

    use_identity(filter, 3);
    oidnSetFilterBool(filter, "hdr", true);
    oidnSetFilterInt(filter, "maxMemoryMB", 4); /* less than the output has */
    oidnSetSharedFilterImage(filter, "color", passes, F3, SIDE, SIDE, 12, 4 * PASSES, 0);
    oidnSetSharedFilterImage(filter, "output", passes, F3, SIDE, SIDE, 0, 4 * PASSES, 0);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnSetSharedFilterImage(filter, "output", passes, F3, SIDE, SIDE, 4, 4 * PASSES, 0);
    oidnCommitFilter(filter);
    ERROR(device, is_peer() ? NONE : MEMORY);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    free(passes);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(in_place);
    RUN(padding_untouched);
    RUN(few_channels);
    RUN(input_scales);
    RUN(memory_limit);
    RUN(interleaved_images_are_not_copied);
    free_identity();
    return check_report();
}
