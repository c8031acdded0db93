/* Writing an image into a copy of the multilayer EXR file that it was read from. */
#ifndef LULL_APPS_EXR_KEEP_H
#define LULL_APPS_EXR_KEEP_H

#include "imageio.h"

/* Copies the EXR file target->keep_layers to `stream` with img, and those of target->also, in place
 * of the channels named in them. All attributes, other channels and other parts stay; parts that no
 * image is in are copied without decoding them. One that some are in is compressed as before if
 * that loses nothing, else as ZIP, and keeps only the full-resolution level of a tiled file. The
 * new channels have their image's type. */
image_status exr_keep_write(FILE *stream, const image *img, const image_target *target,
                            image_error *error);

#endif
