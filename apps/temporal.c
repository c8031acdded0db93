#include "temporal.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    GUIDES = 6,
    REACH = 8, /* of the widest window that change is looked for in */
    ROWS = 2 * REACH + 1,
    SUMS = 3,           /* of pixels, differences, squares */
    MOST_CHANNELS = 14, /* of a pixel that is kept */
    MOVING = 100,       /* pixels that tell the signs of vectors for good */
    PASSES = 16         /* of the mean: one brings it to a 25th where 1 % are lamps */
};
static const size_t radii[] = {2, 4, REACH};
#define GUIDE_LIMIT 51 /* features differ more than that: another thing. 0.2 of either */
/* Frames before that count in the input where nothing moves, and where things move by a pixel: each
 * time they blur a little, and what is seen in a mirror moves otherwise; and in the result, whose
 * errors are alike from frame to frame. */
#define STILL_BEFORE 8.0f
#define MOVING_BEFORE 1.5f
#define MOST_RESULTS 0.5f
#define DARK 0.05f  /* of the mean light: what is darker counts as that */
#define BRIGHT 3.0f /* times the result: what is brighter counts as that */

/* A frame that is gathered: rows of it are prepared REACH rows ahead of those that are finished. */
typedef struct gathering {
    const temporal *t;
    const temporal_frame *frame;
    uint8_t *guide; /* of the frame; those of t are of the one before */
    float *rows;    /* ROWS rows of shares and sums; then column sums, then rows of images: */
    float *noisy, *albedo, *normal, *motion;
    float scale[2];  /* of motion vectors */
    float left, top; /* of the data window, less those of the one before */
} gathering;

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
static void find_signs(temporal *t, gathering *m)
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

static float smaller(float a, float b) { return a < b ? a : b; }

static size_t held_in(long i, size_t n) { return i < 0 ? 0 : (size_t)i < n ? (size_t)i : n - 1; }

/* What was kept of a place inside, by Catmull and Rom's cubic curves, within what the four nearest
 * pixels have. */
static void fetch(float *out, const temporal *t, float x, float y)
{
    const size_t left = (size_t)x, top = (size_t)y;
    const unsigned channels = t->channels;
    float across[4], down[4], low[MOST_CHANNELS], high[MOST_CHANNELS];
    const float *here = t->last + (top * t->width + left) * channels;
    memcpy(low, here, channels * sizeof *low);
    memcpy(high, here, channels * sizeof *high);
    if ((float)left == x && (float)top == y) {
        memcpy(out, here, channels * sizeof *out);
        return;
    }
    cubic_weights(across, x - (float)left);
    cubic_weights(down, y - (float)top);
    memset(out, 0, channels * sizeof *out);
    for (long j = 0; j < 4; j++)
        for (long i = 0; i < 4; i++) {
            const size_t row = held_in((long)top + j - 1, t->height);
            const float *v =
                t->last + (row * t->width + held_in((long)left + i - 1, t->width)) * channels;
            const float w = across[i] * down[j];
            for (unsigned c = 0; c < channels; c++)
                out[c] += w * v[c];
            if ((i != 1 && i != 2) || (j != 1 && j != 2))
                continue;
            for (unsigned c = 0; c < channels; c++) {
                low[c] = v[c] < low[c] ? v[c] : low[c];
                high[c] = v[c] > high[c] ? v[c] : high[c];
            }
        }
    for (unsigned c = 0; c < channels; c++)
        out[c] = out[c] < low[c] ? low[c] : out[c] > high[c] ? high[c] : out[c];
}

/* Where in the frame before pixel (x, y) was; 0 if it was not there. */
static int came_from(const gathering *m, size_t x, size_t y, float at[2], size_t *pixel)
{
    const unsigned steps = m->frame->motion ? m->frame->motion->channels : 0;
    at[0] = (float)x + m->left + (steps ? m->motion[x * steps] * m->scale[0] : 0);
    at[1] = (float)y + m->top + (steps ? m->motion[x * steps + 1] * m->scale[1] : 0);
    return nearest(m->t, at[0], at[1], pixel);
}

/* ---- Gathering ------------------------------------------------------------------------------- */

