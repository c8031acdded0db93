#include "exr_channels.h"

#if LULL_WITH_OPENEXR

#include <stdlib.h>
#include <string.h>

void exr_channels_free(exr_channels *list)
{
    for (size_t i = 0; i < list->count; i++) {
        free(list->names[i]);
        free(list->plain[i]);
    }
    free(list->names);
    free(list->plain);
    free(list->entries);
    memset(list, 0, sizeof *list);
}

static int is_flat(exr_context_t context, int part)
{
    exr_storage_t storage;
    return !exr_get_storage(context, part, &storage) &&
           (storage == EXR_STORAGE_SCANLINE || storage == EXR_STORAGE_TILED);
}

/* Copy of "first[0..length).rest", or of "rest" if the length is 0; NULL without memory. */
static char *join(const char *first, size_t length, const char *rest)
{
    size_t n = strlen(rest) + 1, m = length ? length + 1 : 0;
    char *name = malloc(n + m);
    if (name && m) {
        memcpy(name, first, length);
        name[length] = '.';
    }
    if (name)
        memcpy(name + m, rest, n);
    return name;
}

/* ---- Views in the names of channels ---------------------------------------------------------- */

/* The views that a part of several has in its channels' names, the default one first. */
static exr_attr_string_vector_t find_views(exr_context_t context, int part)
{
    static const exr_attr_string_vector_t none;
    const exr_attribute_t *attribute;
    return !exr_get_attribute_by_name(context, part, "multiView", &attribute) &&
                   attribute->type == EXR_ATTR_STRING_VECTOR
               ? *attribute->stringvector
               : none;
}

/* Place in the list of views of that of a channel, which is the part before the last one of its
 * name ("albedo.left.R"); -1: none. *start: where that part is. */
static int32_t view_of(const char *name, const exr_attr_string_vector_t *views, size_t *start)
{
    const char *dot = strrchr(name, '.');
    size_t end = dot ? (size_t)(dot - name) : 0;
    *start = end;
    while (*start && name[*start - 1] != '.')
        --*start;
    for (int32_t i = 0; dot && i < views->n_strings; i++) {
        const char *view = views->strings[i].str;
        if (strlen(view) == end - *start && !memcmp(view, name + *start, end - *start))
            return i;
    }
    return -1;
}

/* The plain name of a channel (exr_channels.h). */
static char *name_without_view(const char *name, const exr_attr_string_vector_t *views)
{
    size_t start, n;
    int32_t view = view_of(name, views, &start);
    char *copy = join(NULL, 0, name), *to = copy;
    if (view < 0 || !copy)
        return copy;
    n = strlen(views->strings[view].str) + 1;
    memcpy(to, name + start, n);
    to += view ? n : 0;
    memcpy(to, name, start);
    memcpy(to + start, name + start + n, strlen(name + start + n) + 1);
    return copy;
}

/* ---- Views in parts of their own ------------------------------------------------------------- */

/* A part, and what its channels' names do not say. */
typedef struct part_title {
    const char *name; /* NULL: none, or of the only part */
    const char *view; /* of the part; NULL: none, or the file's default view */
    size_t bare;      /* bytes of the name without the view */
} part_title;

/* The view of a part; NULL if it has none or several. */
static const char *view_of_part(exr_context_t context, int part)
{
    const exr_attribute_t *attribute;
    return !find_views(context, part).n_strings &&
                   !exr_get_attribute_by_name(context, part, "view", &attribute) &&
                   attribute->type == EXR_ATTR_STRING
               ? attribute->string->str
               : NULL;
}

/* Names of parts end in their view, since they must differ: "left", "albedo.left", "rgba_left",
 * "ViewLayer.Combined-left". The view of the first part that has one is the default. */
static part_title find_title(exr_context_t context, int part, int parts)
{
    part_title title = {NULL, NULL, 0};
    const char *view = parts > 1 ? view_of_part(context, part) : NULL, *first = NULL;
    size_t n = view ? strlen(view) : 0;

    if (parts == 1 || exr_get_name(context, part, &title.name))
        title.name = NULL;
    title.bare = title.name ? strlen(title.name) : 0;
    if (n && title.bare >= n && !strcmp(title.name + title.bare - n, view)) {
        if (title.bare == n)
            title.bare = 0;
        else if (strchr(".-_ ", title.name[title.bare - n - 1]))
            title.bare -= n + 1;
    }
    for (int i = 0; n && i < parts && !first; i++)
        first = view_of_part(context, i);
    title.view = first && strcmp(first, view) ? view : NULL;
    return title;
}

/* Copy of "albedo.R" as "albedo.right.R". */
static char *insert_view(const char *channel, const char *dot, const char *view)
{
    char *end = join(view, strlen(view), dot + 1);
    char *name = end ? join(channel, (size_t)(dot - channel), end) : NULL;
    free(end);
    return name;
}

/* Full name of a channel of a part. Those with a layer do without the part's, so of them only the
 * view can tell two parts apart. */
static char *full_name(const part_title *title, const char *channel)
{
    const char *dot = strrchr(channel, '.');
    if (dot)
        return title->view ? insert_view(channel, dot, title->view) : join(NULL, 0, channel);
    return join(title->name, title->name ? strlen(title->name) : 0, channel);
}

static char *plain_name(const part_title *title, const char *channel)
{
    char *bare = join(title->name, strchr(channel, '.') ? 0 : title->bare, channel);
    char *plain = bare ? join(title->view, title->view ? strlen(title->view) : 0, bare) : NULL;
    free(bare);
    return plain;
}

