/* Outline: a tile with its halo is loaded into planes; irradiance is limited, its logarithm and
 * the variance of its noise are derived. Then for each displacement of the search window:
 * distances of all pixels, their sums over patches, weights, and a weighted addition, all as
 * loops along rows. What is summed is the difference to the pixel itself, so that flat areas
 * come back unchanged. */
#include "nlm.h"

#include <float.h>

#include "image.h"
#include "transfer.h"

#define SEARCH 8
#define PATCH 2
#define VARIANCE 3 /* radius of the windows of search, patch and variance */
#define HALO (SEARCH + PATCH + VARIANCE + 2) /* one for second differences, one for fireflies */
#define WIDTH ((int)LULL_NLM_TILE_WIDTH)
#define HEIGHT ((int)LULL_NLM_TILE_HEIGHT)
#define STRIDE (WIDTH + 2 * HALO) /* of the planes */
#define ROWS (HEIGHT + 2 * HALO)
#define PATCHED_WIDTH (WIDTH + 2 * PATCH)
#define PATCHED_HEIGHT (HEIGHT + 2 * PATCH)

#define DARK_ALBEDO 0.02f   /* added to albedo, so that black surfaces keep their radiance */
#define BRIGHTEST 1e30f     /* of exposed radiance; sums stay finite */
#define FIREFLY 3.0f        /* times the second brightest neighbour */
#define FLOOR 1e-3f         /* irradiance that is never a firefly */
#define MIN_VARIANCE 4e-8f  /* e of the formula, in units of the log transfer function, squared */
#define ALBEDO_WEIGHT 25.0f /* 1 / 0.2^2 */
#define NORMAL_WEIGHT 4.0f  /* 1 / 0.5^2 */
#define SPACE_WEIGHT 0.01f
#define CUT 8.0f
#define SMALLEST 0x1p-10f /* of 1 - t/8: its eighth power is no subnormal */

/* Second differences have 1.5 times the variance of the noise; the lesser of two squared ones of
 * a normal distribution is 0.363 of their mean. The latter is allowed for by 1.57 only: noise of
 * renders has heavy tails. */
#define SECOND_DIFFERENCE (1.57f / 1.5f / 3.0f) /* and the mean of three channels */

typedef float plane[ROWS * STRIDE];

typedef struct workspace {
    plane light[3];   /* exposed irradiance */
    plane guide[3];   /* its log */
    plane feature[6]; /* albedo, normal */
    plane variance, squares;
    float line[3 * STRIDE];                          /* pixels of a row as they are loaded */
    float distance[PATCHED_HEIGHT * PATCHED_WIDTH]; /* of pixels */
    float across[PATCHED_HEIGHT * WIDTH];           /* summed along x over patches */
    float sum[3][HEIGHT * WIDTH], weight[HEIGHT * WIDTH];
} workspace;

/* The tile: its pixels in the image, and which features there are. */
typedef struct area {
    int x, y, width, height; /* of the tile itself */
    int image_width, image_height;
    int has_albedo, has_normal;
} area;

/* Position of (x, y) of the tile in a plane; the halo has negative coordinates. */
LULL_INLINE int at(int x, int y) { return (y + HALO) * STRIDE + x + HALO; }

/* Index i mirrored into [0, n), without repeating the edge. */
static int mirror(int i, int n)
{
    int period = 2 * n - 2;
    if (n == 1)
        return 0;
    i %= period;
    if (i < 0)
        i += period;
    return i < n ? i : period - i;
}

/* v, or 0 where v is not above `least` >= 0; without a branch, so that loops around it are
 * vectorised. */
LULL_INLINE float above(float v, float least)
{
    uint32_t keep = 0u - (uint32_t)((int32_t)lull_bits(v) > (int32_t)lull_bits(least));
    return lull_float(lull_bits(v) & keep);
}

/* ---- Loading --------------------------------------------------------------------------------- */

/* Three planes of an image around the tile, mirrored at the edges, scaled and clamped. */
static void load_planes(plane *planes, float *line, const lull_image *image, const area *a,
                        float scale, float lo, float hi)
{
    int first = a->x < HALO ? 0 : a->x - HALO, x, y, c;
    int last = a->x + a->width + HALO;
    last = last < a->image_width ? last : a->image_width;
    for (y = -HALO; y < a->height + HALO; ++y) {
        unsigned row = (unsigned)mirror(a->y + y, a->image_height);
        lull_image_load(line, image, (unsigned)a->image_width, (unsigned)first, row,
                        (unsigned)(last - first));
        lull_sanitize(line, 3 * (size_t)(last - first), scale, lo, hi);
        for (x = -HALO; x < a->width + HALO; ++x) {
            const float *pixel = line + 3 * (mirror(a->x + x, a->image_width) - first);
            for (c = 0; c < 3; ++c)
                planes[c][at(x, y)] = pixel[c];
        }
    }
}

