/* The 5x5 means of family K's filter (kernels.h, filter5), LANES pixels at a time, where values of
 * the table are read one by one: products and sums are rounded one by one, in the order of the
 * definition. After filter_rows.h, whose operations it uses, and
 *
 *   values_at(table, q, step, n)    table[q[i * step]] in lane i < n
 */

LULL_INLINE void store_means(float *out, vec sum, vec total, const lull_window *window, unsigned n)
{
    vec mean = add(mul(sum, quotient(set(1.0f), total)), set(window->more));
    store_n(out, choose(total, mean, set(window->none)), n);
}

/* n pixels from p on. */
LULL_INLINE void filter5_block(const lull_window *window, size_t p, unsigned n)
{
    const uint8_t *q = window->codes + p * window->code_step;
    const size_t plane = window->plane, out_plane = window->out_plane;
    float *out = window->out + p;
    vec a = set(0.0f), b = a, c = a, d = a;
    for (unsigned y = 0; y < 5; y++) {
        const float *v = window->rows[y] + (ptrdiff_t)p - 2;
        for (unsigned x = 0; x < 5; x++, q++, v++) {
            vec w = values_at(window->table, q, window->code_step, n);
            a = add(a, mul(w, load_n(v, n)));
            b = add(b, mul(w, load_n(v + plane, n)));
            c = add(c, mul(w, load_n(v + 2 * plane, n)));
            d = add(d, mul(w, load_n(v + 3 * plane, n)));
        }
    }
    store_means(out, b, a, window, n);
    store_means(out + out_plane, c, a, window, n);
    store_means(out + 2 * out_plane, d, a, window, n);
}

void NAME(filter5)(const lull_window *window){
#define BLOCK(n) filter5_block(window, p, n)
    FOR_BLOCKS(window->pixels)
#undef BLOCK
}
