#include "imageio.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "half.h"
#include "platform.h"

/* The formats. The first row whose magic a file begins with reads it; rows with the same magic
 * differ in what they write. */
static const image_format formats[] = {
    {"exr", "OpenEXR", LULL_WITH_OPENEXR, 1, 0, 1, IMAGE_MULTIPLIED, "\x76\x2f\x31\x01",
     image_read_exr, image_write_exr},
    {"pfm", "PFM", 1, 1, 0, 0, IMAGE_OPAQUE, "PF", image_read_pfm, image_write_pfm},
    {"pfm", "PFM", 1, 1, 0, 0, IMAGE_OPAQUE, "Pf", image_read_pfm, image_write_pfm},
    {"pfm", "PFM", 1, 1, 0, 0, IMAGE_OPAQUE, "P=", image_read_pfm, image_write_pfm},
    {"phm", "PHM", 1, 1, 0, 0, IMAGE_OPAQUE, "PH", image_read_pfm, image_write_phm},
    {"phm", "PHM", 1, 1, 0, 0, IMAGE_OPAQUE, "Ph", image_read_pfm, image_write_phm},
    {"phm", "PHM", 1, 1, 0, 0, IMAGE_OPAQUE, "P:", image_read_pfm, image_write_phm},
    {"png", "PNG", LULL_WITH_PNG, 0, 1, 0, IMAGE_STRAIGHT, "\x89PNG\r\n\x1a\n", image_read_png,
     image_write_png},
    {"hdr", "Radiance HDR", 1, 1, 0, 0, IMAGE_OPAQUE, "#?R", image_read_hdr, image_write_hdr},
    {"ppm", "PPM", 1, 0, 1, 0, IMAGE_OPAQUE, "P6", image_read_ppm, image_write_ppm},
    {"pgm", "PGM", 1, 0, 1, 0, IMAGE_OPAQUE, "P5", image_read_ppm, image_write_pgm},
};
#define FORMATS (sizeof formats / sizeof formats[0])

image_status image_fail(image_error *error, image_status status, const char *format, ...)
{
    va_list arguments;
    error->status = status;
    va_start(arguments, format);
    vsnprintf(error->text, sizeof error->text, format, arguments);
    va_end(arguments);
    for (char *c = error->text; *c; c++)
        if ((unsigned char)*c < ' ')
            *c = ' ';
    return status;
}

/* Row of the extension, or NULL. */
static const image_format *format_of_path(const char *path)
{
    const char *dot = strrchr(path, '.');
    for (size_t i = 0; dot && i < FORMATS; i++) {
        const char *a = dot + 1, *b = formats[i].extension;
        while (*a && tolower((unsigned char)*a) == *b)
            a++, b++;
        if (!*a && !*b)
            return &formats[i];
    }
    return NULL;
}

static const image_format *format_of_content(const unsigned char *head, size_t bytes)
{
    for (size_t i = 0; i < FORMATS; i++) {
        size_t n = strlen(formats[i].magic);
        if (n <= bytes && memcmp(head, formats[i].magic, n) == 0)
            return &formats[i];
    }
    return NULL;
}

int image_path_is_linear(const char *path)
{
    const image_format *format = format_of_path(path);
    return format && format->is_linear;
}

int image_path_is_integer(const char *path)
{
    const image_format *format = format_of_path(path);
    return format && format->is_integer;
}

int image_is_linear(const image *img, const char *path)
{
    return format_of_path(path) ? image_path_is_linear(path) : !img->bits;
}

int image_is_integer(const image *img, const char *path)
{
    return img->bits && (image_path_is_integer(path) || !format_of_path(path));
}

image_alpha image_path_alpha(const char *path)
{
    const image_format *format = format_of_path(path);
    return format ? format->alpha : IMAGE_OPAQUE;
}

/* ---- Images ---------------------------------------------------------------------------------- */

size_t image_pixel_bytes(const image *img)
{
    return img->channels * (img->type == IMAGE_HALF ? 2u : 4u);
}
size_t image_count(const image *img) { return img->width * img->height * img->channels; }
size_t image_bytes(const image *img) { return img->width * img->height * image_pixel_bytes(img); }

image_status image_create(image *out, size_t width, size_t height, unsigned channels,
                          image_type type, image_error *error)
{
    memset(out, 0, sizeof *out);
    out->width = width;
    out->height = height;
    out->channels = channels;
    out->type = type == IMAGE_HALF ? IMAGE_HALF : IMAGE_FLOAT;
    if (height == 0 || width <= SIZE_MAX / height / 16)
        out->pixels = malloc(image_bytes(out) ? image_bytes(out) : 1);
    platform_use_huge_pages(out->pixels, out->pixels ? image_bytes(out) : 0);
    if (out->pixels)
        return IMAGE_OK;
    memset(out, 0, sizeof *out);
    return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory for %zux%zu pixels", width,
                      height);
}

