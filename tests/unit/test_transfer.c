/* Transfer functions against a double-precision reference, and their bits against recorded ones. */
#include "transfer.h"

#include <float.h>
#include <math.h>

#include "check.h"
#include "hash.h"

#define N 4096
#define TOLERANCE 1e-6 /* relative; the curves promise 2e-6 */

/* ---- Reference ------------------------------------------------------------------------------- */

static const double pu_a = 1.41283765e+03, pu_b = 1.64593172, pu_c = 4.31384981e-01,
                    pu_d = -2.94139609e-03, pu_e = 1.92653254e-01, pu_f = 6.26026094e-03,
                    pu_g = 9.98620152e-01;

static double pu(double y)
{
    if (y <= 1.57945760e-06)
        return pu_a * y;
    return y <= 3.22087631e-02 ? pu_b * pow(y, pu_c) + pu_d : pu_e * log(y + pu_f) + pu_g;
}

static double pu_back(double x)
{
    if (x <= 2.23151711e-03)
        return x / pu_a;
    return x <= 3.70974749e-01 ? pow((x - pu_d) / pu_b, 1 / pu_c) : exp((x - pu_g) / pu_e) - pu_f;
}

static double linear(double v) { return v; }
static double srgb_to(double y)
{
    return y <= 0.0031308 ? 12.92 * y : 1.055 * pow(y, 1 / 2.4) - 0.055;
}
static double srgb_from(double x)
{
    return x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
}
static double pu_to(double y) { return pu(y) / pu(65504); }
static double pu_from(double x) { return pu_back(x * pu(65504)); }
static double log_to(double y) { return log1p(y) / log(65505); }
static double log_from(double x) { return expm1(x * log(65505)); }

typedef struct curve {
    const char *name;
    void (*apply)(lull_transfer, float *, size_t);
    lull_transfer transfer;
    double (*reference)(double);
    uint64_t hash; /* of all results of sweep() */
} curve;

#define BOTH(name, transfer, to, from, to_hash, from_hash)                  \
    {name, lull_transfer_forward, transfer, to, UINT64_C(to_hash)},         \
    {name " inverse", lull_transfer_inverse, transfer, from, UINT64_C(from_hash)}

static const curve curves[] = {
    BOTH("linear", LULL_TRANSFER_LINEAR, linear, linear, 0xe2b4a42186805871, 0xe2b4a42186805871),
    BOTH("sRGB", LULL_TRANSFER_SRGB, srgb_to, srgb_from, 0x4a76747963a89f21, 0x140d15ab0b19d3f7),
    BOTH("PU", LULL_TRANSFER_PU, pu_to, pu_from, 0x71302e6310abdeb3, 0x99272bcd4619cc84),
    BOTH("log", LULL_TRANSFER_LOG, log_to, log_from, 0x8242b15b8821f103, 0xd66f0e50c708c617),
};
#define CURVES (sizeof curves / sizeof *curves)

/* ---- Sweeps over all finite non-negative floats ---------------------------------------------- */

typedef void visitor(const curve *c, const float *in, const float *out, void *result);

/* Calls visit for blocks of N values with the given step between their bit patterns, up to
 * FLT_MAX. */
static void sweep(const curve *c, uint32_t step, visitor *visit, void *result)
{
    static float in[N], out[N];
    uint64_t bits = 0;
    while (bits < 0x7f800000u) {
        size_t i;
        for (i = 0; i < N; ++i, bits += step)
            in[i] = lull_float(bits < 0x7f800000u ? (uint32_t)bits : 0x7f7fffffu);
        memcpy(out, in, sizeof out);
        c->apply(c->transfer, out, N);
        visit(c, in, out, result);
    }
}

typedef struct accuracy {
    double worst;
    float at;
    unsigned wrong; /* values that should be 0, or infinite, and are not */
} accuracy;

static void measure(const curve *c, const float *in, const float *out, void *result)
{
    accuracy *a = result;
    size_t i;
    for (i = 0; i < N; ++i) {
        double expected = in[i] < FLT_MIN ? 0 : c->reference(in[i]), error;
        if (expected <= FLT_MIN * (1 - TOLERANCE)) {
            a->wrong += lull_bits(out[i]) != 0;
        } else if (expected > FLT_MAX * (1 + TOLERANCE)) {
            a->wrong += !(out[i] > FLT_MAX);
        } else if (expected > FLT_MIN * (1 + TOLERANCE) && expected < FLT_MAX * (1 - TOLERANCE)) {
            error = fabs(out[i] / expected - 1);
            if (!(error <= a->worst)) {
                a->worst = error;
                a->at = in[i];
            }
        }
    }
}

static void is_accurate(void)
{
    size_t i;
    for (i = 0; i < CURVES; ++i) {
        accuracy a = {0, 0, 0};
        sweep(curves + i, 509, measure, &a);
        printf("     %-14s relative error at most %.2e, at %.9g\n", curves[i].name, a.worst, a.at);
        CHECK(a.worst <= TOLERANCE);
        CHECK_EQ(a.wrong, 0);
    }
}

