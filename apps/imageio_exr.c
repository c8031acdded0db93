/* OpenEXR: reading a layer of a file, and writing a file with one image. exr_channels.c lists what
 * layers there are, exr_keep.c writes into a copy of a multilayer file. */
#include "imageio.h"

#if LULL_WITH_OPENEXR

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "exr_channels.h"
#include "exr_file.h"
#include "exr_keep.h"
#include "half.h"
#include "layers.h"

/* ---- The layer that is wanted ---------------------------------------------------------------- */

/* The layer of the role that belongs to the colour, if there is one. */
static layer_match find_role(const exr_channels *list, image_role role, const image *color)
{
    const char *const *names = (const char *const *)list->plain;
    for (size_t i = 0; color && i < list->count; i++)
        if (list->entries[i].part == color->part && list->entries[i].index == color->channel)
            return layers_find_beside(role, names[i], names, list->count);
    return layers_find(role, names, list->count);
}

/* "no normal layer among R, G, B, ..." */
static image_status no_layer(const exr_channels *list, const image_request *request,
                             image_error *error)
{
    char text[160];
    size_t n = 0;
    for (size_t i = 0; i < list->count && n + 4 < sizeof text; i++) {
        int room = (int)(sizeof text - n);
        int more = snprintf(text + n, (size_t)room, "%s%s", i ? ", " : "", list->names[i]);
        if (more >= room) {
            memcpy(text + sizeof text - 4, "...", 4);
            n = sizeof text;
        } else {
            n += (size_t)more;
        }
    }
    if (!list->count)
        return image_fail(error, IMAGE_ERROR_FORMAT, "the file has only deep data");
    if (request->layer)
        return image_fail(error, IMAGE_ERROR_LAYER, "no layer '%.60s' among the channels %s",
                          request->layer, text);
    return image_fail(error, IMAGE_ERROR_LAYER, "no %s layer among the channels %s",
                      layers_role_name(request->role), text);
}

/* The layer asked for; count 0 if there is none, or if its channels are in different parts. */
static layer_match choose(const exr_channels *list, const image_request *request)
{
    const char *const *names = (const char *const *)list->names;
    layer_match match = {0, {0, 0, 0}};
    if (request->layer)
        match = layers_find_named(request->layer, names, list->count);
    else
        match = find_role(list, request->role, request->color);
    if (!match.count && !request->layer && !request->is_exact && request->role != IMAGE_COLOR)
        match = find_role(list, IMAGE_COLOR, NULL);
    for (unsigned c = 1; c < match.count; c++)
        if (list->entries[match.channels[c]].part != list->entries[match.channels[0]].part)
            match.count = 0;
    return match;
}

/* ---- Reading --------------------------------------------------------------------------------- */

typedef struct reader {
    exr_file file;
    exr_chunks chunks;
    exr_decode_pipeline_t decode;
    int is_started;
    int channels;          /* of the part */
    unsigned char *wanted; /* [channels] */
    unsigned char **planes;
    size_t *room;
    int taken[3]; /* channels of the image, as places in the part */
    int alpha;    /* likewise, -1: none */
} reader;

static void reader_free(reader *r)
{
    if (r->is_started)
        exr_decoding_destroy(r->file.context, &r->decode);
    for (int c = 0; r->planes && c < r->channels; c++)
        free(r->planes[c]);
    free(r->planes);
    free(r->room);
    free(r->wanted);
    exr_file_close(&r->file);
}

/* 1 for A and alpha, in upper or lower case. */
static int is_alpha(const char *component)
{
    static const char name[] = "alpha";
    size_t n = strlen(component);
    for (size_t i = 0; i < n; i++)
        if (tolower((unsigned char)component[i]) != name[i < 5 ? i : 5])
            return 0;
    return n == 1 || n == 5;
}

