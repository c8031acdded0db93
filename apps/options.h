/* Command lines from a table. An option begins with any number of dashes; its value is the next
 * argument, or follows a '='. */
#ifndef LULL_APPS_OPTIONS_H
#define LULL_APPS_OPTIONS_H

#include <stddef.h>

typedef enum option_kind {
    OPTION_HEADING, /* only a line of the help */
    OPTION_FLAG,    /* int: set to `low` */
    OPTION_INT,     /* int in [low, high] */
    OPTION_FLOAT,   /* float, finite or "nan" */
    OPTION_TEXT,    /* const char *, the argument itself */
    OPTION_WORD,    /* int: the value of one of `words`, in upper or lower case */
    OPTION_CALL     /* `call` takes `values` arguments */
} option_kind;

typedef struct option_word {
    const char *word; /* aliases separated by spaces; NULL ends the list */
    int value;
} option_word;

typedef struct option {
    option_kind kind;
    const char
        *names;    /* aliases without dashes, separated by spaces; the help shows the first two */
    size_t offset; /* of the field in the settings */
    int low, high;
    const option_word *words;
    int (*call)(void *settings, const char *const *values); /* 0 if the values are valid */
    unsigned values;
    const char *argument; /* for the help: "FILE"; NULL if it takes none */
    const char *help;     /* NULL: not shown */
} option;

/* Rows of a table, where AT(field) is the offset of a field of the settings. */
#define HEADING(text)                                          \
    {                                                          \
        OPTION_HEADING, "", 0, 0, 0, NULL, NULL, 0, NULL, text \
    }
#define FLAG(names, field, value, help)                                    \
    {                                                                      \
        OPTION_FLAG, names, AT(field), value, 0, NULL, NULL, 0, NULL, help \
    }
#define INT(names, field, low, high, argument, help)                           \
    {                                                                          \
        OPTION_INT, names, AT(field), low, high, NULL, NULL, 1, argument, help \
    }
#define FLOAT(names, field, argument, help)                                 \
    {                                                                       \
        OPTION_FLOAT, names, AT(field), 0, 0, NULL, NULL, 1, argument, help \
    }
#define TEXT(names, field, argument, help)                                 \
    {                                                                      \
        OPTION_TEXT, names, AT(field), 0, 0, NULL, NULL, 1, argument, help \
    }
#define WORD(names, field, words, argument, help)                           \
    {                                                                       \
        OPTION_WORD, names, AT(field), 0, 0, words, NULL, 1, argument, help \
    }
#define CALL(names, function, values, argument, help)                       \
    {                                                                       \
        OPTION_CALL, names, 0, 0, 0, NULL, function, values, argument, help \
    }

/* Fills the settings. `positional` takes arguments without dashes (0: accepted); NULL: there are
 * none. Returns 0, or prints one line to stderr and returns 1. */
int options_parse(const option *table, size_t count, void *settings,
                  int (*positional)(void *settings, const char *argument), int argc, char **argv);

/* The table as help on stdout. */
void options_print(const option *table, size_t count);

/* Value of a word, in upper or lower case, or -1. */
int option_word_value(const option_word *words, const char *text);

/* Decimal integer in [low, high] that is the whole text: returns 1 and stores it. */
int option_parse_int(const char *text, int low, int high, int *value);

#endif
