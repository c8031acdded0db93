/* The filter of family K, where rows end (docs/kernel-prediction.md): the rest of it are kernels.
 */
#ifndef LULL_FILTER_H
#define LULL_FILTER_H

#include "pack.h"

/* The flags of lull_encoding for the auxiliary images that it has. */
uint32_t lull_filter_flags(const lull_encoding *from, int is_clipped);

/* The blend kernel for n pixels, some of which may lie beside the coarse columns that exist:
 * `first` to `last`, relative to the blending's. The first fine column is even; `pairs` is ignored.
 */
void lull_filter_blend(const lull_kernels *kernels, const lull_blending *blending, int first,
                       int last, unsigned n);

/* The bilateral kernel for n pixels; of the columns that it reads those from `first` to `last`,
 * relative to the smoothing's, exist. For the others stands the pixel itself. */
void lull_filter_bilateral(const lull_kernels *kernels, const lull_smoothing *smoothing, int first,
                           int last, unsigned n);

/* Pixels first to last that lack a neighbour: the product of result and divisor as it is. */
void lull_filter_product(const lull_edging *edging, unsigned first, unsigned last);

#endif
