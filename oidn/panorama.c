/* Panoramas of a whole sphere (equirectangular): their left and right edges meet, and beyond the
 * top and the bottom lies what is half a turn on, upside down. They are denoised in a border of
 * that, so that nothing shows where they were cut, and then without it. */
#include "internal.h"

#include "../lib/image.h"

#define SOME 64u /* pixels copied together */

typedef struct bordering {
    const lull_image *from, *to;
    unsigned width, height, border; /* of the panorama */
} bordering;

/* Row y of the picture with its border. */
static void copy_row(void *context, unsigned y, unsigned worker)
{
    const bordering *b = context;
    const unsigned turn = 2 * b->height; /* rows from one pole to the other, and back */
    const unsigned down = (y + (turn - b->border % turn)) % turn;
    const bool is_behind = down >= b->height;
    const unsigned row = is_behind ? turn - 1 - down : down;
    const unsigned begin = b->width - b->border % b->width + (is_behind ? b->width / 2 : 0);
    const unsigned outer = b->width + 2 * b->border;
    float block[3 * SOME];
    unsigned x, n;

    (void)worker;
    for (x = 0; x < outer; x += n) {
        const unsigned column = (begin + x) % b->width;

        n = lull_min_u(lull_min_u(SOME, outer - x), b->width - column);
        lull_image_load(block, b->from, b->width, column, row, n);
        lull_image_store(b->to, outer, x, y, n, block);
    }
}

size_t lull_panorama_bytes(size_t pixel_bytes, const lull_frame *frame)
{
    return lull_align_up((size_t)frame->width * frame->height * pixel_bytes, LULL_ALIGN);
}

void lull_panorama_inputs(lull_images *images, const lull_frame *frame, unsigned border,
                          void *memory, const lull_host *host)
{
    lull_image *const inputs[] = {&images->color, &images->albedo, &images->normal};
    char *at = memory;
    unsigned i;

    for (i = 0; i < 3; i++) {
        const lull_image to = lull_tight_image(inputs[i], inputs[i]->type, frame, at);
        bordering b = {inputs[i], &to, frame->width - 2 * border, frame->height - 2 * border,
                       border};

        if (!inputs[i]->data)
            continue;
        host->parallel_for(host->user, frame->height, copy_row, &b);
        *inputs[i] = to;
        at += lull_panorama_bytes(lull_image_pixel_bytes(&to), frame);
    }
}

lull_image lull_panorama_inside(const lull_image *image, const lull_frame *frame, unsigned border)
{
    lull_image inside = *image;

    inside.data = lull_image_pixel(image, frame->width, border, border);
    return inside;
}
