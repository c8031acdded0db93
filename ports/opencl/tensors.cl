/* Access to tensors: pixel (x, y) of one in the working memory. */

#define KERNEL(x, y) __kernel __attribute__((reqd_work_group_size(x, y, 1))) void
#define KERNEL_OF_PIXELS KERNEL(LULL_CL_LOCAL_X, LULL_CL_LOCAL_Y)

static __global uchar *bytes_at(__global uchar *memory, lull_cl_tensor t, int x, int y)
{
    return memory + (ulong)t.at * LULL_CL_UNIT + (long)y * t.pitch + (long)x * t.pixel;
}

/* Tensors of four floats a pixel. */
static __global float4 *floats_at(__global uchar *memory, lull_cl_tensor t, int x, int y)
{
    return (__global float4 *)bytes_at(memory, t, x, y);
}

/* Images: three floats a pixel. */
static __global float *pixel_at(__global uchar *memory, lull_cl_tensor t, int x, int y)
{
    return (__global float *)bytes_at(memory, t, x, y);
}

/* The first three of four floats as an array, which the functions of pixels.h take; and back. */
static void get3(float *v, float4 from)
{
    v[0] = from.x;
    v[1] = from.y;
    v[2] = from.z;
}
static float4 make4(const float *v, float w) { return (float4)(v[0], v[1], v[2], w); }

static void get_pixel(float *v, __global const float *from)
{
    for (int c = 0; c < 3; c++)
        v[c] = from[c];
}

/* Value at pixel (x, y) of those of runs of LULL_RUN pixels, one float each, of `width` pixels. */
static float between_runs(__global uchar *memory, lull_cl_tensor t, int width, int x, int y)
{
    int runs = (width + (int)LULL_RUN - 1) / (int)LULL_RUN;
    float before = *pixel_at(memory, t, lull_cell_near(LULL_RUN, x, 0, runs), y);
    float after = *pixel_at(memory, t, lull_cell_near(LULL_RUN, x, 1, runs), y);
    return before + lull_cell_part(LULL_RUN, x) * (after - before);
}

static int clamp_to(int i, int count) { return clamp(i, 0, count - 1); }
