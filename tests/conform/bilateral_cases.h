/* Part of conform.c: the slots of the filter's last steps. The scalar port is the definition
 * (docs/kernel-prediction.md; tests/golden has its values). */
#ifndef LULL_TESTS_BILATERAL_CASES_H
#define LULL_TESTS_BILATERAL_CASES_H

static void noise_case(unsigned pixels)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, f_plane = plane + 3;
    float *v = make_floats(GUARD_ROW, 3 * plane + pixels, 0.0f, 70000.0f, at_end);
    float *f = make_floats(GUARD_ROW + 1, 2 * f_plane + pixels, 0.0f, 99.0f, at_end);
    uint8_t *noise = guard_place(GUARD_OUT, pixels, at_end);
    for (size_t i = 0; i < pixels; i++) { /* some have next to no noise, or no confidence */
        v[i] = guard_below(8) ? 1e-5f * v[i] : 0.0f;
        for (size_t c = 0; c < 3 && i % 2; c++)
            v[(1 + c) * plane + i] = v[i] * f[c * f_plane + i] * (1.0f + 1e-3f * (float)(i % 99));
    }
    memset(noise, 7, pixels);
    now.scalar.noise(noise, v, plane, f, f_plane, pixels);
    memcpy(expected, noise, pixels);
    for (size_t i = 1; i < pixels; i += 2) /* differences relative to what is there */
        CHECK(v[i] <= 0.0f || f[i] + f[f_plane + i] + f[2 * f_plane + i] < 9.0f ||
              abs(noise[i] - (int)(0.384f * (float)(i % 99) + 0.5f)) <= 1);
    memset(noise, 7, pixels);
    now.port->noise(noise, v, plane, f, f_plane, pixels);
    same_bytes(noise, pixels, "noise", pixels);
}

static void noise_cases(void)
{
    for (unsigned pixels = 1; pixels <= 70; pixels++)
        noise_case(pixels);
}

/* Surfaces that a smoothing reads, values and guides; places for them are the first there are. */
enum { SURFACES = 9 };
typedef char surfaces_have_room[2 * SURFACES <= GUARD_ROOM ? 1 : -1];

/* Row r (0: the row itself) of a surface, with `side` pixels on both sides. `even`: how much values
 * differ. */
static void make_surface(lull_surface *to, unsigned r, unsigned pixels, unsigned side, float even,
                         int at_end)
{
    unsigned n = pixels + 2 * side;
    size_t plane = n + GAP;
    uint8_t *guide = guard_place(SURFACES + r, 2 * (size_t)n, at_end);
    to->v = side + make_floats(GUARD_ROW + r, 2 * plane + n, 1.0f - even, 1.0f, at_end);
    for (size_t i = 0; i < 2 * (size_t)n; i++) /* sometimes the largest differences there can be */
        guide[i] = (uint8_t)(guard_below(2 * n) ? 59 + guard_below(1 + (unsigned)(40 * even))
                                                : 127 * guard_below(2));
    to->plane = plane;
    to->guide = guide + 2 * side;
}

static void bilateral_case(unsigned pixels, float even)
{
    int at_end = guard_below(2) != 0;
    size_t plane, bytes;
    float *out = place_planes(3, pixels, &plane, &bytes, at_end);
    uint8_t *noise = guard_place(GUARD_ROOM, pixels + 2, at_end);
    lull_smoothing s = {out, noise + 1, plane, {0}, {{0}}, 0, pixels};
    s.is_far = guard_below(2) != 0;
    for (unsigned i = 0; i < pixels + 2; i++)
        noise[i] = (uint8_t)guard_below(guard_below(2) ? 8 : 256);
    make_surface(&s.row, 0, pixels, (unsigned)lull_bilateral_reach(s.is_far), even, at_end);
    for (unsigned r = 0; r < lull_bilateral_rows(s.is_far); r++)
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

static void edges_case(unsigned pixels, float even)
{
    const float none[] = {NAN, -1.0f, 1e-39f};
    int at_end = guard_below(2) != 0;
    size_t bytes = LULL_CODES * (size_t)pixels;
    size_t v_plane = pixels + 2 + GAP, smooth_plane = pixels + 3;
    float *out = guard_place(GUARD_OUT, bytes, at_end);
    lull_edging e = {out, {NULL}, {NULL}, v_plane, smooth_plane, 0.0f, 0.7f, pixels};
    e.strength = guard_below(4) ? LULL_EDGE_SHARE * 0.01f * (float)guard_below(101) : 0.0f;
    for (unsigned r = 0; r < 3; r++) {
        float *v = make_floats(GUARD_ROW + r, 2 * v_plane + pixels + 2, 1.0f - even, 1.0f, at_end);
        for (size_t i = 0; i < 2 * v_plane + pixels + 2; i++) /* no colours: as black */
            if (guard_below(32) == 0)
                v[i] = none[guard_below(3)];
        e.v[r] = v + 1;
        e.smooth[r] = 1 + make_floats(GUARD_ROW + 3 + r, 2 * smooth_plane + pixels + 2,
                                      guard_below(2) ? 0.02f : 1.0f, 1.02f, at_end);
    }
    now.scalar.edges(&e);
    memcpy(expected, out, bytes);
    for (size_t i = 0; i < 3 * (size_t)pixels; i++) {
        CHECK(out[i] >= 0.0f && out[i] < 0.72f);
        out[i] = -1.0f;
    }
    now.port->edges(&e);
    same_bytes(out, bytes, "edges", pixels);
}

static void edges_cases(void)
{
    for (unsigned pixels = 1; pixels <= 40; pixels++) {
        edges_case(pixels, 0.05f);
        edges_case(pixels, 1.0f);
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
