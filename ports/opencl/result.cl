/* Steps 6 to 9 of the filter of family K: smoothing along the result, regression on normals and
 * albedo, what the result lacks, and the output with some of the input (docs/kernel-prediction.md,
 * lib/bilateral.h, lib/pixels.h). */

/* ---- Smoothing along the result -------------------------------------------------------------- */

static int noise_at(__global uchar *memory, const lull_cl_filter *a, int x, int y)
{
    return *bytes_at(memory, a->source[2], clamp_to(x, a->inside_width), y);
}

/* How far the pixels lie away that the smoothing looks at, in columns, then in rows, in its order;
 * the first four and two of them are near. */
__constant char away_x[] = {-LULL_BILATERAL_REACH, -2, 2, LULL_BILATERAL_REACH,
                            -LULL_BILATERAL_FAR, LULL_BILATERAL_FAR, -4, 4};
__constant char away_y[] = {-2, 2, -4, 4, -LULL_BILATERAL_REACH, LULL_BILATERAL_REACH,
                            -LULL_BILATERAL_FAR, LULL_BILATERAL_FAR};

/* out: smoothed result; sources: result, guide, noise. */
KERNEL_OF_PIXELS bilateral(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    int is_far = (a.flags & LULL_CL_FAR) != 0;
    int columns = lull_bilateral_columns(is_far), rows = lull_bilateral_rows(is_far);
    float v[3], g[3], sum[3] = {0.0f, 0.0f, 0.0f}, weights = lull_smoothing_own(is_far);
    uchar2 here;
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    get3(v, *floats_at(memory, a.source[0], x, y));
    here = *(__global const uchar2 *)bytes_at(memory, a.source[1], x, y);
    lull_smoothing_factors(g, v, noise_at(memory, &a, x - 1, y) + noise_at(memory, &a, x, y) +
                                     noise_at(memory, &a, x + 1, y), is_far);
    for (int k = 0; k < columns + rows; k++) {
        int other_x = clamp_to(k < columns ? x + away_x[k] : x, a.inside_width);
        int other_y = clamp_to(k < columns ? y : y + away_y[k - columns], a.inside_height);
        uchar2 there = *(__global const uchar2 *)bytes_at(memory, a.source[1], other_x, other_y);
        float change[3], w;
        get3(change, *floats_at(memory, a.source[0], other_x, other_y));
        for (int c = 0; c < 3; c++)
            change[c] -= v[c];
        w = lull_smoothing_weight(change, g, there.x - here.x, there.y - here.y);
        weights += w;
        for (int c = 0; c < 3; c++)
            sum[c] += w * change[c];
    }
    for (int c = 0; c < 3; c++)
        v[c] += sum[c] * (1.0f / weights);
    *floats_at(memory, a.out, x, y) = make4(v, 0.0f);
}

/* ---- Regression ------------------------------------------------------------------------------ */

/* Features and divisor of a pixel; of `regress` and `fit_sums`, whose sources 1 and 2 are filtered
 * albedo and normal. Without normals there is no second. */
static void get_features(float *f, float *smooth, __global uchar *memory, const lull_cl_filter *a,
                         int x, int y)
{
    float normal[3] = {0.0f, 0.0f, 0.0f};
    get3(smooth, *floats_at(memory, a->source[1], x, y));
    if (a->flags & LULL_CL_NORMAL)
        get3(normal, *floats_at(memory, a->source[2], x, y));
    lull_fit_features(f, normal, smooth);
}

/* out: LULL_FIT_SUMS sums of cells; sources: smoothed result, filtered albedo and normal, radiance.
 * A work item makes a column of a cell, a group two cells beside each other in four rows of them.
 * An odd stride lets a group's items add without meeting in the banks of local memory. */
KERNEL_OF_PIXELS fit_sums(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    __local float column[LULL_CL_LOCAL_X * LULL_CL_LOCAL_Y][LULL_FIT_SUMS | 1u];
    int x = get_global_id(0), cell = get_global_id(1), y = cell * (int)LULL_FIT_SIDE;
    int i = get_local_id(1) * LULL_CL_LOCAL_X + get_local_id(0), within = x % (int)LULL_FIT_SIDE;
    int end = x < a.inside_width ? min(y + (int)LULL_FIT_SIDE, a.inside_height) : 0;
    float sum[LULL_FIT_SUMS];
    for (uint k = 0; k < LULL_FIT_SUMS; k++)
        sum[k] = 0.0f;
    for (; y < end; y++) {
        float p[3], smooth[3], r[3], f[LULL_FIT_FEATURES], products[LULL_FIT_SUMS];
        get_features(f, smooth, memory, &a, x, y);
        get3(p, *floats_at(memory, a.source[0], x, y));
        get_radiance(r, memory, a.source[3], x, y);
        for (int c = 0; c < 3; c++)
            p[c] *= smooth[c];
        lull_fit_products(products, p, r, f);
        for (uint k = 0; k < LULL_FIT_SUMS; k++)
            sum[k] += products[k];
    }
    for (uint k = 0; k < LULL_FIT_SUMS; k++)
        column[i][k] = sum[k];
    for (int columns = LULL_FIT_SIDE / 2; columns; columns /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (within < columns)
            for (uint k = 0; k < LULL_FIT_SUMS; k++)
                column[i][k] += column[i + columns][k];
    }
    if (within == 0 && cell < a.height)
        for (uint k = 0; k < LULL_FIT_SUMS; k++)
            pixel_at(memory, a.out, x / (int)LULL_FIT_SIDE, cell)[k] = column[i][k];
}

