#include "port_scalar.h"

#define B LULL_SCALAR_BLOCK

/* Six points of the six values at d, `step` apart, likewise at `to`. */
static void make_side(int16_t *to, size_t to_step, const int16_t *d, size_t step)
{
    int d0 = d[0], d1 = d[step], d2 = d[2 * step], d3 = d[3 * step], d4 = d[4 * step];
    int u = d4 - d2, v = d3 - d1, e = d4 - 4 * d2, f = d3 - 4 * d1;
    int point[6];
    point[0] = u + 4 * (d0 - d2);
    point[1] = e + f;
    point[2] = e - f;
    point[3] = u + 2 * v;
    point[4] = u - 2 * v;
    point[5] = d[5 * step] - d3 - 4 * v;
    for (unsigned i = 0; i < 6; i++)
        to[i * to_step] = (int16_t)point[i];
}

/* Four points likewise, of wide codes. */
static void make_wide_side(int16_t *to, size_t to_step, const int16_t *d, size_t step)
{
    int d0 = d[0], d1 = d[step], d2 = d[2 * step], d3 = d[3 * step];
    to[0] = (int16_t)(d0 - d2);
    to[to_step] = (int16_t)(d1 + d2);
    to[2 * to_step] = (int16_t)(d2 - d1);
    to[3 * to_step] = (int16_t)(d1 - d3);
}

/* Points of one channel of a patch: d are its 6x6 codes, or 4x4 wide ones. */
static void make_points(int16_t *points, size_t plane, const int16_t *d, int is_wide)
{
    void (*side)(int16_t *, size_t, const int16_t *, size_t) = is_wide ? make_wide_side : make_side;
    unsigned n = lull_patch_side(is_wide) + 2;
    int16_t half[36];
    for (unsigned i = 0; i < n; i++)
        side(half + i, n, d + i, n);
    for (unsigned i = 0; i < n; i++)
        side(points + n * i * plane, plane, half + n * i, 1);
}

static int16_t code(const lull_patches *image, unsigned row, size_t at)
{
    int16_t word;
    if (!image->is_wide)
        return image->row[row][at];
    memcpy(&word, image->row[row] + 2 * at, sizeof word);
    return word;
}

void lull_patches_in_scalar(const lull_patches *image)
{
    unsigned side = lull_patch_side(image->is_wide), field = side + 2;
    for (unsigned p = 0; p < image->patches; p++)
        for (unsigned c = 0; c < image->channels; c++) {
            int16_t d[36], *to = image->points + (size_t)p * image->channels + c;
            for (unsigned i = 0; i < field * field; i++)
                d[i] = code(image, i / field,
                            (size_t)(side * p + i % field) * image->channels + c);
            make_points(to, image->plane, d, image->is_wide);
        }
}

/* The sums of one block: unsigned, as they may wrap. */
static void add_points(uint32_t *sum, const lull_segment *segment, unsigned block, unsigned p)
{
    const int16_t *w = (const int16_t *)segment->weights + (size_t)block * segment->length * B * 2;
    const int16_t *x = (const int16_t *)segment->row + (size_t)p * segment->step * 2;
    for (unsigned k = 0; k < segment->length; k++, w += 2 * B, x += 2)
        for (unsigned o = 0; o < B; o++)
            sum[o] += (uint32_t)(x[0] * w[2 * o]) + (uint32_t)(x[1] * w[2 * o + 1]);
}

void lull_points_int_scalar(const lull_conv *conv)
{
    for (unsigned first = 0; first < conv->outputs; first += B)
        for (unsigned p = 0; p < conv->pixels; p++) {
            uint32_t sum[B] = {0};
            unsigned n = lull_min_u(B, conv->outputs - first);
            add_points(sum, &conv->segment[0], first / B, p);
            memcpy((uint32_t *)conv->out + p * conv->out_step + first, sum, n * sizeof *sum);
        }
}

