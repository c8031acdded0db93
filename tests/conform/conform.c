#include "conform.h"

#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "cases.h"
#include "check.h"
#include "guard.h"

#define MAX_PIXELS 49u /* two tiles of 24 and one */
#define ROUNDS 2u

/* The running test. */
static struct {
    const lull_kernels *port;
    lull_kernels scalar;
    int is_scalar, is_int3;
    float tolerance;
    cases_pattern pattern;
    unsigned cases;
} now;

static LULL_ALIGNED(64) uint8_t expected[1u << 20], before[1u << 20];
static double value[MAX_PIXELS * CASES_MAX_OUTPUTS], size[MAX_PIXELS * CASES_MAX_OUTPUTS];

static double stored(const cases_conv *c, const uint8_t *out, size_t at)
{
    float f;
    uint16_t wide;
    if (!c->is_integer)
        return (double)(memcpy(&f, out + 4 * at, 4), f);
    if (c->conv.out_max <= 255)
        return (double)out[at];
    return (double)(memcpy(&wide, out + 2 * at, 2), wide);
}

/* Elements against the definition (scalar) or against the scalar port. */
static int elements_agree(const cases_conv *c, const uint8_t *out)
{
    const lull_conv *conv = &c->conv;
    for (size_t p = 0; p < conv->pixels; p++)
        for (size_t o = 0; o < conv->outputs; o++) {
            size_t at = p * conv->out_step + o, i = p * conv->outputs + o;
            double want = now.is_scalar ? value[i] : stored(c, expected, at);
            double limit = c->is_integer ? 0 : (double)now.tolerance * size[i];
            if (!(fabs(stored(c, out, at) - want) <= limit)) {
                printf("  output %u of pixel %u is %.9g, not %.9g\n", (unsigned)o, (unsigned)p,
                       stored(c, out, at), want);
                return 0;
            }
        }
    return 1;
}

/* What lies between the pixels is as it was. */
static int gaps_untouched(const cases_conv *c, const uint8_t *out)
{
    size_t bytes = !c->is_integer ? 4 : c->conv.out_max <= 255 ? 1 : 2;
    size_t step = c->conv.out_step * bytes, used = c->conv.outputs * bytes;
    for (size_t p = 0; p + 1 < c->conv.pixels; p++)
        if (memcmp(out + p * step + used, before + p * step + used, step - used) != 0)
            return 0;
    return 1;
}

/* How floats are rounded: 1 up, 2 down, 0 otherwise. (On x86 fegetround asks another register.) */
static int rounding(void)
{
    volatile float one = 1.0f, tiny = 1e-9f;
    volatile float more = one + tiny, less = one - tiny;
    return more > one ? 1 : less < one ? 2 : 0;
}

/* Integer kernels neither heed how the caller rounds floats nor change it. */
static int caller_rounds(void)
{
#if defined(FE_UPWARD)
    (void)fesetround(guard_below(2) ? FE_UPWARD : FE_TONEAREST);
#endif
    return rounding();
}
static void caller_goes_on(int mode)
{
    CHECK(rounding() == mode);
    (void)fesetround(FE_TONEAREST);
}

static void run_conv(const lull_kernels *kernels, cases_conv *c, void *out)
{
    int mode;
    memcpy(out, before, cases_out_bytes(c));
    c->conv.out = out;
    cases_pack(c, now.is_int3 ? 1 : c->is_integer ? kernels->block_int : kernels->block_f32,
               !now.is_int3 && kernels->splits_wide);
    if (!c->is_integer) {
        kernels->conv_f32(&c->conv);
        return;
    }
    mode = caller_rounds();
    if (now.is_int3)
        kernels->conv_int3(&c->conv);
    else
        kernels->conv_int(&c->conv);
    caller_goes_on(mode);
}

