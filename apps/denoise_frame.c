#include "denoise_job.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "layers.h"
#include "platform.h"

/* ---- Session --------------------------------------------------------------------------------- */

/* Progress on stderr for a person, when the percentage changes; stops on an interrupt. */
static bool on_progress(void *user, double n)
{
    denoise_session *session = user;
    int percent = (int)(n * 100);
    if (session->shows_progress && percent != session->percent)
        fprintf(stderr, "\rDenoising %d%% ", percent);
    session->percent = percent;
    return !platform_interrupted();
}

exit_code denoise_begin(denoise_session *session, const denoise_settings *settings, json *report)
{
    char version[32];
    double start = platform_clock();
    memset(session, 0, sizeof *session);
    session->settings = settings;
    session->report = report;
    if (settings->is_checking && !settings->output_count)
        return EXIT_OK; /* nothing will be denoised */
    if (settings->weights) {
        session->weights = device_load_weights(settings->weights, &session->weights_size);
        if (!session->weights)
            return EXIT_INPUT;
    }
    report_line("Initializing device\n");
    session->device = device_open(&settings->device);
    if (!session->device)
        return EXIT_DENOISE;
    report_line("  device=%s, version=%s, msec=%g\n", device_type_name(session->device),
                device_version(session->device, version), 1000 * (platform_clock() - start));
    json_text(report, "device", device_type_name(session->device));
    json_text(report, "version", version);
    json_text(report, "filter", settings->filter);
    session->shows_progress = platform_is_terminal(stderr) && settings->device.verbose < 2 &&
                              !settings->is_json;
    return EXIT_OK;
}

void denoise_end(denoise_session *session)
{
    if (session->filter)
        oidnReleaseFilter(session->filter);
    if (session->albedo_filter)
        oidnReleaseFilter(session->albedo_filter);
    if (session->device)
        oidnReleaseDevice(session->device);
    temporal_free(&session->steady);
    free(session->weights);
    memset(session, 0, sizeof *session);
}

/* ---- One frame ------------------------------------------------------------------------------- */

static void job_free(frame_job *job)
{
    for (int i = 0; i < 3; i++)
        device_image_free(&job->views[i]);
    device_image_free(&job->output_view);
    image_destroy(&job->output);
    image_destroy(&job->backup);
    image_destroy(&job->reference);
    denoise_passes_free(job);
    denoise_split_free(job);
    denoise_inputs_free(&job->inputs);
}

exit_code denoise_device_error(const frame_job *job, int is_commit)
{
    const char *text = NULL;
    OIDNError error = oidnGetDeviceError(job->session->device, &text);
    if (error == OIDN_ERROR_NONE)
        return EXIT_OK;
    if (error == OIDN_ERROR_CANCELLED)
        return EXIT_INTERRUPTED;
    if (is_commit && job->settings->weights && error != OIDN_ERROR_OUT_OF_MEMORY)
        return report_error(EXIT_INPUT, "cannot use the weights '%s': %s%s",
                            job->settings->weights, text,
                            job->inputs.is_found[IMAGE_ALBEDO] || job->inputs.is_found[IMAGE_NORMAL]
                                ? " (--no_aux leaves out what was found in the colour's file)"
                                : "");
    return report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[job->inputs.main], text);
}

/* Memory for an image like the input. */
static exit_code make_like_input(frame_job *job, image *made)
{
    const image *main = &job->inputs.images[job->inputs.main];
    image_error error;
    if (image_create(made, main->width, main->height, main->channels, main->type, &error))
        return report_error(EXIT_DENOISE, "%s: %s", job->inputs.paths[job->inputs.main],
                            error.text);
    made->left = main->left, made->top = main->top;
    return EXIT_OK;
}

/* The memory of the result, and a copy of the input if that will be needed when it is no more what
 * it was: replaced by a result of which several are wanted, or by means over frames, and wanted
 * weaker. */
static exit_code make_output(frame_job *job)
{
    const denoise_settings *s = job->settings;
    const image *main = &job->inputs.images[job->inputs.main];
    exit_code code = s->is_in_place ? EXIT_OK : make_like_input(job, &job->output);
    if (code || !((s->is_in_place && s->runs > 1) ||
                  ((s->is_in_place || s->is_temporal) && s->strength < 1)))
        return code;
    code = make_like_input(job, &job->backup);
    if (!code)
        memcpy(job->backup.pixels, main->pixels, image_bytes(main));
    return code;
}

/* The input as it was read. */
static const image *input_of(const frame_job *job)
{
    return job->backup.pixels ? &job->backup : &job->inputs.images[job->inputs.main];
}

image *denoise_result(frame_job *job)
{
    return job->settings->is_in_place ? &job->inputs.images[job->inputs.main] : &job->output;
}

