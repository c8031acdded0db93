/* Half conversion (exhaustive), rows of images in every format, and sanitising. */
#include "image.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "hash.h"

#define INF_BITS 0x7f800000u
#define GUARD 0xa5

/* Value of a half, straight from the definition. */
static double half_value(uint16_t h)
{
    int exponent = h >> 10 & 31, mantissa = h & 1023;
    double v = exponent ? ldexp(1024 + mantissa, exponent - 25) : ldexp(mantissa, -24);
    return h & 0x8000 ? -v : v;
}

static int is_half_nan(uint16_t h) { return (h & 0x7fff) > 0x7c00; }

/* ---- Half ------------------------------------------------------------------------------------ */

static void every_half_is_exact_as_float(void)
{
    uint32_t h;
    for (h = 0; h < 65536; ++h) {
        float f = lull_half_to_float((uint16_t)h);
        if (is_half_nan((uint16_t)h))
            CHECK(lull_is_nan(f) && lull_bits(f) >> 31 == h >> 15);
        else if ((h & 0x7fff) == 0x7c00)
            CHECK(lull_bits(f) == (h >> 15 << 31 | INF_BITS));
        else
            CHECK((double)f == half_value((uint16_t)h) && lull_bits(f) >> 31 == h >> 15);
    }
}

static void every_half_survives_the_round_trip(void)
{
    uint32_t h;
    for (h = 0; h < 65536; ++h) {
        uint16_t back = lull_float_to_half(lull_half_to_float((uint16_t)h));
        int nans = is_half_nan((uint16_t)h) && is_half_nan(back);
        CHECK(back == h || (nans && back >> 15 == h >> 15));
    }
}

/* The midpoint between each two neighbours goes to the even one; the floats beside it do not. */
static void floats_around_every_tie_round_to_even(void)
{
    uint32_t h, sign;
    for (sign = 0; sign < 2; ++sign)
        for (h = 0; h < 0x7c00; ++h) {
            uint32_t up = h + 1, s = sign << 15, middle;
            double next = up < 0x7c00 ? half_value((uint16_t)up) : 65536.0;
            float tie = (float)((half_value((uint16_t)h) + next) / 2); /* exact */
            middle = lull_bits(tie) | sign << 31;
            CHECK_EQ(lull_float_to_half(lull_float(middle)), s | (h & 1 ? up : h));
            CHECK_EQ(lull_float_to_half(lull_float(middle - 1)), s | h);
            CHECK_EQ(lull_float_to_half(lull_float(middle + 1)), s | up);
        }
}

static void extreme_floats_become_half(void)
{
    CHECK_EQ(lull_float_to_half(lull_float(INF_BITS)), 0x7c00);
    CHECK_EQ(lull_float_to_half(-FLT_MAX), 0xfc00);
    CHECK_EQ(lull_float_to_half(FLT_MIN), 0);
    CHECK_EQ(lull_float_to_half(lull_float(0x80000001u)), 0x8000);
    CHECK(is_half_nan(lull_float_to_half(lull_float(0x7f800001u))));
    CHECK(is_half_nan(lull_float_to_half(lull_float(0xffffffffu))));
}

/* ---- Rows ------------------------------------------------------------------------------------ */

typedef struct layout {
    lull_type type;
    unsigned channels;
    unsigned gap, row_gap, shift; /* bytes after pixels, after rows, before the first pixel */
} layout;

enum { WIDTH = 7, HEIGHT = 3 };

static size_t element_bytes(lull_type type) { return type == LULL_F16 ? 2 : 4; }

/* A block of exactly the bytes of the image, at any alignment, so that sanitizers see each byte
 * outside; all GUARD. *block is to be freed. */
