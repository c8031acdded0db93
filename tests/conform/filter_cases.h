/* Part of conform.c: the slots of family K's filter. */
#ifndef LULL_TESTS_FILTER_CASES_H
#define LULL_TESTS_FILTER_CASES_H

/* Products of two tables of 16 whose last values are 1. */
static void make_table(float *table)
{
    float half[32];
    for (unsigned i = 0; i < 32; i++)
        half[i] = i % 16 == 15               ? 1.0f
                  : now.pattern == CASES_MIN ? 0.0f
                  : now.pattern == CASES_MAX ? 1.0f
                                             : (float)guard_below(1u << 20) / 1048576.0f;
    for (unsigned q = 0; q < 256; q++)
        table[q] = half[q / 16] * half[16 + q % 16];
}

/* Planes lie further apart than they are long, by a number that is not a multiple of anything. */
#define GAP 5u

/* code_step: 1 for codes in planes. */
static void filter5_case(unsigned pixels, size_t code_step)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + 4 + GAP, out_plane = pixels + GAP;
    size_t code_plane = code_step == 1 ? pixels + GAP : 1;
    size_t codes_bytes = (pixels - 1) * code_step + 24 * code_plane + 1;
    float *out = guard_place(GUARD_OUT, (2 * out_plane + pixels) * sizeof *out, at_end);
    float *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, codes_bytes, at_end);
    lull_window window = {0};
    make_table(table);
    for (size_t i = 0; i < codes_bytes; i++)
        codes[i] = now.pattern == CASES_ALTERNATING ? (uint8_t)(i & 1 ? 255 : 0)
                                                    : (uint8_t)guard_below(256);
    for (unsigned r = 0; r < 5; r++) {
        size_t floats = 3 * plane + pixels + 4;
        float *row = guard_place(GUARD_ROW + r, floats * sizeof *row, at_end);
        for (size_t i = 0; i < floats; i++)
            row[i] = now.pattern == CASES_MAX ? 65504.0f : (float)guard_below(1u << 24) * 0.001f;
        window.rows[r] = row + 2;
    }
    window.out = out;
    window.out_plane = out_plane;
    window.plane = plane;
    window.codes = codes;
    window.code_step = code_step;
    window.code_plane = code_plane;
    window.table = table;
    window.more = guard_below(2) ? 0.02f : 0.0f;
    window.none = guard_below(2) ? 1.0f : 0.0f;
    window.pixels = pixels;
    memset(out, 1, (2 * out_plane + pixels) * sizeof *out);
    memcpy(expected, out, (2 * out_plane + pixels) * sizeof *out);
    for (size_t p = 0; p < pixels; p++) { /* the definition */
        volatile float sum[4] = {0, 0, 0, 0}, product;
        for (unsigned c = 0; c < 4; c++)
            for (unsigned k = 0; k < 25; k++) {
                product = table[codes[p * code_step + k * code_plane]] *
                          window.rows[k / 5][c * plane + p + k % 5 - 2];
                sum[c] = sum[c] + product;
            }
        for (unsigned c = 0; c < 3; c++) {
            volatile float mean = window.none;
            if (sum[0] > 0.0f) {
                mean = 1.0f / sum[0];
                mean = sum[c + 1] * mean;
                mean = mean + window.more;
            }
            ((float *)(void *)expected)[c * out_plane + p] = mean;
        }
    }
    now.port->filter5(&window);
    now.cases++;
    if (!CHECK(memcmp(out, expected, (2 * out_plane + pixels) * sizeof *out) == 0))
        printf("  with %u pixels, code step %u\n", pixels, (unsigned)code_step);
}

/* 1 if the port's kernels take codes in planes, too. */
static int takes_planes(void) { return now.is_scalar || now.port->in_planes; }

static void filter5_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        filter5_case(pixels, pixels & 1 ? 27 : 52);
    for (unsigned pixels = 1; takes_planes() && pixels <= 40; pixels++)
        filter5_case(pixels, 1);
}

