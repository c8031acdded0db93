/* Parts of vectors of LANES floats, at the end of rows: load_n and store_n of filter_rows.h, and
 * pixels for split and join. They are not worth a copy of their code at every use. Before
 * filter_rows.h; the including file defines LANES, vec and
 *
 *   load(p), store(p, v)            whole vectors
 */

static LULL_NOINLINE vec load_part(const float *p, unsigned n)
{
    float part[LANES] = {0};
    memcpy(part, p, n * sizeof *p);
    return load(part);
}

static LULL_NOINLINE void store_part(float *p, vec v, unsigned n)
{
    float part[LANES];
    store(part, v);
    memcpy(p, part, n * sizeof *p);
}

LULL_INLINE vec load_n(const float *p, unsigned n)
{
    return n == LANES ? load(p) : load_part(p, n);
}

LULL_INLINE void store_n(float *p, vec v, unsigned n)
{
    if (n == LANES)
        store(p, v);
    else
        store_part(p, v, n);
}

/* n pixels of three floats; returns `to`. */
static LULL_NOINLINE const float *copy_pixels(float *to, const float *from, unsigned n)
{
    return (const float *)memcpy(to, from, 3 * n * sizeof *to);
}
