#include "doctor.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "doctor_maps.h"
#include "report.h"

const char *doctor_kind_name(finding_kind kind)
{
    static const char *const names[FINDING_KINDS] = {
        "non-finite",   "negative",   "normals-encoded", "normals-length", "albedo-above-one",
        "albedo-black", "ldr-as-hdr", "hdr-as-ldr",      "correlated",     "shifted",
        "panorama",
    };
    return names[kind];
}

static void add(findings *out, finding_kind kind, image_role role, const char *format, ...)
    REPORT_PRINTF(4, 5);

static void add(findings *out, finding_kind kind, image_role role, const char *format, ...)
{
    va_list arguments;
    if (out->count == FINDINGS_MAX)
        return;
    out->list[out->count].kind = kind;
    out->list[out->count].role = role;
    va_start(arguments, format);
    vsnprintf(out->list[out->count++].text, sizeof out->list[0].text, format, arguments);
    va_end(arguments);
}

static double percent(size_t part, size_t whole)
{
    return whole ? 100.0 * (double)part / (double)whole : 0.0;
}

/* Values that every image should not have. is_signed: negative values are right. */
static void examine_values(findings *out, const image *img, image_role role, int is_signed)
{
    size_t n = image_count(img), non_finite = 0, negative = 0;
    for (size_t i = 0; i < n; i++) {
        float v = image_get(img, i);
        non_finite += !isfinite(v);
        negative += v < 0;
    }
    if (non_finite)
        add(out, FINDING_NONFINITE, role,
            "%zu values (%.2g %%) are NaN or infinite and will be taken as 0 or as "
            "the largest value; find them in the renderer",
            non_finite, percent(non_finite, n));
    if (negative && !is_signed)
        add(out, FINDING_NEGATIVE, role, "%zu values (%.2g %%) are negative and will be taken as 0",
            negative, percent(negative, n));
}

/* ---- Albedo and normals ---------------------------------------------------------------------- */

static void examine_albedo(findings *out, const image *img)
{
    size_t n = image_count(img), above = 0, positive = 0;
    float largest = 0;
    for (size_t i = 0; i < n; i++) {
        float v = image_get(img, i);
        if (!isfinite(v))
            continue;
        above += v > 1.01f;
        positive += v > 0;
        largest = v > largest ? v : largest;
    }
    if (above)
        add(out, FINDING_ALBEDO_ABOVE_ONE, IMAGE_ALBEDO,
            "albedo exceeds 1 in %zu values (%.2g %%), up to %.3g; it will be clamped: is it an "
            "albedo?",
            above, percent(above, n), (double)largest);
    if (!positive)
        add(out, FINDING_ALBEDO_BLACK, IMAGE_ALBEDO,
            "albedo is black everywhere and tells nothing");
}

static void examine_normals(findings *out, const image *img)
{
    size_t pixels = img->width * img->height, used = 0, unit = 0, decoded_unit = 0, negative = 0,
           longer = 0;
    if (img->channels != 3)
        return;
    for (size_t i = 0; i < pixels; i++) {
        float v[3], raw, decoded = 0;
        for (unsigned c = 0; c < 3; c++)
            v[c] = image_get(img, 3 * i + c);
        raw = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        if (!isfinite(raw) || raw == 0)
            continue;
        for (unsigned c = 0; c < 3; c++)
            decoded += (2 * v[c] - 1) * (2 * v[c] - 1);
        decoded = sqrtf(decoded);
        if (decoded < 0.05f && raw > 0.5f) /* an encoded zero: background */
            continue;
        used++;
        unit += fabsf(raw - 1) < 0.1f;
        decoded_unit += fabsf(decoded - 1) < 0.1f;
        negative += v[0] < -0.02f || v[1] < -0.02f || v[2] < -0.02f;
        longer += raw > 1.05f;
    }
    if (used && negative * 1000 < used && decoded_unit * 10 > used * 6 && unit * 2 < used)
        add(out, FINDING_NORMAL_ENCODED, IMAGE_NORMAL,
            "normals look encoded as n * 0.5 + 0.5 (none is negative); the denoiser wants them in "
            "[-1, 1]");
    else if (longer * 100 > used)
        add(out, FINDING_NORMAL_LENGTH, IMAGE_NORMAL, "%.3g %% of the normals are longer than 1",
            percent(longer, used));
}

