#include "layers.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

/* Layer names by role, in order of preference; "" is a layer without a name (plain R, G, B). The
 * first ones of each role are those that Open Image Denoise's toolkit knows. training/layers.py has
 * the same. */
static const struct {
    image_role role;
    const char *layer;
} known[] = {
    {IMAGE_COLOR, ""},
    {IMAGE_COLOR, "Noisy Image"}, /* Cycles */
    {IMAGE_COLOR, "Beauty"},
    {IMAGE_COLOR, "Combined"}, /* Blender */
    {IMAGE_COLOR, "Image"},    /* its compositor */
    {IMAGE_COLOR, "rgba"},
    {IMAGE_COLOR, "rgb"},
    {IMAGE_COLOR, "color"},
    {IMAGE_COLOR, "C"},                 /* Karma */
    {IMAGE_ALBEDO, "Denoising Albedo"}, /* Cycles */
    {IMAGE_ALBEDO, "albedo"},           /* Mitsuba, pbrt, Karma, RenderMan */
    {IMAGE_ALBEDO, "VisibleDiffuse"},
    {IMAGE_ALBEDO, "DiffCol"}, /* Blender */
    {IMAGE_ALBEDO, "Diffuse Color"},
    {IMAGE_ALBEDO, "diffuse_albedo"}, /* Arnold */
    {IMAGE_ALBEDO, "OptixAlbedo"},
    {IMAGE_ALBEDO, "DiffuseFilter"}, /* V-Ray, Redshift */
    {IMAGE_ALBEDO, "VRayDiffuseFilter"},
    {IMAGE_ALBEDO, "diffuse"}, /* or light: layers_may_be_light */
    {IMAGE_NORMAL, "Denoising Normal"}, /* Cycles */
    {IMAGE_NORMAL, "normal"},
    {IMAGE_NORMAL, "sh_normal"}, /* Mitsuba */
    {IMAGE_NORMAL, "Ns"},        /* pbrt: shading normals */
    {IMAGE_NORMAL, "N"},         /* Arnold, pbrt, Karma */
    {IMAGE_NORMAL, "Nn"},        /* RenderMan */
    {IMAGE_NORMAL, "Normals"},
    {IMAGE_NORMAL, "VisibleNormals"},
    {IMAGE_NORMAL, "OptixNormals"},
    {IMAGE_NORMAL, "BumpNormals"}, /* Redshift */
    {IMAGE_NORMAL, "VRayNormals"},
    {IMAGE_MOTION, "Vector"}, /* Blender */
    {IMAGE_MOTION, "motion"},
    {IMAGE_MOTION, "motionvector"}, /* Arnold */
    {IMAGE_MOTION, "Motion Vector"},
    {IMAGE_MOTION, "MotionVectors"}, /* Redshift */
    {IMAGE_MOTION, "velocity"},      /* V-Ray */
};
#define KNOWN (sizeof known / sizeof known[0])

static const char *const components[][3] = {
    {"r", "g", "b"},
    {"x", "y", "z"},
    {"red", "green", "blue"},
};
#define COMPONENTS (sizeof components / sizeof components[0])

const char *layers_role_name(image_role role)
{
    static const char *const names[] = {"color", "albedo", "normal", "motion"};
    return names[role];
}

/* 1 if the first n bytes of a and b are the same letters, in upper or lower case. */
static int same(const char *a, const char *b, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (tolower((unsigned char)a[i]) != tolower((unsigned char)b[i]))
            return 0;
    return 1;
}

/* Splits a channel name: bytes of its layer part ("" for plain channels), and the component after
 * it. */
static size_t layer_length(const char *name, const char **component)
{
    const char *dot = strrchr(name, '.');
    *component = dot ? dot + 1 : name;
    return dot ? (size_t)(dot - name) : 0;
}

static int is_component(const char *component, const char *wanted)
{
    return strlen(component) == strlen(wanted) && same(component, wanted, strlen(wanted));
}

/* The other channels of the layer that the channel `first` (an R, X or red) belongs to: two, or one
 * at least. */