/* Place in the part of the alpha of a layer, one of whose channels has this name; -1: none. */
static int find_alpha(const exr_attr_chlist_t *channels, const char *name)
{
    const char *dot = strrchr(name, '.');
    size_t layer = dot ? (size_t)(dot - name) + 1 : 0;
    for (int c = 0; c < channels->num_channels; c++) {
        const exr_attr_chlist_entry_t *channel = &channels->entries[c];
        if (!strncmp(channel->name.str, name, layer) && is_alpha(channel->name.str + layer) &&
            channel->x_sampling == 1 && channel->y_sampling == 1)
            return c;
    }
    return -1;
}

/* Sizes and types of the layer; allocates the image and the decoding buffers. */
static image_status reader_begin(reader *r, image *out, const exr_channels *list, layer_match match,
                                 const image_request *request, image_error *error)
{
    int part = list->entries[match.channels[0]].part;
    const exr_attr_chlist_t *channels;
    image_type stored = IMAGE_HALF;
    uint64_t width, height;
    image_status status;
    exr_result_t result = exr_get_channels(r->file.context, part, &channels);

    if (!result)
        result = exr_chunks_begin(&r->chunks, r->file.context, part);
    if (result)
        return exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, error);
    r->channels = channels->num_channels;
    r->wanted = calloc((size_t)r->channels, sizeof *r->wanted);
    r->planes = calloc((size_t)r->channels, sizeof *r->planes);
    r->room = calloc((size_t)r->channels, sizeof *r->room);
    if (!r->wanted || !r->planes || !r->room)
        return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (unsigned c = 0; c < match.count; c++) {
        int index = list->entries[match.channels[c]].index;
        const exr_attr_chlist_entry_t *channel = &channels->entries[index];
        if (channel->x_sampling != 1 || channel->y_sampling != 1)
            return image_fail(error, IMAGE_ERROR_FORMAT, "subsampled channels are not supported");
        if (channel->pixel_type != EXR_PIXEL_HALF)
            stored = IMAGE_FLOAT;
        r->taken[c] = index;
        r->wanted[index] = 1;
    }
    width = (uint64_t)((int64_t)r->chunks.window.max.x - r->chunks.window.min.x + 1);
    height = (uint64_t)((int64_t)r->chunks.window.max.y - r->chunks.window.min.y + 1);
    /* Some compressions encode runs before they deflate: 1/64. */
    status = image_check_plausible(r->file.stream, (double)width * (double)height / 64, error);
    if (!status)
        status = image_begin(out, request, width, height, match.count, stored, error);
    if (status)
        return status;
    r->alpha = request->role == IMAGE_COLOR
                   ? find_alpha(channels, channels->entries[r->taken[0]].name.str)
                   : -1;
    if (r->alpha >= 0) {
        r->wanted[r->alpha] = 1;
        out->alpha = malloc((size_t)width * (size_t)height * sizeof *out->alpha);
        if (!out->alpha)
            return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    }
    out->is_layered = 1;
    out->part = part;
    out->channel = r->taken[0];
    out->left = r->chunks.window.min.x;
    out->top = r->chunks.window.min.y;
    out->may_be_light = request->role == IMAGE_ALBEDO && !request->layer &&
                        layers_may_be_light(list->plain[match.channels[0]]);
    for (unsigned c = 0; c < match.count; c++)
        snprintf(out->names[c], sizeof out->names[c], "%s",
                 channels->entries[r->taken[c]].name.str);
    return IMAGE_OK;
}

static float value_at(const unsigned char *plane, size_t i, uint16_t type)
{
    union {
        uint32_t u;
        float f;
        uint16_t h;
    } v;
    if (type == EXR_PIXEL_HALF) {
        memcpy(&v.h, plane + 2 * i, 2);
        return half_to_float(v.h);
    }
    memcpy(&v.u, plane + 4 * i, 4);
    return type == EXR_PIXEL_FLOAT ? v.f : (float)v.u;
}