/* n floats in a guarded place: from 0 to `high`; the pattern may make all the same. */
static float *make_floats(unsigned place, size_t n, float low, float high, int at_end)
{
    float *v = guard_place(place, n * sizeof *v, at_end);
    for (size_t i = 0; i < n; i++)
        v[i] = now.pattern == CASES_MIN   ? low
               : now.pattern == CASES_MAX ? high
               : now.pattern == CASES_PAIRS && i % 3 == 0
                   ? low
                   : low + (high - low) * (float)guard_below(1u << 20) / 1048576.0f;
    return v;
}

/* The scalar port is the definition (docs/kernel-prediction.md; tests/golden has its values). */
static void same_bytes(const void *out, size_t bytes, const char *what, unsigned pixels)
{
    now.cases++;
    if (!CHECK(memcmp(out, expected, bytes) == 0))
        printf("  %s with %u pixels\n", what, pixels);
}

/* Some of n floats become what images may hold. */
static void spoil(float *v, size_t n)
{
    static const uint32_t odd[] = {0x7fc00000, 0xffc00000, 0x7f800000, 0xff800000,
                                   0x80000000, 0x00000001, 0x007fffff, 0x00800000,
                                   0x00800001, 0x80800001, 0x7f7fffff, 0xc0000000};
    for (size_t i = 0; now.pattern == CASES_RANDOM && i < n; i++)
        if (guard_below(8) == 0)
            memcpy(&v[i], &odd[guard_below(sizeof odd / sizeof odd[0])], sizeof *v);
}

static float sane_value(float v, float scale, float lo, float hi)
{
    volatile float r = fabsf(v) >= 0x1p-126f ? v : 0.0f;
    r = r * scale;
    r = fabsf(r) > 0x1p-126f ? r : 0.0f;
    return r > lo ? (r < hi ? r : hi) : lo;
}

/* Albedo as images may hold it, some pixels without any. */
static float *make_albedo(unsigned place, unsigned pixels, int at_end)
{
    static const float none[] = {0.0f, -0.0f, -1.0f, 0x1p-126f, NAN};
    float *albedo = make_floats(place, 3 * (size_t)pixels, 0.0f, 1.0f, at_end);
    spoil(albedo, 3 * (size_t)pixels);
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0, hit = guard_below(4) == 0; c < 3 && hit; c++)
            albedo[3 * i + c] = none[guard_below(sizeof none / sizeof none[0])];
    return albedo;
}

/* What channel c of a pixel's albedo counts as. */
static float albedo_value(const float *pixel, size_t c)
{
    for (size_t i = 0; i < 3; i++)
        if (sane_value(pixel[i], 1.0f, 0.0f, 16.0f) > 0.0f)
            return sane_value(pixel[c], 1.0f, 0.0f, 16.0f);
    return 1.0f;
}

static void encode_case(unsigned pixels, int has_albedo, int has_normal)
{
    int at_end = guard_below(2) != 0;
    float most = guard_below(2) ? 128.0f : 70000.0f;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, most, at_end);
    float *albedo = make_albedo(GUARD_ROW + 1, pixels, at_end);
    float *normal = make_floats(GUARD_ROW + 2, 3 * pixels, -1.0f, 1.0f, at_end);
    uint8_t *out = guard_place(GUARD_OUT, LULL_CODES * (size_t)pixels, at_end);
    lull_encoding from = {radiance, albedo, normal, 1.0f, 65504.0f, 0x5aff00};
    spoil(radiance, 3 * (size_t)pixels);
    spoil(normal, 3 * (size_t)pixels);
    from.scale = guard_below(2) ? 0.25f : 7.5f;
    from.most = guard_below(2) ? 1.0f : 65504.0f;
    from.albedo = has_albedo ? albedo : NULL;
    from.normal = has_normal ? normal : NULL;
    now.scalar.encode(out, &from, pixels);
    for (size_t i = 0; i < pixels; i++) /* what needs no logarithm */
        for (size_t c = 0; c < 3; c++) {
            float n = from.normal ? normal[3 * i + c] : 0.0f;
            float a = from.albedo ? albedo_value(albedo + 3 * i, c) : 0.0f;
            n = n > -1.0f ? n : n <= -1.0f ? -1.0f : 0.0f;
            n = (n < 1.0f ? n : 1.0f) * 127.5f + 128.0f;
            CHECK(out[LULL_CODES * i + 3 + c] == (int)((a < 1.0f ? a : 1.0f) * 255.0f + 0.5f));
            CHECK(abs(out[LULL_CODES * i + 6 + c] - (n < 255.0f ? (int)n : 255)) <= 1);
            CHECK(out[LULL_CODES * i + 9 + c] == (c == 0 ? 0 : c == 1 ? 0xff : 0x5a));
        }
    memcpy(expected, out, LULL_CODES * (size_t)pixels);
    memset(out, 1, LULL_CODES * (size_t)pixels);
    now.port->encode(out, &from, pixels);
    same_bytes(out, LULL_CODES * (size_t)pixels, "encode", pixels);
}

