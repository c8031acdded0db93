/* How far two images lie apart on a display: against the formula in double precision. */
#include "../../lib/exec_difference.h"
#include "check.h"

#include <math.h>
#include <stdint.h>

enum { W = 75, H = 6 };

static float left[3 * W * H], right[3 * W * H];

static lull_image view(float *data, unsigned channels)
{
    lull_image image = {0};
    image.data = data;
    image.channels = channels;
    return image;
}

static lull_frame frame_of(lull_content content, unsigned features)
{
    return lull_frame_default(W, H, content, features);
}

/* Values from below black to far above white, the right ones a little brighter. */
static void fill(float brightest)
{
    uint32_t state = 3;
    for (size_t i = 0; i < 3 * W * H; i++) {
        state = state * 1664525u + 1013904223u;
        left[i] = brightest * ((float)(state >> 8) / 8388608.0f - 0.5f);
        right[i] = left[i] + 0.02f;
    }
}

static double srgb(double x)
{
    return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055;
}

static double show(double x, const lull_frame *frame, double scale)
{
    int is_hdr = frame->content == LULL_HDR || frame->content == LULL_LIGHTMAP_HDR;
    x *= scale;
    if (frame->content == LULL_LIGHTMAP_DIR || frame->features == LULL_HAS_NORMAL)
        return fmin(fmax(x, -1), 1) / 2 + 0.5;
    x = is_hdr ? fmax(x, 0) / (1 + fmax(x, 0)) : fmin(fmax(x, 0), 1);
    return frame->content == LULL_SRGB ? x : srgb(x);
}

static double formula(const lull_frame *frame, double scale)
{
    double sum = 0;
    for (size_t i = 0; i < 3 * W * H; i++) {
        double d = show((double)left[i], frame, scale) - show((double)right[i], frame, scale);
        sum += d * d * LULL_DISPLAY_WHITE * LULL_DISPLAY_WHITE;
    }
    return sum;
}

static void follows_the_formula(void)
{
    static const struct {
        lull_content content;
        unsigned features;
        float scale, brightest;
    } rows[] = {
        {LULL_HDR, LULL_HAS_COLOR, 1, 1},
        {LULL_HDR, LULL_HAS_COLOR, 0.01f, 1000},
        {LULL_LIGHTMAP_HDR, LULL_HAS_COLOR, 3, 1},
        {LULL_LDR, LULL_HAS_COLOR, 1, 1.5f},
        {LULL_LDR, LULL_HAS_ALBEDO, 1, 1.5f},
        {LULL_SRGB, LULL_HAS_COLOR, 1, 1.5f},
        {LULL_LIGHTMAP_DIR, LULL_HAS_COLOR, 1, 1.5f},
        {LULL_LDR, LULL_HAS_NORMAL, 1, 1.5f},
    };
    const lull_image a = view(left, 3), b = view(right, 3);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const lull_frame frame = frame_of(rows[i].content, rows[i].features);
        double expected, found;
        fill(rows[i].brightest);
        expected = formula(&frame, (double)rows[i].scale);
        found = (double)lull_difference(&a, &b, &frame, rows[i].scale);
        /* Codes are rounded: by chance up and down, half a code at most. */
        if (!CHECK(fabs(found - expected) < 0.02 * expected + 0.5 * 3 * W * H))
            printf("  row %u: %g, %g\n", (unsigned)i, found, expected);
        CHECK_EQ(lull_difference(&b, &a, &frame, rows[i].scale), (uint64_t)found);
        CHECK_EQ(lull_difference(&a, &a, &frame, rows[i].scale), 0);
    }
}

static void black_and_white(void)
{
    const lull_frame frame = frame_of(LULL_SRGB, LULL_HAS_COLOR);
    const lull_image a = view(left, 3), b = view(right, 3), grey[2] = {view(left, 1),
                                                                      view(right, 1)};
    const uint64_t most = (uint64_t)LULL_DISPLAY_WHITE * LULL_DISPLAY_WHITE;
    for (size_t i = 0; i < 3 * W * H; i++) {
        left[i] = 0;
        right[i] = 1;
    }
    CHECK(lull_difference(&a, &b, &frame, 1) == 3 * W * H * most);
    CHECK(lull_difference(&grey[0], &grey[1], &frame, 1) == 3 * W * H * most);
}

/* Sums of parts are that of the whole. */
static void parts_add_up(void)
{
    lull_frame frame = frame_of(LULL_HDR, LULL_HAS_COLOR), part = frame;
    lull_image a = view(left, 3), b = view(right, 3);
    uint64_t sum = 0;
    fill(2);
    a.row_stride = b.row_stride = 3 * W * sizeof(float);
    part.height = 1;
    for (unsigned y = 0; y < H; y++) {
        lull_image row[2] = {a, b};
        row[0].data = left + (size_t)3 * W * y;
        row[1].data = right + (size_t)3 * W * y;
        sum += lull_difference(&row[0], &row[1], &part, 0.5f);
    }
    CHECK(sum > 0 && sum == lull_difference(&a, &b, &frame, 0.5f));
}

/* What no sane result holds, or no scale should be, is still a number. */
static void odd_values(void)
{
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e-40f, 0};
    static const float scales[] = {0, 1e-38f, 3e38f, INFINITY, -1};
    const lull_image a = view(left, 3), b = view(right, 3);
    const uint64_t most = (uint64_t)LULL_DISPLAY_WHITE * LULL_DISPLAY_WHITE;
    for (size_t i = 0; i < 3 * W * H; i++) {
        left[i] = odd[i % 7];
        right[i] = odd[i / 7 % 7];
    }
    for (unsigned content = 0; content < LULL_CONTENT_COUNT; content++)
        for (size_t s = 0; s < sizeof scales / sizeof *scales; s++) {
            const lull_frame frame = frame_of((lull_content)content, LULL_HAS_COLOR);
            CHECK(lull_difference(&a, &b, &frame, scales[s]) <= 3 * W * H * most);
        }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(follows_the_formula);
    RUN(black_and_white);
    RUN(parts_add_up);
    RUN(odd_values);
    return check_report();
}
