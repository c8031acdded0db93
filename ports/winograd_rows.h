/* Winograd's form: points of rows, and rows of points, in vectors over channels. Included once by
 * the file of a port, which defines IN and OUT (the functions' names) and
 *
 *   vec, LANES                 a vector of LANES floats, 1 or more
 *   load(p, n), store(p, v, n) the first n lanes if n < LANES
 *   add, sub, most             of two vectors; most(a, b) is a > b ? a : b
 *   madd(x, k, y)              x * k + y, k a constant power of two: rounded once like a sum
 */
#define EACH_CHANNELS(BODY)                                                                        \
    unsigned c = 0;                                                                                \
    for (; c + LANES <= image->channels; c += LANES) {                                             \
        BODY(LANES);                                                                               \
    }                                                                                              \
    if (c < image->channels) {                                                                     \
        BODY(image->channels - c);                                                                 \
    }

/* Six points of a line of six columns. */
LULL_INLINE void make_points(float *to, size_t plane, vec d0, vec d1, vec d2, vec d3, vec d4,
                             vec d5, unsigned n, unsigned is_up)
{
    vec u = sub(d4, d2), v = sub(d3, d1), e = madd(d2, -4.0f, d4), f = madd(d1, -4.0f, d3);
    float *far = to + 3 * plane;
    store(to, madd(sub(d0, d2), 4.0f, u), n);
    store(to + plane, add(e, f), n);
    if (!is_up)
        store(to + 2 * plane, sub(e, f), n);
    store(far, madd(v, 2.0f, u), n);
    store(far + plane, madd(v, -2.0f, u), n);
    store(far + 2 * plane, madd(v, -4.0f, sub(d5, d3)), n);
}

/* A line of points: `how` of rows a and b. Columns of an upsampled source come in pairs. */
#define LINE(to, how, a, b, n)                                                                     \
    {                                                                                              \
        const float *a3 = (a) + 3 * step, *b3 = (b) + 3 * step;                                    \
        vec d0 = how(load(a, n), load(b, n)), d1 = how(load((a) + step, n), load((b) + step, n));  \
        vec d2 = is_up ? d1 : how(load((a) + 2 * step, n), load((b) + 2 * step, n));               \
        vec d3 = is_up ? how(load((a) + 2 * step, n), load((b) + 2 * step, n))                     \
                       : how(load(a3, n), load(b3, n));                                            \
        vec d4 = is_up ? d3 : how(load(a3 + step, n), load(b3 + step, n));                         \
        vec d5 = is_up ? how(load(a3, n), load(b3, n))                                             \
                       : how(load(a3 + 2 * step, n), load(b3 + 2 * step, n));                      \
        make_points(to, plane, d0, d1, d2, d3, d4, d5, n, is_up);                                  \
    }

LULL_INLINE void patches_in(const lull_winograd *image, unsigned is_up)
{
    size_t plane = image->plane, step = image->channels, width = is_up ? 2 * step : 4 * step;
    const float *row0 = image->row[0], *row1 = image->row[1], *row2 = image->row[2],
                *row3 = image->row[3];
    float *points = image->points;
    for (unsigned p = 0; p < image->patches; p++) {
#define LINE_0(n) LINE(points + c, sub, row0 + c, row2 + c, n)
#define LINE_1(n) LINE(points + 6 * plane + c, add, row1 + c, row2 + c, n)
#define LINE_2(n) LINE(points + 12 * plane + c, sub, row2 + c, row1 + c, n)
#define LINE_3(n) LINE(points + 18 * plane + c, sub, row1 + c, row3 + c, n)
        {EACH_CHANNELS(LINE_0)} {
            EACH_CHANNELS(LINE_1)
        }
        if (!is_up) {
            EACH_CHANNELS(LINE_2)
        }
        {EACH_CHANNELS(LINE_3)} points += step;
        row0 += width, row1 += width, row2 += width, row3 += width;
    }
}

void IN(const lull_winograd *image)
{
    if (image->is_up)
        patches_in(image, 1);
    else
        patches_in(image, 0);
}

/* Four pixels y0 to y3 of row 0 or 1 of a patch, from its points at m. */
#define SUM_0(i)                                                                                   \
    vec t##i = add(add(load(m + i * plane, n), load(m6 + i * plane, n)), load(m12 + i * plane, n));
#define SUM_1(i)                                                                                   \
    vec t##i =                                                                                     \
        sub(sub(load(m6 + i * plane, n), load(m12 + i * plane, n)), load(m18 + i * plane, n));
#define SUM(row) SUM_##row(0) SUM_##row(1) SUM_##row(2) SUM_##row(3) SUM_##row(4) SUM_##row(5)
#define PIXELS(row)                                                                                \
    SUM(row)                                                                                       \
    vec s = add(t1, t2), d = sub(t1, t2), far_s = add(t3, t4), far_d = sub(t3, t4);                \
    vec y0 = add(add(t0, s), far_s), y1 = madd(far_d, 2.0f, d), y2 = madd(far_s, 4.0f, s),         \
        y3 = add(madd(far_d, 8.0f, d), t5);

#define ROW(row)                                                                                   \
    {                                                                                              \
        float *out = image->out[row] + at + c;                                                     \
        PIXELS(row)                                                                                \
        store(out, most(y0, zero), n);                                                             \
        store(out + step, most(y1, zero), n);                                                      \
        store(out + 2 * step, most(y2, zero), n);                                                  \
        store(out + 3 * step, most(y3, zero), n);                                                  \
    }

LULL_INLINE void patch_out(const lull_winograd *image, const float *m, size_t at, unsigned c,
                           unsigned n)
{
    size_t plane = image->plane, step = image->channels;
    const float *m6 = m + 6 * plane, *m12 = m + 12 * plane, *m18 = m + 18 * plane;
    vec zero = zeros();
    ROW(0)
    ROW(1)
}

/* The maxima of columns 0 and 1, and 2 and 3. */
LULL_INLINE void patch_pooled(const lull_winograd *image, const float *m, size_t at, unsigned c,
                              unsigned n)
{
    size_t plane = image->plane, step = image->channels;
    const float *m6 = m + 6 * plane, *m12 = m + 12 * plane, *m18 = m + 18 * plane;
    float *out = image->out[0] + at + c;
    vec left, right;
    {
        PIXELS(0)
        left = most(y0, y1);
        right = most(y2, y3);
    }
    {
        PIXELS(1)
        left = most(left, most(y0, y1));
        right = most(right, most(y2, y3));
    }
    store(out, most(left, zeros()), n);
    store(out + step, most(right, zeros()), n);
}

void OUT(const lull_winograd *image)
{
    const float *points = image->points;
    size_t at = 0, width = image->channels * (image->out[1] ? (size_t)4 : 2);
    for (unsigned p = 0; p < image->patches; p++, at += width, points += image->channels) {
#define ROWS(n) patch_out(image, points + c, at, c, n)
#define POOLED(n) patch_pooled(image, points + c, at, c, n)
        if (image->out[1]) {
            EACH_CHANNELS(ROWS)
        } else {
            EACH_CHANNELS(POOLED)
        }
    }
}
