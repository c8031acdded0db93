/* Reading and writing images: OpenEXR, PFM/PHM, PNG, Radiance HDR, PPM/PGM. One row of the table in
 * imageio.c per format.
 *
 * Files may be truncated, corrupt or hostile: every reader checks sizes before it allocates, and
 * fails with a text that says what is wrong (without the file's name: the caller adds it). Writers
 * write to a temporary name and rename, so that an existing file is replaced as a whole or not at
 * all. */
#ifndef LULL_APPS_IMAGEIO_H
#define LULL_APPS_IMAGEIO_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "report.h"

/* Optional dependencies: 1 if the build has them. */
#ifndef LULL_WITH_OPENEXR
#define LULL_WITH_OPENEXR 0
#endif
#ifndef LULL_WITH_PNG
#define LULL_WITH_PNG 0
#endif

#define IMAGE_MAX_SIZE 65536 /* pixels a side, as in the denoising API */
#define IMAGE_NAME_SIZE 256  /* longest EXR channel name, with its NUL */

typedef enum image_status {
    IMAGE_OK = 0,
    IMAGE_ERROR_OPEN,   /* missing, a directory, not permitted, empty */
    IMAGE_ERROR_FORMAT, /* of no known format, or of a variant that is not supported */
    IMAGE_ERROR_DATA,   /* truncated or corrupt */
    IMAGE_ERROR_LAYER,  /* a multilayer file without the layer asked for */
    IMAGE_ERROR_MEMORY,
    IMAGE_ERROR_WRITE
} image_status;

typedef struct image_error {
    image_status status;
    char text[320]; /* reason, one line */
} image_error;

/* Sets status and text (printf) and returns the status. */
image_status image_fail(image_error *error, image_status status, const char *format, ...)
    REPORT_PRINTF(3, 4);

/* Type of the values in memory. */
typedef enum image_type {
    IMAGE_ANY, /* in requests: float, or half where the file holds half */
    IMAGE_FLOAT,
    IMAGE_HALF
} image_type;

/* What formats do with an alpha. */
typedef enum image_alpha {
    IMAGE_OPAQUE,    /* hold none */
    IMAGE_STRAIGHT,  /* beside colours that know nothing of it */
    IMAGE_MULTIPLIED /* colours are multiplied by it */
} image_alpha;

/* Pixels: rows from top to bottom, channels interleaved, no padding. A zeroed struct is an empty
 * image. */
typedef struct image {
    size_t width, height;
    unsigned channels; /* 1 to 3: grey, two-channel, colour */
    image_type type;
    void *pixels; /* malloc */
    float *alpha;   /* width * height, malloc; NULL if the file has none (EXR: or if it is not */
                    /* asked for colour) */
    unsigned bits;  /* 8 or 16: the file held integers of that many bits; 0: floating point */
    int is_layered; /* 1: read from an EXR file; then: */
    char names[3][IMAGE_NAME_SIZE]; /* the channels that were taken */
    int part;          /* where they are */
    int left, top;     /* corner of the data window */
    int may_be_light;  /* an albedo whose layer is called as others call light (layers.h) */
} image;

/* Which layer of a multilayer file is wanted (layers.h). */
typedef enum image_role {
    IMAGE_COLOR,
    IMAGE_ALBEDO,
    IMAGE_NORMAL,
    IMAGE_MOTION,
    IMAGE_ROLES
} image_role;

typedef struct image_request {
    image_role role;
    const char
        *layer; /* NULL: found by the usual names; else the layer's name, or its channels separated
                 * by commas. Only EXR files have layers; other formats ignore it */
    int is_exact; /* 1: only a layer of the role's usual names will do. 0: a file without one may
                   * give its main image (an albedo kept in a file of its own) */
    image_type type;
    uint64_t max_bytes; /* refuse images that need more memory; 0: no limit */
    int threads; /* to decode an EXR file; 0: as many as there are processors */
    struct image_beside *beside; /* other layers of an EXR file to be read along with this one: */
    unsigned beside_count;       /* IMAGE_MAX_BESIDE at most */
} image_request;

/* A layer beside another. Of those that may be meant, one that belongs to the other comes first: of
 * its view layer. If the image asked for is of an EXR file (is_layered), `status` says whether this
 * one could be read, too; else nothing is touched. */
typedef struct image_beside {
    image *out; /* empty where status is not IMAGE_OK */
    image_request request;
    image_status status;
    image_error error;
} image_beside;

#define IMAGE_MAX_BESIDE 80

/* Reads an image. The format is told from the content, not from the name. On failure `out` is
 * empty. */
image_status image_read(image *out, const char *path, const image_request *request,
                        image_error *error);

/* Same from an open file; `name` only helps to tell formats whose content has no mark. */
image_status image_read_stream(image *out, FILE *file, const image_request *request,
                               image_error *error);