static void conv_case(int is_integer, unsigned outputs, unsigned pixels, cases_kind kind)
{
    cases_conv c;
    uint8_t *out;
    int has_patches = now.port->patches_u || now.port->patches_k;
    cases_make(&c, is_integer, now.pattern, outputs, pixels, kind);
    c.has_start =
        is_integer && !now.is_int3 && (now.is_scalar || has_patches) && guard_below(3) == 0;
    out = guard_place(GUARD_OUT, cases_out_bytes(&c), c.at_end);
    if (now.is_scalar || !is_integer)
        cases_define(&c, value, size);
    if (!now.is_scalar) {
        run_conv(&now.scalar, &c, out);
        memcpy(expected, out, cases_out_bytes(&c));
    }
    run_conv(now.port, &c, out);
    now.cases++;
    if (!CHECK(elements_agree(&c, out) && gaps_untouched(&c, out)))
        printf("  with %u outputs, %u pixels, %u segments (%u wide, shift %u), maximum %ld%s\n",
               outputs, pixels, c.conv.segments, c.conv.wide, c.conv.wide_shift,
               (long)c.conv.out_max, c.conv.fits_words ? ", in words" : "");
}

/* Every number of pixels and every number of outputs up to two of the largest tiles and one. */
static void conv_cases(int is_integer)
{
    unsigned block = is_integer ? now.port->block_int : now.port->block_f32;
    unsigned most = 8 * block + 1;
    CHECK(most <= CASES_MAX_OUTPUTS);
    for (unsigned round = 0; round < ROUNDS; round++) {
        for (unsigned pixels = 1; pixels <= MAX_PIXELS; pixels++)
            conv_case(is_integer, 1 + guard_below(most), pixels, CASES_ANY);
        for (unsigned outputs = 1; outputs <= most; outputs++)
            conv_case(is_integer, outputs, 1 + guard_below(MAX_PIXELS), CASES_ANY);
        for (unsigned outputs = 1; outputs <= 2 * block; outputs++) /* most tiles share columns */
            conv_case(is_integer, outputs, MAX_PIXELS / 2 + guard_below(MAX_PIXELS / 2),
                      CASES_LAYER);
        for (unsigned outputs = 1; is_integer && outputs <= most; outputs++)
            conv_case(1, outputs, 1 + guard_below(MAX_PIXELS), CASES_WORDS);
    }
}

static void conv_int_cases(void) { conv_cases(1); }
static void conv_int3_cases(void)
{
    now.is_int3 = 1;
    for (unsigned round = 0; round < 4 * ROUNDS; round++)
        for (unsigned pixels = 1; pixels <= MAX_PIXELS; pixels++)
            conv_case(1, 3, pixels, CASES_ANY);
    now.is_int3 = 0;
}
static void conv_f32_cases(void) { conv_cases(0); }

static void head_case(unsigned outputs, unsigned pixels)
{
    cases_conv c;
    uint8_t *out;
    size_t bytes;
    int mode;
    cases_make(&c, 1, now.pattern, outputs, pixels, CASES_HEAD);
    cases_define(&c, value, size);
    cases_pack(&c, now.port->block_int, 0);
    c.conv.out_step = pixels + guard_below(10);
    bytes = (outputs - 1) * c.conv.out_step + pixels;
    out = c.conv.out = guard_place(GUARD_OUT, bytes, c.at_end);
    memcpy(out, before, bytes);
    memcpy(expected, before, bytes);
    for (size_t o = 0; o < outputs; o++)
        for (size_t p = 0; p < pixels; p++)
            expected[o * c.conv.out_step + p] = (uint8_t)value[p * outputs + o];
    mode = caller_rounds();
    now.port->head(&c.conv);
    caller_goes_on(mode);
    now.cases++;
    if (!CHECK(memcmp(out, expected, bytes) == 0))
        printf("  with %u outputs, %u pixels, runs of %u dwords\n", outputs, pixels,
               (unsigned)c.conv.segment[0].length);
}

static void head_cases(void)
{
    for (unsigned round = 0; round < ROUNDS; round++) {
        for (unsigned pixels = 1; pixels <= MAX_PIXELS; pixels++)
            head_case(1 + guard_below(LULL_HEAD_CODES), pixels);
        for (unsigned outputs = 1; outputs <= LULL_HEAD_CODES; outputs++)
            head_case(outputs, 1 + guard_below(MAX_PIXELS));
    }
}

