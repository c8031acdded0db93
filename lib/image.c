/* Outline: pixels are read and written with memcpy, so any address will do; tight three-channel
 * rows, the common case, go as whole rows. */
#include "image.h"

#include "pixels.h"

#define TYPE_COUNT 2
#define INFINITY_BITS UINT32_C(0x7f800000)

static const uint8_t element_bytes[TYPE_COUNT] = {4, 2}; /* by lull_type */

float lull_half_to_float(uint16_t h)
{
    uint32_t magnitude = h & 0x7fffu, sign = (uint32_t)(h & 0x8000u) << 16;
    uint32_t bits = magnitude << 13;
    if (magnitude >= 0x7c00u) /* infinity, NaN */
        return lull_float(sign | (bits + (224u << 23)));
    if (magnitude >= 0x0400u)
        return lull_float(sign | (bits + (112u << 23)));
    /* Subnormal: an integer below 2^10 in units of 2^-24; both steps are exact. */
    return lull_float(sign | lull_bits((float)magnitude * (1.0f / 16777216.0f)));
}

uint16_t lull_float_to_half(float f)
{
    uint32_t bits = lull_bits(f), magnitude = bits & 0x7fffffffu;
    uint32_t sign = bits >> 16 & 0x8000u;
    if (magnitude > INFINITY_BITS) /* NaN stays NaN, quiet */
        return (uint16_t)(sign | 0x7e00u | (magnitude >> 13 & 0x3ffu));
    if (magnitude >= 0x477ff000u) /* from 65520 on */
        return (uint16_t)(sign | 0x7c00u);
    if (magnitude >= 0x38800000u) { /* normal: from 2^-14 */
        uint32_t odd = magnitude >> 13 & 1u;
        return (uint16_t)(sign | ((magnitude - (112u << 23) + 0xfffu + odd) >> 13));
    }
    if (magnitude <= 0x33000000u) /* up to 2^-25, the tie with 0 */
        return (uint16_t)sign;
    {
        uint32_t mantissa = (magnitude & 0x7fffffu) | 0x800000u;
        unsigned shift = 126u - (magnitude >> 23); /* 14 to 24 */
        uint32_t odd = mantissa >> shift & 1u;
        return (uint16_t)(sign | ((mantissa + (1u << (shift - 1)) - 1u + odd) >> shift));
    }
}

static float load_f32(const uint8_t *p)
{
    float f;
    memcpy(&f, p, sizeof f);
    return f;
}

static float load_f16(const uint8_t *p)
{
    uint16_t h;
    memcpy(&h, p, sizeof h);
    return lull_half_to_float(h);
}

static void store_f32(uint8_t *p, float f) { memcpy(p, &f, sizeof f); }

static void store_f16(uint8_t *p, float f)
{
    uint16_t h = lull_float_to_half(f);
    memcpy(p, &h, sizeof h);
}

static float (*const load_element[TYPE_COUNT])(const uint8_t *) = {load_f32, load_f16};
static void (*const store_element[TYPE_COUNT])(uint8_t *, float) = {store_f32, store_f16};

size_t lull_image_pixel_bytes(const lull_image *image)
{
    return (size_t)element_bytes[image->type] * image->channels;
}

ptrdiff_t lull_image_pixel_stride(const lull_image *image)
{
    return image->pixel_stride ? image->pixel_stride : (ptrdiff_t)lull_image_pixel_bytes(image);
}

ptrdiff_t lull_image_row_stride(const lull_image *image, unsigned width)
{
    return image->row_stride ? image->row_stride
                             : (ptrdiff_t)width * lull_image_pixel_stride(image);
}

uint8_t *lull_image_pixel(const lull_image *image, unsigned width, unsigned x, unsigned y)
{
    return (uint8_t *)image->data + (ptrdiff_t)y * lull_image_row_stride(image, width)
           + (ptrdiff_t)x * lull_image_pixel_stride(image);
}

int lull_image_is_in_place(const lull_image *a, const lull_image *b, unsigned width,
                           unsigned height)
{
    return a->data == b->data &&
           (width == 1 || lull_image_pixel_stride(a) == lull_image_pixel_stride(b)) &&
           (height == 1 || lull_image_row_stride(a, width) == lull_image_row_stride(b, width));
}

/* Bytes from the first pixel of a row to the end of the last, where strides are not negative. */
static size_t row_span(const lull_image *image, unsigned width)
{
    return (width - 1) * (size_t)lull_image_pixel_stride(image) + lull_image_pixel_bytes(image);
}

/* 1 if rows of b, which begin `ahead` bytes after those of a, end before the next ones of a, and do
 * not meet them: they lie behind them, or their pixels between those of a. */
