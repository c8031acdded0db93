/* The filter of family K beside its 5x5 sums. */
#include "port_scalar.h"

static float radiance_at(const lull_encoding *from, size_t i)
{
    return lull_sane(from->radiance[i], from->scale, 0.0f, from->most);
}

/* Albedo of a pixel, as it counts. */
static void get_albedo(float *a, const float *pixel)
{
    for (unsigned c = 0; c < 3; c++)
        a[c] = pixel[c];
    lull_sane_albedo(a);
}

void lull_encode_scalar(uint8_t *codes, const lull_encoding *from, unsigned pixels)
{
    const float *albedo = from->albedo, *normal = from->normal, none = 1.0f - LULL_FILTER_EPSILON;
    for (size_t i = 0; i < pixels; i++, codes += LULL_CODES) {
        float a[3] = {none, none, none}, share[3];
        if (albedo)
            get_albedo(a, albedo + 3 * i);
        for (size_t c = 0; c < 3; c++)
            share[c] = a[c] + LULL_FILTER_EPSILON;
        lull_shares(share, 1.0f, 1.0f);
        for (size_t at = 3 * i, c = 0; c < 3; at++, c++) {
            codes[c] = lull_radiance_code(radiance_at(from, at) * share[c]);
            codes[3 + c] = albedo ? lull_to_code(a[c] * 255.0f) : 0;
            codes[6 + c] = normal ? lull_normal_code(normal[at]) : 128;
            codes[9 + c] = (uint8_t)(from->flags >> 8 * c);
        }
    }
}

void lull_guide_scalar(uint8_t *guide, const float *albedo, const float *normal, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, guide += 2) {
        int q[3] = {0, 0, 0};
        float a[3];
        if (!normal && albedo)
            get_albedo(a, albedo + 3 * i);
        for (size_t c = 0; c < 3 && (normal || albedo); c++)
            q[c] = normal ? lull_normal_code(normal[3 * i + c]) : lull_to_code(a[c] * 255.0f);
        if (normal)
            lull_guide_of_normal(guide, q);
        else
            lull_guide_of_albedo(guide, q);
    }
}

void lull_spread_scalar(float *out, size_t plane, const float *albedo, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, albedo += 3) {
        float a[3];
        get_albedo(a, albedo);
        out[i] = 1.0f;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = a[c];
    }
}

void lull_spread_xyz_scalar(float *out, size_t plane, const float *normal, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, normal += 3) {
        out[i] = 1.0f;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = lull_sane(normal[c], 1.0f, -1.0f, 1.0f);
    }
}

void lull_demodulate_scalar(float *out, size_t plane, const lull_encoding *from,
                            const float *smooth, size_t smooth_plane, const uint8_t *codes,
                            size_t code_step, const float *table, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        float confidence = table[codes[i * code_step]], share[3];
        for (size_t c = 0; c < 3; c++)
            share[c] = smooth[c * smooth_plane + i];
        lull_shares(share, 1.0f, 1.0f);
        out[i] = confidence;
        for (size_t c = 0; c < 3; c++)
            out[(1 + c) * plane + i] = confidence * (radiance_at(from, 3 * i + c) * share[c]);
    }
}

void lull_shrink_scalar(float *out, size_t out_plane, const float *above, const float *below,
                        size_t plane, const uint8_t *codes, size_t code_step, const float *table,
                        unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        const float *a = above + 2 * i, *b = below + 2 * i;
        float weight = ((a[0] + a[1]) + b[0]) + b[1];
        float confidence = table[codes[i * code_step]];
        out[i] = weight > 0.0f ? confidence : 0.0f;
        for (size_t c = 1; c < 4; c++) {
            float sum = ((a[c * plane] + a[c * plane + 1]) + b[c * plane]) + b[c * plane + 1];
            out[c * out_plane + i] = weight > 0.0f ? confidence * (sum * (1.0f / weight)) : 0.0f;
        }
    }
}