/* A step of 2^9 in the bits is more than the rounding of any curve. */
static void see_order(const curve *c, const float *in, const float *out, void *result)
{
    float *last = result;
    size_t i;
    (void)c;
    (void)in;
    for (i = 0; i < N; ++i) {
        if (!(out[i] >= *last)) {
            CHECK(out[i] >= *last);
            return;
        }
        *last = out[i];
    }
}

static void is_monotonic(void)
{
    size_t i;
    for (i = 0; i < CURVES; ++i) {
        float last = 0;
        sweep(curves + i, 512, see_order, &last);
        CHECK(last > 0);
    }
}

static void hash_block(const curve *c, const float *in, const float *out, void *result)
{
    uint64_t *hash = result;
    (void)c;
    (void)in;
    *hash = hash_floats(*hash, out, N);
}

static uint64_t hash_curve(const curve *c)
{
    uint64_t hash = HASH_START;
    sweep(c, 4099, hash_block, &hash);
    return hash;
}

static void gives_the_recorded_bits(void)
{
    size_t i;
    for (i = 0; i < CURVES; ++i) {
        uint64_t hash = hash_curve(curves + i);
        if (!CHECK(hash == curves[i].hash))
            printf("     %-14s 0x%08lx%08lx\n", curves[i].name, (unsigned long)(hash >> 32),
                   (unsigned long)(hash & 0xffffffffu));
    }
}

/* ---- Values ---------------------------------------------------------------------------------- */

static float one(void (*apply)(lull_transfer, float *, size_t), lull_transfer transfer, float v)
{
    apply(transfer, &v, 1);
    return v;
}

static void knows_the_ends(void)
{
    int t;
    for (t = 0; t < LULL_TRANSFER_COUNT; ++t) {
        CHECK(lull_bits(one(lull_transfer_forward, t, 0.0f)) == 0);
        CHECK(lull_bits(one(lull_transfer_inverse, t, 0.0f)) == 0);
        CHECK(lull_bits(one(lull_transfer_forward, t, 1e-40f)) == 0);
        CHECK(lull_bits(one(lull_transfer_inverse, t, 1e-40f)) == 0);
        CHECK(one(lull_transfer_forward, t, FLT_MAX) <= FLT_MAX);
    }
    CHECK(fabs(one(lull_transfer_forward, LULL_TRANSFER_SRGB, 1.0f) - 1) < 2e-7);
    CHECK(fabs(one(lull_transfer_forward, LULL_TRANSFER_PU, 65504.0f) - 1) < 2e-7);
    CHECK(fabs(one(lull_transfer_forward, LULL_TRANSFER_LOG, 65504.0f) - 1) < 2e-7);
    CHECK(fabs(one(lull_transfer_forward, LULL_TRANSFER_PU, FLT_MAX) - 5.7706) < 1e-4);
    CHECK(one(lull_transfer_inverse, LULL_TRANSFER_SRGB, FLT_MAX) > FLT_MAX);
    CHECK(one(lull_transfer_inverse, LULL_TRANSFER_PU, FLT_MAX) > FLT_MAX);
    CHECK(one(lull_transfer_inverse, LULL_TRANSFER_LOG, FLT_MAX) > FLT_MAX);
    CHECK(one(lull_transfer_inverse, LULL_TRANSFER_LINEAR, FLT_MAX) <= FLT_MAX);
}

static void inverse_undoes_forward(void)
{
    int t;
    float y;
    for (t = 0; t < LULL_TRANSFER_COUNT; ++t)
        for (y = 1e-7f; y < 65504.0f; y *= 1.01f) {
            /* One rounding of the code, seen through the slope of the curve: under 16 e ln(2)
             * ulp. */
            float x = one(lull_transfer_forward, t, y);
            double back = one(lull_transfer_inverse, t, x);
            if (!CHECK(fabs(back / y - 1) < 1e-5))
                return;
        }
}

/* Any count at any address: the same values, and nothing else touched. */
static void does_not_depend_on_position(void)
{
    enum { MOST = 70, PAD = 5 };
    float source[MOST], buffer[MOST + 2 * PAD], guard[MOST + 2 * PAD];
    uint32_t seed = 1;
    size_t c, n, at, i;
    for (i = 0; i < MOST; ++i)
        source[i] = lull_float(random_bits(&seed) % 0x7f800000u);
    for (i = 0; i < MOST + 2 * PAD; ++i)
        guard[i] = -(float)i - 1;
    for (c = 0; c < CURVES; ++c)
        for (n = 0; n <= MOST; ++n)
            for (at = 0; at < PAD; ++at) {
                memcpy(buffer, guard, sizeof buffer);
                memcpy(buffer + at, source, n * sizeof *buffer);
                curves[c].apply(curves[c].transfer, buffer + at, n);
                for (i = 0; i < MOST + 2 * PAD; ++i) {
                    float v = guard[i];
                    if (i >= at && i < at + n)
                        v = one(curves[c].apply, curves[c].transfer, source[i - at]);
                    if (!CHECK(lull_bits(buffer[i]) == lull_bits(v)))
                        return;
                }
            }
}

