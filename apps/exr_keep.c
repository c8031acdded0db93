#include "exr_keep.h"

#include "exr_file.h"

#if LULL_WITH_OPENEXR

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "half.h"

#define MOST_IMAGES (1 + IMAGE_MAX_ALSO)

/* A part of the file in which images take the place of channels. */
typedef struct changed_part {
    int part;
    exr_chunks chunks; /* in the source */
    int channels;
    unsigned char *wanted; /* [channels] 1: copied */
    int *replaced;         /* [channels] of what is not: the image, times 3, plus its channel; -1 */
} changed_part;

typedef struct keeper {
    exr_file in, out;
    const image *images[MOST_IMAGES];
    unsigned count;
    changed_part changed[MOST_IMAGES];
    unsigned changed_count;
    changed_part *now;    /* the one that is being copied */
    exr_result_t failure; /* of the first chunk that failed: */
    exr_file *culprit;    /* the file, */
    exr_decoder *failed;  /* and whose it is, if in decoding */
} keeper;

/* A chunk on its way. */
typedef struct keep_slot {
    exr_decoder decoder;
    exr_encoder encoder;
    exr_result_t result;
    int is_decoded;
} keep_slot;

static void keeper_free(keeper *k)
{
    for (unsigned i = 0; i < k->changed_count; i++) {
        free(k->changed[i].wanted);
        free(k->changed[i].replaced);
    }
    exr_file_close(&k->in);
    exr_file_close(&k->out);
}

static changed_part *find_changed(keeper *k, int part)
{
    for (unsigned i = 0; i < k->changed_count; i++)
        if (k->changed[i].part == part)
            return &k->changed[i];
    return NULL;
}

/* Looks at a part in which something will change. */
static image_status begin_part(keeper *k, int part, int channels, image_error *error)
{
    changed_part *p = &k->changed[k->changed_count++];
    exr_result_t result = exr_chunks_begin(&p->chunks, k->in.context, part);

    if (result)
        return exr_file_fail(&k->in, result, IMAGE_ERROR_WRITE, error);
    p->part = part;
    p->channels = channels;
    p->wanted = calloc((size_t)p->channels, sizeof *p->wanted);
    p->replaced = calloc((size_t)p->channels, sizeof *p->replaced);
    if (!p->wanted || !p->replaced)
        return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (int c = 0; c < p->channels; c++) {
        p->wanted[c] = 1;
        p->replaced[c] = -1;
    }
    return IMAGE_OK;
}

/* Finds an image's channels in the source; fails if the file is no longer the one that was read. */
static image_status match_channels(keeper *k, unsigned index, image_error *error)
{
    const image *img = k->images[index];
    changed_part *p = find_changed(k, img->part);
    const exr_attr_chlist_t *list;
    unsigned found = 0;
    exr_result_t result = exr_get_channels(k->in.context, img->part, &list);

    if (result)
        return exr_file_fail(&k->in, result, IMAGE_ERROR_WRITE, error);
    if (!p) {
        image_status status = begin_part(k, img->part, list->num_channels, error);
        if (status)
            return status;
        p = find_changed(k, img->part);
    }
    for (int c = 0; c < p->channels; c++)
        for (unsigned i = 0; i < img->channels; i++)
            if (!strcmp(list->entries[c].name.str, img->names[i])) {
                p->replaced[c] = (int)(index * 3 + i);
                p->wanted[c] = 0;
                found++;
            }
    if (found != img->channels ||
        (size_t)(p->chunks.window.max.x - p->chunks.window.min.x + 1) != img->width ||
        (size_t)(p->chunks.window.max.y - p->chunks.window.min.y + 1) != img->height)
        return image_fail(error, IMAGE_ERROR_WRITE,
                          "the input file changed while it was being denoised");
    return IMAGE_OK;
}

/* ---- Headers --------------------------------------------------------------------------------- */

/* 1 if decoding and encoding again with this compression gives the same values. */
static int is_lossless(exr_compression_t compression)
{
    return compression == EXR_COMPRESSION_NONE || compression == EXR_COMPRESSION_RLE ||
           compression == EXR_COMPRESSION_ZIPS || compression == EXR_COMPRESSION_ZIP ||
           compression == EXR_COMPRESSION_PIZ;
}

