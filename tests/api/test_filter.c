/* The contract of filters, row by row: parameters, images, weights, empty images. */
#include "api.h"

#include <limits.h>

static float pixels[4][3 * 64 * 64];

/* ---- Values ---------------------------------------------------------------------------------- */

static void filter_creation(void)
{
    static const char *const bad[] = {"*", "", "rt", "RTLIGHTMAP", "RTlightmap", "RT ", NULL};
    OIDNDevice device = new_device();
    size_t i;

    for (i = 0; i < COUNT(bad); i++) {
        CHECK(!oidnNewFilter(device, bad[i]));
        ERROR(device, ARGUMENT);
    }
    for (i = 0; i < 2; i++) {
        OIDNFilter filter = oidnNewFilter(device, i ? "RTLightmap" : "RT");

        CHECK(filter != NULL);
        ERROR(device, NONE);
        oidnRetainFilter(filter);
        oidnReleaseFilter(filter);
        oidnReleaseFilter(filter);
        ERROR(device, NONE);
    }
    oidnReleaseDevice(device);
}

/* Kinds: b, i, f. Owners: r RT, l RTLightmap. */
static const struct {
    const char *name;
    char kind;
    const char *owners;
    float initial;
    int settable;
} values[] = {
    {"hdr", 'b', "r", 0, 1},
    {"srgb", 'b', "r", 0, 1},
    {"cleanAux", 'b', "r", 0, 1},
    {"directional", 'b', "l", 0, 1},
    {"inputScale", 'f', "rl", NAN, 1},
    {"hdrScale", 'f', "rl", NAN, 1},
    {"quality", 'i', "rl", 6, 1},
    {"maxMemoryMB", 'i', "rl", -1, 1},
    {"tileAlignment", 'i', "rl", 1, 0},
    {"alignment", 'i', "rl", 1, 0},
    {"tileOverlap", 'i', "rl", 0, 0},
    {"overlap", 'i', "rl", 0, 0},
    {"color", 'x', "", 0, 0},
    {"output", 'x', "", 0, 0},
    {"weights", 'x', "", 0, 0},
    {"nonsense", 'x', "", 0, 0},
    {"HDR", 'x', "", 0, 0},
    {"", 'x', "", 0, 0},
};

static int same(float a, float b) { return a == b || (a != a && b != b); }

static void filter_values(void)
{
    OIDNDevice device = new_device();
    size_t i, t;

    for (t = 0; t < 2; t++)
        for (i = 0; i < COUNT(values); i++) {
            OIDNFilter filter = oidnNewFilter(device, t ? "RTLightmap" : "RT");
            const char *name = values[i].name;
            const int known = strchr(values[i].owners, t ? 'l' : 'r') != NULL;
            const int is_float = known && values[i].kind == 'f', is_int = known && !is_float;

            CHECK(same(oidnGetFilterFloat(filter, name), is_float ? values[i].initial : 0));
            ERROR(device, is_float ? NONE : ARGUMENT);
            CHECK_EQ(oidnGetFilterInt(filter, name), is_int ? (int)values[i].initial : 0);
            ERROR(device, is_int ? NONE : ARGUMENT);
            CHECK_EQ(oidnGetFilterBool(filter, name), is_int && values[i].initial != 0);
            ERROR(device, is_int ? NONE : ARGUMENT);
            oidnSetFilterFloat(filter, name, 2.5f); /* of the wrong kind or unknown: no error, no
                                                       effect */
            ERROR(device, NONE);
            if (is_int)
                CHECK_EQ(oidnGetFilterInt(filter, name), (int)values[i].initial);
            if (is_float)
                CHECK(oidnGetFilterFloat(filter, name) == 2.5f);
            oidnSetFilterInt(filter, name, 5); /* 5 is a quality, too */
            ERROR(device, NONE);
            if (is_float)
                CHECK(oidnGetFilterFloat(filter, name) == 2.5f);
            if (is_int)
                CHECK_EQ(oidnGetFilterInt(filter, name), !values[i].settable
                                                             ? (int)values[i].initial
                                                         : values[i].kind == 'b' ? 1
                                                                                 : 5);
            if (known && strcmp(name, "quality") != 0) {
                oidnSetFilterBool(filter, name, true);
                ERROR(device, NONE);
            }
            oidnGetDeviceError(device, NULL);
            oidnReleaseFilter(filter);
        }
    oidnReleaseDevice(device);
}