void image_destroy(image *img)
{
    free(img->pixels);
    free(img->alpha);
    memset(img, 0, sizeof *img);
}

image_status image_begin(image *out, const image_request *request, uint64_t width, uint64_t height,
                         unsigned channels, image_type stored, image_error *error)
{
    uint64_t bytes;
    if (!width || !height)
        return image_fail(error, IMAGE_ERROR_DATA, "the image has no pixels (%llux%llu)",
                          (unsigned long long)width, (unsigned long long)height);
    if (width > IMAGE_MAX_SIZE || height > IMAGE_MAX_SIZE)
        return image_fail(error, IMAGE_ERROR_FORMAT,
                          "%llux%llu pixels; at most %d a side are supported",
                          (unsigned long long)width, (unsigned long long)height, IMAGE_MAX_SIZE);
    bytes = width * height * channels * 4;
    if (bytes > SIZE_MAX / 4 || (request->max_bytes && bytes > request->max_bytes))
        return image_fail(error, IMAGE_ERROR_MEMORY, "%llux%llu pixels are too many",
                          (unsigned long long)width, (unsigned long long)height);
    return image_create(out, (size_t)width, (size_t)height, channels,
                        request->type == IMAGE_ANY ? stored : request->type, error);
}

#define DEFLATE_MOST 1032 /* bytes that one byte of a deflate stream can stand for */

image_status image_check_plausible(FILE *file, double pixel_bytes, image_error *error)
{
    int64_t size = platform_file_size(file);
    if (size < 0 || pixel_bytes <= (double)size * DEFLATE_MOST + 65536)
        return IMAGE_OK;
    return image_fail(error, IMAGE_ERROR_DATA,
                      "truncated: the header says %.0f bytes of pixels, the file has %.0f",
                      pixel_bytes, (double)size);
}

float image_get(const image *img, size_t index)
{
    if (img->type == IMAGE_HALF)
        return half_to_float(((const uint16_t *)img->pixels)[index]);
    return ((const float *)img->pixels)[index];
}

void image_set(image *img, size_t index, float value)
{
    if (img->type == IMAGE_HALF)
        ((uint16_t *)img->pixels)[index] = half_from_float(value);
    else
        ((float *)img->pixels)[index] = value;
}

int image_is_finite(const image *img)
{
    for (size_t i = 0, n = image_count(img); i < n; i++)
        if (isfinite(image_get(img, i)))
            return 1;
    return 0;
}

void image_get_row(const image *img, size_t y, float *values)
{
    size_t n = img->width * img->channels;
    if (img->type == IMAGE_FLOAT) {
        memcpy(values, (const float *)img->pixels + y * n, n * sizeof *values);
    } else {
        const uint16_t *row = (const uint16_t *)img->pixels + y * n;
        for (size_t i = 0; i < n; i++)
            values[i] = half_to_float(row[i]);
    }
}

void image_set_row(image *img, size_t y, const float *values)
{
    size_t n = img->width * img->channels;
    if (img->type == IMAGE_FLOAT) {
        memcpy((float *)img->pixels + y * n, values, n * sizeof *values);
    } else {
        uint16_t *row = (uint16_t *)img->pixels + y * n;
        for (size_t i = 0; i < n; i++)
            row[i] = half_from_float(values[i]);
    }
}

/* ---- Curves ---------------------------------------------------------------------------------- */

float srgb_encode(float x)
{
    return x <= 0.0031308f ? 12.92f * x : 1.055f * powf(x, 1.0f / 2.4f) - 0.055f;
}

float srgb_decode(float x)
{
    return x <= 0.04045f ? x / 12.92f : powf((x + 0.055f) / 1.055f, 2.4f);
}

static float signed_encode(float x) { return x * 0.5f + 0.5f; }
static float signed_decode(float x) { return x * 2.0f - 1.0f; }

static void map_values(image *img, float (*f)(float))
{
    for (size_t i = 0, n = image_count(img); i < n; i++)
        image_set(img, i, f(image_get(img, i)));
}

void image_encode_srgb(image *img) { map_values(img, srgb_encode); }
void image_decode_srgb(image *img) { map_values(img, srgb_decode); }
void image_encode_signed(image *img) { map_values(img, signed_encode); }
void image_decode_signed(image *img) { map_values(img, signed_decode); }

