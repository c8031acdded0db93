/* Steps 6 and 7 of family K's filter, LANES pixels at a time: products and sums are rounded one by
 * one, in the order of the definition (bilateral.h). After filter_rows.h, whose operations it
 * uses, and
 *
 *   bytes(p, n)                     n bytes at p as floats
 *   put_bytes(p, q, n)              the lowest bytes of the first n lanes of q
 *   pairs(p, n)                     n pairs of bytes at p as words of 16 bits
 *   put_pairs(p, q, n)              the lowest two bytes of the first n lanes of q
 *   squares_of_pairs(a, b)          of pairs of words: the sum of the squares of a - b
 *   add_int(a, b)
 */

LULL_INLINE vec noise_of(vec r, vec smooth, const lull_encoding *from, vec v)
{
    vec i = quotient(sane_radiance(r, from), smooth);
    return quotient(high(sub(i, v), sub(v, i)), add(v, set(LULL_FILTER_EPSILON)));
}

LULL_INLINE vec plane_at(const float *row, size_t plane, unsigned c, size_t p, unsigned n)
{
    return load_n(row + c * plane + p, n);
}

LULL_INLINE void noise_block(uint8_t *noise, const lull_surface *at, const lull_encoding *from,
                             const float *smooth, size_t smooth_plane, size_t p, unsigned n)
{
    const vec codes = set(LULL_ALBEDO_CODES);
    ivec x = set_int(128), y = x, z = x, a[3];
    vec r, g, b, s;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    s = plane_at(smooth, smooth_plane, 0, p, n);
    a[0] = to_codes(mul(codes, s));
    r = noise_of(r, s, from, plane_at(at->v, at->v_plane, 0, p, n));
    s = plane_at(smooth, smooth_plane, 1, p, n);
    a[1] = to_codes(mul(codes, s));
    r = add(r, noise_of(g, s, from, plane_at(at->v, at->v_plane, 1, p, n)));
    s = plane_at(smooth, smooth_plane, 2, p, n);
    a[2] = to_codes(mul(codes, s));
    r = add(r, noise_of(b, s, from, plane_at(at->v, at->v_plane, 2, p, n)));
    put_bytes(noise + p, to_codes(mul(set(LULL_NOISE_CODES), r)), n);
    if (from->normal) {
        split(from->normal + 3 * p, n, &r, &g, &b);
        x = normal_code(r), y = normal_code(g), z = normal_code(b);
    }
    put_pairs(at->pairs + 2 * p, or_int(a[0], shift_left(a[1], 8)), n);
    put_pairs(at->pairs + at->pair_plane + 2 * p, or_int(a[2], shift_left(x, 8)), n);
    put_pairs(at->pairs + 2 * at->pair_plane + 2 * p, or_int(y, shift_left(z, 8)), n);
}