/* Runs one pattern of a slot as a counted test and prints its line. */
static void counted(const char *port, const char *slot, cases_pattern pattern, void (*test)(void))
{
    unsigned failed = check_state.failed;
    now.pattern = pattern;
    now.cases = 0;
    snprintf(guard_case, sizeof guard_case, "%s %s %s", port, slot, cases_names[pattern]);
    guard_seed(0x1234567u + pattern);
    check_run(guard_case, test);
    printf("%s %s: %u cases\n", check_state.failed > failed ? "FAIL" : "ok", guard_case, now.cases);
}

static void counted_patterns(const char *port_name, const lull_kernels *port, int is_scalar,
                             float tolerance, const char *slot, void (*test)(void))
{
    now.port = port;
    now.is_scalar = is_scalar;
    now.tolerance = tolerance;
    lull_port_scalar(&now.scalar);
    for (unsigned pattern = 0; pattern < CASES_PATTERNS; pattern++)
        counted(port_name, slot, (cases_pattern)pattern, test);
}

/* ---- Pooling --------------------------------------------------------------------------------- */

static void pool_case(unsigned bytes, unsigned channels, unsigned pixels)
{
    size_t n = (size_t)channels * pixels * bytes;
    int at_end = guard_below(2) != 0;
    uint8_t *out = guard_place(GUARD_OUT, n, at_end);
    uint8_t *row[2];
    for (unsigned r = 0; r < 2; r++) {
        row[r] = guard_place(GUARD_ROW + r, 2 * n, at_end);
        for (size_t i = 0; i < 2 * n; i += bytes) {
            int low = now.pattern == CASES_MIN, high = now.pattern == CASES_MAX;
            float f = low ? 0.0f : high ? 65504.0f : (float)guard_below(1u << 24) * 0.01f;
            uint8_t u = low ? 0 : high ? 255 : (uint8_t)guard_below(256);
            if (now.pattern == CASES_ALTERNATING)
                f = (i / bytes + r) & 1 ? 0.0f : 1.0f, u = (i / bytes + r) & 1 ? 0 : 255;
            memcpy(row[r] + i, bytes == 4 ? (void *)&f : (void *)&u, bytes);
        }
    }
    for (size_t i = 0; i < n; i += bytes) { /* the definition: largest of four */
        size_t at = i / bytes / channels * 2 * channels + i / bytes % channels;
        double best = 0;
        for (unsigned k = 0; k < 4; k++) {
            const uint8_t *from = row[k >> 1] + (at + (k & 1) * channels) * bytes;
            float f = from[0];
            if (bytes == 4)
                memcpy(&f, from, 4);
            best = (double)f > best ? (double)f : best;
        }
        if (bytes == 4) {
            float f = (float)best;
            memcpy(expected + i, &f, 4);
        } else {
            expected[i] = (uint8_t)best;
        }
    }
    if (bytes == 4)
        now.port->pool_f32((float *)(void *)out, (float *)(void *)row[0], (float *)(void *)row[1],
                           channels, pixels);
    else
        now.port->pool_u8(out, row[0], row[1], channels, pixels);
    now.cases++;
    if (!CHECK(memcmp(out, expected, n) == 0))
        printf("  with %u channels, %u pixels\n", channels, pixels);
}

static void pool_cases(unsigned bytes)
{
    for (unsigned channels = 1; channels <= 2 * 64 + 1; channels++)
        pool_case(bytes, channels, 1 + guard_below(9));
    for (unsigned pixels = 1; pixels <= 40; pixels++)
        pool_case(bytes, 1 + guard_below(130), pixels);
}

static void pool_f32_cases(void) { pool_cases(4); }
static void pool_u8_cases(void) { pool_cases(1); }

/* ---- Winograd's form: the matrices of docs/arithmetic.md ------------------------------------- */

static const double in_rows[4][4] = {{1, 0, -1, 0}, {0, 1, 1, 0}, {0, -1, 1, 0}, {0, 1, 0, -1}};
static const double in_columns[6][6] = {{4, 0, -5, 0, 1, 0},  {0, -4, -4, 1, 1, 0},
                                        {0, 4, -4, -1, 1, 0}, {0, -2, -1, 2, 1, 0},
                                        {0, 2, -1, -2, 1, 0}, {0, 4, 0, -5, 0, 1}};
