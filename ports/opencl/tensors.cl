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

static int clamp_to(int i, int count) { return clamp(i, 0, count - 1); }

/* ---- Cells of side x side pixels ------------------------------------------------------------- */

/* The four cells between whose centres a pixel lies, the nearest where there is none, and how far it
 * lies on the way. */
typedef struct cell_place {
    int left, right, above, below;
    float across, down;
} cell_place;

static cell_place place_between(uint side, const lull_cl_filter *a, int x, int y)
{
    int columns = (int)lull_cell_count(side, (uint)a->inside_width);
    int rows = (int)lull_cell_count(side, (uint)a->inside_height);
    cell_place at;
    at.left = lull_cell_near(side, x, 0, columns);
    at.right = lull_cell_near(side, x, 1, columns);
    at.above = lull_cell_near(side, y, 0, rows);
    at.below = lull_cell_near(side, y, 1, rows);
    at.across = lull_cell_part(side, x);
    at.down = lull_cell_part(side, y);
    return at;
}

/* Value k of cells there: first down, then across. */
static float value_between(__global uchar *memory, lull_cl_tensor cells, const cell_place *at,
                           uint k)
{
    float before = pixel_at(memory, cells, at->left, at->above)[k];
    float after = pixel_at(memory, cells, at->right, at->above)[k];
    before += at->down * (pixel_at(memory, cells, at->left, at->below)[k] - before);
    after += at->down * (pixel_at(memory, cells, at->right, at->below)[k] - after);
    return before + at->across * (after - before);
}

/* Sum k of a cell of the first source; 0 outside the image. */
static float sum_at(__global uchar *memory, const lull_cl_filter *a, int x, int y, uint k)
{
    return x >= 0 && x < a->inside_width && y >= 0 && y < a->inside_height
               ? pixel_at(memory, a->source[0], x, y)[k]
               : 0.0f;
}

/* The same of it and the cells around it, by weights 1, 2, 1: first down. */
static float sum_around(__global uchar *memory, const lull_cl_filter *a, int x, int y, uint k)
{
    float down[3];
    for (int dx = 0; dx < 3; dx++)
        down[dx] = (sum_at(memory, a, x + dx - 1, y - 1, k) +
                    sum_at(memory, a, x + dx - 1, y + 1, k)) +
                   2.0f * sum_at(memory, a, x + dx - 1, y, k);
    return (down[0] + down[2]) + 2.0f * down[1];
}
