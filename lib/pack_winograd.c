/* Weights in Winograd's form. */
#include "pack.h"

/* Points of a kernel's column of three taps, and of its row. */
static const double column_points[4][3] = {
    {1, 0, 0}, {1.0 / 2, 1.0 / 2, 1.0 / 2}, {1.0 / 2, -1.0 / 2, 1.0 / 2}, {0, 0, 1}};
static const double row_points[6][3] = {{1.0 / 4, 0, 0},
                                        {-1.0 / 6, -1.0 / 6, -1.0 / 6},
                                        {-1.0 / 6, 1.0 / 6, -1.0 / 6},
                                        {1.0 / 24, 1.0 / 12, 1.0 / 6},
                                        {1.0 / 24, -1.0 / 12, 1.0 / 6},
                                        {0, 0, 1}};

double lull_pack_point(const double *taps, const double *column, const double *row)
{
    double sum = 0;
    for (unsigned y = 0; y < 3; y++)
        sum += column[y] *
               (row[0] * taps[3 * y] + row[1] * taps[3 * y + 1] + row[2] * taps[3 * y + 2]);
    return sum;
}

void lull_pack_winograd(float *out, const lull_tza_tensor *weight, unsigned outputs,
                        unsigned channels, unsigned offset, unsigned lanes, int is_up)
{
    size_t whole = lull_align_up(outputs, lanes);
    for (unsigned o = 0; o < whole; o++)
        for (unsigned c = 0; c < channels; c++) {
            float *to = out + ((size_t)(o / lanes) * channels + c) * lanes + o % lanes;
            double taps[9] = {0};
            for (unsigned i = 0; i < 9 && o < outputs; i++)
                taps[i] = (double)lull_tza_float(
                    weight, ((size_t)o * weight->dims[1] + offset + c) * 9 + i);
            for (unsigned k = 0; k < LULL_WINOGRAD_POINTS; k++)
                if (!is_up || !lull_winograd_vanishes(k)) {
                    *to = (float)lull_pack_point(taps, column_points[k / 6], row_points[k % 6]);
                    to += whole * channels;
                }
        }
}
