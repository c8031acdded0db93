/* --check and --repair: what is wrong with a frame's inputs, told, and mended where it can be. */
#include <math.h>
#include <string.h>

#include "denoise.h"
#include "doctor.h"
#include "layers.h"

/* Infinite radiance leaves no exposure to measure; no number counts as no light. */
static size_t drop_infinities(image *img)
{
    size_t dropped = 0;
    for (size_t i = 0, n = image_count(img); i < n; i++)
        if (isinf(image_get(img, i))) {
            image_set(img, i, NAN);
            dropped++;
        }
    return dropped;
}

/* Mends what was found, if it can be; says how, or "". */
static const char *repair(denoise_inputs *inputs, int *is_hdr, int *is_srgb, const finding *f)
{
    image *images = inputs->images;
    if (f->kind == FINDING_NORMAL_ENCODED) {
        image_decode_signed(&images[IMAGE_NORMAL]);
        return " (repaired: decoded)";
    }
    if (f->kind == FINDING_LDR_AS_HDR && *is_hdr) {
        *is_hdr = 0;
        *is_srgb = image_is_linear(&images[IMAGE_COLOR], inputs->paths[IMAGE_COLOR]);
        return " (repaired: denoised as sRGB)";
    }
    if (f->kind == FINDING_NONFINITE && f->role == IMAGE_COLOR && *is_hdr &&
        drop_infinities(&images[IMAGE_COLOR]))
        return " (repaired: infinities count as 0)";
    return "";
}

void denoise_check(denoise_inputs *inputs, int *is_hdr, int *is_srgb, const denoise_settings *s,
                   json *report)
{
    const image *images = inputs->images;
    findings found;
    doctor_content content = s->is_directional ? DOCTOR_SIGNED
                             : *is_hdr         ? DOCTOR_HDR
                             : s->is_srgb      ? DOCTOR_SRGB
                                               : DOCTOR_LDR;

    doctor_examine(&found, images[IMAGE_COLOR].pixels ? &images[IMAGE_COLOR] : NULL, content,
                   images[IMAGE_ALBEDO].pixels ? &images[IMAGE_ALBEDO] : NULL,
                   images[IMAGE_NORMAL].pixels ? &images[IMAGE_NORMAL] : NULL);
    if (!s->is_panorama && !strcmp(s->filter, "RT"))
        doctor_examine_edges(&found,
                             &images[images[IMAGE_ALBEDO].pixels ? IMAGE_ALBEDO : inputs->main]);
    report_line("Checking input\n");
    if (!found.count)
        report_line("  nothing found\n");
    json_open(report, "check", '[');
    for (size_t i = 0; i < found.count; i++) {
        const finding *f = &found.list[i];
        const char *done = s->is_repairing ? repair(inputs, is_hdr, is_srgb, f) : "";
        report_line("  %s: %s%s\n", layers_role_name(f->role), f->text, done);
        json_open(report, NULL, '{');
        json_text(report, "image", layers_role_name(f->role));
        json_text(report, "kind", doctor_kind_name(f->kind));
        json_text(report, "text", f->text);
        json_bool(report, "repaired", done[0] != 0);
        json_close(report, '}');
    }
    json_close(report, ']');
}