static const double out_rows[2][4] = {{1, 1, 1, 0}, {0, 1, -1, -1}};
static const double out_columns[4][6] = {
    {1, 1, 1, 1, 1, 0}, {0, 1, -1, 2, -2, 0}, {0, 1, 1, 4, 4, 0}, {0, 1, -1, 8, -8, 1}};

static void fill_floats(float *to, size_t n)
{
    for (size_t i = 0; i < n; i++)
        to[i] = now.pattern == CASES_MIN           ? -1000.0f
                : now.pattern == CASES_MAX         ? 1000.0f
                : now.pattern == CASES_ALTERNATING ? (i & 1 ? -1000.0f : 1000.0f)
                : now.pattern == CASES_PAIRS
                    ? (float)guard_between(-1000, 1000) * (float)(1u << guard_below(20))
                    : (float)guard_between(-1000000, 1000000) * 1e-6f;
}

/* Against the definition (scalar: within rounding) or against the scalar port (to the bit). */
static int float_agrees(const float *out, const float *scalar, double want, double about)
{
    if (now.is_scalar)
        return fabs((double)*out - want) <= 1e-6 * about;
    return memcmp(out, scalar, sizeof *out) == 0;
}

/* Point k of patch p and channel c by definition. */
static double point(const lull_winograd *w, unsigned k, unsigned p, unsigned c, double *about)
{
    double sum = 0;
    *about = 0;
    for (unsigned y = 0; y < 4; y++)
        for (unsigned x = 0; x < 6; x++) {
            unsigned column = w->is_up ? 2 * p + (x + 1) / 2 : 4 * p + x;
            double product = in_rows[k / 6][y] * in_columns[k % 6][x] *
                             (double)w->row[y][(size_t)column * w->channels + c];
            sum += product;
            *about += fabs(product);
        }
    return sum;
}

/* Compares every float of the buffer: points, and what lies between and was not to be written. */
static int points_agree(const lull_winograd *w, const float *out, size_t floats)
{
    const float *scalar = (const float *)(const void *)expected;
    for (size_t i = 0; i < floats; i++) {
        unsigned k = (unsigned)(i / w->plane), at = (unsigned)(i % w->plane);
        double about, want;
        if (at >= w->patches * w->channels || (w->is_up && lull_winograd_vanishes(k))) {
            if (memcmp(out + i, before + 4 * i, 4) != 0)
                return 0;
            continue;
        }
        want = point(w, k, at / w->channels, at % w->channels, &about);
        if (!float_agrees(out + i, scalar + i, want, about)) {
            printf("  point %u at %u is %.9g, not %.9g\n", k, at, (double)out[i], want);
            return 0;
        }
    }
    return 1;
}

static void winograd_in_case(unsigned channels, unsigned patches, unsigned is_up)
{
    lull_winograd w;
    size_t columns = (size_t)(is_up ? 2 : 4) * patches + 2, floats;
    int at_end = guard_below(2) != 0;
    memset(&w, 0, sizeof w);
    w.channels = channels;
    w.patches = patches;
    w.is_up = is_up;
    w.plane = (size_t)channels * patches + guard_below(20);
    for (unsigned y = 0; y < 4; y++) {
        float *row = guard_place(GUARD_ROW + y, columns * channels * sizeof *row, at_end);
        fill_floats(row, columns * channels);
        w.row[y] = is_up && y == 2 ? w.row[1] : row;
    }
    floats = (LULL_WINOGRAD_POINTS - 1) * w.plane + (size_t)channels * patches;
    if (!now.is_scalar) {
        w.points = (float *)(void *)expected;
        now.scalar.winograd_in(&w);
    }
    w.points = guard_place(GUARD_OUT, floats * sizeof *w.points, at_end);
    memcpy(w.points, before, floats * sizeof *w.points);
    now.port->winograd_in(&w);
    now.cases++;
    if (!CHECK(points_agree(&w, w.points, floats)))
        printf("  with %u channels, %u patches, %s\n", channels, patches, is_up ? "upsampled" : "");
}

static void winograd_in_cases(void)
{
    for (unsigned channels = 1; channels <= 70; channels++)
        for (unsigned is_up = 0; is_up < 2; is_up++)
            winograd_in_case(channels, 1 + guard_below(7), is_up);
}

