/* Outline: the columns of a bin are summed down its rows side by side, then across as a tree.
 * Sums of logarithms are compensated (Kahan), so the scale of a large image keeps its precision. */
#include "exposure.h"

#include <float.h>

#include "image.h"
#include "kernels.h"
#include "transfer.h"

#define BIN 16u
#define BINS 8u  /* summed together */
#define KEY 0.18f      /* the grey that the mean is brought to */
#define DARKEST 1e-8f  /* bins from here down do not count */
#define INFINITE UINT32_C(0x7f800000)

typedef struct total {
    float sum, lost;
    uint32_t bins, infinite; /* bins counted; those among them with an infinite logarithm */
} total;

static unsigned bins_of(unsigned size) { return size / BIN + (size % BIN != 0); }

unsigned lull_exposure_rows(unsigned height) { return bins_of(height); }

/* First pixel of bin `index` of `bins` over `size` pixels. */
static unsigned edge(unsigned index, unsigned size, unsigned bins)
{
    return (unsigned)((uint64_t)index * size / bins);
}

static void add(total *t, float value, uint32_t bins)
{
    t->bins += bins;
    if (lull_bits(value) == INFINITE) {
        ++t->infinite;
    } else {
        float corrected = value - t->lost, sum = t->sum + corrected;
        t->lost = (sum - t->sum) - corrected;
        t->sum = sum;
    }
}

static float scale_of(const total *t)
{
    if (t->bins == 0)
        return 1.0f;
    if (t->infinite)
        return 0.0f;
    return KEY / lull_exp2(t->sum / (float)t->bins);
}

/* Mean luminance of n columns of sums over `rows` rows. */
static float mean_of(const float *sums, unsigned n, unsigned rows)
{
    float column[BIN] = {0};
    unsigned x, step;
    memcpy(column, sums, n * sizeof *sums);
    for (step = BIN / 2; step > 0; step /= 2)
        for (x = 0; x < step; ++x)
            column[x] += column[x + step];
    return column[0] / (float)(n * rows);
}

/* Adds the bins [bin, end) of rows [y0, y1); no more bins than BINS. */
static void add_bins(total *t, const lull_image *color, unsigned width, unsigned bin, unsigned end,
                     unsigned y0, unsigned y1, lull_luminance *luminance)
{
    unsigned columns = bins_of(width), x0 = edge(bin, width, columns), y, i;
    float pixels[3 * BIN], sums[BINS * BIN] = {0};
    for (y = y0; y < y1; ++y) {
        unsigned n = edge(end, width, columns) - x0, done, count;
        const float *row = lull_image_floats(color, width, x0, y);
        if (row)
            luminance(sums, row, n);
        for (done = 0; !row && done < n; done += count) {
            count = lull_min_u(BIN, n - done);
            lull_image_load(pixels, color, width, x0 + done, y, count);
            luminance(sums + done, pixels, count);
        }
    }
    for (i = bin; i < end; ++i) {
        unsigned x = edge(i, width, columns);
        float mean = mean_of(sums + (x - x0), edge(i + 1, width, columns) - x, y1 - y0);
        if (mean > DARKEST)
            add(t, lull_bits(mean) == INFINITE ? mean : lull_log2(mean), 1);
    }
}

void lull_exposure_bin_row(lull_exposure_row *result, const lull_image *color, unsigned width,
                           unsigned height, unsigned row, lull_luminance *luminance)
{
    total t = {0, 0, 0, 0};
    unsigned columns = bins_of(width), rows = bins_of(height), i;
    unsigned y0 = edge(row, height, rows), y1 = edge(row + 1, height, rows);
    for (i = 0; i < columns; i += BINS)
        add_bins(&t, color, width, i, lull_min_u(i + BINS, columns), y0, y1, luminance);
    result->log_sum = t.infinite ? lull_float(INFINITE) : t.sum;
    result->bins = t.bins;
}

float lull_exposure_scale(const lull_exposure_row *rows, unsigned n)
{
    total t = {0, 0, 0, 0};
    unsigned i;
    for (i = 0; i < n; ++i)
        add(&t, rows[i].log_sum, rows[i].bins);
    return scale_of(&t);
}

float lull_autoexposure(const lull_image *color, unsigned width, unsigned height)
{
    total t = {0, 0, 0, 0};
    unsigned rows = bins_of(height), i;
    lull_kernels kernels;
    if (color == NULL || color->data == NULL || width == 0)
        return 1.0f;
    lull_kernels_fill(&kernels, lull_ports_available());
    for (i = 0; i < rows; ++i) {
        lull_exposure_row row;
        lull_exposure_bin_row(&row, color, width, height, i, kernels.luminance);
        add(&t, row.log_sum, row.bins);
    }
    return scale_of(&t);
}
