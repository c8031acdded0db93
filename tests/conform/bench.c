#include "bench.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "conform.h"
#include "cpu.h"

#define PIXELS 480u
#define RUNS 9u
#define RUN_SECONDS 0.02

/* A layer: `taps` x `channels` elements under each of `rows` kernel rows of the source, `skip`
 * channels under three rows of 3 taps, and how many of the two are wide. */
typedef struct layer {
    const char *name;
    unsigned outputs, channels, taps, rows, skip, wide_source;
} layer;

static const layer layers[] = {
    {"3x3 64->64", 64, 64, 3, 3, 0, 0},           {"3x3 32->32", 32, 32, 3, 3, 0, 0},
    {"3x3 48->64", 64, 48, 3, 3, 0, 0},           {"3x3 112->112", 112, 112, 3, 3, 0, 0},
    {"2x2 96 + 3x3 48->96", 96, 96, 2, 2, 48, 0}, {"2x2 64 + wide 3x3 9->64", 64, 64, 2, 2, 9, 0},
    {"wide 3x3 9->32", 32, 9, 3, 3, 0, 1},        {"wide 3x3 32->3", 3, 32, 3, 3, 0, 1},
    {"3x3 12->16", 16, 12, 3, 3, 0, 0},           {"3x3 16->16", 16, 16, 3, 3, 0, 0},
    {"2x2 24 + 3x3 16->16", 16, 24, 2, 2, 16, 0}, {"1x1 16->52", 52, 16, 1, 1, 0, 0},
    {"3x3 24->24", 24, 24, 3, 3, 0, 0},           {"3x3 8->8", 8, 8, 3, 3, 0, 0},
};

