/* Which channels of a multilayer file are colour, albedo, normal and motion: the names that
 * renderers use.
 */
#ifndef LULL_APPS_LAYERS_H
#define LULL_APPS_LAYERS_H

#include <stddef.h>

#include "imageio.h"

typedef struct layer_match {
    unsigned count; /* channels found: 1 or 3 (2: a list, motion, or R and G are all); 0: none */
    size_t channels[3]; /* their places in the list of names, in the order R G B or X Y Z */
} layer_match;

/* Finds the layer of a role among `count` full channel names ("ViewLayer.Denoising Albedo.R").
 * Upper and lower case are the same. Rows of the name table are tried in order, first as the whole
 * layer name, then after any prefix. A colour without any known name is the first complete R, G, B
 * that is neither albedo nor normal nor Cryptomatte, or else a single grey channel. */
layer_match layers_find(image_role role, const char *const *names, size_t count);

/* Same for a layer that belongs to a colour, one of whose channels has the full name `color`: of
 * layers with the same prefix ("Char." of "Char.Combined.R") any known name comes before all of
 * others, since files may hold several pictures. */
layer_match layers_find_beside(image_role role, const char *color, const char *const *names,
                               size_t count);

/* Finds a layer that the user named: its name (components as above, or the channel of just that
 * name), or one to three channel names separated by commas. */
layer_match layers_find_named(const char *layer, const char *const *names, size_t count);

/* 1 if the channel is of an albedo by the name of diffuse, which to most renderers is light. */
int layers_may_be_light(const char *channel);

/* A pass of light, of those that add up to the colour. */
typedef struct layer_light {
    const char *light;
    const char *color; /* layer of the surfaces' colours that it is still to be multiplied by; */
                       /* NULL: it is a share of the picture as it is */
    int is_seen_through; /* that is of glass: the picture's albedo shows what is behind it */
} layer_light;

/* What renderers call them; lobes one after the other. */
#define LAYERS_LIGHTS 36
extern const layer_light layers_lights[LAYERS_LIGHTS];

/* 1 if the channel is of a pass of light that is still to be multiplied by the colours of
 * surfaces. */
int layers_is_bare_light(const char *channel);

/* 1 for A and alpha, in upper or lower case: the component of a channel's name, after the dot. */
int layers_is_alpha(const char *component);

/* "color", "albedo", "normal", "motion" */
const char *layers_role_name(image_role role);

#endif
