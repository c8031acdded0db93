#include "exec_difference.h"

#include "exec.h"
#include "image.h"

#define SOME 32u /* pixels compared together */

/* n values of a main image to [0, 1], as they are displayed. */
static void show(float *values, size_t n, const lull_frame *frame, float scale)
{
    const lull_content_rule rule = lull_exec_content(frame);
    if (rule.is_signed) {
        lull_sanitize(values, n, scale, -1.0f, 1.0f);
        for (size_t i = 0; i < n; i++)
            values[i] = 0.5f * values[i] + 0.5f;
        return;
    }
    if (rule.is_hdr) {
        lull_sanitize(values, n, scale, 0.0f, LULL_FLT_MAX);
        for (size_t i = 0; i < n; i++)
            values[i] = values[i] / (1.0f + values[i]);
    } else {
        lull_sanitize(values, n, scale, 0.0f, 1.0f);
    }
    if (frame->content != LULL_SRGB)
        lull_transfer_forward(LULL_TRANSFER_SRGB, values, n);
}

static int code(float value) { return (int)(value * (float)LULL_DISPLAY_WHITE + 0.5f); }

uint64_t lull_difference(const lull_image *a, const lull_image *b, const lull_frame *frame,
                         float scale)
{
    float left[3 * SOME], right[3 * SOME];
    uint64_t sum = 0;
    for (unsigned y = 0; y < frame->height; y++)
        for (unsigned x = 0, n; x < frame->width; x += n) {
            n = lull_min_u(SOME, frame->width - x);
            lull_image_load(left, a, frame->width, x, y, n);
            lull_image_load(right, b, frame->width, x, y, n);
            show(left, 3 * (size_t)n, frame, scale);
            show(right, 3 * (size_t)n, frame, scale);
            for (unsigned i = 0; i < 3 * n; i++) {
                int distance = code(left[i]) - code(right[i]);
                sum += (uint64_t)(distance * distance);
            }
        }
    return sum;
}
