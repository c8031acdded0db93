/* Part of conform.c: the slots of family K's filter. */
#ifndef LULL_TESTS_FILTER_CASES_H
#define LULL_TESTS_FILTER_CASES_H

/* Products of two tables of 16 whose last values are 1. */
static void make_table(float *table)
{
    float half[32];
    for (unsigned i = 0; i < 32; i++)
        half[i] = i % 16 == 15                ? 1.0f
                  : now.pattern == CASES_MIN  ? 0.0f
                  : now.pattern == CASES_MAX ? 1.0f
                                              : (float)guard_below(1u << 20) / 1048576.0f;
    for (unsigned q = 0; q < 256; q++)
        table[q] = half[q / 16] * half[16 + q % 16];
}

static void filter5_case(unsigned pixels, unsigned code_step)
{
    int at_end = guard_below(2) != 0;
    size_t row_floats = 4 * ((size_t)pixels + 4);
    float *out = guard_place(GUARD_OUT, (size_t)pixels * 16, at_end);
    float *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, (size_t)(pixels - 1) * code_step + 25, at_end);
    const float *rows[5];
    make_table(table);
    for (size_t i = 0; i < (size_t)(pixels - 1) * code_step + 25; i++)
        codes[i] = now.pattern == CASES_ALTERNATING ? (uint8_t)(i & 1 ? 255 : 0)
                                                    : (uint8_t)guard_below(256);
    for (unsigned r = 0; r < 5; r++) {
        float *row = guard_place(GUARD_ROW + r, row_floats * sizeof *row, at_end);
        for (size_t i = 0; i < row_floats; i++)
            row[i] = now.pattern == CASES_MAX ? 65504.0f : (float)guard_below(1u << 24) * 0.001f;
        rows[r] = row + 8;
    }
    for (unsigned p = 0; p < pixels; p++) { /* the definition */
        volatile float sum[4] = {0, 0, 0, 0}, product;
        float mean[4];
        for (unsigned c = 0; c < 4; c++)
            for (unsigned k = 0; k < 25; k++) {
                product = table[codes[p * code_step + k]] *
                          rows[k / 5][4 * ((ptrdiff_t)p + (int)(k % 5) - 2) + (int)c];
                sum[c] = sum[c] + product;
            }
        for (unsigned c = 0; c < 3; c++)
            mean[c] = sum[0] > 0.0f ? sum[c + 1] / sum[0] : 0.0f;
        mean[3] = sum[0];
        memcpy(expected + 16 * (size_t)p, mean, sizeof mean);
    }
    now.port->filter5(out, rows, codes, code_step, table, pixels);
    now.cases++;
    if (!CHECK(memcmp(out, expected, (size_t)pixels * 16) == 0))
        printf("  with %u pixels, code step %u\n", pixels, code_step);
}

static void filter5_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        filter5_case(pixels, pixels & 1 ? 27 : 52);
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

static void encode_case(unsigned pixels, int has_albedo, int has_normal)
{
    int at_end = guard_below(2) != 0;
    float most = guard_below(2) ? 128.0f : 70000.0f;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, most, at_end);
    float *albedo = make_floats(GUARD_ROW + 1, 3 * pixels, 0.0f, 1.0f, at_end);
    float *normal = make_floats(GUARD_ROW + 2, 3 * pixels, -1.0f, 1.0f, at_end);
    uint8_t *out = guard_place(GUARD_OUT, 12 * (size_t)pixels, at_end);
    lull_encoding from = {radiance, albedo, normal, 1.0f, 65504.0f, 0x5aff00};
    spoil(radiance, 3 * (size_t)pixels);
    spoil(albedo, 3 * (size_t)pixels);
    spoil(normal, 3 * (size_t)pixels);
    from.scale = guard_below(2) ? 0.25f : 7.5f;
    from.most = guard_below(2) ? 1.0f : 65504.0f;
    from.albedo = has_albedo ? albedo : NULL;
    from.normal = has_normal ? normal : NULL;
    now.scalar.encode(out, &from, pixels);
    for (size_t i = 0; i < pixels; i++) /* what needs no logarithm */
        for (size_t c = 0; c < 3; c++) {
            float n = from.normal ? normal[3 * i + c] : 0.0f;
            float a = from.albedo ? albedo[3 * i + c] : 0.0f;
            n = n > -1.0f ? n : n <= -1.0f ? -1.0f : 0.0f;
            n = (n < 1.0f ? n : 1.0f) * 127.5f + 128.0f;
            a = a > 0.0f ? (a < 1.0f ? a : 1.0f) * 255.0f + 0.5f : 0.0f;
            CHECK(out[12 * i + 3 + c] == (int)a);
            CHECK(abs(out[12 * i + 6 + c] - (n < 255.0f ? (int)n : 255)) <= 1);
            CHECK(out[12 * i + 9 + c] == (c == 0 ? 0 : c == 1 ? 0xff : 0x5a));
        }
    memcpy(expected, out, 12 * (size_t)pixels);
    memset(out, 1, 12 * (size_t)pixels);
    now.port->encode(out, &from, pixels);
    same_bytes(out, 12 * (size_t)pixels, "encode", pixels);
}

static void encode_cases(void)
{
    for (unsigned pixels = 1; pixels <= 70; pixels++)
        encode_case(pixels, pixels % 3 != 0, pixels & 1);
}