/* A row of one channel into the image, from value `at` on in steps of the image's channels. */
static void store_row(image *out, size_t at, const unsigned char *row, size_t width, uint16_t type)
{
    size_t step = out->channels;
    if (out->type == IMAGE_FLOAT) {
        float *values = (float *)out->pixels + at;
        for (size_t x = 0; x < width; x++)
            values[x * step] = value_at(row, x, type);
    } else {
        uint16_t *values = (uint16_t *)out->pixels + at;
        for (size_t x = 0; x < width; x++) {
            if (type == EXR_PIXEL_HALF)
                memcpy(&values[x * step], row + 2 * x, 2);
            else
                values[x * step] = half_from_float(value_at(row, x, type));
        }
    }
}

static void store_alpha(const reader *r, image *out)
{
    size_t w = (size_t)r->chunks.info.width, h = (size_t)r->chunks.info.height;
    uint16_t type = r->decode.channels[r->alpha].data_type;
    const unsigned char *row = r->planes[r->alpha];
    for (size_t y = 0; y < h; y++, row += w * (type == EXR_PIXEL_HALF ? 2 : 4)) {
        float *values = out->alpha + ((size_t)r->chunks.y + y) * out->width + (size_t)r->chunks.x;
        for (size_t x = 0; x < w; x++)
            values[x] = value_at(row, x, type);
    }
}

static void store_chunk(const reader *r, image *out)
{
    size_t w = (size_t)r->chunks.info.width, h = (size_t)r->chunks.info.height;
    if (r->alpha >= 0)
        store_alpha(r, out);
    for (unsigned c = 0; c < out->channels; c++) {
        const exr_coding_channel_info_t *channel = &r->decode.channels[r->taken[c]];
        const unsigned char *plane = r->planes[r->taken[c]];
        size_t line = w * (channel->data_type == EXR_PIXEL_HALF ? 2 : 4);
        for (size_t y = 0; y < h; y++) {
            size_t pixel = ((size_t)r->chunks.y + y) * out->width + (size_t)r->chunks.x;
            store_row(out, pixel * out->channels + c, plane + y * line, w, channel->data_type);
        }
    }
}

static image_status read_layer(reader *r, image *out, const image_request *request,
                               image_error *error)
{
    exr_channels list;
    layer_match match;
    image_status status;
    exr_result_t result = exr_channels_list(&list, r->file.context,
                                        request->color ? request->color->part : 0);
    int is_end = 0;

    if (result) {
        status = exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, error);
    } else {
        match = choose(&list, request);
        if (!match.count)
            status = no_layer(&list, request, error);
        else if (match.count == 1 &&
                 layers_find_named("RY", (const char *const *)list.names, list.count).count)
            status = image_fail(error, IMAGE_ERROR_FORMAT,
                                "luminance and chroma channels are not supported");
        else
            status = reader_begin(r, out, &list, match, request, error);
    }
    exr_channels_free(&list);
    while (!status) {
        result = exr_chunks_next(&r->chunks, &is_end);
        if (is_end)
            break;
        if (!result)
            result = exr_decode_planes(&r->chunks, &r->decode, &r->is_started, r->wanted, r->planes,
                                       r->room);
        if (result)
            status = exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, error);
        else
            store_chunk(r, out);
    }
    return status;
}

image_status image_read_exr(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    reader r;
    image_status status;
    memset(&r, 0, sizeof r);
    status = exr_file_read(&r.file, file, error);
    if (!status)
        status = read_layer(&r, out, request, error);
    reader_free(&r);
    return status;
}

/* ---- Writing a file of its own --------------------------------------------------------------- */

#define LINES 16 /* of a ZIP chunk */