exit_code denoise_make_view(frame_job *job, device_image *view, image *img)
{
    if (device_image_init(view, job->session->device, img,
                          (device_storage)job->settings->storage))
        return denoise_device_error(job, 0);
    device_image_upload(view);
    return EXIT_OK;
}

static exit_code make_views(frame_job *job)
{
    exit_code code = EXIT_OK;
    for (int i = 0; i < 3 && !code; i++)
        if (job->inputs.images[i].pixels)
            code = denoise_make_view(job, &job->views[i], &job->inputs.images[i]);
    if (!code && !job->settings->is_in_place &&
        device_image_init(&job->output_view, job->session->device, &job->output,
                          (device_storage)job->settings->storage))
        return denoise_device_error(job, 0);
    return code ? code : denoise_device_error(job, 0);
}

/* Makes a filter of the session, once. */
static exit_code make_once(frame_job *job, OIDNFilter *filter, const char *type)
{
    if (*filter)
        return EXIT_OK;
    *filter = oidnNewFilter(job->session->device, type);
    return denoise_device_error(job, 0);
}

void denoise_commit(frame_job *job, OIDNFilter filter)
{
    const denoise_settings *s = job->settings;
    if (s->quality >= 0)
        oidnSetFilterInt(filter, "quality", s->quality);
    if (s->is_panorama)
        oidnSetFilterBool(filter, "panorama", true);
    if (s->ensemble > 1)
        oidnSetFilterInt(filter, "ensemble", s->ensemble);
    if (s->max_memory >= 0)
        oidnSetFilterInt(filter, "maxMemoryMB", s->max_memory);
    oidnSetFilterProgressMonitorFunction(filter, on_progress, job->session);
    oidnCommitFilter(filter);
}

exit_code denoise_run_filter(frame_job *job, OIDNFilter filter)
{
    exit_code code;
    if (platform_interrupted())
        return EXIT_INTERRUPTED;
    job->session->percent = -1;
    oidnExecuteFilter(filter);
    code = denoise_device_error(job, 0);
    if (job->session->shows_progress)
        fprintf(stderr, "\r               \r");
    return code;
}

exit_code denoise_prefilter(frame_job *job, const device_image *albedo)
{
    OIDNFilter *filter = &job->session->albedo_filter;
    exit_code code = make_once(job, filter, "RT");
    if (code)
        return code;
    device_image_set(albedo, *filter, "albedo");
    device_image_set(albedo, *filter, "output");
    denoise_commit(job, *filter);
    return denoise_run_filter(job, *filter);
}

/* Where few samples see a fine texture each, an albedo is as noisy as the light. */
static exit_code prefilter_albedo(frame_job *job)
{
    const device_image *albedo = &job->views[IMAGE_ALBEDO];
    double start = platform_clock(), seconds;
    exit_code code;
    if (!job->settings->is_prefiltering)
        return EXIT_OK;
    report_line("Prefiltering albedo\n");
    if (!albedo->img || job->inputs.main == IMAGE_ALBEDO) {
        report_line("  there is none beside the image\n");
        return EXIT_OK;
    }
    code = denoise_prefilter(job, albedo);
    if (code)
        return code;
    seconds = platform_clock() - start;
    report_line("  msec=%g\n", 1000 * seconds);
    json_number(job->session->report, "prefilter_msec", 1000 * seconds);
    return EXIT_OK;
}

/* Sets images and parameters and commits. */
static void configure(frame_job *job)
{
    const denoise_settings *s = job->settings;
    OIDNFilter filter = job->session->filter;
    int is_lightmap = !strcmp(s->filter, "RTLightmap");
    for (int i = 0; i < 3; i++) {
        if (job->inputs.images[i].pixels)
            device_image_set(&job->views[i], filter, layers_role_name((image_role)i));
        else if (!is_lightmap || i == IMAGE_COLOR)
            oidnUnsetFilterImage(filter, layers_role_name((image_role)i));
    }
    device_image_set(s->is_in_place ? &job->views[job->inputs.main] : &job->output_view, filter,
                     "output");
    if (is_lightmap) {
        oidnSetFilterBool(filter, "directional", s->is_directional != 0);
    } else {
        oidnSetFilterBool(filter, "hdr", job->is_hdr != 0);
        oidnSetFilterBool(filter, "srgb", job->is_srgb != 0);
        oidnSetFilterBool(filter, "cleanAux", s->is_aux_clean != 0);
    }
    if (!isnan(s->input_scale))
        oidnSetFilterFloat(filter, "inputScale", s->input_scale);
    if (job->session->weights)
        oidnSetSharedFilterData(filter, "weights", job->session->weights,
                                job->session->weights_size);
    denoise_commit(job, filter);
}

