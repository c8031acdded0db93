/* The regression of family K's filter. */
#include "port_scalar.h"

/* Features of pixel i, and its divisor. */
static void get_features(float *f, float *divisor, const float *normal, size_t normal_plane,
                         const float *smooth, size_t smooth_plane, size_t i)
{
    float facing[3];
    for (size_t c = 0; c < 3; c++) {
        facing[c] = normal[c * normal_plane + i];
        divisor[c] = smooth[c * smooth_plane + i];
    }
    lull_fit_features(f, facing, divisor);
}

void lull_fit_sums_scalar(const lull_fitting *at, const lull_encoding *from)
{
    for (size_t i = 0; i < at->pixels; i++) {
        float f[LULL_FIT_FEATURES], s[3], p[3], r[3], sums[LULL_FIT_SUMS];
        get_features(f, s, at->normal, at->normal_plane, at->smooth, at->smooth_plane, i);
        for (size_t c = 0; c < 3; c++) {
            p[c] = at->v[c * at->v_plane + i] * s[c];
            r[c] = lull_sane(from->radiance[3 * i + c], from->scale, 0.0f, from->most);
        }
        lull_fit_products(sums, p, r, f);
        for (size_t k = 0; k < LULL_FIT_SUMS; k++)
            at->sums[k * at->sum_plane + i] += sums[k];
    }
}

/* Sum k of three rows of a column, weighted. */
static float column_at(const float *const *rows, ptrdiff_t at)
{
    return (rows[0][at] + rows[2][at]) + 2.0f * rows[1][at];
}

void lull_fit_scalar(float *out, size_t out_plane, const float *const *rows, size_t plane,
                     unsigned cells, float *work)
{
    (void)work;
    for (size_t i = 0; i < cells; i++, out++) {
        float sums[LULL_FIT_SUMS], b[LULL_FIT_COEFFICIENTS];
        for (size_t k = 0; k < LULL_FIT_SUMS; k++) {
            ptrdiff_t at = (ptrdiff_t)(k * plane + i);
            sums[k] = (column_at(rows, at - 1) + column_at(rows, at + 1)) +
                      2.0f * column_at(rows, at);
        }
        lull_fit(b, sums);
        for (size_t k = 0; k < LULL_FIT_COEFFICIENTS; k++)
            out[k * out_plane] = b[k];
    }
}

void lull_regress_scalar(const lull_regression *r)
{
    for (size_t i = 0; i < r->pixels; i++) {
        const float *cell = r->coefficients + (i + LULL_FIT_SIDE / 2) / LULL_FIT_SIDE;
        float f[LULL_FIT_FEATURES], s[3], b[LULL_FIT_COEFFICIENTS];
        float part = lull_cell_part(LULL_FIT_SIDE, (int)i);
        get_features(f, s, r->normal, r->normal_plane, r->smooth, r->smooth_plane, i);
        for (size_t k = 0; k < LULL_FIT_COEFFICIENTS; k++, cell += r->plane)
            b[k] = cell[0] + part * (cell[1] - cell[0]);
        for (size_t c = 0; c < 3; c++)
            r->out[c * r->out_plane + i] = lull_regressed(r->v[c * r->v_plane + i], f, b + c);
    }
}
