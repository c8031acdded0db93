/* Messages and exit codes of the programs. */
#ifndef LULL_APPS_REPORT_H
#define LULL_APPS_REPORT_H

#include "json.h"

typedef enum exit_code {
    EXIT_OK = 0,
    EXIT_USAGE = 1,        /* wrong options, or help was asked for */
    EXIT_INPUT = 2,        /* an input is unreadable or unsupported */
    EXIT_DENOISE = 3,      /* the denoiser reported an error, or its result failed a check */
    EXIT_OUTPUT = 4,       /* an output cannot be written */
    EXIT_INTERRUPTED = 130 /* by SIGINT */
} exit_code;

#if defined(__MINGW32__) && !defined(__clang__) /* the C library's functions are replaced, too */
#define REPORT_PRINTF(text, first) __attribute__((format(gnu_printf, text, first)))
#elif defined(__GNUC__)
#define REPORT_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define REPORT_PRINTF(text, first)
#endif

/* Prints "Error: ..." to stderr as one line, and remembers it. Returns the code. */
exit_code report_error(exit_code code, const char *format, ...) REPORT_PRINTF(2, 3);

/* Prints to stdout unless report_be_quiet was called (for --json, whose object stands there alone:
 * what libraries print goes to stderr). */
void report_line(const char *format, ...) REPORT_PRINTF(1, 2);
void report_be_quiet(void);

/* OUTPUT, which it reports, if some of the text could not be printed: for programs whose text is
 * what they are asked for. */
exit_code report_check_text(void);

/* Ends a program's JSON object with its exit code and, if that tells of one, the last error; prints
 * it if is_json, and frees it. Returns the code, or another one if nothing could be printed. */
exit_code report_end(json *report, exit_code code, int is_json);

/* The same for arguments that are refused, if --json is among them. */
exit_code report_refusal(exit_code code, int argc, char **argv);

#endif
