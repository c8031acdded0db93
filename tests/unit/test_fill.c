/* lull_fill: texels without a surface get the light of the nearest one that has. */
#include "../check.h"

#include "../../lib/lull.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { W = 53, H = 41, TEXELS = W * H };

static float color[3 * TEXELS], normal[3 * TEXELS], result[3 * TEXELS];
static uint32_t memory[TEXELS];

static lull_image floats(float *data, unsigned channels)
{
    return (lull_image){.data = data, .type = LULL_F32, .channels = channels};
}

/* Light that says where it is from, and surfaces in a share of the texels. */
static void make(unsigned seed, unsigned one_in)
{
    for (int i = 0; i < TEXELS; i++) {
        seed = seed * 1664525u + 1013904223u;
        normal[3 * i] = normal[3 * i + 1] = normal[3 * i + 2] = 0;
        if ((seed >> 8) % one_in == 0)
            normal[3 * i + (seed >> 4) % 3] = (seed >> 30) & 1 ? -1.0f : 0.5f;
        color[3 * i] = (float)(i % W);
        color[3 * i + 1] = (float)(i / W);
        color[3 * i + 2] = (float)seed;
    }
}

static int has_surface(int i)
{
    return normal[3 * i] != 0 || normal[3 * i + 1] != 0 || normal[3 * i + 2] != 0;
}

static lull_status fill(float *output)
{
    const lull_image out = floats(output, 3), in = floats(color, 3), n = floats(normal, 3);

    return lull_fill(&out, &in, &n, W, H, memory, sizeof memory);
}

/* Square of the distance of two texels, and of the nearest surface. */
static int apart(int i, int k)
{
    const int x = i % W - k % W, y = i / W - k / W;

    return x * x + y * y;
}

static int least_apart(int i)
{
    int least = 2 * TEXELS * TEXELS;

    for (int k = 0; k < TEXELS; k++)
        if (has_surface(k) && apart(i, k) < least)
            least = apart(i, k);
    return least;
}

static void nearest_surfaces_are_found(void)
{
    static const unsigned shares[] = {1, 2, 7, 60, 700, 3000};

    CHECK_EQ(lull_fill_size(W, H), sizeof memory);
    for (size_t s = 0; s < sizeof shares / sizeof shares[0]; s++) {
        int wrong = 0;

        make((unsigned)s, shares[s]);
        CHECK_EQ(fill(result), LULL_OK);
        for (int i = 0; i < TEXELS; i++) {
            const int from = (int)(result[3 * i + 1] * W + result[3 * i]);
            const double more = sqrt(apart(i, from)) - sqrt(least_apart(i));

            CHECK(has_surface(from));
            CHECK(!memcmp(result + 3 * i, color + 3 * from, 3 * sizeof(float)));
            CHECK(from == i || !has_surface(i));
            CHECK(more < 1);
            wrong += more > 0;
        }
        CHECK(wrong <= TEXELS / 200);
    }
}

static void in_its_own_place(void)
{
    make(5, 20);
    CHECK_EQ(fill(result), LULL_OK);
    CHECK_EQ(fill(color), LULL_OK);
    CHECK(!memcmp(color, result, sizeof result));
}

static void without_any_surface_all_stays(void)
{
    make(5, 20);
    memset(normal, 0, sizeof normal);
    normal[33] = NAN; /* no number is no normal */
    CHECK_EQ(fill(result), LULL_OK);
    CHECK(!memcmp(color, result, sizeof result));
}

/* Rows of one channel in halves with gaps, from the last one up. */
static void other_images(void)
{
    enum { STEP = 3, ROW = W * STEP + 5 };
    static uint16_t grey[H * ROW], output[H * ROW];
    lull_image in = {.data = grey + (H - 1) * ROW, .type = LULL_F16, .channels = 1,
                     .pixel_stride = 2 * STEP, .row_stride = -2 * ROW};
    lull_image out = in, n = floats(normal, 3);

    out.data = output + (H - 1) * ROW;
    make(9, 30);
    for (int i = 0; i < H * ROW; i++)
        grey[i] = output[i] = (uint16_t)(0x3c00 + i % 997);
    CHECK_EQ(fill(result), LULL_OK);
    CHECK_EQ(lull_fill(&out, &in, &n, W, H, memory, sizeof memory), LULL_OK);
    for (int y = 0; y < H; y++)
        for (int x = 0; x < ROW; x++) {
            const int i = y * W + x / STEP, at = (H - 1 - y) * ROW + x;
            int from = at;

            if (x < W * STEP && x % STEP == 0)
                from = (H - 1 - (int)result[3 * i + 1]) * ROW + (int)result[3 * i] * STEP;
            CHECK_EQ(output[at], grey[from]);
        }
}

static void thin_ones(void)
{
    static const unsigned sizes[][2] = {{1, 1}, {1, 9}, {9, 1}, {2, 2}};

    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        const unsigned w = sizes[s][0], h = sizes[s][1];
        const lull_image out = floats(result, 3), in = floats(color, 3), n = floats(normal, 3);

        make(1, 4);
        memset(normal, 0, sizeof normal);
        normal[3 * (w * h - 1)] = 1;
        CHECK_EQ(lull_fill(&out, &in, &n, w, h, memory, 4 * (size_t)w * h), LULL_OK);
        for (unsigned i = 0; i < w * h; i++)
            CHECK(!memcmp(result + 3 * i, color + 3 * (w * h - 1), 3 * sizeof(float)));
    }
}

static void what_cannot_be(void)
{
    const lull_image out = floats(result, 3), in = floats(color, 3), n = floats(normal, 3);
    const lull_image none = floats(NULL, 3), grey = floats(result, 1);

    CHECK_EQ(lull_fill_size(0, 4), 0);
    CHECK_EQ(lull_fill_size(4, LULL_MAX_SIZE + 1), 0);
    CHECK_EQ(lull_fill(NULL, &in, &n, W, H, memory, sizeof memory), LULL_ERROR_ARGUMENT);
    CHECK_EQ(lull_fill(&out, &in, &n, 0, H, memory, sizeof memory), LULL_ERROR_ARGUMENT);
    CHECK_EQ(lull_fill(&out, &in, &n, W, H, NULL, sizeof memory), LULL_ERROR_ARGUMENT);
    CHECK_EQ(lull_fill(&out, &in, &n, W, H, memory, sizeof memory - 1), LULL_ERROR_MEMORY);
    CHECK_EQ(lull_fill(&out, &in, &none, W, H, memory, sizeof memory), LULL_ERROR_IMAGE);
    CHECK_EQ(lull_fill(&grey, &in, &n, W, H, memory, sizeof memory), LULL_ERROR_IMAGE);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(nearest_surfaces_are_found);
    RUN(in_its_own_place);
    RUN(without_any_surface_all_stays);
    RUN(other_images);
    RUN(thin_ones);
    RUN(what_cannot_be);
    return check_report();
}