/* What radiance is divided by. */
LULL_INLINE float divisor(float albedo) { return (albedo + DARK_ALBEDO) * (1 / (1 + DARK_ALBEDO)); }

static void divide_by_albedo(workspace *w, const area *a)
{
    int x, y, c;
    for (c = 0; c < 3; ++c)
        for (y = -HALO; y < a->height + HALO; ++y)
            for (x = -HALO; x < a->width + HALO; ++x)
                w->light[c][at(x, y)] /= divisor(w->feature[c][at(x, y)]);
}

/* Limits the sum of the channels to FIREFLY times the second largest of the eight neighbours.
 * `squares` holds the sums, so that limited pixels do not limit others. */
static void limit_fireflies(workspace *w, const area *a)
{
    static const int neighbours[8] = {-STRIDE - 1, -STRIDE, -STRIDE + 1, -1,
                                      1,           STRIDE - 1, STRIDE, STRIDE + 1};
    int x, y, i;
    for (y = -HALO; y < a->height + HALO; ++y)
        for (x = -HALO; x < a->width + HALO; ++x) {
            int p = at(x, y);
            w->squares[p] = (w->light[0][p] + w->light[1][p]) + w->light[2][p];
        }
    for (y = 1 - HALO; y < a->height + HALO - 1; ++y)
        for (x = 1 - HALO; x < a->width + HALO - 1; ++x) {
            int p = at(x, y);
            float largest = 0, second = 0, limit, factor;
            for (i = 0; i < 8; ++i) {
                float v = w->squares[p + neighbours[i]], less = v < largest ? v : largest;
                largest = v > largest ? v : largest;
                second = less > second ? less : second;
            }
            limit = second * FIREFLY + FLOOR;
            if (w->squares[p] > limit) {
                factor = limit / w->squares[p];
                for (i = 0; i < 3; ++i)
                    w->light[i][p] *= factor;
            }
        }
}

/* Squared second difference, the lesser of x and y. */
LULL_INLINE float second_difference(const float *g)
{
    float x = g[0] - 0.5f * (g[-1] + g[1]);
    float y = g[0] - 0.5f * (g[-STRIDE] + g[STRIDE]);
    x *= x;
    y *= y;
    return x < y ? x : y;
}

/* The guide and the variance of its noise, as far out as the search reaches. */
static void estimate_noise(workspace *w, const area *a)
{
    const int reach = SEARCH + PATCH, wide = reach + VARIANCE;
    int x, y, c, i;
    for (c = 0; c < 3; ++c) {
        for (i = 0; i < ROWS * STRIDE; ++i)
            w->guide[c][i] = 4.0f * w->light[c][i];
        lull_transfer_forward(LULL_TRANSFER_LOG, w->guide[c], ROWS * STRIDE);
    }
    for (y = -wide; y < a->height + wide; ++y)
        for (x = -wide; x < a->width + wide; ++x) {
            int p = at(x, y);
            w->squares[p] = SECOND_DIFFERENCE * ((second_difference(w->guide[0] + p)
                                                  + second_difference(w->guide[1] + p))
                                                 + second_difference(w->guide[2] + p));
        }
    for (y = -reach; y < a->height + reach; ++y) {
        for (x = -wide; x < a->width + wide; ++x) {
            const float *s = w->squares + at(x, y);
            w->line[x + wide] = ((s[-3 * STRIDE] + s[-2 * STRIDE]) + (s[-STRIDE] + s[0]))
                                + ((s[STRIDE] + s[2 * STRIDE]) + s[3 * STRIDE]);
        }
        for (x = -reach; x < a->width + reach; ++x) {
            const float *s = w->line + (x + wide);
            w->variance[at(x, y)] =
                (((s[-3] + s[-2]) + (s[-1] + s[0])) + ((s[1] + s[2]) + s[3])) * (1.0f / 49.0f);
        }
    }
}

