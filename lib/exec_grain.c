/* Grain of albedo and normals (docs/kernel-prediction.md): found by cells of the input's codes, and
 * taken out of them, of the albedo that divides and of the normals of the regression. */
#include "exec.h"
#include "filter.h"

#define SIDE LULL_GRAIN_SIDE
enum {
    CLIPPED = LULL_CODES - 1, /* the code that says whether a pixel is */
    SOME = LULL_GRAIN_BLOCK,
    MANY = 4 * SOME,
    NEAR = LULL_FIT_ROOM(MANY) /* cells around so many pixels from the first of a cell on */
};

static const uint8_t tensors[LULL_GRAINY] = {LULL_TENSOR_ALBEDO, LULL_TENSOR_NORMAL};

void lull_exec_grain_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_kernels *kernels = &plan->model->kernels;
    const size_t plane = lull_exec_plane(plan, t->layer + 1);
    float *out = lull_exec_floats(plan, t->layer + 1, y, x);
    const unsigned left = SIDE * x, top = SIDE * y;
    const unsigned right = lull_min_u(left + SIDE * n, lull_exec_inside(t));
    const unsigned bottom = lull_min_u(top + SIDE, plan->frame.height);
    const uint8_t *rows[SIDE];
    if (left >= right || top >= bottom) {
        for (unsigned k = 0; k < LULL_GRAIN_ALL_SUMS; k++)
            memset(out + k * plane, 0, n * sizeof *out);
        return;
    }
    for (unsigned row = top; row < bottom; row++)
        rows[row - top] = lull_exec_row(plan, LULL_TENSOR_INPUT, row) + (size_t)left * LULL_CODES;
    kernels->grain_sums(out, plane, rows, bottom - top, right - left, lull_exec_scratch(t, worker));
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

/* Values of NEAR cells from cell `first` on, the nearest where there are none; v: room for them. */
static const float *near_cells(float *v, const float *row, int first, int cells)
{
    if (first >= 0 && first + NEAR <= cells)
        return row + first;
    for (int i = 0; i < NEAR; i++)
        v[i] = row[first + i < 0 ? 0 : lull_min_u((unsigned)(first + i), (unsigned)cells - 1)];
    return v;
}

/* Of a feature: LULL_GRAIN_VALUES of NEAR cells. */
typedef float near_values[LULL_GRAIN_VALUES][NEAR];

/* Those from the one before column x of the strip on, between the rows of cells above and below row
 * y of pixels. */
static void get_cells(near_values cell, const lull_task *t, unsigned feature, unsigned x,
                      unsigned y)
{
    const lull_plan *plan = t->plan;
    const lull_graph *graph = &plan->model->graph;
    const unsigned tensor = graph->layer[graph->input - 1].source[2]; /* what the input lost */
    const size_t plane = lull_exec_plane(plan, tensor);
    const int cells = (int)lull_cell_count(SIDE, lull_exec_inside(t));
    const int down = (int)lull_cell_count(SIDE, plan->frame.height);
    const float part = lull_cell_part(SIDE, (int)y), *rows[2];
    for (int i = 0; i < 2; i++)
        rows[i] =
            lull_exec_floats(plan, tensor, (unsigned)lull_cell_near(SIDE, (int)y, i, down), 0) +
            feature * LULL_GRAIN_VALUES * plane;
    for (unsigned c = 0; c < LULL_GRAIN_VALUES; c++, rows[0] += plane, rows[1] += plane) {
        float room[2][NEAR];
        const float *above = near_cells(room[0], rows[0], (int)(x / SIDE) - 1, cells);
        const float *below = near_cells(room[1], rows[1], (int)(x / SIDE) - 1, cells);
        for (unsigned i = 0; i < NEAR; i++)
            cell[c][i] = above[i] + part * (below[i] - above[i]);
    }
}

/* 1 if of SOME pixels from number i on some have grain. */
static int has_grain(near_values cell, unsigned i)
{
    float most = 0.0f;
    for (unsigned k = i / SIDE; k < i / SIDE + SOME / SIDE + 2; k++)
        most = cell[0][k] > most ? cell[0][k] : most;
    return most > 0.0f;
}