static int is_between(const lull_image *a, const lull_image *b, size_t ahead, unsigned width)
{
    ptrdiff_t stride = lull_image_pixel_stride(a);
    size_t within = ahead % (size_t)stride;
    if (ahead + row_span(b, width) > (size_t)lull_image_row_stride(a, width))
        return 0;
    return row_span(a, width) <= ahead ||
           (stride == lull_image_pixel_stride(b) && lull_image_pixel_bytes(a) <= within &&
            within + lull_image_pixel_bytes(b) <= (size_t)stride);
}

/* 1 if pixels follow each other in rows, and these one another. */
static int is_in_order(const lull_image *image, unsigned width)
{
    ptrdiff_t row = lull_image_row_stride(image, width);
    return lull_image_pixel_stride(image) > 0 && row > 0 && (size_t)row >= row_span(image, width);
}

/* Addresses from the lowest byte of all pixels to the end of the highest. */
static void extent(const lull_image *image, unsigned width, unsigned height, uintptr_t *low,
                   uintptr_t *end)
{
    unsigned right = lull_image_pixel_stride(image) < 0 ? 0 : width - 1;
    unsigned bottom = lull_image_row_stride(image, width) < 0 ? 0 : height - 1;
    *low = (uintptr_t)lull_image_pixel(image, width, width - 1 - right, height - 1 - bottom);
    *end = (uintptr_t)lull_image_pixel(image, width, right, bottom) + lull_image_pixel_bytes(image);
}

int lull_image_overlaps(const lull_image *a, const lull_image *b, unsigned width, unsigned height)
{
    const lull_image *low = (uintptr_t)a->data <= (uintptr_t)b->data ? a : b;
    const lull_image *high = low == a ? b : a;
    size_t row = (size_t)lull_image_row_stride(low, width);
    size_t ahead = (size_t)((uintptr_t)high->data - (uintptr_t)low->data);
    uintptr_t first[2], end[2];
    extent(a, width, height, &first[0], &end[0]);
    extent(b, width, height, &first[1], &end[1]);
    if (end[0] <= first[1] || end[1] <= first[0])
        return 0;
    if (!is_in_order(a, width) || !is_in_order(b, width) ||
        lull_image_row_stride(a, width) != lull_image_row_stride(b, width))
        return 1;
    ahead %= row;
    return !is_between(low, high, ahead, width) && !is_between(high, low, row - ahead, width);
}

static int is_tight(const lull_image *image, lull_type type)
{
    return image->type == type && image->channels == 3
           && lull_image_pixel_stride(image) == (ptrdiff_t)lull_image_pixel_bytes(image);
}

float *lull_image_floats(const lull_image *image, unsigned width, unsigned x, unsigned y)
{
    uint8_t *p = lull_image_pixel(image, width, x, y);
    return is_tight(image, LULL_F32) && (uintptr_t)p % sizeof(float) == 0 ? (float *)(void *)p
                                                                           : NULL;
}

void lull_image_load(float *out, const lull_image *image, unsigned width, unsigned x, unsigned y,
                     unsigned n)
{
    const uint8_t *p = lull_image_pixel(image, width, x, y);
    ptrdiff_t stride = lull_image_pixel_stride(image);
    size_t element = element_bytes[image->type];
    size_t second = image->channels > 1 ? element : 0;
    size_t third = image->channels > 2 ? 2 * element : second;
    float (*load)(const uint8_t *) = load_element[image->type];
    size_t i;
    if (is_tight(image, LULL_F32)) {
        memcpy(out, p, (size_t)n * 3 * sizeof *out);
        return;
    }
    if (is_tight(image, LULL_F16)) {
        for (i = 0; i < (size_t)n * 3; ++i)
            out[i] = load_f16(p + 2 * i);
        return;
    }
    for (i = 0; i < n; ++i, p += stride, out += 3) {
        out[0] = load(p);
        out[1] = load(p + second);
        out[2] = load(p + third);
    }
}

void lull_image_store(const lull_image *image, unsigned width, unsigned x, unsigned y, unsigned n,
                      const float *in)
{
    uint8_t *p = lull_image_pixel(image, width, x, y);
    ptrdiff_t stride = lull_image_pixel_stride(image);
    size_t element = element_bytes[image->type];
    void (*store)(uint8_t *, float) = store_element[image->type];
    size_t i;
    unsigned c;
    if (is_tight(image, LULL_F32)) {
        memcpy(p, in, (size_t)n * 3 * sizeof *in);
        return;
    }
    if (is_tight(image, LULL_F16)) {
        for (i = 0; i < (size_t)n * 3; ++i)
            store_f16(p + 2 * i, in[i]);
        return;
    }
    for (i = 0; i < n; ++i, p += stride, in += 3)
        for (c = 0; c < image->channels; ++c)
            store(p + c * element, in[c]);
}

void lull_sanitize(float *values, size_t n, float scale, float lo, float hi)
{
    size_t i;
    for (i = 0; i < n; ++i)
        values[i] = lull_sane(values[i], scale, lo, hi);
}
