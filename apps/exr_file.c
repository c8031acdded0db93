#include "exr_file.h"

#if LULL_WITH_OPENEXR

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"

static exr_file *files; /* that are open, the newest first */

/* OpenEXR may hold the lock of a context that it writes to while it calls this, so that nothing can
 * be asked of the context. One that is not known yet is that of the newest file. */
static void on_error(exr_const_context_t context, exr_result_t code, const char *text)
{
    exr_file *file = files;
    (void)code;
    while (file && file->context && file->context != context)
        file = file->next;
    if (!file)
        return;
    platform_lock_enter(file->message_lock);
    if (!file->message[0]) {
        /* The name we gave is in front of most messages. */
        const char *colon = strstr(text, ": ");
        if (text[0] == '\'' && colon)
            text = colon + 2;
        snprintf(file->message, sizeof file->message, "%s", text);
    }
    platform_lock_leave(file->message_lock);
}

static int seek(exr_file *file, uint64_t offset)
{
    if (file->position == (int64_t)offset)
        return 1;
    file->position = (int64_t)offset;
    return offset <= INT64_MAX && !platform_seek(file->stream, (int64_t)offset);
}

static int64_t on_read(exr_const_context_t context, void *user, void *buffer, uint64_t size,
                       uint64_t offset, exr_stream_error_func_ptr_t error)
{
    exr_file *file = user;
    size_t n;
    (void)context;
    (void)error;
    if (!seek(file, offset))
        return -1;
    n = fread(buffer, 1, (size_t)size, file->stream);
    file->position += (int64_t)n;
    return (int64_t)n;
}

static int64_t on_size(exr_const_context_t context, void *user)
{
    (void)context;
    return platform_file_size(((exr_file *)user)->stream);
}

static int64_t on_write(exr_const_context_t context, void *user, const void *buffer, uint64_t size,
                        uint64_t offset, exr_stream_error_func_ptr_t error)
{
    exr_file *file = user;
    size_t n;
    (void)context;
    (void)error;
    if (platform_interrupted())
        return -1;
    if (!seek(file, offset)) {
        file->write_error = errno;
        return -1;
    }
    n = fwrite(buffer, 1, (size_t)size, file->stream);
    if (n < size)
        file->write_error = errno;
    file->position += (int64_t)n;
    return (int64_t)n;
}

static exr_context_initializer_t prepare(exr_file *file, FILE *stream)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    memset(file, 0, sizeof *file);
    file->stream = stream;
    file->position = -1;
    file->next = files;
    files = file;
    init.error_handler_fn = on_error;
    init.user_data = file;
    return init;
}

/* 1 for what OpenEXR says of files of a later one. */
static int is_of_later(const char *text)
{
    return strstr(text, "not yet implemented") ||
           strstr(text, "'compression' (type 'compression'): Invalid value");
}

image_status exr_file_read(exr_file *file, FILE *stream, image_error *error)
{
    exr_context_initializer_t init = prepare(file, stream);
    exr_result_t result;
    init.read_fn = on_read;
    init.size_fn = on_size;
    init.max_image_width = init.max_image_height = IMAGE_MAX_SIZE;
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    result = exr_start_read(&file->context, "file", &init);
    /* A compression that it does not know is told of, but taken for ZIP. */
    if (!result && is_of_later(file->message))
        result = EXR_ERR_FEATURE_NOT_IMPLEMENTED;
    return result ? exr_file_fail(file, result, IMAGE_ERROR_DATA, error) : IMAGE_OK;
}

image_status exr_file_write(exr_file *file, FILE *stream, image_error *error)
{
    exr_context_initializer_t init = prepare(file, stream);
    exr_result_t result;
    init.write_fn = on_write;
#if OPENEXR_VERSION_MAJOR * 10000 + OPENEXR_VERSION_MINOR * 100 + OPENEXR_VERSION_PATCH >= 30103
    init.zip_level = 4; /* as OpenEXR from 3.2 on: a fifth less time, 1 % more bytes than 6 */
#endif
    result = exr_start_write(&file->context, "file", EXR_WRITE_FILE_DIRECTLY, &init);
    return result ? exr_file_fail(file, result, IMAGE_ERROR_WRITE, error) : IMAGE_OK;
}

