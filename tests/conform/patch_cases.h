/* Part of conform.c: integer layers in patches, by the matrices of docs/arithmetic.md. */
#ifndef LULL_TESTS_PATCH_CASES_H
#define LULL_TESTS_PATCH_CASES_H

static int whole(double v) { return (int)v; }

/* Codes of n elements; at odd rounds the pattern's extremes in an order by chance. */
static void fill_codes(uint8_t *row, size_t n, int is_wide)
{
    for (size_t i = 0; i < n; i++) {
        int32_t high = is_wide ? LULL_PATCH_WIDE_MAX : 255;
        int32_t code = now.pattern == CASES_MIN           ? 0
                       : now.pattern == CASES_MAX         ? high
                       : now.pattern == CASES_PAIRS       ? (guard_below(2) ? high : 0)
                       : now.pattern == CASES_ALTERNATING ? (i & 1 ? high : 0)
                                                          : guard_between(0, high);
        uint16_t wide = (uint16_t)code;
        if (is_wide)
            memcpy(row + 2 * i, &wide, 2);
        else
            row[i] = (uint8_t)code;
    }
}

/* IR and OR of wide codes. */
static const int wide_in[4][4] = {{1, 0, -1, 0}, {0, 1, 1, 0}, {0, -1, 1, 0}, {0, 1, 0, -1}};
static const int wide_out[2][4] = {{1, 1, 1, 0}, {0, 1, -1, -1}};

/* Point k of patch p and channel c by definition. */
static int patch_point(const lull_patches *w, unsigned k, unsigned p, unsigned c)
{
    unsigned side = lull_patch_side(w->is_wide), field = side + 2;
    int sum = 0;
    for (unsigned y = 0; y < field; y++)
        for (unsigned x = 0; x < field; x++) {
            size_t at = ((size_t)side * p + x) * w->channels + c;
            uint16_t code = w->row[y][w->is_wide ? 2 * at : at];
            if (w->is_wide)
                memcpy(&code, w->row[y] + 2 * at, 2);
            sum += (w->is_wide ? wide_in[k / 4][y] * wide_in[k % 4][x]
                               : whole(in_columns[k / 6][y]) * whole(in_columns[k % 6][x])) *
                   code;
        }
    return sum;
}

/* Compares every word of the buffer: points, and what lies between and was not to be written. */
static int patch_points_agree(const lull_patches *w, size_t words)
{
    for (size_t i = 0; i < words; i++) {
        unsigned k = (unsigned)(i / w->plane), at = (unsigned)(i % w->plane);
        int want;
        if (at >= w->patches * w->channels) {
            if (memcmp(w->points + i, before + 2 * i, 2) != 0)
                return 0;
            continue;
        }
        want = patch_point(w, k, at / w->channels, at % w->channels);
        if (w->points[i] != want || (!now.is_scalar && ((int16_t *)(void *)expected)[i] != want)) {
            printf("  point %u at %u is %d, not %d\n", k, at, w->points[i], want);
            return 0;
        }
    }
    return 1;
}

static void patches_in_case(unsigned channels, unsigned patches, int is_wide)
{
    lull_patches w;
    size_t elements = ((size_t)lull_patch_side(is_wide) * patches + 2) * channels, words;
    int at_end = guard_below(2) != 0;
    memset(&w, 0, sizeof w);
    w.channels = channels;
    w.patches = patches;
    w.is_wide = is_wide;
    w.plane = (size_t)channels * patches + guard_below(20);
    for (unsigned y = 0; y < lull_patch_side(is_wide) + 2; y++) {
        uint8_t *row = guard_place(GUARD_ROW + y, elements << is_wide, at_end);
        fill_codes(row, elements, is_wide);
        w.row[y] = row;
    }
    words = (lull_patch_points(is_wide) - 1) * w.plane + (size_t)channels * patches;
    if (!now.is_scalar) {
        w.points = (int16_t *)(void *)expected;
        now.scalar.patches_in(&w);
    }
    w.points = guard_place(GUARD_OUT, words * 2, at_end);
    memcpy(w.points, before, words * 2);
    now.port->patches_in(&w);
    now.cases++;
    if (!CHECK(patch_points_agree(&w, words)))
        printf("  with %u channels, %u patches%s\n", channels, patches, is_wide ? ", wide" : "");
}