static lull_image make_image(uint8_t **block, size_t *bytes, const layout *l)
{
    lull_image image = {0};
    size_t pixel = element_bytes(l->type) * l->channels;
    image.type = l->type;
    image.channels = l->channels;
    image.pixel_stride = l->gap ? pixel + l->gap : 0;
    pixel += l->gap;
    image.row_stride = l->row_gap ? WIDTH * pixel + l->row_gap : 0;
    *bytes = l->shift + HEIGHT * (WIDTH * pixel + l->row_gap) - l->row_gap - l->gap;
    *block = malloc(*bytes);
    memset(*block, GUARD, *bytes);
    image.data = *block + l->shift;
    return image;
}

static uint8_t *element_at(const lull_image *image, unsigned x, unsigned y, unsigned c)
{
    size_t pixel = image->pixel_stride ? (size_t)image->pixel_stride
                                       : element_bytes(image->type) * image->channels;
    size_t row = image->row_stride ? (size_t)image->row_stride : WIDTH * pixel;
    return (uint8_t *)image->data + y * row + x * pixel + c * element_bytes(image->type);
}

static void put(uint8_t *p, lull_type type, float f)
{
    uint16_t h = lull_float_to_half(f);
    if (type == LULL_F16)
        memcpy(p, &h, sizeof h);
    else
        memcpy(p, &f, sizeof f);
}

/* A value of its own for every element, NaN and infinities among them. */
static float sample(unsigned x, unsigned y, unsigned c)
{
    static const uint32_t odd[] = {0x7fc00000u, INF_BITS, 0xff800000u, 0x80000000u, 0x33800000u};
    unsigned i = (y * WIDTH + x) * 3 + c;
    return i % 9 == 4 ? lull_float(odd[i / 9 % 5]) : (float)i - 8.5f;
}

static void for_all_layouts(void (*test)(const layout *l))
{
    static const unsigned gaps[] = {0, 1, 4, 13};
    layout l;
    unsigned type, gap, row_gap;
    for (type = 0; type < 2; ++type)
        for (l.channels = 1; l.channels <= 3; ++l.channels)
            for (gap = 0; gap < 4; ++gap)
                for (row_gap = 0; row_gap < 4; ++row_gap)
                    for (l.shift = 0; l.shift < 4; ++l.shift) {
                        l.type = (lull_type)type;
                        l.gap = gaps[gap];
                        l.row_gap = gaps[row_gap];
                        test(&l);
                    }
}

static void check_load(const layout *l)
{
    uint8_t *block;
    size_t bytes;
    lull_image image = make_image(&block, &bytes, l);
    unsigned x, y, n, c, i;
    for (y = 0; y < HEIGHT; ++y)
        for (x = 0; x < WIDTH; ++x)
            for (c = 0; c < l->channels; ++c)
                put(element_at(&image, x, y, c), l->type, sample(x, y, c));
    for (y = 0; y < HEIGHT; ++y)
        for (x = 0; x < WIDTH; ++x)
            for (n = 0; n <= WIDTH - x; ++n) {
                float *out = malloc(3 * n * sizeof *out + 1);
                lull_image_load(out, &image, WIDTH, x, y, n);
                for (i = 0; i < n; ++i)
                    for (c = 0; c < 3; ++c) {
                        unsigned from = c < l->channels ? c : l->channels - 1;
                        float expected = sample(x + i, y, from);
                        CHECK(lull_bits(out[3 * i + c]) == lull_bits(expected));
                    }
                free(out);
            }
    free(block);
}

static void loads_every_layout(void) { for_all_layouts(check_load); }

static void check_store(const layout *l)
{
    unsigned x, y, n, c, i;
    for (y = 0; y < HEIGHT; ++y)
        for (x = 0; x < WIDTH; ++x)
            for (n = 0; n <= WIDTH - x; n += 2) {
                uint8_t *block, *expected_block;
                size_t bytes;
                lull_image expected = make_image(&expected_block, &bytes, l);
                lull_image image = make_image(&block, &bytes, l);
                float in[3 * WIDTH];
                for (i = 0; i < n; ++i)
                    for (c = 0; c < 3; ++c) {
                        in[3 * i + c] = sample(x + i, y, c);
                        if (c < l->channels)
                            put(element_at(&expected, x + i, y, c), l->type, in[3 * i + c]);
                    }
                lull_image_store(&image, WIDTH, x, y, n, in);
                CHECK(memcmp(block, expected_block, bytes) == 0);
                free(block);
                free(expected_block);
            }
}

