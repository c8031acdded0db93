/* What is made of the images before the network and the filter: codes, albedo, normal, guide.
 * Images are given as the host loads them: the main one sanitised and exposed, the albedo as it
 * counts, normals as they are. */

/* Pixel (x, y) of the main image. */
static void get_radiance(float *r, __global uchar *memory, lull_cl_tensor image, int x, int y)
{
    get_pixel(r, pixel_at(memory, image, x, y));
    for (int c = 0; c < 3; c++)
        r[c] = lull_sane(r[c], 1.0f, 0.0f, LULL_RADIANCE_MAX);
}

/* Albedo and codes of the normal at (x, y). */
static void get_albedo(float *v, __global uchar *memory, lull_cl_tensor image, int x, int y)
{
    get_pixel(v, pixel_at(memory, image, x, y));
    lull_sane_albedo(v);
}
static void get_normal(int *q, __global uchar *memory, lull_cl_tensor image, int x, int y)
{
    __global const float *from = pixel_at(memory, image, x, y);
    for (int c = 0; c < 3; c++)
        q[c] = lull_normal_code(from[c]);
}

/* 1 if (x, y) is inside the image; if not, puts zeros there, where there are padding and border. */
static int is_coded(__global uchar *memory, const lull_cl_filter *a, int x, int y)
{
    __global uchar4 *to = (__global uchar4 *)bytes_at(memory, a->out, x, y);
    if (x >= 0 && x < a->inside_width && y >= 0 && y < a->inside_height)
        return 1;
    if (x < a->width + LULL_CL_BORDER && y < a->height + LULL_CL_BORDER)
        to[0] = to[1] = to[2] = (uchar4)(0);
    return 0;
}

/* Codes of radiance by albedo. */
static void code_radiance(uchar *code, const float *r, const float *albedo)
{
    float share[3];
    for (int c = 0; c < 3; c++)
        share[c] = albedo[c] + LULL_FILTER_EPSILON;
    lull_shares(share, 1.0f, 1.0f);
    for (int c = 0; c < 3; c++)
        code[c] = lull_radiance_code(r[c] * share[c]);
}

/* out: the network's input, 12 codes a pixel; sources: radiance, albedo, normal. */
KERNEL_OF_PIXELS encode(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = (int)get_global_id(0) - LULL_CL_BORDER, y = (int)get_global_id(1) - LULL_CL_BORDER;
    float r[3], albedo[3], none = 1.0f - LULL_FILTER_EPSILON;
    int normal[3] = {128, 128, 128};
    uchar code[9];
    __global uchar4 *to = (__global uchar4 *)bytes_at(memory, a.out, x, y);
    if (!is_coded(memory, &a, x, y))
        return;
    get_radiance(r, memory, a.source[0], x, y);
    albedo[0] = albedo[1] = albedo[2] = none;
    if (a.flags & LULL_CL_ALBEDO)
        get_albedo(albedo, memory, a.source[1], x, y);
    if (a.flags & LULL_CL_NORMAL)
        get_normal(normal, memory, a.source[2], x, y);
    for (int c = 0; c < 3 && a.flags & LULL_CL_ALONE; c++)
        normal[c] = lull_normal_code(2.0f * r[c] - 1.0f);
    code_radiance(code, r, albedo);
    for (int c = 0; c < 3; c++) {
        code[3 + c] = a.flags & LULL_CL_ALBEDO ? lull_to_code(albedo[c] * 255.0f) : 0;
        code[6 + c] = normal[c];
    }
    to[0] = (uchar4)(code[0], code[1], code[2], code[3]);
    to[1] = (uchar4)(code[4], code[5], code[6], code[7]);
    to[2] = (uchar4)(code[8], a.flags & LULL_CL_ALBEDO ? 255 : 0,
                     a.flags & (LULL_CL_NORMAL | LULL_CL_ALONE) ? 255 : 0,
                     a.flags & LULL_CL_CLIPPED ? 255 : 0);
}

/* 1 if (x, y) is inside the image; if not, puts zeros there, where there is padding. */
static int is_inside(__global uchar *memory, const lull_cl_filter *a, int x, int y)
{
    if (x < a->inside_width && y < a->inside_height)
        return 1;
    if (x < a->width && y < a->height)
        *floats_at(memory, a->out, x, y) = (float4)(0.0f);
    return 0;
}

