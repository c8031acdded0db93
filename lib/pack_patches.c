/* Weights of integer layers for their computation in patches. */
#include "pack.h"

/* The points of a kernel's row or column of three taps, so scaled that few shifts and sums make 24
 * times a pixel's sum of them in each direction. */
static const double side_points[6][3] = {{6, 0, 0}, {-4, -4, -4}, {-4, 4, -4},
                                         {1, 2, 4}, {1, -2, 4},   {0, 0, 6}};

int lull_pack_fits_patches(const lull_tza_tensor *weight, unsigned outputs, unsigned channels)
{
    for (unsigned o = 0; o < outputs; o++) {
        int64_t sum = 0;
        for (size_t i = 0; i < (size_t)9 * channels; i++) {
            float w = lull_tza_float(weight, (size_t)o * 9 * channels + i);
            sum += (int)(w < 0 ? -w : w);
        }
        if (sum * 255 >= LULL_PATCH_LIMIT)
            return 0;
    }
    return 1;
}

void lull_pack_patches(int16_t *out, const lull_tza_tensor *weight, unsigned outputs,
                       unsigned channels, unsigned lanes)
{
    size_t whole = lull_align_up(outputs, lanes);
    for (unsigned o = 0; o < whole; o++)
        for (unsigned c = 0; c < channels; c++) {
            size_t block = (size_t)(o / lanes) * (channels / 2) + c / 2;
            int16_t *to = out + (block * lanes + o % lanes) * 2 + c % 2;
            double taps[9] = {0};
            for (unsigned i = 0; i < 9 && o < outputs; i++)
                taps[i] = (double)lull_tza_float(weight, ((size_t)o * channels + c) * 9 + i);
            for (unsigned k = 0; k < LULL_PATCH_POINTS; k++, to += whole * channels)
                /* an integer, at most 12 * 12 * 127 */
                *to = (int16_t)lull_pack_point(taps, side_points[k / 6], side_points[k % 6]);
        }
}
