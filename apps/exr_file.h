/* OpenEXRCore over a stdio stream, for imageio_exr.c and exr_keep.c. Only with LULL_WITH_OPENEXR.
 */
#ifndef LULL_APPS_EXR_FILE_H
#define LULL_APPS_EXR_FILE_H

#include "imageio.h"

#if LULL_WITH_OPENEXR

#include <openexr.h>

/* An open file. Initialise with exr_file_read or exr_file_write, end with exr_file_close. The
 * struct must not move in between: OpenEXR holds its address. Not for several threads. */
typedef struct exr_file {
    exr_context_t context;
    FILE *stream;
    int64_t position;  /* of the stream; saves seeks */
    char message[200]; /* first thing that OpenEXR said */
    struct exr_file *next; /* open before it */
} exr_file;

image_status exr_file_read(exr_file *file, FILE *stream, image_error *error);
image_status exr_file_write(exr_file *file, FILE *stream, image_error *error);
void exr_file_close(exr_file *file);

/* Turns what OpenEXR returned and said into an error of this status (FORMAT if it lacks the
 * feature). */
image_status exr_file_fail(const exr_file *file, exr_result_t result, image_status status,
                           image_error *error);

/* One chunk (a few scan lines, or a tile of the full-resolution level) after the other. */
typedef struct exr_chunks {
    exr_context_t context;
    int part;
    int is_tiled;
    exr_attr_box2i_t window; /* data window */
    int lines;               /* scan lines in a chunk, or rows in a tile */
    int columns;             /* of a tile */
    int next_x, next_y;      /* tile, or first scan line, of the next chunk */
    exr_chunk_info_t info;   /* the chunk, after exr_chunks_next */
    int x, y;                /* its first pixel, from the window's corner */
} exr_chunks;

exr_result_t exr_chunks_begin(exr_chunks *chunks, exr_context_t context, int part);

/* Moves to the next chunk; *is_end is 1 (and there is none) after the last. */
exr_result_t exr_chunks_next(exr_chunks *chunks, int *is_end);

/* Decodes the current chunk. planes[c]: where channel c goes, tightly packed in its own type, or
 * NULL; `room[c]` are the bytes there and grow as needed (malloc, realloc). wanted[c]: 0 skips the
 * channel. */
exr_result_t exr_decode_planes(const exr_chunks *chunks, exr_decode_pipeline_t *decode,
                               int *is_started, const unsigned char *wanted, unsigned char **planes,
                               size_t *room);

/* Encodes and writes a chunk whose channels know where their pixels are. */
exr_result_t exr_encode(exr_context_t context, int part, exr_encode_pipeline_t *encode,
                        int is_first);

#endif
#endif
