/* The channels of an EXR file. A multipart file counts as one list of channels, the plain ones of a
 * part (R, G, B) under the part's name. Only with LULL_WITH_OPENEXR. */
#ifndef LULL_APPS_EXR_CHANNELS_H
#define LULL_APPS_EXR_CHANNELS_H

#include "exr_file.h"
#include "layers.h"

#if LULL_WITH_OPENEXR

typedef struct exr_channel {
    int part, index; /* place in that part's list */
} exr_channel;

typedef struct exr_channels {
    size_t count;
    char **names; /* full names, by which users ask for them */
    char **plain; /* the same without the view of stereo files; other views than the default one */
                  /* begin with theirs, as if pictures were view layers: "albedo.R", */
                  /* "right.albedo.R" */
    exr_channel *entries;
} exr_channels;

/* All channels of flat parts, from those of the part `first` on: of equal names the first one
 * counts. Free the list in any case. */
exr_result_t exr_channels_list(exr_channels *list, exr_context_t context, int first);
void exr_channels_free(exr_channels *list);

/* Finds the layer asked for: of those that may be meant, one that belongs to the picture with the
 * channel `color` (NULL: none). Fails if there is none, or if its channels are in different parts.
 */
image_status exr_channels_find(layer_match *match, const exr_channels *list,
                               const image_request *request, const exr_channel *color,
                               image_error *error);

#endif
#endif