/* ---- The list -------------------------------------------------------------------------------- */

/* Appends the channels of the default view and those of no view, or those of the others. */
static exr_result_t append_channels(exr_channels *list, int part, const part_title *title,
                                    const exr_attr_chlist_t *channels,
                                    const exr_attr_string_vector_t *views, int is_other)
{
    for (int c = 0; c < channels->num_channels; c++) {
        const char *channel = channels->entries[c].name.str;
        char *name;
        size_t start;
        if ((view_of(channel, views, &start) > 0) != is_other)
            continue;
        name = full_name(title, channel);
        list->names[list->count] = name;
        list->plain[list->count] = !views->n_strings ? plain_name(title, channel)
                                   : name            ? name_without_view(name, views)
                                                     : NULL;
        list->entries[list->count].part = part;
        list->entries[list->count].index = c;
        if (!list->plain[list->count++] || !name)
            return EXR_ERR_OUT_OF_MEMORY;
    }
    return EXR_ERR_SUCCESS;
}

static exr_result_t append_part(exr_channels *list, exr_context_t context, int part, int parts)
{
    const exr_attr_chlist_t *channels;
    exr_result_t result = exr_get_channels(context, part, &channels);
    exr_attr_string_vector_t views;
    part_title title;
    size_t count;
    char **names, **plain;
    exr_channel *entries;

    if (result)
        return result;
    views = find_views(context, part);
    title = find_title(context, part, parts);
    count = list->count + (size_t)channels->num_channels;
    names = realloc(list->names, (count + 1) * sizeof *names);
    list->names = names ? names : list->names;
    plain = realloc(list->plain, (count + 1) * sizeof *plain);
    list->plain = plain ? plain : list->plain;
    entries = realloc(list->entries, (count + 1) * sizeof *entries);
    list->entries = entries ? entries : list->entries;
    if (!names || !plain || !entries)
        return EXR_ERR_OUT_OF_MEMORY;
    result = append_channels(list, part, &title, channels, &views, 0);
    return result ? result : append_channels(list, part, &title, channels, &views, 1);
}

exr_result_t exr_channels_list(exr_channels *list, exr_context_t context, int first)
{
    int parts = 0;
    exr_result_t result = exr_get_count(context, &parts);
    memset(list, 0, sizeof *list);
    for (int i = 0; i < parts && !result; i++) {
        int part = (first + i) % parts;
        if (is_flat(context, part))
            result = append_part(list, context, part, parts);
    }
    return result;
}

/* ---- The layer that is wanted ---------------------------------------------------------------- */

/* The layer of the role, one that belongs to the colour if there is such. */
static layer_match find_role(const exr_channels *list, image_role role, const exr_channel *color)
{
    const char *const *names = (const char *const *)list->plain;
    for (size_t i = 0; color && i < list->count; i++)
        if (list->entries[i].part == color->part && list->entries[i].index == color->index)
            return layers_find_beside(role, names[i], names, list->count);
    return layers_find(role, names, list->count);
}

/* "no normal layer among R, G, B, ..." */
static image_status no_layer(const exr_channels *list, const image_request *request,
                             image_error *error)
{
    char text[160];
    size_t n = 0;
    for (size_t i = 0; i < list->count && n + 4 < sizeof text; i++) {
        int room = (int)(sizeof text - n);
        int more = snprintf(text + n, (size_t)room, "%s%s", i ? ", " : "", list->names[i]);
        if (more >= room) {
            memcpy(text + sizeof text - 4, "...", 4);
            n = sizeof text;
        } else {
            n += (size_t)more;
        }
    }
    if (!list->count)
        return image_fail(error, IMAGE_ERROR_FORMAT, "the file has only deep data");
    if (request->layer)
        return image_fail(error, IMAGE_ERROR_LAYER, "no layer '%.60s' among the channels %s",
                          request->layer, text);
    return image_fail(error, IMAGE_ERROR_LAYER, "no %s layer among the channels %s",
                      layers_role_name(request->role), text);
}

/* The layer asked for; count 0 if there is none, or if its channels are in different parts. */
static layer_match choose(const exr_channels *list, const image_request *request,
                          const exr_channel *color)
{
    const char *const *names = (const char *const *)list->names;
    layer_match match = {0, {0, 0, 0}};
    if (request->layer)
        match = layers_find_named(request->layer, names, list->count);
    else
        match = find_role(list, request->role, color);
    if (!match.count && !request->layer && !request->is_exact && request->role != IMAGE_COLOR)
        match = find_role(list, IMAGE_COLOR, NULL);
    for (unsigned c = 1; c < match.count; c++)
        if (list->entries[match.channels[c]].part != list->entries[match.channels[0]].part)
            match.count = 0;
    return match;
}

image_status exr_channels_find(layer_match *match, const exr_channels *list,
                               const image_request *request, const exr_channel *color,
                               image_error *error)
{
    *match = choose(list, request, color);
    if (!match->count)
        return no_layer(list, request, error);
    if (match->count == 1 &&
        layers_find_named("RY", (const char *const *)list->names, list->count).count)
        return image_fail(error, IMAGE_ERROR_FORMAT,
                          "luminance and chroma channels are not supported");
    return IMAGE_OK;
}

#else
typedef int exr_channels_is_not_built; /* ISO C wants something in a source file */
#endif
