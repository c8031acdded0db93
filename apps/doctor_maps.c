#include "doctor_maps.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REACH 4          /* pixels of displacement looked for */
#define SAMPLES 1000000u /* pixels that a correlation looks at */

static float finite_or_0(float v) { return isfinite(v) ? v : 0.0f; }

static float luminance_at(const image *img, size_t pixel)
{
    float v[3];
    for (unsigned c = 0; c < 3; c++)
        v[c] = finite_or_0(
            image_get(img, pixel * img->channels + (c < img->channels ? c : img->channels - 1)));
    v[0] = 0.2127f * v[0] + 0.7152f * v[1] + 0.0722f * v[2];
    return v[0] > 0 ? v[0] : 0;
}

/* Mean luminance, large values held down so that a few fireflies do not make it. */
static float robust_mean(const image *img)
{
    size_t n = img->width * img->height;
    double sum = 0, limit;
    for (size_t i = 0; i < n; i++)
        sum += luminance_at(img, i);
    limit = 10 * sum / (double)n;
    sum = 0;
    for (size_t i = 0; i < n; i++) {
        double v = luminance_at(img, i);
        sum += v < limit ? v : limit;
    }
    return (float)(sum / (double)n);
}

/* Mean of 3x3 logarithms around an inner pixel. */
static float smooth_log(const image *img, size_t x, size_t y, float offset)
{
    float sum = 0;
    for (size_t j = y - 1; j <= y + 1; j++)
        for (size_t i = x - 1; i <= x + 1; i++)
            sum += logf(luminance_at(img, j * img->width + i) + offset);
    return sum / 9;
}

/* Adds the gradient of one channel, kept in rows of `smooth`, to the edges. */
static void add_gradient(float *edges, const float *smooth, size_t width, size_t height)
{
    for (size_t y = 1; y + 1 < height; y++)
        for (size_t x = 1; x + 1 < width; x++) {
            const float *p = smooth + y * width + x;
            float gx = p[1] - p[-1], gy = p[width] - *(p - width);
            edges[y * width + x] += sqrtf(gx * gx + gy * gy);
        }
}

static void limit(float *values, size_t n)
{
    for (size_t i = 0; i < n; i++)
        values[i] = values[i] < 1 ? values[i] : 1;
}

int doctor_maps_init(doctor_maps *maps, const image *color)
{
    size_t w = color->width, h = color->height;
    float mean, *smooth;
    memset(maps, 0, sizeof *maps);
    if (w < DOCTOR_MIN_SIZE || h < DOCTOR_MIN_SIZE)
        return -1;
    mean = robust_mean(color);
    if (!(mean > 0))
        return -1;
    maps->width = w;
    maps->height = h;
    maps->luminance = malloc(w * h * sizeof *maps->luminance);
    maps->edges = calloc(w * h, sizeof *maps->edges);
    smooth = calloc(w * h, sizeof *smooth);
    if (!maps->luminance || !maps->edges || !smooth) {
        free(smooth);
        doctor_maps_free(maps);
        return -1;
    }
    for (size_t i = 0; i < w * h; i++)
        maps->luminance[i] = logf(luminance_at(color, i) + 0.02f * mean);
    for (size_t y = 1; y + 1 < h; y++)
        for (size_t x = 1; x + 1 < w; x++)
            smooth[y * w + x] = smooth_log(color, x, y, 0.1f * mean);
    add_gradient(maps->edges, smooth, w, h);
    limit(maps->edges, w * h);
    free(smooth);
    return 0;
}

void doctor_maps_free(doctor_maps *maps)
{
    free(maps->luminance);
    free(maps->edges);
    memset(maps, 0, sizeof *maps);
}

/* Mean of |L(p) - L(p + lag)|, along rows and columns, each at most 1. */
static double mean_difference(const doctor_maps *maps, size_t lag)
{
    size_t w = maps->width, h = maps->height;
    double across = 0, down = 0;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++) {
            const float *p = maps->luminance + y * w + x;
            if (x + lag < w)
                across += fmin(fabs((double)(p[lag] - p[0])), 1);
            if (y + lag < h)
                down += fmin(fabs((double)(p[lag * w] - p[0])), 1);
        }
    return across / (double)((w - lag) * h) + down / (double)((h - lag) * w);
}

void doctor_noise_scale(const doctor_maps *maps, double *near, double *far)
{
    double d1 = mean_difference(maps, 1), d2 = mean_difference(maps, 2);
    double d4 = mean_difference(maps, 4), d8 = mean_difference(maps, 8);
    *near = d2 > 0 ? d1 / d2 : 1;
    *far = d8 > 0 ? d4 / d8 : 0;
}

/* Pearson correlation of edges at (x, y) of the colour with those of `other` at (ax x + bx, ay y +
 * by), ax and ay being 1 or -1. */
static double correlate(const doctor_maps *maps, const float *other, int ax, long bx, int ay,
                        long by)
{
    long w = (long)maps->width, h = (long)maps->height;
    long step = (long)(maps->width * maps->height / SAMPLES + 1);
    double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0, va, vb;
    for (long y = REACH + 1; y < h - REACH - 1; y += step) {
        const float *a = maps->edges + y * w;
        const float *b = other + (ay * y + by) * w + bx;
        for (long x = REACH + 1; x < w - REACH - 1; x++) {
            double u = a[x], v = b[ax * x];
            sa += u;
            sb += v;
            saa += u * u;
            sbb += v * v;
            sab += u * v;
        }
        n += (double)(w - 2 * REACH - 2);
    }
    va = saa - sa * sa / n;
    vb = sbb - sb * sb / n;
    return va > 0 && vb > 0 ? (sab - sa * sb / n) / sqrt(va * vb) : 0;
}

int doctor_align(const doctor_maps *maps, const image *aux, doctor_alignment *out)
{
    size_t w = maps->width, h = maps->height;
    float *edges = calloc(w * h, sizeof *edges), *plane = malloc(w * h * sizeof *plane);
    double vertical, horizontal;
    memset(out, 0, sizeof *out);
    if (!edges || !plane) {
        free(edges);
        free(plane);
        return -1;
    }
    for (unsigned c = 0; c < aux->channels; c++) {
        for (size_t i = 0; i < w * h; i++) {
            float v = finite_or_0(image_get(aux, i * aux->channels + c));
            plane[i] = v < -1 ? -1 : v > 1 ? 1 : v;
        }
        add_gradient(edges, plane, w, h);
    }
    limit(edges, w * h);
    out->as_given = out->shifted = correlate(maps, edges, 1, 0, 1, 0);
    for (int dy = -REACH; dy <= REACH; dy++)
        for (int dx = -REACH; dx <= REACH; dx++) {
            double r = correlate(maps, edges, 1, dx, 1, dy);
            if (r > out->shifted) {
                out->shifted = r;
                out->dx = dx;
                out->dy = dy;
            }
        }
    vertical = correlate(maps, edges, 1, 0, -1, (long)h - 1);
    horizontal = correlate(maps, edges, -1, (long)w - 1, 1, 0);
    out->is_vertical = vertical > horizontal;
    out->mirrored = vertical > horizontal ? vertical : horizontal;
    free(edges);
    free(plane);
    return 0;
}
