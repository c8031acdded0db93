/* Steps 6, 8 and 9 of family K's filter, LANES pixels at a time: products and sums are rounded one
 * by one, in the order of the definition (bilateral.h). After filter_rows.h, whose operations it
 * uses, and
 *
 *   bytes(p, n)                     n bytes at p as floats
 *   put_bytes(p, q, n)              the lowest bytes of the first n lanes of q
 *   pairs(p, n)                     n pairs of bytes at p, each at most 127, for squares_of_pairs
 *   squares_of_pairs(a, b)          the sum of the squares of a - b
 */

LULL_INLINE vec plane_at(const float *row, size_t plane, unsigned c, size_t p, unsigned n)
{
    return load_n(row + c * plane + p, n);
}

LULL_INLINE vec distance(vec a, vec b) { return high(sub(a, b), sub(b, a)); }

LULL_INLINE void noise_block(uint8_t *noise, const float *v, size_t plane, const float *f,
                             size_t f_plane, size_t p, unsigned n)
{
    vec confidence = load_n(v + p, n), apart, all;
    vec r = plane_at(f, f_plane, 0, p, n), g = plane_at(f, f_plane, 1, p, n);
    vec b = plane_at(f, f_plane, 2, p, n);
    apart = distance(plane_at(v, plane, 1, p, n), mul(confidence, r));
    apart = add(apart, distance(plane_at(v, plane, 2, p, n), mul(confidence, g)));
    apart = add(apart, distance(plane_at(v, plane, 3, p, n), mul(confidence, b)));
    all = mul(confidence, add(add(add(r, g), b), set(LULL_NOISE_EPSILON)));
    put_bytes(noise + p, to_codes(mul(set(LULL_NOISE_CODES), quotient(apart, all))), n);
}