/* Places in a pixel of t->last. */
static unsigned result_at(const temporal *t) { return t->channels - 2 - t->colors; }
static unsigned light_at(const temporal *t) { return t->channels - 2; }
static unsigned age_at(const temporal *t) { return t->channels - 1; }

static float light_of(const float *v, unsigned channels)
{
    float sum = 0;
    for (unsigned c = 0; c < channels; c++)
        sum += v[c];
    return sum / (float)channels;
}

/* Light as it is compared: sparks, as few samples have them, would hide all that changes. */
static float bounded(float light, float result, float floor)
{
    const float most = BRIGHT * (result + floor);
    return light > most ? most : light; /* NaN as it is */
}

/* Parts of the ring for row y: shares, and sums one after the other. */
static float *share_row(const gathering *m, size_t y)
{
    return m->rows + y % ROWS * m->t->width * (1 + SUMS);
}
static float *sums_row(const gathering *m, size_t y) { return share_row(m, y) + m->t->width; }

/* How many frames before count at most where things have moved that far. */
static float most_before(float across, float down)
{
    const float far = fabsf(across) > fabsf(down) ? fabsf(across) : fabsf(down);
    return STILL_BEFORE + (MOVING_BEFORE - STILL_BEFORE) * smaller(far, 1);
}

/* How many frames before each pixel of row y may count for, and how its light differs. */
static void prepare_row(const gathering *m, size_t y)
{
    const temporal *t = m->t;
    float *share = share_row(m, y), *sums = sums_row(m, y);
    image_get_row(m->frame->noisy, y, m->noisy);
    if (m->frame->motion)
        image_get_row(m->frame->motion, y, m->motion);
    memset(share, 0, (1 + SUMS) * t->width * sizeof *share);
    for (size_t x = 0; x < t->width; x++) {
        const float *before;
        float at[2], result, d;
        size_t pixel;
        if (!came_from(m, x, y, at, &pixel) ||
            guide_distance(m->guide + (y * t->width + x) * GUIDES, t->guide + pixel * GUIDES) >
                GUIDE_LIMIT)
            continue;
        before = t->last + pixel * t->channels;
        result = light_of(before + result_at(t), t->colors);
        if (!isfinite(result)) /* halves end at 65504 */
            continue;
        share[x] = smaller(before[age_at(t)],
                           most_before(at[0] - (float)x - m->left, at[1] - (float)y - m->top));
        d = light_of(m->noisy + x * t->colors, t->colors);
        d = (bounded(d, result, t->floor) - before[light_at(t)]) / (result + t->floor);
        if (!isfinite(d))
            continue;
        sums[x] = 1;
        sums[t->width + x] = d;
        sums[2 * t->width + x] = d * d;
    }
}

/* Adds the sums of rows [from, to) to those of columns. */
static void add_rows(const gathering *m, float *column, size_t from, size_t to)
{
    for (size_t y = from; y < to; y++)
        for (size_t i = 0; i < SUMS * m->t->width; i++)
            column[i] += sums_row(m, y)[i];
}

/* Lowers the shares of row y where light differs in a window around by more than chance: z, the
 * square of the mean difference by that which chance explains, is 1 on average then. With w of a
 * mean from before, the error is w * w * (z - 1) + (1 - w) in units of the new noise, least at
 * w = 1 / 2(z - 1); frames count for some times that, as denoising leaves less of the noise. */
static void limit_shares(const gathering *m, size_t y, float *column)
{
    const size_t width = m->t->width, height = m->t->height;
    float *share = share_row(m, y);
    size_t top = y, end = y;
    memset(column, 0, SUMS * width * sizeof *column);
    for (size_t r = 0; r < sizeof radii / sizeof *radii; r++) {
        const size_t reach = radii[r], up = y > reach ? y - reach : 0;
        const size_t down = y + reach < height ? y + reach + 1 : height;
        add_rows(m, column, up, top);
        add_rows(m, column, end, down);
        top = up, end = down;
        for (size_t x = 0; x < width; x++) {
            size_t i = x > reach ? x - reach : 0;
            const size_t right = x + reach < width ? x + reach : width - 1;
            float n = 0, d = 0, square = 0, z, most;
            for (; i <= right && share[x] > 0; i++) {
                n += column[i];
                d += column[width + i];
                square += column[2 * width + i];
            }
            z = n > 0 ? d * d / (square + 1e-5f * n * n) : 0;
            most = z > 1 ? 8 / (z - 1) - 0.5f : STILL_BEFORE;
            share[x] = smaller(share[x], most > 0 ? most : 0);
        }
    }
}

