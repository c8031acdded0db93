/* PNG through libpng: 8 or 16 bit, grey or colour, alpha kept apart. */
#include "imageio.h"

#if LULL_WITH_PNG

#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"

/* All that must be freed after an error. It lives in the caller of setjmp's caller, so that longjmp
 * leaves it defined. */
typedef struct png_job {
    png_structp png;
    png_infop info;
    unsigned char *bytes; /* a row, or the whole image if it is interlaced */
    png_bytep *rows;
    float *values;
    image_error *error;
    image_status status; /* given to errors of the library */
} png_job;

static void on_error(png_structp png, png_const_charp text)
{
    png_job *job = png_get_error_ptr(png);
    image_fail(job->error, job->status, "PNG: %s", text);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static void job_free(png_job *job)
{
    free(job->bytes);
    free(job->rows);
    free(job->values);
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* After this, rows are 8 or 16 bit (big endian) grey, grey + alpha, RGB or RGBA. */
static void set_transforms(png_job *job)
{
    int depth = png_get_bit_depth(job->png, job->info);
    int color = png_get_color_type(job->png, job->info);
    if (color == PNG_COLOR_TYPE_PALETTE)
        png_set_palette_to_rgb(job->png);
    if (color == PNG_COLOR_TYPE_GRAY && depth < 8)
        png_set_expand_gray_1_2_4_to_8(job->png);
    if (png_get_valid(job->png, job->info, PNG_INFO_tRNS))
        png_set_tRNS_to_alpha(job->png);
    png_set_interlace_handling(job->png);
    png_read_update_info(job->png, job->info);
}

/* One row of libpng's bytes to the image and its alpha. stored: channels with alpha. */
static void store_row(png_job *job, image *out, size_t y, const unsigned char *bytes,
                      unsigned stored)
{
    float scale = out->bits == 16 ? 65535.0f : 255.0f;
    for (size_t x = 0; x < out->width; x++)
        for (unsigned c = 0; c < stored; c++) {
            size_t i = x * stored + c;
            float v = (float)(out->bits == 16 ? bytes[2 * i] << 8 | bytes[2 * i + 1] : bytes[i]) /
                      scale;
            if (c < out->channels)
                job->values[x * out->channels + c] = v;
            else
                out->alpha[y * out->width + x] = v;
        }
    image_set_row(out, y, job->values);
}

static image_status read_pixels(png_job *job, image *out, FILE *file, const image_request *request)
{
    unsigned stored, is_interlaced;
    size_t width, height, row_bytes;
    image_status status;

    png_read_info(job->png, job->info);
    width = png_get_image_width(job->png, job->info);
    height = png_get_image_height(job->png, job->info);
    is_interlaced = png_get_interlace_type(job->png, job->info) != PNG_INTERLACE_NONE;
    set_transforms(job);
    stored = png_get_channels(job->png, job->info);
    row_bytes = png_get_rowbytes(job->png, job->info);
    status = image_check_plausible(file, (double)row_bytes * (double)height, job->error);
    if (status)
        return status;
    status = image_begin(out, request, width, height, stored > 2 ? 3 : 1, IMAGE_FLOAT, job->error);
    if (status)
        return status;
    out->bits = png_get_bit_depth(job->png, job->info) == 16 ? 16 : 8;
    if (stored != out->channels)
        out->alpha = malloc(width * height * sizeof *out->alpha);
    job->values = malloc(width * out->channels * sizeof *job->values);
    job->bytes = malloc(is_interlaced ? row_bytes * height : row_bytes);
    job->rows = is_interlaced ? malloc(height * sizeof *job->rows) : NULL;
    if (!job->values || !job->bytes || (stored != out->channels && !out->alpha) ||
        (is_interlaced && !job->rows))
        return image_fail(job->error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (is_interlaced) {
        for (size_t y = 0; y < height; y++)
            job->rows[y] = job->bytes + y * row_bytes;
        png_read_image(job->png, job->rows);
    }
    for (size_t y = 0; y < height; y++) {
        if (!is_interlaced)
            png_read_row(job->png, job->bytes, NULL);
        store_row(job, out, y, is_interlaced ? job->rows[y] : job->bytes, stored);
    }
    png_read_end(job->png, NULL);
    return IMAGE_OK;
}

/* Where libpng's errors land. */
static image_status read_guarded(png_job *job, image *out, FILE *file, const image_request *request)
{
    if (setjmp(png_jmpbuf(job->png)))
        return job->error->status;
    png_init_io(job->png, file);
    png_set_user_limits(job->png, IMAGE_MAX_SIZE, IMAGE_MAX_SIZE);
    return read_pixels(job, out, file, request);
}

image_status image_read_png(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    png_job job;
    image_status status;

    memset(&job, 0, sizeof job);
    job.error = error;
    job.status = IMAGE_ERROR_DATA;
    job.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
    job.info = job.png ? png_create_info_struct(job.png) : NULL;
    if (job.info)
        status = read_guarded(&job, out, file, request);
    else
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (job.png)
        png_destroy_read_struct(&job.png, &job.info, NULL);
    job_free(&job);
    return status;
}

/* ---- Writing --------------------------------------------------------------------------------- */

/* Nearest integer; NaN is 0. */
static unsigned quantise(float v, float scale)
{
    v = v * scale + 0.5f;
    return v >= scale ? (unsigned)scale : v > 0.0f ? (unsigned)v : 0u;
}

static void write_pixels(png_job *job, const image *img)
{
    unsigned base = img->channels == 1 ? 1 : 3, stored = base + (img->alpha != NULL);
    unsigned step = img->bits == 16 ? 2 : 1;
    float scale = step == 2 ? 65535.0f : 255.0f;
    static const int types[] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};

    png_set_IHDR(job->png, job->info, (png_uint_32)img->width, (png_uint_32)img->height,
                 (int)step * 8, types[stored], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(job->png, 6);
    png_write_info(job->png, job->info);
    for (size_t y = 0; y < img->height && !platform_interrupted(); y++) {
        image_get_row(img, y, job->values);
        for (size_t x = 0; x < img->width; x++)
            for (unsigned c = 0; c < stored; c++) {
                unsigned from = c < img->channels ? c : img->channels - 1;
                float v = c < base ? job->values[x * img->channels + from]
                                   : img->alpha[y * img->width + x];
                unsigned q = quantise(v, scale);
                unsigned char *p = job->bytes + (x * stored + c) * step;
                if (step == 2)
                    *p++ = (unsigned char)(q >> 8);
                *p = (unsigned char)q;
            }
        png_write_row(job->png, job->bytes);
    }
    if (!platform_interrupted())
        png_write_end(job->png, NULL);
}

static image_status write_guarded(png_job *job, FILE *file, const image *img)
{
    if (setjmp(png_jmpbuf(job->png)))
        return job->error->status;
    png_init_io(job->png, file);
    write_pixels(job, img);
    return IMAGE_OK;
}

image_status image_write_png(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    png_job job;
    image_status status;

    (void)target;
    memset(&job, 0, sizeof job);
    job.error = error;
    job.status = IMAGE_ERROR_WRITE;
    job.bytes = malloc(img->width * 8);
    job.values = malloc(img->width * img->channels * sizeof *job.values);
    job.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
    job.info = job.png ? png_create_info_struct(job.png) : NULL;
    if (job.info && job.bytes && job.values)
        status = write_guarded(&job, file, img);
    else
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (job.png)
        png_destroy_write_struct(&job.png, &job.info);
    job_free(&job);
    return status;
}

#else

image_status image_read_png(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    (void)out;
    (void)file;
    (void)request;
    return image_fail(error, IMAGE_ERROR_FORMAT, "PNG is not supported by this build");
}

image_status image_write_png(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)file;
    (void)img;
    (void)target;
    return image_fail(error, IMAGE_ERROR_WRITE, "this build cannot write PNG");
}

#endif
