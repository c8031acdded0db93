/* Light maps with normals: texels that belong to no surface, whose normal is 0, get the light of
 * the nearest that do, so that charts do not darken where they end. */
#include "internal.h"

#include "../lib/image.h"

static size_t color_bytes(size_t pixel_bytes, const lull_frame *frame)
{
    return lull_align_up((size_t)frame->width * frame->height * pixel_bytes, LULL_ALIGN);
}

size_t lull_lightmap_bytes(size_t pixel_bytes, const lull_frame *frame)
{
    return color_bytes(pixel_bytes, frame) + lull_fill_size(frame->width, frame->height);
}

lull_status lull_lightmap_inputs(lull_images *images, const lull_frame *frame, void *memory)
{
    const lull_image *color = &images->color;
    const size_t bytes = color_bytes(lull_image_pixel_bytes(color), frame);
    const lull_image filled = lull_tight_image(color, color->type, frame, memory);
    const lull_status status =
        lull_fill(&filled, color, &images->normal, frame->width, frame->height,
                  (char *)memory + bytes, lull_fill_size(frame->width, frame->height));

    images->color = filled;
    return status;
}