/* Of the codes that `encode` makes. */
static void guide_case(unsigned pixels, int has_albedo, int has_normal)
{
    int at_end = guard_below(2) != 0;
    float *albedo = make_albedo(GUARD_ROW, pixels, at_end), radiance[3 * 70] = {0};
    float *normal = make_floats(GUARD_ROW + 1, 3 * pixels, -1.0f, 1.0f, at_end);
    uint8_t *out = guard_place(GUARD_OUT, 2 * (size_t)pixels, at_end), codes[LULL_CODES * 70];
    lull_encoding from = {radiance, has_albedo ? albedo : NULL, has_normal ? normal : NULL, 1.0f,
                          65504.0f, 0};
    spoil(normal, 3 * (size_t)pixels);
    now.scalar.encode(codes, &from, pixels);
    for (size_t i = 0; i < pixels; i++) {
        const uint8_t *a = codes + LULL_CODES * i + 3, *n = a + 3;
        expected[2 * i] = (uint8_t)(has_normal ? (2 * n[0] - n[1] - n[2] + 510) / 8 : a[0] / 2);
        expected[2 * i + 1] =
            (uint8_t)(has_normal ? 7 * (n[1] - n[2] + 255) / 32 : (a[1] + a[2]) / 4);
    }
    memset(out, 1, 2 * (size_t)pixels);
    now.port->guide(out, from.albedo, from.normal, pixels);
    same_bytes(out, 2 * (size_t)pixels, "guide", pixels);
    for (size_t i = 0; i < 2 * (size_t)pixels; i++)
        CHECK(out[i] <= 127);
}

static void guide_cases(void)
{
    for (unsigned pixels = 1; pixels <= 70; pixels++)
        guide_case(pixels, pixels % 3 != 0, pixels & 1);
}

static void encode_cases(void)
{
    for (unsigned pixels = 1; pixels <= 70; pixels++)
        encode_case(pixels, pixels % 3 != 0, pixels & 1);
}

/* Places `planes` planes of n floats for a kernel's result; the gaps are checked, too. */
static float *place_planes(unsigned planes, unsigned n, size_t *plane, size_t *bytes, int at_end)
{
    float *out;
    *plane = n + GAP;
    *bytes = ((planes - 1) * *plane + n) * sizeof *out;
    out = guard_place(GUARD_OUT, *bytes, at_end);
    memset(out, 1, *bytes);
    memcpy(expected, out, *bytes);
    return out;
}

static void expect(size_t at, float v) { ((float *)(void *)expected)[at] = v; }

static void spread_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes;
    float *albedo = make_albedo(GUARD_ROW, pixels, at_end);
    float *out = place_planes(4, pixels, &plane, &bytes, at_end);
    for (size_t i = 0; i < pixels; i++) /* the definition */
        for (size_t c = 0; c < 4; c++)
            expect(c * plane + i, c ? albedo_value(albedo + 3 * i, c - 1) : 1.0f);
    now.port->spread(out, plane, albedo, pixels);
    same_bytes(out, bytes, "spread", pixels);
}

