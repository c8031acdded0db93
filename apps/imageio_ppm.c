/* PPM (P6) and PGM (P5), binary, 8 or 16 bit. Writing truncates value * 255 as Open Image Denoise's
 * program does, so that both give equal files. */
#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "imageio.h"
#include "platform.h"

/* Next number of the header, comments skipped; consumes the byte after it. -1 if there is none. */
static long read_number(FILE *file)
{
    long value = 0;
    int digits = 0, c = fgetc(file);
    while (c != EOF && (isspace(c) || c == '#')) {
        if (c == '#')
            while (c != EOF && c != '\n')
                c = fgetc(file);
        else
            c = fgetc(file);
    }
    for (; c != EOF && isdigit(c); c = fgetc(file)) {
        value = value * 10 + (c - '0');
        if (++digits > 9)
            return -1;
    }
    return digits && c != EOF && isspace(c) ? value : -1;
}

image_status image_read_ppm(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    unsigned channels;
    long width, height, maximum;
    size_t n, step;
    int64_t size;
    unsigned char *bytes;
    float *values;
    image_status status;

    (void)fgetc(file);
    channels = fgetc(file) == '6' ? 3 : 1;
    width = read_number(file);
    height = read_number(file);
    maximum = read_number(file);
    if (width < 0 || height < 0 || maximum < 1 || maximum > 65535)
        return image_fail(error, IMAGE_ERROR_DATA, "the PPM header is truncated or malformed");
    step = maximum > 255 ? 2 : 1;
    size = platform_file_size(file);
    if (size >= 0 && (double)width * (double)height * channels * (double)step > (double)size)
        return image_fail(error, IMAGE_ERROR_DATA,
                          "truncated: the header says %ldx%ld pixels, the file has %.0f bytes",
                          width, height, (double)size);
    status = image_begin(out, request, (uint64_t)width, (uint64_t)height, channels, IMAGE_FLOAT,
                         error);
    if (status)
        return status;
    out->bits = step == 2 ? 16 : 8;

    n = out->width * channels;
    bytes = malloc(n * step);
    values = malloc(n * sizeof *values);
    if (!bytes || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (size_t y = 0; !status && y < out->height; y++) {
        if (fread(bytes, step, n, file) != n) {
            status = image_fail(error, IMAGE_ERROR_DATA, "truncated: %zu of %zu rows are missing",
                                out->height - y, out->height);
            break;
        }
        for (size_t i = 0; i < n; i++)
            values[i] = (float)(step == 2 ? bytes[2 * i] << 8 | bytes[2 * i + 1] : bytes[i]) /
                        (float)maximum;
        image_set_row(out, y, values);
    }
    free(bytes);
    free(values);
    return status;
}

/* Value of the channel c of a file with as many as it needs: grey repeats, a missing blue is the
 * green. */
static float pick(const float *pixel, unsigned channels, unsigned c)
{
    return pixel[c < channels ? c : channels - 1];
}

static image_status write_channels(FILE *file, const image *img, unsigned channels,
                                   image_error *error)
{
    unsigned char *bytes = malloc(img->width * channels);
    float *values = malloc(img->width * img->channels * sizeof *values);
    image_status status = IMAGE_OK;

    if (!bytes || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    fprintf(file, "P%c\n%zu %zu\n255\n", channels == 3 ? '6' : '5', img->width, img->height);
    for (size_t y = 0; !status && y < img->height; y++) {
        image_get_row(img, y, values);
        for (size_t x = 0; x < img->width; x++)
            for (unsigned c = 0; c < channels; c++) {
                float v = pick(values + x * img->channels, img->channels, c) * 255.0f;
                bytes[x * channels + c] = (unsigned char)(v >= 255.0f ? 255
                                                          : v > 0.0f  ? (int)v
                                                                      : 0);
            }
        if (fwrite(bytes, channels, img->width, file) != img->width)
            status = image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(errno ? errno : EIO));
    }
    free(bytes);
    free(values);
    return status;
}

image_status image_write_ppm(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)target;
    return write_channels(file, img, img->channels == 1 ? 1 : 3, error);
}

image_status image_write_pgm(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)target;
    if (img->channels != 1)
        return image_fail(error, IMAGE_ERROR_WRITE, "PGM holds grey images only; use .ppm");
    return write_channels(file, img, 1, error);
}
