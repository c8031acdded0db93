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
    const int32_t *start =
        conv->start ? conv->start + p * conv->start_step : (const int32_t *)conv->bias;
    for (; s < conv->wide; s++)
        add_wide(sum, &conv->segment[s], block, p);
    for (unsigned o = 0; o < B; o++)
        sum[o] = ((sum[o] + (1 << conv->wide_shift >> 1)) >> conv->wide_shift) +
                 start[first + o];
    for (; s < conv->segments; s++)
        add_narrow(sum, &conv->segment[s], block, p);
    for (unsigned o = 0; o < n; o++)
        lull_store_scalar(conv->out, at + o, sum[o], conv->multiplier[first + o], conv->out_max);
}

void lull_conv_int_scalar(const lull_conv *conv)
{
    for (unsigned block = 0; block * B < conv->outputs; block++)
        for (unsigned p = 0; p < conv->pixels; p++)
            pixel(conv, block, p);
}

void lull_head_scalar(const lull_conv *conv)
{
    for (unsigned o = 0; o < conv->outputs; o++)
        for (unsigned p = 0; p < conv->pixels; p++) {
            int32_t sum[B] = {0};
            add_narrow(sum, &conv->segment[0], o / B, p);
            lull_store_scalar(conv->out, o * conv->out_step + p,
                              sum[o % B] + ((const int32_t *)conv->bias)[o], conv->multiplier[o],
                              conv->out_max);
        }
}

/* ---- Three outputs: loops over the elements of a run, which compilers make vectors of */

static int32_t dot_wide(const uint16_t *x, const int16_t *w, size_t n)
{
    int32_t sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += x[i] * w[i];
    return sum;
}

static int32_t dot_narrow(const uint8_t *x, const int8_t *w, size_t n)
{
    int32_t sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += x[i] * w[i];
    return sum;
}

static int32_t int3_sum(const lull_conv *conv, size_t p, unsigned o)
{
    int32_t sum = 0;
    for (unsigned s = 0; s < conv->segments; s++) {
        const lull_segment *segment = &conv->segment[s];
        size_t at = p * segment->step, n = segment->length;
        if (s < conv->wide)
            sum += dot_wide((const uint16_t *)segment->row + at,
                            (const int16_t *)segment->weights + o * n * 2, n * 2);
        else
            sum += dot_narrow((const uint8_t *)segment->row + at,
                              (const int8_t *)segment->weights + o * n * 4, n * 4);
        if (s + 1 == conv->wide)
            sum = (sum + (1 << conv->wide_shift >> 1)) >> conv->wide_shift;
    }
    return sum + ((const int32_t *)conv->bias)[o];
}

void lull_conv_int3_scalar(const lull_conv *conv)
{
    for (size_t p = 0; p < conv->pixels; p++)
        for (unsigned o = 0; o < 3; o++)
            lull_store_scalar(conv->out, p * conv->out_step + o, int3_sum(conv, p, o),
                              conv->multiplier[o], conv->out_max);
}
