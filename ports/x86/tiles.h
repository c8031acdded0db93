/* Cutting a convolution into tiles. */
#ifndef LULL_X86_TILES_H
#define LULL_X86_TILES_H

#include "kernels.h"

/* How the sums of an integer tile are requantised and stored (conv_int_tile.h). */
enum {
    BYTES = 1, /* outputs are bytes, not words */
    SMALL = 2  /* lull_conv's is_small */
};

/* What a function for rows of tiles is given: n outputs from `first` on of all pixels. */
typedef struct tile_row {
    const lull_conv *conv;
    unsigned first, n;
    const int32_t *bias; /* integers: of output `first`, and from one pixel's to the next one's */
    size_t bias_step;
    struct tile_part {        /* of a segment: */
        const uint8_t *x, *w; /* the run of pixel 0, the weights of the first vector */
        size_t step, block;   /* bytes from pixel to pixel, and from vector to vector */
        unsigned length;
        unsigned share;       /* SHARE_... */
        unsigned column;      /* dwords of a column of runs that share some, else `length` */
    } part[LULL_MAX_SEGMENTS];
} tile_row;

typedef struct tile_shape {
    void (*run)(const tile_row *row);
    unsigned vectors, pixels; /* of a tile */
    unsigned is_half;         /* 1: no more than half of the last vector's lanes are outputs */
} tile_shape;

/* What the runs of pixels that follow each other share: columns (dwords of one source pixel). */
enum {
    SHARE_NONE,
    SHARE_2,   /* two columns, each next pixel one column on */
    SHARE_3,   /* three columns, each next pixel one column on */
    SHARE_ENDS /* three columns, each next pixel two columns on */
};

/* SHARE_... of a segment with `step` bytes from pixel to pixel. */
LULL_INLINE unsigned tile_share(const lull_segment *segment, size_t step)
{
    size_t bytes = (size_t)4 * segment->length;
    if (step % 4)
        return SHARE_NONE;
    if (3 * step == bytes)
        return SHARE_3;
    if (segment->length % 3 == 0 && 3 * step == 2 * bytes)
        return SHARE_ENDS;
    return 2 * step == bytes ? SHARE_2 : SHARE_NONE;
}

/* Runs the whole convolution. The shapes are listed with decreasing numbers of vectors and end
 * with one of one vector and one pixel. For the outputs that are left, takes the first shape
 * whose vectors and pixels are not more than needed, nor, of halves, too few. Elements of rows have
 * 4 bytes, or, if is_integer, 2 in the wide segments and 1 in the others. */
LULL_INLINE void run_tiles(const lull_conv *conv, const tile_shape *shapes, unsigned lanes,
                           int is_integer)
{
    tile_row row;
    row.conv = conv;
    row.first = 0;
    while (row.first < conv->outputs) {
        unsigned left = conv->outputs - row.first;
        const tile_shape *shape = shapes;
        while (shape->vectors * shape->pixels > 1 &&
               ((shape->vectors - 1) * lanes >= left || shape->pixels > conv->pixels ||
                (shape->is_half && shape->vectors * lanes - lanes / 2 < left)))
            shape++;
        row.n = lull_min_u(left, shape->vectors * lanes);
        row.bias = (const int32_t *)conv->bias + row.first;
        row.bias_step = 0;
        if (is_integer && conv->start) {
            row.bias = conv->start + row.first;
            row.bias_step = conv->start_step;
        }
        for (unsigned s = 0; s < conv->segments; s++) {
            const lull_segment *segment = &conv->segment[s];
            struct tile_part *part = &row.part[s];
            part->x = (const uint8_t *)segment->row;
            part->step = segment->step * (size_t)(!is_integer ? 4 : s < conv->wide ? 2 : 1);
            part->block = (size_t)4 * lanes * segment->length;
            part->w = (const uint8_t *)segment->weights + row.first / lanes * part->block;
            part->length = segment->length;
            part->share = tile_share(segment, part->step);
            part->column = part->length;
            if (part->share != SHARE_NONE)
                part->column /= part->share == SHARE_2 ? 2 : 3;
        }
        shape->run(&row);
        row.first += shape->vectors * lanes;
    }
}

/* The first pixel of the tiles of a row in turn: the last tile is moved back to end at the last
 * pixel. */
#define FOR_TILES(p, conv, size)                                            \
    for (unsigned p##_ = 0, p = 0; FOR_TILES_MORE(p, (conv)->pixels, size); \
         p##_ += (size))
#define FOR_TILES_MORE(p, pixels, size) \
    (p##_ < (pixels) && (p = lull_min_u(p##_, (pixels) - (size)), 1))

#endif
