#include "port_scalar.h"

#define B LULL_SCALAR_BLOCK

/* Sums of one block over one segment. */
static void add_wide(int32_t *sum, const lull_segment *segment, unsigned block, unsigned p)
{
    const int16_t *w = (const int16_t *)segment->weights + (size_t)block * segment->length * B * 2;
    const uint16_t *x = (const uint16_t *)segment->row + (size_t)p * segment->step;
    for (unsigned k = 0; k < segment->length; k++, w += 2 * B, x += 2)
        for (unsigned o = 0; o < B; o++)
            sum[o] += x[0] * w[2 * o] + x[1] * w[2 * o + 1];
}

static void add_narrow(int32_t *sum, const lull_segment *segment, unsigned block, unsigned p)
{
    const int8_t *w = (const int8_t *)segment->weights + (size_t)block * segment->length * B * 4;
    const uint8_t *x = (const uint8_t *)segment->row + (size_t)p * segment->step;
    for (unsigned k = 0; k < segment->length; k++, w += 4 * B, x += 4)
        for (unsigned o = 0; o < B; o++)
            sum[o] += x[0] * w[4 * o] + x[1] * w[4 * o + 1] + x[2] * w[4 * o + 2] +
                      x[3] * w[4 * o + 3];
}

static void pixel(const lull_conv *conv, unsigned block, unsigned p)
{
    int32_t sum[B] = {0};
    unsigned first = block * B, n = lull_min_u(B, conv->outputs - first), s = 0;
    size_t at = p * conv->out_step + first;
    for (; s < conv->wide; s++)
        add_wide(sum, &conv->segment[s], block, p);
    for (unsigned o = 0; o < B; o++)
        sum[o] = ((sum[o] + (1 << conv->wide_shift >> 1)) >> conv->wide_shift) +
                 ((const int32_t *)conv->bias)[first + o];
    for (; s < conv->segments; s++)
        add_narrow(sum, &conv->segment[s], block, p);
    for (unsigned o = 0; o < n; o++) {
        int64_t q = ((int64_t)sum[o] * conv->multiplier[first + o] + (1 << 30)) >> 31;
        q = q < 0 ? 0 : q > conv->out_max ? conv->out_max : q;
        if (conv->out_max <= 255)
            ((uint8_t *)conv->out)[at + o] = (uint8_t)q;
        else
            ((uint16_t *)conv->out)[at + o] = (uint16_t)q;
    }
}

void lull_conv_int_scalar(const lull_conv *conv)
{
    for (unsigned block = 0; block * B < conv->outputs; block++)
        for (unsigned p = 0; p < conv->pixels; p++)
            pixel(conv, block, p);
}
