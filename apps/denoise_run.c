#include <stdlib.h>
#include <string.h>

#include "denoise.h"
#include "platform.h"

/* All frames of the sequence, or the one image. */
static exit_code run_frames(denoise_session *session, const denoise_settings *settings,
                            json *report)
{
    sequence frames;
    exit_code code = EXIT_OK;
    if (!settings->frames)
        return denoise_frame(session, SEQUENCE_NONE);
    if (sequence_parse(&frames, settings->frames))
        return report_error(
            EXIT_USAGE,
            "--frames does not take '%s'; a list such as 1-240 or 1,5,10-20x2 is expected",
            settings->frames);
    json_open(report, "frames", '[');
    for (size_t i = 0; i < frames.count && !code; i++) {
        report_line("Frame %d\n", frames.frames[i]);
        json_open(report, NULL, '{');
        json_number(report, "frame", frames.frames[i]);
        code = denoise_frame(session, frames.frames[i]);
        json_close(report, '}');
    }
    json_close(report, ']');
    sequence_free(&frames);
    return code;
}

exit_code denoise_run(const denoise_settings *settings)
{
    denoise_session session;
    json report;
    exit_code code;

    memset(&report, 0, sizeof report);
    json_open(&report, NULL, '{');
    platform_catch_interrupt();
    code = denoise_begin(&session, settings, &report);
    if (!code)
        code = run_frames(&session, settings, &report);
    denoise_end(&session);
    if (code == EXIT_INTERRUPTED)
        report_error(code, "interrupted");
    if (!code && !settings->is_json && !settings->output_count) /* all there is, is the text */
        code = report_check_text();
    json_number(&report, "peak_memory_bytes", (double)platform_peak_memory());
    return report_end(&report, code, settings->is_json);
}
