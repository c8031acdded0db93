/* Grain of albedo and normals (docs/kernel-prediction.md): found by cells of the input's codes, and
 * taken out of them, of the albedo that divides and of the normals of the regression. */
#include "exec.h"

#define SIDE LULL_GRAIN_SIDE
enum { PIXEL = 12 }; /* codes of a pixel */

static const uint8_t tensors[LULL_GRAINY] = {LULL_TENSOR_ALBEDO, LULL_TENSOR_NORMAL};

/* Sums of columns of pixels, and the last row. Steps are counted where they begin, those to below
 * left where they end. */
typedef struct columns {
    uint32_t squares[LULL_BLOCK], steps[LULL_GRAIN_STEPS][LULL_BLOCK];
    uint16_t light[LULL_BLOCK], color[3][LULL_BLOCK];
    int16_t row[LULL_BLOCK + 1];
    uint16_t rows;
} columns;

/* Adds n pixels, the first of which is the first of its cell. Sums of columns that are not there,
 * and of steps to them, are made, too, and not used. */
static void add_row(columns *sums, const uint8_t *codes, unsigned n)
{
    int16_t now[LULL_BLOCK + 1] = {0};
    const int16_t *row = sums->rows++ ? sums->row : now;
    for (unsigned i = 0; i < n; i++, codes += PIXEL) {
        now[i] = (int16_t)lull_grain_light(codes);
        for (unsigned c = 0; c < 3; c++)
            sums->color[c][i] = (uint16_t)(sums->color[c][i] + codes[c]);
    }
    for (unsigned i = 0; i < LULL_BLOCK; i++) {
        int here = now[i], right = now[i + 1];
        int step[LULL_GRAIN_STEPS] = {right - here, here - row[i], right - row[i],
                                      here - row[i + 1]};
        sums->light[i] = (uint16_t)(sums->light[i] + here);
        sums->squares[i] += (uint16_t)(here * here);
        for (unsigned k = 0; k < LULL_GRAIN_STEPS; k++)
            if (k == 0 || row != now)
                sums->steps[k][i] += (uint16_t)(step[k] * step[k]);
    }
    memcpy(sums->row, now, sizeof now);
}

/* LULL_GRAIN_SUMS of `n` columns from column i on, a cell. */
static void sum_cell(float *out, size_t plane, const columns *sums, unsigned i, unsigned n)
{
    uint32_t sum[LULL_GRAIN_SUMS] = {n * sums->rows};
    for (unsigned end = i + n; i < end; i++) {
        sum[1] += sums->light[i];
        sum[2] += sums->squares[i];
        for (unsigned c = 0; c < 3; c++)
            sum[3 + c] += sums->color[c][i];
        for (unsigned k = 0; k < LULL_GRAIN_STEPS; k++)
            if (k == 1 || i + 1 < end)
                sum[6 + k] += sums->steps[k][i];
    }
    for (unsigned k = 0; k < LULL_GRAIN_SUMS; k++)
        out[k * plane] = (float)sum[k];
}

/* Sums of cells [x, x+n) of row y of cells, of a feature. */
static void sum_feature(float *out, size_t plane, columns *sums, const lull_task *t,
                        unsigned feature, unsigned x, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    unsigned left = SIDE * x, end = lull_min_u(left + SIDE * n, lull_exec_inside(t));
    unsigned bottom = lull_min_u(SIDE * (y + 1), plan->frame.height);
    for (; left < end && SIDE * y < bottom; left += LULL_BLOCK) {
        const unsigned count = lull_min_u(LULL_BLOCK, end - left);
        memset(sums, 0, sizeof *sums);
        for (unsigned row = SIDE * y; row < bottom; row++)
            add_row(sums,
                    lull_exec_row(plan, LULL_TENSOR_INPUT, row) + left * PIXEL +
                        lull_grain_codes(feature),
                    count);
        for (unsigned i = 0; i < count; i += SIDE)
            sum_cell(out++, plane, sums, i, lull_min_u(SIDE, count - i));
    }
}