/* out: coefficients of a cell and those around it; source: sums of cells. */
KERNEL_OF_PIXELS fit(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float sum[LULL_FIT_SUMS], b[LULL_FIT_COEFFICIENTS];
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    for (uint k = 0; k < LULL_FIT_SUMS; k++)
        sum[k] = sum_around(memory, &a, x, y, k);
    lull_fit(b, sum);
    for (uint k = 0; k < LULL_FIT_COEFFICIENTS; k++)
        pixel_at(memory, a.out, x, y)[k] = b[k];
}

/* out: the result with what the regression adds; sources: smoothed result, filtered albedo and
 * normal, coefficients of cells. */
KERNEL_OF_PIXELS regress(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    cell_place at = place_between(LULL_FIT_SIDE, &a, x, y);
    float v[3], smooth[3], f[LULL_FIT_FEATURES], b[LULL_FIT_COEFFICIENTS];
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    for (uint k = 0; k < LULL_FIT_COEFFICIENTS; k++)
        b[k] = value_between(memory, a.source[3], &at, k);
    get_features(f, smooth, memory, &a, x, y);
    get3(v, *floats_at(memory, a.source[0], x, y));
    for (int c = 0; c < 3; c++)
        v[c] = lull_regressed(v[c], f, b + c);
    *floats_at(memory, a.out, x, y) = make4(v, 0.0f);
}

/* ---- What the result lacks ------------------------------------------------------------------- */

/* out: LULL_CELL_SUMS sums of cells; sources: result, radiance, filtered albedo, noise. A group
 * makes a cell, each work item a column of it. */
KERNEL(LULL_CELL, 1) residual(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    __local float4 column[LULL_CELL];
    int i = get_local_id(0), x = get_global_id(0), y = get_group_id(1) * (int)LULL_CELL;
    int end = x < a.inside_width ? min(y + (int)LULL_CELL, a.inside_height) : 0;
    float4 sum = (float4)(0.0f);
    if (a.flags & LULL_CL_CLIPPED) /* it lacks light itself */
        end = 0;
    for (; y < end; y++) {
        float p[3], smooth[3], r[3], sums[LULL_CELL_SUMS];
        get3(p, *floats_at(memory, a.source[0], x, y));
        get3(smooth, *floats_at(memory, a.source[2], x, y));
        get_radiance(r, memory, a.source[1], x, y);
        for (int c = 0; c < 3; c++)
            p[c] *= smooth[c];
        lull_balance_of(sums, p, r, *bytes_at(memory, a.source[3], x, y));
        sum += (float4)(sums[0], sums[1], sums[2], sums[3]);
    }
    column[i] = sum;
    for (int columns = LULL_CELL / 2; columns; columns /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (i < columns)
            column[i] += column[i + columns];
    }
    if (i == 0)
        *floats_at(memory, a.out, get_group_id(0), get_group_id(1)) = column[0];
}

static float4 sums_at(__global uchar *memory, const lull_cl_filter *a, int x, int y)
{
    return x >= 0 && x < a->width && y >= 0 && y < a->height
               ? *floats_at(memory, a->source[0], x, y)
               : (float4)(0.0f);
}

/* out: gains of cells; source: their sums. */
KERNEL_OF_PIXELS gains(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float4 three = (float4)(0.0f), all = (float4)(0.0f);
    float near[LULL_CELL_SUMS], far[LULL_CELL_SUMS];
    if (x >= a.width || y >= a.height)
        return;
    for (int k = -LULL_CELLS_BESIDE; k <= LULL_CELLS_BESIDE; k++) {
        float4 column = (sums_at(memory, &a, x + k, y - 1) + sums_at(memory, &a, x + k, y)) +
                        sums_at(memory, &a, x + k, y + 1);
        float4 above = (sums_at(memory, &a, x + k, y - 4) + sums_at(memory, &a, x + k, y - 3)) +
                       sums_at(memory, &a, x + k, y - 2);
        if (k >= -2 && k <= 2)
            three += column;
        all += column + above;
    }
    vstore4(three, 0, near);
    vstore4(all, 0, far);
    *pixel_at(memory, a.out, x, y) = lull_cell_gain(near, far);
}

/* out: corrected result; sources: result, gains, noise. */
KERNEL_OF_PIXELS correct(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    cell_place at = place_between(LULL_CELL, &a, x, y);
    float w, v[3];
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    w = *bytes_at(memory, a.source[2], x, y) * LULL_NOISE_SHARE;
    w = value_between(memory, a.source[1], &at, 0) * (w < 1.0f ? w : 1.0f);
    get3(v, *floats_at(memory, a.source[0], x, y));
    for (int c = 0; c < 3; c++)
        v[c] += v[c] * w;
    *floats_at(memory, a.out, x, y) = make4(v, 0.0f);
}

