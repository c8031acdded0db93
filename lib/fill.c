/* Filling the texels of light maps that belong to no surface (lull_fill).
 *
 * Nearest ones are found in two sweeps, down and up, in which each texel looks at what its
 * neighbours behind found ("8SED": P.-E. Danielsson, "Euclidean distance mapping", Computer
 * Graphics and Image Processing 14, 1980): now and then one is taken that is less than a texel
 * farther than the nearest. */
#include "image.h"

/* Texels loaded together. */
#define SOME 64u

/* A texel with a surface, and what stands where none is known. */
typedef struct texel {
    uint16_t x, y;
} texel;

static const texel nowhere = {UINT16_MAX, UINT16_MAX};

static int is_somewhere(texel t) { return t.x != nowhere.x || t.y != nowhere.y; }

static int64_t square(unsigned a, unsigned b)
{
    const int64_t d = (int64_t)a - b;

    return d * d;
}

/* Makes *at, which is for (x, y), the nearer of itself and `other`. */
static void take_nearer(texel *at, texel other, unsigned x, unsigned y)
{
    if (is_somewhere(other) && (!is_somewhere(*at) || square(other.x, x) + square(other.y, y) <
                                                          square(at->x, x) + square(at->y, y)))
        *at = other;
}

/* A row by the one before it, NULL for none, and by itself in both directions. */
static void sweep_row(texel *row, const texel *before, unsigned width, unsigned y)
{
    unsigned x, k;

    for (x = 0; x < width; x++) {
        for (k = x ? x - 1 : 0; before && k < lull_min_u(x + 2, width); k++)
            take_nearer(&row[x], before[k], x, y);
        if (x)
            take_nearer(&row[x], row[x - 1], x, y);
    }
    for (x = width - 1; x-- > 0;)
        take_nearer(&row[x], row[x + 1], x, y);
}

/* Which texels have a surface: their normal is not 0. */
static void find_surfaces(texel *nearest, const lull_image *normal, unsigned width, unsigned height)
{
    float block[3 * SOME];
    unsigned x, y, n, i;

    for (y = 0; y < height; y++)
        for (x = 0; x < width; x += n) {
            n = lull_min_u(SOME, width - x);
            lull_image_load(block, normal, width, x, y, n);
            for (i = 0; i < n; i++) {
                const float *v = block + 3 * i;
                const int has_surface = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] > 0.0f;
                const texel own = {(uint16_t)(x + i), (uint16_t)y};

                nearest[(size_t)y * width + x + i] = has_surface ? own : nowhere;
            }
        }
}

/* Light of a row, from where `nearest` says. */
static void fill_row(const lull_image *output, const lull_image *color, const texel *nearest,
                     unsigned width, unsigned y)
{
    float block[3 * SOME];
    unsigned x, n, i;

    for (x = 0; x < width; x += n) {
        n = lull_min_u(SOME, width - x);
        lull_image_load(block, color, width, x, y, n);
        for (i = 0; i < n; i++) {
            const texel from = nearest[x + i];

            if (is_somewhere(from) && (from.x != x + i || from.y != y))
                lull_image_load(block + 3 * i, color, width, from.x, from.y, 1);
        }
        lull_image_store(output, width, x, y, n, block);
    }
}

size_t lull_fill_size(unsigned width, unsigned height)
{
    if (!width || !height || width > LULL_MAX_SIZE || height > LULL_MAX_SIZE ||
        (uint64_t)width * height > SIZE_MAX / sizeof(texel))
        return 0;
    return (size_t)width * height * sizeof(texel);
}

lull_status lull_fill(const lull_image *output, const lull_image *color, const lull_image *normal,
                      unsigned width, unsigned height, void *memory, size_t memory_bytes)
{
    texel *nearest = memory;
    const size_t bytes = lull_fill_size(width, height);
    unsigned y;

    if (!output || !color || !normal || !memory || !bytes)
        return LULL_ERROR_ARGUMENT;
    if (!output->data || !color->data || !normal->data || output->channels != color->channels)
        return LULL_ERROR_IMAGE;
    if (memory_bytes < bytes)
        return LULL_ERROR_MEMORY;
    find_surfaces(nearest, normal, width, height);
    for (y = 0; y < height; y++)
        sweep_row(nearest + (size_t)y * width, y ? nearest + (size_t)(y - 1) * width : NULL, width,
                  y);
    for (y = height - 1; y-- > 0;)
        sweep_row(nearest + (size_t)y * width, nearest + (size_t)(y + 1) * width, width, y);
    for (y = 0; y < height; y++)
        fill_row(output, color, nearest + (size_t)y * width, width, y);
    return LULL_OK;
}