/* 24 times four values, modulo 2^32, from their six sums. */
static void make_pixels(uint32_t y[4], const uint32_t *t, size_t step)
{
    uint32_t s = t[step] + t[2 * step], d = t[step] - t[2 * step];
    uint32_t far_s = t[3 * step] + t[4 * step], far_d = t[3 * step] - t[4 * step];
    y[0] = t[0] + s + far_s;
    y[1] = d + 2 * far_d;
    y[2] = s + 4 * far_s;
    y[3] = d + 8 * far_d + 4 * t[5 * step];
}

/* The sums of products of the 16 pixels of a patch, one channel. */
static void make_patch(int32_t y[16], const int32_t *sums, size_t plane, unsigned phase)
{
    uint32_t t[36], half[4][6];
    for (unsigned i = 0; i < 36; i++)
        t[i] = lull_patch_vanishes(phase, i) ? 0 : (uint32_t)sums[i * plane];
    for (unsigned x = 0; x < 6; x++) {
        uint32_t column[4];
        make_pixels(column, t + x, 6);
        for (unsigned i = 0; i < 4; i++)
            half[i][x] = column[i];
    }
    for (unsigned i = 0; i < 4; i++) {
        uint32_t row[4];
        make_pixels(row, half[i], 1);
        for (unsigned x = 0; x < 4; x++)
            y[4 * i + x] = (int32_t)(row[x] * LULL_PATCH_INVERSE) >> LULL_PATCH_SHIFT;
    }
}

/* The sums of products of the 4 pixels of a patch of wide codes. */
static void make_wide_patch(int32_t y[4], const int32_t *sums, size_t plane)
{
    uint32_t half[2][4];
    for (unsigned x = 0; x < 4; x++) {
        const int32_t *t = sums + x * plane;
        uint32_t t1 = (uint32_t)t[4 * plane], t2 = (uint32_t)t[8 * plane];
        half[0][x] = (uint32_t)t[0] + t1 + t2;
        half[1][x] = t1 - t2 - (uint32_t)t[12 * plane];
    }
    for (unsigned i = 0; i < 2; i++) {
        const uint32_t *t = half[i];
        y[2 * i] = (int32_t)(t[0] + t[1] + t[2]) >> LULL_PATCH_WIDE_SHIFT;
        y[2 * i + 1] = (int32_t)(t[1] - t[2] - t[3]) >> LULL_PATCH_WIDE_SHIFT;
    }
}

static void store(const lull_patches *image, unsigned row, size_t at, unsigned c, int32_t a)
{
    size_t pixel = at;
    at = at * image->channels + c;
    a += image->start ? image->start[row * image->start_row + at] : image->bias[c];
    if (image->is_raw)
        ((int32_t *)(void *)image->out[row])[pixel * image->raw_step + c] = a;
    else
        lull_store_scalar(image->out[row], at, a, image->multiplier[c], image->out_max);
}

static int32_t most(int32_t a, int32_t b) { return a > b ? a : b; }

static void patch_out(const lull_patches *image, unsigned p, unsigned c)
{
    const int32_t *sums = image->sums + (size_t)p * image->channels + c;
    int32_t y[16], half = 1 << image->shift >> 1;
    if (image->is_wide) {
        make_wide_patch(y, sums, image->plane);
        for (unsigned i = 0; i < 4; i++)
            store(image, i / 2, 2 * (size_t)p + i % 2, c, (y[i] + half) >> image->shift);
        return;
    }
    make_patch(y, sums, image->plane, image->phase);
    for (unsigned i = 0; i < 16; i++) {
        if (!image->is_pooled) {
            store(image, i / 4, 4 * (size_t)p + i % 4, c, y[i]);
        } else if (i / 4 % 2 == 0 && i % 2 == 0) {
            int32_t above = most(y[i], y[i + 1]), below = most(y[i + 4], y[i + 5]);
            store(image, i / 8, 2 * (size_t)p + i % 4 / 2, c, most(above, below));
        }
    }
}

void lull_patches_out_scalar(const lull_patches *image)
{
    for (unsigned p = 0; p < image->patches; p++)
        for (unsigned c = 0; c < image->channels; c++)
            patch_out(image, p, c);
}
