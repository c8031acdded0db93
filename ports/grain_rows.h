/* Grain of albedo and normals (kernels.h, grain_sums and take_grain), LANES pixels at a time: sums
 * are integers below 2^24, exact in any order. After filter_rows.h and regression_rows.h, whose
 * operations it uses, and
 *
 *   add_int(a, b), and_int(a, b)    of int32
 */

enum {
    GRAIN_SIDE = LULL_GRAIN_SIDE,
    GRAIN_BLOCK = LULL_GRAIN_BLOCK,
    GRAIN_COLUMNS = 8 /* sums of columns at once: L, r, g, b of two features, or of one the rest */
};

typedef struct grain_work {
    /* Of rows of pixels: L of albedo and normal, and the light; 0 where there is none. */
    float value[GRAIN_SIDE][LULL_GRAINY + 1][GRAIN_BLOCK + LANES];
    float column[GRAIN_COLUMNS][GRAIN_BLOCK];
    float inside[GRAIN_BLOCK]; /* 1 where the next column is of the same cell, else 0 */
} grain_work;

typedef char grain_work_fits[sizeof(grain_work) <= LULL_GRAIN_WORK ? 1 : -1];

/* Bytes 0 and 2 of dwords, or 1 and 3 of those that are shifted right by 8. */
LULL_INLINE ivec grain_two(ivec dwords) { return and_int(dwords, set_int(0x00ff00ff)); }

/* The lowest byte of dwords. */
LULL_INLINE ivec grain_one(ivec dwords) { return and_int(dwords, set_int(255)); }

/* L of three codes. */
LULL_INLINE ivec grain_light(ivec r, ivec g, ivec b)
{
    return shift_right(add_int(add_int(r, b), shift_left(g, 1)), 2);
}

/* Two sums of 16 bits as columns. */
LULL_INLINE void grain_put_two(float *first, float *second, ivec sums)
{
    store_n(first, number(and_int(sums, set_int(0xffff))), LANES);
    store_n(second, number(shift_right(sums, 16)), LANES);
}

/* Values of n columns, at most LANES, of rows from pixel `from` on, as columns from p on; and sums
 * of L and codes. A pixel is three dwords. */
LULL_INLINE void grain_read(grain_work *work, const uint8_t *const *rows, unsigned count,
                            size_t from, unsigned p, unsigned n)
{
    ivec of_r = set_int(0), of_gx = of_r, of_by = of_r, of_z = of_r, of_l = of_r;
    for (unsigned y = 0; y < count; y++) {
        const uint8_t *codes = rows[y] + from * LULL_CODES;
        vec first, second, third;
        ivec a, b, c, high, albedo, normal;
        split((const float *)(const void *)codes, n, &first, &second, &third);
        a = ints(first), b = ints(second), c = ints(third), high = shift_right(b, 8);
        albedo = grain_light(shift_right(a, 24), grain_one(b), grain_one(high));
        normal = grain_light(grain_one(shift_right(b, 16)), shift_right(b, 24), grain_one(c));
        a = shift_right(a, 8);
        of_r = add_int(of_r, grain_two(a));
        of_gx = add_int(of_gx, grain_two(b));
        of_by = add_int(of_by, grain_two(high));
        of_z = add_int(of_z, grain_one(c));
        of_l = add_int(of_l, or_int(albedo, shift_left(normal, 16)));
        store_n(work->value[y][LULL_GRAIN_ALBEDO] + p, number(albedo), LANES);
        store_n(work->value[y][LULL_GRAIN_NORMAL] + p, number(normal), LANES);
        store_n(work->value[y][LULL_GRAINY] + p, number(grain_one(a)), LANES);
    }
    grain_put_two(work->column[0] + p, work->column[4] + p, of_l);
    store_n(work->column[1] + p, number(shift_right(of_r, 16)), LANES);
    grain_put_two(work->column[2] + p, work->column[5] + p, of_gx);
    grain_put_two(work->column[3] + p, work->column[6] + p, of_by);
    store_n(work->column[7] + p, number(of_z), LANES);
}

/* Sums of cells, of those of their columns; `cells` of them. */
LULL_INLINE void grain_fold(float *out, const float *column, unsigned cells)
{
    vec v[GRAIN_BLOCK / LANES + 1];
    unsigned n = GRAIN_BLOCK / LANES;
    for (unsigned i = 0; i < n; i++)
        v[i] = load_n(column + i * LANES, LANES);
    for (unsigned fold = 1; fold < GRAIN_SIDE; fold *= 2) {
        v[n] = set(0.0f);
        n = (n + 1) / 2;
        for (unsigned i = 0; i < n; i++) {
            vec even, odd;
            split_pairs(v[2 * i], v[2 * i + 1], &even, &odd);
            v[i] = add(even, odd);
        }
    }
    for (unsigned i = 0; i * LANES < cells; i++)
        store_n(out + i * LANES, v[i], lull_min_u(cells - i * LANES, LANES));
}

LULL_INLINE vec grain_add(vec sum, vec a, vec b)
{
    vec step = sub(a, b);
    return add(sum, mul(step, step));
}

