/* Radiance HDR (RGBE): three mantissas and a shared exponent in four bytes, plain or run-length
 * encoded. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "imageio.h"
#include "platform.h"

#define RLE_MIN 8 /* widths that the newer run-length encoding knows */
#define RLE_MAX 32767

/* A header line without its end; what does not fit is left out, since the commands that programs
 * note there have no limit. 0 at the end of the file. */
static int read_line(FILE *file, char *line, size_t size)
{
    size_t n = 0;
    int c;
    while ((c = fgetc(file)) != EOF && c != '\n')
        if (n + 1 < size)
            line[n++] = (char)c;
    while (n && line[n - 1] == '\r')
        n--;
    line[n] = 0;
    return c != EOF;
}

/* What a header says. */
typedef struct header {
    unsigned long width, height;
    int is_flipped;  /* rows from bottom to top */
    float factor[3]; /* that pixels were multiplied by */
} header;

/* "NAME=value": the value without blanks around it; NULL if the line is another one. */
static char *value_of(char *line, const char *name)
{
    size_t n = strlen(name);
    char *value = line + n;
    if (strncmp(line, name, n) || *value++ != '=')
        return NULL;
    value += strspn(value, " \t");
    for (n = strlen(value); n && strchr(" \t", value[n - 1]); n--)
        value[n - 1] = 0;
    return value;
}

/* Multiplies by the one factor of a line, or by its three; nonsense counts as none. */
static void add_factors(header *h, const char *text, int count)
{
    float values[3] = {1, 1, 1};
    int found = sscanf(text, "%f %f %f", &values[0], &values[1], &values[2]);
    for (int c = 0; c < 3 && found >= count; c++) {
        float factor = h->factor[c] * values[count == 1 ? 0 : c];
        if (factor > 0 && isfinite(factor) && isfinite(1 / factor))
            h->factor[c] = factor;
    }
}

/* Reads up to and including the resolution line. Factors of several lines multiply. */
static image_status read_header(FILE *file, header *h, image_error *error)
{
    char line[1024], sign_y, sign_x, rest, *value;
    h->factor[0] = h->factor[1] = h->factor[2] = 1;
    do {
        if (!read_line(file, line, sizeof line))
            return image_fail(error, IMAGE_ERROR_DATA, "the Radiance header is truncated");
        if ((value = value_of(line, "FORMAT")) != NULL && strcmp(value, "32-bit_rle_rgbe"))
            return image_fail(error, IMAGE_ERROR_FORMAT,
                              "Radiance files of format '%.40s' are not supported", value);
        if ((value = value_of(line, "EXPOSURE")) != NULL)
            add_factors(h, value, 1);
        if ((value = value_of(line, "COLORCORR")) != NULL)
            add_factors(h, value, 3);
    } while (line[0]);
    if (!read_line(file, line, sizeof line))
        return image_fail(error, IMAGE_ERROR_DATA, "the Radiance header is truncated");
    if (sscanf(line, "%cY %9lu %cX %9lu%c", &sign_y, &h->height, &sign_x, &h->width, &rest) != 4 ||
        (sign_y != '-' && sign_y != '+') || (sign_x != '-' && sign_x != '+'))
        return image_fail(error, IMAGE_ERROR_DATA, "the Radiance resolution line is malformed");
    if (sign_x == '-')
        return image_fail(error, IMAGE_ERROR_FORMAT, "mirrored Radiance files are not supported");
    h->is_flipped = sign_y == '+';
    return IMAGE_OK;
}

/* The newer encoding: each of the four components of the row by itself, in runs (count > 128) and
 * copies. */
static int read_components(FILE *file, unsigned char *row, size_t width)
{
    for (unsigned c = 0; c < 4; c++)
        for (size_t x = 0; x < width;) {
            int count = fgetc(file), value = 0;
            int is_run = count > 128;
            if (is_run) {
                count -= 128;
                value = fgetc(file);
            }
            if (count <= 0 || value == EOF || (size_t)count > width - x)
                return 0;
            for (; count--; x++) {
                if (!is_run && (value = fgetc(file)) == EOF)
                    return 0;
                row[4 * x + c] = (unsigned char)value;
            }
        }
    return 1;
}

/* Plain pixels, with the older encoding: (1,1,1,n) repeats the last pixel n << shift times. */
static int read_pixels(FILE *file, unsigned char *row, size_t width, size_t x)
{
    unsigned shift = 0;
    while (x < width) {
        unsigned char *p = row + 4 * x;
        if (fread(p, 1, 4, file) != 4)
            return 0;
        if (p[0] == 1 && p[1] == 1 && p[2] == 1 && x > 0) {
            size_t count = shift <= 16 ? (size_t)p[3] << shift : width + 1;
            if (count > width - x)
                return 0;
            for (; count--; x++)
                memcpy(row + 4 * x, row + 4 * x - 4, 4);
            shift += 8;
        } else {
            shift = 0;
            x++;
        }
    }
    return 1;
}

