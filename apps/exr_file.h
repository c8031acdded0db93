/* OpenEXRCore over a stdio stream, for imageio_exr.c and exr_keep.c. Only with LULL_WITH_OPENEXR.
 *
 * Chunks are coded by several threads: ordered.h runs them, exr_team says how many, exr_decoder and
 * exr_encoder are what each slot has of its own. What reads or writes the stream, or asks for the
 * next chunk, is done under the team's lock. */
#ifndef LULL_APPS_EXR_FILE_H
#define LULL_APPS_EXR_FILE_H

#include "imageio.h"

#if LULL_WITH_OPENEXR

#include <openexr.h>

#include "ordered.h"

/* An open file. Initialise with exr_file_read or exr_file_write, end with exr_file_close. The
 * struct must not move in between: OpenEXR holds its address. Not for several threads, but as a
 * team. */
typedef struct exr_file {
    exr_context_t context;
    FILE *stream;
    int64_t position;  /* of the stream; saves seeks */
    int write_error;   /* errno of it, which each thread has its own of; exr_file_close sets it */
    char message[200]; /* first thing that OpenEXR said */
    platform_lock *message_lock; /* NULL: one thread */
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
    exr_chunk_info_t info;   /* the chunk */
    int x, y;                /* its first pixel, from the window's corner */
    int is_over;             /* no more are taken */
} exr_chunks;

exr_result_t exr_chunks_begin(exr_chunks *chunks, exr_context_t context, int part);

/* Chunks of the part, or a few more where a tiled one has several levels. */
int exr_chunks_count(const exr_chunks *chunks);

/* The threads that code the chunks of one part, and what keeps them apart. End it before the files
 * are closed. */
typedef struct exr_team {
    unsigned threads, slots;
    platform_lock *lock;    /* of the streams; NULL: one thread */
    platform_lock *message; /* of what OpenEXR says */
    exr_file *files[2];
} exr_team;

/* `threads`: 0 for as many as there are processors. `second` may be NULL. */
void exr_team_begin(exr_team *team, int threads, int chunks, exr_file *first, exr_file *second);
void exr_team_end(exr_team *team);

/* Decodes chunks, one at a time. A zeroed struct with `wanted` set, which is not the decoder's:
 * wanted[c] is 1 for the channels to be decoded, of `channels`. */
typedef struct exr_decoder {
    exr_chunks chunks;  /* the current chunk, */
    exr_result_t found; /* and whether the file has it */
    int channels;
    const unsigned char *wanted;
    platform_lock *lock;    /* of the stream, for decoding outside of it; NULL: none */
    unsigned char **planes; /* [channels] what was decoded, tightly packed in its own type; NULL */
    size_t *room;           /* bytes there */
    exr_decode_pipeline_t decode;
    int is_started;
    exr_result_t (*library_read)(struct _exr_decode_pipeline *);
} exr_decoder;

/* Takes the next chunk, also one that the file lacks; 0: there is none, or one failed before. */
int exr_decoder_take(exr_decoder *decoder, exr_chunks *chunks);

/* Decodes the current chunk into the planes; `found` if that is an error. */
exr_result_t exr_decode(exr_decoder *decoder);

/* Makes room in a plane; 0 if there is no memory. */
int exr_decoder_fit(exr_decoder *decoder, int channel, size_t bytes);
void exr_decoder_free(exr_decoder *decoder);

/* For a chunk whose decoding failed among others, when these are done: decodes it alone, so that
 * the file's message is that of this failure. Returns the result to tell of. */
exr_result_t exr_decode_again(exr_decoder *decoder, exr_result_t result, exr_file *file);

/* Encodes chunks and keeps them until they are written. Begins zeroed. */
typedef struct exr_encoder {
    exr_encode_pipeline_t encode;
    int is_started;
    unsigned char *done; /* headers and bytes of the chunks to be written */
    size_t used, room;
} exr_encoder;

/* Points the pipeline at a chunk, whose channels are then told where their pixels are. */
exr_result_t exr_encoder_begin(exr_encoder *encoder, exr_context_t context, int part,
                               const exr_chunk_info_t *info);
exr_result_t exr_encode(exr_encoder *encoder);

/* Writes what was encoded since the last call; under the lock, in the order of the file. */
exr_result_t exr_encoder_write(exr_encoder *encoder);
void exr_encoder_free(exr_encoder *encoder);

#endif
#endif
