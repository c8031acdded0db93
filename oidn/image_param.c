/* Image parameters: the checks of oidnSetFilterImage, and where the bytes of an image lie. */
#include "internal.h"

/* Number of channels and bytes of a pixel; 0 bytes for OIDN_FORMAT_UNDEFINED. False if unknown. */
static bool describe(OIDNFormat format, unsigned *channels, size_t *bytes)
{
    const int f = (int)format;

    if (f == OIDN_FORMAT_UNDEFINED) {
        *channels = 0;
        *bytes = 0;
    } else if (f >= OIDN_FORMAT_FLOAT && f <= OIDN_FORMAT_FLOAT4) {
        *channels = (unsigned)(f - OIDN_FORMAT_FLOAT + 1);
        *bytes = 4 * *channels;
    } else if (f >= OIDN_FORMAT_HALF && f <= OIDN_FORMAT_HALF4) {
        *channels = (unsigned)(f - OIDN_FORMAT_HALF + 1);
        *bytes = 2 * *channels;
    } else {
        return false;
    }
    return true;
}

unsigned lull_format_channels(OIDNFormat format)
{
    unsigned channels = 0;
    size_t bytes;

    describe(format, &channels, &bytes);
    return channels;
}

size_t lull_format_bytes(OIDNFormat format)
{
    unsigned channels;
    size_t bytes = 0;

    describe(format, &channels, &bytes);
    return bytes;
}

/* *sum = a + b * c, or false on overflow. */
static bool add_product(size_t *sum, size_t a, size_t b, size_t c)
{
    if (b && c > (SIZE_MAX - a) / b)
        return false;
    *sum = a + b * c;
    return true;
}

/* Fills strides and span. */
static bool lay_out(lull_image_param *image, size_t pixel_bytes, lull_fault *fault)
{
    size_t row;

    if (image->pixel_stride && image->pixel_stride < pixel_bytes)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT,
                         "pixel stride is smaller than a pixel");
    if (!image->pixel_stride)
        image->pixel_stride = pixel_bytes;
    if (!add_product(&row, 0, image->width, image->pixel_stride) ||
        (image->row_stride && image->row_stride < row))
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "row stride is smaller than a row");
    if (!image->row_stride)
        image->row_stride = row;
    image->span = 0;
    if (!image->width || !image->height)
        return true;
    if (!add_product(&image->span, pixel_bytes, image->width - 1, image->pixel_stride) ||
        !add_product(&image->span, image->span, image->height - 1, image->row_stride))
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "image is too large");
    return true;
}

bool lull_image_param_make(lull_image_param *image, OIDNBuffer buffer, void *pointer,
                           OIDNFormat format, size_t width, size_t height, size_t offset,
                           size_t pixel_stride, size_t row_stride, lull_fault *fault)
{
    unsigned channels;
    size_t pixel_bytes, end;

    if (!describe(format, &channels, &pixel_bytes))
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "unknown image format: %d",
                         (int)format);
    if (width > LULL_MAX_SIZE || height > LULL_MAX_SIZE ||
        (uint64_t)width * height * (channels ? channels : 1) > INT32_MAX)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "image is too large");
    image->buffer = buffer;
    image->format = format;
    image->width = width;
    image->height = height;
    image->pixel_stride = pixel_stride;
    image->row_stride = row_stride;
    if (!lay_out(image, pixel_bytes, fault))
        return false;
    if (!add_product(&end, offset, 1, image->span) || (uintptr_t)pointer > UINTPTR_MAX - end)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "image region is out of range");
    if (buffer && end > buffer->bytes)
        return lull_fail(
            fault, OIDN_ERROR_INVALID_ARGUMENT,
            "buffer region is out of range: image of %llu bytes at offset %llu of %llu",
            (unsigned long long)image->span, (unsigned long long)offset,
            (unsigned long long)buffer->bytes);
    image->data = buffer ? buffer->data : pointer;
    if (!buffer && !image->data && end)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "image pointer is null");
    image->set = buffer || image->data; /* no memory and no buffer: unset */
    if (image->data)
        image->data += offset;
    return true;
}