static exr_pixel_type_t type_of(const image *img)
{
    return img->type == IMAGE_HALF ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
}

static exr_result_t set_channels(keeper *k, const changed_part *p)
{
    const exr_attr_chlist_t *list;
    exr_result_t result = exr_get_channels(k->in.context, p->part, &list);
    for (int c = 0; c < list->num_channels && !result; c++) {
        const exr_attr_chlist_entry_t *e = &list->entries[c];
        result = exr_add_channel(
            k->out.context, p->part, e->name.str,
            p->wanted[c] ? e->pixel_type : type_of(k->images[p->replaced[c] / 3]),
            e->p_linear ? EXR_PERCEPTUALLY_LINEAR : EXR_PERCEPTUALLY_LOGARITHMIC, e->x_sampling,
            e->y_sampling);
    }
    return result;
}

/* What of the changed part's header differs from the source's; the rest is copied afterwards. */
static exr_result_t change_header(keeper *k, const changed_part *p)
{
    const int part = p->part;
    exr_compression_t compression;
    uint32_t tile_w, tile_h;
    exr_tile_level_mode_t level;
    exr_tile_round_mode_t round;
    exr_result_t result = exr_get_compression(k->in.context, part, &compression);
    if (!result)
        result = exr_set_compression(k->out.context, part,
                                     is_lossless(compression) ? compression : EXR_COMPRESSION_ZIP);
    if (!result)
        result = exr_set_lineorder(k->out.context, part, EXR_LINEORDER_INCREASING_Y);
    if (!result && p->chunks.is_tiled) {
        result = exr_get_tile_descriptor(k->in.context, part, &tile_w, &tile_h, &level, &round);
        if (!result)
            result = exr_set_tile_descriptor(k->out.context, part, tile_w, tile_h,
                                             EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN);
    }
    return result ? result : set_channels(k, p);
}

/* Attribute and channel names over 31 bytes need a flag in the file. */
static int has_long_names(exr_context_t context, int parts)
{
    for (int part = 0; part < parts; part++) {
        const exr_attr_chlist_t *list;
        int32_t count = 0;
        exr_get_attribute_count(context, part, &count);
        for (int32_t i = 0; i < count; i++) {
            const exr_attribute_t *attribute;
            if (!exr_get_attribute_by_index(context, part, EXR_ATTR_LIST_FILE_ORDER, i,
                                            &attribute) &&
                (strlen(attribute->name) > 31 || strlen(attribute->type_name) > 31))
                return 1;
        }
        if (!exr_get_channels(context, part, &list))
            for (int c = 0; c < list->num_channels; c++)
                if (strlen(list->entries[c].name.str) > 31)
                    return 1;
    }
    return 0;
}

/* Copies the attributes of types that OpenEXR does not know, whose bytes exr_copy_unset_attributes
 * refuses (in 3.1). They stay the source's. */
static exr_result_t copy_opaque(keeper *k, int part)
{
    int32_t count = 0;
    exr_result_t result = exr_get_attribute_count(k->in.context, part, &count);
    for (int32_t i = 0; i < count && !result; i++) {
        const exr_attribute_t *from;
        exr_attribute_t *to;
        result = exr_get_attribute_by_index(k->in.context, part, EXR_ATTR_LIST_FILE_ORDER, i,
                                            &from);
        if (result || from->type != EXR_ATTR_OPAQUE)
            continue;
        result = exr_attr_declare_by_type(k->out.context, part, from->name, from->type_name, &to);
        if (!result) {
            to->opaque->size = from->opaque->size;
            to->opaque->packed_data = from->opaque->packed_data;
        }
    }
    return result;
}

