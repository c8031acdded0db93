/* The contract of commits, row by row: what they accept, and what makes one necessary. */
#include "api.h"

#include <limits.h>

static float pixels[4][3 * 64 * 64];

/* ---- What a commit accepts ------------------------------------------------------------------- */

typedef struct commit_row {
    const char *type;
    int color, albedo, normal, output; /* formats; 0: not set */
    const char *flags;                 /* h hdr, s srgb, d directional, c cleanAux */
    int odd;                           /* image that is larger than the others: c a n; 0: none */
    OIDNError error;
} commit_row;

static const commit_row commits[] = {
    /* nothing to work on */
    {"RT", 0, 0, 0, 0, "", 0, OPERATION},
    {"RT", 0, 0, 0, F3, "", 0, OPERATION},
    {"RT", F3, 0, 0, 0, "", 0, OPERATION},
    {"RTLightmap", 0, 0, 0, F3, "", 0, OPERATION},
    /* every set of inputs */
    {"RT", F3, 0, 0, F3, "", 0, NONE},
    {"RT", F3, 0, 0, F3, "h", 0, NONE},
    {"RT", F3, 0, 0, F3, "s", 0, NONE},
    {"RT", F3, F3, 0, F3, "", 0, NONE},
    {"RT", F3, F3, 0, F3, "h", 0, NONE},
    {"RT", F3, F3, 0, F3, "hc", 0, NONE},
    {"RT", F3, F3, F3, F3, "", 0, NONE},
    {"RT", F3, F3, F3, F3, "h", 0, NONE},
    {"RT", F3, F3, F3, F3, "s", 0, NONE},
    {"RT", F3, F3, F3, F3, "hc", 0, NONE},
    {"RT", F3, F3, F3, F3, "c", 0, NONE},
    {"RT", F3, 0, F3, F3, "", 0, NONE}, /* more than Open Image Denoise has a model for */
    {"RT", F3, 0, F3, F3, "h", 0, NONE},
    {"RT", 0, F3, 0, F3, "", 0, NONE},
    {"RT", 0, F3, 0, F3, "s", 0, NONE},
    {"RT", 0, 0, F3, F3, "", 0, NONE},
    {"RT", 0, 0, F3, F3, "c", 0, NONE},
    {"RTLightmap", F3, 0, 0, F3, "", 0, NONE},
    {"RTLightmap", F3, 0, 0, F3, "d", 0, NONE},
    /* and those that there are not */
    {"RT", F3, 0, 0, F3, "hs", 0, OPERATION},
    {"RT", F3, F3, F3, F3, "hs", 0, OPERATION},
    {"RT", 0, F3, 0, F3, "h", 0, OPERATION},
    {"RT", 0, 0, F3, F3, "h", 0, OPERATION},
    {"RT", 0, 0, F3, F3, "s", 0, OPERATION},
    {"RT", 0, F3, F3, F3, "", 0, OPERATION},
    {"RT", 0, F3, F3, F3, "h", 0, OPERATION},
    /* formats */
    {"RT", F1, 0, 0, F1, "", 0, NONE},
    {"RT", F2, 0, 0, F2, "h", 0, NONE},
    {"RT", H3, 0, 0, F3, "", 0, NONE},
    {"RT", F3, 0, 0, H3, "", 0, NONE},
    {"RT", F1, 0, 0, H1, "", 0, NONE},
    {"RT", F3, F1, H1, H3, "h", 0, NONE},
    {"RT", F1, F3, F2, F1, "h", 0, NONE},
    {"RT", F4, 0, 0, F4, "", 0, OPERATION},
    {"RT", H4, 0, 0, H3, "", 0, OPERATION},
    {"RT", F3, F4, 0, F3, "", 0, OPERATION},
    {"RT", F3, F3, H4, F3, "", 0, OPERATION},
    {"RT", F3, 0, 0, F4, "", 0, OPERATION},
    {"RT", F3, 0, 0, F1, "", 0, OPERATION},
    {"RT", F1, 0, 0, F3, "", 0, OPERATION},
    {"RT", F1, F3, 0, F3, "", 0, OPERATION},
    {"RT", 0, F1, 0, F3, "", 0, OPERATION},
    {"RTLightmap", F1, 0, 0, F1, "", 0, NONE},
    /* sizes */
    {"RT", F3, 0, 0, F3, "", 'c', OPERATION},
    {"RT", F3, F3, 0, F3, "", 'a', OPERATION},
    {"RT", F3, F3, F3, F3, "h", 'n', OPERATION},
};