/* out: (1, albedo), zeros outside the image; source: albedo. */
KERNEL_OF_PIXELS spread(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float v[3];
    if (!is_inside(memory, &a, x, y))
        return;
    get_albedo(v, memory, a.source[0], x, y);
    *floats_at(memory, a.out, x, y) = (float4)(1.0f, v[0], v[1], v[2]);
}

/* out: (1, normal), zeros outside the image; source: normal. */
KERNEL_OF_PIXELS spread_normal(__global uchar *memory, __global const uchar *model,
                               lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float v[3];
    if (!is_inside(memory, &a, x, y))
        return;
    get_pixel(v, pixel_at(memory, a.source[0], x, y));
    for (int c = 0; c < 3; c++)
        v[c] = lull_sane(v[c], 1.0f, -1.0f, 1.0f);
    *floats_at(memory, a.out, x, y) = (float4)(1.0f, v[0], v[1], v[2]);
}

/* out: two bytes a pixel; sources: albedo, normal. */
KERNEL_OF_PIXELS guide(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1), q[3] = {0, 0, 0};
    uchar made[2];
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    if (a.flags & LULL_CL_NORMAL) {
        get_normal(q, memory, a.source[1], x, y);
        lull_guide_of_normal(made, q);
    } else {
        if (a.flags & LULL_CL_ALBEDO) {
            float v[3];
            get_albedo(v, memory, a.source[0], x, y);
            for (int c = 0; c < 3; c++)
                q[c] = lull_to_code(v[c] * 255.0f);
        }
        lull_guide_of_albedo(made, q);
    }
    *(__global uchar2 *)bytes_at(memory, a.out, x, y) = (uchar2)(made[0], made[1]);
}

/* ---- Grain of albedo and normals -------------------------------------------------------------- */

/* 1 if there is the feature. */
static int has_feature(const lull_cl_filter *a, uint feature)
{
    return (a->flags & (feature == LULL_GRAIN_NORMAL ? LULL_CL_NORMAL : LULL_CL_ALBEDO)) != 0;
}

/* LULL_GRAIN_SUMS of a feature over the pixels of a cell that are inside the image. */
static void sum_cell(int *sum, __global uchar *memory, const lull_cl_filter *a, uint feature,
                     int cell, int row)
{
    const int side = LULL_GRAIN_SIDE;
    const uint at = lull_grain_codes(feature);
    int left = cell * side, right = min(left + side, a->inside_width);
    int bottom = min((row + 1) * side, a->inside_height);
    for (int y = row * side; y < bottom; y++)
        for (int x = left; x < right; x++) {
            __global uchar *p = bytes_at(memory, a->source[0], x, y) + at;
            uchar here[3] = {p[0], p[1], p[2]};
            int light = lull_grain_light(here), step;
            sum[0]++;
            sum[1] += light;
            sum[2] += light * light;
            for (int c = 0; c < 3; c++)
                sum[3 + c] += here[c];
            for (uint k = 0; k < LULL_GRAIN_STEPS; k++) {
                int other = x + (k == 3 ? -1 : k != 1), below = y + (k > 0);
                if (other < left || other >= right || below >= bottom)
                    continue;
                p = bytes_at(memory, a->source[0], other, below) + at;
                uchar there[3] = {p[0], p[1], p[2]};
                step = lull_grain_light(there) - light;
                sum[6 + k] += step * step;
            }
        }
}

/* The sum of squared steps of the light in a cell. */
static int sum_light(__global uchar *memory, const lull_cl_filter *a, int cell, int row)
{
    const int side = LULL_GRAIN_SIDE;
    int last = min((cell + 1) * side, a->inside_width) - 1;
    int bottom = min((row + 1) * side, a->inside_height), sum = 0;
    for (int y = row * side; y < bottom; y++)
        for (int x = cell * side; x < last; x++) {
            int step = bytes_at(memory, a->source[0], x + 1, y)[LULL_GRAIN_LIGHT_CODE] -
                       bytes_at(memory, a->source[0], x, y)[LULL_GRAIN_LIGHT_CODE];
            sum += step * step;
        }
    return sum;
}

