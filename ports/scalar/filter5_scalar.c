#include "port_scalar.h"

void lull_filter5_scalar(const lull_window *window)
{
    for (size_t p = 0; p < window->pixels; p++) {
        const uint8_t *q = window->codes + p * window->code_step;
        float sum[4] = {0};
        for (unsigned y = 0; y < 5; y++) {
            const float *v = window->rows[y] + (ptrdiff_t)p - 2;
            for (unsigned x = 0; x < 5; x++, v++, q += window->code_plane) {
                float w = window->table[*q];
                for (size_t c = 0; c < 4; c++)
                    sum[c] += w * v[c * window->plane];
            }
        }
        for (size_t c = 0; c < 3; c++)
            window->out[c * window->out_plane + p] =
                sum[0] > 0.0f ? sum[c + 1] * (1.0f / sum[0]) + window->more : window->none;
    }
}