static void patches_in_cases(void)
{
    for (unsigned channels = 16; channels <= 144; channels += LULL_PATCH_CHANNELS)
        for (int is_wide = 0; is_wide < 2; is_wide++)
            for (unsigned round = 0; round < ROUNDS; round++)
                patches_in_case(channels, 1 + guard_below(6), is_wide);
}

static int16_t word_value(size_t i)
{
    return (int16_t)(now.pattern == CASES_MIN           ? -32768
                     : now.pattern == CASES_MAX         ? 32767
                     : now.pattern == CASES_ALTERNATING ? (i & 1 ? -32768 : 32767)
                                                        : guard_between(-32768, 32767));
}

/* Products at a point, with the widest words there are: sums wrap. */
static void points_int_case(unsigned outputs, unsigned pixels, unsigned pairs)
{
    lull_conv conv;
    lull_segment *segment = &conv.segment[0];
    unsigned block = now.port->block_int;
    size_t blocked = lull_align_up(outputs, block), out_bytes;
    int at_end = guard_below(2) != 0;
    int16_t *x, *w;
    uint32_t *out;
    memset(&conv, 0, sizeof conv);
    conv.outputs = outputs;
    conv.pixels = pixels;
    conv.segments = 1;
    conv.out_step = outputs + guard_below(9);
    segment->length = pairs;
    segment->step = pairs + guard_below(5);
    x = guard_place(GUARD_ROW, ((size_t)(pixels - 1) * segment->step + pairs) * 4, at_end);
    w = guard_place(GUARD_WEIGHTS, blocked * pairs * 4, at_end);
    for (size_t i = 0; i < 2 * ((size_t)(pixels - 1) * segment->step + pairs); i++)
        x[i] = word_value(i);
    for (size_t i = 0; i < blocked * pairs * 2; i++)
        w[i] = word_value(i / 3);
    out_bytes = ((pixels - 1) * conv.out_step + outputs) * 4;
    out = guard_place(GUARD_OUT, out_bytes, at_end);
    memcpy(out, before, out_bytes);
    segment->row = x;
    segment->weights = w;
    conv.out = out;
    now.port->points_int(&conv);
    now.cases++;
    for (size_t p = 0; p < pixels; p++)
        for (size_t o = 0; o < conv.out_step && p * conv.out_step + o < out_bytes / 4; o++) {
            uint32_t want;
            memcpy(&want, before + 4 * (p * conv.out_step + o), 4);
            if (o < outputs)
                want = 0;
            for (size_t k = 0; k < 2 * (size_t)pairs && o < outputs; k++)
                want +=
                    (uint32_t)(x[p * segment->step * 2 + k] *
                               w[((o / block * pairs + k / 2) * block + o % block) * 2 + k % 2]);
            if (!CHECK(out[p * conv.out_step + o] == want)) {
                printf("  output %u of %u, pixel %u of %u, %u pairs\n", (unsigned)o, outputs,
                       (unsigned)p, pixels, pairs);
                return;
            }
        }
}

static void points_int_cases(void)
{
    for (unsigned pixels = 1; pixels <= MAX_PIXELS; pixels++)
        points_int_case(1 + guard_below(129), pixels, 1 + guard_below(40));
    for (unsigned outputs = 1; outputs <= 8 * now.port->block_int + 1; outputs++)
        points_int_case(outputs, 1 + guard_below(MAX_PIXELS), 1 + guard_below(20));
}

/* The sum of products of pixel (x, y) of a patch of wide codes, by definition. */
static int32_t wide_pixel(const int32_t *sums, size_t plane, unsigned x, unsigned y)
{
    uint32_t sum = 0;
    for (unsigned k = 0; k < LULL_PATCH_WIDE_POINTS; k++)
        sum += (uint32_t)(wide_out[y][k / 4] * wide_out[x][k % 4]) * (uint32_t)sums[k * plane];
    return (int32_t)sum >> LULL_PATCH_WIDE_SHIFT;
}

