/* The last steps of family K's filter (docs/kernel-prediction.md, steps 6 to 9): averages along
 * surfaces whose light is even, and along edges, and light that the result lacks. Models have them
 * whose files ask for them.
 *
 * noise: codes, whole numbers of at most 255, of pixels' noise: LULL_NOISE_CODES (D / (C (F +
 *     LULL_NOISE_EPSILON))) + 0.5, where D = (|V(r) - C f(r)| + |V(g) - C f(g)|) + |V(b) - C f(b)|
 *     and F = (f(r) + f(g)) + f(b). v: planes (C, V), confident radiance; f: 3 planes, filtered.
 *     255 where that is no number (C = 0).
 *
 * bilateral: the smoothed result of pixels all of whose columns, up to LULL_BILATERAL_REACH, or
 *     LULL_BILATERAL_FAR if is_far, to either side, are there (of the noise one to either side).
 *     First those of lull_bilateral_column count, then the rows of `beside`, in their order.
 *
 * fit_sums: adds what n pixels make of the sums of their cells to LULL_FIT_SUMS planes of sums:
 *     lull_fit_products of p(c) = v(c) smooth(c), R(c) and lull_fit_features.
 *
 * fit: coefficients of cells, LULL_FIT_COEFFICIENTS planes: lull_fit of sums over the cells of
 *     three rows (above, here, below), from cell -1 to cell `cells`, weighted by 1, 2, 1: first
 *     (above + below) + 2 here in each column, then of columns alike. work: LULL_FIT_WORK floats of
 *     memory, aligned.
 *
 * regress: lull_regressed of pixels, the first of which is the first of its cell. Coefficients of
 *     cell 1 are those at its centre, of cell 0 those of the cell before; between two centres b + t
 *     (b' - b), t = lull_cell_part. LULL_FIT_ROOM(pixels) cells are there, whether needed or not.
 *
 * residual: adds what n pixels make of their cell's balance to planes of sums. With V = (v(r)
 *     smooth(r) + v(g) smooth(g)) + v(b) smooth(b), R = (R(r) + R(g)) + R(b), L = V +
 *     LULL_BALANCE_EPSILON and q = (R - V) (1 / L), or max(2 LULL_MOST_LACKING - q, 0) if that is
 *     less: q, q q, (V (1 / L)) w, where w = min(noise code * LULL_NOISE_SHARE, 1), and
 *     min(max(q - LULL_SPARK, 0), 1), a count of sparks; 4 planes.
 *
 * edges: with P = max(v smooth, 0), light L = (P(r) + P(g)) + P(b), and of the lines left and
 *     right, above and below, above left and below right, above right and below left the first that
 *     changes least (lull_edge_change), whose ends are a and b: S(P + share ((P(a) + P(b)) - (P +
 *     P)), 1, 0, FLT_MAX) unscale (kernels.h), lull_edge_share of the least and the most that one
 *     changes. Columns and rows on all sides are there; out is an image.
 */
#ifndef LULL_BILATERAL_H
#define LULL_BILATERAL_H

#include "pixels.h"

/* Columns to either side in the cells whose gains a correction reads, and whose coefficients a
 * regression. */
#define LULL_GAIN_REACH 24u
#define LULL_FIT_REACH 12u

/* A row of the result, 3 planes, `plane` floats apart, and its guide (kernels.h). */
typedef struct lull_surface {
    const float *v;
    const uint8_t *guide;
    size_t plane;
} lull_surface;

typedef struct lull_smoothing {
    float *out; /* 3 planes */
    const uint8_t *noise;
    size_t out_plane;
    lull_surface row, beside[8]; /* row y; y -+ lull_bilateral_away, or the nearest there is */
    int is_far;                  /* 1: with the pixels farthest away, else they need not be there */
    unsigned pixels;
} lull_smoothing;

/* How far the columns lie away that a smoothing looks at, and how far rows 2k and 2k + 1 of
 * `beside`, above and below. */
static const int8_t lull_bilateral_column[] = {-LULL_BILATERAL_REACH, -2, 2, LULL_BILATERAL_REACH,
                                               -LULL_BILATERAL_FAR, LULL_BILATERAL_FAR, -4, 4};
static const uint8_t lull_bilateral_away[] = {2, 4, LULL_BILATERAL_REACH, LULL_BILATERAL_FAR};

/* Columns to either side. */
LULL_INLINE int lull_bilateral_reach(int is_far)
{
    return is_far ? LULL_BILATERAL_FAR : LULL_BILATERAL_REACH;
}

/* Pixels of a row of the smoothed result, their divisor and filtered normal, 3 planes each, and the
 * sums of their cells, as columns, or their coefficients. */
typedef struct lull_fitting {
    float *sums;
    const float *v, *smooth, *normal;
    size_t sum_plane, v_plane, smooth_plane, normal_plane;
    unsigned pixels;
} lull_fitting;

#define LULL_FIT_WORK (16u * (3u + 2u * LULL_FIT_FEATURES) * LULL_FIT_FEATURES)
#define LULL_FIT_ROOM(pixels) ((pixels) / LULL_FIT_SIDE + 4)

typedef struct lull_regression {
    float *out; /* 3 planes */
    const float *v, *smooth, *normal, *coefficients;
    size_t out_plane, v_plane, smooth_plane, normal_plane, plane; /* plane: of the coefficients */
    unsigned pixels;
} lull_regression;

/* Pixels of a row of the result, and rows above and below, 3 planes each, and of the divisor. */
typedef struct lull_edging {
    float *out; /* an image */
    const float *v[3], *smooth[3];
    size_t v_plane, smooth_plane;
    float strength, unscale;
    unsigned pixels;
} lull_edging;

/* Lines through a pixel, to (x, y) and (-x, -y). */
#define LULL_EDGE_LINES 4u
static const int8_t lull_edge_lines[LULL_EDGE_LINES][2] = {{1, 0}, {0, 1}, {1, 1}, {-1, 1}};

/* Pixel i alone: for the last ones of a row, which are no vector (filter.c). */
void lull_edge_pixel(const lull_edging *edging, ptrdiff_t i);

/* Pixels of a row of the smoothed result, 3 planes, and what belongs to them; sums lie in planes,
 * sum_plane apart. */
typedef struct lull_balance {
    float *sums;
    const float *v, *smooth;
    const uint8_t *noise;
    size_t sum_plane, v_plane, smooth_plane;
    unsigned pixels;
} lull_balance;

#endif