static double cpu_seconds(void)
{
#if defined(CLOCK_THREAD_CPUTIME_ID)
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
#else
    return (double)clock() / CLOCKS_PER_SEC;
#endif
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Zeros, aligned like a model and a plan; freed by forget. */
static void *memory(size_t bytes)
{
    uint8_t *block = calloc(1, bytes + 2 * LULL_ALIGN + 64), *p;
    if (!block) {
        fprintf(stderr, "bench: no memory\n");
        exit(2);
    }
    p = block + LULL_ALIGN - (uintptr_t)block % LULL_ALIGN;
    if ((size_t)(p - block) < sizeof block)
        p += LULL_ALIGN;
    memcpy(p - sizeof block, &block, sizeof block);
    return p;
}

static void forget(const void *p)
{
    void *block;
    memcpy(&block, (const uint8_t *)p - sizeof block, sizeof block);
    free(block);
}

/* Multiply-accumulates per second of a peak loop, for a moment. */
static double peak_speed(const bench_peak *peak)
{
    double start = cpu_seconds(), macs = peak->macs(500000);
    return macs / (cpu_seconds() - start);
}

static double median(double *values)
{
    qsort(values, RUNS, sizeof *values, ascending);
    return values[RUNS / 2];
}

static void add_segment(lull_conv *conv, int is_integer, int is_wide, unsigned elements,
                        unsigned step, unsigned block, double *macs)
{
    lull_segment *segment = &conv->segment[conv->segments++];
    unsigned group = !is_integer ? 1 : is_wide ? 2 : 4;
    uint8_t *row, *weights;
    size_t row_bytes, weight_bytes;
    segment->length = (elements + group - 1) / group;
    segment->step = step;
    row_bytes = ((size_t)PIXELS * step + (size_t)group * segment->length) * 4 / group;
    weight_bytes = lull_align_up(conv->outputs, block) * segment->length * 4;
    row = memory(row_bytes);
    weights = memory(2 * weight_bytes); /* wide ones may be there twice */
    for (size_t i = 0; is_integer && i < row_bytes; i++)
        row[i] = (uint8_t)(i * 31 & (is_wide ? 0x7f : 0xff));
    for (size_t i = 0; is_integer && i < weight_bytes; i++)
        weights[i] = (uint8_t)(i * 7 % 63);
    segment->row = row;
    segment->weights = weights;
    *macs += (double)elements * conv->outputs * PIXELS;
}

/* Descriptor of one row of a layer; adds its multiply-accumulates to *macs. */
static void make(lull_conv *conv, const layer *shape, int is_integer, unsigned block, double *macs)
{
    size_t whole = lull_align_up(shape->outputs, block);
    memset(conv, 0, sizeof *conv);
    conv->outputs = shape->outputs;
    conv->pixels = PIXELS;
    conv->out_step = shape->outputs;
    conv->out_max = 255;
    conv->is_small = is_integer; /* as in trained networks */
    conv->bias = memory(whole * 4);
    conv->multiplier = memory(whole * 4);
    for (size_t i = 0; i < whole; i++)
        ((int32_t *)(size_t)conv->multiplier)[i] = 1 << 20;
    conv->out = memory(PIXELS * conv->out_step * 4);
    *macs = 0;
    if (shape->skip && is_integer && shape->skip < 16) { /* the network's input: wide, first */
        conv->wide = 3;
        for (unsigned i = 0; i < 3; i++)
            add_segment(conv, 1, 1, 3 * shape->skip, 2 * shape->skip, block, macs);
    }
    for (unsigned i = 0; i < shape->rows; i++)
        add_segment(conv, is_integer, (int)shape->wide_source, shape->taps * shape->channels,
                    shape->channels, block, macs);
    if (shape->wide_source && is_integer) {
        conv->wide = conv->segments;
        conv->out_max = shape->outputs == 3 ? 32767 : 255;
    }
    if (shape->skip && !conv->wide)
        for (unsigned i = 0; i < 3; i++)
            add_segment(conv, is_integer, 0, 3 * shape->skip, 2 * shape->skip, block, macs);
}

static void release(lull_conv *conv)
{
    for (unsigned s = 0; s < conv->segments; s++) {
        forget(conv->segment[s].row);
        forget(conv->segment[s].weights);
    }
    forget(conv->bias);
    forget(conv->multiplier);
    forget(conv->out);
}

/* Multiply-accumulates per second of `count` calls; *share: of the peak measured in turn with it,
 * as clocks change from moment to moment. */
static double conv_speed(void (*kernel)(const lull_conv *), const lull_conv *conv, unsigned count,
                         double macs, const bench_peak *peak, double *share)
{
    double speed[RUNS], shares[RUNS];
    kernel(conv);
    for (unsigned i = 0; i < RUNS; i++) {
        double before = peak ? peak_speed(peak) : 0, start = cpu_seconds(), end;
        unsigned n = 0;
        do {
            for (unsigned k = 0; k < count; k++)
                kernel(conv + k);
            n++;
        } while ((end = cpu_seconds()) - start < RUN_SECONDS);
        speed[i] = macs * n / (end - start);
        shares[i] = peak ? 2 * speed[i] / (before + peak_speed(peak)) : 0;
    }
    *share = median(shares);
    return median(speed);
}

/* The peak of a port's slot, which it prints; NULL if it is not known. */
static const bench_peak *find_peak(const char *port, const char *slot)
{
    double speed[RUNS];
    for (unsigned i = 0; i < bench_peak_count; i++)
        if (!strcmp(bench_peaks[i].port, port) && !strcmp(bench_peaks[i].slot, slot)) {
            for (unsigned k = 0; k < RUNS; k++)
                speed[k] = peak_speed(&bench_peaks[i]);
            printf("%-8s %s peak (%s): %.1f GMAC/s\n", port, slot, bench_peaks[i].instructions,
                   median(speed) * 1e-9);
            return &bench_peaks[i];
        }
    return NULL;
}

static void print_conv(const char *port, const char *slot, const char *name, double speed,
                       const bench_peak *peak, double share)
{
    printf("%-8s %-10s %-24s %7.1f GMAC/s", port, slot, name, speed * 1e-9);
    if (peak)
        printf("  %3.0f %% of peak", 100 * share);
    printf("\n");
    fflush(stdout);
}

static void bench_conv(const char *port, const lull_kernels *kernels, int is_integer)
{
    const char *slot = is_integer ? "conv_int" : "conv_f32";
    const bench_peak *peak = find_peak(port, slot);
    for (unsigned i = 0; i < sizeof layers / sizeof layers[0]; i++) {
        int is_int3 = is_integer && layers[i].outputs == 3 && !kernels->splits_wide;
        void (*kernel)(const lull_conv *) = is_int3      ? kernels->conv_int3
                                            : is_integer ? kernels->conv_int
                                                         : kernels->conv_f32;
        unsigned block = is_int3 ? 1 : is_integer ? kernels->block_int : kernels->block_f32;
        lull_conv conv;
        double macs, speed, share;
        make(&conv, &layers[i], is_integer, block, &macs);
        speed = conv_speed(kernel, &conv, 1, macs, peak, &share);
        release(&conv);
        print_conv(port, slot, layers[i].name, speed, peak, share);
    }
}

/* 1 if a layer is one of those to see sums in words of. */
static int is_narrow(const layer *shape)
{
    return !shape->wide_source && shape->channels <= 64 && shape->channels % 4 == 0 &&
           (shape->skip == 0 || shape->skip == 16);
}

/* Integer convolutions whose sums fit words: weights of -1, 0 and 1. */
static void bench_words(const char *port, const lull_kernels *kernels)
{
    const bench_peak *peak = find_peak(port, "in words");
    for (unsigned i = 0; peak && i < sizeof layers / sizeof layers[0]; i++) {
        lull_conv conv;
        double macs, speed, share;
        if (!is_narrow(&layers[i]))
            continue;
        make(&conv, &layers[i], 1, kernels->block_int, &macs);
        conv.fits_words = 1;
        for (unsigned s = 0; s < conv.segments; s++) {
            int8_t *weights = (int8_t *)(size_t)conv.segment[s].weights;
            size_t whole = lull_align_up(conv.outputs, kernels->block_int);
            for (size_t k = 0; k < whole * conv.segment[s].length * 4; k++)
                weights[k] = (int8_t)(k % 3) - 1;
        }
        speed = conv_speed(kernels->conv_int, &conv, 1, macs, peak, &share);
        release(&conv);
        print_conv(port, "in words", layers[i].name, speed, peak, share);
    }
}

/* ---- Products at the points of patches ---- */

#define POINT_BYTES (320u << 10) /* of points and sums, about what a task of plan.c has */

/* Bytes from plane to plane: an odd number of lines, as in plans. */
static size_t plane_bytes(size_t bytes) { return lull_align_up(bytes, LULL_ALIGN) | LULL_ALIGN; }

/* The products of all points of twelve patches or more, each with its weights. Returns their
 * multiply-accumulates. */
static double make_points(lull_conv conv[LULL_PATCH_POINTS], const layer *shape, unsigned block)
{
    size_t patch = (size_t)LULL_PATCH_POINTS * (2 * shape->channels + 4 * shape->outputs);
    unsigned patches = 12 * lull_max_u((unsigned)(POINT_BYTES / patch / 12), 1);
    size_t in = plane_bytes((size_t)2 * patches * shape->channels);
    size_t out = plane_bytes((size_t)4 * patches * shape->outputs);
    size_t weights = lull_align_up(shape->outputs, block) * shape->channels * 2;
    uint8_t *points = memory(LULL_PATCH_POINTS * in), *sums = memory(LULL_PATCH_POINTS * out);
    uint8_t *w = memory(LULL_PATCH_POINTS * weights);
    memset(conv, 0, LULL_PATCH_POINTS * sizeof *conv);
    for (unsigned k = 0; k < LULL_PATCH_POINTS; k++) {
        conv[k].outputs = shape->outputs;
        conv[k].out_step = shape->outputs;
        conv[k].pixels = patches;
        conv[k].out = sums + k * out;
        conv[k].segments = 1;
        conv[k].segment[0].row = points + k * in;
        conv[k].segment[0].weights = w + k * weights;
        conv[k].segment[0].length = conv[k].segment[0].step = shape->channels / 2;
    }
    for (size_t i = 0; i < LULL_PATCH_POINTS * in; i++)
        points[i] = (uint8_t)(i * 31);
    for (size_t i = 0; i < LULL_PATCH_POINTS * weights; i++)
        w[i] = (uint8_t)(i * 7);
    return (double)LULL_PATCH_POINTS * patches * shape->channels * shape->outputs;
}

/* 1 if a layer is one that can be made in patches. */
static int is_patched(const layer *shape)
{
    return shape->taps == 3 && !shape->skip && !shape->wide_source &&
           shape->channels % LULL_PATCH_CHANNELS == 0 && shape->outputs % LULL_PATCH_CHANNELS == 0;
}

static void bench_points(const char *port, const lull_kernels *kernels)
{
    const bench_peak *peak = find_peak(port, "points_int");
    for (unsigned i = 0; i < sizeof layers / sizeof layers[0]; i++) {
        static lull_conv conv[LULL_PATCH_POINTS];
        double macs, speed, share;
        if (!is_patched(&layers[i]))
            continue;
        macs = make_points(conv, &layers[i], kernels->block_int);
        speed = conv_speed(kernels->points_int, conv, LULL_PATCH_POINTS, macs, peak, &share);
        forget(conv[0].segment[0].row);
        forget(conv[0].segment[0].weights);
        forget(conv[0].out);
        print_conv(port, "points_int", layers[i].name, speed, peak, share);
    }
}

/* ---- The other slots: nanoseconds for each output pixel ---- */

#define CHANNELS 32u
#define CODE_STEP 52u

static float *floats;
static uint8_t *bytes;

static void run_pool_f32(const lull_kernels *k)
{
    k->pool_f32(floats, floats + 64 * PIXELS, floats + 256 * PIXELS, CHANNELS, PIXELS);
}

static void run_pool_u8(const lull_kernels *k)
{
    k->pool_u8(bytes, bytes + 64 * PIXELS, bytes + 256 * PIXELS, CHANNELS, PIXELS);
}

#define PLANE (2 * PIXELS + 16) /* floats from plane to plane */

/* Of 32 channels, four rows of pixels in patches. */
#define PATCHES (PIXELS / LULL_PATCH_SIDE / LULL_PATCH_SIDE)

static int16_t *points;
static int32_t *sums;

static void run_patches_in(const lull_kernels *k)
{
    lull_patches image = {0};
    for (unsigned y = 0; y < 6; y++)
        image.row[y] = bytes + 8 * y * PIXELS;
    image.points = points;
    image.plane = plane_bytes(2 * CHANNELS * PATCHES) / 2;
    image.channels = CHANNELS;
    image.patches = PATCHES;
    k->patches_in(&image);
}

static void run_patches_out(const lull_kernels *k)
{
    static const int32_t bias[CHANNELS], multiplier[CHANNELS];
    static int32_t room[LULL_PATCH_ROOM];
    lull_patches image = {0};
    for (unsigned y = 0; y < LULL_PATCH_SIDE; y++)
        image.out[y] = bytes + 8 * y * PIXELS;
    image.sums = sums;
    image.room = room;
    image.plane = plane_bytes(4 * CHANNELS * PATCHES) / 4;
    image.bias = bias;
    image.multiplier = multiplier;
    image.out_max = 255;
    image.channels = CHANNELS;
    image.patches = PATCHES;
    image.phase = LULL_PATCH_WHOLE;
    image.is_small = 1;
    k->patches_out(&image);
}

static void run_filter5(const lull_kernels *k)
{
    lull_window window = {.out = floats, .out_plane = PLANE, .plane = PLANE, .pixels = PIXELS};
    for (unsigned y = 0; y < 5; y++)
        window.rows[y] = floats + (8 + 8 * y) * PIXELS;
    window.codes = bytes;
    window.code_step = k->in_planes ? 1 : CODE_STEP;
    window.code_plane = k->in_planes ? PIXELS : 1;
    window.table = floats + 256 * PIXELS;
    k->filter5(&window);
}

static void run_encode(const lull_kernels *k)
{
    lull_encoding from = {floats, floats + 64 * PIXELS, floats + 128 * PIXELS, 1.0f, 65504.0f, 0};
    k->encode(bytes, &from, PIXELS);
}

static void run_demodulate(const lull_kernels *k)
{
    lull_encoding from = {floats + 64 * PIXELS, NULL, NULL, 1.0f, 65504.0f, 0};
    k->demodulate(floats, PLANE, &from, floats + 128 * PIXELS, PLANE, bytes + 8, CODE_STEP,
                  floats + 256 * PIXELS, PIXELS);
}

static void run_shrink(const lull_kernels *k)
{
    k->shrink(floats, PLANE, floats + 64 * PIXELS, floats + 128 * PIXELS, PLANE, bytes + 8,
              CODE_STEP, floats + 256 * PIXELS, PIXELS);
}

static void run_blend(const lull_kernels *k)
{
    lull_blending b = {floats,
                       floats + 64 * PIXELS,
                       floats + 128 * PIXELS,
                       floats + 192 * PIXELS,
                       PLANE,
                       PLANE,
                       PLANE,
                       bytes,
                       floats + 256 * PIXELS,
                       PIXELS / 2};
    k->blend(&b);
}

static void run_noise(const lull_kernels *k)
{
    k->noise(bytes, floats, PLANE, floats + 128 * PIXELS, PLANE, PIXELS);
}

static void run_bilateral(const lull_kernels *k)
{
    lull_surface at = {floats + 129 * PIXELS, bytes + 4 * PIXELS, PLANE};
    lull_smoothing s = {floats, bytes + PIXELS, PLANE, at, {at, at, at, at}, 0, PIXELS};
    k->bilateral(&s);
}

static void run_residual(const lull_kernels *k)
{
    lull_encoding from = {floats, NULL, NULL, 1.0f, 65504.0f, 0};
    lull_balance b = {floats + 256 * PIXELS, floats + 64 * PIXELS, floats + 128 * PIXELS, bytes,
                      PLANE, PLANE, PLANE, PIXELS};
    k->residual(&b, &from);
}

static void run_fit_sums(const lull_kernels *k)
{
    lull_encoding from = {floats, NULL, NULL, 1.0f, 65504.0f, 0};
    lull_fitting at = {floats + 256 * PIXELS, floats + 64 * PIXELS, floats + 128 * PIXELS,
                       floats + 192 * PIXELS, PIXELS + 16, PLANE, PLANE, PLANE, PIXELS};
    k->fit_sums(&at, &from);
}

static void run_fit(const lull_kernels *k)
{
    const float *const row = floats + 64 * PIXELS + 1, *const rows[] = {row, row, row};
    k->fit(floats, PIXELS, rows, PIXELS + 16, PIXELS, floats + 256 * PIXELS);
}

static void run_regress(const lull_kernels *k)
{
    lull_regression r = {floats, floats + 64 * PIXELS, floats + 128 * PIXELS, floats + 192 * PIXELS,
                         floats + 256 * PIXELS, PLANE, PLANE, PLANE, PLANE, PIXELS / 4, PIXELS};
    k->regress(&r);
}

static void run_spread_xyz(const lull_kernels *k)
{
    k->spread_xyz(floats, PLANE, floats + 64 * PIXELS, PIXELS);
}

static void run_spread(const lull_kernels *k)
{
    k->spread(floats, PLANE, floats + 64 * PIXELS, PIXELS);
}

static void run_guide(const lull_kernels *k)
{
    k->guide(bytes, NULL, floats + 64 * PIXELS, PIXELS);
}

static void run_edges(const lull_kernels *k)
{
    const float *v = floats + 64 * PIXELS + 1, *smooth = floats + 128 * PIXELS + 1;
    lull_edging e = {floats, {v, v, v}, {smooth, smooth, smooth}, PLANE, PLANE, 0.1f, 1, PIXELS};
    k->edges(&e);
}

static void run_grain_sums(const lull_kernels *k)
{
    k->grain_sums(floats, PIXELS, (const uint8_t *const *)&bytes, 1, PIXELS, floats + 64 * PIXELS);
}

static void run_take_grain(const lull_kernels *k)
{
    k->take_grain(floats, PLANE, floats + 66 * PIXELS, floats + 128 * PIXELS, 99, 0, PIXELS);
}

static void run_modulate(const lull_kernels *k)
{
    k->modulate(floats, floats + 64 * PIXELS, PLANE, floats + 128 * PIXELS, PLANE, 0.5f, PIXELS);
}

static void run_luminance(const lull_kernels *k)
{
    k->luminance(floats, floats + 64 * PIXELS, PIXELS);
}

static void run_curve(const lull_kernels *k, int is_out)
{
    static const lull_curve curve = {2, 1.0f, 0.0f, 3.402823466e38f, 0};
    memcpy(floats, floats + 64 * PIXELS, 3 * PIXELS * sizeof *floats);
    (is_out ? k->curve_out : k->curve_in)(floats, &curve, 3 * (size_t)PIXELS);
}

static void run_curve_in(const lull_kernels *k) { run_curve(k, 0); }
static void run_curve_out(const lull_kernels *k) { run_curve(k, 1); }

static double pixel_time(void (*run)(const lull_kernels *), const lull_kernels *kernels)
{
    double best[RUNS];
    run(kernels);
    for (unsigned i = 0; i < RUNS; i++) {
        double start = cpu_seconds(), end;
        unsigned n = 0;
        do {
            run(kernels);
            n++;
        } while ((end = cpu_seconds()) - start < RUN_SECONDS);
        best[i] = (end - start) / n / PIXELS;
    }
    qsort(best, RUNS, sizeof *best, ascending);
    return best[RUNS / 2];
}

static unsigned bench_pixels(const char *port, const lull_kernels *kernels,
                             const lull_kernels *scalar)
{
    unsigned done = 0, all = kernels == scalar;
    floats = memory(512 * PIXELS * sizeof *floats);
    bytes = memory(512 * PIXELS);
    points = memory(LULL_PATCH_POINTS * plane_bytes(2 * CHANNELS * PATCHES));
    sums = memory(LULL_PATCH_POINTS * plane_bytes(4 * CHANNELS * PATCHES));
    for (unsigned i = 0; i < 512 * PIXELS; i++) {
        floats[i] = (float)(1 + i * 37 % 101) * 0.01f;
        bytes[i] = (uint8_t)(i * 37 % 251);
    }
#define BENCH(slot, what)                                                                          \
    if (all || kernels->slot != scalar->slot)                                                      \
        done++, printf("%-8s %-11s %-23s %7.2f ns/pixel\n", port, #slot, what,                     \
                       1e9 * pixel_time(run_##slot, kernels));
    BENCH(pool_f32, "32 channels")
    BENCH(pool_u8, "32 channels")
    BENCH(filter5, "25 codes")
    BENCH(encode, "12 codes")
    BENCH(demodulate, "3 channels")
    BENCH(shrink, "3 channels")
    BENCH(blend, "3 channels")
    BENCH(spread, "3 channels")
    BENCH(spread_xyz, "3 channels")
    BENCH(guide, "of normals")
    BENCH(noise, "3 channels")
    BENCH(bilateral, "6 pixels")
    BENCH(fit_sums, "50 sums")
    BENCH(fit, "21, a cell per pixel")
    BENCH(regress, "21 coefficients")
    BENCH(residual, "4 sums")
    BENCH(edges, "4 lines")
    BENCH(grain_sums, "a row")
    BENCH(take_grain, "of an albedo")
    BENCH(modulate, "3 channels")
    BENCH(luminance, "3 channels")
    BENCH(curve_in, "3 channels")
    BENCH(curve_out, "3 channels")
    BENCH(patches_in, "32 channels")
    BENCH(patches_out, "32 channels")
    forget(floats);
    forget(bytes);
    forget(points);
    forget(sums);
    return done;
}

int bench_main(const char *port)
{
    static const struct {
        const char *name;
        void (*fill)(lull_kernels *);
    } ports[] = {
#define PORT(name) {#name, lull_port_##name},
#include "ports.def"
    };
    uint32_t available = lull_cpu_ports();
    unsigned done = 0;
    for (unsigned i = 0; i < sizeof ports / sizeof ports[0]; i++) {
        lull_kernels scalar = {0}, kernels;
        if (!(available >> i & 1) || (port && strcmp(port, ports[i].name) != 0))
            continue;
        lull_port_scalar(&scalar);
        kernels = scalar;
        kernels.halves_pay = lull_cpu_halves_pay();
        ports[i].fill(&kernels);
        if (i == 0 || kernels.conv_f32 != scalar.conv_f32)
            bench_conv(ports[i].name, &kernels, 0), done++;
        if (i == 0 || kernels.conv_int != scalar.conv_int)
            bench_conv(ports[i].name, &kernels, 1), bench_words(ports[i].name, &kernels), done++;
        if (i == 0 || kernels.points_int != scalar.points_int)
            bench_points(ports[i].name, &kernels), done++;
        done += bench_pixels(ports[i].name, i ? &kernels : &scalar, &scalar);
    }
    if (!done)
        fprintf(stderr, "bench: no port '%s' on this CPU\n", port ? port : "");
    return done ? 0 : 2;
}