void exr_file_close(exr_file *file)
{
    exr_file **link = &files;
    if (file->context)
        exr_finish(&file->context);
    while (*link && *link != file)
        link = &(*link)->next;
    if (*link)
        *link = file->next;
    if (file->write_error)
        errno = file->write_error;
}

image_status exr_file_fail(const exr_file *file, exr_result_t result, image_status status,
                           image_error *error)
{
    const char *text = file->message[0] ? file->message : exr_get_default_error_message(result);
    if (result == EXR_ERR_OUT_OF_MEMORY)
        return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (result == EXR_ERR_FEATURE_NOT_IMPLEMENTED || is_of_later(text))
        return image_fail(error, IMAGE_ERROR_FORMAT, "not supported by this OpenEXR: %s", text);
    if (status == IMAGE_ERROR_DATA)
        return image_fail(error, status, "truncated or corrupt: %s", text);
    return image_fail(error, status, "OpenEXR: %s", text);
}

/* ---- Chunks ---------------------------------------------------------------------------------- */

exr_result_t exr_chunks_begin(exr_chunks *chunks, exr_context_t context, int part)
{
    exr_storage_t storage;
    exr_result_t result = exr_get_storage(context, part, &storage);
    int32_t lines = 0, columns = 0;

    memset(chunks, 0, sizeof *chunks);
    chunks->context = context;
    chunks->part = part;
    chunks->is_tiled = storage == EXR_STORAGE_TILED;
    if (!result)
        result = exr_get_data_window(context, part, &chunks->window);
    if (!result && chunks->is_tiled)
        result = exr_get_tile_sizes(context, part, 0, 0, &columns, &lines);
    else if (!result)
        result = exr_get_scanlines_per_chunk(context, part, &lines);
    if (!result && (lines < 1 || (chunks->is_tiled && columns < 1)))
        result = EXR_ERR_FILE_BAD_HEADER;
    chunks->lines = lines;
    chunks->columns = columns;
    chunks->next_y = chunks->is_tiled ? 0 : chunks->window.min.y;
    return result;
}

/* Moves to the next chunk; *is_end is 1 (and there is none) after the last. */
static exr_result_t next_chunk(exr_chunks *chunks, int *is_end)
{
    int width = chunks->window.max.x - chunks->window.min.x + 1;
    int height = chunks->window.max.y - chunks->window.min.y + 1;
    exr_result_t result;

    *is_end = 0;
    if (chunks->is_tiled) {
        int across = (width - 1) / chunks->columns + 1;
        if (chunks->next_x == across) {
            chunks->next_x = 0;
            chunks->next_y++;
        }
        chunks->x = chunks->next_x * chunks->columns;
        chunks->y = (int)((int64_t)chunks->next_y * chunks->lines < height
                              ? chunks->next_y * chunks->lines
                              : height);
        if (chunks->y == height) {
            *is_end = 1;
            return EXR_ERR_SUCCESS;
        }
        result = exr_read_tile_chunk_info(chunks->context, chunks->part, chunks->next_x,
                                          chunks->next_y, 0, 0, &chunks->info);
        chunks->next_x++;
    } else {
        if (chunks->next_y > chunks->window.max.y) {
            *is_end = 1;
            return EXR_ERR_SUCCESS;
        }
        result = exr_read_scanline_chunk_info(chunks->context, chunks->part, chunks->next_y,
                                              &chunks->info);
        chunks->x = 0;
        chunks->y = chunks->next_y - chunks->window.min.y;
        chunks->next_y += chunks->lines;
    }
    if (!result &&
        (chunks->info.width < 1 || chunks->info.height < 1 ||
         chunks->info.width > width - chunks->x || chunks->info.height > height - chunks->y))
        result = EXR_ERR_BAD_CHUNK_LEADER;
    return result;
}

int exr_chunks_count(const exr_chunks *chunks)
{
    int32_t count = 0;
    return exr_get_chunk_count(chunks->context, chunks->part, &count) ? 0 : (int)count;
}

/* ---- Threads --------------------------------------------------------------------------------- */

