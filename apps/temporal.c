#include "temporal.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    GUIDES = 6,
    AGE_ONE = 60, /* one frame */
    REACH = 4,    /* of the window that change is looked for in */
    ROWS = 2 * REACH + 1,
    SUMS = 3,    /* of pixels, differences, squares */
    MOVING = 100, /* pixels that tell the signs of vectors for good */
    PASSES = 16   /* of the mean: one brings it to a 25th where 1 % are lamps */
};
#define GUIDE_LIMIT 51  /* features differ more than that: another thing. 0.2 of either */
#define STILL_AGE 3.0f  /* frames before that count where nothing moves, ... */
#define MOVING_AGE 1.0f /* ... and where things move by a pixel: each time they blur a little */
#define CHANCE 4.0f     /* square of the deviations that chance explains, ... */
#define CHANGE 16.0f    /* ... and that it does not */
#define DARK 0.05f      /* of the mean light: what is darker counts as that */
#define LEAST -1.0f     /* of a pixel's relative difference; fireflies beyond the most */
#define MOST 6.0f

/* A frame that is mixed: rows of it are prepared REACH rows ahead of those that are finished. */
typedef struct mixing {
    const temporal *t;
    const temporal_frame *frame;
    image *result;
    uint8_t *guide, *age; /* of the frame; those of t are of the one before */
    float *rows;          /* ROWS rows of moved results, share, sums; then rows of images */
    float *noisy, *here, *motion;
    float floor;    /* of light */
    float scale[2]; /* of motion vectors */
    float left, top; /* of the data window, less those of the one before */
} mixing;

/* ---- Guides ---------------------------------------------------------------------------------- */

static uint8_t to_byte(float v) { return (uint8_t)(v > 0 ? v < 1 ? 255 * v + 0.5f : 255 : 0); }

/* Rows y - 1, y and y + 1 of an image of three channels, those at the edges twice, summed. */
static void sum_rows(float *sum, float *row, const image *img, size_t y)
{
    const size_t n = img->width * img->channels;
    memset(sum, 0, n * sizeof *sum);
    for (int d = -1; d <= 1; d++) {
        size_t at = (d < 0 && y == 0) || (d > 0 && y + 1 == img->height) ? y : y + (size_t)d;
        image_get_row(img, at, row);
        for (size_t i = 0; i < n; i++)
            sum[i] += isfinite(row[i]) ? row[i] : 0;
    }
}

/* 3x3 means v of an image as v * scale + offset, in three of a row's guides. */
static void make_guides(uint8_t *guide, float *work, const image *img, size_t y, float scale,
                        float offset)
{
    const size_t width = img->width;
    const unsigned channels = img->channels;
    float *sum = work, *row = work + 3 * width;
    sum_rows(sum, row, img, y);
    for (size_t x = 0; x < width; x++) {
        size_t left = x ? x - 1 : x, right = x + 1 < width ? x + 1 : x;
        for (unsigned c = 0; c < 3; c++) {
            size_t k = c < channels ? c : channels - 1;
            float v = sum[left * channels + k] + sum[x * channels + k] + sum[right * channels + k];
            guide[x * GUIDES + c] = to_byte(v * (scale / 9) + offset);
        }
    }
}

static void make_all_guides(uint8_t *guide, float *work, const temporal_frame *frame)
{
    const size_t width = frame->noisy->width, height = frame->noisy->height;
    memset(guide, 0, width * height * GUIDES);
    for (size_t y = 0; y < height; y++, guide += width * GUIDES) {
        if (frame->albedo)
            make_guides(guide, work, frame->albedo, y, 1, 0);
        if (frame->normal)
            make_guides(guide + 3, work, frame->normal, y, 0.5f, 0.5f);
    }
}

static int guide_distance(const uint8_t *a, const uint8_t *b)
{
    int most = 0;
    for (int i = 0; i < GUIDES; i++) {
        int d = (a[i] > b[i] ? a[i] - b[i] : b[i] - a[i]) << (i / 3); /* normals: in halves */
        most = d > most ? d : most;
    }
    return most;
}

