#include "cases.h"

#include <math.h>

#include "guard.h"

const char *const cases_names[CASES_PATTERNS] = {"random", "min", "max", "alternating", "pairs"};

static float weights[LULL_MAX_SEGMENTS][CASES_MAX_OUTPUTS * CASES_MAX_ELEMENTS];
static float float_bias[CASES_MAX_OUTPUTS];
static int32_t int_bias[CASES_MAX_OUTPUTS], multiplier[CASES_MAX_OUTPUTS];

float cases_weight(unsigned s, unsigned o, unsigned e)
{
    return weights[s][o * CASES_MAX_ELEMENTS + e];
}

static float unit(void) { return (float)guard_between(-1000000, 1000000) * 1e-6f; }

static int has_words(cases_kind kind) { return kind == CASES_WORDS || kind == CASES_HEAD; }

/* Value of the pattern between low and high at place i. */
static int32_t pick(cases_pattern pattern, unsigned i, int32_t low, int32_t high)
{
    switch (pattern) {
    case CASES_MIN: return low;
    case CASES_MAX:
    case CASES_PAIRS: return high;
    case CASES_ALTERNATING: return i & 1 ? low : high;
    default: return guard_between(low, high);
    }
}

/* Two weights of a pair: positive ones sum to at most 128, negative ones to at least -128. */
static void pick_pair(cases_pattern pattern, float pair[2])
{
    int a, b;
    switch (pattern) {
    case CASES_MIN: a = b = -64; break;
    case CASES_MAX: a = b = 64; break;
    case CASES_ALTERNATING: a = 127, b = -127; break;
    case CASES_PAIRS:
        a = guard_between(1, 127);
        b = 128 - a;
        if (guard_below(2))
            a = -a, b = -b;
        break;
    default:
        a = guard_between(-127, 127);
        b = guard_between(-127, 127);
        if (a > 0 && b > 0 && a + b > 128)
            b = 128 - a;
        if (a < 0 && b < 0 && a + b < -128)
            b = -128 - a;
    }
    pair[0] = (float)a;
    pair[1] = (float)b;
}

static void make_int_weights(const cases_conv *c, cases_pattern pattern, unsigned s)
{
    for (unsigned o = 0; o < c->conv.outputs; o++) {
        float *w = &weights[s][o * CASES_MAX_ELEMENTS];
        for (unsigned e = 0; e < c->elements[s]; e++) {
            float pair[2];
            if (s < c->conv.wide)
                w[e] = (float)pick(pattern, e, -127, 127);
            else if (e % 2 == 0) {
                pick_pair(pattern, pair);
                w[e] = pair[0];
                if (e + 1 < c->elements[s])
                    w[e + 1] = pair[1];
            }
        }
    }
}

/* Adds up to `left` to the sizes of some weights of this sign, `together` at a time: of `dwords`
 * times two weights, from `first` on in every second pair of a run. */
static void spread(float *first, unsigned dwords, int sign, int left, int together)
{
    for (unsigned tries = 0; left > 0 && tries < 1000; tries++) {
        float *w = first + 4 * guard_below(dwords) + guard_below(2);
        int most = (float)sign * *w < 0 ? 0 : 127 - (int)fabs((double)*w);
        most = most < together ? most : together;
        most = most < left ? most : left;
        *w += (float)(sign * most);
        left -= most;
    }
}

/* Weights of segment s: of both words the positive ones sum to at most 128, and the negative ones
 * to at least -128. */
static void make_word_weights(const cases_conv *c, cases_pattern pattern, unsigned s)
{
    unsigned dwords = c->conv.segment[s].length, half = (dwords + 1) / 2;
    memset(weights[s], 0, sizeof weights[s]);
    for (unsigned i = 0; i < 2 * c->conv.outputs; i++) {
        float *first = &weights[s][i / 2 * CASES_MAX_ELEMENTS + 2 * (i % 2)], *pair;
        int sign = guard_below(2) ? 1 : -1;
        switch (pattern) {
        case CASES_MIN:
        case CASES_MAX:
            pair = first + 4 * guard_below(dwords);
            pair[i / 4 % 2] = pattern == CASES_MIN ? -127.0f : 127.0f;
            pair[!(i / 4 % 2)] = pattern == CASES_MIN ? -1.0f : 1.0f;
            break;
        case CASES_ALTERNATING:
            spread(first, half, sign, 128, 20);
            spread(first + 4 * (dwords - half), half, -sign, 128, 20);
            break;
        case CASES_PAIRS:
            spread(first, dwords, sign, 128, 1);
            spread(first, dwords, -sign, 128, 1);
            break;
        default:
            spread(first, dwords, 1, guard_between(0, 128), guard_between(1, 127));
            spread(first, dwords, -1, guard_between(0, 128), guard_between(1, 127));
        }
    }
}