static void stores_every_layout(void) { for_all_layouts(check_store); }

static void fills_in_strides(void)
{
    lull_image image = {0};
    image.channels = 3;
    CHECK_EQ(lull_image_pixel_bytes(&image), 12);
    CHECK_EQ(lull_image_pixel_stride(&image), 12);
    CHECK_EQ(lull_image_row_stride(&image, 65536), 65536 * 12);
    image.type = LULL_F16;
    image.channels = 2;
    image.pixel_stride = 9;
    CHECK_EQ(lull_image_pixel_bytes(&image), 4);
    CHECK_EQ(lull_image_pixel_stride(&image), 9);
    CHECK_EQ(lull_image_row_stride(&image, 10), 90);
    image.row_stride = 77;
    CHECK_EQ(lull_image_row_stride(&image, 10), 77);
}

/* ---- Sanitising ------------------------------------------------------------------------------ */

static float sanitized(float v, float scale, float lo, float hi)
{
    lull_sanitize(&v, 1, scale, lo, hi);
    return v;
}

static void sanitizes_single_values(void)
{
    float nan = lull_float(0x7fc00000u), inf = lull_float(INF_BITS);
    CHECK(lull_bits(sanitized(nan, 1, 0, FLT_MAX)) == 0);
    CHECK(lull_bits(sanitized(lull_float(0xff800001u), 1, -1, 1)) == 0);
    CHECK(sanitized(nan, 1, 0.25f, 1) == 0.25f);
    CHECK(sanitized(inf, 1, 0, FLT_MAX) == FLT_MAX);
    CHECK(sanitized(-inf, 1, 0, FLT_MAX) == 0);
    CHECK(lull_bits(sanitized(inf, 0, 0, FLT_MAX)) == 0); /* the product is a NaN */
    CHECK(sanitized(3, 0.25f, 0, 1) == 0.75f);
    CHECK(sanitized(3, 2, 0, 1) == 1);
    CHECK(sanitized(-3, 1, -1, 1) == -1);
    CHECK(sanitized(FLT_MAX, 4, 0, FLT_MAX) == FLT_MAX);
    CHECK(lull_bits(sanitized(1e-40f, 1e10f, 0, 1)) == 0);
    CHECK(lull_bits(sanitized(-1e-40f, 1, -1, 1)) == 0);
    CHECK(lull_bits(sanitized(-0.0f, 1, -1, 1)) == 0);
    CHECK(lull_bits(sanitized(1e-20f, 1e-20f, 0, 1)) == 0);
}

static void sanitizes_runs_of_any_length(void)
{
    enum { MOST = 70 };
    float values[MOST + 1], source[MOST];
    uint32_t seed = 7;
    size_t n, i;
    for (i = 0; i < MOST; ++i)
        source[i] = lull_float(random_bits(&seed));
    for (n = 0; n <= MOST; ++n) {
        memcpy(values, source, n * sizeof *values);
        values[n] = -77;
        lull_sanitize(values, n, 0.3f, -1, 1);
        for (i = 0; i < n; ++i)
            CHECK(lull_bits(values[i]) == lull_bits(sanitized(source[i], 0.3f, -1, 1)));
        CHECK(values[n] == -77);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(every_half_is_exact_as_float);
    RUN(every_half_survives_the_round_trip);
    RUN(floats_around_every_tie_round_to_even);
    RUN(extreme_floats_become_half);
    RUN(loads_every_layout);
    RUN(stores_every_layout);
    RUN(fills_in_strides);
    RUN(sanitizes_single_values);
    RUN(sanitizes_runs_of_any_length);
    return check_report();
}
