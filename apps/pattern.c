#include "pattern.h"

#include <ctype.h>
#include <stddef.h>
#include <string.h>

#define PATTERN_MAX 200
#define TEXT_MAX 127

/* Where matching failed before: what follows depends only on the places in pattern and text, so
 * that no pair need be tried twice and backtracking stays cheap. */
typedef struct matcher {
    const char *pattern, *text;
    unsigned char failed[PATTERN_MAX + 1][TEXT_MAX + 1];
} matcher;

/* Matching goes by continuations: match_here() matches a part of the pattern and then whatever
 * `next` says is left of it. */
typedef struct rest {
    const char *start, *end; /* the pattern that follows */
    const struct rest *next;
    const struct repeat *repeat; /* or: try the piece again */
    const char *from;            /* text where the last repetition began */
} rest;

typedef struct repeat {
    const char *piece, *piece_end; /* what is repeated */
    const char *after, *end;       /* pattern after the quantifier */
    const rest *next;
    int is_once; /* '?' */
} repeat;

static int match_alternatives(matcher *m, const char *p, const char *end, const char *text,
                              const rest *next);

/* End of the piece (character, class or group) at p; NULL if it is not closed. */
static const char *piece_end(const char *p, const char *end)
{
    int depth = 0;
    if (*p == '\\')
        return p + 1 < end ? p + 2 : NULL;
    if (*p == '[') {
        p += p + 1 < end && p[1] == '^' ? 2 : 1;
        for (const char *first = p; p < end; p++)
            if (*p == ']' && p > first)
                return p + 1;
        return NULL;
    }
    if (*p != '(')
        return p + 1;
    for (; p < end; p++) {
        if (*p == '\\')
            p++;
        else if (*p == '(')
            depth++;
        else if (*p == ')' && --depth == 0)
            return p + 1;
    }
    return NULL;
}

/* 1 if the character is in the class \c. */
static int is_escape(char c, char text)
{
    unsigned char t = (unsigned char)text;
    return c == 'd'   ? isdigit(t) != 0
           : c == 'w' ? isalnum(t) || t == '_'
           : c == 's' ? isspace(t) != 0
                      : c == text;
}

/* 1 if the piece [p, end), no group, matches the character. */
static int matches_one(const char *p, const char *end, char text)
{
    int is_negated, found = 0;
    if (*p == '.')
        return 1;
    if (*p == '\\')
        return is_escape(p[1], text);
    if (*p != '[')
        return *p == text;
    is_negated = p[1] == '^';
    p += is_negated ? 2 : 1;
    for (end--; p < end; p++) {
        if (p + 2 < end && p[1] == '-') {
            found |= p[0] <= text && text <= p[2];
            p += 2;
        } else {
            found |= *p == text;
        }
    }
    return found != is_negated;
}

static int match_rest(matcher *m, const rest *next, const char *text);
static int match_here(matcher *m, const char *p, const char *end, const char *text,
                      const rest *next);

/* Matches a piece once, then `next`. */
static int match_piece(matcher *m, const char *p, const char *end, const char *text,
                       const rest *next)
{
    if (*p == '(')
        return match_alternatives(m, p + 1, end - 1, text, next);
    if (*p == '^' || *p == '$') /* the begin and the end of the text */
        return (*p == '^' ? text == m->text : !*text) && match_rest(m, next, text);
    return *text && matches_one(p, end, *text) && match_rest(m, next, text + 1);
}

/* A sequence of pieces without '|' at its level, then `next`. */
static int try_here(matcher *m, const char *p, const char *end, const char *text, const rest *next)
{
    const char *after;
    rest follow;
    repeat loop;
    char quantifier;

    if (p == end)
        return match_rest(m, next, text);
    after = piece_end(p, end);
    quantifier = after < end ? *after : 0;
    memset(&follow, 0, sizeof follow);
    if (quantifier != '*' && quantifier != '+' && quantifier != '?') {
        follow.start = after;
        follow.end = end;
        follow.next = next;
        return match_piece(m, p, after, text, &follow);
    }
    loop.piece = p;
    loop.piece_end = after;
    loop.after = after + 1;
    loop.end = end;
    loop.next = next;
    loop.is_once = quantifier == '?';
    follow.repeat = &loop;
    follow.from = text;
    if (match_piece(m, p, after, text, &follow))
        return 1;
    return quantifier != '+' && match_here(m, loop.after, end, text, next);
}

static int match_here(matcher *m, const char *p, const char *end, const char *text,
                      const rest *next)
{
    unsigned char *failed = &m->failed[p - m->pattern][text - m->text];
    if (*failed)
        return 0;
    *failed = !try_here(m, p, end, text, next);
    return !*failed;
}

static int match_rest(matcher *m, const rest *next, const char *text)
{
    const repeat *loop;
    rest again;
    if (!next)
        return *text == 0;
    loop = next->repeat;
    if (!loop)
        return match_here(m, next->start, next->end, text, next->next);
    memset(&again, 0, sizeof again);
    again.repeat = loop;
    again.from = text;
    /* An empty repetition would go on for ever. */
    if (!loop->is_once && text != next->from &&
        match_piece(m, loop->piece, loop->piece_end, text, &again))
        return 1;
    return match_here(m, loop->after, loop->end, text, loop->next);
}

static int match_alternatives(matcher *m, const char *p, const char *end, const char *text,
                              const rest *next)
{
    for (;;) {
        const char *stop = p;
        while (stop < end && *stop != '|')
            stop = piece_end(stop, end);
        if (match_here(m, p, stop, text, next))
            return 1;
        if (stop == end)
            return 0;
        p = stop + 1;
    }
}

static const char *error_between(const char *p, const char *end)
{
    int can_repeat = 0;
    while (p < end) {
        const char *after = piece_end(p, end);
        const char *inner = NULL;
        if (!after)
            return *p == '[' ? "[ without ]" : *p == '(' ? "( without )" : "\\ at the end";
        if (*p == '{')
            return "counts in braces are not known, and a brace itself is \\{";
        if (*p == ')' || *p == ']')
            return *p == ')' ? ") without (" : "] without [";
        if (*p == '*' || *p == '+' || *p == '?') {
            if (!can_repeat)
                return "nothing to repeat";
            can_repeat = 0;
        } else {
            can_repeat = *p != '|';
        }
        if (*p == '(')
            inner = error_between(p + 1, after - 1);
        if (inner)
            return inner;
        p = after;
    }
    return NULL;
}

const char *pattern_error(const char *pattern)
{
    if (strlen(pattern) > PATTERN_MAX)
        return "too long";
    return error_between(pattern, pattern + strlen(pattern));
}

int pattern_matches(const char *pattern, const char *text)
{
    matcher m;
    if (strlen(pattern) > PATTERN_MAX || strlen(text) > TEXT_MAX)
        return 0;
    memset(&m, 0, sizeof m);
    m.pattern = pattern;
    m.text = text;
    return match_alternatives(&m, pattern, pattern + strlen(pattern), text, NULL);
}