static void make_float_weights(const cases_conv *c, cases_pattern pattern, unsigned s)
{
    for (unsigned o = 0; o < c->conv.outputs; o++)
        for (unsigned e = 0; e < c->elements[s]; e++) {
            float *w = &weights[s][o * CASES_MAX_ELEMENTS + e];
            *w = pattern == CASES_RANDOM  ? unit()
                 : pattern == CASES_PAIRS ? unit() * (float)(1u << guard_below(20))
                                          : (float)pick(pattern, e, -100, 100);
        }
}

/* An output whose sum is its bias, and the result so little below a half (less than 2^-18) that a
 * float holds it only if it is rounded down. */
static void just_below_a_half(const lull_conv *conv, unsigned o)
{
    int32_t left;
    for (unsigned s = 0; s < conv->segments; s++)
        for (unsigned e = 0; e < CASES_MAX_ELEMENTS; e++)
            weights[s][o * CASES_MAX_ELEMENTS + e] = 0.0f;
    do {
        int64_t half = (int64_t)guard_between(64, 254) * 2 + 1; /* times 2^-1 */
        int_bias[o] = guard_between(1 << 15, 1 << 17);
        multiplier[o] = (int32_t)((half << 30) / int_bias[o]);
        left = (int32_t)((half << 30) % int_bias[o]);
    } while (!left || left >= 1 << 13 || multiplier[o] >= 1 << 24);
}

/* Bias and multiplier of every output: sums stay in int32, results fall on both sides of the
 * clamp. */
static void make_int_scales(cases_conv *c, cases_pattern pattern, cases_kind kind)
{
    lull_conv *conv = &c->conv;
    int is_layer = kind != CASES_ANY, may_be_small = is_layer || guard_below(4) != 0;
    conv->is_small = may_be_small;
    conv->fits_words = has_words(kind);
    for (unsigned o = 0; o < conv->outputs; o++) {
        double wide = 0, narrow = 0, negative = 0, room;
        for (unsigned s = 0; s < conv->segments; s++)
            for (unsigned e = 0; e < c->elements[s]; e++) {
                double w = (double)cases_weight(s, o, e);
                *(s < conv->wide ? &wide : &narrow) += fabs(w);
                negative += w < 0 ? -w : 0;
            }
        wide = floor((wide * 32767 + (1 << conv->wide_shift >> 1)) / (1 << conv->wide_shift));
        room = 2147483647.0 - wide - narrow * 255;
        room = is_layer || guard_below(4) ? fmin(room, 1 << 12) : room; /* mostly small */
        int_bias[o] = pick(pattern, o, -(int32_t)room, (int32_t)room);
        multiplier[o] = pattern == CASES_RANDOM || pattern == CASES_PAIRS
                            ? guard_between(0, (1 << (10 + guard_below(21))) - 1)
                            : pick(pattern, o, 0, (1 << 30) - 1);
        if (is_layer) /* results in the middle of their range */
            multiplier[o] = (int32_t)fmin(1 << 30, (1 << 11) * 1048576.0 / (narrow + 1));
        if (has_words(kind)) { /* all sums, whatever their sign, in different results */
            int_bias[o] = (int32_t)(255 * negative);
            multiplier[o] = (int32_t)fmin((1 << 30) - 1, (1 << 11) * 1048576.0 / (narrow + 1) *
                                                             (conv->out_max > 255 ? 100 : 1));
        }
        if (may_be_small) /* 24 bits; often a power of two or so, for results with halves */
            multiplier[o] = guard_below(2)              ? multiplier[o] & ~0xffff
                            : multiplier[o] >= 1 << 24 ? multiplier[o] & ~0x3f
                                                       : multiplier[o];
        if (is_layer && guard_below(4) == 0) {
            just_below_a_half(conv, o);
            continue;
        }
        if (wide + fabs((double)int_bias[o]) + narrow * 255 > 1 << 24)
            conv->is_small = 0;
    }
}

static void fill_row(const cases_conv *c, cases_pattern pattern, unsigned s, void *row, size_t n,
                     cases_kind kind)
{
    int is_wide = s < c->conv.wide;
    if (has_words(kind) && pattern != CASES_RANDOM)
        pattern = CASES_MAX;
    for (size_t i = 0; i < n; i++) {
        int32_t high = is_wide ? 32767 : 255;
        if (!c->is_integer) {
            float v = pattern == CASES_RANDOM || pattern == CASES_PAIRS
                          ? unit()
                          : (float)pick(pattern, (unsigned)i, 0, 1000);
            memcpy((float *)row + i, &v, sizeof v);
        } else if (is_wide) {
            ((uint16_t *)row)[i] = (uint16_t)pick(pattern, (unsigned)i, 0, high);
        } else {
            ((uint8_t *)row)[i] = (uint8_t)pick(pattern, (unsigned)i, 0, high);
        }
    }
}

