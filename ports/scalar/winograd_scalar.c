#include "port_scalar.h"

/* The lines of points: sums or differences of two of the four rows. */
static const struct {
    uint8_t first, second;
    float sign;
} lines[4] = {{0, 2, -1.0f}, {1, 2, 1.0f}, {2, 1, -1.0f}, {1, 3, -1.0f}};

/* Six points of one line of a patch, for each channel: a and b are its rows. */
static void make_line(float *LULL_RESTRICT to, size_t plane, const float *a, const float *b,
                      float sign, unsigned channels, unsigned is_up)
{
    size_t column[6];
    for (unsigned i = 0; i < 6; i++)
        column[i] = (size_t)(is_up ? (i + 1) / 2 : i) * channels;
    for (unsigned c = 0; c < channels; c++) {
        float d[6], u, v, e, f;
        for (unsigned i = 0; i < 6; i++)
            d[i] = a[column[i] + c] + sign * b[column[i] + c];
        u = d[4] - d[2];
        v = d[3] - d[1];
        e = d[4] - 4.0f * d[2];
        f = d[3] - 4.0f * d[1];
        to[c] = u + 4.0f * (d[0] - d[2]);
        to[plane + c] = e + f;
        to[3 * plane + c] = u + 2.0f * v;
        to[4 * plane + c] = u - 2.0f * v;
        to[5 * plane + c] = (d[5] - d[3]) - 4.0f * v;
        if (!is_up)
            to[2 * plane + c] = e - f;
    }
}

void lull_winograd_in_scalar(const lull_winograd *image)
{
    unsigned columns = image->is_up ? LULL_WINOGRAD_COLUMNS / 2 : LULL_WINOGRAD_COLUMNS;
    for (unsigned p = 0; p < image->patches; p++) {
        size_t at = (size_t)p * columns * image->channels;
        for (unsigned i = 0; i < 4; i++)
            if (!image->is_up || i != 2)
                make_line(image->points + 6 * i * image->plane + (size_t)p * image->channels,
                          image->plane, image->row[lines[i].first] + at,
                          image->row[lines[i].second] + at, lines[i].sign, image->channels,
                          image->is_up);
    }
}

static float positive(float v) { return v > 0.0f ? v : 0.0f; }

/* Four pixels of row `second` of a patch, one channel. */
static void make_pixels(float y[4], const float *m, size_t plane, unsigned second)
{
    float t[6], s, d, big_s, big_d;
    for (unsigned i = 0; i < 6; i++, m += plane)
        t[i] = second ? (m[6 * plane] - m[12 * plane]) - m[18 * plane]
                      : (m[0] + m[6 * plane]) + m[12 * plane];
    s = t[1] + t[2];
    d = t[1] - t[2];
    big_s = t[3] + t[4];
    big_d = t[3] - t[4];
    y[0] = (t[0] + s) + big_s;
    y[1] = d + 2.0f * big_d;
    y[2] = s + 4.0f * big_s;
    y[3] = (d + 8.0f * big_d) + t[5];
}

void lull_winograd_out_scalar(const lull_winograd *image)
{
    unsigned n = image->channels, columns = image->out[1] ? 4 : 2;
    for (unsigned p = 0; p < image->patches; p++)
        for (unsigned c = 0; c < n; c++) {
            const float *m = image->points + (size_t)p * n + c;
            size_t at = (size_t)p * columns * n + c;
            float y[2][4];
            make_pixels(y[0], m, image->plane, 0);
            make_pixels(y[1], m, image->plane, 1);
            for (unsigned i = 0; i < 4; i++) {
                if (image->out[1]) {
                    image->out[0][at + i * n] = positive(y[0][i]);
                    image->out[1][at + i * n] = positive(y[1][i]);
                } else if (i % 2 == 0) {
                    float a = y[0][i] > y[0][i + 1] ? y[0][i] : y[0][i + 1];
                    float b = y[1][i] > y[1][i + 1] ? y[1][i] : y[1][i + 1];
                    image->out[0][at + i / 2 * n] = positive(a > b ? a : b);
                }
            }
        }
}
