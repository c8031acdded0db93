/* The schedule and memory of a run: which rows of which tensor are kept, and where. Holds offsets
 * only.
 *
 * Rows stream through the network. Every tensor is a ring of the few rows that its consumers still
 * need. In one step `row_step` input rows come in, then each layer in turn makes the rows that it
 * now can. How many that are, and how many rows stay needed, follows from the layers alone. The
 * planner plays the steps through once, without pixels, and takes the largest number of rows alive
 * as a ring's size. Steps go on after the last input row until the output is complete.
 */
#ifndef LULL_PLAN_H
#define LULL_PLAN_H

#include "pack.h"

/* Rows of a tensor, kept in a ring. A row is `left` bytes of zero border, the pixels, and more
 * zeros; row y is at offset + (y % rows) * row length + left. If the tensor has planes, that is its
 * first plane, and each of the others follows lull_plan_plane bytes later. Small: plans are put on
 * stacks. */
typedef struct lull_ring {
    uint32_t offset;         /* in units of LULL_ALIGN bytes */
    unsigned row_units : 30; /* length of a row, likewise */
    unsigned has_planes : 1; /* 0: channels are interleaved */
    unsigned done_high : 1;  /* lull_plan_done */
    unsigned rows : 16;
    unsigned channels : 11;
    unsigned level : 3;
    unsigned dtype : 2; /* lull_dtype */
} lull_ring;

/* Bytes from pixel to pixel: of all channels, or of one where they are planes. */
size_t lull_ring_pixel(const lull_ring *ring);

/* Bytes before pixel 0 of a row: one pixel of zero border, aligned. */
size_t lull_ring_left(const lull_ring *ring);

/* Rows made of the input while no run is under way. */
#define LULL_ROWS_IDLE 0x1ffffu

#define LULL_BLOCK 64u /* pixels converted together at the input and output */
#define LULL_FIT_BLOCK 128u /* columns summed together by cells: enough for CPUs to see streams */
#define LULL_SCRATCH_LOCAL (LULL_BLOCK * (9 * sizeof(float) + 1))

/* Tensors made of the input images. */
#define LULL_LOADED 5u
static const uint8_t lull_loaded[LULL_LOADED] = {LULL_TENSOR_INPUT, LULL_TENSOR_RADIANCE,
                                                 LULL_TENSOR_ALBEDO, LULL_TENSOR_GUIDE,
                                                 LULL_TENSOR_NORMAL};

struct lull_plan {
    const lull_model *model;
    lull_frame frame;
    size_t bytes;
    unsigned threads;
    unsigned row_step;
    unsigned height;      /* padded */
    unsigned width;       /* padded width of the frame */
    unsigned strip_width; /* columns of output of one strip, a multiple of the alignment */
    unsigned strips;
    unsigned row_width; /* columns held: the strip and its overlaps */
    unsigned delay_rows;
    unsigned played;               /* the row step that rings and delay are set for */
    uint32_t zero_row;             /* offset of zeros as long as any row, and ... */
    uint32_t exposure;             /* ... of rows of auto-exposure bins, in units of LULL_ALIGN */
    size_t scratch, scratch_bytes; /* per worker: LULL_BLOCK pixels of images, then, from
                                    * LULL_SCRATCH_LOCAL on, a part of a tensor without rows; or
                                    * what convolutions need */
    size_t saved; /* columns that an in-place run would overwrite before the next strip reads them
                   */
    uint16_t plane_units[8]; /* by level: from plane to plane, in units of LULL_ALIGN bytes */
    uint16_t saved_width;
    uint16_t keeps_rows; /* what is made of the images is kept from the input on; else, in family K,
                          * all but the codes is made of images that are read again */
    /* State of a run: rows made of every tensor (lull_plan_done), and stored of the output. */
    unsigned stored;
    float scale, calm, ragged; /* of lull_images */
    uint16_t done_low[LULL_TENSORS];
    lull_ring ring[LULL_TENSORS];
};

/* Rows made of a tensor: 17 bits, for plans are put on stacks. */
static inline unsigned lull_plan_done(const lull_plan *plan, unsigned tensor)
{
    return plan->done_low[tensor] | (unsigned)plan->ring[tensor].done_high << 16;
}

