/* The channels of an EXR file. A multipart file counts as one list of channels, the plain ones of a
 * part (R, G, B) under the part's name. Only with LULL_WITH_OPENEXR. */
#ifndef LULL_APPS_EXR_CHANNELS_H
#define LULL_APPS_EXR_CHANNELS_H

#include "exr_file.h"

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

#endif
#endif