/* Pixel (x, y) of a patch by definition, before it is made positive. */
static double pixel(const lull_winograd *w, unsigned p, unsigned x, unsigned y, unsigned c,
                    double *about)
{
    double sum = 0;
    for (unsigned k = 0; k < LULL_WINOGRAD_POINTS; k++) {
        double product = out_rows[y][k / 6] * out_columns[x][k % 6] *
                         (double)w->points[k * w->plane + (size_t)p * w->channels + c];
        sum += product;
        *about += fabs(product);
    }
    return sum;
}

static int pixels_agree(const lull_winograd *w)
{
    unsigned is_pooled = !w->out[1], columns = is_pooled ? 2 : 4, n = w->channels;
    for (unsigned y = 0; y < (is_pooled ? 1u : 2u); y++)
        for (unsigned x = 0; x < columns * w->patches; x++)
            for (unsigned c = 0; c < n; c++) {
                size_t at = (size_t)x * n + c;
                double about = 0, want = 0;
                const float *scalar =
                    (const float *)(const void *)expected + y * (size_t)columns * w->patches * n;
                for (unsigned i = 0; i < (is_pooled ? 4u : 1u); i++)
                    want = fmax(want,
                                pixel(w, x / columns, is_pooled ? x % 2 * 2 + (i & 1) : x % columns,
                                      is_pooled ? i >> 1 : y, c, &about));
                if (!float_agrees(w->out[y] + at, scalar + at, want, about)) {
                    printf("  column %u, channel %u is %.9g, not %.9g\n", x, c,
                           (double)w->out[y][at], want);
                    return 0;
                }
            }
    return 1;
}

static void winograd_out_case(unsigned channels, unsigned patches, unsigned is_pooled)
{
    lull_winograd w;
    size_t pixels = (size_t)(is_pooled ? 2 : 4) * patches * channels, floats;
    int at_end = guard_below(2) != 0;
    memset(&w, 0, sizeof w);
    w.channels = channels;
    w.patches = patches;
    w.plane = (size_t)channels * patches + guard_below(20);
    floats = (LULL_WINOGRAD_POINTS - 1) * w.plane + (size_t)channels * patches;
    w.points = guard_place(GUARD_WEIGHTS, floats * sizeof *w.points, at_end);
    fill_floats(w.points, floats);
    if (!now.is_scalar) {
        w.out[0] = (float *)(void *)expected;
        w.out[1] = is_pooled ? NULL : w.out[0] + pixels;
        now.scalar.winograd_out(&w);
    }
    w.out[0] = guard_place(GUARD_OUT, pixels * sizeof(float), at_end);
    w.out[1] = is_pooled ? NULL : guard_place(GUARD_ROW, pixels * sizeof(float), at_end);
    now.port->winograd_out(&w);
    now.cases++;
    if (!CHECK(pixels_agree(&w)))
        printf("  with %u channels, %u patches, %s\n", channels, patches,
               is_pooled ? "pooled" : "");
}

static void winograd_out_cases(void)
{
    for (unsigned channels = 1; channels <= 70; channels++)
        for (unsigned is_pooled = 0; is_pooled < 2; is_pooled++)
            winograd_out_case(channels, 1 + guard_below(7), is_pooled);
}

#include "filter_cases.h"
#include "bilateral_cases.h"
#include "regression_cases.h"
#include "grain_cases.h"
#include "patch_cases.h"

/* ---- Slots ----------------------------------------------------------------------------------- */

