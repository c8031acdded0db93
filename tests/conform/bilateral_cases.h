/* Part of conform.c: the slots of the filter's last step. The scalar port is the definition
 * (docs/kernel-prediction.md; tests/golden has its values). */
#ifndef LULL_TESTS_BILATERAL_CASES_H
#define LULL_TESTS_BILATERAL_CASES_H

static void noise_case(unsigned pixels, int has_normal)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, bytes = 3 * plane + pixels, floats = 2 * plane + pixels;
    float *radiance = make_floats(GUARD_ROW, 3 * pixels, 0.0f, 70000.0f, at_end);
    float *normal = make_floats(GUARD_ROW + 1, 3 * pixels, -1.0f, 1.0f, at_end);
    float *v = make_floats(GUARD_ROW + 2, floats, 0.0f, 99.0f, at_end);
    float *smooth = make_floats(GUARD_ROW + 3, floats, 0.02f, 1.02f, at_end);
    uint8_t *out = guard_place(GUARD_OUT, bytes, at_end);
    lull_encoding from = {radiance, NULL, has_normal ? normal : NULL, 1.0f, 65504.0f, 0};
    lull_surface at = {v, smooth, NULL, plane, plane, plane};
    spoil(radiance, 3 * (size_t)pixels);
    spoil(normal, 3 * (size_t)pixels);
    from.scale = guard_below(2) ? 0.0002f : 7.5f;
    for (size_t i = 0; i < 3 * (size_t)pixels; i++) /* some have next to no noise */
        if (guard_below(2))
            radiance[i] = v[i % 3 * plane + i / 3] * smooth[i % 3 * plane + i / 3] / from.scale;
    memset(out, 7, bytes);
    now.scalar.noise(out, &from, &at, pixels);
    memcpy(expected, out, bytes);
    memset(out, 7, bytes);
    now.port->noise(out, &from, &at, pixels);
    same_bytes(out, bytes, "noise", pixels);
    for (size_t i = 0; !has_normal && i < pixels; i++)
        CHECK(out[i] == 7 && out[plane + i] == 7 && out[2 * plane + i] == 7);
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
    size_t plane = n + GAP;
    uint8_t *codes = guard_place(code_places[r], 3 * plane + n, at_end);
    float low = 1.0f - even;
    to->v = side + make_floats(GUARD_ROW + r, 2 * plane + n, low, 1.0f, at_end);
    to->smooth = side + make_floats(GUARD_WEIGHTS + r, 2 * plane + n, low + 0.02f, 1.02f, at_end);
    to->v_plane = to->smooth_plane = to->code_plane = plane;
    for (size_t i = 0; i < 3 * plane + n; i++)
        codes[i] = (uint8_t)(i < 3 * plane ? 128 + guard_below(1 + (unsigned)(99 * even))
                                           : guard_below(guard_below(2) ? 8 : 256));
    to->codes = codes + side;
}

static void bilateral_case(unsigned pixels, float even)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes;
    float *out = place_planes(3, pixels, &plane, &bytes, at_end);
    lull_smoothing s = {out, plane, {0}, {{0}}, pixels};
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

#endif
