/* Numbered files: "frame.####.exr" or "frame.%04d.exr" for each number of a list such as 1-240 or
 * 1,5,10-20x2. */
#ifndef LULL_APPS_SEQUENCE_H
#define LULL_APPS_SEQUENCE_H

#include <stddef.h>

#define SEQUENCE_MAX 1000000 /* frames */
#define SEQUENCE_NONE (-1)   /* number of an image that belongs to no sequence */

typedef struct sequence {
    int *frames; /* malloc */
    size_t count;
} sequence;

/* 0, or -1 if the text is malformed, too long, or memory runs out. */
int sequence_parse(sequence *s, const char *text);
void sequence_free(sequence *s);

/* 1 if the path has a place for a number in its last component. */
int sequence_is_pattern(const char *path);

/* The path of a frame (malloc; NULL without memory). Paths without a place for a number, and those
 * of SEQUENCE_NONE, are copied. */
char *sequence_path(const char *pattern, int frame);

#endif
