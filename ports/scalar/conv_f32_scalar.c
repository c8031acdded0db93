#include "port_scalar.h"

#define B LULL_SCALAR_BLOCK
#define TILE 4u /* pixels computed together */

/* One block of outputs of `pixels` <= TILE pixels from pixel p on. */
static void tile(const lull_conv *conv, unsigned block, unsigned p, unsigned pixels)
{
    float sum[TILE][B];
    unsigned first = block * B, n = lull_min_u(B, conv->outputs - first);
    for (unsigned i = 0; i < TILE; i++)
        for (unsigned o = 0; o < B; o++)
            sum[i][o] = ((const float *)conv->bias)[first + o];
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        const float *w = (const float *)segment->weights + (size_t)block * segment->length * B;
        const float *row = (const float *)segment->row + (size_t)p * segment->step;
        size_t step = pixels == TILE ? segment->step : 0; /* a short tile repeats its first pixel */
        for (unsigned k = 0; k < segment->length; k++, w += B)
            for (unsigned i = 0; i < TILE; i++)
                for (unsigned o = 0; o < B; o++)
                    sum[i][o] += row[i * step + k] * w[o];
    }
    for (unsigned i = 0; i < pixels; i++)
        for (unsigned o = 0; o < n; o++)
            ((float *)conv->out)[(p + i) * conv->out_step + first + o] =
                sum[i][o] > conv->least ? sum[i][o] : conv->least;
}

void lull_conv_f32_scalar(const lull_conv *conv)
{
    for (unsigned block = 0; block * B < conv->outputs; block++) {
        unsigned p = 0;
        for (; p + TILE <= conv->pixels; p += TILE)
            tile(conv, block, p, TILE);
        for (; p < conv->pixels; p++)
            tile(conv, block, p, 1);
    }
}