static exit_code make_filter(frame_job *job)
{
    double start = platform_clock();
    image *normal = &job->inputs.images[IMAGE_NORMAL];
    exit_code code;
    report_line("Initializing filter\n");
    code = make_once(job, &job->session->filter, job->settings->filter);
    if (code)
        return code;
    configure(job);
    if (job->inputs.is_found[IMAGE_NORMAL] && !job->inputs.images[IMAGE_ALBEDO].pixels &&
        oidnGetDeviceError(job->session->device, NULL) != OIDN_ERROR_NONE) {
        report_line("  normals are left out: there is no albedo\n");
        json_bool(job->session->report, "normals_left_out", 1);
        device_image_free(&job->views[IMAGE_NORMAL]);
        image_destroy(normal);
        configure(job);
    }
    code = denoise_device_error(job, 1);
    if (!code)
        report_line("  filter=%s, msec=%g\n", job->settings->filter,
                    1000 * (platform_clock() - start));
    return code;
}

/* Restores the input of an in-place run. */
static void rewind_input(frame_job *job)
{
    image *main = &job->inputs.images[job->inputs.main];
    if (!job->settings->is_in_place)
        return;
    memcpy(main->pixels, job->backup.pixels, image_bytes(main));
    device_image_upload(&job->views[job->inputs.main]);
}

/* Makes the result once: runs the filter and downloads it, or adds up parts, or both. */
static exit_code execute(frame_job *job, double *seconds)
{
    const int has_parts = job->settings->part_count > 0;
    double start = platform_clock();
    exit_code code =
        has_parts ? denoise_parts_run(job) : denoise_run_filter(job, job->session->filter);
    if (!code && !has_parts)
        device_image_download(job->settings->is_in_place ? &job->views[job->inputs.main]
                                                         : &job->output_view);
    if (!code && job->settings->is_split)
        code = denoise_split_run(job);
    *seconds = platform_clock() - start;
    return code;
}

/* Brings what earlier frames know into the images of this one, if it is wanted steady. */
static exit_code gather(frame_job *job)
{
    const denoise_settings *s = job->settings;
    image *images = job->inputs.images;
    temporal_frame frame = {0};
    if (!s->is_temporal)
        return EXIT_OK;
    frame.number = job->frame;
    frame.noisy = &images[IMAGE_COLOR];
    frame.albedo = images[IMAGE_ALBEDO].pixels ? &images[IMAGE_ALBEDO] : NULL;
    frame.normal = images[IMAGE_NORMAL].pixels ? &images[IMAGE_NORMAL] : NULL;
    frame.motion = images[IMAGE_MOTION].pixels ? &images[IMAGE_MOTION] : NULL;
    frame.scale = s->has_motion_scale ? s->motion_scale : NULL;
    if (temporal_gather(&job->session->steady, &frame))
        return report_error(EXIT_DENOISE, "%s: not enough memory", job->inputs.paths[IMAGE_COLOR]);
    return EXIT_OK;
}

void denoise_weaken(image *result, const image *input, float strength)
{
    for (size_t i = 0, n = image_count(result); i < n; i++) {
        float from = image_get(input, i), to = image_get(result, i);
        if (isfinite(from))
            image_set(result, i, from + strength * (to - from));
    }
}

static void save_debug(const char *path, const image *img)
{
    image_error error;
    if (image_write(path, img, NULL, &error))
        report_error(EXIT_OUTPUT, "cannot write '%s': %s", path, error.text);
}

/* The images of a failed comparison, in the current directory as Open Image Denoise's program
 * leaves them. */
static void save_debug_images(frame_job *job)
{
    report_line("Saving debug images\n");
    if (job->backup.pixels || !job->settings->is_in_place)
        save_debug("denoise_in.pfm", input_of(job));
    save_debug("denoise_out.pfm", denoise_result(job));
    if (job->reference.pixels)
        save_debug("denoise_ref.pfm", &job->reference);
}

static exit_code verify(frame_job *job, comparison *result)
{
    const denoise_settings *s = job->settings;
    double limit = !isnan(s->max_error)                     ? (double)s->max_error
                   : denoise_is_signed(s, job->inputs.main) ? COMPARE_MAX_ERROR_SIGNED
                                                            : COMPARE_MAX_ERROR;
    report_line("Verifying output\n");
    image_compare(result, &job->reference, denoise_result(job), limit);
    report_line("  values=%zu, errors=%zu, avgerror=%g\n", result->values, result->errors,
                result->average);
    if (!result->errors)
        return EXIT_OK;
    save_debug_images(job);
    for (size_t i = 0; i < result->shown; i++)
        fprintf(stderr, "  error i=%zu, expect=%g, actual=%g\n", result->examples[i].index,
                (double)result->examples[i].expected, (double)result->examples[i].actual);
    return report_error(EXIT_DENOISE, "output does not match the reference");
}