static int read_row(FILE *file, unsigned char *row, size_t width)
{
    if (fread(row, 1, 4, file) != 4)
        return 0;
    if (width >= RLE_MIN && width <= RLE_MAX && row[0] == 2 && row[1] == 2 && row[2] < 128)
        return ((size_t)row[2] << 8 | row[3]) == width && read_components(file, row, width);
    return read_pixels(file, row, width, 1);
}

image_status image_read_hdr(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    header h = {0};
    int64_t size;
    unsigned char *row;
    float *values;
    image_status status = read_header(file, &h, error);

    if (status)
        return status;
    size = platform_file_size(file);
    if (size >= 0 && (double)h.height * 4 > (double)size) /* a row takes four bytes at least */
        return image_fail(error, IMAGE_ERROR_DATA,
                          "truncated: the header says %lux%lu pixels, the file has %.0f bytes",
                          h.width, h.height, (double)size);
    status = image_begin(out, request, h.width, h.height, 3, IMAGE_FLOAT, error);
    if (status)
        return status;
    row = malloc(out->width * 4);
    values = malloc(out->width * 3 * sizeof *values);
    if (!row || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (size_t y = 0; !status && y < out->height; y++) {
        if (!read_row(file, row, out->width)) {
            status = image_fail(error, IMAGE_ERROR_DATA, "truncated or corrupt in row %zu of %zu",
                                y, out->height);
            break;
        }
        for (size_t x = 0; x < out->width; x++) {
            const unsigned char *p = row + 4 * x;
            float unit = p[3] ? ldexpf(1.0f, p[3] - (128 + 8)) : 0.0f;
            for (unsigned c = 0; c < 3; c++)
                values[3 * x + c] = (float)p[c] * unit / h.factor[c];
        }
        image_set_row(out, h.is_flipped ? out->height - 1 - y : y, values);
    }
    free(row);
    free(values);
    return status;
}

/* Nearest RGBE; negative values and NaN become 0, infinities the largest value there is. */
static void encode_pixel(unsigned char *rgbe, const float *rgb)
{
    float v[3], largest = 0;
    int exponent;
    memset(rgbe, 0, 4);
    for (unsigned c = 0; c < 3; c++) {
        v[c] = rgb[c] > 0 ? rgb[c] : 0;
        v[c] = v[c] < 1.69e38f ? v[c] : 1.69e38f;
        largest = v[c] > largest ? v[c] : largest;
    }
    if (largest < 1e-37f)
        return;
    frexpf(largest, &exponent);
    if (floorf(ldexpf(largest, 8 - exponent) + 0.5f) >= 256.0f)
        exponent++;
    for (unsigned c = 0; c < 3; c++)
        rgbe[c] = (unsigned char)floorf(ldexpf(v[c], 8 - exponent) + 0.5f);
    rgbe[3] = (unsigned char)(exponent + 128);
}

/* Appends one component of a row, run-length encoded, and returns the new end. */
static unsigned char *encode_component(unsigned char *end, const unsigned char *row, size_t width)
{
    size_t x = 0;
    while (x < width) {
        size_t start = x, run = 0;
        /* Copies go on until a run of at least 4. */
        while (x < width) {
            run = 1;
            while (x + run < width && run < 127 && row[4 * (x + run)] == row[4 * x])
                run++;
            if (run >= 4)
                break;
            x += run;
        }
        while (start < x) {
            size_t count = x - start < 128 ? x - start : 128;
            *end++ = (unsigned char)count;
            for (size_t i = 0; i < count; i++)
                *end++ = row[4 * start++];
        }
        if (x < width) {
            *end++ = (unsigned char)(128 + run);
            *end++ = row[4 * x];
            x += run;
        }
    }
    return end;
}

image_status image_write_hdr(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    size_t width = img->width;
    unsigned char *row = malloc(width * 4);
    unsigned char *packed = malloc(width * 5 + 64);
    float *values = malloc(width * img->channels * sizeof *values);
    int is_packed = width >= RLE_MIN && width <= RLE_MAX;
    image_status status = IMAGE_OK;

    (void)target;
    if (!row || !packed || !values)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    fprintf(file, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %zu +X %zu\n", img->height, width);
    for (size_t y = 0; !status && y < img->height; y++) {
        unsigned char *end = packed;
        const unsigned char *start = row;
        size_t bytes = width * 4;
        image_get_row(img, y, values);
        for (size_t x = 0; x < width; x++) {
            float rgb[3];
            for (unsigned c = 0; c < 3; c++)
                rgb[c] = values[x * img->channels + (c < img->channels ? c : img->channels - 1)];
            encode_pixel(row + 4 * x, rgb);
        }
        if (is_packed) {
            *end++ = 2;
            *end++ = 2;
            *end++ = (unsigned char)(width >> 8);
            *end++ = (unsigned char)width;
            for (unsigned c = 0; c < 4; c++)
                end = encode_component(end, row + c, width);
            start = packed;
            bytes = (size_t)(end - packed);
        }
        if (fwrite(start, 1, bytes, file) != bytes)
            status = image_fail(error, IMAGE_ERROR_WRITE, "%s", strerror(errno ? errno : EIO));
    }
    free(row);
    free(packed);
    free(values);
    return status;
}
