/* One frame on its way: what denoise_frame.c, denoise_passes.c and denoise_outputs.c share. */
#ifndef LULL_APPS_DENOISE_JOB_H
#define LULL_APPS_DENOISE_JOB_H

#include "denoise.h"
#include "layers.h"

/* A further layer of the colour's file, --pass or --part. */
typedef struct denoise_pass {
    image img; /* the layer, later its result */
    double msec; /* that it took */
    int is_alpha;
    int is_bare; /* has nothing of the colours of surfaces: their albedo is left out */
} denoise_pass;

/* --split: the colour as a sum of shares, each with the albedo that suits it. Empty images are of
 * light that the file does not have, or that is black. */
typedef struct denoise_split {
    image lights[LAYERS_LIGHTS];       /* of layers_lights: shares of the colour, in floats */
    image colors[LAYERS_LIGHTS];       /* of surfaces, each once, at the first light it is of; */
    device_image views[LAYERS_LIGHTS]; /* as the device sees them */
    image rest; /* of the colour: what all these lack */
    double msec[LAYERS_LIGHTS + 1]; /* that each took, the rest last */
} denoise_split;

typedef struct frame_job {
    denoise_session *session;
    const denoise_settings *settings;
    int frame;
    denoise_inputs inputs;
    image output, backup, reference; /* backup: the input, where it is needed again */
    device_image views[3], output_view;
    denoise_pass passes[MAX_PASSES];
    denoise_split split;
    int is_hdr, is_srgb; /* settings, or what --repair made of them */
} frame_job;

/* denoise_frame.c */

/* The image that holds the result, or will. */
image *denoise_result(frame_job *job);

/* Makes a view of an image in the session's storage, with the image's pixels. */
exit_code denoise_make_view(frame_job *job, device_image *view, image *img);

/* --prefilter: denoises an albedo in its own memory, without help of other images. */
exit_code denoise_prefilter(frame_job *job, const device_image *albedo);

/* The pending error of the device as an exit code; EXIT_OK if there is none. */
exit_code denoise_device_error(const frame_job *job, int is_commit);

/* Sets what all filters of the session have in common, and commits. */
void denoise_commit(frame_job *job, OIDNFilter filter);

/* Runs a committed filter, with its progress. */
exit_code denoise_run_filter(frame_job *job, OIDNFilter filter);

/* Moves a result back towards its input, where that is a number, to this strength. */
void denoise_weaken(image *result, const image *input, float strength);

/* denoise_passes.c */

/* Reads the layers, and checks that parts add up to the colour, which must still be as it was
 * read. */
exit_code denoise_passes_load(frame_job *job);

/* Denoises the parts; their sum is the result. */
exit_code denoise_parts_run(frame_job *job);

/* Denoises those that are no parts. */
exit_code denoise_passes_run(frame_job *job);

/* Tells of all in the JSON report, once they are done. */
void denoise_passes_tell(const frame_job *job);
void denoise_passes_free(frame_job *job);

/* Denoises an image like the colour in its place, with this albedo (NULL, or a view without an
 * image: none) and the normals. */
exit_code denoise_layer(frame_job *job, image *img, const device_image *albedo);

/* denoise_split.c */

/* Reads the passes of light; the colour must still be as it was read. */
exit_code denoise_split_load(frame_job *job);

/* Makes the result, the colour denoised as a whole, the mean of that and of the sum of what its
 * shares give. */
exit_code denoise_split_run(frame_job *job);

/* Tells of it in the JSON report, once it is done. */
void denoise_split_tell(const frame_job *job);
void denoise_split_free(frame_job *job);

/* denoise_outputs.c */

/* Whether the outputs of this frame of a sequence, which are known one by one, can be written. */
exit_code denoise_check_outputs(const frame_job *job);
exit_code denoise_write_outputs(frame_job *job);

#endif