static exr_result_t write_headers(keeper *k, int parts)
{
    exr_result_t result = EXR_ERR_SUCCESS;
    if (has_long_names(k->in.context, parts))
        result = exr_set_longname_support(k->out.context, 1);
    for (int part = 0; part < parts && !result; part++) {
        const changed_part *changed = find_changed(k, part);
        const char *name = NULL;
        exr_storage_t storage;
        int added;
        result = exr_get_storage(k->in.context, part, &storage);
        if (parts == 1 || exr_get_name(k->in.context, part, &name))
            name = NULL;
        if (!result)
            result = exr_add_part(k->out.context, name, storage, &added);
        if (!result && changed)
            result = change_header(k, changed);
        if (!result)
            result = copy_opaque(k, part);
        if (!result)
            result = exr_copy_unset_attributes(k->out.context, part, k->in.context, part);
    }
    return result ? result : exr_write_header(k->out.context);
}

/* ---- Parts copied as they are ---------------------------------------------------------------- */

/* A buffer that grows. */
typedef struct bytes {
    void *data;
    size_t size;
} bytes;

static int bytes_fit(bytes *b, uint64_t size)
{
    void *more;
    if (size <= b->size && b->data)
        return 1;
    more = realloc(b->data, (size_t)size + 1);
    if (!more)
        return 0;
    b->data = more;
    b->size = (size_t)size;
    return 1;
}

static exr_result_t copy_chunk(keeper *k, int part, const exr_chunk_info_t *info, bytes *packed,
                               bytes *samples)
{
    int is_deep = info->type == EXR_STORAGE_DEEP_SCANLINE || info->type == EXR_STORAGE_DEEP_TILED;
    exr_result_t result;
    if (!bytes_fit(packed, info->packed_size) || !bytes_fit(samples, info->sample_count_table_size))
        return EXR_ERR_OUT_OF_MEMORY;
    if (is_deep)
        result = exr_read_deep_chunk(k->in.context, part, info, packed->data, samples->data);
    else
        result = exr_read_chunk(k->in.context, part, info, packed->data);
    if (result)
        return result;
    switch (info->type) {
    case EXR_STORAGE_SCANLINE:
        return exr_write_scanline_chunk(k->out.context, part, info->start_y, packed->data,
                                        info->packed_size);
    case EXR_STORAGE_TILED:
        return exr_write_tile_chunk(k->out.context, part, info->start_x, info->start_y,
                                    info->level_x, info->level_y, packed->data, info->packed_size);
    case EXR_STORAGE_DEEP_SCANLINE:
        return exr_write_deep_scanline_chunk(k->out.context, part, info->start_y, packed->data,
                                             info->packed_size, info->unpacked_size, samples->data,
                                             info->sample_count_table_size);
    default:
        return exr_write_deep_tile_chunk(k->out.context, part, info->start_x, info->start_y,
                                         info->level_x, info->level_y, packed->data,
                                         info->packed_size, info->unpacked_size, samples->data,
                                         info->sample_count_table_size);
    }
}

static exr_result_t copy_tile_level(keeper *k, int part, int lx, int ly, bytes *packed,
                                    bytes *samples)
{
    int32_t width, height, tile_w, tile_h;
    exr_chunk_info_t info;
    exr_result_t result = exr_get_level_sizes(k->in.context, part, lx, ly, &width, &height);
    if (!result)
        result = exr_get_tile_sizes(k->in.context, part, lx, ly, &tile_w, &tile_h);
    for (int32_t y = 0; !result && y * (int64_t)tile_h < height; y++)
        for (int32_t x = 0; !result && x * (int64_t)tile_w < width; x++) {
            result = exr_read_tile_chunk_info(k->in.context, part, x, y, lx, ly, &info);
            if (!result)
                result = copy_chunk(k, part, &info, packed, samples);
        }
    return result;
}

static exr_result_t copy_tiles(keeper *k, int part, bytes *packed, bytes *samples)
{
    uint32_t tile_w, tile_h;
    int32_t nx = 1, ny = 1;
    exr_tile_level_mode_t level;
    exr_tile_round_mode_t round;
    exr_result_t result = exr_get_tile_descriptor(k->in.context, part, &tile_w, &tile_h, &level,
                                                  &round);
    if (!result)
        result = exr_get_tile_levels(k->in.context, part, &nx, &ny);
    if (!result && level != EXR_TILE_RIPMAP_LEVELS) {
        for (int l = 0; l < nx && !result; l++)
            result = copy_tile_level(k, part, l, l, packed, samples);
        return result;
    }
    for (int ly = 0; ly < ny && !result; ly++)
        for (int lx = 0; lx < nx && !result; lx++)
            result = copy_tile_level(k, part, lx, ly, packed, samples);
    return result;
}