/* The error of a row; the real library has no model for colour with normals alone. */
static OIDNError row_error(const commit_row *row)
{
    return is_peer() && row->color && !row->albedo && row->normal ? OPERATION : row->error;
}

static void set_row_image(OIDNFilter filter, const commit_row *row, const char *name, int format,
                          int index)
{
    if (format)
        oidnSetSharedFilterImage(filter, name, pixels[index], (OIDNFormat)format, 7,
                                 row->odd == name[0] ? 6 : 5, 0, 0, 0);
}

static void commit_rules(void)
{
    OIDNDevice device;
    size_t i;

    WANTS_BUILTIN();
    device = new_device();
    for (i = 0; i < COUNT(commits); i++) {
        const commit_row *row = &commits[i];
        const OIDNError expected = row_error(row);
        OIDNFilter filter = oidnNewFilter(device, row->type);
        OIDNError error;

        set_row_image(filter, row, "color", row->color, 0);
        set_row_image(filter, row, "albedo", row->albedo, 1);
        set_row_image(filter, row, "normal", row->normal, 2);
        set_row_image(filter, row, "output", row->output, 3);
        oidnSetFilterBool(filter, "hdr", strchr(row->flags, 'h') != NULL);
        oidnSetFilterBool(filter, "srgb", strchr(row->flags, 's') != NULL);
        oidnSetFilterBool(filter, "cleanAux", strchr(row->flags, 'c') != NULL);
        oidnSetFilterBool(filter, "directional", strchr(row->flags, 'd') != NULL);
        ERROR(device, NONE);
        oidnCommitFilter(filter);
        error = take_error(device);
        if (!CHECK_EQ(error, expected))
            printf("  row %u\n", (unsigned)i);
        oidnExecuteFilter(filter);
        CHECK_EQ(take_error(device), expected == NONE ? NONE : OPERATION);
        if (expected == NONE) {
            CHECK_EQ(oidnGetFilterInt(filter, "tileAlignment"), 16);
            CHECK(oidnGetFilterInt(filter, "tileOverlap") >= 96);
        } else {
            CHECK_EQ(oidnGetFilterInt(filter, "tileAlignment"), 1);
            CHECK_EQ(oidnGetFilterInt(filter, "tileOverlap"), 0);
        }
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* Every accepted combination with built-in weights leaves a grey image about as it is. */
static void builtin_outputs(void)
{
    enum { SIZE = 40 };
    OIDNDevice device;
    size_t i, k;

    WANTS_BUILTIN();
    device = new_device();
    for (i = 0; i < COUNT(commits); i++) {
        static const char *const names[] = {"color", "albedo", "normal", "output"};
        const int formats[] = {commits[i].color, commits[i].albedo, commits[i].normal,
                               commits[i].output};
        OIDNFilter filter;
        float low = 9, high = -9;

        if (row_error(&commits[i]) != NONE || commits[i].output != F3)
            continue;
        filter = oidnNewFilter(device, commits[i].type);
        for (k = 0; k < 3 * SIZE * SIZE; k++) {
            pixels[0][k] = pixels[1][k] = 0.5f;
            pixels[2][k] = 0.57735f;
            pixels[3][k] = -1;
        }
        for (k = 0; k < 4; k++)
            if (formats[k])
                oidnSetSharedFilterImage(filter, names[k], pixels[k], F3, SIZE, SIZE, 0, 0, 0);
        oidnSetFilterBool(filter, "hdr", strchr(commits[i].flags, 'h') != NULL);
        oidnSetFilterBool(filter, "srgb", strchr(commits[i].flags, 's') != NULL);
        oidnSetFilterBool(filter, "cleanAux", strchr(commits[i].flags, 'c') != NULL);
        oidnSetFilterBool(filter, "directional", strchr(commits[i].flags, 'd') != NULL);
        oidnCommitFilter(filter);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        for (k = 0; k < 3 * SIZE * SIZE; k++) {
            low = pixels[3][k] < low ? pixels[3][k] : low;
            high = pixels[3][k] > high ? pixels[3][k] : high;
        }
        if (!CHECK(low > 0.25f && high < 0.85f))
            printf("  row %u: %g to %g\n", (unsigned)i, low, high);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* With weights of the caller the number of inputs decides. */
static void commit_user_weights(void)
{
    static const struct {
        int albedo, normal;
        unsigned inputs;
        OIDNError error;
    } rows[] = {
        {0, 0, 3, NONE},     {F3, 0, 6, NONE},     {F3, F3, 9, NONE},  {0, F3, 6, NONE},
        {F3, 0, 3, UNKNOWN}, {F3, F3, 6, UNKNOWN}, {0, 0, 9, UNKNOWN},
    };
    OIDNDevice device = new_device();
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        OIDNFilter filter = oidnNewFilter(device, "RT");

        oidnSetSharedFilterImage(filter, "color", pixels[0], F3, 5, 5, 0, 0, 0);
        oidnSetSharedFilterImage(filter, "output", pixels[3], F3, 5, 5, 0, 0, 0);
        if (rows[i].albedo)
            oidnSetSharedFilterImage(filter, "albedo", pixels[1], F3, 5, 5, 0, 0, 0);
        if (rows[i].normal)
            oidnSetSharedFilterImage(filter, "normal", pixels[2], F3, 5, 5, 0, 0, 0);
        use_identity(filter, rows[i].inputs);
        oidnCommitFilter(filter);
        if (!CHECK_EQ(take_error(device), rows[i].error))
            printf("  row %u\n", (unsigned)i);
        oidnReleaseFilter(filter);
    }
    oidnReleaseDevice(device);
}

/* A filter that failed to commit keeps failing to execute until it is repaired. */
static void commit_repaired(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = new_identity(device, pixels[0], pixels[3], 5, 5);

    CHECK_EQ(oidnGetFilterInt(filter, "tileAlignment"), 16);
    CHECK_EQ(oidnGetFilterInt(filter, "tileOverlap"), 96);
    CHECK_EQ(oidnGetFilterInt(filter, "overlap"), 96);
    oidnSetSharedFilterImage(filter, "output", pixels[3], F3, 5, 6, 0, 0, 0);
    oidnExecuteFilter(filter);
    ERROR(device, OPERATION);
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnExecuteFilter(filter);
    ERROR(device, OPERATION);
    oidnExecuteFilterAsync(filter);
    ERROR(device, OPERATION);
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnSetSharedFilterImage(filter, "color", pixels[0], F3, 5, 6, 0, 0, 0);
    oidnCommitFilter(filter);
    ERROR(device, NONE);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnCommitFilter(filter); /* nothing changed */
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

/* ---- What makes a commit necessary ----------------------------------------------------------- */

static bool ignore_progress(void *user, double n)
{
    (void)user;
    return n >= 0;
}

static void change(OIDNFilter filter, int what)
{
    static char bytes[4];

    switch (what) {
    case 0:
        oidnSetFilterBool(filter, "hdr", false);
        break;
    case 1:
        oidnSetFilterInt(filter, "quality", 6);
        break;
    case 2:
        oidnSetFilterFloat(filter, "inputScale", 1);
        break;
    case 3:
        oidnSetFilterInt(filter, "maxMemoryMB", -1);
        break;
    case 4:
        oidnSetFilterBool(filter, "nonsense", true);
        break;
    case 5:
        oidnSetFilterInt(filter, "nonsense", 1);
        break;
    case 6:
        oidnSetFilterFloat(filter, "nonsense", 1);
        break;
    case 7:
        oidnSetFilterFloat(filter, "hdr", 1);
        break;
    case 8:
        oidnSetFilterInt(filter, "tileOverlap", 1);
        break;
    case 9:
        oidnSetSharedFilterImage(filter, "color", pixels[0], F3, 5, 5, 0, 0, 0);
        break;
    case 10:
        oidnSetSharedFilterImage(filter, "nonsense", pixels[0], F3, 5, 5, 0, 0, 0);
        break;
    case 11:
        oidnUnsetFilterImage(filter, "albedo");
        break;
    case 12:
        oidnUnsetFilterImage(filter, "nonsense");
        break;
    case 13:
        oidnSetSharedFilterData(filter, "nonsense", bytes, 4);
        break;
    case 14:
        oidnUpdateFilterData(filter, "nonsense");
        break;
    case 15:
        oidnUnsetFilterData(filter, "nonsense");
        break;
    case 16:
        oidnUpdateFilterData(filter, "weights");
        break;
    case 17:
        use_identity(filter, 3);
        break;
    case 18: /* names of another kind */
        oidnSetSharedFilterImage(filter, "weights", pixels[0], F3, 5, 5, 0, 0, 0);
        break;
    case 19:
        oidnSetSharedFilterData(filter, "color", bytes, 4);
        break;
    case 20:
        oidnSetFilterInt(filter, "color", 1);
        break;
    case 21:
        oidnUnsetFilterData(filter, "output");
        break;
    case 22:
        oidnUnsetFilterImage(filter, "hdr");
        break;
    default:
        break;
    }
}

/* Declared for C++ only, and exported with C linkage. */
void oidnExecuteSYCLFilterAsync(OIDNFilter filter, const void *events, int count, void *done);

static void what_dirties(void)
{
    OIDNDevice device = new_device();
    OIDNFilter filter = new_identity(device, pixels[0], pixels[3], 5, 5);
    int i;

    for (i = 0; i < 23; i++) {
        change(filter, i);
        ERROR(device, NONE);
        oidnExecuteFilter(filter);
        if (!CHECK_EQ(take_error(device), OPERATION))
            printf("  change %d\n", i);
        oidnCommitFilter(filter);
        ERROR(device, NONE);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
    }
    oidnSetFilterProgressMonitorFunction(filter, ignore_progress, NULL);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnSetFilterProgressMonitorFunction(filter, NULL, NULL);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    CHECK_EQ(oidnGetFilterInt(filter, "quality"), 6); /* getting does not dirty, even in error */
    oidnGetFilterInt(filter, "nonsense");
    ERROR(device, ARGUMENT);
    oidnExecuteSYCLFilterAsync(filter, NULL, 0, NULL);
    ERROR(device, OPERATION);
    oidnSetFilterInt(filter, "quality", 77);
    ERROR(device, ARGUMENT);
    oidnSetSharedFilterImage(filter, "color", pixels[0], (OIDNFormat)99, 5, 5, 0, 0, 0);
    ERROR(device, ARGUMENT);
    oidnSetSharedFilterData(filter, "weights", NULL, 9);
    ERROR(device, ARGUMENT);
    oidnExecuteFilter(filter);
    ERROR(device, NONE);
    oidnSetSharedFilterData(filter, "weights", pixels[0], 0); /* an empty file is none */
    oidnCommitFilter(filter);
    ERROR(device, OPERATION);
    oidnSetSharedFilterData(filter, "weights", NULL, 0);
    oidnCommitFilter(filter);
    ERROR(device, NONE);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(commit_rules);
    RUN(builtin_outputs);
    RUN(commit_user_weights);
    RUN(commit_repaired);
    RUN(what_dirties);
    free_identity();
    return check_report();
}