static void filter_value_names(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");
    char byte = 0;

    oidnSetFilterBool(filter, NULL, true);
    ERROR(device, ARGUMENT);
    oidnSetFilterInt(filter, NULL, 1);
    ERROR(device, ARGUMENT);
    oidnSetFilterFloat(filter, NULL, 1);
    ERROR(device, ARGUMENT);
    CHECK_EQ(oidnGetFilterBool(filter, NULL), 0);
    ERROR(device, ARGUMENT);
    CHECK_EQ(oidnGetFilterInt(filter, NULL), 0);
    ERROR(device, ARGUMENT);
    CHECK(oidnGetFilterFloat(filter, NULL) == 0);
    ERROR(device, ARGUMENT);
    oidnSetSharedFilterImage(filter, NULL, pixels[0], OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0);
    ERROR(device, ARGUMENT);
    oidnUnsetFilterImage(filter, NULL);
    ERROR(device, ARGUMENT);
    oidnSetSharedFilterData(filter, NULL, &byte, 1);
    ERROR(device, ARGUMENT);
    oidnUpdateFilterData(filter, NULL);
    ERROR(device, ARGUMENT);
    oidnUnsetFilterData(filter, NULL);
    ERROR(device, ARGUMENT);
    oidnSetFilterFloat(filter, "hdrScale", 3); /* an alias */
    CHECK(oidnGetFilterFloat(filter, "inputScale") == 3);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void filter_quality(void)
{
    static const struct {
        int value;
        OIDNError error;
        int reads_back;
    } rows[] = {
        {4, NONE, 4},     {5, NONE, 5},      {6, NONE, 6},
        {0, NONE, 6},     {1, ARGUMENT, 6},  {3, ARGUMENT, 6},
        {7, ARGUMENT, 6}, {-1, ARGUMENT, 6}, {INT_MAX, ARGUMENT, 6},
    };
    OIDNDevice device = new_device();
    OIDNFilter filter = new_identity(device, pixels[0], pixels[3], 1, 1);
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        oidnSetFilterInt(filter, "quality", rows[i].value);
        ERROR(device, rows[i].error);
        CHECK_EQ(oidnGetFilterInt(filter, "quality"), rows[i].reads_back);
        oidnCommitFilter(filter);
        ERROR(device, NONE);
    }
    oidnSetFilterInt(filter, "quality", 9); /* refused before anything changes */
    ERROR(device, ARGUMENT);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Images ---------------------------------------------------------------------------------- */

static void image_rules(void)
{
    static const struct {
        size_t width, height, offset, pixel, row, buffer; /* bytes of the buffer */
        int format;
        OIDNError error;
    } rows[] = {
        {4, 3, 0, 0, 0, 144, F3, NONE},
        {4, 3, 0, 0, 0, 143, F3, ARGUMENT},
        {5, 3, 0, 0, 0, 144, F3, ARGUMENT},
        {4, 3, 1, 0, 0, 144, F3, ARGUMENT},
        {4, 3, 1, 0, 0, 145, F3, NONE},
        {4, 3, 0, 100, 0, 144, F3, ARGUMENT},
        {4, 3, 0, 0, 400, 144, F3, ARGUMENT},
        {4, 3, 0, 16, 0, 188, F3, NONE}, /* the last pixel is not padded */
        {4, 3, 0, 16, 0, 187, F3, ARGUMENT},
        {4, 3, 0, 0, 60, 168, F3, NONE},
        {4, 3, 0, 0, 60, 167, F3, ARGUMENT},
        {4, 3, 0, 13, 0, 155, F3, NONE}, /* any stride of a pixel or more */
        {4, 3, 0, 11, 0, 999, F3, ARGUMENT},
        {4, 3, 0, 0, 47, 999, F3, ARGUMENT},
        {4, 3, 0, 16, 60, 999, F3, ARGUMENT}, /* rows count from the pixel stride */
        {4, 3, 0, 16, 64, 999, F3, NONE},
        {4, 3, 0, 0, 0, 72, H3, NONE},
        {4, 3, 0, 0, 0, 71, H3, ARGUMENT},
        {4, 3, 0, 0, 0, 999, OIDN_FORMAT_FLOAT4, NONE},
        {4, 3, 0, 0, 0, 999, OIDN_FORMAT_HALF4, NONE},
        {4, 3, 0, 0, 0, 999, OIDN_FORMAT_UNDEFINED, NONE},
        {4, 3, 0, 0, 0, 999, -1, ARGUMENT},
        {4, 3, 0, 0, 0, 999, 5, ARGUMENT},
        {4, 3, 0, 0, 0, 999, 256, ARGUMENT},
        {4, 3, 0, 0, 0, 999, 261, ARGUMENT},
        {0, 0, 0, 0, 0, 16, F3, NONE},
        {0, 3, 16, 0, 0, 16, F3, NONE},
        {4, 0, 17, 0, 0, 16, F3, ARGUMENT},
        {65537, 1, 0, 0, 0, 999, F3, ARGUMENT},
        {1, 65537, 0, 0, 0, 999, F3, ARGUMENT},
        {65536, 65536, 0, 0, 0, 999, F3, ARGUMENT},
        {SIZE_MAX, 1, 0, 0, 0, 999, F3, ARGUMENT},
        {1, 1, SIZE_MAX, 0, 0, 999, F3, ARGUMENT},
        {1, 1, SIZE_MAX - 11, 0, 0, 999, F3, ARGUMENT},
        {2, 2, 0, SIZE_MAX / 2, 0, 999, F3, ARGUMENT},
        {2, 3, 0, 0, SIZE_MAX / 2, 999, F3, ARGUMENT},
        {2, 2, 0, SIZE_MAX, SIZE_MAX, 999, F3, ARGUMENT},
#if SIZE_MAX > 0xffffffffu
        {((size_t)1 << 32) + 4, 3, 0, 0, 0, 144, F3, ARGUMENT},
        {4, ((size_t)1 << 32) + 3, 0, 0, 0, 144, F3, ARGUMENT},
#endif
    };
    OIDNDevice device = new_device(), other = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");
    OIDNBuffer buffer;
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        const OIDNFormat format = (OIDNFormat)rows[i].format;
        char *memory = malloc(rows[i].buffer);
        OIDNError error;

        buffer = oidnNewBuffer(device, rows[i].buffer);
        oidnSetFilterImage(filter, "color", buffer, format, rows[i].width, rows[i].height,
                           rows[i].offset, rows[i].pixel, rows[i].row);
        error = take_error(device);
        if (!CHECK_EQ(error, rows[i].error))
            printf("  row %u\n", (unsigned)i);
        oidnSetFilterImage(filter, "nonsense", buffer, format, rows[i].width, rows[i].height,
                           rows[i].offset, rows[i].pixel, rows[i].row); /* checked all the same */
        CHECK_EQ(take_error(device), rows[i].error);
        oidnReleaseBuffer(buffer);
        oidnUnsetFilterImage(filter, "color");
        ERROR(device, NONE);
        free(memory);
    }
    oidnSetFilterImage(filter, "color", NULL, OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0);
    ERROR(device, ARGUMENT);
    oidnSetFilterImage(filter, NULL, NULL, OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0);
    ERROR(device, ARGUMENT);
    buffer = oidnNewBuffer(other, 999);
    oidnSetFilterImage(filter, "color", buffer, OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0);
    ERROR(device, ARGUMENT);
    ERROR(other, NONE);
    oidnReleaseBuffer(buffer);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    oidnReleaseDevice(other);
}

