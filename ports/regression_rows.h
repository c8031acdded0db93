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

/* Vector k of memory. */
LULL_INLINE vec get(const float *v, unsigned k) { return load_n(v + (size_t)k * LANES, LANES); }
LULL_INLINE void put(float *v, unsigned k, vec to) { store_n(v + (size_t)k * LANES, to, LANES); }

enum { FEATURES = LULL_FIT_FEATURES };

/* What lull_fit has as arrays, LANES floats each. */
typedef struct fit_work {
    float *f, *inverse, *lower, *scaled, *b;
} fit_work;

/* Cholesky factors of the covariance of w->f, by rows. */
LULL_INLINE void factor(const fit_work *w, const cell_sums *at, vec ridge, unsigned n)
{
    for (unsigned i = 0, k = LULL_FIT_SQUARES; i < FEATURES; i++) {
        for (unsigned j = i; j < FEATURES; j++, k++) {
            vec a = less(sum_at(at, k, n), get(w->f, i), get(w->f, j));
            if (i == j)
                a = add(a, ridge);
            for (unsigned t = 0; t < i; t++)
                a = less(a, get(w->lower, FEATURES * j + t), get(w->scaled, FEATURES * i + t));
            put(w->scaled, FEATURES * j + i, a);
        }
        put(w->inverse, i, quotient(set(1.0f), get(w->scaled, FEATURES * i + i)));
        for (unsigned j = i + 1; j < FEATURES; j++)
            put(w->lower, FEATURES * j + i,
                mul(get(w->scaled, FEATURES * j + i), get(w->inverse, i)));
    }
}

/* Coefficients of channel c. */
LULL_INLINE void solve(float *out, size_t plane, const fit_work *w, const cell_sums *at, unsigned c,
                       unsigned n)
{
    vec e = sum_at(at, LULL_FIT_RESTS + c, n), all;
    for (unsigned i = 0; i < FEATURES; i++) {
        vec b = less(sum_at(at, LULL_FIT_MIXED + 3 * i + c, n), get(w->f, i), e);
        for (unsigned t = 0; t < i; t++)
            b = less(b, get(w->lower, FEATURES * i + t), get(w->b, t));
        put(w->b, i, b);
    }
    for (unsigned i = FEATURES; i-- > 0;) {
        vec b = mul(get(w->b, i), get(w->inverse, i));
        for (unsigned t = i + 1; t < FEATURES; t++)
            b = less(b, get(w->lower, FEATURES * t + i), get(w->b, t));
        put(w->b, i, b);
        store_n(out + (3 * i + c) * plane, b, n);
    }
    all = mul(get(w->f, 0), get(w->b, 0));
    for (unsigned i = 1; i < FEATURES; i++)
        all = add(all, mul(get(w->f, i), get(w->b, i)));
    store_n(out + (3 * FEATURES + c) * plane, mul(all, set(-1.0f)), n);
}

/* lull_fit of n cells from p on. */
LULL_NOINLINE static void fit_block(float *out, size_t plane, const float *const *rows,
                                    size_t sum_plane, size_t p, unsigned n, float *work)
{
    cell_sums at = {{rows[0] + p, rows[1] + p, rows[2] + p}, sum_plane, set(1.0f)};
    fit_work w;
    vec ridge;
    w.f = work;
    w.inverse = w.f + (size_t)FEATURES * LANES;
    w.lower = w.inverse + (size_t)FEATURES * LANES;
    w.scaled = w.lower + (size_t)FEATURES * FEATURES * LANES;
    w.b = w.scaled + (size_t)FEATURES * FEATURES * LANES;
    at.m = quotient(set(1.0f), sum_at(&at, 0, n));
    for (unsigned i = 0; i < FEATURES; i++)
        put(w.f, i, sum_at(&at, 1 + i, n));
    ridge = squares(sum_at(&at, LULL_FIT_RESTS, n), sum_at(&at, LULL_FIT_RESTS + 1, n),
                    sum_at(&at, LULL_FIT_RESTS + 2, n));
    ridge = high(mul(sub(sum_at(&at, LULL_FIT_NOISE, n), ridge), set(LULL_THIRD)), set(0.0f));
    ridge = add(set(LULL_RIDGE), mul(set(LULL_RIDGE_OF_NOISE), ridge));
    factor(&w, &at, ridge, n);
    for (unsigned c = 0; c < 3; c++)
        solve(out + p, plane, &w, &at, c, n);
}

void NAME(fit)(float *out, size_t out_plane, const float *const *rows, size_t plane, unsigned cells,
               float *work)
{
    for (size_t p = 0; p < cells; p += LANES)
        fit_block(out, out_plane, rows, plane, p, (unsigned)(cells - p < LANES ? cells - p : LANES),
                  work);
}

/* Plane k of values of cells of 8 pixels at `cell`, on the way to those of the next cell, `part` of
 * it: for pixels from p on, that of parts_of_cells(p). */
LULL_INLINE vec between_cells(const float *cell, size_t plane, unsigned k, vec part)
{
    vec before, after;
    around(cell + k * plane, &before, &after);
    return add(before, mul(part, sub(after, before)));
}

LULL_INLINE vec parts_of_cells(size_t p)
{
    static const float parts[24] = {0.0625f, 0.1875f, 0.3125f, 0.4375f, 0.5625f, 0.6875f,
                                    0.8125f, 0.9375f, 0.0625f, 0.1875f, 0.3125f, 0.4375f,
                                    0.5625f, 0.6875f, 0.8125f, 0.9375f, 0.0625f, 0.1875f,
                                    0.3125f, 0.4375f, 0.5625f, 0.6875f, 0.8125f, 0.9375f};
    return load_n(parts + (p + LULL_FIT_SIDE / 2) % LULL_FIT_SIDE, LANES);
}

LULL_INLINE void regress_block(const lull_regression *r, size_t p, unsigned n)
{
    const float *b = r->coefficients + (p + LULL_FIT_SIDE / 2) / LULL_FIT_SIDE;
    const size_t plane = r->plane;
    const vec part = parts_of_cells(p);
    vec f0 = plane_at(r->normal, r->normal_plane, 0, p, n);
    vec f1 = plane_at(r->normal, r->normal_plane, 1, p, n);
    vec f2 = plane_at(r->normal, r->normal_plane, 2, p, n);
    vec f3 = plane_at(r->smooth, r->smooth_plane, 0, p, n);
    vec f4 = plane_at(r->smooth, r->smooth_plane, 1, p, n);
    vec f5 = plane_at(r->smooth, r->smooth_plane, 2, p, n);
    for (unsigned c = 0; c < 3; c++) {
        vec v = plane_at(r->v, r->v_plane, c, p, n);
        vec k = add(mul(f0, between_cells(b, plane, c, part)),
                    mul(f1, between_cells(b, plane, 3 + c, part)));
        k = add(k, mul(f2, between_cells(b, plane, 6 + c, part)));
        k = add(k, mul(f3, between_cells(b, plane, 9 + c, part)));
        k = add(k, mul(f4, between_cells(b, plane, 12 + c, part)));
        k = add(k, mul(f5, between_cells(b, plane, 15 + c, part)));
        k = add(between_cells(b, plane, 18 + c, part), k);
        k = low(high(k, set(-LULL_MOST_FIT)), set(LULL_MOST_FIT));
        store_n(r->out + c * r->out_plane + p, add(v, mul(v, k)), n);
    }
}

void NAME(regress)(const lull_regression *r){
#define BLOCK(n) regress_block(r, p, n)
    FOR_BLOCKS(r->pixels)
#undef BLOCK
}
