/* Grain of albedo and normals (docs/kernel-prediction.md): found by cells of the input's codes, and
 * taken out of them, of the albedo that divides and of the normals of the regression. */
#include "exec.h"
#include "filter.h"

#define SIDE LULL_GRAIN_SIDE
enum { PIXEL = 12, CLIPPED = 11 }; /* codes of a pixel, the last of which says whether it is */

static const uint8_t tensors[LULL_GRAINY] = {LULL_TENSOR_ALBEDO, LULL_TENSOR_NORMAL};

enum { SOME = 32, CELLS = SOME / SIDE, HALF = SIDE / 2 }; /* pixels at once, their cells */

/* Of columns of pixels, a feature: sums of squares, and the last row of L. Steps are counted where
 * they begin, those to below left where they end. */
typedef struct columns {
    uint32_t squares[SOME], steps[LULL_GRAIN_STEPS][SOME];
    int16_t row[SOME + 1];
} columns;

/* Of CELLS cells: sums of codes of pixels, 16 bits each, of numbers 1, 3, 5, 7 and 2, 4, 6, 8, and
 * of L of both features, 32 bits each; and squared steps of columns of the light. */
typedef struct cell_sums {
    columns of[LULL_GRAINY];
    uint64_t odd[CELLS], even[CELLS], mean[CELLS];
    uint32_t light[SOME];
    unsigned rows;
} cell_sums;

/* Sums of columns that are not there, and of steps to them, are made, too, and not used. */
static void add_squares(columns *sums, const int16_t *now, int is_first)
{
    const int16_t *row = sums->row;
    for (unsigned i = 0; i < SOME; i++) {
        int here = now[i], step = now[i + 1] - here;
        sums->squares[i] += (uint16_t)(here * here);
        sums->steps[0][i] += (uint16_t)(step * step);
    }
    for (unsigned i = 0; i < SOME && !is_first; i++) {
        int step[LULL_GRAIN_STEPS] = {0, now[i] - row[i], now[i + 1] - row[i], now[i] - row[i + 1]};
        for (unsigned k = 1; k < LULL_GRAIN_STEPS; k++)
            sums->steps[k][i] += (uint16_t)(step[k] * step[k]);
    }
    memcpy(sums->row, now, sizeof sums->row);
}

/* Adds n pixels, the first of which is the first of its cell. */
static void add_row(cell_sums *sums, const uint8_t *codes, unsigned n)
{
    const uint64_t bytes = 0x00ff00ff00ff00ffu;
    int16_t now[LULL_GRAINY][SOME + 1] = {{0}}, light[SOME + 1] = {0};
    for (unsigned i = 0; i < n; i += SIDE) {
        uint64_t odd = 0, even = 0, mean = 0;
        for (unsigned end = lull_min_u(i + SIDE, n), at = i; at < end; at++) {
            uint64_t pixel = lull_load_u64(codes + (size_t)at * PIXEL + LULL_GRAIN_LIGHT_CODE);
            uint64_t a = pixel & bytes, b = pixel >> 8 & bytes;
            uint32_t albedo = ((a >> 16 & 255) + (a >> 32 & 255) + 2 * (b >> 16 & 255)) >> 2;
            uint32_t normal = ((b >> 32 & 255) + (b >> 48) + 2 * (a >> 48)) >> 2;
            now[LULL_GRAIN_ALBEDO][at] = (int16_t)albedo;
            now[LULL_GRAIN_NORMAL][at] = (int16_t)normal;
            light[at] = a & 255;
            odd += a;
            even += b;
            mean += albedo | (uint64_t)normal << 32;
        }
        sums->odd[i / SIDE] += odd;
        sums->even[i / SIDE] += even;
        sums->mean[i / SIDE] += mean;
    }
    for (unsigned i = 0; i < SOME; i++) {
        int step = light[i + 1] - light[i];
        sums->light[i] += (uint16_t)(step * step);
    }
    for (unsigned f = 0; f < LULL_GRAINY; f++)
        add_squares(&sums->of[f], now[f], sums->rows == 0);
    sums->rows++;
}

