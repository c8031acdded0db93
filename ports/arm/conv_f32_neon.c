/* fp32 convolution: vectors over 4 output channels, rows read a few elements at a time and
 * multiplied lane by lane. */
#include "port_neon.h"
#include "tiles.h"

#if defined(__aarch64__)
#define GROUP 4u
typedef float32x4_t group;
#define EACH(X) X(0) X(1) X(2) X(3)
#define MADD(sum, w, x, j) vfmaq_laneq_f32(sum, w, x, j)
LULL_INLINE group load_group(const float *p) { return vld1q_f32(p); }
LULL_INLINE group splat(const float *p) { return vld1q_dup_f32(p); }
#else
#define GROUP 2u
typedef float32x2_t group;
#define EACH(X) X(0) X(1)
#define MADD(sum, w, x, j) vmlaq_lane_f32(sum, w, x, j)
LULL_INLINE group load_group(const float *p) { return vld1_f32(p); }
LULL_INLINE group splat(const float *p) { return vld1_dup_f32(p); }
#endif

/* The maximum of v and least; the first n lanes if n < LANES. */
LULL_INLINE void store(float *out, float32x4_t v, unsigned n, float32x4_t least)
{
    v = vmaxq_f32(v, least);
    if (n >= LANES) {
        vst1q_f32(out, v);
        return;
    }
    vst1q_lane_f32(out, v, 0);
    if (n > 1)
        vst1q_lane_f32(out + 1, v, 1);
    if (n > 2)
        vst1q_lane_f32(out + 2, v, 2);
}

#if defined(__aarch64__)
#define TILE tile_4
#define VECTORS 4
#define PIXELS 4
#include "conv_f32_tile.h"

#define TILE tile_2
#define VECTORS 2
#define PIXELS 8
#include "conv_f32_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 8
#include "conv_f32_tile.h"
#else
#define TILE tile_2
#define VECTORS 2
#define PIXELS 4
#include "conv_f32_tile.h"

#define TILE tile_1
#define VECTORS 1
#define PIXELS 6
#include "conv_f32_tile.h"
#endif

#define TILE pixel_1
#define VECTORS 1
#define PIXELS 1
#include "conv_f32_tile.h"

static const tile_shape shapes[] = {
#if defined(__aarch64__)
    {tile_4, 4, 4}, {tile_2, 2, 8}, {tile_1, 1, 8}, {pixel_1, 1, 1},
#else
    {tile_2, 2, 4}, {tile_1, 1, 6}, {pixel_1, 1, 1},
#endif
};

void lull_conv_f32_neon(const lull_conv *conv)
{
    unsigned first = 0;
    while (first < conv->outputs) {
        const tile_shape *shape = choose_shape(shapes, conv->outputs - first, conv->pixels);
        unsigned n = lull_min_u(conv->outputs - first, shape->vectors * LANES);
        run_row(conv, shape, (const float *)conv->bias + first, first, n);
        first += shape->vectors * LANES;
    }
}
