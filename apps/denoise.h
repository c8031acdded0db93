/* The parts of oidnDenoise: settings from the command line, the inputs of a frame, and denoising
 * it. */
#ifndef LULL_APPS_DENOISE_H
#define LULL_APPS_DENOISE_H

#include "device.h"
#include "imageio.h"
#include "json.h"
#include "report.h"
#include "sequence.h"
#include "temporal.h"

#define MAX_OUTPUTS 8
#define MAX_PASSES IMAGE_MAX_ALSO

typedef struct denoise_settings {
    device_settings device;
    const char *filter;
    const char *files[IMAGE_ROLES];  /* color, albedo, normal, motion (image_role); NULL: none */
    const char *layers[IMAGE_ROLES]; /* --layer, NULL: by the usual names; "none": leave it out */
    const char *weights, *reference, *frames;
    const char *outputs[MAX_OUTPUTS];
    int output_count;
    const char *passes[MAX_PASSES]; /* --pass, --part: further layers of the colour's file */
    int is_part[MAX_PASSES];        /* --part: those that add up to the colour */
    int pass_count, part_count;
    int is_hdr, is_srgb, is_directional, is_aux_clean, is_in_place;
    int is_untold; /* nobody said whether the colour is HDR: its extension does, or what it holds */
    int is_prefiltering; /* the albedo is denoised by itself first */
    int is_panorama;     /* of a whole sphere: the edges meet */
    int is_split;        /* the mean of the colour denoised as a whole and pass by pass */
    int is_temporal;     /* inputs and results are means with the frames before */
    int has_motion_scale;
    float motion_scale[2];
    int only_given; /* --no_aux: do not look for albedo and normal in the colour's file */
    int is_json, is_checking, is_repairing, is_help, is_list;
    int type, quality, storage, runs, max_memory, ensemble;
    float input_scale; /* NaN: not set */
    float strength;    /* how far the result is from the input, 1 being that of the filter */
    float max_error;   /* NaN: the default of the content */
} denoise_settings;

/* Reads the command line. Returns EXIT_OK, or EXIT_USAGE after it said why. */
exit_code denoise_parse(denoise_settings *settings, int argc, char **argv);
void denoise_print_help(void);

/* The images of one frame. */
typedef struct denoise_inputs {
    image images[IMAGE_ROLES]; /* image_role; empty ones have no pixels */
    char *paths[IMAGE_ROLES];  /* malloc */
    int is_found[IMAGE_ROLES]; /* in the colour's file, not asked for: may be left out again */
    int has_light;   /* what is called as an albedo may be is light, and left out */
    image_role main; /* the one to be denoised */
} denoise_inputs;

/* Loads and checks what the settings name, for a frame (any number if it is not a sequence), and
 * tells what it took in text and in the JSON object. On failure everything is freed. */
exit_code denoise_load(denoise_inputs *inputs, const denoise_settings *settings, int frame,
                       json *report);
void denoise_inputs_free(denoise_inputs *inputs);

/* Tells in text and JSON what looks wrong with the inputs, and mends what can be mended if the
 * settings ask for it: the images, and what the colour is taken for. */
void denoise_check(denoise_inputs *inputs, int *is_hdr, int *is_srgb,
                   const denoise_settings *settings, json *report);

/* Loads another image of the main image's kind, size and channels: the reference. */
exit_code denoise_load_reference(image *reference, const denoise_settings *settings,
                                 const denoise_inputs *inputs, int frame);

/* 1 if image values of that role are signed: normals, or directional light maps. */
int denoise_is_signed(const denoise_settings *settings, image_role role);

/* What lasts from frame to frame. */
typedef struct denoise_session {
    const denoise_settings *settings;
    OIDNDevice device;
    OIDNFilter filter, albedo_filter; /* the latter for --prefilter; made when needed */
    void *weights; /* malloc */
    size_t weights_size;
    json *report;
    temporal steady; /* the frame before */
    int shows_progress, percent; /* on stderr; what was shown last */
} denoise_session;

exit_code denoise_begin(denoise_session *session, const denoise_settings *settings, json *report);
void denoise_end(denoise_session *session);

/* Loads, denoises, compares and writes a frame. */
exit_code denoise_frame(denoise_session *session, int frame);

/* All that the settings ask for: one image or a sequence, with its report. */
exit_code denoise_run(const denoise_settings *settings);

/* Settings as if there were no options. */
void denoise_set_defaults(denoise_settings *settings);

#endif
