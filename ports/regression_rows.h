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

LULL_INLINE void fit_sums_block(const lull_fitting *at, const lull_encoding *from, size_t p,
                                unsigned n)
{
    const size_t plane = at->sum_plane;
    float *sums = at->sums + p;
    vec f0 = plane_at(at->normal, at->normal_plane, 0, p, n);
    vec f1 = plane_at(at->normal, at->normal_plane, 1, p, n);
    vec f2 = plane_at(at->normal, at->normal_plane, 2, p, n);
    vec f3 = plane_at(at->smooth, at->smooth_plane, 0, p, n);
    vec f4 = plane_at(at->smooth, at->smooth_plane, 1, p, n);
    vec f5 = plane_at(at->smooth, at->smooth_plane, 2, p, n), r, g, b;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    r = rest_of(at, from, r, 0, f3, p, n);
    g = rest_of(at, from, g, 1, f4, p, n);
    b = rest_of(at, from, b, 2, f5, p, n);
#define ADD(v) add_sum(&sums, plane, v, n)
#define ADD_RESTS(f) ADD(mul(f, r)), ADD(mul(f, g)), ADD(mul(f, b))
    ADD(set(1.0f)), ADD(f0), ADD(f1), ADD(f2), ADD(f3), ADD(f4), ADD(f5), ADD(r), ADD(g), ADD(b);
    ADD(mul(f0, f0)), ADD(mul(f0, f1)), ADD(mul(f0, f2)), ADD(mul(f0, f3)), ADD(mul(f0, f4));
    ADD(mul(f0, f5)), ADD(mul(f1, f1)), ADD(mul(f1, f2)), ADD(mul(f1, f3)), ADD(mul(f1, f4));
    ADD(mul(f1, f5)), ADD(mul(f2, f2)), ADD(mul(f2, f3)), ADD(mul(f2, f4)), ADD(mul(f2, f5));
    ADD(mul(f3, f3)), ADD(mul(f3, f4)), ADD(mul(f3, f5)), ADD(mul(f4, f4)), ADD(mul(f4, f5));
    ADD(mul(f5, f5)), ADD_RESTS(f0), ADD_RESTS(f1), ADD_RESTS(f2), ADD_RESTS(f3), ADD_RESTS(f4);
    ADD_RESTS(f5), ADD(squares(r, g, b));
#undef ADD_RESTS
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
    vec f0, f1, f2, f3, f4, f5, ridge, d0, d1, d2, d3, d4, d5;
    vec s10, s20, s30, s40, s50, s21, s31, s41, s51, s32, s42, s52, s43, s53, s54;
    vec l10, l20, l30, l40, l50, l21, l31, l41, l51, l32, l42, l52, l43, l53, l54;
    out += p;
    at.m = quotient(set(1.0f), sum_at(&at, 0, n));
    f0 = sum_at(&at, 1, n), f1 = sum_at(&at, 2, n), f2 = sum_at(&at, 3, n);
    f3 = sum_at(&at, 4, n), f4 = sum_at(&at, 5, n), f5 = sum_at(&at, 6, n);
    ridge = squares(sum_at(&at, 7, n), sum_at(&at, 8, n), sum_at(&at, 9, n));
    ridge = high(mul(sub(sum_at(&at, 49, n), ridge), set(LULL_THIRD)), set(0.0f));
    ridge = add(set(LULL_RIDGE), mul(set(LULL_RIDGE_OF_NOISE), ridge));
#define COVARIANCE(k, i, j) less(sum_at(&at, k, n), i, j)
#define LESS2(v, a, b, c, d) less(less(v, a, b), c, d)
#define LESS3(v, a, b, c, d, e, f) less(LESS2(v, a, b, c, d), e, f)
#define LESS4(v, a, b, c, d, e, f, g, h) less(LESS3(v, a, b, c, d, e, f), g, h)
#define LESS5(v, a, b, c, d, e, f, g, h, i, j) less(LESS4(v, a, b, c, d, e, f, g, h), i, j)
    d0 = quotient(set(1.0f), add(COVARIANCE(10, f0, f0), ridge));
    s10 = COVARIANCE(11, f0, f1), s20 = COVARIANCE(12, f0, f2), s30 = COVARIANCE(13, f0, f3);
    s40 = COVARIANCE(14, f0, f4), s50 = COVARIANCE(15, f0, f5);
    l10 = mul(s10, d0), l20 = mul(s20, d0), l30 = mul(s30, d0), l40 = mul(s40, d0);
    l50 = mul(s50, d0);
    d1 = quotient(set(1.0f), less(add(COVARIANCE(16, f1, f1), ridge), l10, s10));
    s21 = less(COVARIANCE(17, f1, f2), l20, s10), s31 = less(COVARIANCE(18, f1, f3), l30, s10);
    s41 = less(COVARIANCE(19, f1, f4), l40, s10), s51 = less(COVARIANCE(20, f1, f5), l50, s10);
    l21 = mul(s21, d1), l31 = mul(s31, d1), l41 = mul(s41, d1), l51 = mul(s51, d1);
    d2 = LESS2(add(COVARIANCE(21, f2, f2), ridge), l20, s20, l21, s21);
    d2 = quotient(set(1.0f), d2);
    s32 = LESS2(COVARIANCE(22, f2, f3), l30, s20, l31, s21);
    s42 = LESS2(COVARIANCE(23, f2, f4), l40, s20, l41, s21);
    s52 = LESS2(COVARIANCE(24, f2, f5), l50, s20, l51, s21);
    l32 = mul(s32, d2), l42 = mul(s42, d2), l52 = mul(s52, d2);
    d3 = LESS3(add(COVARIANCE(25, f3, f3), ridge), l30, s30, l31, s31, l32, s32);
    d3 = quotient(set(1.0f), d3);
    s43 = LESS3(COVARIANCE(26, f3, f4), l40, s30, l41, s31, l42, s32);
    s53 = LESS3(COVARIANCE(27, f3, f5), l50, s30, l51, s31, l52, s32);
    l43 = mul(s43, d3), l53 = mul(s53, d3);
    d4 = LESS4(add(COVARIANCE(28, f4, f4), ridge), l40, s40, l41, s41, l42, s42, l43, s43);
    d4 = quotient(set(1.0f), d4);
    s54 = LESS4(COVARIANCE(29, f4, f5), l50, s40, l51, s41, l52, s42, l53, s43);
    l54 = mul(s54, d4);
    d5 = add(COVARIANCE(30, f5, f5), ridge);
    d5 = LESS5(d5, l50, s50, l51, s51, l52, s52, l53, s53, l54, s54);
    d5 = quotient(set(1.0f), d5);
    for (unsigned c = 0; c < 3; c++, out += plane) {
        vec e = sum_at(&at, 7 + c, n), b0 = COVARIANCE(31 + c, f0, e);
        vec b1 = less(COVARIANCE(34 + c, f1, e), l10, b0);
        vec b2 = LESS2(COVARIANCE(37 + c, f2, e), l20, b0, l21, b1);
        vec b3 = LESS3(COVARIANCE(40 + c, f3, e), l30, b0, l31, b1, l32, b2);
        vec b4 = LESS4(COVARIANCE(43 + c, f4, e), l40, b0, l41, b1, l42, b2, l43, b3);
        vec b5 = LESS5(COVARIANCE(46 + c, f5, e), l50, b0, l51, b1, l52, b2, l53, b3, l54, b4);
        b5 = mul(b5, d5);
        b4 = less(mul(b4, d4), l54, b5);
        b3 = LESS2(mul(b3, d3), l43, b4, l53, b5);
        b2 = LESS3(mul(b2, d2), l32, b3, l42, b4, l52, b5);
        b1 = LESS4(mul(b1, d1), l21, b2, l31, b3, l41, b4, l51, b5);
        b0 = LESS5(mul(b0, d0), l10, b1, l20, b2, l30, b3, l40, b4, l50, b5);
        store_n(out, b0, n);
        store_n(out + 3 * plane, b1, n);
        store_n(out + 6 * plane, b2, n);
        store_n(out + 9 * plane, b3, n);
        store_n(out + 12 * plane, b4, n);
        store_n(out + 15 * plane, b5, n);
        b0 = add(add(add(mul(f0, b0), mul(f1, b1)), mul(f2, b2)), mul(f3, b3));
        b0 = add(add(b0, mul(f4, b4)), mul(f5, b5));
        store_n(out + 18 * plane, mul(b0, set(-1.0f)), n);
    }
#undef LESS5
#undef LESS4
#undef LESS3
#undef LESS2
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
    vec f3 = plane_at(r->smooth, r->smooth_plane, 0, p, n);
    vec f4 = plane_at(r->smooth, r->smooth_plane, 1, p, n);
    vec f5 = plane_at(r->smooth, r->smooth_plane, 2, p, n);
    for (unsigned c = 0; c < 3; c++) {
        vec v = plane_at(r->v, r->v_plane, c, p, n);
        vec k = add(mul(f0, coefficient_at(b, plane, c, part)),
                    mul(f1, coefficient_at(b, plane, 3 + c, part)));
        k = add(k, mul(f2, coefficient_at(b, plane, 6 + c, part)));
        k = add(k, mul(f3, coefficient_at(b, plane, 9 + c, part)));
        k = add(k, mul(f4, coefficient_at(b, plane, 12 + c, part)));
        k = add(k, mul(f5, coefficient_at(b, plane, 15 + c, part)));
        k = add(coefficient_at(b, plane, 18 + c, part), k);
        k = low(high(k, set(-LULL_MOST_FIT)), set(LULL_MOST_FIT));
        store_n(r->out + c * r->out_plane + p, add(v, mul(v, k)), n);
    }
}

void NAME(regress)(const lull_regression *r){
#define BLOCK(n) regress_block(r, p, n)
    FOR_BLOCKS(r->pixels)
#undef BLOCK
}