static exr_result_t write_header(exr_file *file, const image *img)
{
    static const char *const names[3][3] = {{"Y"}, {"R", "G"}, {"R", "G", "B"}};
    exr_pixel_type_t type = img->type == IMAGE_HALF ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
    int part = 0;
    exr_result_t result = exr_add_part(file->context, NULL, EXR_STORAGE_SCANLINE, &part);
    if (!result)
        result = exr_initialize_required_attr_simple(file->context, part, (int)img->width,
                                                     (int)img->height, EXR_COMPRESSION_ZIP);
    for (unsigned c = 0; c < img->channels && !result; c++)
        result = exr_add_channel(file->context, part, names[img->channels - 1][c], type,
                                 EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    if (!result && img->alpha)
        result = exr_add_channel(file->context, part, "A", type, EXR_PERCEPTUALLY_LINEAR, 1, 1);
    return result ? result : exr_write_header(file->context);
}

/* The rows of the chunk as planes in the order of the file's channels, which is alphabetical. */
static void fill_planes(unsigned char *planes, const image *img, exr_encode_pipeline_t *encode,
                        size_t y0, size_t rows)
{
    size_t step = img->type == IMAGE_HALF ? 2 : 4, w = img->width;
    for (int k = 0; k < encode->channel_count; k++) {
        exr_coding_channel_info_t *channel = &encode->channels[k];
        const char *name = channel->channel_name;
        unsigned c = *name == 'G' ? 1 : *name == 'B' ? 2 : 0;
        unsigned char *plane = planes + (size_t)k * LINES * w * step;
        for (size_t i = 0; i < rows * w; i++) {
            size_t pixel = y0 * w + i;
            float v = *name == 'A' ? img->alpha[pixel] : image_get(img, pixel * img->channels + c);
            uint16_t half = half_from_float(v);
            if (step == 2)
                memcpy(plane + 2 * i, &half, 2);
            else
                memcpy(plane + 4 * i, &v, 4);
        }
        channel->encode_from_ptr = plane;
        channel->user_bytes_per_element = (int16_t)step;
        channel->user_data_type = channel->data_type;
        channel->user_pixel_stride = (int32_t)step;
        channel->user_line_stride = (int32_t)(step * w);
    }
}

static exr_result_t write_rows(exr_file *file, const image *img, unsigned char *planes)
{
    exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_chunk_info_t info;
    exr_result_t result = EXR_ERR_SUCCESS;
    for (size_t y = 0; y < img->height && !result; y += LINES) {
        size_t rows = img->height - y < LINES ? img->height - y : LINES;
        result = exr_write_scanline_chunk_info(file->context, 0, (int)y, &info);
        if (!result && !y)
            result = exr_encoding_initialize(file->context, 0, &info, &encode);
        else if (!result)
            result = exr_encoding_update(file->context, 0, &info, &encode);
        if (result)
            break;
        fill_planes(planes, img, &encode, y, rows);
        result = exr_encode(file->context, 0, &encode, !y);
    }
    exr_encoding_destroy(file->context, &encode);
    return result;
}

static image_status write_alone(FILE *stream, const image *img, image_error *error)
{
    exr_file file;
    exr_result_t result;
    unsigned char *planes = malloc(4 * LINES * img->width * 4);
    image_status status = exr_file_write(&file, stream, error);

    if (!planes && !status)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (!status) {
        result = write_header(&file, img);
        if (!result)
            result = write_rows(&file, img, planes);
        if (result)
            status = exr_file_fail(&file, result, IMAGE_ERROR_WRITE, error);
    }
    exr_file_close(&file);
    free(planes);
    return status;
}

image_status image_write_exr(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    if (target->keep_layers && img->is_layered)
        return exr_keep_write(file, img, target->keep_layers, error);
    return write_alone(file, img, error);
}

#else

image_status image_read_exr(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    (void)out;
    (void)file;
    (void)request;
    return image_fail(error, IMAGE_ERROR_FORMAT, "OpenEXR is not supported by this build");
}

image_status image_write_exr(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    (void)file;
    (void)img;
    (void)target;
    return image_fail(error, IMAGE_ERROR_WRITE, "this build cannot write OpenEXR");
}

#endif
