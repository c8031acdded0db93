/* How calm a frame is: the part of its cells whose finest detail is so little that whatever noise
 * there is must be little, too, for texture is in some places, noise in nearly all
 * (docs/kernel-prediction.md, step 9). Looks at cells of 4x4 differences, so far from each other
 * that there are a few thousand of them. */
#include "exec.h"
#include "exposure.h"

#define SIDE 4u
#define LEAST_CELLS 1000u /* as many at least, where the frame has them */
#define ROWS 16u          /* of pixels, for each partial result */

/* Detail: noise codes of half the sum of second differences, relative to the light and 0.02 in
 * each channel of a pixel. A cell with less than the least tells nothing; one with the most is not
 * calm. */
#define DETAIL_GAIN 192.0f
#define DETAIL_EPSILON 0.96f
#define LEAST_DETAIL 1.0f
#define MOST_DETAIL 10.0f

typedef char calm_rows_fit[sizeof(lull_calm_row) <= sizeof(lull_exposure_row) ? 1 : -1];

static unsigned cells_along(unsigned size, unsigned step)
{
    return size > SIDE ? (size - SIDE - 1) / step + 1 : 0;
}

/* Pixels from cell to cell, a power of two. */
static unsigned spacing(const lull_frame *frame)
{
    unsigned step = SIDE;
    while (cells_along(frame->width, 2 * step) * cells_along(frame->height, 2 * step) >=
           LEAST_CELLS)
        step *= 2;
    return step;
}

/* What a cell is, from detail summed over its differences and light over its pixels, of three
 * channels. */
static void add_cell(lull_calm_row *row, float detail, float light)
{
    detail *= DETAIL_GAIN;
    light += DETAIL_EPSILON;
    if (detail < light * LEAST_DETAIL)
        return; /* sky, lamps, what is clipped: they say nothing */
    row->cells++;
    row->calm += detail < light * MOST_DETAIL;
}

/* The cell at pixel (x, y). */
static void look_at(lull_calm_row *row, const lull_task *t, unsigned x, unsigned y)
{
    float above[SIDE] = {0}, detail = 0.0f, light = 0.0f;
    for (unsigned dy = 0; dy <= SIDE; dy++) {
        float pixels[3 * (SIDE + 1)], v[SIDE + 1];
        lull_encoding from;
        lull_exec_main(&from, t, pixels, x, y + dy, SIDE + 1);
        lull_exec_sane(pixels, &from, t, SIDE + 1);
        for (unsigned i = 0; i <= SIDE; i++)
            v[i] = (pixels[3 * i] + pixels[3 * i + 1]) + pixels[3 * i + 2];
        for (unsigned i = 0; i < SIDE; i++) {
            float across = v[i] - v[i + 1], change = above[i] - across;
            if (dy > 0)
                detail += change < 0.0f ? -change : change;
            if (dy < SIDE)
                light += v[i];
            above[i] = across;
        }
    }
    add_cell(row, detail, light);
}

void lull_exec_calm_row(lull_calm_row *row, const lull_task *t, unsigned index)
{
    const lull_frame *frame = &t->plan->frame;
    unsigned step = spacing(frame), y = (unsigned)lull_align_up(index * ROWS, step);
    row->cells = row->calm = 0;
    for (; y < (index + 1) * ROWS && y + SIDE < frame->height; y += step)
        for (unsigned x = 0; x + SIDE < frame->width; x += step)
            look_at(row, t, x, y);
}

float lull_calm_share(const lull_calm_row *rows, unsigned n)
{
    uint32_t cells = 0, calm = 0;
    for (unsigned i = 0; i < n; i++) {
        cells += rows[i].cells;
        calm += rows[i].calm;
    }
    return cells ? (float)calm * (1.0f / (float)cells) : 0.0f;
}
