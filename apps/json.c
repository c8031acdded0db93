#include "json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void append(json *j, const char *bytes, size_t n)
{
    if (j->has_failed)
        return;
    if (j->size + n + 1 > j->room) {
        size_t room = 2 * (j->size + n + 64);
        char *more = realloc(j->text, room);
        if (!more) {
            j->has_failed = 1;
            return;
        }
        j->text = more;
        j->room = room;
    }
    memcpy(j->text + j->size, bytes, n);
    j->size += n;
    j->text[j->size] = 0;
}

/* Bytes of the valid UTF-8 character at s, 0 if it is none: one in more bytes than it needs, half
 * of a pair, or beyond U+10FFFF. */
static size_t utf8_length(const unsigned char *s)
{
    size_t n = s[0] < 0x80 ? 1 : s[0] >= 0xc2 && s[0] < 0xe0 ? 2 : (s[0] & 0xf0) == 0xe0 ? 3 : 0;
    if (s[0] >= 0xf0 && s[0] < 0xf5)
        n = 4;
    for (size_t i = 1; i < n; i++)
        if ((s[i] & 0xc0) != 0x80)
            return 0;
    if ((s[0] == 0xe0 && s[1] < 0xa0) || (s[0] == 0xed && s[1] >= 0xa0) ||
        (s[0] == 0xf0 && s[1] < 0x90) || (s[0] == 0xf4 && s[1] >= 0x90))
        return 0;
    return n;
}

static void append_string(json *j, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;
    append(j, "\"", 1);
    while (*s) {
        size_t n = utf8_length(s);
        char escaped[8];
        if (!n) {
            append(j, "?", 1);
            n = 1;
        } else if (*s == '"' || *s == '\\') {
            escaped[0] = '\\';
            escaped[1] = (char)*s;
            append(j, escaped, 2);
        } else if (*s < ' ') {
            append(j, escaped, (size_t)snprintf(escaped, sizeof escaped, "\\u%04x", *s));
        } else {
            append(j, (const char *)s, n);
        }
        s += n;
    }
    append(j, "\"", 1);
}

static void begin(json *j, const char *key)
{
    if (j->needs_comma)
        append(j, ", ", 2);
    j->needs_comma = 1;
    if (key) {
        append_string(j, key);
        append(j, ": ", 2);
    }
}

void json_open(json *j, const char *key, char bracket)
{
    begin(j, key);
    append(j, &bracket, 1);
    j->needs_comma = 0;
}

void json_close(json *j, char bracket)
{
    append(j, &bracket, 1);
    j->needs_comma = 1;
}

void json_text(json *j, const char *key, const char *value)
{
    begin(j, key);
    append_string(j, value);
}

void json_number(json *j, const char *key, double value)
{
    char text[40];
    begin(j, key);
    if (isfinite(value))
        append(j, text,
               (size_t)snprintf(text, sizeof text,
                                fabs(value) < 1e15 && value == floor(value) ? "%.0f" : "%.9g",
                                value));
    else
        append(j, "null", 4);
}

void json_bool(json *j, const char *key, int value)
{
    begin(j, key);
    append(j, value ? "true" : "false", value ? 4 : 5);
}

int json_print(json *j, FILE *stream)
{
    int has_failed = !j->text || j->has_failed || fprintf(stream, "%s\n", j->text) < 0 ||
                     fflush(stream) != 0;
    free(j->text);
    memset(j, 0, sizeof *j);
    return has_failed ? -1 : 0;
}
