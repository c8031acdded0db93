/* Convolutions of integers. A work item makes eight outputs of four pixels, a square of 2x2, whose
 * sums share the weights that they read; where tensors have a border, it writes that, too. */

typedef struct sums {
    int8 of[4]; /* of pixels (0,0), (1,0), (0,1), (1,1) of the square */
} sums;

static int8 add_products(int8 sum, uchar4 x, int8 w0, int8 w1, int8 w2, int8 w3)
{
    sum += (int)x.s0 * w0;
    sum += (int)x.s1 * w1;
    sum += (int)x.s2 * w2;
    return sum + (int)x.s3 * w3;
}

static int8 get_weights(__global const char *w, int i) { return convert_int8(vload8(i, w)); }

/* The sum of a run of dwords for one pixel. */
static int8 add_run(int8 sum, __global const uchar *row, __global const char *w, uint length)
{
    __global const uchar4 *x = (__global const uchar4 *)row;
    for (uint k = 0; k < length; k++, w += 32)
        sum = add_products(sum, x[k], get_weights(w, 0), get_weights(w, 1), get_weights(w, 2),
                           get_weights(w, 3));
    return sum;
}

/* The same of words. */
static int8 add_wide_run(int8 sum, __global const uchar *row, __global const char *w, uint length)
{
    __global const ushort2 *x = (__global const ushort2 *)row;
    for (uint k = 0; k < length; k++, w += 16) {
        sum += (int)x[k].s0 * get_weights(w, 0);
        sum += (int)x[k].s1 * get_weights(w, 1);
    }
    return sum;
}

/* A run of bytes for all four pixels: at `row`, `pixel` bytes after it, and both a `pitch` later.
 */
static void add_runs(sums *s, __global const uchar *row, uint pixel, uint pitch,
                     __global const char *w, uint length)
{
    __global const uchar4 *a = (__global const uchar4 *)row;
    __global const uchar4 *b = (__global const uchar4 *)(row + pixel);
    __global const uchar4 *c = (__global const uchar4 *)(row + pitch);
    __global const uchar4 *d = (__global const uchar4 *)(row + pitch + pixel);
    for (uint k = 0; k < length; k++, w += 32) {
        int8 w0 = get_weights(w, 0), w1 = get_weights(w, 1);
        int8 w2 = get_weights(w, 2), w3 = get_weights(w, 3);
        s->of[0] = add_products(s->of[0], a[k], w0, w1, w2, w3);
        s->of[1] = add_products(s->of[1], b[k], w0, w1, w2, w3);
        s->of[2] = add_products(s->of[2], c[k], w0, w1, w2, w3);
        s->of[3] = add_products(s->of[3], d[k], w0, w1, w2, w3);
    }
}

static int is_wide(const lull_cl_conv *a, uint s) { return a->wide >> s & 1; }

/* Weights of a block of outputs for one row of taps. */
static __global const char *row_weights(__global const uchar *model, const lull_cl_conv *a, uint s,
                                        uint row, uint block)
{
    uint blocks = (a->outputs + LULL_CL_BLOCK - 1) / LULL_CL_BLOCK;
    return (__global const char *)(model + a->weights[s]) +
           (row * blocks + block) * a->length[s] * (is_wide(a, s) ? 16 : 32);
}

/* Adds source s of the layer's own resolution, for the square at (x, y). */
static void add_full(sums *sum, __global uchar *memory, __global const uchar *model,
                     const lull_cl_conv *a, uint s, int x, int y, uint block)
{
    int rows = a->form & LULL_CL_HEAD ? 1 : 3, before = rows / 2;
    for (int dy = 0; dy < rows; dy++) {
        __global const char *w = row_weights(model, a, s, dy, block);
        __global const uchar *row =
            bytes_at(memory, a->source[s], x - before, y - before + dy);
        uint pixel = a->source[s].pixel, pitch = a->source[s].pitch;
        if (is_wide(a, s))
            for (int i = 0; i < 4; i++)
                sum->of[i] = add_wide_run(sum->of[i], row + i / 2 * pitch + (i & 1) * pixel, w,
                                          a->length[s]);
        else
            add_runs(sum, row, pixel, pitch, w, a->length[s]);
    }
}