void lull_blend_scalar(const lull_blending *b)
{
    for (size_t c = 0; c < 3; c++) {
        const float *near = b->near + c * b->coarse_plane, *far = b->far + c * b->coarse_plane;
        for (size_t i = 0; i < 2 * (size_t)b->pairs; i++) {
            ptrdiff_t at = (ptrdiff_t)(i / 2), beside = i & 1 ? at + 1 : at - 1;
            b->out[c * b->out_plane + i] =
                lull_blended(b->fine[c * b->fine_plane + i], b->table[b->codes[i]], near[at],
                             far[at], near[beside], far[beside]);
        }
    }
}

void lull_modulate_scalar(float *out, const float *v, size_t plane, const float *smooth,
                          size_t smooth_plane, float unscale, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++, out += 3)
        for (size_t c = 0; c < 3; c++)
            out[c] = lull_sane(v[c * plane + i] * smooth[c * smooth_plane + i], 1.0f, 0.0f,
                               LULL_LARGEST) *
                     unscale;
}

void lull_luminance_scalar(float *sums, const float *pixels, unsigned n)
{
    for (unsigned i = 0; i < n; i++, pixels += 3) {
        float v[3];
        for (unsigned c = 0; c < 3; c++)
            v[c] = lull_sane(pixels[c], 1.0f, 0.0f, LULL_LARGEST);
        sums[i] += (0.212671f * v[0] + 0.715160f * v[1]) + 0.072169f * v[2];
    }
}

void lull_noise_scalar(uint8_t *noise, const float *v, size_t plane, const float *f,
                       size_t f_plane, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        float confident[4], mean[3];
        for (size_t c = 0; c < 4; c++)
            confident[c] = v[c * plane + i];
        for (size_t c = 0; c < 3; c++)
            mean[c] = f[c * f_plane + i];
        noise[i] = lull_noise_code(confident, mean);
    }
}

void lull_residual_scalar(const lull_balance *b, const lull_encoding *from)
{
    for (size_t i = 0; i < b->pixels; i++) {
        float p[3], r[3], sums[LULL_CELL_SUMS];
        for (size_t c = 0; c < 3; c++) {
            p[c] = b->v[c * b->v_plane + i] * b->smooth[c * b->smooth_plane + i];
            r[c] = radiance_at(from, 3 * i + c);
        }
        lull_balance_of(sums, p, r, b->noise[i]);
        for (size_t c = 0; c < LULL_CELL_SUMS; c++)
            b->sums[c * b->sum_plane + i] += sums[c];
    }
}

/* The weight of pixel j of `other` for pixel i of `row`, g being what differences of its channels
 * count. Those go to `change`. */
static float weight_of(const lull_surface *row, ptrdiff_t i, const lull_surface *other, ptrdiff_t j,
                       const float *g, float *change)
{
    int a = other->guide[2 * j] - row->guide[2 * i];
    int b = other->guide[2 * j + 1] - row->guide[2 * i + 1];
    for (ptrdiff_t c = 0; c < 3; c++)
        change[c] = other->v[c * (ptrdiff_t)other->plane + j] -
                    row->v[c * (ptrdiff_t)row->plane + i];
    return lull_smoothing_weight(change, g, a, b);
}

void lull_bilateral_scalar(const lull_smoothing *s)
{
    const unsigned columns = lull_bilateral_columns(s->is_far);
    const unsigned all = columns + lull_bilateral_rows(s->is_far);
    const lull_surface *const row = &s->row;
    for (ptrdiff_t i = 0; i < (ptrdiff_t)s->pixels; i++) {
        const uint8_t *noise = s->noise + i;
        const float *v = row->v + i;
        float here[3], g[3], change[3], sum[3] = {0.0f, 0.0f, 0.0f};
        float weights = lull_smoothing_own(s->is_far);
        for (size_t c = 0; c < 3; c++)
            here[c] = v[c * row->plane];
        lull_smoothing_factors(g, here, noise[-1] + noise[0] + noise[1], s->is_far);
        for (unsigned k = 0; k < all; k++) {
            float w = k < columns
                          ? weight_of(row, i, row, i + lull_bilateral_column[k], g, change)
                          : weight_of(row, i, &s->beside[k - columns], i, g, change);
            weights += w;
            for (unsigned c = 0; c < 3; c++)
                sum[c] += w * change[c];
        }
        for (size_t c = 0; c < 3; c++)
            s->out[c * s->out_plane + (size_t)i] = here[c] + sum[c] * (1.0f / weights);
    }
}