static void shared_image_rules(void)
{
    static const struct {
        int null;
        size_t width, height, offset;
        int format;
        OIDNError error;
    } rows[] = {
        {0, 4, 3, 0, OIDN_FORMAT_FLOAT3, NONE},
        {0, 4, 3, 100, OIDN_FORMAT_HALF, NONE},
        {0, 0, 0, 0, OIDN_FORMAT_FLOAT3, NONE},
        {0, 4, 3, 0, 77, ARGUMENT},
        {1, 0, 0, 0, OIDN_FORMAT_FLOAT3, NONE},
        {1, 0, 5, 0, OIDN_FORMAT_FLOAT3, NONE},
        {1, 0, 0, 1, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {1, 1, 1, 0, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {1, 1, 1, 8, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {0, 65537, 1, 0, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {0, 65536, 1, 0, OIDN_FORMAT_FLOAT3, NONE},
        {0, 65536, 32767, 0, OIDN_FORMAT_HALF, NONE},
        {0, 65536, 32768, 0, OIDN_FORMAT_HALF, ARGUMENT}, /* 2^31 values */
        {0, 26754, 26754, 0, OIDN_FORMAT_FLOAT3, NONE},
        {0, 26755, 26755, 0, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {1, 1, 1, SIZE_MAX - 11, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {0, 24, 0, SIZE_MAX - 14, OIDN_FORMAT_FLOAT2, ARGUMENT}, /* empty, but nowhere */
        {0, 0, 0, SIZE_MAX, OIDN_FORMAT_FLOAT3, ARGUMENT},
        {0, 4, 3, SIZE_MAX - 999, OIDN_FORMAT_UNDEFINED, ARGUMENT},
        {0, 1, 1, SIZE_MAX - 99, OIDN_FORMAT_FLOAT3, ARGUMENT},
    };
    OIDNDevice device = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        oidnSetSharedFilterImage(filter, "color", rows[i].null ? NULL : pixels[0],
                                 (OIDNFormat)rows[i].format, rows[i].width, rows[i].height,
                                 rows[i].offset, 0, 0);
        if (!CHECK_EQ(take_error(device), rows[i].error))
            printf("  row %u\n", (unsigned)i);
    }
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Weights --------------------------------------------------------------------------------- */

static void weights_data(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = oidnNewFilter(device, "RT");
    const weights good = identity(3);
    unsigned char *copy = malloc(good.bytes);
    const int builtin = has_builtin();

    memcpy(copy, good.data, good.bytes);
    oidnSetSharedFilterImage(filter, "color", pixels[0], F3, 5, 5, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", pixels[3], F3, 5, 5, 0, 0, 0);
    oidnSetSharedFilterData(filter, "weights", NULL, 900);
    ERROR(device, ARGUMENT);
    oidnSetSharedFilterData(filter, "weights", NULL, 0);
    ERROR(device, NONE);
    oidnCommitFilter(filter);
    CHECK_EQ(take_error(device), builtin ? NONE : OPERATION);
    oidnSetSharedFilterData(filter, "weights", copy, good.bytes);
    oidnCommitFilter(filter);
    ERROR(device, NONE);
    memset(copy, 0x5a, good.bytes); /* read in the commit only */
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnSetFilterBool(filter, "hdr", true);
    oidnUpdateFilterData(filter, "weights");
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    memcpy(copy, good.data, good.bytes);
    oidnUpdateFilterData(filter, "weights");
    oidnCommitFilter(filter);
    ERROR(device, NONE);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnUnsetFilterData(filter, "weights");
    oidnCommitFilter(filter);
    CHECK_EQ(take_error(device), builtin ? NONE : OPERATION);
    free(copy);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

static void weights_corrupted(void)
{
    static const struct {
        const char *what;
        size_t at, size; /* size: bytes given; 0: all */
        int value;
        OIDNError error;
    } rows[] = {
        {"good", 0, 0, -1, NONE},
        {"magic", 0, 0, 0xd8, OPERATION},
        {"major version", 2, 0, 3, OPERATION},
        {"minor version", 3, 0, 9, NONE},
        {"table offset", 11, 0, 0x7f, OPERATION},
        {"table offset", 9, 0, 0x7f, OPERATION},
        {"one byte", 0, 1, -1, OPERATION},
        {"header only", 0, 12, -1, OPERATION},
        {"truncated", 0, 900, -1, OPERATION},
    };
    const weights good = identity(3);
    OIDNDevice device = new_device();
    unsigned char *copy = malloc(good.bytes);
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        OIDNFilter filter = oidnNewFilter(device, "RT");

        memcpy(copy, good.data, good.bytes);
        if (rows[i].value >= 0)
            copy[rows[i].at] = (unsigned char)rows[i].value;
        oidnSetSharedFilterImage(filter, "color", pixels[0], F3, 5, 5, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", pixels[3], F3, 5, 5, 0, 0, 0);
        oidnSetSharedFilterData(filter, "weights", copy, rows[i].size ? rows[i].size : good.bytes);
        ERROR(device, NONE);
        oidnCommitFilter(filter);
        if (!CHECK_EQ(take_error(device), rows[i].error))
            printf("  %s\n", rows[i].what);
        oidnReleaseFilter(filter);
    }
    free(copy);
    oidnReleaseDevice(device);
}

/* The large topology has an overlap of 112. */
static void weights_large(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = new_identity(device, pixels[0], pixels[3], 5, 5);
    size_t bytes = 0;
    void *data;

    if (is_peer()) {
        SKIP("optional: Open Image Denoise knows only its own widths of this network");
    } else {
        data = identity_weights(3, 8, 1, &bytes);
        oidnSetSharedFilterData(filter, "weights", data, bytes);
        oidnCommitFilter(filter);
        ERROR(device, NONE);
        CHECK_EQ(oidnGetFilterInt(filter, "tileOverlap"), 112);
        free(data);
    }
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- Empty images ---------------------------------------------------------------------------- */

static bool fail_if_called(void *user, double n)
{
    *(int *)user = 1;
    return n >= 0;
}

static void empty_images(void)
{
    static const size_t sizes[][2] = {{0, 0}, {0, 1}, {1, 0}, {0, 100},
                                      {1, 1}, {1, 2}, {2, 1}, {17, 1}};
    OIDNDevice device = new_device();
    OIDNBuffer nothing = oidnNewBuffer(device, 0);
    OIDNFilter empty = oidnNewFilter(device, "RT");
    size_t i;

    use_identity(empty, 3);
    oidnSetFilterImage(empty, "color", nothing, F3, 0, 0, 0, 0, 0); /* set, unlike NULL */
    oidnSetFilterImage(empty, "output", nothing, F3, 0, 0, 0, 0, 0);
    oidnReleaseBuffer(nothing);
    oidnCommitFilter(empty);
    ERROR(device, NONE);
    oidnExecuteFilter(empty);
    ERROR(device, NONE);
    oidnSetSharedFilterImage(empty, "color", NULL, F3, 0, 0, 0, 0, 0); /* unset */
    ERROR(device, NONE);
    oidnCommitFilter(empty);
    ERROR(device, OPERATION);
    use_identity(empty, 9); /* more than the images have, which does not matter yet */
    oidnSetSharedFilterImage(empty, "color", pixels[0], F3, 0, 1, 0, 0, 0);
    oidnSetSharedFilterImage(empty, "output", pixels[0], F3, 0, 1, 0, 0, 0);
    oidnCommitFilter(empty);
    oidnExecuteFilter(empty);
    ERROR(device, NONE);
    oidnSetSharedFilterImage(empty, "color", pixels[0], F3, 1, 1, 0, 0, 0);
    oidnSetSharedFilterImage(empty, "output", pixels[0], F3, 1, 1, 0, 0, 0);
    oidnCommitFilter(empty);
    ERROR(device, UNKNOWN);
    oidnReleaseFilter(empty);
    for (i = 0; i < COUNT(sizes); i++) {
        const size_t width = sizes[i][0], height = sizes[i][1];
        OIDNFilter filter = new_identity(device, pixels[0], pixels[3], width, height);
        int called = 0;

        oidnSetFilterProgressMonitorFunction(filter, fail_if_called, &called);
        pixels[3][0] = -7;
        pixels[0][0] = 0.5f;
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK_EQ(called, width && height);
        CHECK((pixels[3][0] == -7) == !(width && height));
        oidnExecuteFilterAsync(filter);
        oidnSyncDevice(device);
        ERROR(device, NONE);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(filter_creation);
    RUN(filter_values);
    RUN(filter_value_names);
    RUN(filter_quality);
    RUN(image_rules);
    RUN(shared_image_rules);
    RUN(weights_data);
    RUN(weights_corrupted);
    RUN(weights_large);
    RUN(empty_images);
    free_identity();
    return check_report();
}
