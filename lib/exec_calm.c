/* What cells of 4x4 differences tell of a frame, so far from each other that there are a few
 * thousand of them (docs/kernel-prediction.md, step 9). How calm it is: the part of them whose
 * finest detail is so little that whatever noise there is must be little, too, for texture is in
 * some places, noise in nearly all; unless the detail of the others is noise by its looks, halved
 * in means of 2x2 pixels. And how ragged its edges are, each pixel having seen one place: much
 * noise, and edges of the albedo without pixels between the two sides. */
#include "exec.h"
#include "exposure.h"

typedef char rows_fit[sizeof(lull_calm_row) <= LULL_PLAN_BINS ? 1 : -1];
typedef char bins_fit[sizeof(lull_exposure_row) <= LULL_PLAN_BINS ? 1 : -1];

#define SIDE 4u
#define LEAST_CELLS 1000u /* as many at least, where the frame has them */
#define ROWS 16u          /* of pixels, for each partial result */

/* Detail: noise codes of half the sum of second differences, relative to the light and 0.02 in
 * each channel of a pixel. A cell with less than the least tells nothing; one with the most is not
 * calm; WILD_DETAIL is much noise. */
#define DETAIL_GAIN 192.0f
#define DETAIL_EPSILON 0.96f
#define LEAST_DETAIL 1.0f
#define MOST_DETAIL 10.0f
#define WILD_DETAIL 160.0f
#define WILD_SHARE 0.25f, 6.6666667f /* the part of cells with much: a ramp */

/* Rough cells, neither calm nor wild, are noise if means of 2x2 pixels leave less of their detail;
 * and the part of them that is noise, up to which a frame may be calm: a ramp downwards. */
#define COARSE 0.6f
#define NOT_CALM 0.42f, -12.5f

/* Of five pixels in a row or column two on either side are alike, and the sides far apart; an edge
 * is sharp if the pixel between is like one of them. Sums of the albedo's channels. */
#define FLAT 0.03f
#define STEP 0.3f
#define FEW 16u          /* edges that tell nothing */
#define SHARP 0.3f, 5.0f /* the part of them that is: a ramp */

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

/* The sum of what SIDE x SIDE differences are between means of 2x2 pixels, two apart. */
static float coarse_of(float d[SIDE][SIDE])
{
    float sum = 0.0f;
    for (unsigned y = 0; y + 2 < SIDE; y++) {
        for (unsigned x = 0; x + 2 < SIDE; x++) {
            float of_row[3];
            for (unsigned i = 0; i < 3; i++) {
                const float *v = d[y + i] + x;
                of_row[i] = (v[0] + v[2]) + (v[1] + v[1]);
            }
            sum += lull_abs((of_row[0] + of_row[2]) + (of_row[1] + of_row[1]));
        }
    }
    return sum;
}

/* What a cell is. */
typedef enum level {
    SILENT, /* sky, lamps, what is clipped: it says nothing */
    CALM,
    ROUGH, /* detail that is none of the others' */
    NOISE,
    WILD
} level;

/* Of light, the sum of three channels, of SIDE + 1 pixels both ways. */
static level level_of(float v[SIDE + 1][SIDE + 1])
{
    float d[SIDE][SIDE], sum = 0.0f, light = 0.0f, detail;
    for (unsigned y = 0; y < SIDE; y++) {
        for (unsigned x = 0; x < SIDE; x++) {
            d[y][x] = (v[y][x] - v[y][x + 1]) - (v[y + 1][x] - v[y + 1][x + 1]);
            sum += lull_abs(d[y][x]);
            light += v[y][x];
        }
    }
    detail = sum * DETAIL_GAIN;
    light += DETAIL_EPSILON;
    if (detail < light * LEAST_DETAIL)
        return SILENT;
    if (detail < light * MOST_DETAIL)
        return CALM;
    if (detail >= light * WILD_DETAIL)
        return WILD;
    return coarse_of(d) < sum * COARSE ? NOISE : ROUGH;
}

/* What five pixels of the albedo are, `step` apart. */
static void add_edge(lull_calm_row *row, const float *v, unsigned step)
{
    float before = v[step], between = v[2 * step], after = v[3 * step];
    if (!(lull_abs(v[0] - before) <= FLAT && lull_abs(after - v[4 * step]) <= FLAT &&
          lull_abs(before - after) >= STEP))
        return;
    row->edges++;
    if (lull_abs(before - between) <= FLAT || lull_abs(between - after) <= FLAT)
        row->sharp++;
}

/* Edges of sums of the albedo of SIDE + 1 pixels both ways. */
static void add_edges(lull_calm_row *row, float v[SIDE + 1][SIDE + 1])
{
    for (unsigned i = 0; i <= SIDE; i++) {
        add_edge(row, v[i], 1);
        add_edge(row, v[0] + i, SIDE + 1);
    }
}