void exr_team_begin(exr_team *team, int threads, int chunks, exr_file *first, exr_file *second)
{
    memset(team, 0, sizeof *team);
    team->threads = ordered_threads(threads, chunks);
    team->files[0] = first;
    team->files[1] = second;
    if (team->threads > 1) {
        team->lock = platform_lock_new();
        team->message = platform_lock_new();
    }
    if (!team->lock || !team->message) {
        platform_lock_free(team->lock);
        team->lock = NULL;
        team->threads = 1;
    }
    team->slots = ordered_slots(team->threads);
    for (int i = 0; i < 2 && team->lock; i++)
        if (team->files[i])
            team->files[i]->message_lock = team->message;
}

void exr_team_end(exr_team *team)
{
    for (int i = 0; i < 2; i++)
        if (team->files[i])
            team->files[i]->message_lock = NULL;
    platform_lock_free(team->lock);
    platform_lock_free(team->message);
    memset(team, 0, sizeof *team);
}

/* ---- Decoding -------------------------------------------------------------------------------- */

static exr_result_t read_chunk(struct _exr_decode_pipeline *decode)
{
    exr_decoder *decoder = decode->decoding_user_data;
    exr_result_t result;
    platform_lock_enter(decoder->lock);
    result = decoder->library_read(decode);
    platform_lock_leave(decoder->lock);
    return result;
}

int exr_decoder_fit(exr_decoder *decoder, int channel, size_t bytes)
{
    unsigned char *more;
    if (bytes <= decoder->room[channel])
        return 1;
    more = realloc(decoder->planes[channel], bytes);
    if (!more)
        return 0;
    decoder->planes[channel] = more;
    decoder->room[channel] = bytes;
    return 1;
}

/* Where the channels of the current chunk go. */
static exr_result_t aim(exr_decoder *decoder)
{
    for (int c = 0; c < decoder->decode.channel_count; c++) {
        exr_coding_channel_info_t *channel = &decoder->decode.channels[c];
        size_t bytes = (size_t)channel->width * (size_t)channel->height *
                       (size_t)channel->bytes_per_element;
        channel->decode_to_ptr = NULL;
        if (!decoder->wanted[c] || !bytes)
            continue;
        if (!exr_decoder_fit(decoder, c, bytes))
            return EXR_ERR_OUT_OF_MEMORY;
        channel->decode_to_ptr = decoder->planes[c];
        channel->user_bytes_per_element = channel->bytes_per_element;
        channel->user_data_type = channel->data_type;
        channel->user_pixel_stride = channel->bytes_per_element;
        channel->user_line_stride = channel->width * channel->bytes_per_element;
    }
    return EXR_ERR_SUCCESS;
}

int exr_decoder_take(exr_decoder *decoder, exr_chunks *chunks)
{
    int is_end = 0;
    if (chunks->is_over)
        return 0;
    decoder->found = next_chunk(chunks, &is_end);
    decoder->chunks = *chunks;
    chunks->is_over = is_end || decoder->found;
    return !is_end;
}

exr_result_t exr_decode(exr_decoder *decoder)
{
    const exr_chunks *chunks = &decoder->chunks;
    exr_decode_pipeline_t *decode = &decoder->decode;
    exr_result_t result;
    if (decoder->found)
        return decoder->found;
    if (!decoder->planes)
        decoder->planes = calloc((size_t)decoder->channels, sizeof *decoder->planes);
    if (!decoder->room)
        decoder->room = calloc((size_t)decoder->channels, sizeof *decoder->room);
    if (!decoder->planes || !decoder->room)
        return EXR_ERR_OUT_OF_MEMORY;
    if (decoder->is_started)
        result = exr_decoding_update(chunks->context, chunks->part, &chunks->info, decode);
    else
        result = exr_decoding_initialize(chunks->context, chunks->part, &chunks->info, decode);
    if (result)
        return result;
    decoder->is_started = 1;
    result = aim(decoder);
    if (result)
        return result;
    platform_lock_enter(decoder->lock); /* OpenEXR asks what the CPU can do, once, into a static */
    result = exr_decoding_choose_default_routines(chunks->context, chunks->part, decode);
    platform_lock_leave(decoder->lock);
    if (result)
        return result;
    decoder->library_read = decode->read_fn;
    decode->read_fn = read_chunk;
    decode->decoding_user_data = decoder;
    /* What compression did not make smaller is stored as it is. OpenEXR 3.1 forgets it of B44. */
    if (chunks->info.packed_size == chunks->info.unpacked_size)
        decode->decompress_fn = NULL;
    return exr_decoding_run(chunks->context, chunks->part, decode);
}

