#include "sequence.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A number without sign; moves *text past it. -1 if there is none. */
static long read_number(const char **text)
{
    long value = 0;
    int digits = 0;
    for (; isdigit((unsigned char)**text); ++*text) {
        value = value * 10 + (**text - '0');
        if (++digits > 9)
            return -1;
    }
    return digits ? value : -1;
}

static int append(sequence *s, long first, long last, long step)
{
    size_t more;
    int *frames;
    if (last < first || step < 1)
        return -1;
    more = (size_t)((last - first) / step + 1);
    if (s->count + more > SEQUENCE_MAX)
        return -1;
    frames = realloc(s->frames, (s->count + more) * sizeof *frames);
    if (!frames)
        return -1;
    s->frames = frames;
    for (long frame = first; frame <= last; frame += step)
        s->frames[s->count++] = (int)frame;
    return 0;
}

int sequence_parse(sequence *s, const char *text)
{
    memset(s, 0, sizeof *s);
    for (;;) {
        long first = read_number(&text), last = first, step = 1;
        if (first >= 0 && *text == '-') {
            text++;
            last = read_number(&text);
            if (last >= 0 && *text == 'x') {
                text++;
                step = read_number(&text);
            }
        }
        if (first < 0 || last < 0 || append(s, first, last, step) || (*text && *text != ',')) {
            sequence_free(s);
            return -1;
        }
        if (!*text++)
            return 0;
    }
}

void sequence_free(sequence *s)
{
    free(s->frames);
    memset(s, 0, sizeof *s);
}

/* Where the number goes: start and length in the path, and its least digits. Length 0: nowhere. */
static size_t find_place(const char *path, size_t *start, int *digits)
{
    const char *name = path + strlen(path);
    while (name > path && name[-1] != '/' && name[-1] != '\\')
        name--;
    for (const char *c = name; *c; c++) {
        size_t n = strspn(c, "#");
        *start = (size_t)(c - path);
        *digits = (int)n;
        if (n)
            return n;
        if (*c == '%') {
            const char *end = c + 1;
            *digits = 0;
            if (*end == '0' && isdigit((unsigned char)end[1])) {
                *digits = end[1] - '0';
                end += 2;
            }
            if (*end == 'd')
                return (size_t)(end + 1 - c);
        }
    }
    return 0;
}

int sequence_is_pattern(const char *path)
{
    size_t start;
    int digits;
    return find_place(path, &start, &digits) > 0;
}

char *sequence_path(const char *pattern, int frame)
{
    size_t start = 0, room = strlen(pattern) + 32;
    int digits = 0;
    size_t length = frame == SEQUENCE_NONE ? 0 : find_place(pattern, &start, &digits);
    char *path = malloc(room);
    if (path && length)
        snprintf(path, room, "%.*s%0*d%s", (int)start, pattern, digits > 20 ? 20 : digits, frame,
                 pattern + start + length);
    else if (path)
        memcpy(path, pattern, strlen(pattern) + 1);
    return path;
}