/* ---- Elementary functions -------------------------------------------------------------------- */

static void log2_is_accurate(void)
{
    double worst = 0;
    uint32_t bits;
    for (bits = 0x00800000u; bits < 0x7f800000u; bits += 509) {
        double exact = log2(lull_float(bits));
        double error = fabs(lull_log2(lull_float(bits)) - exact) - fabs(exact) * FLT_EPSILON;
        worst = error > worst ? error : worst;
    }
    printf("     log2: 2 ulp and %.2e\n", worst);
    CHECK(worst < 2e-7);
    CHECK(lull_log2(FLT_MIN) == -126.0f);
    CHECK(lull_log2(1e-40f) == -126.0f);
    CHECK(lull_log2(0.0f) == -126.0f);
    CHECK(lull_log2(1.0f) == 0.0f);
}

static void exp2_is_accurate(void)
{
    double worst = 0, x;
    for (x = -126; x < 127.999; x += 0.00037) {
        double error = fabs(lull_exp2((float)x) / exp2((float)x) - 1);
        worst = error > worst ? error : worst;
    }
    printf("     exp2: relative error %.2e\n", worst);
    CHECK(worst < 3e-7);
    CHECK(lull_exp2(0.0f) == 1.0f);
    CHECK(lull_exp2(-126.0f) == FLT_MIN);
    CHECK(lull_bits(lull_exp2(-126.0001f)) == 0);
    CHECK(lull_bits(lull_exp2(-FLT_MAX)) == 0);
    CHECK(lull_exp2(127.0f) == 0x1p127f);
    CHECK(lull_exp2(128.0f) > FLT_MAX);
    CHECK(lull_exp2(FLT_MAX) > FLT_MAX);
}

static void elementary_functions_give_the_recorded_bits(void)
{
    static float values[N];
    uint64_t hash = HASH_START;
    uint32_t i;
    for (i = 0; i < N; ++i)
        values[i] = lull_log2(lull_float(i * 0x7f800u));
    hash = hash_floats(hash, values, N);
    for (i = 0; i < N; ++i)
        values[i] = lull_exp2((float)((int)i - N / 2) * 0.0631f);
    hash = hash_floats(hash, values, N);
    if (!CHECK(hash == UINT64_C(0x5634d6d2840a762a)))
        printf("     0x%08lx%08lx\n", (unsigned long)(hash >> 32),
               (unsigned long)(hash & 0xffffffffu));
}

/* ---- Callers that flush subnormals ----------------------------------------------------------- */

#if defined(__SSE2__)
#include <xmmintrin.h>
#define FLUSHES 1
static unsigned flush_begin(void)
{
    unsigned old = _mm_getcsr();
    _mm_setcsr(old | 0x8040u); /* flush to zero, denormals are zero */
    return old;
}
static void flush_end(unsigned old) { _mm_setcsr(old); }
#elif defined(__aarch64__) && defined(__GNUC__)
#define FLUSHES 1
static unsigned flush_begin(void)
{
    uint64_t old;
    __asm__ volatile("mrs %0, fpcr" : "=r"(old));
    __asm__ volatile("msr fpcr, %0" : : "r"(old | 1u << 24));
    return (unsigned)old;
}
static void flush_end(unsigned old) { __asm__ volatile("msr fpcr, %0" : : "r"((uint64_t)old)); }
#elif defined(__arm__) && defined(__VFP_FP__) && defined(__GNUC__)
#define FLUSHES 1
static unsigned flush_begin(void)
{
    unsigned old;
    __asm__ volatile("vmrs %0, fpscr" : "=r"(old));
    __asm__ volatile("vmsr fpscr, %0" : : "r"(old | 1u << 24));
    return old;
}
static void flush_end(unsigned old) { __asm__ volatile("vmsr fpscr, %0" : : "r"(old)); }
#else
#define FLUSHES 0
static unsigned flush_begin(void) { return 0; }
static void flush_end(unsigned old) { (void)old; }
#endif

static void does_not_depend_on_flushing_of_subnormals(void)
{
    size_t i;
    if (!FLUSHES)
        SKIP("optional: this CPU cannot flush subnormals to zero");
    for (i = 0; i < CURVES; ++i) {
        unsigned old = flush_begin();
        uint64_t hash = hash_curve(curves + i);
        flush_end(old);
        CHECK(hash == curves[i].hash);
    }
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(is_accurate);
    RUN(is_monotonic);
    RUN(knows_the_ends);
    RUN(inverse_undoes_forward);
    RUN(does_not_depend_on_position);
    RUN(gives_the_recorded_bits);
    RUN(does_not_depend_on_flushing_of_subnormals);
    RUN(log2_is_accurate);
    RUN(exp2_is_accurate);
    RUN(elementary_functions_give_the_recorded_bits);
    return check_report();
}