static void spread_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        spread_case(pixels);
}

static void spread_xyz_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes;
    float *normal = make_floats(GUARD_ROW, 3 * pixels, -1.1f, 1.1f, at_end);
    float *out = place_planes(4, pixels, &plane, &bytes, at_end);
    spoil(normal, 3 * (size_t)pixels);
    for (size_t i = 0; i < pixels; i++) /* the definition */
        for (size_t c = 0; c < 4; c++)
            expect(c * plane + i,
                   c ? sane_value(normal[3 * i + c - 1], 1.0f, -1.0f, 1.0f) : 1.0f);
    now.port->spread_xyz(out, plane, normal, pixels);
    same_bytes(out, bytes, "spread_xyz", pixels);
}

static void spread_xyz_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        spread_xyz_case(pixels);
}

static void modulate_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, smooth_plane = pixels + 1, bytes = LULL_CODES * (size_t)pixels;
    float *v = make_floats(GUARD_ROW, 2 * plane + pixels, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 1, 2 * smooth_plane + pixels, 0.02f, 1.02f, at_end);
    float *out = guard_place(GUARD_OUT, bytes, at_end);
    spoil(v, 2 * plane + pixels);
    for (size_t i = 0; i < 3 * (size_t)pixels; i++) { /* the definition */
        volatile float r = v[i % 3 * plane + i / 3] * smooth[i % 3 * smooth_plane + i / 3];
        r = sane_value(r, 1.0f, 0.0f, 3.402823466e38f);
        expect(i, r * 1.7f);
    }
    memset(out, 1, bytes);
    now.port->modulate(out, v, plane, smooth, smooth_plane, 1.7f, pixels);
    same_bytes(out, bytes, "modulate", pixels);
}

static void modulate_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        modulate_case(pixels);
}

static void curve_case(unsigned n, int is_out)
{
    static const float highs[] = {1.0f, 3.402823466e38f};
    int at_end = guard_below(2) != 0;
    float *v = guard_place(GUARD_OUT, n * sizeof *v, at_end), *from;
    lull_curve curve;
    curve.transfer = guard_below(4);
    curve.scale = guard_below(2) ? 0.25f : 7.5f;
    curve.is_signed = guard_below(4) == 0;
    curve.low = curve.is_signed ? -1.0f : 0.0f;
    curve.high = highs[guard_below(2)];
    from = make_floats(GUARD_ROW, n, is_out ? 0.0f : -0.1f, is_out ? 1.1f : 200.0f, at_end);
    spoil(from, n);
    memcpy(expected, from, n * sizeof *v);
    memcpy(v, from, n * sizeof *v);
    if (is_out) {
        now.scalar.curve_out((float *)(void *)expected, &curve, n);
        now.port->curve_out(v, &curve, n);
    } else {
        now.scalar.curve_in((float *)(void *)expected, &curve, n);
        now.port->curve_in(v, &curve, n);
    }
    for (unsigned i = 0; curve.transfer == 0 && i < n; i++) { /* the definition, without a curve */
        volatile float x = is_out
                               ? sane_value(from[i], 1.0f, 0.0f, 3.402823466e38f)
                               : sane_value(from[i], curve.scale, curve.low, curve.high);
        if (curve.is_signed)
            x = is_out ? x * 2.0f - 1.0f : x * 0.5f + 0.5f;
        x = is_out && x < curve.low ? curve.low : x;
        x = (is_out && x > curve.high ? curve.high : x) * (is_out ? curve.scale : 1.0f);
        CHECK(v[i] == x);
    }
    same_bytes(v, n * sizeof *v, is_out ? "curve_out" : "curve_in", n);
}

static void curve_in_cases(void)
{
    for (unsigned n = 1; n <= 100; n++)
        curve_case(n, 0);
}