void NAME(noise)(uint8_t *noise, const lull_surface *at, const lull_encoding *from,
                 const float *smooth, size_t smooth_plane, unsigned pixels){
#define BLOCK(n) noise_block(noise, at, from, smooth, smooth_plane, p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

LULL_INLINE void residual_block(const lull_balance *at, const lull_encoding *from, size_t p,
                                unsigned n)
{
    float *sums = at->sums + p;
    vec w = low(mul(bytes(at->noise + p, n), set(LULL_NOISE_SHARE)), set(1.0f));
    vec r, g, b, v, level, q;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    r = add(add(sane_radiance(r, from), sane_radiance(g, from)), sane_radiance(b, from));
    v = mul(plane_at(at->v, at->v_plane, 0, p, n), plane_at(at->smooth, at->smooth_plane, 0, p, n));
    g = mul(plane_at(at->v, at->v_plane, 1, p, n), plane_at(at->smooth, at->smooth_plane, 1, p, n));
    b = mul(plane_at(at->v, at->v_plane, 2, p, n), plane_at(at->smooth, at->smooth_plane, 2, p, n));
    v = add(add(v, g), b);
    level = add(v, set(LULL_BALANCE_EPSILON));
    q = low(quotient(sub(r, v), level), set(LULL_MOST_LACKING));
    store_n(sums, add(load_n(sums, n), q), n);
    sums += at->sum_plane;
    store_n(sums, add(load_n(sums, n), mul(q, q)), n);
    sums += at->sum_plane;
    store_n(sums, add(load_n(sums, n), mul(quotient(v, level), w)), n);
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
    ivec first, second, third; /* pairs of codes */
} weighing;

LULL_INLINE vec squares(vec a, vec b, vec c) { return add(add(mul(a, a), mul(b, b)), mul(c, c)); }

/* Pixels from p on of `other`. */
LULL_INLINE void weigh(weighing *to, const lull_surface *other, size_t p, unsigned n)
{
    const uint8_t *codes = other->pairs + 2 * p;
    size_t step = other->pair_plane;
    ivec apart = squares_of_pairs(pairs(codes, n), to->first);
    vec r = sub(plane_at(other->v, other->v_plane, 0, p, n), to->r);
    vec g = sub(plane_at(other->v, other->v_plane, 1, p, n), to->g);
    vec b = sub(plane_at(other->v, other->v_plane, 2, p, n), to->b);
    vec t = squares(mul(r, to->width_r), mul(g, to->width_g), mul(b, to->width_b)), w;
    apart = add_int(apart, squares_of_pairs(pairs(codes + step, n), to->second));
    apart = add_int(apart, squares_of_pairs(pairs(codes + 2 * step, n), to->third));
    t = add(t, mul(set(LULL_SURFACE_SCALE), number(apart)));
    w = high(sub(set(1.0f), t), set(0.0f));
    w = mul(w, w);
    to->weights = add(to->weights, w);
    to->sum_r = add(to->sum_r, mul(w, r));
    to->sum_g = add(to->sum_g, mul(w, g));
    to->sum_b = add(to->sum_b, mul(w, b));
}

LULL_INLINE vec smoothed(vec v, vec sum, const weighing *to)
{
    return add(v, quotient(sum, to->weights));
}

LULL_INLINE void bilateral_block(const lull_smoothing *s, size_t p, unsigned n)
{
    static const int8_t columns[] = {-LULL_BILATERAL_REACH, -6, -2, 2, 6, LULL_BILATERAL_REACH};
    const lull_surface *row = &s->row;
    const uint8_t *noise = s->noise + p, *codes = row->pairs + 2 * p;
    const vec epsilon = set(LULL_FILTER_EPSILON);
    float *out = s->out + p;
    vec width = add(add(bytes(noise - 1, n), bytes(noise, n)), bytes(noise + 1, n));
    weighing to;
    width = low(mul(width, set(LULL_NOISE_WIDTH)), set(LULL_WIDEST));
    width = quotient(set(0.5f), high(width, set(LULL_NARROWEST)));
    to.r = plane_at(row->v, row->v_plane, 0, p, n);
    to.g = plane_at(row->v, row->v_plane, 1, p, n);
    to.b = plane_at(row->v, row->v_plane, 2, p, n);
    to.first = pairs(codes, n);
    to.second = pairs(codes + row->pair_plane, n);
    to.third = pairs(codes + 2 * row->pair_plane, n);
    to.width_r = quotient(width, add(to.r, epsilon));
    to.width_g = quotient(width, add(to.g, epsilon));
    to.width_b = quotient(width, add(to.b, epsilon));
    to.sum_r = to.sum_g = to.sum_b = set(0.0f);
    to.weights = set(1.0f);
    for (unsigned k = 0; k < sizeof columns; k++)
        weigh(&to, row, p + (size_t)(ptrdiff_t)columns[k], n);
    for (const lull_surface *other = s->beside; other < s->beside + 4; other++)
        weigh(&to, other, p, n);
    store_n(out, smoothed(to.r, to.sum_r, &to), n);
    store_n(out + s->out_plane, smoothed(to.g, to.sum_g, &to), n);
    store_n(out + 2 * s->out_plane, smoothed(to.b, to.sum_b, &to), n);
}

LULL_NOINLINE static void bilateral_rest(const lull_smoothing *s, size_t p, unsigned n)
{
    bilateral_block(s, p, n);
}

void NAME(bilateral)(const lull_smoothing *smoothing)
{
    size_t p = 0;
    for (; p + LANES <= smoothing->pixels; p += LANES)
        bilateral_block(smoothing, p, LANES);
    if (p < smoothing->pixels)
        bilateral_rest(smoothing, p, (unsigned)(smoothing->pixels - p));
}