/* ---- The output, with some of the input where there is little noise -------------------------- */

/* out: shares of the input of runs of LULL_RUN pixels; source: noise. */
KERNEL_OF_PIXELS shares(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int run = get_global_id(0), y = get_global_id(1);
    lull_mixing mixing =
        lull_mixing_of(a.calm, a.flags & LULL_CL_FEATURES, a.flags & LULL_CL_CLEAN);
    uint pixels = 0, codes = 0;
    if (run * (int)LULL_RUN >= a.inside_width || y >= a.inside_height)
        return;
    for (int other = run - LULL_RUNS_BESIDE; other <= run + LULL_RUNS_BESIDE; other++) {
        int x = other * (int)LULL_RUN, end = min(x + (int)LULL_RUN, a.inside_width);
        uint count = x >= 0 && x < end ? end - x : 0, sum = 0;
        for (uint i = 0; i < count; i++)
            sum += *bytes_at(memory, a.source[0], x + (int)i, y);
        pixels += lull_noisy(count, count, sum);
        codes += lull_noisy(sum, count, sum);
    }
    *pixel_at(memory, a.out, run, y) = lull_run_share((float)pixels, (float)codes, &mixing);
}

/* Value at pixel (x, y) of those of runs of LULL_RUN pixels, one float each, of `width` pixels. */
static float between_runs(__global uchar *memory, lull_cl_tensor t, int width, int x, int y)
{
    int runs = (int)lull_cell_count(LULL_RUN, (uint)width);
    float before = *pixel_at(memory, t, lull_cell_near(LULL_RUN, x, 0, runs), y);
    float after = *pixel_at(memory, t, lull_cell_near(LULL_RUN, x, 1, runs), y);
    return before + lull_cell_part(LULL_RUN, x) * (after - before);
}

/* Exposed radiance of a pixel, and its light. */
static float light_at(float *p, __global uchar *memory, const lull_cl_filter *a, int x, int y)
{
    float smooth[3];
    get3(p, *floats_at(memory, a->source[0], x, y));
    get3(smooth, *floats_at(memory, a->source[1], x, y));
    for (int c = 0; c < 3; c++)
        p[c] = p[c] * smooth[c] > 0.0f ? p[c] * smooth[c] : 0.0f;
    return (p[0] + p[1]) + p[2];
}

/* Exposed radiance of a pixel inside, averaged along edges. */
static void average(float *v, __global uchar *memory, const lull_cl_filter *a, float strength,
                    int x, int y)
{
    const int line_x[] = {1, 0, 1, -1}, line_y[] = {0, 1, 1, 1};
    float ends[3] = {0.0f, 0.0f, 0.0f}, least = LULL_LARGEST, most = 0.0f, share;
    float light = light_at(v, memory, a, x, y);
    for (int k = 0; k < 4; k++) {
        float first[3], last[3];
        float before = light_at(first, memory, a, x - line_x[k], y - line_y[k]);
        float after = light_at(last, memory, a, x + line_x[k], y + line_y[k]);
        float change = lull_edge_change(light, before, after);
        for (int c = 0; change < least && c < 3; c++)
            ends[c] = first[c] + last[c];
        least = change < least ? change : least;
        most = change > most ? change : most;
    }
    share = lull_edge_share(light, least, most, strength);
    for (int c = 0; c < 3; c++)
        v[c] += share * (ends[c] - (v[c] + v[c]));
}

/* out: the exposed result as an image; sources: result, filtered albedo + epsilon, and, if some of
 * the input is asked for, shares of runs, radiance, noise. */
KERNEL_OF_PIXELS modulate(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float v[3], strength = a.flags & LULL_CL_NOISE ? a.ragged * LULL_EDGE_SHARE : 0.0f;
    if (x >= a.inside_width || y >= a.inside_height)
        return;
    if (strength > 0.0f && x > 0 && y > 0 && x + 1 < a.inside_width && y + 1 < a.inside_height)
        average(v, memory, &a, strength, x, y);
    else
        light_at(v, memory, &a, x, y);
    for (int c = 0; c < 3; c++)
        v[c] = lull_sane(v[c], 1.0f, 0.0f, LULL_LARGEST);
    if (a.flags & LULL_CL_NOISE) {
        float between = between_runs(memory, a.source[2], a.inside_width, x, y), r[3];
        lull_mixing mixing =
            lull_mixing_of(a.calm, a.flags & LULL_CL_FEATURES, a.flags & LULL_CL_CLEAN);
        float share;
        get_radiance(r, memory, a.source[3], x, y);
        share = lull_pixel_share(between, *bytes_at(memory, a.source[4], x, y), v, r, &mixing);
        for (int c = 0; c < 3; c++)
            v[c] += share * (r[c] - v[c]);
    }
    for (int c = 0; c < 3; c++)
        pixel_at(memory, a.out, x, y)[c] = v[c];
}
