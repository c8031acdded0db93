/* Part of conform.c: the slots for grain of albedo and normals (kernels.h). */
#ifndef LULL_TESTS_GRAIN_CASES_H
#define LULL_TESTS_GRAIN_CASES_H

static int square(int a) { return a * a; }

/* L of a feature's codes; of those of the light, if feature is LULL_GRAINY. */
static int grain_value(const uint8_t *codes, unsigned feature)
{
    return feature == LULL_GRAINY ? codes[LULL_GRAIN_LIGHT_CODE]
                                  : lull_grain_light(codes + lull_grain_codes(feature));
}

/* Sums of a feature of a cell of w by h pixels, by their definition, pixel by pixel. */
static void sum_grain(int *sums, const uint8_t *const *rows, unsigned x, unsigned w, unsigned h,
                      unsigned feature)
{
    memset(sums, 0, LULL_GRAIN_SUMS * sizeof *sums);
    for (unsigned y = 0; y < h; y++)
        for (unsigned i = 0; i < w; i++) {
            const uint8_t *codes = rows[y] + LULL_CODES * (size_t)(x + i);
            int here = grain_value(codes, feature);
            sums[0]++;
            sums[1] += here;
            sums[2] += square(here);
            for (unsigned c = 0; c < 3 && feature < LULL_GRAINY; c++)
                sums[3 + c] += codes[lull_grain_codes(feature) + c];
            if (i + 1 < w)
                sums[6] += square(grain_value(codes + LULL_CODES, feature) - here);
            if (y + 1 < h) {
                const uint8_t *below = rows[y + 1] + LULL_CODES * (size_t)(x + i);
                sums[7] += square(grain_value(below, feature) - here);
                if (i + 1 < w)
                    sums[8] += square(grain_value(below + LULL_CODES, feature) - here);
                if (i > 0)
                    sums[9] += square(grain_value(below - LULL_CODES, feature) - here);
            }
        }
}

static void grain_sums_case(unsigned pixels, unsigned count)
{
    static float work[LULL_GRAIN_WORK / 4];
    int at_end = guard_below(2) != 0, sums[LULL_GRAIN_SUMS];
    const uint8_t *rows[LULL_GRAIN_SIDE];
    unsigned cells = lull_cell_count(LULL_GRAIN_SIDE, pixels);
    size_t plane, bytes;
    float *out = place_planes(LULL_GRAIN_ALL_SUMS, cells, &plane, &bytes, at_end);
    for (unsigned y = 0; y < count; y++) {
        uint8_t *row = guard_place(GUARD_ROW + y, LULL_CODES * (size_t)pixels, at_end);
        for (size_t i = 0; i < LULL_CODES * (size_t)pixels; i++)
            row[i] = (uint8_t)(now.pattern == CASES_MIN ? 0
                               : now.pattern == CASES_MAX ? (guard_below(2) ? 255 : 0)
                                                          : guard_below(256));
        rows[y] = row;
    }
    for (unsigned i = 0; i < cells; i++) {
        unsigned x = LULL_GRAIN_SIDE * i, w = lull_min_u(LULL_GRAIN_SIDE, pixels - x);
        for (unsigned f = 0; f <= LULL_GRAINY; f++) {
            sum_grain(sums, rows, x, w, count, f);
            for (size_t k = 0; k < LULL_GRAIN_SUMS && f < LULL_GRAINY; k++)
                expect((f * LULL_GRAIN_SUMS + k) * plane + i, (float)sums[k]);
        }
        expect(LULL_GRAIN_LIGHT * plane + i, (float)sums[6]); /* of the last, the light */
    }
    now.port->grain_sums(out, plane, rows, count, pixels, work);
    same_bytes(out, bytes, "grain_sums", pixels);
}

static void grain_sums_cases(void)
{
    for (unsigned pixels = 1; pixels <= 150; pixels += 1 + (pixels > 70))
        for (unsigned count = 1; count <= LULL_GRAIN_SIDE; count += guard_below(3) + 1)
            grain_sums_case(pixels, count);
}

static void take_grain_case(unsigned pixels, unsigned feature, int has_image)
{
    int at_end = guard_below(2) != 0;
    size_t plane = pixels + GAP, floats = 2 * plane + pixels, cell_plane, bytes;
    size_t cells = LULL_FIT_ROOM(pixels);
    float least = feature == LULL_GRAIN_NORMAL ? -1.0f : 0.0f;
    float *v = make_floats(GUARD_ROW, floats, least, 1.0f, at_end);
    float *image = guard_place(GUARD_OUT, 3 * pixels * sizeof *v, at_end);
    float *cell;
    cell_plane = cells + GAP;
    cell = make_floats(GUARD_ROW + 1, 3 * cell_plane + cells, 0.0f, 1.0f, at_end);
    bytes = floats * sizeof *v;
    memcpy(expected, v, bytes);
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) {
            size_t at = (i + 4) / LULL_GRAIN_SIDE, p = c * plane + i;
            float t = (float)(2 * ((i + 4) % LULL_GRAIN_SIDE) + 1) * 0.0625f, between[2];
            for (size_t k = 0; k < 2; k++) {
                const float *row = cell + (k ? 1 + c : 0) * cell_plane;
                between[k] = row[at] + t * (row[at + 1] - row[at]);
            }
            expect(p, lull_without_grain(v[p], between[0], between[1], feature));
        }
    memset(image, 1, 3 * pixels * sizeof *v);
    now.port->take_grain(v, plane, has_image ? image : NULL, cell, cell_plane, feature, pixels);
    same_bytes(v, bytes, "take_grain", pixels);
    for (size_t i = 0; i < 3 * pixels; i++)
        CHECK(lull_bits(image[i]) ==
              (has_image ? lull_bits(v[i % 3 * plane + i / 3]) : 0x01010101));
}

static void take_grain_cases(void)
{
    for (unsigned pixels = 1; pixels <= LULL_GRAIN_BLOCK; pixels++)
        for (unsigned feature = 0; feature < LULL_GRAINY; feature++)
            take_grain_case(pixels, feature, (int)guard_below(2));
}

#endif