/* The sum of products of pixel (x, y) of a patch, by definition. */
static int32_t patch_pixel(const int32_t *sums, size_t plane, unsigned phase, unsigned x,
                           unsigned y)
{
    uint32_t sum = 0;
    for (unsigned k = 0; k < LULL_PATCH_POINTS; k++) {
        static const unsigned absent[] = {5, 0, 6}; /* of even, odd and all rows or columns */
        unsigned no_row = absent[phase < 4 ? phase / 2 : 2];
        unsigned no_column = absent[phase < 4 ? phase % 2 : 2];
        int last = k / 6 == 5 ? 4 : 1, factor = whole(out_columns[y][k / 6]) * last;
        factor *= whole(out_columns[x][k % 6]) * (k % 6 == 5 ? 4 : 1);
        if (k / 6 != no_row && k % 6 != no_column)
            sum += (uint32_t)factor * (uint32_t)sums[k * plane];
    }
    return (int32_t)(sum * LULL_PATCH_INVERSE) >> LULL_PATCH_SHIFT;
}

/* Output c of pixel (x, y) of a patch that begins at column `first`. */
static double patch_code(const lull_patches *w, const int32_t *sums, unsigned first, unsigned x,
                         unsigned y, unsigned c)
{
    int32_t start = w->start ? w->start[y * w->start_row + (size_t)(first + x) * w->channels + c]
                             : w->bias[c];
    double q, a = w->is_wide ? floor(((double)wide_pixel(sums, w->plane, x, y) +
                                      (1 << w->shift >> 1)) /
                                     (1 << w->shift))
                             : patch_pixel(sums, w->plane, w->phase, x, y);
    if (w->is_raw)
        return a + start;
    q = floor(((a + start) * w->multiplier[c] + (1 << 30)) / 2147483648.0);
    return q < 0 ? 0 : q > w->out_max ? w->out_max : q;
}

/* What is stored at place `at` of row y. */
static double patch_value(const lull_patches *w, unsigned y, size_t at)
{
    uint16_t wide;
    if (w->is_raw)
        return ((const int32_t *)(const void *)w->out[y])[at];
    if (w->out_max <= 255)
        return w->out[y][at];
    return memcpy(&wide, w->out[y] + 2 * at, 2), wide;
}

static int patch_codes_agree(const lull_patches *w, const int32_t *sums)
{
    unsigned columns = w->is_pooled || w->is_wide ? 2 : 4, n = w->channels;
    for (unsigned y = 0; y < columns; y++)
        for (unsigned x = 0; x < columns * w->patches; x++)
            for (unsigned c = 0; c < n; c++) {
                size_t at = (size_t)x * (w->is_raw ? w->raw_step : n) + c;
                const int32_t *of = sums + x / columns * n + c;
                double want = 0, got = patch_value(w, y, at);
                if (w->is_pooled)
                    for (unsigned i = 0; i < 4; i++)
                        want =
                            fmax(want, patch_code(w, of, 0, x % 2 * 2 + (i & 1),
                                                  2 * y + (i >> 1), c));
                else
                    want = patch_code(w, of, x / columns * columns, x % columns, y, c);
                if (got != want) {
                    printf("  row %u, column %u, channel %u is %g, not %g\n", y, x, c, got, want);
                    return 0;
                }
            }
    return 1;
}

/* Sums at points by chance: those of small ones so that a float holds them, those of wide codes
 * also so that a stays in int32. Multipliers are so short that doubles hold the products. */
static void make_sums(lull_patches *w, int32_t *sums, int32_t *bias, int32_t *multiplier)
{
    size_t n = lull_patch_points(w->is_wide) * w->plane;
    for (size_t i = 0; i < n; i++) {
        int32_t most = w->is_small ? 100 * 576 : w->is_wide ? INT32_MAX / 36 : INT32_MAX;
        int32_t sum = now.pattern == CASES_MIN   ? -most
                      : now.pattern == CASES_MAX ? most
                                                 : guard_between(-most, most);
        sums[i] = w->is_small ? sum / 576 * 576 : sum;
    }
    for (unsigned c = 0; c < w->channels; c++) {
        bias[c] = guard_between(-100000, 100000);
        multiplier[c] = guard_between(0, (1 << (2 + guard_below(19))) - 1) << guard_below(5);
    }
    w->bias = bias;
    w->multiplier = multiplier;
}