/* ---- High or low dynamic range --------------------------------------------------------------- */

/* How the values look like those of an 8-bit file: 0 not, 1 as stored, 2 after the sRGB curve. */
static int find_steps(const image *img)
{
    size_t n = image_count(img), step = n / 20000 + 1, seen = 0, raw = 0, encoded = 0, distinct = 0;
    float tolerance = img->type == IMAGE_HALF ? 0.07f : 0.02f;
    unsigned char levels[256] = {0};
    for (size_t i = 0; i < n; i += step) {
        float v = image_get(img, i), a, b;
        if (!(v > 0.05f && v < 0.999f)) /* near 0 every value is close to a step */
            continue;
        a = v * 255;
        b = srgb_encode(v) * 255;
        seen++;
        raw += fabsf(a - floorf(a + 0.5f)) < tolerance;
        encoded += fabsf(b - floorf(b + 0.5f)) < tolerance;
        distinct += !levels[(int)a];
        levels[(int)a] = 1;
    }
    if (seen < 200 || distinct < 8)
        return 0;
    return raw * 100 >= seen * 99 ? 1 : encoded * 100 >= seen * 99 ? 2 : 0;
}

static void examine_range(findings *out, const image *img, doctor_content content)
{
    size_t n = image_count(img), above = 0, clipped = 0;
    float largest = 0;
    for (size_t i = 0; i < n; i++) {
        float v = image_get(img, i);
        if (!isfinite(v))
            continue;
        largest = v > largest ? v : largest;
        above += v > 1.001f;
        clipped += v > 0.999f && v <= 1.001f;
    }
    if (content != DOCTOR_HDR) {
        if (above)
            add(out, FINDING_HDR_AS_LDR, IMAGE_COLOR,
                "%zu values (%.2g %%) are above 1, up to %.3g, and will be "
                "clipped: it looks like HDR, use --hdr",
                above, percent(above, n), (double)largest);
        return;
    }
    if (largest > 1.001f)
        return;
    switch (find_steps(img)) {
    case 1:
        add(out, FINDING_LDR_AS_HDR, IMAGE_COLOR,
            "marked HDR, but the values are the 256 steps of an 8-bit image, "
            "likely sRGB-encoded: use --ldr with --srgb");
        return;
    case 2:
        add(out, FINDING_LDR_AS_HDR, IMAGE_COLOR,
            "marked HDR, but it comes from an 8-bit sRGB image: use --ldr");
        return;
    default:
        if (clipped >= 4 && clipped * 5000 > n)
            add(out, FINDING_LDR_AS_HDR, IMAGE_COLOR,
                "marked HDR, but %.3g %% of the values are clipped at 1: use "
                "--ldr, and --srgb if it is encoded",
                percent(clipped, n));
    }
}

/* ---- Noise and alignment --------------------------------------------------------------------- */

