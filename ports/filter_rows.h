/* The filter of family K over rows of planes, LANES pixels at a time: products and sums are rounded
 * one by one, in the order of the definition (kernels.h). The including file defines, for its
 * instruction set:
 *
 *   vec, ivec, LANES                a vector of LANES floats; the same as int32
 *   set(f)                          f in all lanes
 *   load_n(p, n), store_n(p, v, n)  any address; the first n lanes only, others are 0
 *   add, sub, mul, quotient, low, high
 *                                   low(a, b): b if one is no number; high alike
 *   above(v, least)                 v where its bits are above `least` as int32, else 0; v >= 0
 *   choose(if_positive, v, other)   lanes of v where if_positive > 0, else of other
 *   ints(v), floats(i)              casts
 *   whole(v)                        floats to int32, cut
 *   set_int(i), sub_int, or_int, shift_left(i, n), shift_right(i, n) (zeros come in),
 *   shift_sign(i, n) (copies of the sign), number(i) (to float)
 *   is_number(v)                    v, or 0 where it is no number
 *   split(p, n, &a, &b, &c)         3 n interleaved floats at p, n <= LANES, as three vectors
 *   join(p, n, a, b, c)             the reverse
 *   split_pairs(a, b, &even, &odd), join_pairs(even, odd, &a, &b)
 *   tables, tables_init(&t, table), weights(&t, q)
 *                                   table values of the lowest bytes of q
 *   codes_at(q, step, n)            the dword at q + i * step in lane i < n
 *   TAKES_PLANES                    optional: codes of heads may be in planes; and
 *   codes_from(q, n)                q[i] in lane i < n
 *   look_up(table, q, n)            table[q[i]] in lane i < n
 *   put_pairs(p, q, n)              the lowest two bytes of the first n lanes of q
 *   NAME(op)                        lull_<op>_<isa>
 */

/* WHOLE for the vectors of pixels from pixel p on, then REST for those that are left, from p on. */
#define FOR_VECTORS(pixels, WHOLE, REST)                                                           \
    {                                                                                              \
        size_t p = 0;                                                                              \
        for (; p + LANES <= (pixels); p += LANES)                                                  \
            WHOLE;                                                                                 \
        if (p < (pixels))                                                                          \
            REST;                                                                                  \
    }

/* The same for both: BLOCK(n) stands for n pixels from pixel p on. */
#define FOR_BLOCKS(pixels) FOR_VECTORS(pixels, BLOCK(LANES), BLOCK((unsigned)((pixels)-p)))

/* ---- Codes ----------------------------------------------------------------------------------- */

/* v + 0.5 as codes: cut, and at most 255. */
LULL_INLINE ivec to_codes(vec v) { return whole(low(add(v, set(0.5f)), set(255.0f))); }

/* Logarithm of u >= 1 in codes (kernels.h). */
LULL_INLINE vec log_code(vec u)
{
    ivec exponent = shift_sign(sub_int(ints(u), set_int(0x3f3504f3)), 23);
    vec t = sub(floats(sub_int(ints(u), shift_left(exponent, 23))), set(1.0f));
    vec p = add(mul(set(LULL_LOG_2), t), set(LULL_LOG_1));
    vec q = add(mul(set(LULL_LOG_4), t), set(LULL_LOG_3));
    p = mul(t, add(p, mul(mul(t, t), q)));
    return add(mul(number(exponent), set(LULL_CODES_PER_OCTAVE)), p);
}

/* Shares of v, in its place (kernels.h). */
LULL_INLINE void shares(vec *v, vec top, vec bottom)
{
    vec first = mul(v[0], v[1]), share = quotient(top, mul(mul(first, v[2]), bottom));
    vec other = mul(v[0], v[2]);
    v[0] = mul(mul(v[1], v[2]), share);
    v[1] = mul(other, share);
    v[2] = mul(first, share);
}

/* Radiance, sanitised. The maximum is 0 if v is no number. */
LULL_INLINE vec sane_radiance(vec v, const lull_encoding *from)
{
    v = above(high(v, set(0.0f)), 0x007fffff);
    v = above(high(mul(v, set(from->scale)), set(0.0f)), 0x00800000);
    return low(v, set(from->most));
}

LULL_INLINE vec sane_albedo(vec v)
{
    return low(above(high(v, set(0.0f)), 0x00800000), set(LULL_ALBEDO_MOST));
}

