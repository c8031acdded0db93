/* Weights of integer layers for their computation in patches. */
#include "pack.h"

/* The points of a kernel's row or column of three taps, so scaled that few shifts and sums make 24
 * times a pixel's sum of them in each direction. */
static const double side_points[6][3] = {{6, 0, 0}, {-4, -4, -4}, {-4, 4, -4},
                                         {1, 2, 4}, {1, -2, 4},   {0, 0, 6}};

/* On wide codes: twice the sum. */
static const double wide_points[4][3] = {{2, 0, 0}, {1, 1, 1}, {1, -1, 1}, {0, 0, 2}};

int lull_pack_fits_patches(const lull_tza_tensor *weight, unsigned sums, unsigned taps,
                           int is_wide)
{
    int64_t most = is_wide ? LULL_PATCH_WIDE_MAX : 255;
    int64_t limit = is_wide ? LULL_PATCH_WIDE_LIMIT : LULL_PATCH_LIMIT;
    for (unsigned o = 0; o < sums; o++) {
        int64_t sum = 0;
        for (size_t i = 0; i < taps; i++) {
            float w = lull_tza_float(weight, (size_t)o * taps + i);
            sum += (int)(w < 0 ? -w : w);
        }
        if (sum * most >= limit)
            return 0;
    }
    return 1;
}

/* The 3x3 taps of output o on channel c: as they are, or the 2x2 taps of a phase with zeros. */
static void read_taps(double *taps, const lull_tza_tensor *weight, unsigned outputs, unsigned o,
                      unsigned channels, unsigned c, unsigned phase)
{
    unsigned side = phase < LULL_PATCH_WHOLE ? 2 : 3;
    unsigned first = side == 2 ? 3 * (phase >> 1) + (phase & 1) : 0;
    size_t row = side == 2 ? (size_t)phase * outputs + o : o;
    for (unsigned i = 0; i < 9; i++)
        taps[i] = 0;
    for (unsigned i = 0; i < side * side && o < outputs; i++)
        taps[first + i / side * 3 + i % side] =
            (double)lull_tza_float(weight, (row * channels + c) * side * side + i);
}

int16_t *lull_pack_patches(int16_t *out, const lull_tza_tensor *weight, unsigned outputs,
                           unsigned channels, unsigned lanes, unsigned phase, int is_wide)
{
    const double(*side)[3] = is_wide ? wide_points : side_points;
    unsigned n = lull_patch_side(is_wide) + 2, points = 0;
    size_t whole = lull_align_up(outputs, lanes);
    for (unsigned o = 0; o < whole; o++)
        for (unsigned c = 0; c < channels; c++) {
            size_t block = (size_t)(o / lanes) * (channels / 2) + c / 2;
            int16_t *to = out + (block * lanes + o % lanes) * 2 + c % 2;
            double taps[9];
            read_taps(taps, weight, outputs, o, channels, c, phase);
            points = 0;
            for (unsigned k = 0; k < n * n; k++)
                if (!lull_patch_vanishes(phase, k)) /* an integer, at most 12 * 12 * 127 */
                    to[points++ * whole * channels] =
                        (int16_t)lull_pack_point(taps, side[k / n], side[k % n]);
        }
    return out + points * whole * channels;
}
