/* Patches: points of codes, and codes of sums at points, in vectors over channels. Included once by
 * the file of an instruction set, which calls patches_in and patches_out, and defines
 *
 *   words, WORDS                   a vector of WORDS int16
 *   load_words(p, n), store_words(p, v, n)
 *                                  the first n of them if n < WORDS (a multiple of 16)
 *   load_codes(p, n)               bytes as words
 *   addw, subw, shlw(a, bits)      of words
 *   vec, LANES                     a vector of LANES int32, with load, save, add, sub, shl
 *   exact(a)                       a * LULL_PATCH_INVERSE >> LULL_PATCH_SHIFT
 *   shr(a, bits)                   arithmetic shift to the right
 *   shift(a, n), most(a, b)        arithmetic shift to the right; the larger one
 *   scales, scales_init(&s, image, first)
 *                                  constants of the requantisation of the outputs from `first` on
 *                                  (s.bias is their bias)
 *   put(&s, to, next, pixel, a)    requantises and stores the sums a[0] to a[3] of four pixels: two
 *                                  from `to` on, two from `next` on, `pixel` bytes apart
 *
 * Both directions of a patch are done one after the other; the points, and the room that
 * patches_out is given, hold what the first one makes, but of wide codes registers do. */

/* Six points of d. */
LULL_INLINE void make_side(words *point, const words *d)
{
    words u = subw(d[4], d[2]), v = subw(d[3], d[1]);
    words e = subw(d[4], shlw(d[2], 2)), f = subw(d[3], shlw(d[1], 2));
    words twice = shlw(v, 1);
    point[0] = addw(shlw(subw(d[0], d[2]), 2), u);
    point[1] = addw(e, f);
    point[2] = subw(e, f);
    point[3] = addw(u, twice);
    point[4] = subw(u, twice);
    point[5] = subw(subw(d[5], d[3]), shlw(v, 2));
}

LULL_INLINE void store_side(int16_t *to, size_t step, const words *point, unsigned n)
{
    for (unsigned i = 0; i < 6; i++)
        store_words(to + i * step, point[i], n);
}

/* Points of n channels of a patch, from channel c on. The last two columns are the first two of the
 * next patch: the first direction of these is done once, for both. */
LULL_INLINE void patch_in(const lull_patches *image, unsigned patch, unsigned c, unsigned n)
{
    size_t plane = image->plane, channels = image->channels;
    size_t at = LULL_PATCH_SIDE * patch * channels + c;
    int16_t *points = image->points + patch * channels + c;
    int has_next = patch + 1 < image->patches;
    words d[6], point[6];
    for (unsigned x = patch ? 2 : 0; x < 6; x++) {
        for (unsigned y = 0; y < 6; y++)
            d[y] = load_codes(image->row[y] + at + x * channels, n);
        make_side(point, d);
        store_side(points + x * plane, 6 * plane, point, n);
        if (x >= LULL_PATCH_SIDE && has_next)
            store_side(points + channels + (x - LULL_PATCH_SIDE) * plane, 6 * plane, point, n);
    }
    for (unsigned y = 0; y < 6; y++, points += 6 * plane) {
        for (unsigned x = 0; x < 6; x++)
            d[x] = load_words(points + x * plane, n);
        make_side(point, d);
        store_side(points, plane, point, n);
    }
}

LULL_INLINE void points_in(const lull_patches *image)
{
    for (unsigned p = 0; p < image->patches; p++) {
        unsigned c = 0;
        for (; c + WORDS <= image->channels; c += WORDS)
            patch_in(image, p, c, WORDS);
        if (c < image->channels)
            patch_in(image, p, c, image->channels - c);
    }
}

/* A column of wide codes in one direction. */
LULL_INLINE void wide_column(words *d, const lull_patches *image, size_t at, unsigned n)
{
    words d0 = load_words(image->row[0] + at, n), d1 = load_words(image->row[1] + at, n);
    words d2 = load_words(image->row[2] + at, n), d3 = load_words(image->row[3] + at, n);
    d[0] = subw(d0, d2);
    d[1] = addw(d1, d2);
    d[2] = subw(d2, d1);
    d[3] = subw(d1, d3);
}