/* Mean of a value, if it is a number, and one that stands for k times as much. */
static float mean_of(float v, float before, float k)
{
    return isfinite(v) ? v + k / (1 + k) * (before - v) : before;
}

static void mean_row(float *row, size_t x, const image *img, const float *before, float k)
{
    for (size_t c = 0; img && c < img->channels; c++)
        row[x * img->channels + c] = mean_of(row[x * img->channels + c], before[c], k);
}

/* Row y of the images becomes the mean; what else the next frame and the result want is moved. */
static void finish_row(const gathering *m, size_t y)
{
    const temporal *t = m->t;
    const temporal_frame *f = m->frame;
    const unsigned albedo_at = t->colors;
    const unsigned normal_at = albedo_at + (f->albedo ? f->albedo->channels : 0);
    const float *share = share_row(m, y);
    image_get_row(f->noisy, y, m->noisy);
    if (f->albedo)
        image_get_row(f->albedo, y, m->albedo);
    if (f->normal)
        image_get_row(f->normal, y, m->normal);
    if (f->motion)
        image_get_row(f->motion, y, m->motion);
    for (size_t x = 0; x < t->width; x++) {
        float *moved = t->moved + (y * t->width + x) * (t->colors + 2);
        float light = light_of(m->noisy + x * t->colors, t->colors), at[2], sum = 0;
        float before[MOST_CHANNELS];
        const float k = share[x];
        size_t pixel;
        moved[t->colors] = light; /* bounded when there is a result */
        moved[t->colors + 1] = 1;
        if (!(k > 0) || !came_from(m, x, y, at, &pixel))
            continue;
        fetch(before, t, at[0], at[1]);
        for (unsigned c = 0; c < t->channels; c++)
            sum += before[c];
        if (!isfinite(sum))
            continue;
        light = bounded(light, light_of(before + result_at(t), t->colors), t->floor);
        memcpy(moved, before + result_at(t), t->colors * sizeof *moved);
        moved[t->colors] = mean_of(light, before[light_at(t)], k);
        moved[t->colors + 1] = 1 + k;
        mean_row(m->noisy, x, f->noisy, before, k);
        mean_row(m->albedo, x, f->albedo, before + albedo_at, k);
        mean_row(m->normal, x, f->normal, before + normal_at, k);
    }
    image_set_row(f->noisy, y, m->noisy);
    if (f->albedo)
        image_set_row(f->albedo, y, m->albedo);
    if (f->normal)
        image_set_row(f->normal, y, m->normal);
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
    return t->last && t->is_whole && frame->number == t->number + 1 &&
           frame->noisy->width == t->width && frame->noisy->height == t->height &&
           frame->noisy->channels == t->colors && features == t->features;
}

static void take_over(temporal *t, gathering *m)
{
    const size_t height = t->height;
    float *column = m->rows + ROWS * (1 + SUMS) * t->width;
    m->left = (float)(m->frame->noisy->left - t->left);
    m->top = (float)(m->frame->noisy->top - t->top);
    memcpy(m->scale, m->frame->scale ? m->frame->scale : t->scale, sizeof m->scale);
    if (m->frame->motion && m->scale[0] == 0 && m->scale[1] == 0)
        find_signs(t, m);
    for (size_t y = 0; y < height + REACH; y++) {
        if (y < height)
            prepare_row(m, y);
        if (y < REACH)
            continue;
        limit_shares(m, y - REACH, column);
        finish_row(m, y - REACH);
    }
}

/* Without a frame before: as if all of it were new. */
static void begin(gathering *m)
{
    memset(m->rows, 0, ROWS * (1 + SUMS) * m->t->width * sizeof *m->rows);
    for (size_t y = 0; y < m->t->height; y++)
        finish_row(m, y);
}

