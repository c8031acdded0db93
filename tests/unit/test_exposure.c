/* Auto-exposure against a double-precision reference, and its bits against recorded ones. */
#include "exposure.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "hash.h"
#include "image.h"
#include "kernels.h"

#define INF_BITS 0x7f800000u

/* The rule in doubles: mean over bins of log2 of the mean luminance. */
static double reference(const float *rgb, unsigned width, unsigned height)
{
    unsigned columns = (width + 15) / 16, rows = (height + 15) / 16, i, j, x, y, bins = 0;
    double sum = 0;
    for (i = 0; i < rows; ++i)
        for (j = 0; j < columns; ++j) {
            unsigned y0 = i * height / rows, y1 = (i + 1) * height / rows;
            unsigned x0 = j * width / columns, x1 = (j + 1) * width / columns;
            double mean = 0;
            for (y = y0; y < y1; ++y)
                for (x = x0; x < x1; ++x) {
                    double v[3];
                    unsigned c;
                    for (c = 0; c < 3; ++c) {
                        v[c] = rgb[(y * width + x) * 3 + c];
                        v[c] = isnan(v[c]) ? 0 : fmin(fmax(v[c], 0), FLT_MAX);
                    }
                    mean += 0.212671 * v[0] + 0.715160 * v[1] + 0.072169 * v[2];
                }
            mean /= (y1 - y0) * (x1 - x0);
            if (mean > 1e-8) {
                sum += log2(mean);
                ++bins;
            }
        }
    return bins ? 0.18 / exp2(sum / bins) : 1;
}

static lull_image view(float *rgb)
{
    lull_image image = {0};
    image.data = rgb;
    image.channels = 3;
    return image;
}

static float exposure_of(float *rgb, unsigned width, unsigned height)
{
    lull_image image = view(rgb);
    return lull_autoexposure(&image, width, height);
}

/* Brightness that changes over 40 stops in the image, with some invalid values. */
static float *make_image(unsigned width, unsigned height, uint32_t seed)
{
    size_t n = (size_t)width * height * 3, i;
    float *rgb = malloc(n * sizeof *rgb);
    for (i = 0; i < n; ++i)
        rgb[i] = (random_float(&seed) - 0.1f) * ldexpf(1.0f, (int)(40 * i / n) - 20);
    for (i = 17; i < n; i += 1009)
        rgb[i] = lull_float(i & 1 ? 0x7fc00000u : 0xff800000u); /* NaN, -infinity */
    return rgb;
}

static const unsigned sizes[][2] = {{1, 1},   {15, 17},  {16, 16}, {17, 15},  {33, 50}, {100, 7},
                                    {5, 999}, {333, 21}, {64, 64}, {257, 130}};
#define SIZES (sizeof sizes / sizeof *sizes)

static void agrees_with_doubles(void)
{
    double worst = 0;
    size_t s;
    for (s = 0; s < SIZES; ++s) {
        float *rgb = make_image(sizes[s][0], sizes[s][1], (uint32_t)s + 1);
        double expected = reference(rgb, sizes[s][0], sizes[s][1]);
        double error = fabs(exposure_of(rgb, sizes[s][0], sizes[s][1]) / expected - 1);
        worst = error > worst ? error : worst;
        free(rgb);
    }
    printf("     relative error at most %.2e\n", worst);
    CHECK(worst < 2e-6);
}

/* Rows computed in any order, and through the streaming interface: the same bits. */
static void does_not_depend_on_the_order_of_rows(void)
{
    size_t s;
    for (s = 0; s < SIZES; ++s) {
        unsigned width = sizes[s][0], height = sizes[s][1], n = lull_exposure_rows(height), i;
        float *rgb = make_image(width, height, 99);
        lull_image image = view(rgb);
        lull_exposure_row *rows = malloc(n * sizeof *rows);
        lull_kernels kernels;
        lull_kernels_fill(&kernels, LULL_PORTS_SCALAR); /* all ports are equal */
        CHECK_EQ(n, (height + 15) / 16);
        for (i = n; i-- > 0;)
            lull_exposure_bin_row(rows + i, &image, width, height, i, kernels.luminance);
        CHECK(lull_bits(lull_exposure_scale(rows, n))
              == lull_bits(lull_autoexposure(&image, width, height)));
        free(rows);
        free(rgb);
    }
}

