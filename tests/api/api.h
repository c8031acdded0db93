/* Shared by the tests of the OIDN interface. They also pass on Open Image Denoise itself (link
 * against it and set LULL_TEST_PEER=1, which leaves out what it does differently), so they test the
 * contract and not our reading of it. */
#ifndef LULL_TESTS_API_H
#define LULL_TESTS_API_H

#define OIDN_LEGACY_1X
#include "OpenImageDenoise/oidn.h"

#if defined(LULL_PEER_BUILD)
#pragma weak oidnMapBuffer /* missing in Open Image Denoise */
#pragma weak oidnUnmapBuffer
#endif

#include "check.h"
#include "identity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

#define F1 OIDN_FORMAT_FLOAT
#define F2 OIDN_FORMAT_FLOAT2
#define F3 OIDN_FORMAT_FLOAT3
#define F4 OIDN_FORMAT_FLOAT4
#define H1 OIDN_FORMAT_HALF
#define H3 OIDN_FORMAT_HALF3
#define H4 OIDN_FORMAT_HALF4

/* True when the library under test is Open Image Denoise. */
static inline int is_peer(void) { return getenv("LULL_TEST_PEER") != NULL; }

/* Ends a test there; reason: what Open Image Denoise does, or has not. */
#define OURS_ALONE(reason)                                                                         \
    do {                                                                                           \
        if (is_peer())                                                                             \
            SKIP("optional: Open Image Denoise " reason);                                          \
    } while (0)

/* Takes the error of this thread; checks that a message comes with an error and none without. */
static inline OIDNError take_error(OIDNDevice device)
{
    const char *text = "none";
    const OIDNError code = oidnGetDeviceError(device, &text);

    CHECK(code == OIDN_ERROR_NONE ? text == NULL : text != NULL && *text);
    return code;
}

/* The error of the last call was `code`, and it was the only one. */
#define ERROR(device, code)                                                                        \
    do {                                                                                           \
        CHECK_EQ(take_error(device), (code));                                                      \
        CHECK_EQ(oidnGetDeviceError((device), NULL), 0);                                           \
    } while (0)
#define NONE OIDN_ERROR_NONE
#define UNKNOWN OIDN_ERROR_UNKNOWN
#define ARGUMENT OIDN_ERROR_INVALID_ARGUMENT
#define OPERATION OIDN_ERROR_INVALID_OPERATION
#define MEMORY OIDN_ERROR_OUT_OF_MEMORY
#define HARDWARE OIDN_ERROR_UNSUPPORTED_HARDWARE
#define CANCELLED OIDN_ERROR_CANCELLED

static inline OIDNDevice new_device(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);

    oidnSetDeviceInt(device, "numThreads", 2);
    oidnCommitDevice(device);
    ERROR(device, NONE);
    return device;
}

/* Identity weights of 3, 6 and 9 inputs, kept for the whole program. Open Image Denoise knows only
 * its own widths. */
typedef struct weights {
    void *data;
    size_t bytes;
} weights;

static inline weights identity(unsigned inputs)
{
    static weights made[10];

    if (!made[inputs].data)
        made[inputs].data = identity_weights(inputs, is_peer() ? 32 : 8, 0, &made[inputs].bytes);
    return made[inputs];
}

static inline void use_identity(OIDNFilter filter, unsigned inputs)
{
    const weights w = identity(inputs);

    oidnSetSharedFilterData(filter, "weights", w.data, w.bytes);
}

static inline void free_identity(void)
{
    unsigned i;

    for (i = 3; i <= 9; i += 3) {
        weights w = identity(i);

        free(w.data);
    }
}