/* out: LULL_GRAIN_ALL_SUMS sums of cells, whole numbers; source: the network's input. */
KERNEL_OF_PIXELS grain_sums(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int cell = get_global_id(0), row = get_global_id(1);
    if (cell * (int)LULL_GRAIN_SIDE >= a.inside_width ||
        row * (int)LULL_GRAIN_SIDE >= a.inside_height)
        return;
    for (uint f = 0; f < LULL_GRAINY; f++) {
        int sum[LULL_GRAIN_SUMS] = {0};
        if (has_feature(&a, f))
            sum_cell(sum, memory, &a, f, cell, row);
        for (uint k = 0; k < LULL_GRAIN_SUMS; k++)
            pixel_at(memory, a.out, cell, row)[f * LULL_GRAIN_SUMS + k] = (float)sum[k];
    }
    pixel_at(memory, a.out, cell, row)[LULL_GRAIN_LIGHT] =
        (float)sum_light(memory, &a, cell, row);
}

/* Puts LULL_GRAIN_VALUES of a feature of a cell. */
static void put_grain(__global uchar *memory, const lull_cl_filter *a, uint feature, int x, int y,
                      float part)
{
    float around[LULL_GRAIN_SUMS], own[LULL_GRAIN_SUMS], cell[LULL_GRAIN_VALUES] = {0.0f};
    float light[2];
    __global float *to = pixel_at(memory, a->out, x, y) + feature * LULL_GRAIN_VALUES;
    for (uint k = 0; k < LULL_GRAIN_SUMS; k++) {
        around[k] = sum_around(memory, a, x, y, feature * LULL_GRAIN_SUMS + k);
        own[k] = sum_at(memory, a, x, y, feature * LULL_GRAIN_SUMS + k);
    }
    light[0] = sum_around(memory, a, x, y, LULL_GRAIN_LIGHT);
    light[1] = sum_at(memory, a, x, y, LULL_GRAIN_LIGHT);
    if (has_feature(a, feature))
        lull_grain(cell, around, own, light, feature, part);
    for (uint c = 0; c < LULL_GRAIN_VALUES; c++)
        to[c] = cell[c];
}

/* out: for each feature how much of the mean stands for it, and the mean, of cells; source: sums of
 * cells. */
KERNEL_OF_PIXELS grain(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    put_grain(memory, &a, LULL_GRAIN_NORMAL, x, y, LULL_GRAIN_OF_NORMAL);
    put_grain(memory, &a, LULL_GRAIN_ALBEDO, x, y,
              lull_grain_of_albedo(pixel_at(memory, a.out, x,
                                            y)[LULL_GRAIN_NORMAL * LULL_GRAIN_VALUES]));
}

/* Takes its grain out of a feature's pixel (1, value) of a tensor, which v is then. Returns 0 if it
 * has none. */
static int clean_pixel(float *v, __global uchar *memory, lull_cl_tensor tensor,
                       const lull_cl_filter *a, const cell_place *at, uint feature, int x, int y)
{
    const uint first = feature * LULL_GRAIN_VALUES;
    float share;
    if (!has_feature(a, feature))
        return 0;
    share = value_between(memory, a->source[2], at, first);
    if (!(share > 0.0f))
        return 0;
    get3(v, floats_at(memory, tensor, x, y)->yzww);
    for (int c = 0; c < 3; c++)
        v[c] = lull_without_grain(v[c], share,
                                  value_between(memory, a->source[2], at, first + 1 + c), feature);
    *floats_at(memory, tensor, x, y) = (float4)(1.0f, v[0], v[1], v[2]);
    return 1;
}

/* out: the codes of the network's input, without grain; sources: albedo and normal, (1, value),
 * which lose it, too; grain of cells, radiance. */
KERNEL_OF_PIXELS take_grain(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    cell_place at = place_between(LULL_GRAIN_SIDE, &a, x, y);
    float r[3], v[3];
    uchar code[6];
    __global uchar *to = bytes_at(memory, a.out, x, y);
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    if (clean_pixel(v, memory, a.source[1], &a, &at, LULL_GRAIN_NORMAL, x, y))
        for (int c = 0; c < 3; c++)
            to[lull_grain_codes(LULL_GRAIN_NORMAL) + c] = lull_normal_code(v[c]);
    if (!clean_pixel(v, memory, a.source[0], &a, &at, LULL_GRAIN_ALBEDO, x, y))
        return;
    get_radiance(r, memory, a.source[3], x, y);
    lull_sane_albedo(v);
    code_radiance(code, r, v);
    for (int c = 0; c < 3; c++)
        code[3 + c] = lull_to_code(v[c] * 255.0f);
    for (int k = 0; k < 6; k++)
        to[k] = code[k];
}
