/* Step 7 of family K's filter, LANES pixels or cells at a time: products and sums are rounded one
 * by one, in the order of the definition (pixels.h). After bilateral_rows.h, whose operations it
 * uses, and
 *
 *   around(p, &before, &after)      of lanes 4 i to 4 i + 3, p[(i + 1) / 2] and the one after it
 */

/* Adds to the sums of n pixels, and goes on to the next plane. */
LULL_INLINE void add_sum(float **sums, size_t plane, vec v, unsigned n)
{
    store_n(*sums, add(load_n(*sums, n), v), n);
    *sums += plane;
}

/* What the input has and the result has not, of pixels from p on of one channel. */
LULL_INLINE vec rest_of(const lull_fitting *at, const lull_encoding *from, vec radiance, unsigned c,
                        vec smooth, size_t p, unsigned n)
{
    vec v = mul(plane_at(at->v, at->v_plane, c, p, n), smooth);
    vec share = quotient(set(1.0f), add(v, set(LULL_FIT_EPSILON)));
    return low(mul(sub(sane_radiance(radiance, from), v), share), set(LULL_FIT_MOST_REST));
}

LULL_INLINE vec mean_of(vec r, vec g, vec b) { return mul(add(add(r, g), b), set(LULL_THIRD)); }

LULL_INLINE void fit_sums_block(const lull_fitting *at, const lull_encoding *from, size_t p,
                                unsigned n)
{
    const size_t plane = at->sum_plane;
    float *sums = at->sums + p;
    vec s0 = plane_at(at->smooth, at->smooth_plane, 0, p, n);
    vec s1 = plane_at(at->smooth, at->smooth_plane, 1, p, n);
    vec s2 = plane_at(at->smooth, at->smooth_plane, 2, p, n);
    vec f0 = plane_at(at->normal, at->normal_plane, 0, p, n);
    vec f1 = plane_at(at->normal, at->normal_plane, 1, p, n);
    vec f2 = plane_at(at->normal, at->normal_plane, 2, p, n), f3 = mean_of(s0, s1, s2), r, g, b;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    r = rest_of(at, from, r, 0, s0, p, n);
    g = rest_of(at, from, g, 1, s1, p, n);
    b = rest_of(at, from, b, 2, s2, p, n);
#define ADD(v) add_sum(&sums, plane, v, n)
    ADD(set(1.0f)), ADD(f0), ADD(f1), ADD(f2), ADD(f3), ADD(r), ADD(g), ADD(b);
    ADD(mul(f0, f0)), ADD(mul(f0, f1)), ADD(mul(f0, f2)), ADD(mul(f0, f3)), ADD(mul(f1, f1));
    ADD(mul(f1, f2)), ADD(mul(f1, f3)), ADD(mul(f2, f2)), ADD(mul(f2, f3)), ADD(mul(f3, f3));
    ADD(mul(f0, r)), ADD(mul(f0, g)), ADD(mul(f0, b)), ADD(mul(f1, r)), ADD(mul(f1, g));
    ADD(mul(f1, b)), ADD(mul(f2, r)), ADD(mul(f2, g)), ADD(mul(f2, b)), ADD(mul(f3, r));
    ADD(mul(f3, g)), ADD(mul(f3, b)), ADD(squares(r, g, b));
#undef ADD
}

void NAME(fit_sums)(const lull_fitting *at, const lull_encoding *from){
#define BLOCK(n) fit_sums_block(at, from, p, n)
    FOR_BLOCKS(at->pixels)
#undef BLOCK
}

/* Sums around n cells, times m. */
typedef struct cell_sums {
    const float *rows[3];
    size_t plane;
    vec m;
} cell_sums;

LULL_INLINE vec column_at(const cell_sums *at, unsigned k, ptrdiff_t beside, unsigned n)
{
    const ptrdiff_t i = (ptrdiff_t)(k * at->plane) + beside;
    vec here = load_n(at->rows[1] + i, n);
    return add(add(load_n(at->rows[0] + i, n), load_n(at->rows[2] + i, n)), add(here, here));
}

LULL_INLINE vec sum_at(const cell_sums *at, unsigned k, unsigned n)
{
    vec here = column_at(at, k, 0, n);
    here = add(here, here);
    return mul(add(add(column_at(at, k, -1, n), column_at(at, k, 1, n)), here), at->m);
}

/* a - b c. */
LULL_INLINE vec less(vec a, vec b, vec c) { return sub(a, mul(b, c)); }