/* Points of n channels of all patches, from channel c on. */
LULL_INLINE void wide_in(const lull_patches *image, unsigned c, unsigned n)
{
    size_t plane = image->plane, pixel = 2 * (size_t)image->channels, at = 2 * (size_t)c;
    int16_t *points = image->points + c;
    words a[4], b[4], d[4], e[4];
    wide_column(a, image, at, n);
    wide_column(b, image, at + pixel, n);
    for (unsigned p = 0; p < image->patches; p++, points += image->channels) {
        at += 2 * pixel;
        wide_column(d, image, at, n);
        wide_column(e, image, at + pixel, n);
        for (unsigned y = 0; y < 4; y++) {
            int16_t *to = points + 4 * y * plane;
            store_words(to, subw(a[y], d[y]), n);
            store_words(to + plane, addw(b[y], d[y]), n);
            store_words(to + 2 * plane, subw(d[y], b[y]), n);
            store_words(to + 3 * plane, subw(b[y], e[y]), n);
            a[y] = d[y];
            b[y] = e[y];
        }
    }
}

LULL_INLINE void patches_in(const lull_patches *image)
{
    unsigned c = 0;
    if (!image->is_wide) {
        points_in(image);
        return;
    }
    for (; c + WORDS <= image->channels; c += WORDS)
        wide_in(image, c, WORDS);
    if (c < image->channels)
        wide_in(image, c, image->channels - c);
}

/* 24 times four values from their six sums, of which `missing` is 0. */
LULL_INLINE void make_pixels(vec *y, const int32_t *t, size_t step, unsigned missing)
{
    vec t1 = load(t + step), t2 = load(t + 2 * step), t3 = load(t + 3 * step);
    vec t4 = load(t + 4 * step);
    vec s = add(t1, t2), d = sub(t1, t2), far_s = add(t3, t4), far_d = sub(t3, t4);
    y[0] = add(s, far_s);
    if (missing != 0)
        y[0] = add(y[0], load(t));
    y[1] = add(d, shl(far_d, 1));
    y[2] = add(s, shl(far_s, 2));
    y[3] = add(d, shl(far_d, 3));
    if (missing != 5)
        y[3] = add(y[3], shl(load(t + 5 * step), 2));
}

/* The first direction: four values `to` for the six sums of each column. */
LULL_INLINE void make_columns(int32_t *to, const int32_t *m, size_t plane, unsigned phase)
{
    unsigned no_row = lull_patch_no_row(phase), no_column = lull_patch_no_column(phase);
    for (unsigned x = 0; x < 6; x++, m += plane, to += LANES) {
        vec y[4];
        if (x == no_column)
            continue;
        make_pixels(y, m, 6 * plane, no_row);
        for (unsigned i = 0; i < 4; i++)
            save(to + 6 * i * LANES, y[i]);
    }
}

/* The second direction: sums of the four pixels of a row. */
LULL_INLINE void make_row(vec *a, const lull_patches *image, unsigned row)
{
    vec y[4];
    make_pixels(y, image->room + 6 * row * LANES, LANES, lull_patch_no_column(image->phase));
    for (unsigned i = 0; i < 4; i++)
        a[i] = exact(y[i]);
}

/* Adds the bias, or what stands in its place, to four pixels. */
LULL_INLINE void add_start(vec *a, const scales *s, const int32_t *start, size_t pixel)
{
    for (unsigned i = 0; i < 4; i++)
        a[i] = add(a[i], start ? load(start + i * pixel) : s->bias);
}

/* Four pixels as they are. */
LULL_INLINE void save_raw(int32_t *to, size_t pixel, const vec *a)
{
    for (unsigned i = 0; i < 4; i++)
        save(to + i * pixel, a[i]);
}

/* LANES outputs of a patch: its sums at m; `at`: place of its first pixel in the rows, in bytes (in
 * elements if image->is_raw); start: of that pixel. */