/* Albedo of n pixels at p, sanitised: where there is none, white. */
LULL_INLINE void load_albedo(const float *p, unsigned n, vec *a)
{
    vec sum;
    split(p, n, &a[0], &a[1], &a[2]);
    a[0] = sane_albedo(a[0]), a[1] = sane_albedo(a[1]), a[2] = sane_albedo(a[2]);
    sum = add(add(a[0], a[1]), a[2]);
    for (unsigned c = 0; c < 3; c++)
        a[c] = choose(sum, a[c], set(1.0f));
}

LULL_INLINE ivec radiance_code(const lull_encoding *from, vec r, vec share)
{
    vec v = mul(sane_radiance(r, from), share);
    return to_codes(log_code(add(set(1.0f), mul(set(LULL_LOG_GAIN), v))));
}

LULL_INLINE ivec albedo_code(vec albedo) { return to_codes(mul(albedo, set(255.0f))); }

LULL_INLINE ivec normal_code(vec v)
{
    v = low(high(is_number(v), set(-1.0f)), set(1.0f));
    return to_codes(add(mul(v, set(127.5f)), set(127.5f)));
}

LULL_INLINE ivec dword(ivec a, ivec b, ivec c, ivec d)
{
    return or_int(or_int(a, shift_left(b, 8)), or_int(shift_left(c, 16), shift_left(d, 24)));
}

LULL_INLINE void encode_block(uint8_t *codes, const lull_encoding *from, size_t p, unsigned n)
{
    const ivec zero = set_int(0), middle = set_int(128);
    vec r, g, b, v[3];
    ivec a[3] = {zero, zero, zero}, m[3] = {middle, middle, middle}, d0, d1, d2;
    v[0] = v[1] = v[2] = set(1.0f - LULL_FILTER_EPSILON);
    if (from->albedo) {
        load_albedo(from->albedo + 3 * p, n, v);
        a[0] = albedo_code(v[0]), a[1] = albedo_code(v[1]), a[2] = albedo_code(v[2]);
    }
    for (unsigned c = 0; c < 3; c++)
        v[c] = add(v[c], set(LULL_FILTER_EPSILON));
    shares(v, set(1.0f), set(1.0f));
    split(from->radiance + 3 * p, n, &r, &g, &b);
    d0 = dword(radiance_code(from, r, v[0]), radiance_code(from, g, v[1]),
               radiance_code(from, b, v[2]), a[0]);
    if (from->normal) {
        split(from->normal + 3 * p, n, &r, &g, &b);
        m[0] = normal_code(r), m[1] = normal_code(g), m[2] = normal_code(b);
    }
    d1 = dword(a[1], a[2], m[0], m[1]);
    d2 = or_int(m[2], set_int((int)(from->flags << 8)));
    join((float *)(void *)(codes + LULL_CODES * p), n, floats(d0), floats(d1), floats(d2));
}

/* Less than a vector; apart, for its registers would be kept in the frame of the whole ones. */
LULL_NOINLINE static void encode_rest(uint8_t *codes, const lull_encoding *from, size_t p,
                                      unsigned n)
{
    encode_block(codes, from, p, n);
}

void NAME(encode)(uint8_t *codes, const lull_encoding *from, unsigned pixels){
    FOR_VECTORS(pixels, encode_block(codes, from, p, LANES),
                encode_rest(codes, from, p, (unsigned)(pixels - p)))
}

LULL_INLINE void guide_block(uint8_t *guide, const float *albedo, const float *normal, unsigned n)
{
    const ivec zero = set_int(0);
    ivec first = zero, second = zero, x, y, z;
    vec v[3];
    if (normal) {
        split(normal, n, &v[0], &v[1], &v[2]);
        x = normal_code(v[0]), y = normal_code(v[1]), z = normal_code(v[2]);
        first = sub_int(sub_int(shift_left(x, 1), y), sub_int(z, set_int(510)));
        second = sub_int(y, sub_int(z, set_int(255)));
        first = shift_right(first, 3);
        second = shift_right(sub_int(shift_left(second, 3), second), 5);
    } else if (albedo) {
        load_albedo(albedo, n, v);
        first = shift_right(albedo_code(v[0]), 1);
        second = sub_int(albedo_code(v[1]), sub_int(zero, albedo_code(v[2])));
        second = shift_right(second, 2);
    }
    put_pairs(guide, or_int(first, shift_left(second, 8)), n);
}

