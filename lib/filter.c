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
        b->out[c * b->out_plane + i] =
            lull_blended(b->fine[c * b->fine_plane + i], b->table[b->codes[i]], near[x], far[x],
                         near[beside], far[beside]);
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

#define REACH LULL_BILATERAL_FAR
#define EDGE 8 /* pixels of an edge at once: a vector of most ports */
#define COLUMNS (EDGE + 2 * REACH)

/* The same from its pixel i on. */
static lull_smoothing smoothing_from(const lull_smoothing *smoothing, int i)
{
    lull_smoothing s = *smoothing;
    s.out += i, s.noise += i;
    s.row.v += i, s.row.guide += 2 * i;
    for (unsigned k = 0; k < lull_bilateral_rows(s.is_far); k++)
        s.beside[k].v += i, s.beside[k].guide += 2 * i;
    return s;
}

/* n <= EDGE pixels from i on, where columns may be missing: the nearest one stands for them. */
LULL_NOINLINE static void smooth_edge(const lull_kernels *kernels, const lull_smoothing *s,
                                      int first, int last, int i, int n)
{
    float v[3 * COLUMNS];
    uint8_t guide[2 * COLUMNS], noise[COLUMNS];
    lull_smoothing part = smoothing_from(s, i);
    for (int d = 0; d < n + 2 * REACH; d++) {
        int x = i + d - REACH;
        x = x < first ? first : x > last ? last : x;
        noise[d] = s->noise[x];
        memcpy(guide + 2 * d, s->row.guide + 2 * (ptrdiff_t)x, 2);
        for (int c = 0; c < 3; c++)
            v[c * COLUMNS + d] = s->row.v[c * (ptrdiff_t)s->row.plane + x];
    }
    part.noise = noise + REACH;
    part.row.v = v + REACH;
    part.row.guide = guide + 2 * REACH;
    part.row.plane = COLUMNS;
    part.pixels = (unsigned)n;
    kernels->bilateral(&part);
}

void lull_filter_bilateral(const lull_kernels *kernels, const lull_smoothing *smoothing, int first,
                           int last, unsigned n)
{
    /* pixels whose columns are all there: from `begin` on, before `end` */
    int all = (int)n, i, reach = lull_bilateral_reach(smoothing->is_far);
    int begin = first + reach < 0 ? 0 : first + reach > all ? all : first + reach;
    int end = last + 1 - reach > all ? all : last + 1 - reach;
    lull_smoothing inside;
    end = end < begin ? begin : end;
    for (i = 0; i < begin; i += EDGE)
        smooth_edge(kernels, smoothing, first, last, i, begin - i < EDGE ? begin - i : EDGE);
    inside = smoothing_from(smoothing, begin);
    inside.pixels = (unsigned)(end - begin);
    if (begin < end)
        kernels->bilateral(&inside);
    for (i = end; i < all; i += EDGE)
        smooth_edge(kernels, smoothing, first, last, i, all - i < EDGE ? all - i : EDGE);
}

/* Exposed radiance of pixel i of a row, and its light. */
LULL_NOINLINE static float light_at(float *p, const lull_edging *e, ptrdiff_t row, ptrdiff_t i)
{
    const float *v = e->v[row] + i, *smooth = e->smooth[row] + i;
    for (size_t c = 0; c < 3; c++, v += e->v_plane, smooth += e->smooth_plane) {
        float product = *v * *smooth;
        p[c] = product > 0.0f ? product : 0.0f;
    }
    return (p[0] + p[1]) + p[2];
}

static void put_pixel(const lull_edging *e, ptrdiff_t i, const float *p)
{
    for (ptrdiff_t c = 0; c < 3; c++)
        e->out[3 * i + c] = lull_sane(p[c], 1.0f, 0.0f, LULL_LARGEST) * e->unscale;
}

void lull_edge_pixel(const lull_edging *e, ptrdiff_t i)
{
    float here[3], ends[3] = {0.0f, 0.0f, 0.0f}, least = LULL_LARGEST, most = 0.0f, share;
    float light = light_at(here, e, 1, i);
    for (unsigned k = 0; k < LULL_EDGE_LINES; k++) {
        ptrdiff_t x = lull_edge_lines[k][0], y = lull_edge_lines[k][1];
        float a[3], b[3], first = light_at(a, e, 1 - y, i - x);
        float change = lull_edge_change(light, first, light_at(b, e, 1 + y, i + x));
        for (unsigned c = 0; change < least && c < 3; c++)
            ends[c] = a[c] + b[c];
        least = change < least ? change : least;
        most = change > most ? change : most;
    }
    share = lull_edge_share(light, least, most, e->strength);
    for (unsigned c = 0; c < 3; c++)
        here[c] += share * (ends[c] - (here[c] + here[c]));
    put_pixel(e, i, here);
}

void lull_filter_product(const lull_edging *e, unsigned first, unsigned last)
{
    for (ptrdiff_t i = first; i <= (ptrdiff_t)last; i++) {
        float p[3];
        light_at(p, e, 1, i);
        put_pixel(e, i, p);
    }
}