static void examine_noise(findings *out, const image *color, const image *albedo,
                          const image *normal)
{
    doctor_maps maps;
    const image *aux[2] = {albedo, normal};
    double near, far;
    if (doctor_maps_init(&maps, color))
        return;
    doctor_noise_scale(&maps, &near, &far);
    /* White noise differs by as much from the next pixel as from the one after it (near is 1),
     * structure keeps growing with distance (far and near are about 0.7). Limits set on 250 renders
     * with box filter (none flagged) and the same under a tent filter (80 % flagged up to 16
     * samples per pixel). */
    if (far > 0.75 && near < 0.72 && far - near > 0.12)
        add(out, FINDING_CORRELATED, IMAGE_COLOR,
            "the noise of neighbouring pixels is correlated: render with a box "
            "filter, without splatting, and denoise before any other filter");
    for (int i = 0; i < 2; i++) {
        doctor_alignment a;
        image_role role = i ? IMAGE_NORMAL : IMAGE_ALBEDO;
        if (!aux[i] || doctor_align(&maps, aux[i], &a))
            continue;
        if (a.mirrored > 0.12 && a.mirrored - a.as_given > 0.1 && a.mirrored > a.shifted)
            add(out, FINDING_SHIFTED, role, "it looks mirrored %s against the colour",
                a.is_vertical ? "top to bottom" : "left to right");
        else if (a.shifted > 0.12 && a.shifted - a.as_given > 0.03)
            add(out, FINDING_SHIFTED, role,
                "it looks shifted against the colour, by %d pixels to the right and %d "
                "down",
                a.dx, a.dy);
    }
    doctor_maps_free(&maps);
}

void doctor_examine(findings *out, const image *color, doctor_content content, const image *albedo,
                    const image *normal)
{
    out->count = 0;
    if (color)
        examine_values(out, color, IMAGE_COLOR, content == DOCTOR_SIGNED);
    if (albedo)
        examine_values(out, albedo, IMAGE_ALBEDO, 0);
    if (normal)
        examine_values(out, normal, IMAGE_NORMAL, 1);
    if (albedo)
        examine_albedo(out, albedo);
    if (normal)
        examine_normals(out, normal);
    if (color && content != DOCTOR_SIGNED) {
        examine_range(out, color, content);
        examine_noise(out, color, albedo, normal);
    }
}

/* ---- Panoramas ------------------------------------------------------------------------------- */

enum { STRIPS = 64, ROWS = STRIPS / 2 }; /* blocks across a picture, and down */

/* Sum of the values of a block that are light. */
static double block_sum(const image *img, size_t x, size_t y)
{
    size_t size = img->width / STRIPS, n = size * img->channels;
    double sum = 0;
    for (size_t row = y * size; row < (y + 1) * size; row++)
        for (size_t i = 0; i < n; i++) {
            float v = image_get(img, row * img->width * img->channels + x * n + i);
            sum += v > 0 && isfinite(v) ? (double)v : 0;
        }
    return sum;
}

/* How far two columns of blocks are apart in brightness. */
static double distance(float light[ROWS][STRIPS], size_t a, size_t b)
{
    double sum = 0;
    for (size_t y = 0; y < ROWS; y++)
        sum += fabs((double)light[y][a] - (double)light[y][b]);
    return sum;
}

/* The limits were set on 18 panoramas of 1 to 16 samples, of which 15 are found, and on 410 renders
 * of other kinds, cut to their shape, of which 4 are. */
void doctor_examine_edges(findings *out, const image *img)
{
    float light[ROWS][STRIPS];
    double meet, near = 0, far = INFINITY, mean = 0;
    if (img->width != 2 * img->height || img->width < STRIPS)
        return;
    for (size_t i = 0; i < ROWS * STRIPS; i++) {
        light[i / STRIPS][i % STRIPS] = (float)block_sum(img, i % STRIPS, i / STRIPS);
        mean += (double)light[i / STRIPS][i % STRIPS] / (ROWS * STRIPS);
    }
    for (size_t i = 0; i < ROWS * STRIPS && mean > 0; i++)
        light[i / STRIPS][i % STRIPS] = logf(0.05f + light[i / STRIPS][i % STRIPS] / (float)mean);
    meet = distance(light, 0, STRIPS - 1);
    for (size_t x = 0; x < STRIPS; x += STRIPS / 4) {
        near += distance(light, x, x + 1) / 4;
        far = x ? fmin(far, distance(light, 0, x)) : far;
    }
    if (meet < 1.2 * near && meet < 0.4 * far)
        add(out, FINDING_PANORAMA, IMAGE_COLOR,
            "it looks like a panorama of a whole sphere, whose edges meet: --panorama leaves no "
            "seam there");
}