static float sane_value(float v, float scale, float lo, float hi)
{
    volatile float r = fabsf(v) >= 0x1p-126f ? v : 0.0f;
    r = r * scale;
    r = fabsf(r) > 0x1p-126f ? r : 0.0f;
    return r > lo ? (r < hi ? r : hi) : lo;
}

static void spread_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    float *albedo = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 1.0f, at_end);
    float *out = guard_place(GUARD_OUT, 16 * (size_t)pixels, at_end);
    spoil(albedo, 3 * (size_t)pixels);
    for (size_t i = 0; i < pixels; i++) /* the definition */
        for (size_t c = 0; c < 4; c++)
            ((float *)(void *)expected)[4 * i + c] =
                c ? sane_value(albedo[3 * i + c - 1], 1.0f, 0.0f, 1.0f) : 1.0f;
    memset(out, 1, 16 * (size_t)pixels);
    now.port->spread(out, albedo, pixels);
    same_bytes(out, 16 * (size_t)pixels, "spread", pixels);
}

static void spread_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        spread_case(pixels);
}

static void modulate_case(unsigned n)
{
    int at_end = guard_below(2) != 0;
    float *v = make_floats(GUARD_ROW, n, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 1, n, 0.02f, 1.02f, at_end);
    float *out = guard_place(GUARD_OUT, n * sizeof *out, at_end);
    spoil(v, n);
    for (size_t i = 0; i < n; i++) { /* the definition */
        volatile float r = v[i] * smooth[i];
        r = sane_value(r, 1.0f, 0.0f, 3.402823466e38f);
        ((float *)(void *)expected)[i] = r * 1.7f;
    }
    memset(out, 1, n * sizeof *out);
    now.port->modulate(out, v, smooth, 1.7f, n);
    same_bytes(out, n * sizeof *out, "modulate", n);
}

static void modulate_cases(void)
{
    for (unsigned n = 1; n <= 40; n++)
        modulate_case(n);
}

static void demodulate_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t codes_bytes = (size_t)(pixels - 1) * 27 + 1;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 70000.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 1, 3 * pixels, 0.02f, 1.02f, at_end);
    float *table = guard_place(GUARD_WEIGHTS, 256 * sizeof *table, at_end);
    uint8_t *codes = guard_place(GUARD_BIAS, codes_bytes, at_end);
    float *out = guard_place(GUARD_OUT, 16 * (size_t)pixels, at_end);
    lull_encoding from = {radiance, NULL, NULL, 1.0f, 65504.0f, 0};
    from.scale = guard_below(2) ? 0.25f : 7.5f;
    from.most = guard_below(2) ? 1.0f : 65504.0f;
    spoil(radiance, 3 * (size_t)pixels);
    make_table(table);
    for (size_t i = 0; i < codes_bytes; i++)
        codes[i] = (uint8_t)guard_below(256);
    for (size_t i = 0; i < pixels; i++) { /* the definition */
        volatile float c = table[codes[27 * i]], v[4];
        v[0] = c;
        for (size_t k = 0; k < 3; k++) {
            volatile float r = sane_value(radiance[3 * i + k], from.scale, 0.0f, from.most);
            r = r / smooth[3 * i + k];
            v[1 + k] = c * r;
        }
        for (size_t k = 0; k < 4; k++)
            ((float *)(void *)expected)[4 * i + k] = v[k];
    }
    memset(out, 1, 16 * (size_t)pixels);
    now.port->demodulate(out, &from, smooth, codes, 27, table, pixels);
    same_bytes(out, 16 * (size_t)pixels, "demodulate", pixels);
}

static void demodulate_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        demodulate_case(pixels);
}

static void blend_case(unsigned pairs, unsigned channels)
{
    int at_end = guard_below(2) != 0;
    size_t bytes = 2 * (size_t)pairs * channels * sizeof(float);
    float *filtered = make_floats(GUARD_ROW, 8 * (size_t)pairs, 0.0f, 1.0f, at_end);
    float *row[2], *out = guard_place(GUARD_OUT, bytes, at_end);
    for (unsigned r = 0; r < 2; r++)
        row[r] = 4 + make_floats(GUARD_ROW + 1 + r, 4 * ((size_t)pairs + 2), 0.0f, 99.0f, at_end);
    for (size_t i = 0; i < 2 * (size_t)pairs; i++) /* the definition */
        for (size_t c = 0; c < channels; c++) {
            ptrdiff_t at = 4 * (ptrdiff_t)(i / 2) + (int)c, beside = at + (i & 1 ? 4 : -4);
            volatile float f = filtered[4 * i + c], a = 0.75f * row[0][at], b = 0.25f * row[1][at];
            volatile float here = a + b, there, v;
            a = 0.75f * row[0][beside];
            b = 0.25f * row[1][beside];
            there = a + b;
            a = 0.75f * here;
            b = 0.25f * there;
            v = a + b;
            v = v - f;
            v = filtered[4 * i + 3] * v;
            v = f + v;
            ((float *)(void *)expected)[channels * i + c] = c == 3 ? 0.0f : v;
        }
    memset(out, 1, bytes);
    now.port->blend(out, channels, filtered, row[0], row[1], pairs);
    same_bytes(out, bytes, "blend", 2 * pairs);
}

static void blend_cases(void)
{
    for (unsigned pairs = 1; pairs <= 20; pairs++)
        blend_case(pairs, pairs & 1 ? 3 : 4);
}

#endif
