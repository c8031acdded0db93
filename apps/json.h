/* Writes one JSON object into memory. */
#ifndef LULL_APPS_JSON_H
#define LULL_APPS_JSON_H

#include <stddef.h>
#include <stdio.h>

typedef struct json {
    char *text; /* malloc; NULL if nothing was written or memory ran out */
    size_t size, room;
    int needs_comma, has_failed;
} json;

/* Each takes the member's key, or NULL inside arrays. Text must be UTF-8; invalid bytes become '?'.
 */
void json_open(json *j, const char *key, char bracket); /* '{' or '[' */
void json_close(json *j, char bracket);
void json_text(json *j, const char *key, const char *value);
void json_number(json *j, const char *key, double value); /* non-finite: null */
void json_bool(json *j, const char *key, int value);

/* Prints the text and a newline to a stream and frees it. 0, or -1 if that failed. */
int json_print(json *j, FILE *stream);

#endif
