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
    int channels;          /* of the part */
    unsigned char *wanted; /* [channels] */
    int taken[3]; /* channels of the image, as places in the part */
    int alpha;    /* likewise, -1: none */
    image *out;
    exr_result_t failure; /* of the first chunk that failed, */
    exr_decoder *failed;  /* and whose it is, if in decoding */
} reader;

/* A chunk on its way. */
typedef struct read_slot {
    exr_decoder decoder;
    exr_result_t result;
} read_slot;

static void reader_free(reader *r)
{
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

/* Sizes and types of the layer; allocates the image. */
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
    if (!r->wanted)
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
    if (r->alpha >= 0 && r->wanted[r->alpha]) /* it is what is asked for, and has none itself */
        r->alpha = -1;
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

static void store_alpha(const reader *r, const exr_decoder *decoder)
{
    const exr_chunks *chunks = &decoder->chunks;
    size_t w = (size_t)chunks->info.width, h = (size_t)chunks->info.height;
    uint16_t type = decoder->decode.channels[r->alpha].data_type;
    const unsigned char *row = decoder->planes[r->alpha];
    for (size_t y = 0; y < h; y++, row += w * (type == EXR_PIXEL_HALF ? 2 : 4)) {
        float *values = r->out->alpha + ((size_t)chunks->y + y) * r->out->width + (size_t)chunks->x;
        for (size_t x = 0; x < w; x++)
            values[x] = value_at(row, x, type);
    }
}

static void store_chunk(const reader *r, const exr_decoder *decoder)
{
    const exr_chunks *chunks = &decoder->chunks;
    image *out = r->out;
    size_t w = (size_t)chunks->info.width, h = (size_t)chunks->info.height;
    if (r->alpha >= 0)
        store_alpha(r, decoder);
    for (unsigned c = 0; c < out->channels; c++) {
        const exr_coding_channel_info_t *channel = &decoder->decode.channels[r->taken[c]];
        const unsigned char *plane = decoder->planes[r->taken[c]];
        size_t line = w * (channel->data_type == EXR_PIXEL_HALF ? 2 : 4);
        for (size_t y = 0; y < h; y++) {
            size_t pixel = ((size_t)chunks->y + y) * out->width + (size_t)chunks->x;
            store_row(out, pixel * out->channels + c, plane + y * line, w, channel->data_type);
        }
    }
}

static int take_chunk(void *user, void *slot)
{
    reader *r = user;
    read_slot *s = slot;
    return exr_decoder_take(&s->decoder, &r->chunks);
}

static void decode_chunk(void *user, void *slot)
{
    read_slot *s = slot;
    s->result = exr_decode(&s->decoder);
    if (!s->result)
        store_chunk(user, &s->decoder);
}

static int put_chunk(void *user, void *slot)
{
    reader *r = user;
    read_slot *s = slot;
    r->failure = s->result;
    r->failed = s->result && !s->decoder.found ? &s->decoder : NULL;
    return !s->result;
}

/* The pixels of the layer. */
static image_status read_chunks(reader *r, int threads, image_error *error)
{
    const ordered_work work = {r, take_chunk, decode_chunk, put_chunk};
    image_status status = IMAGE_OK;
    exr_team team;
    read_slot *slots;
    exr_team_begin(&team, threads, exr_chunks_count(&r->chunks), &r->file, NULL);
    slots = calloc(team.slots, sizeof *slots);
    for (unsigned i = 0; slots && i < team.slots; i++) {
        slots[i].decoder.channels = r->channels;
        slots[i].decoder.wanted = r->wanted;
        slots[i].decoder.lock = team.lock;
    }
    if (slots)
        ordered_run(&work, slots, sizeof *slots, team.threads, team.lock);
    else
        r->failure = EXR_ERR_OUT_OF_MEMORY;
    if (r->failed && team.lock)
        r->failure = exr_decode_again(r->failed, r->failure, &r->file);
    if (r->failure)
        status = exr_file_fail(&r->file, r->failure, IMAGE_ERROR_DATA, error);
    for (unsigned i = 0; slots && i < team.slots; i++)
        exr_decoder_free(&slots[i].decoder);
    free(slots);
    exr_team_end(&team);
    return status;
}

static image_status read_layer(reader *r, image *out, const image_request *request,
                               image_error *error)
{
    exr_channels list;
    layer_match match;
    image_status status;
    exr_result_t result = exr_channels_list(&list, r->file.context,
                                        request->color ? request->color->part : 0);

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
    r->out = out;
    return status ? status : read_chunks(r, request->threads, error);
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

typedef struct writer {
    exr_file file;
    const image *img;
    size_t next; /* first row of the next chunk */
    exr_result_t result;
} writer;

/* A chunk on its way. */
typedef struct write_slot {
    exr_encoder encoder;
    unsigned char *planes;
    size_t y, rows;
    exr_result_t result;
} write_slot;

/* The rows of the chunk as planes in the order of the file's channels, which is alphabetical. */
static void fill_planes(write_slot *s, const image *img)
{
    size_t step = img->type == IMAGE_HALF ? 2 : 4, w = img->width;
    for (int k = 0; k < s->encoder.encode.channel_count; k++) {
        exr_coding_channel_info_t *channel = &s->encoder.encode.channels[k];
        const char *name = channel->channel_name;
        unsigned c = *name == 'G' ? 1 : *name == 'B' ? 2 : 0;
        unsigned char *plane = s->planes + (size_t)k * LINES * w * step;
        for (size_t i = 0; i < s->rows * w; i++) {
            size_t pixel = s->y * w + i;
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

static int take_rows(void *user, void *slot)
{
    writer *w = user;
    write_slot *s = slot;
    size_t left = w->img->height - w->next;
    s->y = w->next;
    s->rows = left < LINES ? left : LINES;
    w->next += s->rows;
    return left > 0;
}

static void encode_rows(void *user, void *slot)
{
    writer *w = user;
    write_slot *s = slot;
    exr_chunk_info_t info;
    if (!s->planes)
        s->planes = malloc(4 * LINES * w->img->width * 4);
    s->result = s->planes ? exr_write_scanline_chunk_info(w->file.context, 0, (int)s->y, &info)
                          : EXR_ERR_OUT_OF_MEMORY;
    if (!s->result)
        s->result = exr_encoder_begin(&s->encoder, w->file.context, 0, &info);
    if (s->result)
        return;
    fill_planes(s, w->img);
    s->result = exr_encode(&s->encoder);
}

static int put_rows(void *user, void *slot)
{
    writer *w = user;
    write_slot *s = slot;
    w->result = s->result ? s->result : exr_encoder_write(&s->encoder);
    return !w->result;
}

static void write_rows(writer *w, int threads)
{
    const ordered_work work = {w, take_rows, encode_rows, put_rows};
    exr_team team;
    write_slot *slots;
    exr_team_begin(&team, threads, (int)((w->img->height - 1) / LINES + 1), &w->file, NULL);
    slots = calloc(team.slots, sizeof *slots);
    if (slots)
        ordered_run(&work, slots, sizeof *slots, team.threads, team.lock);
    else
        w->result = EXR_ERR_OUT_OF_MEMORY;
    for (unsigned i = 0; slots && i < team.slots; i++) {
        exr_encoder_free(&slots[i].encoder);
        free(slots[i].planes);
    }
    free(slots);
    exr_team_end(&team);
}

static image_status write_alone(FILE *stream, const image *img, int threads, image_error *error)
{
    writer w;
    image_status status;
    memset(&w, 0, sizeof w);
    w.img = img;
    status = exr_file_write(&w.file, stream, error);
    if (!status) {
        w.result = write_header(&w.file, img);
        if (!w.result)
            write_rows(&w, threads);
        if (w.result)
            status = exr_file_fail(&w.file, w.result, IMAGE_ERROR_WRITE, error);
    }
    exr_file_close(&w.file);
    return status;
}

image_status image_write_exr(FILE *file, const image *img, const image_target *target,
                             image_error *error)
{
    if (target->keep_layers && img->is_layered)
        return exr_keep_write(file, img, target, error);
    return write_alone(file, img, target->threads, error);
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
