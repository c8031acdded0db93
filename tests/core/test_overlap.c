/* Which overlaps of output and input lull_run takes, and that it is right where it does. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdlib.h>

#include "models.h"

#define WEIGHTS "tests/golden/unet_3_eights/weights.tza"
#define ROOM 60000 /* bytes that any of the cases has its pixels in */

enum { W = 20, H = 40, ROW = 12 * W, PIXELS = W * H };

typedef struct overlap_case {
    const char *name;
    size_t input, output; /* offsets of the first pixels */
    ptrdiff_t input_pixel, output_pixel, row;
    lull_type type; /* of the output */
    enum { NEVER, IN_PLACE, ALWAYS } allowed;
} overlap_case;

static const overlap_case cases[] = {
    {"same place", 999, 999, 0, 0, 0, LULL_F32, IN_PLACE},
    {"halves in the place of floats", 0, 0, 12, 12, 0, LULL_F16, IN_PLACE},
    {"halves over floats", 0, 0, 0, 0, 0, LULL_F16, NEVER},
    {"other pixel strides", 0, 0, 12, 16, 500, LULL_F32, NEVER},
    {"a row later", 0, ROW, 0, 0, 0, LULL_F32, NEVER},
    {"a row earlier", ROW, 0, 0, 0, 0, LULL_F32, NEVER},
    {"a byte later", 0, 1, 0, 0, 0, LULL_F32, NEVER},
    {"a value later", 0, 4, 16, 16, 0, LULL_F32, NEVER},
    {"the last row is the first", 0, ROW * (H - 1), 0, 0, 0, LULL_F32, NEVER},
    {"behind", 0, ROW * H, 0, 0, 0, LULL_F32, ALWAYS},
    {"before", ROW * H, 0, 0, 0, 0, LULL_F32, ALWAYS},
    {"pixels by turns", 0, 12, 24, 24, 0, LULL_F32, ALWAYS},
    {"pixels by turns, the output first", 12, 0, 24, 24, 0, LULL_F32, ALWAYS},
    {"pixels by turns, rows apart", 4, 20, 33, 33, 33 * W + 7, LULL_F16, ALWAYS},
    {"rows by turns", 0, 300, 0, 0, 600, LULL_F32, ALWAYS},
    {"rows by turns, the output first", 300, 0, 0, 13, 600, LULL_F32, ALWAYS},
    {"side by side", ROW, 0, 0, 0, 2 * ROW, LULL_F32, ALWAYS},
    {"side by side, rows later", 0, 7 * 500 + ROW, 0, 0, 500, LULL_F32, ALWAYS},
    {"the last column is the first", 0, ROW - 12, 0, 0, 2 * ROW, LULL_F32, NEVER},
    {"side by side, pixels by turns", 24 * W, 5 * 999 + 12, 24, 24, 999, LULL_F32, ALWAYS},
    {"turned, same place", 12, 12, 12 * H, 12 * H, 12, LULL_F32, IN_PLACE},
    {"turned, halves in the place of floats", 0, 0, 12 * H, 12 * H, 12, LULL_F16, IN_PLACE},
    {"turned, a pixel later", 0, 12, 12 * H, 12 * H, 12, LULL_F32, NEVER},
    {"turned, behind", 0, ROW * H, 12 * H, 12 * H, 12, LULL_F32, ALWAYS},
    {"turned, before", ROW * H, 0, 12 * H, 12 * H, 12, LULL_F32, ALWAYS},
    {"turned and a byte on the last", 0, ROW * H - 1, 12 * H, 12 * H, 12, LULL_F32, NEVER},
    {"mirrored, same place", ROW - 12, ROW - 12, -12, -12, ROW, LULL_F32, IN_PLACE},
    {"mirrored, behind", ROW - 12, ROW * (H + 1) - 12, -12, -12, ROW, LULL_F32, ALWAYS},
    {"mirrored, a pixel earlier", ROW, ROW - 12, -12, -12, ROW, LULL_F32, NEVER},
    {"mirrored and not", ROW - 12, ROW - 12, -12, 12, ROW, LULL_F32, NEVER},
    {"upside down, same place", ROW * H, ROW * H, 0, 0, -ROW, LULL_F32, IN_PLACE},
    {"upside down, before", ROW * (2 * H - 1), ROW * (H - 1), 0, 0, -ROW, LULL_F32, ALWAYS},
    {"upside down, a row earlier", ROW * H, ROW * (H - 1), 0, 0, -ROW, LULL_F32, NEVER},
    {"half a turn", ROW * H, ROW * (2 * H), -12, -12, -ROW, LULL_F32, ALWAYS},
};

/* Moves the pixels of a tight picture to where a case has them, or back. */
static void move_pixels(uint8_t *memory, uint8_t *tight, size_t pixel, ptrdiff_t stride,
                        ptrdiff_t row, int is_back)
{
    stride = stride ? stride : (ptrdiff_t)pixel;
    row = row ? row : W * stride;
    for (ptrdiff_t y = 0; y < H; y++)
        for (ptrdiff_t x = 0; x < W; x++, tight += pixel) {
            uint8_t *at = memory + y * row + x * stride;
            memcpy(is_back ? tight : at, is_back ? at : tight, pixel);
        }
}