/* Sums of the channels of a row of pixels, each times a factor if there are some. */
static void add_channels(float *sums, const float *pixels, const float *factors)
{
    for (unsigned i = 0; i <= SIDE; i++, pixels += 3) {
        float v[3] = {pixels[0], pixels[1], pixels[2]};
        for (unsigned c = 0; factors && c < 3; c++)
            v[c] *= factors[3 * i + c];
        sums[i] = (v[0] + v[1]) + v[2];
    }
}

/* Reads the cell at pixel (x, y): its light, and the albedo, by which the light is demodulated,
 * too. Returns 0 if there is no albedo. */
static int read_cell(float light[SIDE + 1][SIDE + 1], float even[SIDE + 1][SIDE + 1],
                     float albedo[SIDE + 1][SIDE + 1], const lull_task *t, unsigned x, unsigned y)
{
    int has_albedo = 0;
    for (unsigned dy = 0; dy <= SIDE; dy++) {
        float pixels[3 * (SIDE + 1)], block[3 * (SIDE + 1)], a[3 * (SIDE + 1)];
        const float *of_albedo = lull_exec_aux(t, 1, block, x, y + dy, SIDE + 1);
        lull_encoding from;
        lull_exec_main(&from, t, pixels, x, y + dy, SIDE + 1);
        lull_exec_sane(pixels, &from, t, SIDE + 1);
        add_channels(light[dy], pixels, NULL);
        if (!of_albedo)
            continue;
        has_albedo = 1;
        memcpy(a, of_albedo, sizeof a);
        for (unsigned i = 0; i <= SIDE; i++)
            lull_sane_albedo(a + 3 * i);
        add_channels(albedo[dy], a, NULL);
        for (unsigned i = 0; i <= SIDE; i++) {
            for (unsigned c = 0; c < 3; c++)
                a[3 * i + c] += LULL_FILTER_EPSILON;
            lull_shares(a + 3 * i, 1.0f, 1.0f);
        }
        add_channels(even[dy], pixels, a);
    }
    return has_albedo;
}

/* The cell at pixel (x, y). */
static void look_at(lull_calm_row *row, const lull_task *t, unsigned x, unsigned y)
{
    float light[SIDE + 1][SIDE + 1], even[SIDE + 1][SIDE + 1], albedo[SIDE + 1][SIDE + 1];
    int has_albedo = read_cell(light, even, albedo, t, x, y);
    level of_light = level_of(light), of_even = has_albedo ? level_of(even) : of_light;
    if (has_albedo)
        add_edges(row, albedo);
    row->lit = (uint16_t)(row->lit + (of_light != SILENT));
    row->wild = (uint16_t)(row->wild + (of_light == WILD));
    row->cells = (uint16_t)(row->cells + (of_even != SILENT));
    row->calm = (uint16_t)(row->calm + (of_even == CALM));
    row->noise = (uint16_t)(row->noise + (of_even == NOISE));
    row->rough = (uint16_t)(row->rough + (of_even == NOISE || of_even == ROUGH));
}

void lull_exec_calm_row(lull_calm_row *row, const lull_task *t, unsigned index)
{
    const lull_frame *frame = &t->plan->frame;
    unsigned step = spacing(frame), y = (unsigned)lull_align_up(index * ROWS, step);
    memset(row, 0, sizeof *row);
    for (; y < (index + 1) * ROWS && y + SIDE < frame->height; y += step)
        for (unsigned x = 0; x + SIDE < frame->width; x += step)
            look_at(row, t, x, y);
}

static lull_calm_row sum_of(const lull_calm_row *rows, unsigned n)
{
    lull_calm_row sum = {0, 0, 0, 0, 0, 0, 0, 0};
    for (unsigned i = 0; i < n; i++) {
        sum.lit = (uint16_t)(sum.lit + rows[i].lit);
        sum.wild = (uint16_t)(sum.wild + rows[i].wild);
        sum.cells = (uint16_t)(sum.cells + rows[i].cells);
        sum.calm = (uint16_t)(sum.calm + rows[i].calm);
        sum.rough = (uint16_t)(sum.rough + rows[i].rough);
        sum.noise = (uint16_t)(sum.noise + rows[i].noise);
        sum.edges = (uint16_t)(sum.edges + rows[i].edges);
        sum.sharp = (uint16_t)(sum.sharp + rows[i].sharp);
    }
    return sum;
}

static float share_of(unsigned part, unsigned whole)
{
    return (float)(int)part * (1.0f / (float)(int)lull_max_u(whole, 1));
}

float lull_calm_share(const lull_calm_row *rows, unsigned n)
{
    const lull_calm_row all = sum_of(rows, n);
    return share_of(all.calm, all.cells) * lull_ramp(share_of(all.noise, all.rough), NOT_CALM);
}

float lull_ragged_share(const lull_calm_row *rows, unsigned n)
{
    const lull_calm_row all = sum_of(rows, n);
    float wild = lull_ramp(share_of(all.wild, all.lit), WILD_SHARE);
    return all.edges < FEW ? wild : wild * lull_ramp(share_of(all.sharp, all.edges), SHARP);
}