/* Says what quality `auto` came to. */
static void report_quality(const frame_job *job)
{
    const char *used;
    if (job->settings->quality != LULL_QUALITY_AUTO)
        return;
    used = device_used_quality(job->session->filter);
    report_line("  quality=%s\n", used);
    json_text(job->session->report, "quality", used);
}

/* One repetition with its result line; *hash is that of the first one afterwards. */
static exit_code run_once(frame_job *job, int run, uint32_t *hash)
{
    json *report = job->session->report;
    double seconds = 0;
    uint32_t mine;
    char text[16];
    exit_code code;
    if (run)
        rewind_input(job);
    if (run && job->settings->is_split) {
        configure(job); /* the filter has the images of a share */
        code = denoise_device_error(job, 1);
        if (code)
            return code;
    }
    report_line("Denoising\n");
    code = execute(job, &seconds);
    if (code)
        return code;
    if (job->settings->is_temporal)
        temporal_mix(&job->session->steady, denoise_result(job), job->frame);
    if (job->settings->strength < 1 && !job->settings->part_count)
        denoise_weaken(denoise_result(job), input_of(job), job->settings->strength);
    mine = image_hash(denoise_result(job));
    snprintf(text, sizeof text, "%08x", (unsigned)mine);
    report_line("  msec=%g, hash=%s\n", 1000 * seconds, text);
    json_open(report, NULL, '{');
    json_number(report, "msec", 1000 * seconds);
    json_text(report, "hash", text);
    report_quality(job);
    json_close(report, '}');
    if (run && mine != *hash) {
        save_debug_images(job);
        return report_error(EXIT_DENOISE, "output hash mismatch: %08x, then %s", (unsigned)*hash,
                            text);
    }
    *hash = mine;
    return EXIT_OK;
}

/* All repetitions; the first one's result is compared with the reference. */
static exit_code run_all(frame_job *job)
{
    json *report = job->session->report;
    comparison compared = {0};
    uint32_t hash = 0;
    exit_code code = EXIT_OK;
    json_open(report, "runs", '[');
    for (int run = 0; run < job->settings->runs && !code; run++) {
        code = run_once(job, run, &hash);
        if (!code && !run && job->reference.pixels)
            code = verify(job, &compared);
    }
    json_close(report, ']');
    if (compared.values) {
        char *path = sequence_path(job->settings->reference, job->frame);
        json_open(report, "reference", '{');
        json_text(report, "file", path ? path : job->settings->reference);
        free(path);
        json_number(report, "values", (double)compared.values);
        json_number(report, "errors", (double)compared.errors);
        json_number(report, "avgerror", compared.average);
        json_close(report, '}');
    }
    return code;
}

/* Everything after loading. */
static exit_code process(frame_job *job)
{
    exit_code code;
    if (job->settings->is_checking || job->settings->is_repairing)
        denoise_check(&job->inputs, &job->is_hdr, &job->is_srgb, job->settings,
                      job->session->report);
    if (job->settings->is_checking && !job->settings->output_count)
        return EXIT_OK;
    code = denoise_passes_load(job);
    if (!code)
        code = denoise_split_load(job);
    if (!code)
        code = make_output(job);
    if (!code && job->settings->reference)
        code = denoise_load_reference(&job->reference, job->settings, &job->inputs, job->frame);
    if (!code)
        code = gather(job);
    if (!code)
        code = make_views(job);
    if (!code)
        code = prefilter_albedo(job);
    if (!code)
        code = make_filter(job);
    if (!code)
        code = run_all(job);
    if (!code)
        code = denoise_passes_run(job);
    if (!code)
        denoise_passes_tell(job);
    if (!code)
        denoise_split_tell(job);
    return code ? code : denoise_write_outputs(job);
}

exit_code denoise_frame(denoise_session *session, int frame)
{
    frame_job job;
    exit_code code;
    memset(&job, 0, sizeof job);
    job.session = session;
    job.settings = session->settings;
    job.frame = frame;
    job.is_hdr = job.settings->is_hdr;
    job.is_srgb = job.settings->is_srgb;
    code = denoise_check_outputs(&job);
    if (code)
        return code;
    report_line("Loading input\n");
    code = denoise_load(&job.inputs, job.settings, frame, session->report);
    if (!code && job.settings->is_untold && !job.is_srgb)
        job.is_hdr = image_is_linear(&job.inputs.images[IMAGE_COLOR],
                                     job.inputs.paths[IMAGE_COLOR]);
    if (!code)
        code = platform_interrupted() ? EXIT_INTERRUPTED : process(&job);
    job_free(&job);
    return code;
}
