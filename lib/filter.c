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

#define REACH LULL_BILATERAL_REACH
#define COLUMNS (2 * REACH + 1)

/* Pixel i, where columns may be missing: the kernel sees them as pixel i itself. */
static void smooth_pixel(const lull_kernels *kernels, const lull_smoothing *s, int first, int last,
                         int i)
{
    float v[3 * COLUMNS], smooth[3 * COLUMNS];
    uint8_t codes[LULL_BILATERAL_CODES * COLUMNS];
    lull_smoothing one = *s;
    for (int d = 0; d < COLUMNS; d++) {
        int x = i + d - REACH;
        size_t at;
        x = x < first || x > last ? i : x;
        at = (size_t)(x - first);
        for (size_t c = 0; c < 3; c++) {
            v[c * COLUMNS + d] = (s->row.v + first)[c * s->row.v_plane + at];
            smooth[c * COLUMNS + d] = (s->row.smooth + first)[c * s->row.smooth_plane + at];
        }
        for (size_t c = 0; c < LULL_BILATERAL_CODES; c++)
            codes[c * COLUMNS + d] = (s->row.codes + first)[c * s->row.code_plane + at];
    }
    one.out += i;
    one.row.v = v + REACH;
    one.row.smooth = smooth + REACH;
    one.row.codes = codes + REACH;
    one.row.v_plane = one.row.smooth_plane = one.row.code_plane = COLUMNS;
    for (unsigned k = 0; k < 4; k++) {
        one.beside[k].v += i;
        one.beside[k].smooth += i;
        one.beside[k].codes += i;
    }
    one.pixels = 1;
    kernels->bilateral(&one);
}

void lull_filter_bilateral(const lull_kernels *kernels, const lull_smoothing *smoothing, int first,
                           int last, unsigned n)
{
    int begin = first + REACH < 0 ? 0 : first + REACH, end = last + 1 - REACH, i;
    lull_smoothing inside = *smoothing;
    lull_surface *rows[] = {&inside.row, inside.beside, inside.beside + 1, inside.beside + 2,
                            inside.beside + 3};
    end = end > (int)n ? (int)n : end;
    for (i = 0; i < (int)n && i < begin; i++)
        smooth_pixel(kernels, smoothing, first, last, i);
    if (i < end) {
        inside.out += i;
        inside.pixels = (unsigned)(end - i);
        for (unsigned k = 0; k < 5; k++) {
            rows[k]->v += i;
            rows[k]->smooth += i;
            rows[k]->codes += i;
        }
        kernels->bilateral(&inside);
        i = end;
    }
    for (; i < (int)n; i++)
        smooth_pixel(kernels, smoothing, first, last, i);
}