exr_result_t exr_decode_again(exr_decoder *decoder, exr_result_t result, exr_file *file)
{
    exr_result_t again;
    file->message[0] = 0;
    again = exr_decode(decoder);
    return again ? again : result;
}

void exr_decoder_free(exr_decoder *decoder)
{
    if (decoder->is_started)
        exr_decoding_destroy(decoder->chunks.context, &decoder->decode);
    for (int c = 0; decoder->planes && c < decoder->channels; c++)
        free(decoder->planes[c]);
    free(decoder->planes);
    free(decoder->room);
}

/* ---- Encoding -------------------------------------------------------------------------------- */

/* Keeps an encoded chunk: its header, which tells the size, and its bytes. */
static exr_result_t keep_chunk(struct _exr_encode_pipeline *encode)
{
    exr_encoder *encoder = encode->encoding_user_data;
    exr_chunk_info_t info = encode->chunk;
    size_t size = sizeof info + encode->compressed_bytes;
    const void *bytes = encode->compressed_buffer;
    /* Readers take as many bytes as there are of pixels for the pixels themselves, but OpenEXR 3.1
     * leaves them compressed if that came to just as many. */
    if (encode->compressed_bytes == encode->packed_bytes)
        bytes = encode->packed_buffer;
    if (size > encoder->room - encoder->used) {
        unsigned char *more = realloc(encoder->done, encoder->used + size);
        if (!more)
            return EXR_ERR_OUT_OF_MEMORY;
        encoder->done = more;
        encoder->room = encoder->used + size;
    }
    info.packed_size = encode->compressed_bytes;
    memcpy(encoder->done + encoder->used, &info, sizeof info);
    if (encode->compressed_bytes) /* a line may have no pixels of subsampled channels */
        memcpy(encoder->done + encoder->used + sizeof info, bytes, encode->compressed_bytes);
    encoder->used += size;
    return EXR_ERR_SUCCESS;
}

exr_result_t exr_encoder_begin(exr_encoder *encoder, exr_context_t context, int part,
                               const exr_chunk_info_t *info)
{
    exr_result_t result = encoder->is_started
                              ? exr_encoding_update(context, part, info, &encoder->encode)
                              : exr_encoding_initialize(context, part, info, &encoder->encode);
    if (!result)
        encoder->is_started = 1;
    return result;
}

exr_result_t exr_encode(exr_encoder *encoder)
{
    exr_encode_pipeline_t *encode = &encoder->encode;
    exr_context_t context = (exr_context_t)(uintptr_t)encode->context;
    if (!encode->write_fn) {
        exr_result_t result = exr_encoding_choose_default_routines(context, encode->part_index,
                                                                   encode);
        if (result)
            return result;
        encode->encoding_user_data = encoder;
        encode->yield_until_ready_fn = NULL;
        encode->write_fn = keep_chunk;
    }
    return exr_encoding_run(context, encode->part_index, encode);
}

exr_result_t exr_encoder_write(exr_encoder *encoder)
{
    exr_context_t context = (exr_context_t)(uintptr_t)encoder->encode.context;
    int part = encoder->encode.part_index;
    exr_result_t result = EXR_ERR_SUCCESS;
    for (size_t at = 0; at < encoder->used && !result;) {
        exr_chunk_info_t info;
        const unsigned char *bytes = encoder->done + at + sizeof info;
        memcpy(&info, encoder->done + at, sizeof info);
        if (info.type == EXR_STORAGE_TILED)
            result = exr_write_tile_chunk(context, part, info.start_x, info.start_y, info.level_x,
                                          info.level_y, bytes, info.packed_size);
        else
            result = exr_write_scanline_chunk(context, part, info.start_y, bytes,
                                              info.packed_size);
        at += sizeof info + (size_t)info.packed_size;
    }
    encoder->used = 0;
    return result;
}

void exr_encoder_free(exr_encoder *encoder)
{
    if (encoder->is_started)
        exr_encoding_destroy(encoder->encode.context, &encoder->encode);
    free(encoder->done);
}

#else
typedef int exr_file_is_not_built; /* ISO C wants something in a source file */
#endif
