/* Inside the executor: what its files share. */
#ifndef LULL_EXEC_H
#define LULL_EXEC_H

#include "plan.h"
#include "transfer.h"

/* Layers whose rows are made together, one after the other in each part. */
typedef struct lull_group {
    unsigned layer, layers;
    unsigned stores;                     /* 1: then those rows of the output are stored */
    unsigned first, rows, chunk, chunks; /* rows: of parts; layers may make two rows in each */
} lull_group;

#define LULL_GROUPS 6

/* What the body functions of one parallel_for see. Indices run down the rows first, so that a part
 * of them is a band of columns, much the same one in every loop. */
typedef struct lull_task {
    lull_plan *plan;
    const lull_images *images;
    lull_group group[LULL_GROUPS]; /* loops over layers: those that do not need each other */
    unsigned groups;
    unsigned parts;                   /* of them, in the loop */
    unsigned ahead;                   /* rows of input images fetched ahead, three for each row of
                                       * the next step, or LULL_NOT_AHEAD */
    unsigned layer;                   /* the one that is made */
    unsigned first, rows, chunk;      /* loops over images: first row, rows, columns of a part */
    unsigned base_row;                /* row of the frame at the start of the images */
    unsigned begin, end, left, right; /* columns: of the strip's output, and held in the rings */
} lull_task;

/* How a frame's main image is read and written. */
typedef struct lull_content_rule {
    lull_transfer transfer;
    uint8_t is_hdr, is_signed;
} lull_content_rule;

lull_content_rule lull_exec_content(const lull_frame *frame);

/* Image number `feature`: 0 colour, 1 albedo, 2 normal. */
const lull_image *lull_exec_feature(const lull_images *images, unsigned feature);

/* Pixel 0 of row y of a tensor, for writing; pixel x of an fp32 one; floats from plane to plane. */
uint8_t *lull_exec_row(const lull_plan *plan, unsigned tensor, unsigned y);
float *lull_exec_floats(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x);
size_t lull_exec_plane(const lull_plan *plan, unsigned tensor);

/* Row y of a tensor for reading; rows outside are zeros. */
const uint8_t *lull_exec_source(const lull_plan *plan, unsigned tensor, int y);

#define LULL_NOT_AHEAD 0x40000000u
#define LULL_FETCH 2u /* rows of images that a loop over layers fetches ahead */

/* Bodies of parallel_for. Context: a lull_task. */
void lull_exec_load(void *context, unsigned index, unsigned worker);   /* a chunk of the input */
void lull_exec_spread(void *context, unsigned index, unsigned worker); /* of albedo, normals */
void lull_exec_guide(void *context, unsigned index, unsigned worker);
void lull_exec_chunk(void *context, unsigned index, unsigned worker);  /* of one of the groups */
void lull_exec_store(void *context, unsigned index, unsigned worker);  /* of the output */

/* Fetches into caches what the thread of index `index` will read of input images in the next step:
 * reading is then done while layers are made, which wait for memory little. */
void lull_exec_fetch(const lull_task *t, unsigned index);

