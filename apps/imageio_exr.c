/* OpenEXR: reading layers of a file, and writing a file with one image. exr_channels.c lists what
 * layers there are, exr_keep.c writes into a copy of a multilayer file. */
#include "imageio.h"

#if LULL_WITH_OPENEXR

#include <stdlib.h>
#include <string.h>

#include "exr_channels.h"
#include "exr_file.h"
#include "exr_keep.h"
#include "half.h"
#include "layers.h"

/* ---- Reading --------------------------------------------------------------------------------- */

/* A layer on its way into an image. */
typedef struct layer {
    image *out;
    const image_request *request;
    image_error *error;
    image_status status; /* whether it can be read, or was */
    int is_read;
    int part;
    int taken[3]; /* channels of the image, as places in the part */
    int alpha;    /* likewise, -1: none */
} layer;

typedef struct reader {
    exr_file file;
    layer layers[1 + IMAGE_MAX_BESIDE]; /* the one asked for, and those beside it */
    unsigned count;
    int part; /* that is being read, */
    exr_chunks chunks;
    int channels;          /* of it */
    unsigned char *wanted; /* [channels] */
    exr_result_t failure;  /* of the first chunk that failed, */
    exr_decoder *failed;   /* and whose it is, if in decoding */
} reader;

/* A chunk on its way. */
typedef struct read_slot {
    exr_decoder decoder;
    exr_result_t result;
} read_slot;

/* Place in the part of the alpha of a layer, one of whose channels has this name; -1: none. */
static int find_alpha(const exr_attr_chlist_t *channels, const char *name)
{
    const char *dot = strrchr(name, '.');
    size_t prefix = dot ? (size_t)(dot - name) + 1 : 0;
    for (int c = 0; c < channels->num_channels; c++) {
        const exr_attr_chlist_entry_t *channel = &channels->entries[c];
        if (!strncmp(channel->name.str, name, prefix) &&
            layers_is_alpha(channel->name.str + prefix) && channel->x_sampling == 1 &&
            channel->y_sampling == 1)
            return c;
    }
    return -1;
}

/* The channels of the layer. */
static image_status take_channels(layer *l, image_type *stored, const exr_channels *list,
                                  const layer_match *match, const exr_attr_chlist_t *channels)
{
    for (unsigned c = 0; c < match->count; c++) {
        int index = list->entries[match->channels[c]].index;
        const exr_attr_chlist_entry_t *channel = &channels->entries[index];
        if (channel->x_sampling != 1 || channel->y_sampling != 1)
            return image_fail(l->error, IMAGE_ERROR_FORMAT,
                              "subsampled channels are not supported");
        if (channel->pixel_type != EXR_PIXEL_HALF)
            *stored = IMAGE_FLOAT;
        l->taken[c] = index;
    }
    l->alpha = l->request->role == IMAGE_COLOR
                   ? find_alpha(channels, channels->entries[l->taken[0]].name.str)
                   : -1;
    for (unsigned c = 0; c < match->count; c++)
        if (l->taken[c] == l->alpha) /* it is what is asked for, and has none itself */
            l->alpha = -1;
    return IMAGE_OK;
}

/* Sizes and types of the layer; allocates the image. */
static image_status layer_begin(reader *r, layer *l, const exr_channels *list,
                                const layer_match *match)
{
    image *out = l->out;
    const exr_attr_chlist_t *channels;
    exr_attr_box2i_t window;
    image_type stored = IMAGE_HALF;
    uint64_t width, height;
    image_status status;
    exr_result_t result;

    l->part = list->entries[match->channels[0]].part;
    result = exr_get_channels(r->file.context, l->part, &channels);
    if (!result)
        result = exr_get_data_window(r->file.context, l->part, &window);
    if (result)
        return exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, l->error);
    status = take_channels(l, &stored, list, match, channels);
    if (status)
        return status;
    width = (uint64_t)((int64_t)window.max.x - window.min.x + 1);
    height = (uint64_t)((int64_t)window.max.y - window.min.y + 1);
    /* Some compressions encode runs before they deflate: 1/64. */
    status = image_check_plausible(r->file.stream, (double)width * (double)height / 64, l->error);
    if (!status)
        status = image_begin(out, l->request, width, height, match->count, stored, l->error);
    if (status)
        return status;
    if (l->alpha >= 0) {
        out->alpha = malloc((size_t)width * (size_t)height * sizeof *out->alpha);
        if (!out->alpha)
            return image_fail(l->error, IMAGE_ERROR_MEMORY, "not enough memory");
    }
    out->is_layered = 1;
    out->part = l->part;
    out->left = window.min.x;
    out->top = window.min.y;
    out->may_be_light = l->request->role == IMAGE_ALBEDO && !l->request->layer &&
                        layers_may_be_light(list->plain[match->channels[0]]);
    for (unsigned c = 0; c < match->count; c++)
        snprintf(out->names[c], sizeof out->names[c], "%s",
                 channels->entries[l->taken[c]].name.str);
    return IMAGE_OK;
}

