/* Image values to network values and back: the common loops, compiled for this instruction set. */
#include "curves.h"
#include "port_avx512.h"

void lull_curve_in_avx512(float *values, const lull_curve *curve, size_t n)
{
    curve_in(values, curve, n);
}

void lull_curve_out_avx512(float *values, const lull_curve *curve, size_t n)
{
    curve_out(values, curve, n);
}
