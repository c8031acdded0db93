/* The filter of family K, steps 1 to 5 (docs/kernel-prediction.md). Tensors of float4: of
 * radiance with confidence (C, C r, C g, C b), of results (r, g, b, unused). */

/* Sums of the 25 taps of a 5x5 kernel over a tensor of width x height pixels, whose logits are
 * codes; what is outside weighs nothing. */
static float4 sum5(__global uchar *memory, lull_cl_tensor source, int width, int height,
                   __global const uchar *codes, __global const float *table, int x, int y)
{
    float4 sum = (float4)(0.0f);
    for (int dy = -2; dy <= 2; dy++)
        for (int dx = -2; dx <= 2; dx++, codes++)
            if (x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height)
                sum += table[*codes] * *floats_at(memory, source, x + dx, y + dy);
    return sum;
}

/* Its means, plus `more`; `none` where nothing weighs. */
static float4 mean5(float4 sum, float more, float none)
{
    float share = 1.0f / sum.x;
    return sum.x > 0.0f ? (float4)(sum.yzw * share + more, 0.0f) : (float4)(none);
}

/* Means of albedo or normal, the first source, by logits of a head, the second. */
static float4 feature_mean(__global uchar *memory, __global const uchar *model,
                           const lull_cl_filter *a, int x, int y, float more, float none)
{
    return mean5(sum5(memory, a->source[0], a->width, a->height,
                      bytes_at(memory, a->source[1], x, y) + a->code,
                      (__global const float *)model, x, y),
                 more, none);
}

/* out: filtered albedo + epsilon; sources: (1, albedo), head. */
KERNEL_OF_PIXELS smooth(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float4 v = (float4)(1.0f);
    if (x >= a.width || y >= a.height)
        return;
    if (a.flags & LULL_CL_ALBEDO)
        v = feature_mean(memory, model, &a, x, y, LULL_FILTER_EPSILON, 1.0f);
    *floats_at(memory, a.out, x, y) = v;
}

/* out: filtered normal, which the regression wants (result.cl); sources: (1, normal), head. */
KERNEL_OF_PIXELS face(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= a.width || y >= a.height)
        return;
    *floats_at(memory, a.out, x, y) = feature_mean(memory, model, &a, x, y, 0.0f, 0.0f);
}

/* out: radiance with confidence, zeros outside the image; sources: radiance, filtered albedo,
 * head. */
KERNEL_OF_PIXELS demodulate(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float confidence, share[3], r[3];
    if (x >= a.width || y >= a.height)
        return;
    if (x >= a.inside_width || y >= a.inside_height) {
        *floats_at(memory, a.out, x, y) = (float4)(0.0f);
        return;
    }
    confidence = ((__global const float *)model)[bytes_at(memory, a.source[2], x, y)[a.code]];
    get3(share, *floats_at(memory, a.source[1], x, y));
    lull_shares(share, 1.0f, 1.0f);
    get_radiance(r, memory, a.source[0], x, y);
    for (int c = 0; c < 3; c++)
        r[c] = confidence * (r[c] * share[c]);
    *floats_at(memory, a.out, x, y) = (float4)(confidence, r[0], r[1], r[2]);
}

/* out: radiance with confidence at half the resolution of the first source; sources: it, head. */
KERNEL_OF_PIXELS shrink(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    float4 sum, out = (float4)(0.0f);
    float confidence;
    if (x >= a.width || y >= a.height)
        return;
    confidence = ((__global const float *)model)[bytes_at(memory, a.source[1], x, y)[a.code]];
    sum = ((*floats_at(memory, a.source[0], 2 * x, 2 * y) +
            *floats_at(memory, a.source[0], 2 * x + 1, 2 * y)) +
           *floats_at(memory, a.source[0], 2 * x, 2 * y + 1)) +
          *floats_at(memory, a.source[0], 2 * x + 1, 2 * y + 1);
    if (sum.x > 0.0f)
        out = (float4)(confidence, confidence * (sum.yzw * (1.0f / sum.x)));
    *floats_at(memory, a.out, x, y) = out;
}

/* out: filtered radiance, and the weight of the coarser level as its fourth float; sources:
 * radiance with confidence, head, and, if asked for, where codes of the noise are put. */
KERNEL_OF_PIXELS filter(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    __global const float *table = (__global const float *)model;
    int x = get_global_id(0), y = get_global_id(1);
    __global const uchar *codes;
    float4 f;
    if (x >= a.width || y >= a.height)
        return;
    codes = bytes_at(memory, a.source[1], x, y);
    f = mean5(sum5(memory, a.source[0], a.width, a.height, codes, table, x, y), 0.0f, 0.0f);
    f.w = table[256 + codes[a.code]];
    *floats_at(memory, a.out, x, y) = f;
    if (a.flags & LULL_CL_NOISE) {
        float4 here = *floats_at(memory, a.source[0], x, y);
        float v[4] = {here.x, here.y, here.z, here.w}, mean[3];
        get3(mean, f);
        *bytes_at(memory, a.source[2], x, y) = lull_noise_code(v, mean);
    }
}

/* out: the result of a level; sources: filtered radiance with weights, the coarser result. */
KERNEL_OF_PIXELS blend(__global uchar *memory, __global const uchar *model, lull_cl_filter a)
{
    int x = get_global_id(0), y = get_global_id(1);
    int near_x = clamp_to(x / 2, a.inside_width), near_y = clamp_to(y / 2, a.inside_height);
    int far_x = clamp_to(x / 2 + (x & 1 ? 1 : -1), a.inside_width);
    int far_y = clamp_to(y / 2 + (y & 1 ? 1 : -1), a.inside_height);
    float fine[3], near_here[3], far_here[3], near_beside[3], far_beside[3];
    float4 f;
    if (x >= a.width || y >= a.height)
        return;
    f = *floats_at(memory, a.source[0], x, y);
    get3(fine, f);
    get3(near_here, *floats_at(memory, a.source[1], near_x, near_y));
    get3(far_here, *floats_at(memory, a.source[1], near_x, far_y));
    get3(near_beside, *floats_at(memory, a.source[1], far_x, near_y));
    get3(far_beside, *floats_at(memory, a.source[1], far_x, far_y));
    for (int c = 0; c < 3; c++)
        fine[c] = lull_blended(fine[c], f.w, near_here[c], far_here[c], near_beside[c],
                               far_beside[c]);
    *floats_at(memory, a.out, x, y) = make4(fine, 0.0f);
}