#define KERNEL(slot, parameters, tolerance, purpose)                                        \
    static int slot##_fills(const lull_kernels *a, const lull_kernels *b)                   \
    {                                                                                       \
        return a->slot != b->slot;                                                          \
    }                                                                                       \
    static void slot##_test(const char *port_name, const lull_kernels *port, int is_scalar, \
                            float tol)                                                      \
    {                                                                                       \
        counted_patterns(port_name, port, is_scalar, tol, #slot, slot##_cases);             \
    }
#include "kernels.def"

const conform_slot conform_slots[] = {
#define KERNEL(slot, parameters, tolerance, purpose) \
    {#slot, tolerance, slot##_fills, slot##_test},
#include "kernels.def"
};
const unsigned conform_slot_count = sizeof conform_slots / sizeof conform_slots[0];

/* Tests the slots that *port has other than *known, of the scalar port all. Returns how many. */
static unsigned test_slots(const char *name, const lull_kernels *port, const lull_kernels *known,
                           int is_scalar)
{
    unsigned tested = 0;
    for (unsigned i = 0; i < conform_slot_count; i++)
        if (is_scalar || conform_slots[i].fills(port, known)) {
            conform_slots[i].test(name, port, is_scalar, conform_slots[i].tolerance);
            tested++;
        }
    return tested;
}

void conform_port(const char *name, void (*fill)(lull_kernels *))
{
    lull_kernels scalar = {0}, port, halves;
    int is_scalar = fill == lull_port_scalar;
    char with_halves[64];
    for (size_t i = 0; i < sizeof before; i++)
        before[i] = (uint8_t)(i * 37 + 11);
    lull_port_scalar(&scalar);
    port = halves = scalar;
    fill(&port);
    if (!test_slots(name, &port, &scalar, is_scalar)) {
        printf("FAIL %s fills no slot\n", name);
        check_state.failed++;
    }
    /* What it takes on CPUs of the other kind. */
    halves.halves_pay = 1;
    fill(&halves);
    (void)snprintf(with_halves, sizeof with_halves, "%s by halves", name);
    (void)test_slots(with_halves, &halves, &port, 0);
}

void conform_skip(const char *name, const char *reason)
{
    printf("SKIP %s: %s\n", name, reason);
    check_state.skipped++;
}

int conform_report(void) { return check_report(); }

/* ---- Table of docs/ports.md ------------------------------------------------------------------ */

/* Value of the first line of Linux's CPU description that starts with `key`; empty if none. */
static void cpu_line(const char *key, char *to, size_t bytes)
{
    char line[4096];
    FILE *file = fopen("/proc/cpuinfo", "r");
    to[0] = 0;
    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, key, strlen(key)) == 0 && strchr(line, ':')) {
            snprintf(to, bytes, "%s", strchr(line, ':') + 2);
            to[strcspn(to, "\n")] = 0;
            break;
        }
    if (file)
        fclose(file);
}

/* Those of the CPU's flags that matter to a port. */
static void cpu_flags(char *to, size_t bytes)
{
    static const char *const known[] = {
        "ssse3", "avx2", "fma", "avx512f", "avx512bw", "avx512vl", "avx512dq", "avx512_vnni",
        "avx_vnni", "amx_int8", "neon", "asimd", "asimddp", "i8mm"};
    char flags[4096];
    size_t n = 0;
    cpu_line("flags", flags, sizeof flags);
    if (!flags[0])
        cpu_line("Features", flags, sizeof flags);
    to[0] = 0;
    for (unsigned i = 0; i < sizeof known / sizeof known[0]; i++) {
        const char *at = flags;
        size_t length = strlen(known[i]);
        while ((at = strstr(at, known[i])) != NULL) {
            if ((at == flags || at[-1] == ' ') && (at[length] == ' ' || !at[length])) {
                n += (size_t)snprintf(to + n, bytes - n, "%s%s", n ? " " : "", known[i]);
                break;
            }
            at += length;
        }
    }
}

void conform_row(const char *name, void (*fill)(lull_kernels *), const char *where)
{
    lull_kernels scalar = {0}, port;
    char model[200], flags[300], date[16];
    time_t seconds = time(NULL);
    lull_port_scalar(&scalar);
    port = scalar;
    fill(&port);
    cpu_line("model name", model, sizeof model);
    cpu_flags(flags, sizeof flags);
    strftime(date, sizeof date, "%Y-%m-%d", gmtime(&seconds));
    printf("ROW | %s |", name);
    for (unsigned i = 0; i < conform_slot_count; i++)
        if (fill == lull_port_scalar || conform_slots[i].fills(&port, &scalar))
            printf(" %s", conform_slots[i].name);
    printf(" | %s | %s | %s |\n", where ? where : model[0] ? model : "this CPU", date,
           where ? "-" : flags);
}