/* Rows to start from; in some cases. */
static void make_start(lull_patches *w, int at_end)
{
    size_t row = (size_t)LULL_PATCH_SIDE * w->patches * w->channels, n;
    int32_t *start;
    if (w->is_wide || w->is_pooled || guard_below(2))
        return;
    w->start_row = row + guard_below(20);
    n = 3 * w->start_row + row;
    w->start = start = guard_place(GUARD_START, n * sizeof *start, at_end);
    for (size_t i = 0; i < n; i++)
        start[i] = guard_between(-100000, 100000);
}

static void patches_out_case(unsigned channels, unsigned patches, int is_wide, int is_pooled,
                             int is_raw)
{
    static const int32_t maxima[] = {255, 255, 100, 32767, 1000};
    lull_patches w;
    size_t points, row_bytes;
    int at_end = guard_below(2) != 0, mode;
    int32_t *sums, *kept = (int32_t *)(void *)expected;
    memset(&w, 0, sizeof w);
    w.channels = channels;
    w.patches = patches;
    w.is_wide = is_wide;
    w.is_pooled = is_pooled;
    w.is_raw = is_raw;
    w.is_small = (int)guard_below(2);
    w.shift = is_wide ? guard_below(16) : 0;
    w.phase = is_wide || is_pooled ? LULL_PATCH_WHOLE : guard_below(LULL_PATCH_WHOLE + 1);
    w.out_max = maxima[guard_below(5)];
    w.plane = (size_t)channels * patches + guard_below(20);
    points = lull_patch_points(is_wide) * w.plane;
    sums = guard_place(GUARD_WEIGHTS, points * sizeof *sums, at_end);
    make_sums(&w, sums, guard_place(GUARD_BIAS, channels * sizeof(int32_t), at_end),
              guard_place(GUARD_MULTIPLIER, channels * sizeof(int32_t), at_end));
    memcpy(kept, sums, points * sizeof *sums);
    make_start(&w, at_end);
    w.raw_step = channels * (1 + guard_below(2));
    row_bytes = (size_t)(is_pooled || is_wide ? 2 : 4) * patches * channels;
    row_bytes *= w.out_max <= 255 ? 1 : 2;
    if (is_raw)
        row_bytes = ((4 * (size_t)patches - 1) * w.raw_step + channels) * sizeof(int32_t);
    for (unsigned y = 0; y < (is_pooled || is_wide ? 2u : 4u); y++)
        w.out[y] = guard_place(GUARD_ROW + y, row_bytes, at_end);
    w.sums = sums;
    if (!is_wide)
        w.room = guard_place(GUARD_ROOM, LULL_PATCH_ROOM * sizeof *w.room, at_end);
    mode = caller_rounds();
    now.port->patches_out(&w);
    caller_goes_on(mode);
    now.cases++;
    if (!CHECK(patch_codes_agree(&w, kept)))
        printf("  with %u channels, %u patches, phase %u%s%s%s%s%s, shift %u, maximum %ld\n",
               channels, patches, w.phase,
               is_wide ? ", wide" : "", is_pooled ? ", pooled" : "", is_raw ? ", raw" : "",
               w.start ? ", start" : "",
               w.is_small ? ", small" : "", w.shift, (long)w.out_max);
}

static void patches_out_cases(void)
{
    for (unsigned channels = 16; channels <= 144; channels += LULL_PATCH_CHANNELS)
        for (unsigned kind = 0; kind < 5 * ROUNDS; kind++) {
            int is_wide = kind % 5 == 3;
            patches_out_case(channels, 1 + guard_below(6), is_wide, kind % 5 < 2, kind % 5 == 4);
        }
}

#endif
