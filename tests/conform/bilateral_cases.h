/* Part of conform.c: the slots of the filter's last steps. The scalar port is the definition
 * (docs/kernel-prediction.md; tests/golden has its values). */
#ifndef LULL_TESTS_BILATERAL_CASES_H
#define LULL_TESTS_BILATERAL_CASES_H

static void noise_case(unsigned pixels, int has_normal)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, floats = 2 * plane + pixels, pair_bytes = 6 * plane - 2 * GAP;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 70000.0f, at_end);
    float *normal = make_floats(GUARD_ROW + 1, 3 * pixels, -1.0f, 1.0f, at_end);
    float *v = make_floats(GUARD_ROW + 2, floats, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 3, floats, 0.02f, 1.02f, at_end);
    uint8_t *noise = guard_place(GUARD_OUT, pixels, at_end);
    uint8_t *pairs = guard_place(GUARD_BIAS, pair_bytes, at_end);
    lull_encoding from = {radiance, NULL, has_normal ? normal : NULL, 1.0f, 65504.0f, 0};
    lull_surface at = {v, pairs, plane, 2 * plane};
    spoil(radiance, 3 * (size_t)pixels);
    spoil(normal, 3 * (size_t)pixels);
    from.scale = guard_below(2) ? 0.0002f : 7.5f;
    for (size_t i = 0; i < 3 * (size_t)pixels; i++) /* some have next to no noise */
        if (guard_below(2))
            radiance[i] = v[i % 3 * plane + i / 3] * smooth[i % 3 * plane + i / 3] / from.scale;
    memset(noise, 7, pixels);
    memset(pairs, 7, pair_bytes);
    now.scalar.noise(noise, &at, &from, smooth, plane, pixels);
    memcpy(expected, noise, pixels);
    memcpy(expected + pixels, pairs, pair_bytes);
    for (size_t i = 0; !has_normal && i < pixels; i++)
        CHECK(pairs[2 * plane + 2 * i + 1] == 128 && pairs[4 * plane + 2 * i] == 128);
    memset(noise, 7, pixels);
    memset(pairs, 7, pair_bytes);
    now.port->noise(noise, &at, &from, smooth, plane, pixels);
    same_bytes(noise, pixels, "noise", pixels);
    memmove(expected, expected + pixels, pair_bytes);
    same_bytes(pairs, pair_bytes, "noise: pairs", pixels);
}

static void noise_cases(void)
{
    for (unsigned pixels = 1; pixels <= 70; pixels++)
        noise_case(pixels, pixels & 1);
}

/* Row r (0: the row itself) of a surface, with `side` pixels on both sides. `even`: how much values
 * differ. */
static void make_surface(lull_surface *to, unsigned r, unsigned pixels, unsigned side, float even,
                         int at_end)
{
    static const unsigned code_places[] = {GUARD_ROW + 5, GUARD_WEIGHTS + 5, GUARD_BIAS,
                                           GUARD_MULTIPLIER, GUARD_START};
    unsigned n = pixels + 2 * side;
    size_t plane = n + GAP, bytes = 6 * plane - 2 * GAP;
    uint8_t *pairs = guard_place(code_places[r], bytes, at_end);
    to->v = side + make_floats(GUARD_ROW + r, 2 * plane + n, 1.0f - even, 1.0f, at_end);
    to->v_plane = plane;
    to->pair_plane = 2 * plane;
    for (size_t i = 0; i < bytes; i++) /* of some pixels the largest differences there can be */
        pairs[i] = (uint8_t)(guard_below(2 * (unsigned)bytes) ? 99 + guard_below(1 + (unsigned)(
                                                                    80 * even))
                                                              : 255 * guard_below(2));
    to->pairs = pairs + 2 * side;
}

static void bilateral_case(unsigned pixels, float even)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes;
    float *out = place_planes(3, pixels, &plane, &bytes, at_end);
    uint8_t *noise = guard_place(GUARD_WEIGHTS, pixels + 2, at_end);
    lull_smoothing s = {out, noise + 1, plane, {0}, {{0}}, pixels};
    for (unsigned i = 0; i < pixels + 2; i++)
        noise[i] = (uint8_t)guard_below(guard_below(2) ? 8 : 256);
    make_surface(&s.row, 0, pixels, LULL_BILATERAL_REACH, even, at_end);
    for (unsigned r = 0; r < 4; r++)
        make_surface(&s.beside[r], 1 + r, pixels, 0, even, at_end);
    if (guard_below(2)) /* as at the upper edge of an image */
        s.beside[0] = s.row;
    now.scalar.bilateral(&s);
    memcpy(expected, out, bytes);
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) {
            CHECK(out[c * plane + i] > 0.999f - even && out[c * plane + i] < 1.001f);
            out[c * plane + i] = 0.0f;
        }
    now.port->bilateral(&s);
    same_bytes(out, bytes, "bilateral", pixels);
}

static void bilateral_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++) {
        bilateral_case(pixels, 0.05f);
        bilateral_case(pixels, 1.0f);
    }
}

static void residual_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, floats = 2 * plane + pixels, sum_plane, bytes;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 700.0f, at_end);
    float *v = make_floats(GUARD_ROW + 1, floats, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 2, floats, 0.02f, 1.02f, at_end);
    uint8_t *noise = guard_place(GUARD_WEIGHTS, pixels, at_end);
    float *sums = place_planes(LULL_CELL_SUMS, pixels, &sum_plane, &bytes, at_end);
    lull_encoding from = {radiance, NULL, NULL, 3.5f, 65504.0f, 0};
    lull_balance b = {sums, v, smooth, noise, sum_plane, plane, plane, pixels};
    spoil(radiance, 3 * (size_t)pixels);
    for (unsigned i = 0; i < pixels; i++)
        noise[i] = (uint8_t)guard_below(guard_below(2) ? 24 : 256);
    for (unsigned run = 0; run < 2; run++) {
        for (size_t i = 0; i < bytes / sizeof *sums; i++)
            sums[i] = (float)i;
        if (run)
            now.port->residual(&b, &from);
        else
            now.scalar.residual(&b, &from);
        if (!run)
            memcpy(expected, sums, bytes);
    }
    same_bytes(sums, bytes, "residual", pixels);
    for (size_t i = 0; i < pixels; i++)
        CHECK(sums[i] - (float)i <= LULL_MOST_LACKING * 1.001f);
}

static void residual_cases(void)
{
    for (unsigned pixels = 1; pixels <= 64; pixels++)
        residual_case(pixels);
}

#endif
