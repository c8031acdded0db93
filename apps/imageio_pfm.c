/* PFM (float) and PHM (half): a text header, then rows from bottom to top. A negative scale means
 * little endian; its absolute value multiplies. Three magics each, for three, one and two channels;
 * the last is an extension by Open Image Denoise, as is PHM. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "half.h"
#include "imageio.h"
#include "platform.h"

static const struct {
    char mark;
    unsigned channels;
    image_type type;
} variants[] = {
    {'F', 3, IMAGE_FLOAT}, {'f', 1, IMAGE_FLOAT}, {'=', 2, IMAGE_FLOAT},
    {'H', 3, IMAGE_HALF},  {'h', 1, IMAGE_HALF},  {':', 2, IMAGE_HALF},
};
#define VARIANTS (sizeof variants / sizeof variants[0])

/* Next word of the header; consumes one white-space byte after it. Returns 0 if there is none. */
static int read_word(FILE *file, char *word, size_t size)
{
    size_t n = 0;
    int c = fgetc(file);
    while (c != EOF && isspace(c))
        c = fgetc(file);
    for (; c != EOF && !isspace(c); c = fgetc(file)) {
        if (n + 1 >= size)
            return 0;
        word[n++] = (char)c;
    }
    word[n] = 0;
    return n && c != EOF;
}

static int read_number(FILE *file, double *value)
{
    char word[40], *end;
    if (!read_word(file, word, sizeof word))
        return 0;
    *value = strtod(word, &end);
    return *end == 0 && isfinite(*value);
}

/* Moves past a line feed after the one byte of white space that ends the header (\r\n, or a blank
 * and \n). It may as well be the first byte of the pixels: the file's size tells. */
static void skip_line_feed(FILE *file, double pixel_bytes)
{
    int64_t size = platform_file_size(file);
    long here = ftell(file);
    if (size < 0 || here < 0 || (double)(size - here) != pixel_bytes + 1)
        return;
    platform_seek(file, here - 1);
    if (fgetc(file) == '\n' || fgetc(file) != '\n')
        platform_seek(file, here);
}

/* One row of values in file order to floats. */
static void unpack_row(float *values, const unsigned char *bytes, size_t n, image_type type,
                       int is_big, float scale)
{
    for (size_t i = 0; i < n; i++) {
        if (type == IMAGE_HALF) {
            const unsigned char *p = bytes + 2 * i;
            values[i] = half_to_float((uint16_t)(is_big ? p[0] << 8 | p[1] : p[1] << 8 | p[0]));
        } else {
            const unsigned char *p = bytes + 4 * i;
            uint32_t u = is_big ? (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 |
                                      (uint32_t)p[2] << 8 | p[3]
                                : (uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 |
                                      (uint32_t)p[1] << 8 | p[0];
            memcpy(&values[i], &u, sizeof u);
        }
        if (scale != 1.0f)
            values[i] *= scale;
    }
}

image_status image_read_pfm(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    char mark[8];
    double width, height, scale;
    size_t v = 0, n, row_bytes;
    int64_t size;
    unsigned char *bytes;
    float *values;
    image_status status;

    if (!read_word(file, mark, sizeof mark) || !read_number(file, &width) ||
        !read_number(file, &height) || !read_number(file, &scale) || mark[2])
        return image_fail(error, IMAGE_ERROR_DATA, "the PFM header is truncated or malformed");
    while (v < VARIANTS && variants[v].mark != mark[1])
        v++;
    if (v == VARIANTS || scale == 0 || width < 0 || height < 0 || width != floor(width) ||
        height != floor(height) || width > 1e9 || height > 1e9)
        return image_fail(error, IMAGE_ERROR_DATA, "the PFM header is malformed");

    size = platform_file_size(file);
    row_bytes = (size_t)width * variants[v].channels * (variants[v].type == IMAGE_HALF ? 2u : 4u);
    if (size >= 0 && (double)row_bytes * height > (double)size)
        return image_fail(
            error, IMAGE_ERROR_DATA,
            "truncated: the header says %.0fx%.0f pixels, %.0f bytes, the file has %.0f", width,
            height, (double)row_bytes * height, (double)size);
    status = image_begin(out, request, (uint64_t)width, (uint64_t)height, variants[v].channels,
                         variants[v].type, error);
    if (status)
        return status;

    skip_line_feed(file, (double)row_bytes * height);
    n = out->width * out->channels;
    bytes = malloc(row_bytes);
    values = malloc(n * sizeof *values);
    if (!bytes || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (size_t y = out->height; !status && y-- > 0;) {
        if (fread(bytes, 1, row_bytes, file) != row_bytes) {
            status = image_fail(error, IMAGE_ERROR_DATA, "truncated: %zu of %zu rows are missing",
                                y + 1, out->height);
            break;
        }
        unpack_row(values, bytes, n, variants[v].type, scale > 0, (float)fabs(scale));
        image_set_row(out, y, values);
    }
    free(bytes);
    free(values);
    return status;
}

static image_status write_variant(FILE *file, const image *img, image_type type, image_error *error)
{
    size_t n = img->width * img->channels, step = type == IMAGE_HALF ? 2 : 4, v = 0;
    unsigned char *bytes = malloc(n * step);
    float *values = malloc(n * sizeof *values);
    image_status status = IMAGE_OK;

    if (!bytes || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    while (variants[v].channels != img->channels || variants[v].type != type)
        v++;
    fprintf(file, "P%c\n%zu %zu\n-1.0\n", variants[v].mark, img->width, img->height);
    for (size_t y = img->height; !status && y-- > 0;) {
        image_get_row(img, y, values);
        for (size_t i = 0; i < n; i++) {
            uint32_t u;
            memcpy(&u, &values[i], sizeof u);
            if (type == IMAGE_HALF)
                u = half_from_float(values[i]);
            for (size_t k = 0; k < step; k++)
                bytes[step * i + k] = (unsigned char)(u >> 8 * k);
        }
        if (fwrite(bytes, step, n, file) != n)
            status = image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(errno ? errno : EIO));
    }
    free(bytes);
    free(values);
    return status;
}

image_status image_write_pfm(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)target;
    return write_variant(file, img, IMAGE_FLOAT, error);
}

image_status image_write_phm(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)target;
    return write_variant(file, img, IMAGE_HALF, error);
}
