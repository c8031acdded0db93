/* Small regular expressions, for --run: literals, . [a-z] [^a] ( ) | * + ? ^ $ and \ before a
 * special character (\d \w \s are digit, word and space). The same on every system. */
#ifndef LULL_APPS_PATTERN_H
#define LULL_APPS_PATTERN_H

/* 1 if the whole text, of at most 127 bytes, matches; the pattern must be free of errors. */
int pattern_matches(const char *pattern, const char *text);

/* NULL, or what is wrong with the pattern (static text). */
const char *pattern_error(const char *pattern);

#endif
