#include "compare.h"

#include <math.h>
#include <string.h>

uint32_t image_hash(const image *img)
{
    const unsigned char *bytes = img->pixels;
    size_t n = image_bytes(img), step = img->type == IMAGE_HALF ? 2 : 4;
    const uint16_t order = 1;
    uint32_t hash = 0x811c9dc5u;
    size_t flip = *(const unsigned char *)&order ? 0 : step - 1; /* big-endian machines */
    for (size_t i = 0; i < n; i++)
        hash = (hash ^ bytes[i ^ flip]) * 0x1000193u;
    return hash;
}

void image_compare(comparison *result, const image *expected, const image *actual, double max_error)
{
    double sum = 0;
    memset(result, 0, sizeof *result);
    result->values = image_count(actual);
    for (size_t i = 0; i < result->values; i++) {
        float e = image_get(expected, i), a = image_get(actual, i);
        float difference = fabsf(e - a);
        float relative = difference / (fabsf(e) + fabsf(a) + 0.01f);
        int is_good = max_error == 0 ? difference == 0 : difference <= 0.02f || relative <= 0.05f;
        sum += relative;
        if (is_good)
            continue;
        result->errors++;
        if (result->shown < COMPARE_SHOWN) {
            result->examples[result->shown].index = i;
            result->examples[result->shown].expected = e;
            result->examples[result->shown++].actual = a;
        }
    }
    result->average = result->values ? sum / (double)result->values : 0;
    if (!(result->average <= max_error))
        result->errors = result->values;
}

exit_code image_check_aligned(const image *img, const char *role, const char *name,
                              const image *main, const char *main_name)
{
    if (img->width != main->width || img->height != main->height)
        return report_error(EXIT_INPUT, "the %s of '%s' has %zux%zu pixels, but '%s' has %zux%zu",
                            role, name, img->width, img->height, main_name, main->width,
                            main->height);
    if (img->is_layered && main->is_layered && (img->left != main->left || img->top != main->top))
        return report_error(EXIT_INPUT,
                            "the data window of the %s of '%s' begins at %d,%d, but that of '%s' "
                            "(%s) at %d,%d",
                            role, name, img->left, img->top, main_name, main->names[0], main->left,
                            main->top);
    return EXIT_OK;
}

exit_code image_check_finite(const image *img, const char *name)
{
    if (image_is_finite(img))
        return EXIT_OK;
    return report_error(EXIT_INPUT,
                        "cannot read '%s': it has no finite value (only NaN or infinity)", name);
}

/* Mean of a pixel's channels, without those that are no numbers. */
static float brightness(const image *img, size_t pixel)
{
    float sum = 0;
    for (unsigned c = 0; c < img->channels; c++) {
        float v = image_get(img, pixel * img->channels + c);
        sum += isfinite(v) ? v : 0;
    }
    return sum / (float)img->channels;
}

/* Where the colour is brighter than any albedo it tells nothing, unless the other is that bright,
 * too. */
int image_is_light(const image *albedo, const image *color)
{
    size_t n = color->width * color->height, looked = 0, brighter = 0, bright = 0;
    if (!albedo->may_be_light || albedo->width != color->width || albedo->height != color->height)
        return 0;
    for (size_t i = 0; i < n; i++) {
        float a = brightness(albedo, i), c = brightness(color, i);
        looked += c < 1;
        brighter += c < 1 && a > 1.02f * c + 0.001f;
        bright += a > 1.02f;
    }
    return looked ? 100 * brighter < looked : bright > 0;
}