/* Adds the first source, which is upsampled: the four pixels are the four phases. */
static void add_up(sums *sum, __global uchar *memory, __global const uchar *model,
                   const lull_cl_conv *a, int x, int y, uint block)
{
    for (int phase = 0; phase < 4; phase++)
        for (int dy = 0; dy < 2; dy++) {
            __global const char *w = row_weights(model, a, 0, 2 * phase + dy, block);
            __global const uchar *row = bytes_at(memory, a->source[0], x / 2 - 1 + (phase & 1),
                                                 y / 2 - 1 + phase / 2 + dy);
            sum->of[phase] = is_wide(a, 0) ? add_wide_run(sum->of[phase], row, w, a->length[0])
                                           : add_run(sum->of[phase], row, w, a->length[0]);
        }
}

/* Adds the sources that are wide, or those that are not. */
static void add_sources(sums *sum, __global uchar *memory, __global const uchar *model,
                        const lull_cl_conv *a, int wide, int x, int y, uint block)
{
    for (uint s = 0; s < a->sources; s++)
        if (is_wide(a, s) == wide) {
            if (s == 0 && a->form & LULL_CL_UP)
                add_up(sum, memory, model, a, x, y, block);
            else
                add_full(sum, memory, model, a, s, x, y, block);
        }
}

static int8 requantise(int8 sum, int8 multiplier, int most)
{
    long8 q = (convert_long8(sum) * convert_long8(multiplier) + (long8)(1 << 30)) >> (long8)(31);
    return convert_int8(clamp(q, (long8)(0), (long8)(most)));
}

/* Eight outputs of pixel (x, y) of a tensor of width x height pixels; zeros around it. */
static void put(__global uchar *memory, const lull_cl_conv *a, int x, int y, int width, int height,
                uint block, int8 q)
{
    int words = a->most > 255, left = (int)(a->outputs - block * LULL_CL_BLOCK);
    __global uchar *to = bytes_at(memory, a->out, x, y) + (block * LULL_CL_BLOCK << words);
    if (x >= width + LULL_CL_BORDER || y >= height + LULL_CL_BORDER)
        return;
    if (x < 0 || x >= width || y < 0 || y >= height)
        q = (int8)(0);
    if (!words) {
        *(__global uchar4 *)to = convert_uchar4(q.lo);
        if (left > 4)
            *(__global uchar4 *)(to + 4) = convert_uchar4(q.hi);
        return;
    }
    *(__global ushort2 *)to = convert_ushort2(q.s01);
    if (left > 2)
        *(__global ushort2 *)(to + 4) = convert_ushort2(q.s23);
    if (left > 4)
        *(__global ushort2 *)(to + 8) = convert_ushort2(q.s45);
    if (left > 6)
        *(__global ushort2 *)(to + 12) = convert_ushort2(q.s67);
}

KERNEL_OF_PIXELS conv(__global uchar *memory, __global const uchar *model, lull_cl_conv a)
{
    int pools = (a.form & LULL_CL_POOL) != 0;
    int x = 2 * ((int)get_global_id(0) - (pools ? LULL_CL_BORDER : LULL_CL_BORDER / 2));
    int y = 2 * ((int)get_global_id(1) - (pools ? LULL_CL_BORDER : LULL_CL_BORDER / 2));
    uint block = get_global_id(2);
    int8 bias = vload8(block, (__global const int *)(model + a.bias));
    int8 multiplier = vload8(block, (__global const int *)(model + a.multiplier));
    sums sum;
    for (int i = 0; i < 4; i++)
        sum.of[i] = (int8)(0);
    if (x >= 0 && y >= 0 && x < a.width && y < a.height) {
        if (a.wide)
            add_sources(&sum, memory, model, &a, 1, x, y, block);
        for (int i = 0; i < 4; i++)
            sum.of[i] = ((sum.of[i] + (1 << a.shift >> 1)) >> (int8)(a.shift)) + bias;
        add_sources(&sum, memory, model, &a, 0, x, y, block);
    }
    if (pools) {
        int8 most = max(max(sum.of[0], sum.of[1]), max(sum.of[2], sum.of[3]));
        put(memory, &a, x / 2, y / 2, a.width / 2, a.height / 2, block,
            requantise(most, multiplier, a.most));
        return;
    }
    for (int i = 0; i < 4; i++)
        put(memory, &a, x + (i & 1), y + i / 2, a.width, a.height, block,
            requantise(sum.of[i], multiplier, a.most));
}