/* Finds a layer; those beside the first belong to it. */
static image_status layer_find(reader *r, layer *l, const exr_channels *list)
{
    const exr_channel color = {r->layers[0].part, r->layers[0].taken[0]};
    layer_match match;
    image_status status = exr_channels_find(&match, list, l->request,
                                            l == r->layers ? NULL : &color, l->error);
    return status ? status : layer_begin(r, l, list, &match);
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

static void store_alpha(const layer *l, const exr_decoder *decoder)
{
    const exr_chunks *chunks = &decoder->chunks;
    size_t w = (size_t)chunks->info.width, h = (size_t)chunks->info.height;
    uint16_t type = decoder->decode.channels[l->alpha].data_type;
    const unsigned char *row = decoder->planes[l->alpha];
    for (size_t y = 0; y < h; y++, row += w * (type == EXR_PIXEL_HALF ? 2 : 4)) {
        float *values = l->out->alpha + ((size_t)chunks->y + y) * l->out->width + (size_t)chunks->x;
        for (size_t x = 0; x < w; x++)
            values[x] = value_at(row, x, type);
    }
}

static void store_layer(const layer *l, const exr_decoder *decoder)
{
    const exr_chunks *chunks = &decoder->chunks;
    image *out = l->out;
    size_t w = (size_t)chunks->info.width, h = (size_t)chunks->info.height;
    if (l->alpha >= 0)
        store_alpha(l, decoder);
    for (unsigned c = 0; c < out->channels; c++) {
        const exr_coding_channel_info_t *channel = &decoder->decode.channels[l->taken[c]];
        const unsigned char *plane = decoder->planes[l->taken[c]];
        size_t line = w * (channel->data_type == EXR_PIXEL_HALF ? 2 : 4);
        for (size_t y = 0; y < h; y++) {
            size_t pixel = ((size_t)chunks->y + y) * out->width + (size_t)chunks->x;
            store_row(out, pixel * out->channels + c, plane + y * line, w, channel->data_type);
        }
    }
}

/* 1 if the layer is in the part that is being read. */
static int is_current(const reader *r, const layer *l)
{
    return !l->status && l->part == r->part;
}

static void store_chunk(const reader *r, const exr_decoder *decoder)
{
    for (unsigned i = 0; i < r->count; i++)
        if (is_current(r, &r->layers[i]))
            store_layer(&r->layers[i], decoder);
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

/* The pixels of all layers of the part. */
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

static image_status begin_part(reader *r, int part, image_error *error)
{
    const exr_attr_chlist_t *channels;
    exr_result_t result = exr_get_channels(r->file.context, part, &channels);
    r->part = part;
    r->failure = EXR_ERR_SUCCESS;
    r->failed = NULL;
    if (!result)
        result = exr_chunks_begin(&r->chunks, r->file.context, part);
    if (result)
        return exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, error);
    r->channels = channels->num_channels;
    r->wanted = calloc((size_t)r->channels, sizeof *r->wanted);
    if (!r->wanted)
        return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (unsigned i = 0; i < r->count; i++) {
        const layer *l = &r->layers[i];
        for (unsigned c = 0; is_current(r, l) && c < l->out->channels; c++)
            r->wanted[l->taken[c]] = 1;
        if (is_current(r, l) && l->alpha >= 0)
            r->wanted[l->alpha] = 1;
    }
    return IMAGE_OK;
}

/* Reads a part once for all layers in it. */
static void read_part(reader *r, int part)
{
    image_error error;
    image_status status = begin_part(r, part, &error);
    if (!status)
        status = read_chunks(r, r->layers[0].request->threads, &error);
    for (unsigned i = 0; i < r->count; i++) {
        layer *l = &r->layers[i];
        if (!is_current(r, l))
            continue;
        l->is_read = 1;
        l->status = status;
        if (status)
            *l->error = error;
    }
    free(r->wanted);
    r->wanted = NULL;
}

/* Finds all layers; those beside the first one in a list that begins with its part. */
static void find_layers(reader *r)
{
    layer *first = r->layers;
    exr_channels list;
    exr_result_t result = exr_channels_list(&list, r->file.context, 0);
    if (!result)
        first->status = layer_find(r, first, &list);
    if (!result && !first->status && first->part && r->count > 1) {
        exr_channels_free(&list);
        result = exr_channels_list(&list, r->file.context, first->part);
    }
    if (result)
        first->status = exr_file_fail(&r->file, result, IMAGE_ERROR_DATA, first->error);
    for (unsigned i = 1; i < r->count && !first->status; i++)
        r->layers[i].status = layer_find(r, &r->layers[i], &list);
    exr_channels_free(&list);
}

static void read_layers(reader *r)
{
    find_layers(r);
    for (unsigned i = 0; i < r->count && !r->layers[0].status; i++)
        if (!r->layers[i].status && !r->layers[i].is_read)
            read_part(r, r->layers[i].part);
}

static void add_layer(reader *r, image *out, const image_request *request, image_error *error)
{
    layer *l = &r->layers[r->count++];
    l->out = out;
    l->request = request;
    l->error = error;
    memset(out, 0, sizeof *out);
}

image_status image_read_exr(image *out, FILE *file, const image_request *request,
                            image_error *error)
{
    reader r;
    image_status status;
    memset(&r, 0, sizeof r);
    add_layer(&r, out, request, error);
    for (unsigned i = 0; i < request->beside_count; i++)
        add_layer(&r, request->beside[i].out, &request->beside[i].request,
                  &request->beside[i].error);
    status = exr_file_read(&r.file, file, error);
    if (!status) {
        read_layers(&r);
        status = r.layers[0].status;
    }
    exr_file_close(&r.file);
    for (unsigned i = 0; i < r.count; i++) {
        if (i)
            request->beside[i - 1].status = status ? status : r.layers[i].status;
        if (status || r.layers[i].status)
            image_destroy(r.layers[i].out);
    }
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