/* lull_fit of n cells from p on, without arrays. */
LULL_INLINE void fit_block(float *out, size_t plane, const float *const *rows, size_t sum_plane,
                           size_t p, unsigned n)
{
    cell_sums at = {{rows[0] + p, rows[1] + p, rows[2] + p}, sum_plane, set(1.0f)};
    vec f0, f1, f2, f3, ridge, s10, s20, s30, s21, s31, s32, d0, d1, d2, d3;
    vec l10, l20, l30, l21, l31, l32;
    out += p;
    at.m = quotient(set(1.0f), sum_at(&at, 0, n));
    f0 = sum_at(&at, 1, n), f1 = sum_at(&at, 2, n), f2 = sum_at(&at, 3, n), f3 = sum_at(&at, 4, n);
    ridge = squares(sum_at(&at, 5, n), sum_at(&at, 6, n), sum_at(&at, 7, n));
    ridge = high(mul(sub(sum_at(&at, 30, n), ridge), set(LULL_THIRD)), set(0.0f));
    ridge = add(set(LULL_RIDGE), mul(set(LULL_RIDGE_OF_NOISE), ridge));
#define COVARIANCE(k, i, j) less(sum_at(&at, k, n), i, j)
    d0 = quotient(set(1.0f), add(COVARIANCE(8, f0, f0), ridge));
    s10 = COVARIANCE(9, f0, f1), s20 = COVARIANCE(10, f0, f2), s30 = COVARIANCE(11, f0, f3);
    l10 = mul(s10, d0), l20 = mul(s20, d0), l30 = mul(s30, d0);
    d1 = quotient(set(1.0f), less(add(COVARIANCE(12, f1, f1), ridge), l10, s10));
    s21 = less(COVARIANCE(13, f1, f2), l20, s10), s31 = less(COVARIANCE(14, f1, f3), l30, s10);
    l21 = mul(s21, d1), l31 = mul(s31, d1);
    d2 = less(less(add(COVARIANCE(15, f2, f2), ridge), l20, s20), l21, s21);
    d2 = quotient(set(1.0f), d2);
    s32 = less(less(COVARIANCE(16, f2, f3), l30, s20), l31, s21);
    l32 = mul(s32, d2);
    d3 = less(less(less(add(COVARIANCE(17, f3, f3), ridge), l30, s30), l31, s31), l32, s32);
    d3 = quotient(set(1.0f), d3);
    for (unsigned c = 0; c < 3; c++, out += plane) {
        vec e = sum_at(&at, 5 + c, n), b0 = COVARIANCE(18 + c, f0, e);
        vec b1 = less(COVARIANCE(21 + c, f1, e), l10, b0);
        vec b2 = less(less(COVARIANCE(24 + c, f2, e), l20, b0), l21, b1);
        vec b3 = less(less(less(COVARIANCE(27 + c, f3, e), l30, b0), l31, b1), l32, b2);
        b3 = mul(b3, d3);
        b2 = less(mul(b2, d2), l32, b3);
        b1 = less(less(mul(b1, d1), l21, b2), l31, b3);
        b0 = less(less(less(mul(b0, d0), l10, b1), l20, b2), l30, b3);
        store_n(out, b0, n);
        store_n(out + 3 * plane, b1, n);
        store_n(out + 6 * plane, b2, n);
        store_n(out + 9 * plane, b3, n);
        b0 = add(add(add(mul(f0, b0), mul(f1, b1)), mul(f2, b2)), mul(f3, b3));
        store_n(out + 12 * plane, mul(b0, set(-1.0f)), n);
    }
#undef COVARIANCE
}

LULL_NOINLINE static void fit_rest(float *out, size_t plane, const float *const *rows,
                                   size_t sum_plane, size_t p, unsigned n)
{
    fit_block(out, plane, rows, sum_plane, p, n % LANES); /* none are asked whether all are there */
}

void NAME(fit)(float *out, size_t out_plane, const float *const *rows, size_t plane, unsigned cells)
{
    size_t p = 0;
    for (; p + LANES <= cells; p += LANES)
        fit_block(out, out_plane, rows, plane, p, LANES);
    if (p < cells)
        fit_rest(out, out_plane, rows, plane, p, (unsigned)(cells - p));
}

LULL_INLINE vec coefficient_at(const float *b, size_t plane, unsigned k, vec part)
{
    vec before, after;
    around(b + k * plane, &before, &after);
    return add(before, mul(part, sub(after, before)));
}

LULL_INLINE void regress_block(const lull_regression *r, size_t p, unsigned n)
{
    static const float parts[24] = {0.0625f, 0.1875f, 0.3125f, 0.4375f, 0.5625f, 0.6875f,
                                    0.8125f, 0.9375f, 0.0625f, 0.1875f, 0.3125f, 0.4375f,
                                    0.5625f, 0.6875f, 0.8125f, 0.9375f, 0.0625f, 0.1875f,
                                    0.3125f, 0.4375f, 0.5625f, 0.6875f, 0.8125f, 0.9375f};
    const float *b = r->coefficients + (p + LULL_FIT_SIDE / 2) / LULL_FIT_SIDE;
    const size_t plane = r->plane;
    vec part = load_n(parts + (p + LULL_FIT_SIDE / 2) % LULL_FIT_SIDE, LANES);
    vec f0 = plane_at(r->normal, r->normal_plane, 0, p, n);
    vec f1 = plane_at(r->normal, r->normal_plane, 1, p, n);
    vec f2 = plane_at(r->normal, r->normal_plane, 2, p, n);
    vec f3 = mean_of(plane_at(r->smooth, r->smooth_plane, 0, p, n),
                     plane_at(r->smooth, r->smooth_plane, 1, p, n),
                     plane_at(r->smooth, r->smooth_plane, 2, p, n));
    for (unsigned c = 0; c < 3; c++) {
        vec v = plane_at(r->v, r->v_plane, c, p, n);
        vec k = add(mul(f0, coefficient_at(b, plane, c, part)),
                    mul(f1, coefficient_at(b, plane, 3 + c, part)));
        k = add(k, mul(f2, coefficient_at(b, plane, 6 + c, part)));
        k = add(k, mul(f3, coefficient_at(b, plane, 9 + c, part)));
        k = add(coefficient_at(b, plane, 12 + c, part), k);
        k = low(high(k, set(-LULL_MOST_FIT)), set(LULL_MOST_FIT));
        store_n(r->out + c * r->out_plane + p, add(v, mul(v, k)), n);
    }
}

void NAME(regress)(const lull_regression *r){
#define BLOCK(n) regress_block(r, p, n)
    FOR_BLOCKS(r->pixels)
#undef BLOCK
}