/* Columns of a feature: squares, and squared steps right, down, and down to the right and left. */
LULL_INLINE void grain_steps(grain_work *work, unsigned count, unsigned feature)
{
    for (unsigned p = 0; p < GRAIN_BLOCK; p += LANES) {
        const vec zero = set(0.0f), inside = load_n(work->inside + p, LANES);
        const float *v = work->value[0][feature] + p;
        vec here = load_n(v, LANES), next = load_n(v + 1, LANES);
        vec sum = mul(here, here), right = grain_add(zero, next, here), down = zero;
        vec down_right = zero, down_left = zero;
        for (unsigned y = 1; y < count; y++) {
            const vec above = here, above_next = next;
            v = work->value[y][feature] + p;
            here = load_n(v, LANES);
            next = load_n(v + 1, LANES);
            sum = add(sum, mul(here, here));
            right = grain_add(right, next, here);
            down = grain_add(down, here, above);
            down_right = grain_add(down_right, next, above);
            down_left = grain_add(down_left, here, above_next);
        }
        store_n(work->column[0] + p, sum, LANES);
        store_n(work->column[1] + p, mul(right, inside), LANES);
        store_n(work->column[2] + p, down, LANES);
        store_n(work->column[3] + p, mul(down_right, inside), LANES);
        store_n(work->column[4] + p, mul(down_left, inside), LANES);
    }
}

/* Columns of the light: squared steps right. */
LULL_INLINE void grain_steps_of_light(grain_work *work, unsigned count)
{
    for (unsigned p = 0; p < GRAIN_BLOCK; p += LANES) {
        vec right = set(0.0f);
        for (unsigned y = 0; y < count; y++) {
            const float *v = work->value[y][LULL_GRAINY] + p;
            right = grain_add(right, load_n(v + 1, LANES), load_n(v, LANES));
        }
        store_n(work->column[0] + p, mul(right, load_n(work->inside + p, LANES)), LANES);
    }
}

void NAME(grain_sums)(float *out, size_t plane, const uint8_t *const *rows, unsigned count,
                      unsigned pixels, void *memory)
{
    grain_work *work = (grain_work *)memory;
    for (unsigned x = 0; x < pixels; x += GRAIN_BLOCK, out += GRAIN_BLOCK / GRAIN_SIDE) {
        const unsigned n = lull_min_u(pixels - x, GRAIN_BLOCK);
        const unsigned cells = lull_cell_count(GRAIN_SIDE, n);
        if (!x || n < GRAIN_BLOCK) {
            memset(work, 0, sizeof *work);
            for (unsigned i = 0; i + 1 < n; i++)
                work->inside[i] = i % GRAIN_SIDE == GRAIN_SIDE - 1 ? 0.0f : 1.0f;
        }
        for (unsigned p = 0; p < n; p += LANES)
            grain_read(work, rows, count, x + p, p, lull_min_u(n - p, LANES));
        for (unsigned k = 0; k < GRAIN_COLUMNS; k++) {
            float *sums = out + k / 4 * LULL_GRAIN_SUMS * plane;
            grain_fold(sums + (k % 4 ? 2 + k % 4 : 1) * plane, work->column[k], cells);
        }
        for (unsigned f = 0; f < LULL_GRAINY; f++) {
            float *sums = out + f * LULL_GRAIN_SUMS * plane;
            grain_steps(work, count, f);
            grain_fold(sums + 2 * plane, work->column[0], cells);
            for (unsigned k = 0; k < LULL_GRAIN_STEPS; k++)
                grain_fold(sums + (6 + k) * plane, work->column[1 + k], cells);
            for (unsigned i = 0; i < cells; i++)
                sums[i] = (float)(lull_min_u(GRAIN_SIDE, n - i * GRAIN_SIDE) * count);
        }
        grain_steps_of_light(work, count);
        grain_fold(out + LULL_GRAIN_LIGHT * plane, work->column[0], cells);
    }
}

/* lull_without_grain of n pixels from p on. */
LULL_INLINE void take_grain_block(float *v, size_t plane, float *out, const float *cells,
                                  size_t cell_plane, unsigned feature, size_t p, unsigned n)
{
    const float *cell = cells + (p + GRAIN_SIDE / 2) / GRAIN_SIDE;
    const vec part = parts_of_cells(p), share = between_cells(cell, cell_plane, 0, part);
    const int is_normal = feature == LULL_GRAIN_NORMAL;
    vec value[3];
    for (unsigned c = 0; c < 3; c++) {
        vec old = plane_at(v, plane, c, p, n), mean = between_cells(cell, cell_plane, 1 + c, part);
        if (is_normal)
            mean = sub(mul(mean, set(2.0f)), set(1.0f));
        value[c] = add(old, mul(share, sub(mean, old)));
        store_n(v + c * plane + p, value[c], n);
    }
    if (out)
        join(out + 3 * p, n, value[0], value[1], value[2]);
}

void NAME(take_grain)(float *v, size_t plane, float *out, const float *cells, size_t cell_plane,
                      unsigned feature, unsigned pixels){
#define BLOCK(n) take_grain_block(v, plane, out, cells, cell_plane, feature, p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}