static exr_result_t copy_lines(keeper *k, int part, bytes *packed, bytes *samples)
{
    exr_attr_box2i_t window;
    int32_t lines = 1;
    exr_chunk_info_t info;
    exr_result_t result = exr_get_data_window(k->in.context, part, &window);
    if (!result)
        result = exr_get_scanlines_per_chunk(k->in.context, part, &lines);
    for (int64_t y = window.min.y; !result && y <= window.max.y; y += lines) {
        result = exr_read_scanline_chunk_info(k->in.context, part, (int)y, &info);
        if (!result)
            result = copy_chunk(k, part, &info, packed, samples);
    }
    return result;
}

static exr_result_t copy_part(keeper *k, int part)
{
    bytes packed = {NULL, 0}, samples = {NULL, 0};
    exr_storage_t storage;
    exr_result_t result = exr_get_storage(k->in.context, part, &storage);
    if (!result && (storage == EXR_STORAGE_TILED || storage == EXR_STORAGE_DEEP_TILED))
        result = copy_tiles(k, part, &packed, &samples);
    else if (!result)
        result = copy_lines(k, part, &packed, &samples);
    free(packed.data);
    free(samples.data);
    return result;
}

/* ---- Changed parts --------------------------------------------------------------------------- */

/* Writes the images' pixels of a chunk into the planes of the channels that they replace. */
static exr_result_t replace_planes(const keeper *k, exr_decoder *decoder)
{
    const changed_part *p = k->now;
    const exr_chunks *chunks = &decoder->chunks;
    size_t w = (size_t)chunks->info.width, h = (size_t)chunks->info.height;
    for (int c = 0; c < p->channels; c++) {
        const image *img;
        size_t step;
        if (p->wanted[c])
            continue;
        img = k->images[p->replaced[c] / 3];
        step = img->type == IMAGE_HALF ? 2 : 4;
        if (!exr_decoder_fit(decoder, c, w * h * step))
            return EXR_ERR_OUT_OF_MEMORY;
        for (size_t i = 0; i < w * h; i++) {
            size_t pixel = ((size_t)chunks->y + i / w) * img->width + (size_t)chunks->x + i % w;
            size_t at = pixel * img->channels + (size_t)(p->replaced[c] % 3);
            memcpy(decoder->planes[c] + i * step, (const unsigned char *)img->pixels + at * step,
                   step);
        }
    }
    return EXR_ERR_SUCCESS;
}

/* Encodes one chunk of the output. skipped: lines of the decoded chunk above it. */
static exr_result_t encode_chunk(keeper *k, keep_slot *s, const exr_chunk_info_t *info, int skipped)
{
    exr_result_t result = exr_encoder_begin(&s->encoder, k->out.context, k->now->part, info);
    for (int c = 0; c < k->now->channels && !result; c++) {
        exr_coding_channel_info_t *channel = &s->encoder.encode.channels[c];
        unsigned char *plane = s->decoder.planes[c];
        size_t line = (size_t)channel->width * (size_t)channel->bytes_per_element;
        channel->user_bytes_per_element = channel->bytes_per_element;
        channel->user_data_type = channel->data_type;
        channel->user_pixel_stride = channel->bytes_per_element;
        channel->user_line_stride = (int32_t)line;
        channel->encode_from_ptr = plane;
        if (skipped && plane)
            channel->encode_from_ptr += (size_t)(skipped / channel->y_samples) * line;
    }
    return result ? result : exr_encode(&s->encoder);
}

/* Encodes the decoded chunk: one output chunk, or several if the output's compression takes fewer
 * lines. */
static exr_result_t encode_chunks(keeper *k, keep_slot *s)
{
    const exr_chunks *chunks = &s->decoder.chunks;
    exr_chunk_info_t info;
    int part = k->now->part, done = 0;
    exr_result_t result = EXR_ERR_SUCCESS;
    if (chunks->is_tiled) {
        result = exr_write_tile_chunk_info(k->out.context, part, chunks->info.start_x,
                                           chunks->info.start_y, 0, 0, &info);
        return result ? result : encode_chunk(k, s, &info, 0);
    }
    while (done < chunks->info.height && !result) {
        int y = chunks->window.min.y + chunks->y + done;
        result = exr_write_scanline_chunk_info(k->out.context, part, y, &info);
        if (!result)
            result = encode_chunk(k, s, &info, done);
        done += info.height;
    }
    return result;
}