static layer_match complete(size_t first, unsigned least, const char *const *names, size_t count)
{
    layer_match match = {0, {0, 0, 0}};
    const char *component, *other;
    size_t length = layer_length(names[first], &component);
    for (size_t s = 0; s < COMPONENTS && !match.count; s++) {
        unsigned found = 1;
        if (!is_component(component, components[s][0]))
            continue;
        match.channels[0] = first;
        for (unsigned c = 1; c < 3 && found == c; c++)
            for (size_t i = 0; i < count; i++)
                if (layer_length(names[i], &other) == length &&
                    same(names[i], names[first], length) && is_component(other, components[s][c])) {
                    match.channels[c] = i;
                    found++;
                    break;
                }
        match.count = found > least ? found : 0;
    }
    return match;
}

/* How the layer of a channel agrees with a name: 2 it is the name, 1 it ends in ".name", 0 not at
 * all. */
static int agreement(const char *channel, const char *layer)
{
    const char *component;
    size_t have = layer_length(channel, &component), want = strlen(layer);
    if (have == want && same(channel, layer, want))
        return 2;
    if (want && have > want && channel[have - want - 1] == '.' &&
        same(channel + have - want, layer, want))
        return 1;
    return 0;
}

static layer_match find_layer(const char *layer, unsigned least, const char *const *names,
                              size_t count)
{
    layer_match match = {0, {0, 0, 0}};
    for (int wanted = 2; wanted >= 1; wanted--)
        for (size_t i = 0; i < count; i++)
            if (agreement(names[i], layer) == wanted) {
                match = complete(i, least, names, count);
                if (match.count)
                    return match;
            }
    return match;
}

/* Channels beside the first one that a layer must have: motion is across and down. */
static unsigned least_of(image_role role) { return role == IMAGE_MOTION ? 1 : 2; }

/* 1 if the channel's layer is one of those known for something else than colour, or of Cryptomatte,
 * whose values are names ("CryptoObject00", "ViewLayer.crypto_material00"). */
static int is_auxiliary(const char *channel)
{
    static const char matte[] = "crypto";
    const char *component;
    size_t length = layer_length(channel, &component), start = length;
    while (start && channel[start - 1] != '.')
        start--;
    if (length - start >= strlen(matte) && same(channel + start, matte, strlen(matte)))
        return 1;
    for (size_t k = 0; k < KNOWN; k++)
        if (known[k].role != IMAGE_COLOR && agreement(channel, known[k].layer))
            return 1;
    return 0;
}

int layers_may_be_light(const char *channel) { return agreement(channel, "diffuse") > 0; }

const layer_light layers_lights[LAYERS_LIGHTS] = {
    {"Diffuse Direct", "Diffuse Color", 0}, /* Cycles, from Blender 5 on */
    {"Diffuse Indirect", "Diffuse Color", 0},
    {"Glossy Direct", "Glossy Color", 0},
    {"Glossy Indirect", "Glossy Color", 0},
    {"Transmission Direct", "Transmission Color", 1},
    {"Transmission Indirect", "Transmission Color", 1},
    {"DiffDir", "DiffCol", 0}, /* to Blender 4 */
    {"DiffInd", "DiffCol", 0},
    {"GlossDir", "GlossCol", 0},
    {"GlossInd", "GlossCol", 0},
    {"TransDir", "TransCol", 1},
    {"TransInd", "TransCol", 1},
    {"diffuse_direct", NULL, 0}, /* Arnold */
    {"diffuse_indirect", NULL, 0},
    {"specular_direct", NULL, 0},
    {"specular_indirect", NULL, 0},
    {"coat_direct", NULL, 0},
    {"coat_indirect", NULL, 0},
    {"sheen_direct", NULL, 0},
    {"sheen_indirect", NULL, 0},
    {"transmission_direct", NULL, 0},
    {"transmission_indirect", NULL, 0},
    {"sss_direct", NULL, 0},
    {"sss_indirect", NULL, 0},
    {"volume_direct", NULL, 0},
    {"volume_indirect", NULL, 0},
    {"directDiffuse", NULL, 0}, /* RenderMan */
    {"indirectDiffuse", NULL, 0},
    {"directSpecular", NULL, 0},
    {"indirectSpecular", NULL, 0},
    {"subsurface", NULL, 0},
    {"transmissive", NULL, 0},
    {"DIRECT_DIFFUSE", NULL, 0}, /* LuxCore */
    {"INDIRECT_DIFFUSE", NULL, 0},
    {"DIRECT_GLOSSY", NULL, 0},
    {"INDIRECT_GLOSSY", NULL, 0},
};