void NAME(noise)(uint8_t *noise, const float *v, size_t plane, const float *f, size_t f_plane,
                 unsigned pixels){
#define BLOCK(n) noise_block(noise, v, plane, f, f_plane, p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

LULL_INLINE void residual_block(const lull_balance *at, const lull_encoding *from, size_t p,
                                unsigned n)
{
    float *sums = at->sums + p;
    vec w = low(mul(bytes(at->noise + p, n), set(LULL_NOISE_SHARE)), set(1.0f));
    vec r, g, b, v, share, q;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    r = add(add(sane_radiance(r, from), sane_radiance(g, from)), sane_radiance(b, from));
    v = mul(plane_at(at->v, at->v_plane, 0, p, n), plane_at(at->smooth, at->smooth_plane, 0, p, n));
    g = mul(plane_at(at->v, at->v_plane, 1, p, n), plane_at(at->smooth, at->smooth_plane, 1, p, n));
    b = mul(plane_at(at->v, at->v_plane, 2, p, n), plane_at(at->smooth, at->smooth_plane, 2, p, n));
    v = add(add(v, g), b);
    share = quotient(set(1.0f), add(v, set(LULL_BALANCE_EPSILON)));
    q = mul(sub(r, v), share);
    q = low(q, high(sub(set(2.0f * LULL_MOST_LACKING), q), set(0.0f)));
    store_n(sums, add(load_n(sums, n), q), n);
    sums += at->sum_plane;
    store_n(sums, add(load_n(sums, n), mul(q, q)), n);
    sums += at->sum_plane;
    store_n(sums, add(load_n(sums, n), mul(mul(v, share), w)), n);
    sums += at->sum_plane;
    q = low(high(sub(q, set(LULL_SPARK)), set(0.0f)), set(1.0f));
    store_n(sums, add(load_n(sums, n), q), n);
}

void NAME(residual)(const lull_balance *at, const lull_encoding *from){
#define BLOCK(n) residual_block(at, from, p, n)
    FOR_BLOCKS(at->pixels)
#undef BLOCK
}

/* What weights of other pixels are made of, and the sums: no arrays, which compilers would leave in
 * memory. */
typedef struct weighing {
    vec r, g, b, width_r, width_g, width_b, sum_r, sum_g, sum_b, weights;
    ivec guide;
} weighing;

LULL_INLINE vec squares(vec a, vec b, vec c) { return add(add(mul(a, a), mul(b, b)), mul(c, c)); }

/* Pixels from p on of `other`. */
LULL_INLINE void weigh(weighing *to, const lull_surface *other, size_t p, unsigned n)
{
    const size_t plane = other->plane;
    ivec apart = squares_of_pairs(pairs(other->guide + 2 * p, n), to->guide);
    vec r = sub(plane_at(other->v, plane, 0, p, n), to->r);
    vec g = sub(plane_at(other->v, plane, 1, p, n), to->g);
    vec b = sub(plane_at(other->v, plane, 2, p, n), to->b);
    vec t = squares(mul(r, to->width_r), mul(g, to->width_g), mul(b, to->width_b)), w;
    t = add(t, mul(set(LULL_GUIDE_SCALE), number(apart)));
    w = high(sub(set(1.0f), t), set(0.0f));
    w = mul(w, w);
    to->weights = add(to->weights, w);
    to->sum_r = add(to->sum_r, mul(w, r));
    to->sum_g = add(to->sum_g, mul(w, g));
    to->sum_b = add(to->sum_b, mul(w, b));
}

/* The same out of line, for the last pixels of a row, whose loads are much code. */
LULL_NOINLINE static void weigh_some(weighing *to, const lull_surface *other, size_t p, unsigned n)
{
    weigh(to, other, p, n);
}

LULL_INLINE void bilateral_block(const lull_smoothing *s, size_t p, unsigned n,
                                 void (*look)(weighing *, const lull_surface *, size_t, unsigned))
{
    const size_t plane = s->row.plane;
    const uint8_t *noise = s->noise + p;
    float *out = s->out + p;
    vec width = add(add(bytes(noise - 1, n), bytes(noise, n)), bytes(noise + 1, n)), v[3], share;
    weighing to;
    width = low(mul(width, set(LULL_NOISE_WIDTH)), set(lull_smoothing_widest(s->is_far)));
    to.r = plane_at(s->row.v, plane, 0, p, n);
    to.g = plane_at(s->row.v, plane, 1, p, n);
    to.b = plane_at(s->row.v, plane, 2, p, n);
    v[0] = add(to.r, set(LULL_FILTER_EPSILON));
    v[1] = add(to.g, set(LULL_FILTER_EPSILON));
    v[2] = add(to.b, set(LULL_FILTER_EPSILON));
    shares(v, set(0.5f), high(width, set(LULL_NARROWEST)));
    to.width_r = v[0], to.width_g = v[1], to.width_b = v[2];
    to.guide = pairs(s->row.guide + 2 * p, n);
    to.sum_r = to.sum_g = to.sum_b = set(0.0f);
    to.weights = set(lull_smoothing_own(s->is_far));
    for (unsigned k = 0; k < lull_bilateral_columns(s->is_far); k++)
        look(&to, &s->row, p + (size_t)(ptrdiff_t)lull_bilateral_column[k], n);
    for (unsigned k = 0; k < lull_bilateral_rows(s->is_far); k++)
        look(&to, &s->beside[k], p, n);
    share = quotient(set(1.0f), to.weights);
    store_n(out, add(to.r, mul(to.sum_r, share)), n);
    store_n(out + s->out_plane, add(to.g, mul(to.sum_g, share)), n);
    store_n(out + 2 * s->out_plane, add(to.b, mul(to.sum_b, share)), n);
}

LULL_NOINLINE static void bilateral_rest(const lull_smoothing *s, size_t p, unsigned n)
{
    bilateral_block(s, p, n, weigh_some);
}

void NAME(bilateral)(const lull_smoothing *smoothing){
    FOR_VECTORS(smoothing->pixels, bilateral_block(smoothing, p, LANES, weigh),
                bilateral_rest(smoothing, p, (unsigned)(smoothing->pixels - p)))
}

LULL_INLINE vec ramp(vec v, float begin, float slope)
{
    return low(high(mul(sub(v, set(begin)), set(slope)), set(0.0f)), set(1.0f));
}

/* Exposed radiance of LANES pixels, and its light. */
typedef struct lit {
    vec r, g, b, light;
} lit;

LULL_INLINE vec product_of(const float *v, const float *smooth)
{
    return high(mul(load_n(v, LANES), load_n(smooth, LANES)), set(0.0f));
}

LULL_INLINE void lit_at(lit *to, const lull_edging *e, unsigned row, ptrdiff_t p)
{
    const float *v = e->v[row] + p, *smooth = e->smooth[row] + p;
    to->r = product_of(v, smooth);
    to->g = product_of(v + e->v_plane, smooth + e->smooth_plane);
    to->b = product_of(v + 2 * e->v_plane, smooth + 2 * e->smooth_plane);
    to->light = add(add(to->r, to->g), to->b);
}

LULL_INLINE void edges_block(const lull_edging *e, size_t p)
{
    const vec unscale = set(e->unscale);
    lit here, ends;
    vec least = set(LULL_LARGEST), most = set(0.0f), share, evenness;
    lit_at(&here, e, 1, (ptrdiff_t)p);
    ends = here;
    for (unsigned k = 0; k < LULL_EDGE_LINES; k++) {
        const ptrdiff_t x = lull_edge_lines[k][0];
        const unsigned y = (unsigned)lull_edge_lines[k][1];
        vec change, closer;
        lit a, b;
        lit_at(&a, e, 1 - y, (ptrdiff_t)p - x);
        lit_at(&b, e, 1 + y, (ptrdiff_t)p + x);
        change = add(distance(a.light, here.light), distance(b.light, here.light));
        closer = sub(least, change);
        ends.r = choose(closer, add(a.r, b.r), ends.r);
        ends.g = choose(closer, add(a.g, b.g), ends.g);
        ends.b = choose(closer, add(a.b, b.b), ends.b);
        least = low(change, least);
        most = high(change, most);
    }
    share = quotient(set(1.0f), add(here.light, set(LULL_EDGE_EPSILON)));
    share = ramp(mul(most, share), LULL_EDGE_CONTRAST);
    evenness = quotient(set(1.0f), add(most, set(LULL_EDGE_TINY)));
    evenness = ramp(mul(sub(most, least), evenness), LULL_EDGE_EVENNESS);
    share = mul(mul(share, evenness), set(e->strength));
    here.r = sane(add(here.r, mul(share, sub(ends.r, add(here.r, here.r)))));
    here.g = sane(add(here.g, mul(share, sub(ends.g, add(here.g, here.g)))));
    here.b = sane(add(here.b, mul(share, sub(ends.b, add(here.b, here.b)))));
    join(e->out + 3 * p, LANES, mul(here.r, unscale), mul(here.g, unscale), mul(here.b, unscale));
}

void NAME(edges)(const lull_edging *edging)
{
    size_t p = 0;
    for (; p + LANES <= edging->pixels; p += LANES)
        edges_block(edging, p);
    for (; p < edging->pixels; p++)
        lull_edge_pixel(edging, (ptrdiff_t)p);
}