static void load(workspace *w, const lull_nlm *job, const area *a)
{
    load_planes(w->light, w->line, &job->color, a, job->scale, 0.0f, BRIGHTEST);
    if (a->has_albedo) {
        load_planes(w->feature, w->line, &job->albedo, a, 1.0f, 0.0f, 1.0f);
        divide_by_albedo(w, a);
    }
    if (a->has_normal)
        load_planes(w->feature + 3, w->line, &job->normal, a, 1.0f, -1.0f, 1.0f);
    limit_fireflies(w, a);
    estimate_noise(w, a);
}

/* ---- Filtering ------------------------------------------------------------------------------- */

/* Distances between the pixels p of a row and those `shift` elements further, less their noise. */
static void distance_row(float *LULL_RESTRICT out, const workspace *w, int p, int shift, int n,
                         float strength)
{
    const float *g0 = w->guide[0] + p, *g1 = w->guide[1] + p, *g2 = w->guide[2] + p;
    const float *v = w->variance + p;
    int i;
    for (i = 0; i < n; ++i) {
        float a = g0[i] - g0[i + shift], b = g1[i] - g1[i + shift], c = g2[i] - g2[i + shift];
        float vp = v[i], vq = v[i + shift], least = vp < vq ? vp : vq;
        out[i] = (((a * a + b * b) + c * c) * (1.0f / 3.0f) - (vp + least))
                 / (MIN_VARIANCE + strength * (vp + vq));
    }
}

/* Squared distances in three feature planes, added to out. */
static void feature_row(float *LULL_RESTRICT out, const plane *planes, int p, int shift, int n,
                        float weight)
{
    const float *f0 = planes[0] + p, *f1 = planes[1] + p, *f2 = planes[2] + p;
    int i;
    for (i = 0; i < n; ++i) {
        float a = f0[i] - f0[i + shift], b = f1[i] - f1[i + shift], c = f2[i] - f2[i + shift];
        out[i] += ((a * a + b * b) + c * c) * weight;
    }
}

/* Weights from exponents t: (1 - t/8)^8, and the additions that they make. */
static void add_row(workspace *w, int at_sum, int p, int shift, int n, const float *t)
{
    float *LULL_RESTRICT weight = w->weight + at_sum;
    float *LULL_RESTRICT s0 = w->sum[0] + at_sum, *LULL_RESTRICT s1 = w->sum[1] + at_sum;
    float *LULL_RESTRICT s2 = w->sum[2] + at_sum;
    const float *l0 = w->light[0] + p, *l1 = w->light[1] + p, *l2 = w->light[2] + p;
    int i;
    for (i = 0; i < n; ++i) {
        float u = above(1.0f - t[i] * (1.0f / CUT), SMALLEST);
        u *= u;
        u *= u;
        u *= u;
        weight[i] += u;
        s0[i] += u * (l0[i + shift] - l0[i]);
        s1[i] += u * (l1[i + shift] - l1[i]);
        s2[i] += u * (l2[i + shift] - l2[i]);
    }
}

/* One displacement: the pixels of the tile whose partner is inside the image. */
static void add_displacement(workspace *w, const area *a, int dx, int dy, float strength)
{
    int x0 = a->x + dx < 0 ? -(a->x + dx) : 0, y0 = a->y + dy < 0 ? -(a->y + dy) : 0;
    int x1 = a->image_width - a->x - dx, y1 = a->image_height - a->y - dy;
    int shift = dy * STRIDE + dx, x, y, n;
    float space = SPACE_WEIGHT * (float)(dx * dx + dy * dy);
    x1 = x1 < a->width ? x1 : a->width;
    y1 = y1 < a->height ? y1 : a->height;
    n = x1 - x0;
    if (n <= 0 || y1 <= y0)
        return;
    for (y = y0; y < y1 + 2 * PATCH; ++y) {
        const float *d = w->distance;
        float *across = w->across + y * WIDTH;
        distance_row(w->distance, w, at(x0 - PATCH, y - PATCH), shift, n + 2 * PATCH, strength);
        for (x = 0; x < n; ++x)
            across[x] = ((d[x] + d[x + 1]) + (d[x + 3] + d[x + 4])) + d[x + 2];
    }
    for (y = y0; y < y1; ++y) {
        const float *s = w->across + y * WIDTH;
        float *t = w->distance;
        for (x = 0; x < n; ++x) {
            float v = ((s[x] + s[x + WIDTH]) + (s[x + 3 * WIDTH] + s[x + 4 * WIDTH]))
                      + s[x + 2 * WIDTH];
            t[x] = above(v, 0.0f) * (1.0f / 25.0f) + space;
        }
        if (a->has_albedo)
            feature_row(t, w->feature, at(x0, y), shift, n, ALBEDO_WEIGHT);
        if (a->has_normal)
            feature_row(t, w->feature + 3, at(x0, y), shift, n, NORMAL_WEIGHT);
        add_row(w, y * WIDTH + x0, at(x0, y), shift, n, t);
    }
}