static void make_segment(cases_conv *c, cases_pattern pattern, unsigned s, cases_kind kind)
{
    int is_layer = kind != CASES_ANY;
    lull_segment *segment = &c->conv.segment[s];
    unsigned group = !c->is_integer ? 1 : s < c->conv.wide ? 2 : 4;
    size_t bytes = 4 / group, span;
    void *row;
    segment->length = 1 + guard_below(guard_below(4) ? 12 : 40);
    segment->step = 1 + guard_below(2 * group * segment->length);
    c->elements[s] = group * segment->length - guard_below(group);
    if (is_layer || guard_below(2)) { /* 1 to 3 columns, the next pixel one or two on */
        unsigned columns = kind == CASES_LAYER ? 2 + guard_below(2)
                           : has_words(kind)   ? 1 + guard_below(4)
                                               : 1 + guard_below(3);
        unsigned channels = group * (1 + guard_below(12));
        if (kind == CASES_HEAD)
            columns = 1, channels = group * (2 + guard_below(LULL_HEAD_RUN - 1));
        segment->length = columns * channels / group;
        segment->step = columns == 3 && guard_below(2) ? 2 * channels : channels;
        c->elements[s] = columns * channels;
    }
    span = (size_t)(c->conv.pixels - 1) * segment->step + (size_t)group * segment->length;
    row = guard_place(GUARD_ROW + s, span * bytes, c->at_end);
    fill_row(c, pattern, s, row, span, kind);
    segment->row = row;
    if (c->is_integer)
        make_int_weights(c, pattern, s);
    else
        make_float_weights(c, pattern, s);
}

void cases_make(cases_conv *c, int is_integer, cases_pattern pattern, unsigned outputs,
                unsigned pixels, cases_kind kind)
{
    static const int32_t maxima[] = {255, 255, 255, 100, 32767, 32767, 256, 1000};
    lull_conv *conv = &c->conv;
    memset(c, 0, sizeof *c);
    c->is_integer = is_integer;
    c->at_end = guard_below(2) != 0;
    conv->outputs = outputs;
    conv->pixels = pixels;
    conv->segments = kind == CASES_HEAD ? 1 : 1 + guard_below(LULL_MAX_SEGMENTS);
    conv->out_step = outputs + (guard_below(2) ? guard_below(2 * outputs) : 0);
    if (is_integer) {
        conv->wide = kind == CASES_ANY && guard_below(3) ? guard_below(conv->segments + 1) : 0;
        conv->wide_shift = guard_below(2) ? guard_below(16) : 0;
        conv->out_max = maxima[guard_below(kind == CASES_LAYER || kind == CASES_HEAD ? 4 : 8)];
    }
    for (unsigned s = 0; s < conv->segments; s++)
        make_segment(c, pattern, s, kind);
    for (unsigned s = 0; has_words(kind) && s < conv->segments; s++)
        make_word_weights(c, pattern, s);
    if (is_integer)
        make_int_scales(c, pattern, kind);
    else
        conv->least = guard_below(2) ? 0.0f : -LULL_FLT_MAX;
    if (!is_integer)
        for (unsigned o = 0; o < outputs; o++)
            float_bias[o] = unit() * (pattern == CASES_PAIRS ? 1e3f : 1.0f);
}

static void pack_segment(cases_conv *c, unsigned s, unsigned block, int is_split)
{
    lull_segment *segment = &c->conv.segment[s];
    unsigned group = !c->is_integer ? 1 : s < c->conv.wide ? 2 : 4;
    size_t whole = lull_align_up(c->conv.outputs, block), i = 0;
    size_t bytes = whole * segment->length * 4;
    int is_twice = is_split && group == 2;
    uint8_t *to = guard_place(GUARD_WEIGHTS + s, is_twice ? 2 * bytes : bytes, c->at_end);
    segment->weights = to;
    for (size_t first = 0; first < whole; first += block)
        for (unsigned k = 0; k < segment->length; k++)
            for (size_t o = first; o < first + block; o++)
                for (unsigned e = k * group; e < (k + 1) * group; e++, i++) {
                    float w = o < c->conv.outputs && e < c->elements[s]
                                  ? cases_weight(s, (unsigned)o, e)
                                  : 0.0f;
                    int16_t wide = (int16_t)w;
                    if (is_twice) { /* on a little-endian CPU */
                        wide = (int16_t)(uint8_t)(int8_t)w;
                        memcpy(to + bytes + 2 * i, &wide, 2);
                        wide = (int16_t)(uint16_t)((uint16_t)wide << 8);
                    }
                    if (group == 1)
                        memcpy(to + 4 * i, &w, 4);
                    else if (group == 2)
                        memcpy(to + 2 * i, &wide, 2);
                    else
                        ((int8_t *)to)[i] = (int8_t)w;
                }
}

