#include "report.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"

static char last_error[9216]; /* two paths and the reason */
static int is_quiet;
static FILE *json_stream; /* NULL: stdout */

exit_code report_error(exit_code code, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(last_error, sizeof last_error, format, arguments);
    va_end(arguments);
    for (char *c = last_error; *c; c++)
        if ((unsigned char)*c < ' ')
            *c = ' ';
    fflush(stdout);
    fprintf(stderr, "Error: %s\n", last_error);
    return code;
}

void report_be_quiet(void)
{
    is_quiet = 1;
    json_stream = platform_divert_stdout();
}

void report_line(const char *format, ...)
{
    va_list arguments;
    if (is_quiet)
        return;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    fflush(stdout);
}

exit_code report_check_text(void)
{
    return fflush(stdout) || ferror(stdout)
               ? report_error(EXIT_OUTPUT, "cannot write to the standard output")
               : EXIT_OK;
}

exit_code report_end(json *report, exit_code code, int is_json)
{
    json_number(report, "exit_code", code);
    if (code)
        json_text(report, "error", last_error);
    json_close(report, '}');
    if (is_json && json_print(report, json_stream ? json_stream : stdout) && !code)
        code = report_error(EXIT_OUTPUT, "cannot write to the standard output");
    free(report->text);
    return code;
}

exit_code report_refusal(exit_code code, int argc, char **argv)
{
    json report;
    int is_json = 0;
    for (int i = 1; i < argc; i++)
        is_json |= argv[i][0] == '-' && !strcmp(argv[i] + strspn(argv[i], "-"), "json");
    memset(&report, 0, sizeof report);
    json_open(&report, NULL, '{');
    return report_end(&report, code, is_json);
}