/* ---- Storing --------------------------------------------------------------------------------- */

/* Adds the mean difference to the pixel, in units of radiance. A pixel that was not limited
 * starts from its own bits, so that it stays as it is where there is nothing to add. */
static void store(workspace *w, const lull_nlm *job, const area *a)
{
    float back = 1.0f / job->scale;
    int x, y, c;
    for (y = 0; y < a->height; ++y) {
        unsigned row = (unsigned)(a->y + y);
        lull_image_load(w->line, &job->color, job->width, (unsigned)a->x, row, (unsigned)a->width);
        lull_sanitize(w->line, 3 * (size_t)a->width, 1.0f, 0.0f, FLT_MAX);
        for (x = 0; x < a->width; ++x)
            for (c = 0; c < 3; ++c) {
                int p = at(x, y), s = y * WIDTH + x;
                float albedo = a->has_albedo ? divisor(w->feature[c][p]) : 1.0f;
                float radiance = w->line[3 * x + c], own = w->light[c][p];
                float change = w->sum[c][s] / w->weight[s], v;
                int is_limited = own < radiance * job->scale / albedo;
                v = is_limited ? (own + change) * albedo * back : radiance + change * albedo * back;
                w->line[3 * x + c] = v;
            }
        lull_sanitize(w->line, 3 * (size_t)a->width, 1.0f, 0.0f, FLT_MAX);
        lull_image_store(&job->output, job->width, (unsigned)a->x, row, (unsigned)a->width,
                         w->line);
    }
}

/* ---- Interface ------------------------------------------------------------------------------- */

static unsigned tiles(unsigned size, unsigned tile) { return size / tile + (size % tile != 0); }

unsigned lull_nlm_columns(unsigned width) { return tiles(width, LULL_NLM_TILE_WIDTH); }
unsigned lull_nlm_rows(unsigned height) { return tiles(height, LULL_NLM_TILE_HEIGHT); }

size_t lull_nlm_bytes(void) { return lull_align_up(sizeof(workspace), LULL_ALIGN); }

static int is_image(const lull_image *image)
{
    return image->channels >= 1 && image->channels <= 3 && (unsigned)image->type <= LULL_F16;
}

lull_status lull_nlm_check(const lull_nlm *job)
{
    if (job == NULL || job->width > LULL_MAX_SIZE || job->height > LULL_MAX_SIZE
        || !(job->scale > 0.0f && job->scale <= FLT_MAX)
        || !(job->strength > 0.0f && job->strength <= 1000.0f))
        return LULL_ERROR_ARGUMENT;
    if (job->width == 0 || job->height == 0)
        return LULL_OK;
    if (job->color.data == NULL || job->output.data == NULL || !is_image(&job->color)
        || !is_image(&job->output) || (job->albedo.data && !is_image(&job->albedo))
        || (job->normal.data && !is_image(&job->normal)))
        return LULL_ERROR_IMAGE;
    return LULL_OK;
}

void lull_nlm_tile(const lull_nlm *job, unsigned column, unsigned row, void *memory)
{
    workspace *w = memory;
    area a;
    int dx, dy, width = (int)job->width, height = (int)job->height;
    a.x = (int)(column * LULL_NLM_TILE_WIDTH);
    a.y = (int)(row * LULL_NLM_TILE_HEIGHT);
    a.width = width - a.x < WIDTH ? width - a.x : WIDTH;
    a.height = height - a.y < HEIGHT ? height - a.y : HEIGHT;
    a.image_width = width;
    a.image_height = height;
    a.has_albedo = job->albedo.data != NULL;
    a.has_normal = job->normal.data != NULL;
    memset(w, 0, sizeof *w);
    load(w, job, &a);
    for (dy = -SEARCH; dy <= SEARCH; ++dy)
        for (dx = -SEARCH; dx <= SEARCH; ++dx)
            add_displacement(w, &a, dx, dy, job->strength * job->strength);
    store(w, job, &a);
}