static inline void lull_plan_set_done(lull_plan *plan, unsigned tensor, unsigned rows)
{
    plan->done_low[tensor] = (uint16_t)rows;
    plan->ring[tensor].done_high = rows >> 16 & 1u;
}

/* Bytes for what is seen of 16 rows of the frame before the run. */
#define LULL_PLAN_BINS 16u

/* How much this run averages along edges, which is done with the output: 0 is not at all. */
float lull_plan_edges(const lull_plan *plan);

/* Rows of the output that those of the result allow; are_averaged: along edges, for which the row
 * below has to be there. */
unsigned lull_plan_ready(const lull_plan *plan, int are_averaged);

/* None are made of any. */
void lull_plan_restart(lull_plan *plan);

/* Bytes from plane to plane of a tensor that has planes. */
size_t lull_plan_plane(const lull_plan *plan, unsigned tensor);

/* Bytes of all channels of a pixel of a tensor. */
size_t lull_plan_pixel(const lull_plan *plan, unsigned tensor);

/* 1 if a frame has this feature, LULL_GRAIN_ALBEDO or _NORMAL, and not as its main image. */
int lull_plan_has_feature(const lull_plan *plan, unsigned feature);

/* 1 if the model's network makes this tensor. */
int lull_plan_has(const lull_plan *plan, unsigned tensor);

/* 1 if grain is taken out of the frame's features. */
int lull_plan_takes_grain(const lull_plan *plan);

/* 1 if layer l is for the grain of features, and none is taken out: its turns do nothing. */
int lull_plan_is_idle(const lull_plan *plan, unsigned l);

/* 1 if layer l is the first to need tensors made of auxiliary images: the guide, or the others. */
int lull_plan_brings(const lull_plan *plan, unsigned l);

/* Rows of them that it needs for its turn, where rows are not kept. */
unsigned lull_plan_aux_rows(const lull_plan *plan, unsigned l);

/* Notes that so many rows of them are made; of all. */
void lull_plan_bring(lull_plan *plan, unsigned l, unsigned rows);
void lull_plan_set_aux(lull_plan *plan, unsigned rows);

/* Bands of columns that loops are cut in, so that each thread has the same one in every loop; 1 if
 * there are more threads than few. */
unsigned lull_plan_bands(const lull_plan *plan);

/* Columns of a task that reads or writes images. */
unsigned lull_plan_band(const lull_plan *plan);

/* Columns of a task of layer l, at its own resolution before pooling: even. */
unsigned lull_plan_chunk(const lull_plan *plan, unsigned l);

/* 1 if layer l is made in patches: where a step has rows enough for them. */
int lull_plan_is_patched(const lull_plan *plan, unsigned l);

/* Rows (after pooling) that layer l makes together; the first is a multiple of them. */
unsigned lull_plan_rows(const lull_plan *plan, unsigned l);

/* Where a task of layer l, in Winograd's form or in patches, has the points of its sources (0, 1)
 * and of its outputs (2) in its scratch memory: bytes from the start, and elements from plane to
 * plane. Returns the bytes of all. In patches: points of the sources that are made so, in turn (0),
 * of the outputs (2), and, of layers with two sources, what one adds to the four or eight rows of
 * pixels (1; plane: a row). */
typedef struct lull_points {
    size_t offset[3], plane[3];
    size_t room; /* offset of what patches_out has of its own */
} lull_points;
size_t lull_plan_points(lull_points *points, const lull_plan *plan, unsigned l);

/* In a step the layers [first, end) take their turns `times` times, one after the other, then those
 * of the next stage. */
typedef struct lull_stage {
    unsigned first, end, times;
} lull_stage;

/* The stage that begins with layer `first`. */
lull_stage lull_plan_stage(const lull_plan *plan, unsigned first);

/* Rows of a tensor that are still needed, given what its consumers and the output have made. */
unsigned lull_plan_alive(const lull_plan *plan, unsigned tensor);

/* Rows that layer l will have made after its turn in the present step: all that its sources allow,
 * but no more than its share of a step (else the last rows of the frame would all be alive at
 * once). */
unsigned lull_plan_turn(const lull_plan *plan, unsigned l);

#endif