/* Bias of output o at pixel p. */
static int32_t bias_at(const cases_conv *c, unsigned p, unsigned o)
{
    return c->has_start ? int_bias[o] / (int32_t)(1 + p % 3) : int_bias[o];
}

static void place_start(cases_conv *c)
{
    lull_conv *conv = &c->conv; /* whole vectors are read, of the last pixel, too */
    size_t whole = lull_align_up(conv->outputs, 16), words;
    int32_t *start;
    conv->start_step = conv->outputs + 5;
    words = (conv->pixels - 1) * conv->start_step + whole;
    start = guard_place(GUARD_START, words * sizeof *start, c->at_end);
    memset(start, 0, words * sizeof *start);
    for (unsigned p = 0; p < conv->pixels; p++)
        for (unsigned o = 0; o < conv->outputs; o++)
            start[p * conv->start_step + o] = bias_at(c, p, o);
    conv->start = start;
}

void cases_pack(cases_conv *c, unsigned block, int is_split)
{
    size_t whole = lull_align_up(c->conv.outputs, block), used = c->conv.outputs * (size_t)4;
    uint8_t *bias = guard_place(GUARD_BIAS, whole * 4, c->at_end);
    uint8_t *scale = guard_place(GUARD_MULTIPLIER, whole * 4, c->at_end);
    for (unsigned s = 0; s < c->conv.segments; s++)
        pack_segment(c, s, block, is_split);
    memset(bias, 0, whole * 4);
    memset(scale, 0, whole * 4);
    memcpy(bias, c->is_integer ? (void *)int_bias : (void *)float_bias, used);
    memcpy(scale, multiplier, used);
    c->conv.bias = bias;
    if (c->has_start)
        place_start(c);
    c->conv.multiplier = (int32_t *)(void *)scale;
}

size_t cases_out_bytes(const cases_conv *c)
{
    size_t size = !c->is_integer ? 4 : c->conv.out_max <= 255 ? 1 : 2;
    return ((c->conv.pixels - 1) * c->conv.out_step + c->conv.outputs) * size;
}

/* Element e of pixel p's run in segment s. */
static double element(const cases_conv *c, unsigned s, unsigned p, unsigned e)
{
    const lull_segment *segment = &c->conv.segment[s];
    size_t at = (size_t)p * segment->step + e;
    if (!c->is_integer)
        return (double)((const float *)segment->row)[at];
    return s < c->conv.wide ? (double)((const uint16_t *)segment->row)[at]
                            : (double)((const uint8_t *)segment->row)[at];
}

static double requantised(const cases_conv *c, unsigned p, unsigned o, double wide, double narrow)
{
    const lull_conv *conv = &c->conv;
    double scale = 1 << conv->wide_shift;
    double a = floor((wide + (1 << conv->wide_shift >> 1)) / scale) + bias_at(c, p, o) + narrow;
    /* a * M + 2^30 needs 61 bits: the low 15 bits of a apart */
    double high = floor(a / 32768), low = a - high * 32768;
    double q = high * multiplier[o] + floor((low * multiplier[o] + (1 << 30)) / 32768);
    q = floor(q / 65536);
    return fmax(0, fmin(q, conv->out_max));
}

void cases_define(const cases_conv *c, double *value, double *size)
{
    const lull_conv *conv = &c->conv;
    for (unsigned p = 0; p < conv->pixels; p++)
        for (unsigned o = 0; o < conv->outputs; o++) {
            double wide = 0, sum = 0, absolute = 0;
            size_t at = (size_t)p * conv->outputs + o;
            for (unsigned s = 0; s < conv->segments; s++)
                for (unsigned e = 0; e < c->elements[s]; e++) {
                    double product = element(c, s, p, e) * (double)cases_weight(s, o, e);
                    *(s < conv->wide ? &wide : &sum) += product;
                    absolute += fabs(product);
                }
            if (c->is_integer) {
                value[at] = requantised(c, p, o, wide, sum);
            } else {
                value[at] = fmax((double)conv->least, sum + (double)float_bias[o]);
                size[at] = absolute + fabs((double)float_bias[o]);
            }
        }
}
