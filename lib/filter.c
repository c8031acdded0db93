#include "filter.h"

uint32_t lull_filter_flags(const lull_encoding *from, int is_clipped)
{
    return (from->albedo ? 0xffu : 0) | (from->normal ? 0xff00u : 0) | (is_clipped ? 0xff0000u : 0);
}

/* Fine pixel i, where coarse pixels beside it may be missing. */
static void blend_pixel(const lull_blending *b, int first, int last, unsigned i)
{
    int x = (int)(i / 2), beside = x + (i & 1 ? 1 : -1);
    x = x > last ? last : x;
    beside = beside > last ? last : beside;
    beside = beside < first ? first : beside;
    for (size_t c = 0; c < 3; c++) {
        const float *near = b->near + c * b->coarse_plane, *far = b->far + c * b->coarse_plane;
        float fine = b->fine[c * b->fine_plane + i];
        float here = 0.75f * near[x] + 0.25f * far[x];
        float there = 0.75f * near[beside] + 0.25f * far[beside];
        float up = 0.75f * here + 0.25f * there;
        b->out[c * b->out_plane + i] = fine + b->table[b->codes[i]] * (up - fine);
    }
}

void lull_filter_blend(const lull_kernels *kernels, const lull_blending *blending, int first,
                       int last, unsigned n)
{
    /* pairs of fine pixels whose coarse pixels are all there: from `begin` on, before `end` */
    unsigned begin = first < 0 ? 0 : (unsigned)first + 1, i;
    unsigned end = last < 0 ? 0 : lull_min_u(n / 2, (unsigned)last);
    lull_blending inside = *blending;
    end = lull_max_u(end, begin);
    for (i = 0; i < lull_min_u(2 * begin, n); i++)
        blend_pixel(blending, first, last, i);
    inside.out += 2 * (size_t)begin;
    inside.fine += 2 * (size_t)begin;
    inside.codes += 2 * (size_t)begin;
    inside.near += begin;
    inside.far += begin;
    inside.pairs = end - begin;
    if (i < n)
        kernels->blend(&inside);
    for (i = lull_max_u(i, 2 * end); i < n; i++)
        blend_pixel(blending, first, last, i);
}