static int take_chunk(void *user, void *slot)
{
    keeper *k = user;
    keep_slot *s = slot;
    return exr_decoder_take(&s->decoder, &k->now->chunks);
}

static void change_chunk(void *user, void *slot)
{
    keep_slot *s = slot;
    s->result = exr_decode(&s->decoder);
    s->is_decoded = !s->result;
    if (!s->result)
        s->result = replace_planes(user, &s->decoder);
    if (!s->result)
        s->result = encode_chunks(user, s);
}

static int put_chunk(void *user, void *slot)
{
    keeper *k = user;
    keep_slot *s = slot;
    k->failure = s->result ? s->result : exr_encoder_write(&s->encoder);
    k->culprit = s->is_decoded ? &k->out : &k->in;
    k->failed = k->failure && !s->decoder.found && !s->is_decoded ? &s->decoder : NULL;
    return !k->failure;
}

static image_status change_part(keeper *k, int threads, image_error *error)
{
    const ordered_work work = {k, take_chunk, change_chunk, put_chunk};
    image_status status = IMAGE_OK;
    exr_team team;
    keep_slot *slots;
    exr_team_begin(&team, threads, exr_chunks_count(&k->now->chunks), &k->in, &k->out);
    slots = calloc(team.slots, sizeof *slots);
    if (!slots)
        status = image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    for (unsigned i = 0; slots && i < team.slots; i++) {
        slots[i].decoder.channels = k->now->channels;
        slots[i].decoder.wanted = k->now->wanted;
        slots[i].decoder.lock = team.lock;
    }
    if (slots)
        ordered_run(&work, slots, sizeof *slots, team.threads, team.lock);
    if (k->failed && team.lock)
        k->failure = exr_decode_again(k->failed, k->failure, &k->in);
    if (k->failure)
        status = exr_file_fail(k->culprit, k->failure, IMAGE_ERROR_WRITE, error);
    for (unsigned i = 0; slots && i < team.slots; i++) {
        exr_decoder_free(&slots[i].decoder);
        exr_encoder_free(&slots[i].encoder);
    }
    free(slots);
    exr_team_end(&team);
    return status;
}

static image_status copy_all(keeper *k, int threads, image_error *error)
{
    int parts = 0;
    exr_result_t result = exr_get_count(k->in.context, &parts);
    image_status status = IMAGE_OK;
    if (!result)
        result = write_headers(k, parts);
    for (int part = 0; part < parts && !result && !status; part++) {
        k->now = find_changed(k, part);
        if (k->now)
            status = change_part(k, threads, error);
        else
            result = copy_part(k, part);
    }
    if (result)
        status = exr_file_fail(k->out.message[0] ? &k->out : &k->in, result, IMAGE_ERROR_WRITE,
                               error);
    return status;
}

image_status exr_keep_write(FILE *stream, const image *img, const image_target *target,
                            image_error *error)
{
    const char *path = target->keep_layers;
    keeper k;
    image_status status;
    FILE *source = fopen(path, "rb");

    if (!source)
        return image_fail(error, IMAGE_ERROR_WRITE, "cannot copy the layers of '%.100s': %s", path,
                          strerror(errno));
    memset(&k, 0, sizeof k);
    k.images[k.count++] = img;
    for (unsigned i = 0; i < target->also_count; i++)
        k.images[k.count++] = target->also[i];
    status = exr_file_read(&k.in, source, error);
    for (unsigned i = 0; i < k.count && !status; i++)
        status = match_channels(&k, i, error);
    if (!status)
        status = exr_file_write(&k.out, stream, error);
    if (!status)
        status = copy_all(&k, target->threads, error);
    keeper_free(&k);
    fclose(source);
    return status;
}

#else
typedef int exr_keep_is_not_built; /* ISO C wants something in a source file */
#endif
