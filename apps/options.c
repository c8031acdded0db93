#include "options.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"
#include "report.h"

/* 1 if n bytes are the same, but for upper and lower case if is_any_case. */
static int is_same(const char *a, const char *b, size_t n, int is_any_case)
{
    for (size_t i = 0; i < n; i++)
        if (is_any_case ? tolower((unsigned char)a[i]) != tolower((unsigned char)b[i])
                        : a[i] != b[i])
            return 0;
    return 1;
}

/* 1 if the first n bytes of text are one of the words in a list separated by spaces. */
static int is_listed(const char *list, const char *text, size_t n, int is_any_case)
{
    while (*list) {
        size_t length = strcspn(list, " ");
        if (length == n && is_same(list, text, n, is_any_case))
            return 1;
        list += length + (list[length] == ' ');
    }
    return 0;
}

int option_word_value(const option_word *words, const char *text)
{
    for (; words->word; words++)
        if (is_listed(words->word, text, strlen(text), 1))
            return words->value;
    return -1;
}

int option_parse_int(const char *text, int low, int high, int *value)
{
    char *end;
    long number;
    errno = 0;
    number = strtol(text, &end, 10);
    if (end == text || *end || errno || number < low || number > high)
        return 0;
    *value = (int)number;
    return 1;
}

static int parse_float(const char *text, float *value)
{
    char *end;
    *value = strtof(text, &end);
    return end != text && !*end && !isinf(*value);
}

/* Stores the value of an option; 1 if it is valid. */
static int store(const option *o, void *settings, const char *const *values)
{
    char *field = (char *)settings + o->offset;
    switch (o->kind) {
    case OPTION_FLAG:
        *(int *)(void *)field = o->low;
        return 1;
    case OPTION_INT:
        return option_parse_int(values[0], o->low, o->high, (int *)(void *)field);
    case OPTION_FLOAT:
        return parse_float(values[0], (float *)(void *)field);
    case OPTION_TEXT:
        *(const char **)(void *)field = values[0];
        return values[0][0] != 0;
    case OPTION_WORD:
        *(int *)(void *)field = option_word_value(o->words, values[0]);
        return option_word_value(o->words, values[0]) >= 0;
    case OPTION_CALL:
        return o->call(settings, values) == 0;
    default:
        return 0;
    }
}

static int bad_value(const option *o, const char *argument, const char *value)
{
    char expected[160] = "";
    if (o->kind == OPTION_INT && o->high < INT_MAX)
        snprintf(expected, sizeof expected, "; a number from %d to %d is expected", o->low,
                 o->high);
    else if (o->kind == OPTION_INT)
        snprintf(expected, sizeof expected, "; a number of at least %d is expected", o->low);
    else if (o->kind == OPTION_FLOAT)
        snprintf(expected, sizeof expected, "; a number such as 0.5 is expected");
    else if (o->argument)
        snprintf(expected, sizeof expected, "; %s is expected", o->argument);
    report_error(EXIT_USAGE, "option %s does not take '%s'%s", argument, value, expected);
    return 1;
}

/* Handles the option at argv[*i], and moves *i to its last argument. */
static int parse_option(const option *table, size_t count, void *settings, int argc, char **argv,
                        int *i)
{
    const char *argument = argv[*i];
    const char *name = argument + strspn(argument, "-");
    const char *equals = strchr(name, '=');
    size_t length = equals ? (size_t)(equals - name) : strlen(name);
    const char *values[2] = {NULL, NULL};
    unsigned needed;
    size_t k = 0;

    while (k < count &&
           (table[k].kind == OPTION_HEADING || !is_listed(table[k].names, name, length, 0)))
        k++;
    if (k == count || !length) {
        report_error(EXIT_USAGE, "unknown option '%s'", argument);
        return 1;
    }
    needed = table[k].kind == OPTION_FLAG ? 0 : table[k].kind == OPTION_CALL ? table[k].values : 1;
    for (unsigned v = 0; v < needed; v++) {
        if (equals && v == 0) {
            values[v] = equals + 1;
        } else if (*i + 1 < argc) {
            values[v] = argv[++*i];
        } else {
            report_error(EXIT_USAGE, "option %s needs a value (%s)", argument, table[k].argument);
            return 1;
        }
    }
    if (equals && !needed) {
        report_error(EXIT_USAGE, "option %.*s takes no value", (int)(equals - argument), argument);
        return 1;
    }
    return store(&table[k], settings, values)
               ? 0
               : bad_value(&table[k], argument, values[0] ? values[0] : "");
}

int options_parse(const option *table, size_t count, void *settings,
                  int (*positional)(void *settings, const char *argument), int argc, char **argv)
{
    platform_hold_standard();
    for (int i = 1; i < argc; i++) {
        if (argv[i][0] == '-') {
            if (parse_option(table, count, settings, argc, argv, &i))
                return 1;
        } else if (!positional || positional(settings, argv[i])) {
            report_error(EXIT_USAGE, "option expected, not '%s'", argv[i]);
            return 1;
        }
    }
    return 0;
}

void options_print(const option *table, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        const option *o = &table[k];
        char left[64];
        const char *name = o->names;
        size_t n = 0;
        if (!o->help)
            continue;
        if (o->kind == OPTION_HEADING) {
            printf("\n%s\n", o->help);
            continue;
        }
        for (unsigned shown = 0; *name && shown < 2; shown++) {
            size_t length = strcspn(name, " ");
            n += (size_t)snprintf(left + n, sizeof left - n, "%s%s%.*s", shown ? ", " : "",
                                  length == 1 ? "-" : "--", (int)length, name);
            name += length + (name[length] == ' ');
        }
        if (o->argument)
            snprintf(left + n, sizeof left - n, " %s", o->argument);
        if (n > 30)
            printf("  %s\n%-32s %s\n", left, "", o->help);
        else
            printf("  %-30s %s\n", left, o->help);
    }
}
