/* Part of conform.c: the slots of the regression. The scalar port is the definition
 * (docs/kernel-prediction.md; tests/golden has its values). */
#ifndef LULL_TESTS_REGRESSION_CASES_H
#define LULL_TESTS_REGRESSION_CASES_H

static void fit_sums_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, floats = 2 * plane + pixels, sum_plane, bytes;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 700.0f, at_end);
    float *v = make_floats(GUARD_ROW + 1, floats, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 2, floats, 0.02f, 1.02f, at_end);
    float *normal = make_floats(GUARD_ROW + 3, floats, -1.0f, 1.0f, at_end);
    float *sums = place_planes(LULL_FIT_SUMS, pixels, &sum_plane, &bytes, at_end);
    lull_encoding from = {radiance, NULL, NULL, 3.5f, 65504.0f, 0};
    lull_fitting at = {sums, v, smooth, normal, sum_plane, plane, plane, plane, pixels};
    spoil(radiance, 3 * (size_t)pixels);
    for (unsigned run = 0; run < 2; run++) {
        for (size_t i = 0; i < bytes / sizeof *sums; i++)
            sums[i] = (float)(i % 1000) * 0.001f;
        if (run)
            now.port->fit_sums(&at, &from);
        else
            now.scalar.fit_sums(&at, &from);
        if (!run)
            memcpy(expected, sums, bytes);
    }
    same_bytes(sums, bytes, "fit_sums", pixels);
    for (size_t i = 0; i < pixels; i++) { /* some of the definition */
        size_t at5 = 5 * sum_plane + i;
        CHECK(sums[i] == (float)(i % 1000) * 0.001f + 1.0f);
        CHECK(fabsf(sums[at5] - (float)(at5 % 1000) * 0.001f - smooth[plane + i]) < 1e-5f);
        for (size_t c = LULL_FIT_RESTS; c < LULL_FIT_SQUARES; c++)
            CHECK(sums[c * sum_plane + i] <= LULL_FIT_MOST_REST + 1.0f);
    }
}

static void fit_sums_cases(void)
{
    for (unsigned pixels = 1; pixels <= 64; pixels++)
        fit_sums_case(pixels);
}

/* Makes sums of a cell what `pixels` random ones give whose rest is a known function of their
 * features, if they are not all alike. */
static void make_cell(float *row, size_t plane, unsigned pixels)
{
    for (unsigned i = 0; i < pixels; i++) {
        float f[LULL_FIT_FEATURES], p[3], r[3], sums[LULL_FIT_SUMS];
        for (unsigned k = 0; k < LULL_FIT_FEATURES; k++)
            f[k] = now.pattern == CASES_MIN   ? 0.0f
                   : now.pattern == CASES_MAX ? 1.0f
                                              : (float)guard_between(-999, 999) * 1e-3f;
        for (unsigned c = 0; c < 3; c++) {
            float rest = 0.3f * f[c] - 0.2f * f[5] + 0.1f;
            p[c] = (float)guard_below(1000) * 1e-2f;
            r[c] = p[c] + rest * (p[c] + LULL_FIT_EPSILON);
        }
        lull_fit_products(sums, p, r, f);
        for (size_t k = 0; k < LULL_FIT_SUMS; k++)
            row[k * plane] += sums[k];
    }
}

/* What coefficients of cell i of a channel give for the mean features, without the mean rest. */
static float at_mean_features(const float *b, size_t step, const float *const *rows, size_t plane,
                              size_t i)
{
    double sums[1 + LULL_FIT_FEATURES] = {0}, all = (double)b[LULL_FIT_FEATURES * step];
    for (size_t k = 0; k <= LULL_FIT_FEATURES; k++)
        for (unsigned y = 0; y < 3; y++)
            for (unsigned x = 0; x < 3; x++)
                sums[k] += (double)((1 + (x == 1)) * (1 + (y == 1))) *
                           (double)rows[y][(ptrdiff_t)(k * plane + i + x) - 1];
    for (size_t k = 0; k < LULL_FIT_FEATURES; k++)
        all += sums[1 + k] / sums[0] * (double)b[k * step];
    return (float)all;
}

static void fit_case(unsigned cells)
{
    int at_end = guard_below(2) != 0;
    size_t plane = cells + 2 + GAP, floats = (LULL_FIT_SUMS - 1) * plane + cells + 2;
    size_t out_plane, bytes;
    float *out = place_planes(LULL_FIT_COEFFICIENTS, cells, &out_plane, &bytes, at_end);
    float *work = guard_place(GUARD_ROW + 3, LULL_FIT_WORK * sizeof *work, at_end);
    const float *rows[3];
    for (unsigned r = 0; r < 3; r++) {
        float *row = guard_place(GUARD_ROW + r, floats * sizeof *row, at_end);
        memset(row, 0, floats * sizeof *row);
        for (unsigned i = 0; i < cells + 2; i++)
            if (r == 1 || guard_below(4)) /* else as outside the image */
                make_cell(row + i, plane, 1 + guard_below(64));
        rows[r] = row + 1;
    }
    now.scalar.fit(out, out_plane, rows, plane, cells, work);
    memcpy(expected, out, bytes);
    for (size_t i = 0; i < cells; i++) /* the ridge changes little */
        for (size_t c = 0; now.pattern == CASES_RANDOM && c < 3; c++) {
            CHECK(fabsf(out[c * 4 * out_plane + i] - 0.3f) < 0.05f);
            CHECK(fabsf(out[(15 + c) * out_plane + i] + 0.2f) < 0.05f);
            CHECK(fabsf(at_mean_features(out + c * out_plane + i, 3 * out_plane, rows, plane, i)) <
                  1e-4f);
        }
    for (size_t i = 0; i < cells; i++)
        for (size_t k = 0; k < LULL_FIT_COEFFICIENTS; k++)
            out[k * out_plane + i] = 9.0f;
    now.port->fit(out, out_plane, rows, plane, cells, work);
    same_bytes(out, bytes, "fit", cells);
}

static void fit_cases(void)
{
    for (unsigned cells = 1; cells <= 35; cells++)
        fit_case(cells);
}

static void regress_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, floats = 2 * plane + pixels, out_plane, bytes;
    size_t room = LULL_FIT_ROOM(pixels), b_plane = room + 3;
    size_t b_floats = (LULL_FIT_COEFFICIENTS - 1) * b_plane + room;
    float *out = place_planes(3, pixels, &out_plane, &bytes, at_end);
    float *v = make_floats(GUARD_ROW, floats, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 1, floats, 0.02f, 1.02f, at_end);
    float *normal = make_floats(GUARD_ROW + 2, floats, -1.0f, 1.0f, at_end);
    float *b = make_floats(GUARD_ROW + 3, b_floats, -0.5f, 0.5f, at_end);
    lull_regression r = {out,   v,     smooth, normal,  b,     out_plane,
                         plane, plane, plane,  b_plane, pixels};
    now.scalar.regress(&r);
    memcpy(expected, out, bytes);
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) {
            float ratio = out[c * out_plane + i] / (v[c * plane + i] + 1e-9f);
            CHECK(v[c * plane + i] <= 0.0f || (ratio > 0.499f && ratio < 1.501f));
            out[c * out_plane + i] = -1.0f;
        }
    now.port->regress(&r);
    same_bytes(out, bytes, "regress", pixels);
}

static void regress_cases(void)
{
    for (unsigned pixels = 1; pixels <= 64; pixels++)
        regress_case(pixels);
}

#endif