void image_convert_alpha(image *img, const float *alpha, image_alpha from, image_alpha to)
{
    if (!alpha || from == to || from == IMAGE_OPAQUE || to == IMAGE_OPAQUE)
        return;
    for (size_t i = 0, n = image_count(img); i < n; i++) {
        float a = alpha[i / img->channels], v = image_get(img, i);
        if (to == IMAGE_MULTIPLIED)
            image_set(img, i, v * a);
        else if (a > 0) /* what shines through transparent pixels stays */
            image_set(img, i, v / a);
    }
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* "not a picture of a known format" with a hint where the beginning is telling. */
static image_status unknown_format(const unsigned char *head, size_t bytes, image_error *error)
{
    static const char lfs[] = "version https://git-lfs";
    if (bytes >= 7 && !memcmp(head, lfs, bytes < sizeof lfs - 1 ? bytes : sizeof lfs - 1))
        return image_fail(error, IMAGE_ERROR_FORMAT, "a Git LFS pointer, not the file itself");
    if (bytes >= 3 && head[0] == 0xff && head[1] == 0xd8 && head[2] == 0xff)
        return image_fail(error, IMAGE_ERROR_FORMAT, "JPEG images are not supported");
    return image_fail(error, IMAGE_ERROR_FORMAT,
                      "not an image of a supported format (exr, pfm, phm, png, hdr, ppm, pgm)");
}

/* A temporary file of what a pipe gives, beginning with the bytes that were read of it already:
 * readers want to seek. NULL if it cannot be made. */
static FILE *copy_pipe(FILE *pipe, const unsigned char *head, size_t bytes)
{
    char block[4096];
    FILE *copy = tmpfile();
    int is_whole = copy && fwrite(head, 1, bytes, copy) == bytes;
    while (is_whole && (bytes = fread(block, 1, sizeof block, pipe)) > 0)
        is_whole = fwrite(block, 1, bytes, copy) == bytes;
    if (is_whole && !ferror(pipe) && !fflush(copy) && !platform_seek(copy, 0))
        return copy;
    if (copy)
        fclose(copy);
    return NULL;
}

image_status image_read_stream(image *out, FILE *file, const image_request *request,
                               image_error *error)
{
    unsigned char head[24];
    size_t bytes;
    const image_format *format;
    FILE *source = file;
    image_status status;

    memset(out, 0, sizeof *out);
    errno = 0;
    bytes = fread(head, 1, sizeof head, file);
    if (!bytes)
        return image_fail(error, IMAGE_ERROR_OPEN, "%s",
                          ferror(file) ? strerror(errno ? errno : EIO) : "the file is empty");
    format = format_of_content(head, bytes);
    if (!format)
        return unknown_format(head, bytes, error);
    if (!format->is_available)
        return image_fail(error, IMAGE_ERROR_FORMAT, "%s is not supported by this build",
                          format->name);
    if (platform_seek(file, 0)) {
        if (format->is_copied)
            return image_fail(error, IMAGE_ERROR_OPEN, "%s is not read from pipes", format->name);
        source = copy_pipe(file, head, bytes);
        if (!source)
            return image_fail(error, IMAGE_ERROR_OPEN, "cannot copy the pipe to a temporary file");
    }
    status = format->read(out, source, request, error);
    if (source != file)
        fclose(source);
    if (status)
        image_destroy(out);
    return status;
}

image_status image_read(image *out, const char *path, const image_request *request,
                        image_error *error)
{
    FILE *file;
    image_status status;

    memset(out, 0, sizeof *out);
    if (platform_is_directory(path))
        return image_fail(error, IMAGE_ERROR_OPEN, "is a directory");
    file = fopen(path, "rb");
    if (!file)
        return image_fail(error, IMAGE_ERROR_OPEN, "%s", strerror(errno));
    status = image_read_stream(out, file, request, error);
    fclose(file);
    return status;
}

image_status image_check_writable(const char *path, image_error *error)
{
    const image_format *format = format_of_path(path);
    int code;
    if (!format)
        return image_fail(
            error, IMAGE_ERROR_WRITE,
            "the extension names no format that can be written (exr, pfm, phm, png, hdr, "
            "ppm, pgm)");
    if (!format->is_available)
        return image_fail(error, IMAGE_ERROR_WRITE, "this build cannot write %s", format->name);
    code = output_check(path);
    return code ? image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(code)) : IMAGE_OK;
}

image_status image_write(const char *path, const image *img, const image_target *target,
                         image_error *error)
{
    static const image_target plain = {NULL, 0, NULL, 0};
    output_file out;
    image_status status = image_check_writable(path, error);
    int code;

    if (status)
        return status;
    code = output_open(&out, path);
    if (code)
        return image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(code));
    errno = 0;
    status = format_of_path(path)->write(out.stream, img, target ? target : &plain, error);
    if (ferror(out.stream)) /* the reason; libraries say only that they could not write */
        status = image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(errno ? errno : EIO));
    if (platform_interrupted())
        status = image_fail(error, IMAGE_ERROR_WRITE, "interrupted");
    if (status) {
        output_discard(&out);
        return status;
    }
    code = output_close(&out);
    return code ? image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(code)) : IMAGE_OK;
}