/* Memory for frames of another kind than those before; 0 if there is none. */
static int make_memory(temporal *t, const temporal_frame *frame, int features)
{
    const size_t pixels = frame->noisy->width * frame->noisy->height;
    const float scale[2] = {t->scale[0], t->scale[1]};
    temporal_free(t);
    memcpy(t->scale, scale, sizeof t->scale);
    t->width = frame->noisy->width, t->height = frame->noisy->height;
    t->colors = frame->noisy->channels;
    t->features = features;
    t->channels = 2 * t->colors + (unsigned)(features % 4 + features / 4) + 2;
    t->last = malloc(pixels * t->channels * sizeof *t->last);
    t->moved = malloc(pixels * (t->colors + 2) * sizeof *t->moved);
    t->guide = malloc(pixels * GUIDES);
    return t->last && t->moved && t->guide;
}

/* Keeps the images of a frame, as they are now, and their guides. */
static void keep(temporal *t, gathering *m, float *work)
{
    const image *images[3] = {m->frame->noisy, m->frame->albedo, m->frame->normal};
    unsigned at = 0;
    for (int i = 0; i < 3; i++) {
        const unsigned channels = images[i] ? images[i]->channels : 0;
        for (size_t y = 0; y < t->height && channels; y++) {
            image_get_row(images[i], y, work);
            for (size_t x = 0; x < t->width; x++)
                memcpy(t->last + (y * t->width + x) * t->channels + at, work + x * channels,
                       channels * sizeof *work);
        }
        at += channels;
    }
    make_all_guides(t->guide, work, m->frame);
    t->left = m->frame->noisy->left, t->top = m->frame->noisy->top;
    t->number = m->frame->number;
    t->is_whole = 0;
}

int temporal_gather(temporal *t, const temporal_frame *frame)
{
    const int features = (frame->albedo ? (int)frame->albedo->channels : 0) +
                         4 * (frame->normal ? (int)frame->normal->channels : 0);
    const size_t width = frame->noisy->width;
    const size_t steps = frame->motion ? frame->motion->channels : 0;
    const int continues = goes_on(t, frame, features);
    gathering m = {0};
    m.t = t, m.frame = frame;
    m.guide = malloc(width * frame->noisy->height * GUIDES);
    m.rows = malloc(width * (ROWS * (1 + SUMS) + SUMS + 9 + steps) * sizeof *m.rows);
    if (!m.guide || !m.rows || (!continues && !make_memory(t, frame, features))) {
        free(m.guide), free(m.rows);
        temporal_free(t);
        return -1;
    }
    m.noisy = m.rows + (ROWS * (1 + SUMS) + SUMS) * width;
    m.albedo = m.noisy + 3 * width;
    m.normal = m.albedo + 3 * width;
    m.motion = m.normal + 3 * width;
    if (continues) {
        make_all_guides(m.guide, m.noisy, frame);
        take_over(t, &m);
    } else {
        begin(&m);
    }
    keep(t, &m, m.noisy);
    free(m.guide);
    free(m.rows);
    return 0;
}

void temporal_mix(temporal *t, image *result, int number)
{
    const unsigned colors = t->colors;
    if (!t->last || t->is_whole || t->number != number)
        return;
    t->floor = mean_light(result) * DARK;
    t->floor = t->floor > 1e-30f ? t->floor : 1e-30f;
    for (size_t i = 0, pixels = t->width * t->height; i < pixels; i++) {
        const float *moved = t->moved + i * (colors + 2);
        float *last = t->last + i * t->channels, *here = last + result_at(t);
        const float k = moved[colors + 1] - 1;
        float light = moved[colors];
        for (unsigned c = 0; c < colors; c++) {
            here[c] = image_get(result, i * colors + c);
            if (k > 0 && isfinite(here[c]))
                here[c] = mean_of(here[c], moved[c], smaller(k, MOST_RESULTS));
            image_set(result, i * colors + c, here[c]);
        }
        if (!(k > 0)) /* nothing was known to bound it by */
            light = isnan(light) ? light_of(here, colors)
                                 : bounded(light, light_of(here, colors), t->floor);
        last[light_at(t)] = light;
        last[age_at(t)] = k + 1;
    }
    t->is_whole = 1;
}

void temporal_free(temporal *t)
{
    free(t->last);
    free(t->moved);
    free(t->guide);
    memset(t, 0, sizeof *t);
}
