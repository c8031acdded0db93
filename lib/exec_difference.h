/* How far two results of a denoiser lie apart to a viewer. Stateless; from any thread. */
#ifndef LULL_EXEC_DIFFERENCE_H
#define LULL_EXEC_DIFFERENCE_H

#include "base.h"

/* Display values are codes from 0, black, to this, white. */
#define LULL_DISPLAY_WHITE 4000u

/* Squared differences of the display codes of two images, summed over pixels and three channels
 * (a grey image counts three times): sRGB codes, of HDR values after x / (1 + x); values in [-1, 1]
 * (directional light maps, and normals as the main image) go linearly from black to white. `frame`:
 * width, height, content and features of both; `scale`: that of the run which made them. A sum of
 * integers, so the same on every CPU, and sums of parts add up to that of the whole. */
uint64_t lull_difference(const lull_image *a, const lull_image *b, const lull_frame *frame,
                         float scale);

#endif