/* LULL_GRAIN_SUMS of a feature of cell number i, of n columns. */
static void sum_cell(float *out, size_t plane, const cell_sums *sums, unsigned feature, unsigned i,
                     unsigned n)
{
    const columns *of = &sums->of[feature];
    uint32_t sum[LULL_GRAIN_SUMS] = {n * sums->rows};
    sum[1] = (uint32_t)(sums->mean[i] >> 32 * feature);
    for (unsigned c = 0; c < 3; c++) {
        unsigned code = lull_grain_codes(feature) + c;
        sum[3 + c] = (code & 1 ? sums->odd[i] : sums->even[i]) >> 16 * ((code - 1) / 2) & 0xffff;
    }
    for (unsigned at = i * SIDE, end = at + n; at < end; at++) {
        sum[2] += of->squares[at];
        for (unsigned k = 0; k < LULL_GRAIN_STEPS; k++)
            if (k == 1 || at + 1 < end)
                sum[6 + k] += of->steps[k][at];
    }
    for (unsigned k = 0; k < LULL_GRAIN_SUMS; k++)
        out[k * plane] = (float)sum[k];
}

/* The sum of squared steps of the light in cell number i, of n columns. */
static float sum_light(const cell_sums *sums, unsigned i, unsigned n)
{
    uint32_t sum = 0;
    for (unsigned at = i * SIDE, end = at + n - 1; at < end; at++)
        sum += sums->light[at];
    return (float)sum;
}

void lull_exec_grain_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    const size_t plane = lull_exec_plane(plan, t->layer + 1);
    unsigned left = SIDE * x, end = lull_min_u(left + SIDE * n, lull_exec_inside(t));
    unsigned bottom = lull_min_u(SIDE * (y + 1), plan->frame.height);
    cell_sums *sums = lull_exec_scratch(t, worker);
    for (unsigned k = 0; k < LULL_GRAIN_ALL_SUMS; k++)
        memset(out + k * plane, 0, n * sizeof *out);
    for (; left < end && SIDE * y < bottom; left += SOME, out += CELLS) {
        const unsigned count = lull_min_u(SOME, end - left);
        memset(sums, 0, sizeof *sums);
        for (unsigned row = SIDE * y; row < bottom; row++)
            add_row(sums, lull_exec_row(plan, LULL_TENSOR_INPUT, row) + (size_t)left * PIXEL,
                    count);
        for (unsigned i = 0; i < lull_cell_count(SIDE, count); i++) {
            const unsigned wide = lull_min_u(SIDE, count - i * SIDE);
            for (unsigned f = 0; f < LULL_GRAINY; f++)
                if (lull_plan_has_feature(plan, f))
                    sum_cell(out + f * LULL_GRAIN_SUMS * plane + i, plane, sums, f, i, wide);
            out[LULL_GRAIN_LIGHT * plane + i] = sum_light(sums, i, wide);
        }
    }
}

/* Of cell `at` and those around it, by weights 1, 2, 1, first down. */
LULL_NOINLINE static float sum_around(const float *const rows[3], size_t at)
{
    const float *above = rows[0] + at, *row = rows[1] + at, *below = rows[2] + at;
    float down[3];
    for (int i = -1; i <= 1; i++)
        down[i + 1] = (above[i] + below[i]) + 2.0f * row[i];
    return (down[0] + down[2]) + 2.0f * down[1];
}

/* LULL_GRAIN_VALUES of a feature of cell x, of three rows of sums in planes. */
static void find_in_cell(float *cell, const float *const rows[3], size_t plane, unsigned feature,
                         unsigned x, float part)
{
    const size_t lit = LULL_GRAIN_LIGHT * plane + x;
    const float light[2] = {sum_around(rows, lit), rows[1][lit]};
    float around[LULL_GRAIN_SUMS], own[LULL_GRAIN_SUMS];
    for (unsigned k = 0; k < LULL_GRAIN_SUMS; k++) {
        size_t at = (feature * LULL_GRAIN_SUMS + k) * plane + x;
        around[k] = sum_around(rows, at);
        own[k] = rows[1][at];
    }
    lull_grain(cell, around, own, light, feature, part);
}

