/* Devices of the denoising API, as the programs' options choose them. */
#ifndef LULL_APPS_DEVICE_H
#define LULL_APPS_DEVICE_H

#include <OpenImageDenoise/lull_device.h>
#include <OpenImageDenoise/lull_quality.h>
#include <limits.h>

#include "imageio.h"
#include "options.h"

typedef struct device_settings {
    int type;     /* OIDNDeviceType or LULL_DEVICE_TYPE_OPENCL; -1: by id */
    int id;       /* physical device */
    int threads;  /* 0: all */
    int affinity; /* -1: as the library likes */
    int verbose;  /* -1: not set */
} device_settings;

device_settings device_settings_default(void);

/* OPTION_CALL of -d: stores a type's name or a device number in the device_settings. 0 if it is
 * valid. */
int device_parse(device_settings *settings, const char *text);

/* Rows of a table of options, where the settings have `device`, a device_settings, and `weights`,
 * `max_memory` and `is_in_place`; set_device calls device_parse. */
#define DEVICE_OPTIONS(set_device)                                                                 \
    TEXT("w weights", weights, "FILE.tza", "network weights (the built-in ones)"),                 \
        CALL("d dev device", set_device, 1, "N|default|cpu|sycl|cuda|hip|metal|opencl", "device"), \
        INT("threads", device.threads, 0, INT_MAX, "N", "threads (all)"),                          \
        INT("affinity", device.affinity, 0, 1, "0|1", "bind threads to cores"),                    \
        INT("maxmem maxMemoryMB maxmemorymb", max_memory, INT_MIN, INT_MAX, "MB",                  \
            "memory to keep within"),                                                              \
        FLAG("inplace in_place in-place", is_in_place, 1,                                          \
             "denoise within the memory of the input")

extern const option_word device_ensembles[]; /* orientations that results are means of */
extern const option_word device_qualities[]; /* OIDNQuality, or LULL_QUALITY_AUTO */
extern const option_word device_types[];     /* image_type: what float and half are called */

/* A committed device. NULL: the error is reported (report.h). */
OIDNDevice device_open(const device_settings *settings);

/* "2.5.1" of a device, and the name of its type. */
const char *device_version(OIDNDevice device, char text[32]);
const char *device_type_name(OIDNDevice device);

/* Name of the quality that the latest execution of a filter took. */
const char *device_used_quality(OIDNFilter filter);

/* Prints the physical devices as Open Image Denoise's programs do. */
void device_print_list(void);

/* Reads a weights file whole (malloc). NULL: the error is reported. */
void *device_load_weights(const char *path, size_t *size);

/* Format of an image's pixels. */
OIDNFormat device_format(const image *img);

/* An image's memory as the device sees it: the image's own, or a buffer. */
typedef enum device_storage {
    STORAGE_SHARED, /* the image's own memory */
    STORAGE_HOST,
    STORAGE_DEVICE,
    STORAGE_MANAGED
} device_storage;

extern const option_word device_storages[];

typedef struct device_image {
    image *img;
    OIDNBuffer buffer; /* NULL: shared */
    OIDNFormat format;
} device_image;

/* Makes the image known to the device. Devices that cannot read system memory get a buffer in any
 * case. Without STORAGE_SHARED the pixels must be moved with _upload and _download. Returns 0, or
 * -1 with the device's error pending. */
int device_image_init(device_image *out, OIDNDevice device, image *img, device_storage storage);
void device_image_upload(const device_image *view);
void device_image_download(const device_image *view);
void device_image_set(const device_image *view, OIDNFilter filter, const char *name);
void device_image_free(device_image *view);

#endif
