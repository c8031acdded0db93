/* Image values to network values and back: the common loops. */
#include "curves.h"
#include "port_scalar.h"

void lull_curve_in_scalar(float *values, const lull_curve *curve, size_t n)
{
    curve_in(values, curve, n);
}

void lull_curve_out_scalar(float *values, const lull_curve *curve, size_t n)
{
    curve_out(values, curve, n);
}