static lull_status run_frame(const lull_model *model, const lull_images *images,
                             const lull_frame *frame)
{
    lull_plan *plan = NULL;
    size_t bytes = lull_plan_size(frame, model);
    lull_status status;
    CHECK_EQ(lull_plan_init(&plan, aligned(bytes), bytes, frame, model), LULL_OK);
    status = lull_run(plan, images, NULL);
    free(plan);
    return status;
}

static lull_status run(const lull_model *model, const lull_images *images, unsigned in_place,
                       unsigned strip_width)
{
    lull_frame frame = lull_frame_default(W, H, LULL_HDR, LULL_HAS_COLOR);
    frame.in_place = in_place;
    frame.strip_width = strip_width;
    return run_frame(model, images, &frame);
}

static void check_case(const overlap_case *c, const lull_model *model, float *picture,
                       unsigned in_place, unsigned strip_width)
{
    static uint8_t memory[ROOM], expected[12 * PIXELS], found[12 * PIXELS];
    const size_t pixel = c->type == LULL_F16 ? 6 : 12;
    const int is_allowed = c->allowed == ALWAYS || (c->allowed == IN_PLACE && in_place);
    lull_images images = {0};
    int is_ok;
    images.color.data = picture;
    images.color.channels = images.output.channels = 3;
    images.output.data = expected;
    images.output.type = c->type;
    images.input_scale = images.calm = images.ragged = NAN;
    CHECK_EQ(run(model, &images, 0, 0), LULL_OK);
    memset(memory, 0, ROOM);
    move_pixels(memory + c->input, (uint8_t *)picture, 12, c->input_pixel, c->row, 0);
    images.color.data = memory + c->input;
    images.color.pixel_stride = c->input_pixel;
    images.output.data = memory + c->output;
    images.output.pixel_stride = c->output_pixel;
    images.color.row_stride = images.output.row_stride = c->row;
    is_ok = CHECK_EQ(run(model, &images, in_place, strip_width),
                     is_allowed ? LULL_OK : LULL_ERROR_IMAGE);
    if (is_allowed) {
        move_pixels(memory + c->output, found, pixel, c->output_pixel, c->row, 1);
        is_ok &= CHECK(memcmp(expected, found, pixel * PIXELS) == 0);
    }
    if (!is_ok)
        printf("  %s%s\n", c->name, in_place ? ", in place" : "");
}

static void overlap_is_in_place_or_refused(void)
{
    static float picture[3 * PIXELS];
    lull_model *model = load_model(WEIGHTS);
    for (unsigned i = 0; i < 3 * PIXELS; i++)
        picture[i] = (float)(i * 2654435761u >> 7 & 1023u) / 512.0f;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        for (unsigned variant = 0; variant < 4; variant++)
            check_case(&cases[i], model, picture, variant & 1, variant & 2 ? 16 : 0);
    free(model);
}

/* A network that is not the same both ways sees the same picture however it lies. */
static void turned_pictures_are_seen_as_turned(void)
{
    static const struct {
        size_t first; /* pixel */
        ptrdiff_t pixel, row;
    } turns[] = {
        {W * (H - 1), -W, 1}, {W - 1, W, -1}, {W * H - 1, -1, -W}, {0, W, 1}, {W - 1, -1, W},
    };
    static float picture[3 * PIXELS], moved[3 * PIXELS], expected[3 * PIXELS], found[3 * PIXELS];
    lull_model *model = load_model("weights/kernel5_8.tza");
    for (unsigned i = 0; i < 3 * PIXELS; i++)
        picture[i] = (float)(i * 2654435761u >> 7 & 1023u) / 512.0f;
    for (size_t i = 0; i < sizeof turns / sizeof turns[0]; i++)
        for (unsigned strips = 0; strips < 2; strips++) {
            const int is_on_side = turns[i].row == 1 || turns[i].row == -1;
            lull_frame frame = lull_frame_default(is_on_side ? H : W, is_on_side ? W : H, LULL_HDR,
                                                  LULL_HAS_COLOR);
            lull_images images = {0};
            const float *from = picture + 3 * turns[i].first;
            for (unsigned k = 0; k < PIXELS; k++)
                memcpy(moved + 3 * k,
                       from + 3 * ((ptrdiff_t)(k % frame.width) * turns[i].pixel +
                                   (ptrdiff_t)(k / frame.width) * turns[i].row),
                       12);
            frame.strip_width = strips ? 16 : 0;
            images.color.channels = images.output.channels = 3;
            images.input_scale = images.calm = images.ragged = NAN;
            images.color.data = moved;
            images.output.data = expected;
            CHECK_EQ(run_frame(model, &images, &frame), LULL_OK);
            images.color.data = (float *)picture + 3 * turns[i].first;
            images.color.pixel_stride = 12 * turns[i].pixel;
            images.color.row_stride = 12 * turns[i].row;
            images.output = images.color;
            images.output.data = found + 3 * turns[i].first;
            CHECK_EQ(run_frame(model, &images, &frame), LULL_OK);
            for (unsigned k = 0; k < PIXELS; k++)
                CHECK(!memcmp(expected + 3 * k,
                              (float *)images.output.data +
                                  3 * ((ptrdiff_t)(k % frame.width) * turns[i].pixel +
                                       (ptrdiff_t)(k / frame.width) * turns[i].row),
                              12));
        }
    free(model);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(overlap_is_in_place_or_refused);
    RUN(turned_pictures_are_seen_as_turned);
    return check_report();
}