typedef struct image_target {
    const char
        *keep_layers; /* EXR: copy everything but the channels named in the image from this file,
                       * which may be the target itself; NULL: a file with this image only */
    int threads; /* to encode an EXR file, likewise; its bytes do not depend on it */
    const image *const *also; /* with keep_layers: others of that file, to be replaced, too: */
    unsigned also_count;      /* IMAGE_MAX_ALSO at most */
} image_target;

#define IMAGE_MAX_ALSO 64

/* Writes an image in the format that the path's extension names; `target` may be NULL. After an
 * interrupt (platform_interrupted) it fails and leaves what was there. */
image_status image_write(const char *path, const image *img, const image_target *target,
                         image_error *error);

/* Fails with the reason if image_write would not know how to write to such a path, or not be
 * allowed to. */
image_status image_check_writable(const char *path, image_error *error);

/* 0 for files whose extension implies sRGB-encoded values: all but .exr .pfm .phm .hdr. */
int image_path_is_linear(const char *path);

/* 1 for an extension whose values are integers in [0, 1]: .png .ppm .pgm. */
int image_path_is_integer(const char *path);

/* Same two of an image that was read from a file of this name. Where the extension is that of no
 * format (/dev/stdin, beauty.exr.1) its content says it. */
int image_is_linear(const image *img, const char *path);
int image_is_integer(const image *img, const char *path);

/* What files of this extension do with an alpha. */
image_alpha image_path_alpha(const char *path);

/* Brings linear colours beside which there is this alpha (NULL: none) from one kind to another. */
void image_convert_alpha(image *img, const float *alpha, image_alpha from, image_alpha to);

/* Allocates pixels (contents undefined). */
image_status image_create(image *out, size_t width, size_t height, unsigned channels,
                          image_type type, image_error *error);
void image_destroy(image *img);

/* Bytes of all pixels, of one pixel. */
size_t image_bytes(const image *img);
size_t image_pixel_bytes(const image *img);

/* Number of values; and one value by its index in memory order. */
size_t image_count(const image *img);
float image_get(const image *img, size_t index);
void image_set(image *img, size_t index, float value);

/* 1 if a value is neither NaN nor infinite. */
int image_is_finite(const image *img);

/* A row of width * channels values. */
void image_get_row(const image *img, size_t y, float *values);
void image_set_row(image *img, size_t y, const float *values);

/* The sRGB curve and its inverse, in place and for one value. */
void image_encode_srgb(image *img);
void image_decode_srgb(image *img);
float srgb_encode(float linear);
float srgb_decode(float encoded);

/* v * 0.5 + 0.5 and v * 2 - 1 in place: how integer formats hold signed values such as normals. */
void image_encode_signed(image *img);
void image_decode_signed(image *img);

/* ---- For the readers and writers ----------------------------------------------------------------
 */

/* Checks the size read from a header against limits and allocates. `stored`: type that IMAGE_ANY
 * gives. */
image_status image_begin(image *out, const image_request *request, uint64_t width, uint64_t height,
                         unsigned channels, image_type stored, image_error *error);

/* Fails if a file is too short to hold that many bytes of pixels, however well they were deflated.
 */
image_status image_check_plausible(FILE *file, double pixel_bytes, image_error *error);

typedef struct image_format {
    const char *extension;
    const char *name;
    int is_available;
    int is_linear;     /* values in such files are linear, not sRGB-encoded */
    int is_integer;    /* values are clamped to [0, 1] */
    int is_copied;     /* read once more for what an output keeps of it: no pipe will do */
    image_alpha alpha;
    const char *magic; /* first bytes, or NULL if another row reads these files */
    image_status (*read)(image *, FILE *, const image_request *, image_error *);
    image_status (*write)(FILE *, const image *, const image_target *, image_error *);
} image_format;

image_status image_read_exr(image *, FILE *, const image_request *, image_error *);
image_status image_read_pfm(image *, FILE *, const image_request *, image_error *);
image_status image_read_png(image *, FILE *, const image_request *, image_error *);
image_status image_read_hdr(image *, FILE *, const image_request *, image_error *);
image_status image_read_ppm(image *, FILE *, const image_request *, image_error *);

image_status image_write_exr(FILE *, const image *, const image_target *, image_error *);
image_status image_write_pfm(FILE *, const image *, const image_target *, image_error *);
image_status image_write_phm(FILE *, const image *, const image_target *, image_error *);
image_status image_write_png(FILE *, const image *, const image_target *, image_error *);
image_status image_write_hdr(FILE *, const image *, const image_target *, image_error *);
image_status image_write_ppm(FILE *, const image *, const image_target *, image_error *);
image_status image_write_pgm(FILE *, const image *, const image_target *, image_error *);

#endif