void lull_exec_find_grain(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const unsigned source = plan->model->graph.layer[t->layer].source[0];
    const size_t plane = lull_exec_plane(plan, t->layer + 1);
    const size_t from = lull_exec_plane(plan, source);
    unsigned end = lull_min_u(x + n, lull_cell_count(SIDE, lull_exec_inside(t)));
    const float *rows[3];
    (void)worker;
    if (y >= lull_cell_count(SIDE, plan->frame.height))
        return;
    for (int i = 0; i < 3; i++)
        rows[i] = (const float *)(const void *)lull_exec_source(plan, source, (int)y + i - 1);
    for (; x < end; x++) {
        float cell[LULL_GRAINY * LULL_GRAIN_VALUES] = {0};
        float *normal = cell + LULL_GRAIN_NORMAL * LULL_GRAIN_VALUES;
        float *out = lull_exec_floats(plan, t->layer + 1, y, x);
        if (lull_plan_has_feature(plan, LULL_GRAIN_NORMAL))
            find_in_cell(normal, rows, from, LULL_GRAIN_NORMAL, x, LULL_GRAIN_OF_NORMAL);
        if (lull_plan_has_feature(plan, LULL_GRAIN_ALBEDO))
            find_in_cell(cell, rows, from, LULL_GRAIN_ALBEDO, x, lull_grain_of_albedo(normal[0]));
        for (unsigned c = 0; c < LULL_GRAINY * LULL_GRAIN_VALUES; c++)
            out[c * plane] = cell[c];
    }
}

/* Of pixels from the first of a cell on: the share of the mean, and the mean. Those of pixel i are
 * number HALF + i: they are made from centre to centre. */
typedef struct grain_row {
    float of[LULL_GRAIN_VALUES][SOME + SIDE];
} grain_row;

enum { NEAR = CELLS + 2 }; /* cells that SOME pixels from the first of a cell on lie between */

/* Values of NEAR cells from cell `first` on, the nearest where there are none; v: room for them. */
static const float *near_cells(float *v, const float *row, int first, int cells)
{
    if (first >= 0 && first + NEAR <= cells)
        return row + first;
    for (int i = 0; i < NEAR; i++)
        v[i] = row[first + i < 0 ? 0 : lull_min_u((unsigned)(first + i), (unsigned)cells - 1)];
    return v;
}

/* Of pixels, from values of cells above and below: down by `part`, then across, from the centre of
 * a cell to that of the next. */
static void spread_out(float *v, const float *above, const float *below, float part)
{
    static const float parts[SIDE] = {0.0625f, 0.1875f, 0.3125f, 0.4375f,
                                      0.5625f, 0.6875f, 0.8125f, 0.9375f};
    float cell[NEAR];
    for (unsigned i = 0; i < NEAR; i++)
        cell[i] = above[i] + part * (below[i] - above[i]);
    for (unsigned i = 0; i + 1 < NEAR; i++, v += SIDE)
        for (unsigned k = 0; k < SIDE; k++)
            v[k] = cell[i] + parts[k] * (cell[i + 1] - cell[i]);
}

/* Of a feature of at most SOME pixels from column x of the strip on. Returns 0 if all shares are
 * 0. */
static int get_grain(grain_row *grain, const lull_task *t, unsigned feature, unsigned x, unsigned y)
{
    const lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    const unsigned tensor = graph->layer[graph->input - 1].source[2]; /* what the input lost */
    const size_t plane = lull_exec_plane(plan, tensor);
    const int cells = (int)lull_cell_count(SIDE, lull_exec_inside(t));
    const int down = (int)lull_cell_count(SIDE, plan->frame.height);
    const float *rows[2], *v[2];
    float any = 0.0f, room[2][NEAR];
    for (int i = 0; i < 2; i++)
        rows[i] =
            lull_exec_floats(plan, tensor, (unsigned)lull_cell_near(SIDE, (int)y, i, down), 0) +
            feature * LULL_GRAIN_VALUES * plane;
    for (unsigned c = 0; c < LULL_GRAIN_VALUES; c++) {
        for (int i = 0; i < 2; i++)
            v[i] = near_cells(room[i], rows[i] + c * plane, (int)(x / SIDE) - 1, cells);
        for (unsigned i = 0; i < NEAR && c == 0; i++)
            any += v[0][i] + v[1][i];
        if (!(any > 0.0f))
            return 0;
        spread_out(grain->of[c], v[0], v[1], lull_cell_part(SIDE, (int)y));
    }
    return 1;
}