int layers_is_bare_light(const char *channel)
{
    for (size_t i = 0; i < LAYERS_LIGHTS; i++)
        if (layers_lights[i].color && agreement(channel, layers_lights[i].light))
            return 1;
    return 0;
}

int layers_is_alpha(const char *component)
{
    return is_component(component, "a") || is_component(component, "alpha");
}

/* Colour under a name we do not know, grey, or R and G alone. */
static layer_match find_any_color(const char *const *names, size_t count)
{
    static const char *const grey[] = {"Y", "L", "grey", "gray", "luminance"};
    layer_match match = {0, {0, 0, 0}};
    const char *component;
    for (size_t i = 0; i < count; i++) {
        size_t length = layer_length(names[i], &component);
        if (is_auxiliary(names[i]) || !length || is_component(component, "x"))
            continue;
        match = complete(i, 2, names, count);
        if (match.count)
            return match;
    }
    for (size_t g = 0; g < sizeof grey / sizeof grey[0]; g++)
        for (size_t i = 0; i < count; i++)
            if (is_component(names[i], grey[g])) {
                match.count = 1;
                match.channels[0] = i;
                return match;
            }
    if (count == 2 && !is_auxiliary(names[0]))
        match = layers_find_named("R,G", names, count);
    if (!match.count)
        match.count = count == 1; /* whatever it is called, it is the image */
    return match;
}

layer_match layers_find(image_role role, const char *const *names, size_t count)
{
    layer_match match = {0, {0, 0, 0}};
    for (size_t k = 0; k < KNOWN && !match.count; k++)
        if (known[k].role == role)
            match = find_layer(known[k].layer, least_of(role), names, count);
    if (!match.count && role == IMAGE_COLOR)
        match = find_any_color(names, count);
    return match;
}

/* 1 if a channel's layer is the name after the first n bytes of `prefix`. */
static int is_prefixed(const char *channel, const char *prefix, size_t n, const char *layer)
{
    const char *component;
    size_t want = strlen(layer);
    return layer_length(channel, &component) == n + want && same(channel, prefix, n) &&
           same(channel + n, layer, want);
}

layer_match layers_find_beside(image_role role, const char *color, const char *const *names,
                               size_t count)
{
    layer_match match = {0, {0, 0, 0}};
    for (size_t n = strlen(color); n > 0; n--) {
        if (color[n - 1] != '.')
            continue;
        for (size_t k = 0; k < KNOWN; k++)
            for (size_t i = 0; i < count && known[k].role == role; i++) {
                if (is_prefixed(names[i], color, n, known[k].layer))
                    match = complete(i, least_of(role), names, count);
                if (match.count)
                    return match;
            }
    }
    return layers_find(role, names, count);
}

/* Place of a channel by its full name, or `count`. */
static size_t find_channel(const char *name, size_t length, const char *const *names, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (strlen(names[i]) == length && !memcmp(names[i], name, length))
            return i;
    for (size_t i = 0; i < count; i++)
        if (strlen(names[i]) == length && same(names[i], name, length))
            return i;
    return count;
}

layer_match layers_find_named(const char *layer, const char *const *names, size_t count)
{
    layer_match match = {0, {0, 0, 0}};
    const char *start = layer;
    if (!strchr(layer, ',')) {
        match = find_layer(layer, 2, names, count);
        if (match.count)
            return match;
    }
    for (;;) {
        size_t length = strcspn(start, ",");
        size_t i = find_channel(start, length, names, count);
        if (i == count || match.count == 3) {
            match.count = 0;
            return match;
        }
        match.channels[match.count++] = i;
        if (!start[length])
            return match;
        start += length + 1;
    }
}