void lull_exec_grain_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    const size_t plane = lull_exec_plane(plan, t->layer + 1);
    for (unsigned k = 0; k < LULL_GRAINY * LULL_GRAIN_SUMS; k++)
        memset(out + k * plane, 0, n * sizeof *out);
    for (unsigned f = 0; f < LULL_GRAINY; f++)
        if (lull_plan_has(plan, tensors[f]))
            sum_feature(out + f * LULL_GRAIN_SUMS * plane, plane, lull_exec_scratch(t, worker), t,
                        f, x, y, n);
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
                         unsigned x, float most)
{
    float around[LULL_GRAIN_SUMS], own[LULL_GRAIN_SUMS];
    for (unsigned k = 0; k < LULL_GRAIN_SUMS; k++) {
        size_t at = (feature * LULL_GRAIN_SUMS + k) * plane + x;
        around[k] = sum_around(rows, at);
        own[k] = rows[1][at];
    }
    lull_grain(cell, around, own, most);
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
        if (lull_plan_has(plan, LULL_TENSOR_NORMAL))
            find_in_cell(normal, rows, from, LULL_GRAIN_NORMAL, x, LULL_GRAIN_MOST_OF_NORMAL);
        if (lull_plan_has(plan, LULL_TENSOR_ALBEDO))
            find_in_cell(cell, rows, from, LULL_GRAIN_ALBEDO, x, lull_grain_most(normal[0]));
        for (unsigned c = 0; c < LULL_GRAINY * LULL_GRAIN_VALUES; c++)
            out[c * plane] = cell[c];
    }
}

enum { SOME = 32, HALF = SIDE / 2 }; /* pixels at once */

/* Of pixels from the first of a cell on: the share of the mean, and the mean. Those of pixel i are
 * number HALF + i: they are made from centre to centre. */
typedef struct grain_row {
    float of[LULL_GRAIN_VALUES][SOME + SIDE];
} grain_row;

/* Between two rows of values of cells. */
static float down_from(const float *const rows[2], size_t i, float part)
{
    return rows[0][i] + part * (rows[1][i] - rows[0][i]);
}

/* From the centre of a cell to that of the next. */
LULL_NOINLINE static void go_across(float *v, float a, float b)
{
    static const float parts[SIDE] = {0.0625f, 0.1875f, 0.3125f, 0.4375f,
                                      0.5625f, 0.6875f, 0.8125f, 0.9375f};
    b -= a;
    for (unsigned i = 0; i < SIDE; i++)
        v[i] = a + parts[i] * b;
}

/* Of a feature of at most SOME pixels from column x of the strip on. Returns 0 if all shares are
 * 0. */
LULL_NOINLINE static int get_grain(grain_row *grain, const lull_task *t, unsigned feature,
                                   unsigned x, unsigned y)
{
    const lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    const unsigned tensor = graph->layer[graph->input - 1].source[2]; /* what the input lost */
    const size_t plane = lull_exec_plane(plan, tensor);
    const int cells = (int)lull_cell_count(SIDE, lull_exec_inside(t));
    const int down = (int)lull_cell_count(SIDE, plan->frame.height);
    const float part = lull_cell_part(SIDE, (int)y), *rows[2];
    enum { COUNT = SOME / SIDE + 2 };
    unsigned cell[COUNT];
    float any = 0.0f;
    for (int i = 0; i < 2; i++)
        rows[i] =
            lull_exec_floats(plan, tensor, (unsigned)lull_cell_near(SIDE, (int)y, i, down), 0) +
            feature * LULL_GRAIN_VALUES * plane;
    for (unsigned i = 0; i < COUNT; i++) {
        cell[i] = (unsigned)lull_cell_near(SIDE, (int)(x + SIDE * i), 0, cells);
        any += rows[0][cell[i]] + rows[1][cell[i]];
    }
    if (!(any > 0.0f))
        return 0;
    for (unsigned c = 0; c < LULL_GRAIN_VALUES; c++) {
        float *v = grain->of[c], a = down_from(rows, c * plane + cell[0], part), b;
        for (unsigned i = 1; i < COUNT; i++, v += SIDE, a = b) {
            b = down_from(rows, c * plane + cell[i], part);
            go_across(v, a, b);
        }
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
    if (!lull_plan_has(plan, tensors[feature]) || !get_grain(&e->grain, t, feature, x, y))
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
        from.flags = 0;
        plan->model->kernels.encode(made, &from, n);
        first = albedo ? 0 : normals;
        last = normal ? normals + 3 : normals;
        for (unsigned i = 0; i < n; i++)
            memcpy(codes + i * PIXEL + first, made + i * PIXEL + first, last - first);
    }
}