static void curve_out_cases(void)
{
    for (unsigned n = 1; n <= 100; n++)
        curve_case(n, 1);
}

/* 1 / v(k), v(i) = v[i * plane], as shares have it (kernels.h): no product is contracted. */
static float share_of(const float *v, size_t plane, size_t k)
{
    volatile float all = v[0] * v[plane], share, others = v[k == 0 ? plane : 0];
    all = all * v[2 * plane];
    share = 1.0f / all;
    others = others * v[k == 2 ? plane : 2 * plane];
    return others * share;
}

static void demodulate_case(unsigned pixels, size_t code_step)
{
    int at_end = guard_below(2) != 0;
    size_t before_it = code_step > 1 ? LULL_HEAD_CONFIDENCE : 0;
    size_t codes_bytes = (pixels - 1) * code_step + before_it + 1;
    size_t smooth_plane = pixels + 3, plane, bytes;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 70000.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 1, 2 * smooth_plane + pixels, 0.02f, 1.02f, at_end);
    float *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, codes_bytes, at_end);
    float *out = place_planes(4, pixels, &plane, &bytes, at_end);
    lull_encoding from = {radiance, NULL, NULL, 1.0f, 65504.0f, 0};
    from.scale = guard_below(2) ? 0.25f : 7.5f;
    from.most = guard_below(2) ? 1.0f : 65504.0f;
    spoil(radiance, 3 * (size_t)pixels);
    make_table(table);
    for (size_t i = 0; i < codes_bytes; i++)
        codes[i] = (uint8_t)guard_below(256);
    for (size_t i = 0; i < pixels; i++) { /* the definition */
        volatile float c = table[codes[code_step * i + before_it]];
        expect(i, c);
        for (size_t k = 0; k < 3; k++) {
            volatile float r = sane_value(radiance[3 * i + k], from.scale, 0.0f, from.most);
            r = r * share_of(smooth + i, smooth_plane, k);
            expect((1 + k) * plane + i, c * r);
        }
    }
    now.port->demodulate(out, plane, &from, smooth, smooth_plane, codes + before_it, code_step,
                         table, pixels);
    same_bytes(out, bytes, "demodulate", pixels);
}

static void demodulate_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        demodulate_case(pixels, 27);
    for (unsigned pixels = 1; takes_planes() && pixels <= 40; pixels++)
        demodulate_case(pixels, 1);
}

static void shrink_case(unsigned pixels, size_t code_step)
{
    int at_end = guard_below(2) != 0;
    size_t before_it = code_step > 1 ? LULL_HEAD_CONFIDENCE : 0;
    size_t codes_bytes = (pixels - 1) * code_step + before_it + 1;
    size_t fine = 2 * pixels + 3, plane, bytes;
    float *rows[2], *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, codes_bytes, at_end);
    float *out = place_planes(4, pixels, &plane, &bytes, at_end);
    for (unsigned r = 0; r < 2; r++) {
        rows[r] = make_floats(GUARD_ROW + r, 3 * fine + 2 * pixels, 0.0f, 99.0f, at_end);
        for (size_t i = 0; i < 2 * pixels; i++) /* weights of whole pixels are 0 */
            if (i / 2 % 3 == 0)
                rows[r][i] = 0.0f;
    }
    make_table(table);
    for (size_t i = 0; i < codes_bytes; i++)
        codes[i] = (uint8_t)guard_below(256);
    for (size_t i = 0; i < pixels; i++) /* the definition */
        for (size_t k = 0; k < 4; k++) {
            volatile float confidence = table[codes[code_step * i + before_it]];
            volatile float weight = rows[0][2 * i], sum = rows[0][k * fine + 2 * i];
            volatile float share;
            weight = weight + rows[0][2 * i + 1];
            weight = weight + rows[1][2 * i];
            weight = weight + rows[1][2 * i + 1];
            sum = sum + rows[0][k * fine + 2 * i + 1];
            sum = sum + rows[1][k * fine + 2 * i];
            sum = sum + rows[1][k * fine + 2 * i + 1];
            share = 1.0f / weight;
            sum = sum * share;
            expect(k * plane + i, !(weight > 0.0f) ? 0.0f : k ? confidence * sum : confidence);
        }
    now.port->shrink(out, plane, rows[0], rows[1], fine, codes + before_it, code_step, table,
                     pixels);
    same_bytes(out, bytes, "shrink", pixels);
}

