/* oidnDenoise: denoises images, with the options and result lines of Open Image Denoise's program
 * of that name. docs/apps.md is its manual. */
#include "denoise.h"

int main(int argc, char **argv)
{
    denoise_settings settings;
    exit_code code;
    if (argc <= 1) {
        denoise_print_help();
        return EXIT_USAGE;
    }
    code = denoise_parse(&settings, argc, argv);
    if (code)
        return report_refusal(code, argc, argv);
    if (settings.is_help) {
        denoise_print_help();
        return EXIT_USAGE;
    }
    if (settings.is_list) {
        device_print_list();
        return report_check_text();
    }
    if (settings.is_json)
        report_be_quiet();
    return denoise_run(&settings);
}