/* Takes it out of n pixels of three planes of a feature. */
LULL_NOINLINE static void take_grain(float *v, size_t plane, const grain_row *grain,
                                     unsigned feature, unsigned n)
{
    const float *share = grain->of[0] + HALF;
    for (unsigned c = 0; c < 3; c++, v += plane)
        for (unsigned i = 0; i < n; i++)
            v[i] = lull_without_grain(v[i], share[i], grain->of[1 + c][HALF + i], feature);
}

void lull_exec_clean(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    grain_row *grain = lull_exec_scratch(t, worker);
    for (unsigned f = 0; f < LULL_GRAINY; f++) {
        const size_t plane = lull_exec_plane(plan, tensors[f]);
        const unsigned end = lull_plan_has(plan, tensors[f]) ? x + n : x;
        for (unsigned i = x; i < end; i += SOME)
            if (get_grain(grain, t, f, i, y))
                take_grain(lull_exec_floats(plan, tensors[f], y, i) + plane, plane, grain, f,
                           lull_min_u(SOME, end - i));
    }
}

/* Memory of a worker. */
typedef struct encoding {
    grain_row grain;
    float block[3 * SOME], planes[4][SOME], pixels[LULL_GRAINY][3 * SOME];
} encoding;

/* n pixels of a feature without its grain; NULL if it has none, there or at all. Where rows are
 * kept these lose it, too. */
static const float *get_clean(encoding *e, const lull_task *t, unsigned feature, unsigned x,
                              unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    size_t plane = SOME;
    float *v = e->planes[0], *pixels = e->pixels[feature];
    if (!lull_plan_has_feature(plan, feature) || !get_grain(&e->grain, t, feature, x, y))
        return NULL;
    if (plan->keeps_rows) {
        v = lull_exec_floats(plan, tensors[feature], y, x);
        plane = lull_exec_plane(plan, tensors[feature]);
    } else {
        const lull_kernels *kernels = &plan->model->kernels;
        (feature == LULL_GRAIN_NORMAL ? kernels->spread_xyz : kernels->spread)(
            v, plane, lull_exec_aux(t, 1 + feature, e->block, t->left + x, y - t->base_row, n), n);
    }
    take_grain(v + plane, plane, &e->grain, feature, n);
    for (unsigned i = 0; i < n; i++)
        for (unsigned c = 0; c < 3; c++)
            pixels[3 * i + c] = v[(1 + c) * plane + i];
    return pixels;
}

/* In the place of the input's rows, which nobody needs any more. Codes of features without grain,
 * and the flags, stay; with the albedo's those of the radiance change. */
void lull_exec_encode(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const unsigned end = y < plan->frame.height ? lull_min_u(lull_exec_inside(t), x + n) : 0;
    const unsigned normals = lull_grain_codes(LULL_GRAIN_NORMAL);
    encoding *e = lull_exec_scratch(t, worker);
    for (; x < end; x += SOME) {
        uint8_t made[SOME * PIXEL];
        uint8_t *codes = lull_exec_row(plan, LULL_TENSOR_INPUT, y) + (size_t)x * PIXEL;
        const float *albedo, *normal;
        unsigned first, last;
        lull_encoding from;
        n = lull_min_u(SOME, end - x);
        albedo = get_clean(e, t, LULL_GRAIN_ALBEDO, x, y, n);
        normal = get_clean(e, t, LULL_GRAIN_NORMAL, x, y, n);
        if (!albedo && !normal)
            continue;
        lull_exec_radiance(&from, t, e->block, t->left + x, y, n);
        from.albedo = albedo;
        from.normal = normal;
        from.flags = lull_filter_flags(&from, codes[CLIPPED]);
        if (!albedo == !lull_plan_has_feature(plan, LULL_GRAIN_ALBEDO) &&
            !normal == !lull_plan_has_feature(plan, LULL_GRAIN_NORMAL)) {
            plan->model->kernels.encode(codes, &from, n);
            continue;
        }
        plan->model->kernels.encode(made, &from, n);
        first = albedo ? 0 : normals;
        last = normal ? normals + 3 : normals;
        for (unsigned i = 0; i < n; i++)
            memcpy(codes + i * PIXEL + first, made + i * PIXEL + first, last - first);
    }
}
