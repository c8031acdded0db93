/* Step 6 of family K's filter, LANES pixels at a time: products and sums are rounded one by one, in
 * the order of the definition (bilateral.h). After filter_rows.h, whose operations it uses, and
 *
 *   bytes(p, n)                     n bytes at p as floats
 *   put_bytes(p, q, n)              the lowest bytes of the first n lanes of q
 */

LULL_INLINE vec noise_of(vec r, const lull_encoding *from, const lull_surface *at, size_t p,
                         unsigned c, unsigned n)
{
    vec v = load_n(at->v + c * at->v_plane + p, n);
    vec i = quotient(sane_radiance(r, from), load_n(at->smooth + c * at->smooth_plane + p, n));
    return quotient(high(sub(i, v), sub(v, i)), add(v, set(LULL_FILTER_EPSILON)));
}

LULL_INLINE void noise_block(uint8_t *codes, const lull_encoding *from, const lull_surface *at,
                             size_t p, unsigned n)
{
    size_t plane = at->code_plane;
    vec r, g, b;
    split(from->radiance + 3 * p, n, &r, &g, &b);
    r = add(noise_of(r, from, at, p, 0, n), noise_of(g, from, at, p, 1, n));
    r = add(r, noise_of(b, from, at, p, 2, n));
    put_bytes(codes + 3 * plane + p, to_codes(mul(set(LULL_NOISE_CODES), r)), n);
    if (!from->normal)
        return;
    split(from->normal + 3 * p, n, &r, &g, &b);
    put_bytes(codes + p, normal_code(r), n);
    put_bytes(codes + plane + p, normal_code(g), n);
    put_bytes(codes + 2 * plane + p, normal_code(b), n);
}

void NAME(noise)(uint8_t *codes, const lull_encoding *from, const lull_surface *at,
                 unsigned pixels){
#define BLOCK(n) noise_block(codes, from, at, p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

/* What weights of other pixels are made of, and the sums: no arrays, which compilers would leave in
 * memory. */
typedef struct weighing {
    vec r, g, b, smooth_r, smooth_g, smooth_b, x, y, z, width_r, width_g, width_b;
    vec sum_r, sum_g, sum_b, weights;
} weighing;

LULL_INLINE vec plane_at(const float *row, size_t plane, unsigned c, size_t p, unsigned n)
{
    return load_n(row + c * plane + p, n);
}

LULL_INLINE vec squares(vec a, vec b, vec c) { return add(add(mul(a, a), mul(b, b)), mul(c, c)); }

/* Pixels from p on of `other`. */
LULL_INLINE void weigh(weighing *to, const lull_surface *other, size_t p, unsigned n)
{
    const float *v = other->v, *smooth = other->smooth;
    const uint8_t *codes = other->codes + p;
    size_t plane = other->v_plane, smooth_plane = other->smooth_plane, step = other->code_plane;
    vec r = sub(plane_at(v, plane, 0, p, n), to->r);
    vec g = sub(plane_at(v, plane, 1, p, n), to->g);
    vec b = sub(plane_at(v, plane, 2, p, n), to->b);
    vec t = squares(mul(r, to->width_r), mul(g, to->width_g), mul(b, to->width_b)), w;
    w = squares(sub(plane_at(smooth, smooth_plane, 0, p, n), to->smooth_r),
                sub(plane_at(smooth, smooth_plane, 1, p, n), to->smooth_g),
                sub(plane_at(smooth, smooth_plane, 2, p, n), to->smooth_b));
    t = add(t, mul(set(LULL_SMOOTH_SCALE), w));
    w = squares(sub(bytes(codes, n), to->x), sub(bytes(codes + step, n), to->y),
                sub(bytes(codes + 2 * step, n), to->z));
    t = add(t, mul(set(LULL_NORMAL_SCALE), w));
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
    const lull_surface *row = &s->row;
    const uint8_t *codes = row->codes + p, *noise = codes + 3 * row->code_plane;
    const vec epsilon = set(LULL_FILTER_EPSILON);
    float *out = s->out + p;
    vec width = add(add(bytes(noise - 1, n), bytes(noise, n)), bytes(noise + 1, n));
    weighing to;
    width = low(mul(width, set(LULL_NOISE_WIDTH)), set(LULL_WIDEST));
    width = quotient(set(0.5f), high(width, set(LULL_NARROWEST)));
    to.r = plane_at(row->v, row->v_plane, 0, p, n);
    to.g = plane_at(row->v, row->v_plane, 1, p, n);
    to.b = plane_at(row->v, row->v_plane, 2, p, n);
    to.smooth_r = plane_at(row->smooth, row->smooth_plane, 0, p, n);
    to.smooth_g = plane_at(row->smooth, row->smooth_plane, 1, p, n);
    to.smooth_b = plane_at(row->smooth, row->smooth_plane, 2, p, n);
    to.x = bytes(codes, n);
    to.y = bytes(codes + row->code_plane, n);
    to.z = bytes(codes + 2 * row->code_plane, n);
    to.width_r = quotient(width, add(to.r, epsilon));
    to.width_g = quotient(width, add(to.g, epsilon));
    to.width_b = quotient(width, add(to.b, epsilon));
    to.sum_r = to.sum_g = to.sum_b = set(0.0f);
    to.weights = set(1.0f);
    /* -8, -4, -2, -1, 1, 2, 4, 8 */
    for (int k = -LULL_BILATERAL_REACH; k <= LULL_BILATERAL_REACH;
         k = k == -1 ? 1 : k < 0 ? k / 2 : 2 * k)
        weigh(&to, row, p + (size_t)(ptrdiff_t)k, n);
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
