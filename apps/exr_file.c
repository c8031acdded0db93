#include "exr_file.h"

#if LULL_WITH_OPENEXR

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
    if (file && !file->message[0]) {
        /* The name we gave is in front of most messages. */
        const char *colon = strstr(text, ": ");
        if (text[0] == '\'' && colon)
            text = colon + 2;
        snprintf(file->message, sizeof file->message, "%s", text);
    }
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
    if (platform_interrupted() || !seek(file, offset))
        return -1;
    n = fwrite(buffer, 1, (size_t)size, file->stream);
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

image_status exr_file_read(exr_file *file, FILE *stream, image_error *error)
{
    exr_context_initializer_t init = prepare(file, stream);
    exr_result_t result;
    init.read_fn = on_read;
    init.size_fn = on_size;
    init.max_image_width = init.max_image_height = IMAGE_MAX_SIZE;
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    result = exr_start_read(&file->context, "file", &init);
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
}

image_status exr_file_fail(const exr_file *file, exr_result_t result, image_status status,
                           image_error *error)
{
    const char *text = file->message[0] ? file->message : exr_get_default_error_message(result);
    if (result == EXR_ERR_OUT_OF_MEMORY)
        return image_fail(error, IMAGE_ERROR_MEMORY, "not enough memory");
    if (result == EXR_ERR_FEATURE_NOT_IMPLEMENTED || strstr(text, "not yet implemented") ||
        strstr(text, "'compression' (type 'compression'): Invalid value")) /* of a later one */
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

exr_result_t exr_chunks_next(exr_chunks *chunks, int *is_end)
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

exr_result_t exr_decode_planes(const exr_chunks *chunks, exr_decode_pipeline_t *decode,
                               int *is_started, const unsigned char *wanted, unsigned char **planes,
                               size_t *room)
{
    exr_result_t result;
    if (*is_started)
        result = exr_decoding_update(chunks->context, chunks->part, &chunks->info, decode);
    else
        result = exr_decoding_initialize(chunks->context, chunks->part, &chunks->info, decode);
    if (result)
        return result;
    *is_started = 1;
    for (int c = 0; c < decode->channel_count; c++) {
        exr_coding_channel_info_t *channel = &decode->channels[c];
        size_t bytes = (size_t)channel->width * (size_t)channel->height *
                       (size_t)channel->bytes_per_element;
        channel->decode_to_ptr = NULL;
        if (!wanted[c] || !bytes)
            continue;
        if (bytes > room[c]) {
            unsigned char *more = realloc(planes[c], bytes);
            if (!more)
                return EXR_ERR_OUT_OF_MEMORY;
            planes[c] = more;
            room[c] = bytes;
        }
        channel->decode_to_ptr = planes[c];
        channel->user_bytes_per_element = channel->bytes_per_element;
        channel->user_data_type = channel->data_type;
        channel->user_pixel_stride = channel->bytes_per_element;
        channel->user_line_stride = channel->width * channel->bytes_per_element;
    }
    result = exr_decoding_choose_default_routines(chunks->context, chunks->part, decode);
    /* What compression did not make smaller is stored as it is. OpenEXR 3.1 forgets it of B44. */
    if (chunks->info.packed_size == chunks->info.unpacked_size)
        decode->decompress_fn = NULL;
    return result ? result : exr_decoding_run(chunks->context, chunks->part, decode);
}

/* What goes on writing after write_chunk. */
static exr_result_t (*library_write)(struct _exr_encode_pipeline *);

/* Readers take as many bytes as there are of pixels for the pixels themselves, but OpenEXR 3.1
 * leaves them compressed if that came to just as many. */
static exr_result_t write_chunk(struct _exr_encode_pipeline *encode)
{
    if (encode->compressed_bytes == encode->packed_bytes &&
        encode->compressed_buffer != encode->packed_buffer)
        memcpy(encode->compressed_buffer, encode->packed_buffer, encode->compressed_bytes);
    return library_write(encode);
}

exr_result_t exr_encode(exr_context_t context, int part, exr_encode_pipeline_t *encode,
                        int is_first)
{
    exr_result_t result =
        is_first ? exr_encoding_choose_default_routines(context, part, encode) : EXR_ERR_SUCCESS;
    if (is_first && !result) {
        library_write = encode->write_fn;
        encode->write_fn = write_chunk;
    }
    return result ? result : exr_encoding_run(context, part, encode);
}

#else
typedef int exr_file_is_not_built; /* ISO C wants something in a source file */
#endif