void lull_edges_scalar(const lull_edging *edging)
{
    for (ptrdiff_t i = 0; i < (ptrdiff_t)edging->pixels; i++)
        lull_edge_pixel(edging, i);
}

/* L of the codes of a pixel's feature; of those of the light, if it is LULL_GRAINY. */
static int grain_value(const uint8_t *codes, unsigned feature)
{
    return feature == LULL_GRAINY ? codes[LULL_GRAIN_LIGHT_CODE]
                                  : lull_grain_light(codes + lull_grain_codes(feature));
}

/* Adds what row y of `wide` pixels makes of a feature's sums. */
static void add_grain(uint32_t *sums, const uint8_t *const *rows, unsigned y, unsigned wide,
                      unsigned feature)
{
    const uint8_t *row = rows[y], *above = y ? rows[y - 1] : NULL;
    for (unsigned i = 0; i < wide; i++, row += LULL_CODES) {
        int here = grain_value(row, feature);
        int step[LULL_GRAIN_STEPS] = {i + 1 < wide ? grain_value(row + LULL_CODES, feature) - here
                                                    : 0};
        if (above) {
            const uint8_t *up = above + LULL_CODES * (size_t)i;
            step[1] = here - grain_value(up, feature);
            step[2] = i ? here - grain_value(up - LULL_CODES, feature) : 0;
            step[3] = i + 1 < wide ? here - grain_value(up + LULL_CODES, feature) : 0;
        }
        sums[0]++;
        sums[1] += (uint32_t)here;
        sums[2] += (uint32_t)(here * here);
        for (unsigned c = 0; c < 3 && feature < LULL_GRAINY; c++)
            sums[3 + c] += row[lull_grain_codes(feature) + c];
        for (unsigned k = 0; k < LULL_GRAIN_STEPS; k++)
            sums[6 + k] += (uint32_t)(step[k] * step[k]);
    }
}

void lull_grain_sums_scalar(float *out, size_t plane, const uint8_t *const *rows, unsigned count,
                            unsigned pixels, void *work)
{
    (void)work;
    for (unsigned x = 0; x < pixels; x += LULL_GRAIN_SIDE, out++) {
        const uint8_t *at[LULL_GRAIN_SIDE];
        for (unsigned y = 0; y < count; y++)
            at[y] = rows[y] + LULL_CODES * (size_t)x;
        for (unsigned f = 0; f <= LULL_GRAINY; f++) {
            uint32_t sums[LULL_GRAIN_SUMS] = {0};
            for (unsigned y = 0; y < count; y++)
                add_grain(sums, at, y, lull_min_u(pixels - x, LULL_GRAIN_SIDE), f);
            for (size_t k = 0; k < LULL_GRAIN_SUMS && f < LULL_GRAINY; k++)
                out[(f * LULL_GRAIN_SUMS + k) * plane] = (float)sums[k];
            out[LULL_GRAIN_LIGHT * plane] = (float)sums[6]; /* of the last, the light */
        }
    }
}

void lull_take_grain_scalar(float *v, size_t plane, float *out, const float *cells,
                            size_t cell_plane, unsigned feature, unsigned pixels)
{
    for (size_t i = 0; i < pixels; i++) {
        const float *cell = cells + (i + LULL_GRAIN_SIDE / 2) / LULL_GRAIN_SIDE;
        float part = lull_cell_part(LULL_GRAIN_SIDE, (int)i), at[LULL_GRAIN_VALUES];
        for (size_t k = 0; k < LULL_GRAIN_VALUES; k++, cell += cell_plane)
            at[k] = cell[0] + part * (cell[1] - cell[0]);
        for (size_t c = 0; c < 3; c++) {
            float *p = v + c * plane + i;
            *p = lull_without_grain(*p, at[0], at[1 + c], feature);
            if (out)
                out[3 * i + c] = *p;
        }
    }
}