static void shrink_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        shrink_case(pixels, 27);
    for (unsigned pixels = 1; takes_planes() && pixels <= 40; pixels++)
        shrink_case(pixels, 1);
}

static void blend_case(unsigned pairs)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes, fine_plane = 2 * pairs + 1, coarse_plane = pairs + 2 + GAP;
    float *fine = make_floats(GUARD_ROW, 2 * fine_plane + 2 * pairs, 0.0f, 1.0f, at_end);
    float *row[2], *out = place_planes(3, 2 * pairs, &plane, &bytes, at_end);
    float *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, 2 * (size_t)pairs, at_end);
    lull_blending b = {0};
    for (unsigned i = 0; i < 256; i++)
        table[i] = (float)guard_below(1u << 20) / 1048576.0f;
    for (unsigned i = 0; i < 2 * pairs; i++)
        codes[i] = (uint8_t)guard_below(256);
    for (unsigned r = 0; r < 2; r++)
        row[r] =
            1 + make_floats(GUARD_ROW + 1 + r, 2 * coarse_plane + pairs + 2, 0.0f, 99.0f, at_end);
    for (size_t i = 0; i < 2 * (size_t)pairs; i++) /* the definition */
        for (size_t c = 0; c < 3; c++) {
            ptrdiff_t at = (ptrdiff_t)(c * coarse_plane + i / 2), beside = at + (i & 1 ? 1 : -1);
            volatile float f = fine[c * fine_plane + i];
            volatile float x = 0.75f * row[0][at], y = 0.25f * row[1][at];
            volatile float here = x + y, there, v;
            x = 0.75f * row[0][beside];
            y = 0.25f * row[1][beside];
            there = x + y;
            x = 0.75f * here;
            y = 0.25f * there;
            v = x + y;
            v = v - f;
            v = table[codes[i]] * v;
            expect(c * plane + i, f + v);
        }
    b.out = out, b.out_plane = plane;
    b.fine = fine, b.fine_plane = fine_plane;
    b.near = row[0], b.far = row[1], b.coarse_plane = coarse_plane;
    b.codes = codes, b.table = table, b.pairs = pairs;
    now.port->blend(&b);
    same_bytes(out, bytes, "blend", 2 * pairs);
}

static void blend_cases(void)
{
    for (unsigned pairs = 1; pairs <= 40; pairs++)
        blend_case(pairs);
}

static void luminance_case(unsigned n)
{
    int at_end = guard_below(2) != 0;
    float *pixels = make_floats(GUARD_ROW, 3 * n, 0.0f, 99.0f, at_end);
    float *sums = make_floats(GUARD_OUT, n, 0.0f, 999.0f, at_end);
    spoil(pixels, 3 * (size_t)n);
    for (size_t i = 0; i < n; i++) { /* the definition */
        volatile float v[3];
        for (size_t c = 0; c < 3; c++)
            v[c] = sane_value(pixels[3 * i + c], 1.0f, 0.0f, 3.402823466e38f);
        v[0] = 0.212671f * v[0];
        v[1] = 0.715160f * v[1];
        v[2] = 0.072169f * v[2];
        v[0] = v[0] + v[1];
        v[0] = v[0] + v[2];
        expect(i, sums[i] + v[0]);
    }
    now.port->luminance(sums, pixels, n);
    same_bytes(sums, n * sizeof *sums, "luminance", n);
}

static void luminance_cases(void)
{
    for (unsigned n = 1; n <= 40; n++)
        luminance_case(n);
}

#endif