LULL_INLINE void patch_out(const lull_patches *image, const scales *s, const int32_t *m,
                           const int32_t *start, size_t at)
{
    size_t pixel = image->channels * (image->out_max <= 255 ? (size_t)1 : 2);
    make_columns(image->room, m, image->plane, image->phase);
    if (!image->is_pooled) {
        for (unsigned y = 0; y < 4; y++) {
            vec a[4];
            make_row(a, image, y);
            add_start(a, s, start ? start + y * image->start_row : NULL, image->channels);
            if (image->is_raw) {
                save_raw((int32_t *)(void *)image->out[y] + at, image->raw_step, a);
                continue;
            }
            put(s, image->out[y] + at, image->out[y] + at + 2 * pixel, pixel, a);
        }
        return;
    }
    vec a[8], most4[4];
    for (unsigned y = 0; y < 2; y++) {
        make_row(a, image, 2 * y);
        make_row(a + 4, image, 2 * y + 1);
        most4[2 * y] = most(most(a[0], a[1]), most(a[4], a[5]));
        most4[2 * y + 1] = most(most(a[2], a[3]), most(a[6], a[7]));
    }
    add_start(most4, s, NULL, 0);
    put(s, image->out[0] + at, image->out[1] + at, pixel, most4);
}

/* The same of wide codes: four pixels. */
LULL_INLINE void wide_out(const lull_patches *image, const scales *s, const int32_t *m, size_t at)
{
    size_t plane = image->plane, pixel = image->channels * (image->out_max <= 255 ? (size_t)1 : 2);
    vec half = splat_int(1 << image->shift >> 1), top[4], low[4], a[4];
    for (unsigned x = 0; x < 4; x++, m += plane) {
        vec t1 = load(m + 4 * plane), t2 = load(m + 8 * plane);
        top[x] = add(add(load(m), t1), t2);
        low[x] = sub(sub(t1, t2), load(m + 12 * plane));
    }
    a[0] = add(add(top[0], top[1]), top[2]);
    a[1] = sub(sub(top[1], top[2]), top[3]);
    a[2] = add(add(low[0], low[1]), low[2]);
    a[3] = sub(sub(low[1], low[2]), low[3]);
    for (unsigned i = 0; i < 4; i++)
        a[i] = shift(add(shr(a[i], LULL_PATCH_WIDE_SHIFT), half), image->shift);
    add_start(a, s, NULL, 0);
    put(s, image->out[0] + at, image->out[1] + at, pixel, a);
}

/* All patches of wide codes, one vector of outputs after the other: registers hold its scales. */
LULL_INLINE void wide_patches(const lull_patches *image, size_t size, size_t width)
{
    for (unsigned c = 0; c < image->channels; c += LANES) {
        const int32_t *m = image->sums + c;
        size_t at = c * size;
        scales s;
        scales_init(&s, image, c);
        for (unsigned p = 0; p < image->patches; p++, m += image->channels, at += width)
            wide_out(image, &s, m, at);
    }
}

/* 16 outputs of all others, from `first` on: their sums are a line of the caches, which is then
 * read once. */
LULL_INLINE void narrow_patches(const lull_patches *image, unsigned first, size_t size,
                                size_t width)
{
    const int32_t *m = image->sums + first;
    const int32_t *start = image->start ? image->start + first : NULL;
    size_t at = first * size;
    scales s[LULL_PATCH_CHANNELS / LANES];
    for (unsigned i = 0; i < LULL_PATCH_CHANNELS / LANES; i++)
        scales_init(&s[i], image, first + i * LANES);
    for (unsigned p = 0; p < image->patches; p++, m += image->channels, at += width) {
        for (unsigned i = 0; i < LULL_PATCH_CHANNELS / LANES; i++)
            patch_out(image, &s[i], m + i * LANES, start ? start + i * LANES : NULL,
                      at + i * LANES * size);
        if (start)
            start += LULL_PATCH_SIDE * image->channels;
    }
}

LULL_INLINE void patches_out(const lull_patches *image)
{
    size_t size = image->out_max <= 255 || image->is_raw ? 1 : 2;
    size_t width = (image->is_raw ? image->raw_step : image->channels * size) *
                   (image->is_pooled ? 2u : lull_patch_side(image->is_wide));
    if (image->is_wide) {
        wide_patches(image, size, width);
        return;
    }
    for (unsigned c = 0; c < image->channels; c += LULL_PATCH_CHANNELS)
        narrow_patches(image, c, size, width);
}
