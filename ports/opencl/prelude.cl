/* What stands before all other sources: OpenCL's names for what lib/pixels.h and args.h use, no
 * contraction of products and sums, and tensors. */
#pragma OPENCL FP_CONTRACT OFF

#define uint8_t uchar
#define int32_t int
#define uint32_t uint

#define LULL_INLINE static

static uint lull_bits(float f) { return as_uint(f); }
static float lull_float(uint u) { return as_float(u); }