/* Gives a filter float3 images from in to out, tight, and commits it. */
static inline void commit_tight(OIDNDevice device, OIDNFilter filter, float *in, float *out,
                                size_t width, size_t height)
{
    oidnSetSharedFilterImage(filter, "color", in, OIDN_FORMAT_FLOAT3, width, height, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", out, OIDN_FORMAT_FLOAT3, width, height, 0, 0, 0);
    oidnCommitFilter(filter);
    ERROR(device, NONE);
}

/* A committed RT filter (srgb, so that the identity is exact) from in to out, float3, tight. */
static inline OIDNFilter new_identity(OIDNDevice device, float *in, float *out, size_t width,
                                      size_t height)
{
    OIDNFilter filter = oidnNewFilter(device, "RT");

    use_identity(filter, 3);
    oidnSetFilterBool(filter, "srgb", true);
    commit_tight(device, filter, in, out, width, height);
    return filter;
}

/* A filter of float3 images, tight. Flags: a with albedo, n with normals, L a light map; h hdr, s
 * srgb, d directional. */
static inline OIDNFilter new_flagged(OIDNDevice device, const char *flags, float *const inputs[3],
                                     float *output, size_t width, size_t height)
{
    OIDNFilter filter = oidnNewFilter(device, strchr(flags, 'L') ? "RTLightmap" : "RT");

    oidnSetSharedFilterImage(filter, "color", inputs[0], F3, width, height, 0, 0, 0);
    if (strchr(flags, 'a'))
        oidnSetSharedFilterImage(filter, "albedo", inputs[1], F3, width, height, 0, 0, 0);
    if (strchr(flags, 'n'))
        oidnSetSharedFilterImage(filter, "normal", inputs[2], F3, width, height, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", output, F3, width, height, 0, 0, 0);
    if (strchr(flags, 'h'))
        oidnSetFilterBool(filter, "hdr", true);
    if (strchr(flags, 's'))
        oidnSetFilterBool(filter, "srgb", true);
    if (strchr(flags, 'd'))
        oidnSetFilterBool(filter, "directional", true);
    ERROR(device, NONE);
    return filter;
}

/* Megabytes that a filter needs at least, by the error of a commit with one. */
static inline int least_megabytes(OIDNDevice device, OIDNFilter filter)
{
    const char *text = NULL, *number;

    oidnSetFilterInt(filter, "maxMemoryMB", 1);
    oidnCommitFilter(filter);
    CHECK_EQ(oidnGetDeviceError(device, &text), MEMORY);
    number = text ? strrchr(text, '(') : NULL;
    return CHECK(number != NULL) ? (int)strtol(number + 1, NULL, 10) : 0;
}

/* Reproducible values in [0, 1). */
static inline float noise(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / 16777216.0f;
}

/* Noisy colour, brighter to the right, an albedo of two parts, and normals of noise. */
static inline void fill_frame(float *color, float *albedo, float *normal, size_t width,
                              size_t height, unsigned seed)
{
    size_t i;

    for (i = 0; i < 3 * width * height; i++) {
        color[i] = noise(&seed) * (0.2f + 0.7f * (float)(i / 3 % width) / (float)width);
        albedo[i] = i / 3 / width < height / 3 ? 0.25f : 0.75f;
        normal[i] = 2 * noise(&seed) - 1;
    }
}

/* Commits a filter and executes it. */
static inline void run_filter(OIDNDevice device, OIDNFilter filter)
{
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
}

/* Frames of few pixels or none, all alike, come back with that parameter. */
static inline void check_thin_frames(OIDNDevice device, const char *parameter, int value)
{
    enum { W = 61, H = 43 };
    static const size_t sizes[][2] = {{1, 1}, {W, 1}, {1, H}, {17, 2}, {0, 0}, {0, 5}};
    static float color[3 * W * H], result[3 * W * H];
    size_t i, k;

    for (i = 0; i < COUNT(color); i++)
        color[i] = 0.25f;
    for (i = 0; i < COUNT(sizes); i++) {
        const size_t width = sizes[i][0], height = sizes[i][1];
        OIDNFilter filter =
            new_flagged(device, "h", (float *[]){color, NULL, NULL}, result, width, height);

        oidnSetFilterInt(filter, parameter, value);
        memset(result, 0, sizeof result);
        run_filter(device, filter);
        for (k = 0; k < 3 * width * height; k++)
            CHECK(fabsf(result[k] - 0.25f) < 1e-6f);
        oidnReleaseFilter(filter);
    }
}

/* An output whose pixels are `step` floats apart and its rows `row`, which before had the numbers
 * of its floats in them: from the third float of each pixel on it has what is expected, and no
 * other has changed. */
static inline void check_strided(const float *output, const float *expected, size_t width,
                                 size_t height, size_t step, size_t row)
{
    size_t i;

    for (i = 0; i < row * height; i++) {
        const size_t x = i % row / step, value = i % row % step;

        if (x < width && value >= 2 && value < 5)
            CHECK(output[i] == expected[3 * (i / row * width + x) + value - 2]);
        else
            CHECK(output[i] == (float)i);
    }
}

static inline float *noise_image(size_t floats, unsigned seed)
{
    float *image = malloc(floats * sizeof *image);
    size_t i;

    for (i = 0; i < floats; i++)
        image[i] = noise(&seed);
    return image;
}

/* Largest difference of two float images. */
static inline float difference(const float *a, const float *b, size_t n)
{
    float most = 0;
    size_t i;

    for (i = 0; i < n; i++)
        if (!(fabsf(a[i] - b[i]) <= most))
            most = fabsf(a[i] - b[i]);
    return most;
}

/* Whether commits without user weights can succeed at all. */
static inline int has_builtin(void)
{
    float in[3 * 4 * 4] = {0}, out[3 * 4 * 4];
    OIDNDevice device = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");
    int ok;

    oidnSetSharedFilterImage(filter, "color", in, OIDN_FORMAT_FLOAT3, 4, 4, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", out, OIDN_FORMAT_FLOAT3, 4, 4, 0, 0, 0);
    oidnSetFilterBool(filter, "hdr", true);
    oidnCommitFilter(filter);
    ok = oidnGetDeviceError(device, NULL) == NONE;
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    return ok;
}

/* Ends a test of a library without them. */
#define WANTS_BUILTIN()                                                                            \
    do {                                                                                           \
        if (!has_builtin())                                                                        \
            SKIP("there are no built-in weights");                                                 \
    } while (0)

#endif