void NAME(guide)(uint8_t *guide, const float *albedo, const float *normal, unsigned pixels){
#define BLOCK(n)                                                                                   \
    guide_block(guide + 2 * p, albedo ? albedo + 3 * p : NULL, normal ? normal + 3 * p : NULL, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

/* ---- Radiance -------------------------------------------------------------------------------- */

LULL_INLINE void spread_block(float *out, size_t plane, const float *albedo, unsigned n)
{
    vec a[3];
    load_albedo(albedo, n, a);
    store_n(out, set(1.0f), n);
    for (unsigned c = 0; c < 3; c++)
        store_n(out + (1 + c) * plane, a[c], n);
}

void NAME(spread)(float *out, size_t plane, const float *albedo, unsigned pixels){
#define BLOCK(n) spread_block(out + p, plane, albedo + 3 * p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

/* A number in [-1, 1]; one of the two parts is 0. */
LULL_INLINE vec sane_normal(vec v)
{
    vec positive = above(high(v, set(0.0f)), 0x00800000);
    vec negative = above(high(sub(set(0.0f), v), set(0.0f)), 0x00800000);
    return low(high(sub(positive, negative), set(-1.0f)), set(1.0f));
}

LULL_INLINE void spread_xyz_block(float *out, size_t plane, const float *normal, unsigned n)
{
    vec v[3];
    split(normal, n, &v[0], &v[1], &v[2]);
    store_n(out, set(1.0f), n);
    for (unsigned c = 0; c < 3; c++)
        store_n(out + (1 + c) * plane, sane_normal(v[c]), n);
}

void NAME(spread_xyz)(float *out, size_t plane, const float *normal, unsigned pixels){
#define BLOCK(n) spread_xyz_block(out + p, plane, normal + 3 * p, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

LULL_INLINE vec demodulated(vec r, vec share, vec confidence, const lull_encoding *from)
{
    return mul(confidence, mul(sane_radiance(r, from), share));
}

LULL_INLINE void demodulate_block(float *out, size_t plane, const lull_encoding *from,
                                  const float *radiance, const float *smooth, size_t smooth_plane,
                                  ivec codes, const tables *t, unsigned n)
{
    vec r, g, b, v[3], c = weights(t, codes);
    for (unsigned i = 0; i < 3; i++)
        v[i] = load_n(smooth + i * smooth_plane, n);
    shares(v, set(1.0f), set(1.0f));
    split(radiance, n, &r, &g, &b);
    store_n(out, c, n);
    store_n(out + plane, demodulated(r, v[0], c, from), n);
    store_n(out + 2 * plane, demodulated(g, v[1], c, from), n);
    store_n(out + 3 * plane, demodulated(b, v[2], c, from), n);
}

/* Confidence codes of n pixels from pixel p on. */
#define APART(n) shift_right(codes_at(codes + p * code_step - 3, code_step, n), 24)
#if defined(TAKES_PLANES)
#define CONFIDENCE(n) (code_step == 1 ? codes_from(codes + p, n) : APART(n))
#else
#define CONFIDENCE(n) APART(n)
#endif

void NAME(demodulate)(float *out, size_t plane, const lull_encoding *from, const float *smooth,
                      size_t smooth_plane, const uint8_t *codes, size_t code_step,
                      const float *table, unsigned pixels)
{
    tables t;
    tables_init(&t, table);
#define BLOCK(n)                                                                                   \
    demodulate_block(out + p, plane, from, from->radiance + 3 * p, smooth + p, smooth_plane,       \
                     CONFIDENCE(n), &t, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

/* The sums over 2x2 pixels; n is of the coarse level. */
LULL_INLINE vec sum_2x2(const float *above_it, const float *below, unsigned n)
{
    unsigned first = n == LANES ? LANES : lull_min_u(2 * n, LANES), second = 2 * n - first;
    vec left, right, sum;
    split_pairs(load_n(above_it, first), load_n(above_it + LANES, second), &left, &right);
    sum = add(left, right);
    split_pairs(load_n(below, first), load_n(below + LANES, second), &left, &right);
    return add(add(sum, left), right);
}

LULL_INLINE void shrink_block(float *out, size_t out_plane, const float *upper, const float *lower,
                              size_t plane, ivec codes, const tables *t, unsigned n)
{
    vec weight = sum_2x2(upper, lower, n), c = weights(t, codes), zero = set(0.0f);
    vec share = quotient(set(1.0f), weight);
    store_n(out, choose(weight, c, zero), n);
    for (unsigned i = 1; i < 4; i++) {
        vec sum = sum_2x2(upper + i * plane, lower + i * plane, n);
        store_n(out + i * out_plane, choose(weight, mul(c, mul(sum, share)), zero), n);
    }
}

void NAME(shrink)(float *out, size_t out_plane, const float *upper, const float *lower,
                  size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                  unsigned pixels)
{
    tables t;
    tables_init(&t, table);
#define BLOCK(n)                                                                                   \
    shrink_block(out + p, out_plane, upper + 2 * p, lower + 2 * p, plane, CONFIDENCE(n), &t, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

/* 0.75 a + 0.25 b. */
LULL_INLINE vec between(vec a, vec b) { return add(mul(set(0.75f), a), mul(set(0.25f), b)); }

LULL_INLINE vec coarse_at(const lull_blending *b, size_t at, ptrdiff_t beside, unsigned n)
{
    ptrdiff_t i = (ptrdiff_t)at + beside;
    return between(load_n(b->near + i, n), load_n(b->far + i, n));
}

LULL_INLINE vec blended(const lull_blending *b, size_t at, vec up, vec beta, unsigned n)
{
    vec fine = load_n(b->fine + at, n);
    return add(fine, mul(beta, sub(up, fine)));
}

/* n pairs from pair p on. */
LULL_INLINE void blend_block(const lull_blending *blending, size_t p, unsigned n)
{
    unsigned first = n == LANES ? LANES : lull_min_u(2 * n, LANES), second = 2 * n - first;
    lull_blending b = *blending;
    const uint8_t *q = b.codes + 2 * p;
    vec beta0 = look_up(b.table, q, first), beta1 = beta0;
    if (second)
        beta1 = look_up(b.table, q + LANES, second);
    for (unsigned c = 0; c < 3; c++) {
        vec here = coarse_at(&b, p, 0, n), v, w;
        join_pairs(between(here, coarse_at(&b, p, -1, n)), between(here, coarse_at(&b, p, 1, n)),
                   &v, &w);
        store_n(b.out + 2 * p, blended(&b, 2 * p, v, beta0, first), first);
        if (second)
            store_n(b.out + 2 * p + LANES, blended(&b, 2 * p + LANES, w, beta1, second), second);
        b.out += b.out_plane, b.fine += b.fine_plane;
        b.near += b.coarse_plane, b.far += b.coarse_plane;
    }
}

void NAME(blend)(const lull_blending *blending){
#define BLOCK(n) blend_block(blending, p, n)
    FOR_BLOCKS(blending->pairs)
#undef BLOCK
}

LULL_INLINE vec sane(vec v)
{
    return low(above(high(v, set(0.0f)), 0x00800000), set(LULL_LARGEST));
}

LULL_INLINE vec modulated(const float *v, const float *smooth, vec unscale, unsigned n)
{
    return mul(sane(mul(load_n(v, n), load_n(smooth, n))), unscale);
}

LULL_INLINE void modulate_block(float *out, const float *v, size_t plane, const float *smooth,
                                size_t smooth_plane, float unscale, unsigned n)
{
    vec factor = set(unscale);
    join(out, n, modulated(v, smooth, factor, n),
         modulated(v + plane, smooth + smooth_plane, factor, n),
         modulated(v + 2 * plane, smooth + 2 * smooth_plane, factor, n));
}

void NAME(modulate)(float *out, const float *v, size_t plane, const float *smooth,
                    size_t smooth_plane, float unscale, unsigned pixels){
#define BLOCK(n) modulate_block(out + 3 * p, v + p, plane, smooth + p, smooth_plane, unscale, n)
    FOR_BLOCKS(pixels)
#undef BLOCK
}

LULL_INLINE void luminance_block(float *sums, const float *pixels, unsigned n)
{
    vec r, g, b;
    split(pixels, n, &r, &g, &b);
    r = add(mul(set(0.212671f), sane(r)), mul(set(0.715160f), sane(g)));
    store_n(sums, add(load_n(sums, n), add(r, mul(set(0.072169f), sane(b)))), n);
}

void NAME(luminance)(float *sums, const float *pixels, unsigned n)
{
    unsigned count = n;
#define BLOCK(n) luminance_block(sums + p, pixels + 3 * p, n)
    FOR_BLOCKS(count)
#undef BLOCK
}