/* ---- Motion ---------------------------------------------------------------------------------- */

/* Nearest pixel of the frame before to the place (x, y); 0 if it is outside. */
static int nearest(const temporal *t, float x, float y, size_t *pixel)
{
    if (!(x >= 0 && y >= 0 && x <= (float)(t->width - 1) && y <= (float)(t->height - 1)))
        return 0; /* also for NaN */
    *pixel = (size_t)(y + 0.5f) * t->width + (size_t)(x + 0.5f);
    return 1;
}

/* Renderers agree on pixels, but not on the signs of their vectors: those with which the features
 * of pixels that move are most like those of the frame before; Cycles' where none are clearly
 * better. */
static void find_signs(temporal *t, mixing *m)
{
    static const float signs[4][2] = {{1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
    const image *motion = m->frame->motion;
    double sum[4] = {0};
    size_t count = 0, pixel;
    int best = 0;
    for (size_t y = 0; y < t->height; y += 3)
        for (size_t x = y % 9 / 3; x < t->width; x += 3) {
            const size_t here = y * t->width + x;
            float mx = image_get(motion, here * motion->channels);
            float my = image_get(motion, here * motion->channels + 1);
            if (!(mx * mx + my * my > 1)) /* also for NaN */
                continue;
            count++;
            for (int s = 0; s < 4; s++) {
                float px = (float)x + m->left + mx * signs[s][0];
                float py = (float)y + m->top + my * signs[s][1];
                sum[s] += nearest(t, px, py, &pixel)
                              ? guide_distance(m->guide + here * GUIDES, t->guide + pixel * GUIDES)
                              : GUIDE_LIMIT;
            }
        }
    for (int s = 1; s < 4; s++)
        best = sum[s] < sum[best] && sum[s] < 0.9 * sum[0] ? s : best;
    memcpy(m->scale, signs[best], sizeof m->scale);
    if (count >= MOVING)
        memcpy(t->scale, m->scale, sizeof t->scale);
}

/* Weights of the four pixels around a place of so much between the second and third. */
static void cubic_weights(float w[4], float f)
{
    w[0] = 0.5f * f * (-1 + f * (2 - f));
    w[1] = 1 + 0.5f * f * f * (3 * f - 5);
    w[2] = 0.5f * f * (1 + f * (4 - 3 * f));
    w[3] = 0.5f * f * f * (f - 1);
}

static size_t held_in(long i, size_t n) { return i < 0 ? 0 : (size_t)i < n ? (size_t)i : n - 1; }

/* The last result at a place inside, by Catmull and Rom's cubic curves, within what the four
 * nearest pixels have. */
static void fetch(float *out, const temporal *t, float x, float y)
{
    const long left = (long)x, top = (long)y;
    const unsigned channels = t->channels;
    float across[4], down[4], low[3], high[3], sum[3] = {0};
    cubic_weights(across, x - (float)left);
    cubic_weights(down, y - (float)top);
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) {
            const float *v = t->last + (held_in(top + j - 1, t->height) * t->width +
                                        held_in(left + i - 1, t->width)) *
                                           channels;
            int is_inner = (i == 1 || i == 2) && (j == 1 || j == 2);
            for (unsigned c = 0; c < channels; c++) {
                sum[c] += across[i] * down[j] * v[c];
                if (is_inner && ((i == 1 && j == 1) || v[c] < low[c]))
                    low[c] = v[c];
                if (is_inner && ((i == 1 && j == 1) || v[c] > high[c]))
                    high[c] = v[c];
            }
        }
    for (unsigned c = 0; c < channels; c++)
        out[c] = sum[c] < low[c] ? low[c] : sum[c] > high[c] ? high[c] : sum[c];
}

/* ---- Mixing ---------------------------------------------------------------------------------- */

static float light_of(const float *v, unsigned channels)
{
    float sum = 0;
    for (unsigned c = 0; c < channels; c++)
        sum += v[c];
    return sum / (float)channels;
}

static float difference(float noisy, float clean, float least)
{
    float d = (noisy - clean) / (clean + least);
    return d > LEAST ? d < MOST ? d : MOST : LEAST; /* NaN: as little as can be */
}

/* Parts of the ring for row y: moved results, shares, and sums one after the other. */
static float *moved_row(const mixing *m, size_t y)
{
    return m->rows + y % ROWS * m->t->width * (m->t->channels + 1 + SUMS);
}
static float *share_row(const mixing *m, size_t y)
{
    return moved_row(m, y) + m->t->width * m->t->channels;
}
static float *sums_row(const mixing *m, size_t y) { return share_row(m, y) + m->t->width; }

/* Brings the last result to row y; how many frames it may count for, and how the noisy image
 * differs from it more than from the new result. */
static void prepare_row(const mixing *m, size_t y)
{
    const temporal *t = m->t;
    const unsigned channels = t->channels,
                   steps = m->frame->motion ? m->frame->motion->channels : 0;
    float *moved = moved_row(m, y), *share = share_row(m, y), *sums = sums_row(m, y);
    image_get_row(m->frame->noisy, y, m->noisy);
    image_get_row(m->result, y, m->here);
    if (steps)
        image_get_row(m->frame->motion, y, m->motion);
    memset(share, 0, (1 + SUMS) * t->width * sizeof *share);
    for (size_t x = 0; x < t->width; x++) {
        float mx = steps ? m->motion[x * steps] * m->scale[0] : 0;
        float my = steps ? m->motion[x * steps + 1] * m->scale[1] : 0;
        float far = fabsf(mx) > fabsf(my) ? fabsf(mx) : fabsf(my), most, before, now, d;
        float px = (float)x + m->left + mx, py = (float)y + m->top + my;
        size_t pixel;
        if (!nearest(t, px, py, &pixel) ||
            guide_distance(m->guide + (y * t->width + x) * GUIDES, t->guide + pixel * GUIDES) >
                GUIDE_LIMIT)
            continue;
        fetch(moved + x * channels, t, px, py);
        before = light_of(moved + x * channels, channels);
        now = light_of(m->here + x * channels, channels);
        if (!isfinite(before) || !isfinite(now)) /* halves end at 65504 */
            continue;
        most = STILL_AGE + (MOVING_AGE - STILL_AGE) * (far < 1 ? far : 1);
        share[x] = (float)t->age[pixel] * (1.0f / AGE_ONE);
        share[x] = share[x] < most ? share[x] : most;
        d = light_of(m->noisy + x * channels, channels);
        if (!isfinite(d))
            continue;
        now = difference(d, now, m->floor);
        d = difference(d, before, m->floor);
        sums[x] = 1;
        sums[t->width + x] = d - now;
        sums[2 * t->width + x] = d * d;
    }
}

/* Column sums of the rows around y, then the result of row y. */
static void finish_row(const mixing *m, size_t y, float *column)
{
    const temporal *t = m->t;
    const size_t width = t->width, top = y > REACH ? y - REACH : 0;
    const size_t end = y + REACH < t->height ? y + REACH + 1 : t->height;
    const float *moved = moved_row(m, y), *share = share_row(m, y);
    memset(column, 0, SUMS * width * sizeof *column);
    for (size_t row = top; row < end; row++)
        for (size_t i = 0; i < SUMS * width; i++)
            column[i] += sums_row(m, row)[i];
    image_get_row(m->result, y, m->here);
    for (size_t x = 0; x < width; x++) {
        size_t left = x > REACH ? x - REACH : 0, right = x + REACH < width ? x + REACH : width - 1;
        float n = 0, d = 0, square = 0, z, k, w;
        for (size_t i = left; i <= right && share[x] > 0; i++) {
            n += column[i];
            d += column[width + i];
            square += column[2 * width + i];
        }
        z = n > 0 ? d * d / (square + 1e-5f * n * n) : 0;
        k = share[x] * (z < CHANCE ? 1 : z < CHANGE ? (CHANGE - z) / (CHANGE - CHANCE) : 0);
        w = k / (1 + k);
        for (size_t i = x * t->channels; i < (x + 1) * t->channels && w > 0; i++)
            m->here[i] += w * (moved[i] - m->here[i]);
        m->age[y * width + x] = (uint8_t)((1 + k) * AGE_ONE);
    }
    image_set_row(m->result, y, m->here);
}

/* Mean of some of an image's values, to which none adds more than four times the mean: lamps are
 * few, and may be a million times as bright as what they shine on. */
static float mean_light(const image *img)
{
    const size_t count = image_count(img), step = count / 100000 + 1;
    float mean = FLT_MAX / 4;
    for (int pass = 0; pass < PASSES; pass++) {
        double sum = 0, n = 0;
        for (size_t i = 0; i < count; i += step, n++) {
            float v = image_get(img, i);
            sum += v > 0 ? v < 4 * mean ? v : 4 * mean : 0;
        }
        mean = (float)(sum / n);
    }
    return mean;
}

/* 1 if the frame before is there, and of the same kind. */
static int goes_on(const temporal *t, const temporal_frame *frame, int features)
{
    return t->last && frame->number == t->number + 1 && frame->noisy->width == t->width &&
           frame->noisy->height == t->height && frame->noisy->channels == t->channels &&
           features == t->features;
}

static void mix(temporal *t, mixing *m, float *column)
{
    const size_t height = t->height;
    m->left = (float)(m->frame->noisy->left - t->left);
    m->top = (float)(m->frame->noisy->top - t->top);
    memcpy(m->scale, m->frame->scale ? m->frame->scale : t->scale, sizeof m->scale);
    if (m->frame->motion && m->scale[0] == 0 && m->scale[1] == 0)
        find_signs(t, m);
    m->floor = mean_light(m->result) * DARK;
    m->floor = m->floor > 1e-30f ? m->floor : 1e-30f;
    for (size_t y = 0; y < height + REACH; y++) {
        if (y < height)
            prepare_row(m, y);
        if (y >= REACH)
            finish_row(m, y - REACH, column);
    }
}

/* Memory of a frame; 0 if there is none. */
static int make_memory(mixing *m, float **last, float **work)
{
    const size_t width = m->result->width, pixels = width * m->result->height;
    const size_t channels = m->result->channels;
    const size_t steps = m->frame->motion ? m->frame->motion->channels : 0;
    const size_t ring = ROWS * (channels + 1 + SUMS);
    m->guide = malloc(pixels * GUIDES);
    m->age = malloc(pixels);
    *last = malloc(pixels * channels * sizeof **last);
    m->rows = malloc(width * (ring + 2 * channels + steps + 6) * sizeof *m->rows);
    if (!m->guide || !m->age || !*last || !m->rows) {
        free(m->guide), free(m->age), free(*last), free(m->rows);
        return 0;
    }
    m->noisy = m->rows + ring * width;
    m->here = m->noisy + channels * width;
    m->motion = m->here + channels * width;
    *work = m->motion + steps * width;
    return 1;
}

int temporal_mix(temporal *t, image *result, const temporal_frame *frame)
{
    const int features = (frame->albedo ? 1 : 0) | (frame->normal ? 2 : 0);
    const size_t row = result->width * result->channels;
    mixing m = {0};
    float *last, *work;
    m.t = t, m.frame = frame, m.result = result;
    if (!make_memory(&m, &last, &work)) {
        temporal_free(t);
        return -1;
    }
    make_all_guides(m.guide, work, frame);
    memset(m.age, AGE_ONE, result->width * result->height);
    if (goes_on(t, frame, features))
        mix(t, &m, work);
    for (size_t y = 0; y < result->height; y++)
        image_get_row(result, y, last + y * row);
    free(m.rows);
    free(t->last), free(t->guide), free(t->age);
    t->width = result->width, t->height = result->height, t->channels = result->channels;
    t->left = frame->noisy->left, t->top = frame->noisy->top;
    t->last = last, t->guide = m.guide, t->age = m.age;
    t->features = features, t->number = frame->number;
    return 0;
}

void temporal_free(temporal *t)
{
    free(t->last);
    free(t->guide);
    free(t->age);
    memset(t, 0, sizeof *t);
}
