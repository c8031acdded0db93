/* Winograd's form, channel by channel. */
#include "port_scalar.h"

#define LANES 1u
typedef float vec;

LULL_INLINE vec zeros(void) { return 0.0f; }
LULL_INLINE vec add(vec a, vec b) { return a + b; }
LULL_INLINE vec sub(vec a, vec b) { return a - b; }
LULL_INLINE vec most(vec a, vec b) { return a > b ? a : b; }
LULL_INLINE vec madd(vec x, float k, vec y) { return x * k + y; }
LULL_INLINE vec load(const float *p, unsigned n) { return (void)n, *p; }
LULL_INLINE void store(float *p, vec v, unsigned n) { (void)n, *p = v; }

#define IN lull_winograd_in_scalar
#define OUT lull_winograd_out_scalar
#include "../winograd_rows.h"
