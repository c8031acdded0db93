#include "transfer.h"

#include "curves.h"

float lull_log2(float x)
{
    lull_logarithm l = lull_log2_parts(choose(mask_greater(BITS_MIN, signed_bits(x)), FLT_MIN, x));
    return l.whole + l.part;
}

float lull_exp2(float x)
{
    float t = x < 129.0f ? x : 129.0f;
    float n, y;
    t = t > -127.0f ? t : -127.0f;
    n = nearest(t);
    y = scale_wide(1.0f + exp2m1_part(t - n), (int32_t)n);
    return x < -126.0f ? 0.0f : y;
}

/* ---- Loops ----------------------------------------------------------------------------------- */

typedef void block_function(float *values);

#define CURVE(name)                        \
    static void name##_block(float *values) \
    {                                      \
        for (unsigned i = 0; i < BLOCK; ++i)        \
            values[i] = name(values[i]);   \
    }

CURVE(linear)
CURVE(srgb_forward)
CURVE(srgb_inverse)
CURVE(pu_forward)
CURVE(pu_inverse)
CURVE(log_forward)
CURVE(log_inverse)

static block_function *const forward[LULL_TRANSFER_COUNT] = {
    linear_block, srgb_forward_block, pu_forward_block, log_forward_block};
static block_function *const inverse[LULL_TRANSFER_COUNT] = {
    linear_block, srgb_inverse_block, pu_inverse_block, log_inverse_block};

static void apply(block_function *block, float *values, size_t n)
{
    float last[BLOCK] = {0};
    size_t whole = n - n % BLOCK, i;
    for (i = 0; i < whole; i += BLOCK)
        block(values + i);
    if (whole < n) {
        memcpy(last, values + whole, (n - whole) * sizeof *last);
        block(last);
        memcpy(values + whole, last, (n - whole) * sizeof *last);
    }
}

void lull_transfer_forward(lull_transfer transfer, float *values, size_t n)
{
    apply(forward[transfer], values, n);
}

void lull_transfer_inverse(lull_transfer transfer, float *values, size_t n)
{
    apply(inverse[transfer], values, n);
}
