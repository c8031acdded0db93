/* Writing an image into a copy of the multilayer EXR file that it was read from. */
#ifndef LULL_APPS_EXR_KEEP_H
#define LULL_APPS_EXR_KEEP_H

#include "imageio.h"

/* Copies the EXR file target->keep_layers to `stream` with img in place of the channels named in
 * it. All attributes, other channels and other parts stay; parts that the image is not in are
 * copied without decoding them. The part that it is in is compressed as before if that loses
 * nothing, else as ZIP, and keeps only the full-resolution level of a tiled file. The new channels
 * have the image's type. */
image_status exr_keep_write(FILE *stream, const image *img, const image_target *target,
                            image_error *error);

#endif