void lull_exec_clean(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const lull_kernels *kernels = &plan->model->kernels;
    near_values *cell = lull_exec_scratch(t, worker);
    for (unsigned f = 0; f < LULL_GRAINY; f++) {
        const size_t plane = lull_exec_plane(plan, tensors[f]);
        const unsigned end = lull_plan_has(plan, tensors[f]) ? x + n : x;
        for (unsigned i = x; i < end; i += MANY) {
            float *v = lull_exec_floats(plan, tensors[f], y, i) + plane;
            get_cells(*cell, t, f, i, y);
            for (unsigned k = 0; k < MANY && i + k < end; k += SOME)
                if (has_grain(*cell, k))
                    kernels->take_grain(v + k, plane, NULL, cell[0][0] + k / SIDE, NEAR, f,
                                        lull_min_u(SOME, end - i - k));
        }
    }
}

/* Memory of a worker. */
typedef struct encoding {
    near_values cell[LULL_GRAINY];
    float block[3 * SOME], planes[4][SOME], pixels[LULL_GRAINY][3 * SOME];
    uint8_t codes[LULL_CODES * SOME];
} encoding;

typedef char encoding_fits[sizeof(encoding) <= LULL_GRAIN_WORK ? 1 : -1];

/* n pixels of a feature without its grain, from column x on, that is number i of those of e->cell;
 * NULL if it has none, there or at all. Where rows are kept these lose it, too. */
static const float *get_clean(encoding *e, const lull_task *t, unsigned feature, unsigned x,
                              unsigned i, unsigned y, unsigned n)
{
    const lull_plan *plan = t->plan;
    const lull_kernels *kernels = &plan->model->kernels;
    size_t plane = SOME;
    float *v = e->planes[0];
    if (!lull_plan_has_feature(plan, feature) || !has_grain(e->cell[feature], i))
        return NULL;
    if (plan->keeps_rows) {
        v = lull_exec_floats(plan, tensors[feature], y, x);
        plane = lull_exec_plane(plan, tensors[feature]);
    } else {
        (feature == LULL_GRAIN_NORMAL ? kernels->spread_xyz : kernels->spread)(
            v, plane, lull_exec_aux(t, 1 + feature, e->block, t->left + x, y - t->base_row, n), n);
    }
    kernels->take_grain(v + plane, plane, e->pixels[feature], e->cell[feature][0] + i / SIDE, NEAR,
                        feature, n);
    return e->pixels[feature];
}

/* Codes of n pixels from column x on, at most SOME, number i of those of e->cell. Those of features
 * without grain, and the flags, stay; with the albedo's those of the radiance change. */
static void encode_some(encoding *e, const lull_task *t, unsigned x, unsigned i, unsigned y,
                        unsigned n)
{
    const lull_plan *plan = t->plan;
    const lull_kernels *kernels = &plan->model->kernels;
    const unsigned normals = lull_grain_codes(LULL_GRAIN_NORMAL);
    uint8_t *codes = lull_exec_row(plan, LULL_TENSOR_INPUT, y) + (size_t)x * LULL_CODES;
    const float *albedo = get_clean(e, t, LULL_GRAIN_ALBEDO, x, i, y, n);
    const float *normal = get_clean(e, t, LULL_GRAIN_NORMAL, x, i, y, n);
    unsigned first, last;
    lull_encoding from;
    if (!albedo && !normal)
        return;
    lull_exec_radiance(&from, t, e->block, t->left + x, y, n);
    from.albedo = albedo;
    from.normal = normal;
    from.flags = lull_filter_flags(&from, codes[CLIPPED]);
    if (!albedo == !lull_plan_has_feature(plan, LULL_GRAIN_ALBEDO) &&
        !normal == !lull_plan_has_feature(plan, LULL_GRAIN_NORMAL)) {
        kernels->encode(codes, &from, n);
        return;
    }
    kernels->encode(e->codes, &from, n);
    first = albedo ? 0 : normals;
    last = normal ? normals + 3 : normals;
    for (unsigned k = 0; k < n; k++)
        memcpy(codes + k * LULL_CODES + first, e->codes + k * LULL_CODES + first, last - first);
}

/* In the place of the input's rows, which nobody needs any more. */
void lull_exec_encode(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker)
{
    const lull_plan *plan = t->plan;
    const unsigned end = y < plan->frame.height ? lull_min_u(lull_exec_inside(t), x + n) : 0;
    encoding *e = lull_exec_scratch(t, worker);
    for (; x < end; x += MANY) {
        for (unsigned f = 0; f < LULL_GRAINY; f++)
            if (lull_plan_has_feature(plan, f))
                get_cells(e->cell[f], t, f, x, y);
        for (unsigned i = 0; i < MANY && x + i < end; i += SOME)
            encode_some(e, t, x + i, i, y, lull_min_u(SOME, end - x - i));
    }
}