/* Stores columns [x, x+n) of row y of the output image. */
void lull_exec_store_part(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* Row (counted from the first) and columns of a loop's index; columns are [left, right) of it. */
typedef struct lull_part {
    unsigned row, left, right;
} lull_part;
lull_part lull_exec_part(const lull_task *t, unsigned index, unsigned left, unsigned right);

/* Columns [x, x+n) of rows y and y + 1 (or of the pooled row y) of the task's layer, in Winograd's
 * form. x and n, before pooling, are whole patches. */
void lull_exec_winograd(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* Columns [x, x+n) of four rows from y on (or of the pooled rows y and y + 1; or, if the layer has
 * phases, of eight), in patches. x and n, before pooling, are whole patches. */
void lull_exec_patches(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* Columns [x, x+n) of row y of layer l from the source that has no patches, and `start`, which is
 * the bias with what the other one adds. */
void lull_exec_conv(const lull_plan *plan, unsigned l, const int32_t *start, unsigned x, unsigned y,
                    unsigned n);

/* The codes that a layer of the filter keeps beside its result, at pixel x; those of the noise are
 * the last. */
uint8_t *lull_exec_codes(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x);
uint8_t *lull_exec_noise(const lull_plan *plan, unsigned tensor, unsigned y, unsigned x);

/* Columns of a row of level 0 that are inside the image. */
unsigned lull_exec_inside(const lull_task *t);

/* Sums, and then gains, of cells [x, x+n) of row y of cells; columns [x, x+n) of row y of the
 * corrected result. */
void lull_exec_residual(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_gains(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_correct(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* The regression: sums and coefficients of cells [x, x+n) of row y of cells; columns [x, x+n) of
 * row y of the result, x being the first of a cell. */
void lull_exec_fit_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_fit(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_regress(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* n pixels (r,g,b), at most LULL_BLOCK, from column x on of row y of the frame, of the exposed
 * result averaged along edges, times `unscale`. */
void lull_exec_edges(float *out, const lull_task *t, float unscale, unsigned x, unsigned y,
                     unsigned n);

/* Before the network proper, grain of the features: sums, shares and means of cells [x, x+n) of row
 * y of cells; columns [x, x+n) of row y of the input without it. */
void lull_exec_grain_sums(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_find_grain(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);
void lull_exec_encode(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* Takes it out of columns [x, x+n), of the strip, of the tensors of albedo and normal. */
void lull_exec_clean(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* Columns [x, x+n) of row y of the task's layer, if it is one of the filter. */
void lull_exec_filter(const lull_task *t, unsigned x, unsigned y, unsigned n, unsigned worker);

/* A part of a row of a U network's input, and of its auxiliary channels if those are apart: pixels,
 * and bytes from one to the next. */
typedef struct lull_direct {
    uint8_t *to[2];
    size_t pixel[2];
} lull_direct;

/* n pixels of a U network's input from column x of row y of the images on; they pass through
 * `block`. */
void lull_exec_direct(const lull_task *t, const lull_direct *row, float *block, unsigned x,
                      unsigned y, unsigned n);

/* The first three channels of n pixels of a U network's output, `pixel` bytes each, as floats. */
void lull_exec_output(const lull_model *model, float *out, const uint8_t *row, size_t pixel,
                      unsigned n);

/* n pixels of the main image of family K, from column x of row y of the images on; brought to
 * `block`, always so where rows are kept. */
void lull_exec_main(lull_encoding *from, const lull_task *t, float *block, unsigned x, unsigned y,
                    unsigned n);

/* n pixels of an auxiliary image of family K: in place, or copied to `block`. NULL if there are
 * none: after the main image, in the order of the bits. */
const float *lull_exec_aux(const lull_task *t, unsigned feature, float *block, unsigned x,
                           unsigned y, unsigned n);

/* n pixels (r,g,b) of the result to image values: network values of family U, exposed radiance of
 * K. */
void lull_exec_finish(float *v, const lull_plan *plan, unsigned channels, unsigned n);

/* Shares of the input in the output, from a column on, at most LULL_MIXED pixels: of runs, the
 * first of which may begin before. */
#define LULL_MIXED 512u
typedef struct lull_run_shares {
    int first, any; /* any: 0 if all are 0 */
    float of[LULL_MIXED / LULL_RUN + 2];
} lull_run_shares;
void lull_exec_shares(lull_run_shares *shares, const lull_task *t, unsigned x, unsigned y,
                      unsigned n);
/* 1 if some of n of these pixels have input in them. */
int lull_exec_has_share(const lull_run_shares *shares, const lull_task *t, unsigned x, unsigned n);
/* Mixes the input into n of them (r,g,b), at most LULL_BLOCK; `block` has room for as many. */
void lull_exec_mix(float *v, const lull_run_shares *shares, const lull_task *t, float *block,
                   unsigned x, unsigned y, unsigned n);

/* Radiance of n pixels, at most LULL_BLOCK, from column x on of row y of the frame; it may be
 * brought to `block`. */
void lull_exec_radiance(lull_encoding *from, const lull_task *t, float *block, unsigned x,
                        unsigned y, unsigned n);

/* The same, exposed and sanitised, in any case in `block`. */
void lull_exec_sane(float *block, const lull_encoding *from, const lull_task *t, unsigned n);

/* What is seen of rows 16 index to 16 index + 15 of the frame: of the light cells that say
 * something, and those with much detail; of the light by the albedo cells that say something, those
 * among them with next to no detail, those with some, and of these what is noise and not texture;
 * edges of the albedo, and sharp ones. */
typedef struct lull_calm_row {
    uint16_t lit, wild; /* of a few thousand cells in the whole frame */
    uint16_t cells, calm, rough, noise;
    uint16_t edges, sharp;
} lull_calm_row;
void lull_exec_calm_row(lull_calm_row *row, const lull_task *t, unsigned index);

/* How calm the frame is, and how ragged its edges if it has an albedo, of all rows: in [0, 1]. */
float lull_calm_share(const lull_calm_row *rows, unsigned n);
float lull_ragged_share(const lull_calm_row *rows, unsigned n);

/* 1 if there is an albedo or a normal beside the main image. */
int lull_exec_has_features(const lull_plan *plan);

/* Memory of a worker: lull_plan.scratch_bytes of it. */
void *lull_exec_scratch(const lull_task *t, unsigned worker);

#endif