static void does_not_depend_on_strides(void)
{
    enum { W = 37, H = 29, PIXEL = 21, ROW = W * PIXEL + 11 };
    float *rgb = make_image(W, H, 5);
    uint8_t *wide = malloc(H * ROW + 1);
    lull_image image = view((float *)(void *)rgb);
    unsigned x, y;
    memset(wide, 0xff, H * ROW + 1);
    for (y = 0; y < H; ++y)
        for (x = 0; x < W; ++x)
            memcpy(wide + 1 + y * ROW + x * PIXEL, rgb + (y * W + x) * 3, 12);
    image.data = wide + 1;
    image.pixel_stride = PIXEL;
    image.row_stride = ROW;
    CHECK(lull_bits(lull_autoexposure(&image, W, H)) == lull_bits(exposure_of(rgb, W, H)));
    free(wide);
    free(rgb);
}

static void half_and_grey_images_count_too(void)
{
    uint16_t grey[40 * 20];
    lull_image image = {0};
    unsigned i;
    for (i = 0; i < 40 * 20; ++i)
        grey[i] = lull_float_to_half(0.5f);
    image.data = grey;
    image.type = LULL_F16;
    image.channels = 1;
    CHECK(fabs(lull_autoexposure(&image, 40, 20) - 0.36) < 1e-6);
}

static void fill(float *rgb, size_t n, float v)
{
    size_t i;
    for (i = 0; i < n; ++i)
        rgb[i] = v;
}

static void knows_the_special_images(void)
{
    static float rgb[3 * 40 * 33];
    enum { W = 40, H = 33, N = 3 * W * H };
    lull_image none = {0};
    fill(rgb, N, 0.18f);
    CHECK(fabs(exposure_of(rgb, W, H) - 1) < 1e-6);
    fill(rgb, N, 0);
    CHECK(exposure_of(rgb, W, H) == 1);
    fill(rgb, N, 0.9e-8f); /* too dark to count */
    CHECK(exposure_of(rgb, W, H) == 1);
    fill(rgb, N, -1);
    CHECK(exposure_of(rgb, W, H) == 1);
    fill(rgb, N, lull_float(0x7fc00000u));
    CHECK(exposure_of(rgb, W, H) == 1);
    fill(rgb, N, lull_float(INF_BITS));
    CHECK(lull_bits(exposure_of(rgb, W, H)) == 0);
    CHECK(lull_bits(exposure_of(rgb, 1, 1)) == 0);
    fill(rgb, N, 0.18f); /* one infinite bin is enough */
    rgb[0] = rgb[3] = rgb[1] = rgb[4] = lull_float(INF_BITS);
    CHECK(lull_bits(exposure_of(rgb, W, H)) == 0);
    CHECK(exposure_of(rgb, 0, H) == 1);
    CHECK(exposure_of(rgb, W, 0) == 1);
    CHECK(lull_autoexposure(&none, W, H) == 1);
    CHECK(lull_autoexposure(NULL, W, H) == 1);
    CHECK(lull_exposure_scale(NULL, 0) == 1);
}

/* A large image of one brightness but for rounding: sums must not lose precision. */
static void stays_precise_over_many_bins(void)
{
    enum { ROWS = 4096 };
    static lull_exposure_row rows[ROWS];
    unsigned i;
    double scale;
    for (i = 0; i < ROWS; ++i) {
        rows[i].log_sum = -13.3f * 4096;
        rows[i].bins = 4096;
    }
    scale = lull_exposure_scale(rows, ROWS);
    CHECK(fabs(scale / (0.18 * exp2(13.3)) - 1) < 2e-6);
}

static void gives_the_recorded_bits(void)
{
    uint64_t hash = HASH_START;
    size_t s;
    for (s = 0; s < SIZES; ++s) {
        float *rgb = make_image(sizes[s][0], sizes[s][1], (uint32_t)s + 100);
        float scale = exposure_of(rgb, sizes[s][0], sizes[s][1]);
        hash = hash_floats(hash, &scale, 1);
        free(rgb);
    }
    if (!CHECK(hash == UINT64_C(0xbf4364b2d2c0e0eb)))
        printf("     0x%08lx%08lx\n", (unsigned long)(hash >> 32),
               (unsigned long)(hash & 0xffffffffu));
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(agrees_with_doubles);
    RUN(does_not_depend_on_the_order_of_rows);
    RUN(does_not_depend_on_strides);
    RUN(half_and_grey_images_count_too);
    RUN(knows_the_special_images);
    RUN(stays_precise_over_many_bins);
    RUN(gives_the_recorded_bits);
    return check_report();
}
