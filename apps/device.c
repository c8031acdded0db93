#include "device.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "platform.h"
#include "report.h"

static const option_word type_words[] = {
    {"default", OIDN_DEVICE_TYPE_DEFAULT},
    {"cpu", OIDN_DEVICE_TYPE_CPU},
    {"sycl", OIDN_DEVICE_TYPE_SYCL},
    {"cuda", OIDN_DEVICE_TYPE_CUDA},
    {"hip", OIDN_DEVICE_TYPE_HIP},
    {"metal", OIDN_DEVICE_TYPE_METAL},
    {"opencl", LULL_DEVICE_TYPE_OPENCL},
    {NULL, 0},
};

const option_word device_ensembles[] = {{"1", 1}, {"2", 2}, {"4", 4}, {NULL, 0}};
const option_word device_qualities[] = {
    {"default", OIDN_QUALITY_DEFAULT},
    {"high h", OIDN_QUALITY_HIGH},
    {"balanced b", OIDN_QUALITY_BALANCED},
    {"fast f", OIDN_QUALITY_FAST},
    {"auto", LULL_QUALITY_AUTO},
    {NULL, 0},
};

const option_word device_types[] = {
    {"float f fp32", IMAGE_FLOAT},
    {"half h fp16", IMAGE_HALF},
    {NULL, 0},
};

const option_word device_storages[] = {
    {"host", STORAGE_HOST},
    {"device", STORAGE_DEVICE},
    {"managed", STORAGE_MANAGED},
    {NULL, 0},
};

device_settings device_settings_default(void)
{
    device_settings settings = {OIDN_DEVICE_TYPE_DEFAULT, 0, 0, -1, -1};
    return settings;
}

int device_parse(device_settings *settings, const char *text)
{
    if (isdigit((unsigned char)text[0])) {
        settings->type = -1;
        return !option_parse_int(text, 0, INT_MAX, &settings->id);
    }
    settings->type = option_word_value(type_words, text);
    return settings->type < 0;
}

OIDNDevice device_open(const device_settings *settings)
{
    const char *text = NULL;
    OIDNDevice device = settings->type < 0 ? oidnNewDeviceByID(settings->id)
                                           : oidnNewDevice((OIDNDeviceType)settings->type);
    if (device) {
        if (settings->threads > 0)
            oidnSetDeviceInt(device, "numThreads", settings->threads);
        if (settings->affinity >= 0)
            oidnSetDeviceBool(device, "setAffinity", settings->affinity != 0);
        if (settings->verbose >= 0)
            oidnSetDeviceInt(device, "verbose", settings->verbose);
        oidnCommitDevice(device);
    }
    if (oidnGetDeviceError(device, &text) == OIDN_ERROR_NONE && device)
        return device;
    report_error(EXIT_DENOISE, "%s", text ? text : "cannot create a device");
    if (device)
        oidnReleaseDevice(device);
    return NULL;
}

const char *device_version(OIDNDevice device, char text[32])
{
    snprintf(text, 32, "%d.%d.%d", oidnGetDeviceInt(device, "versionMajor"),
             oidnGetDeviceInt(device, "versionMinor"), oidnGetDeviceInt(device, "versionPatch"));
    return text;
}

static const char *type_name(int type)
{
    static const char *const names[] = {"default", "CPU", "SYCL", "CUDA", "HIP", "Metal"};
    if (type == LULL_DEVICE_TYPE_OPENCL)
        return "OpenCL";
    return type >= 0 && type < 6 ? names[type] : "unknown";
}

const char *device_type_name(OIDNDevice device)
{
    return type_name(oidnGetDeviceInt(device, "type"));
}

const char *device_used_quality(OIDNFilter filter)
{
    const int quality = oidnGetFilterInt(filter, "usedQuality");
    return quality == OIDN_QUALITY_FAST ? "fast" : quality == OIDN_QUALITY_BALANCED ? "balanced"
                                                                                    : "high";
}

static void print_bytes(int id, const char *label, const char *supported, const char *name)
{
    size_t n = 0;
    const unsigned char *bytes;
    if (!oidnGetPhysicalDeviceBool(id, supported))
        return;
    bytes = oidnGetPhysicalDeviceData(id, name, &n);
    printf("  %s: ", label);
    for (size_t i = 0; bytes && i < n; i++)
        printf("%02x", bytes[i]);
    printf("\n");
}

void device_print_list(void)
{
    int count = oidnGetNumPhysicalDevices();
    for (int id = 0; id < count; id++) {
        printf("Device %d\n", id);
        printf("  Name: %s\n", oidnGetPhysicalDeviceString(id, "name"));
        printf("  Type: %s\n", type_name(oidnGetPhysicalDeviceInt(id, "type")));
        print_bytes(id, "UUID", "uuidSupported", "uuid");
        print_bytes(id, "LUID", "luidSupported", "luid");
        if (oidnGetPhysicalDeviceBool(id, "pciAddressSupported"))
            printf("  PCI : %04x:%02x:%02x.%x\n",
                   (unsigned)oidnGetPhysicalDeviceInt(id, "pciDomain"),
                   (unsigned)oidnGetPhysicalDeviceInt(id, "pciBus"),
                   (unsigned)oidnGetPhysicalDeviceInt(id, "pciDevice"),
                   (unsigned)oidnGetPhysicalDeviceInt(id, "pciFunction"));
    }
    if (!count)
        printf("No devices found\n");
}

void *device_load_weights(const char *path, size_t *size)
{
    FILE *file = platform_is_directory(path) ? NULL : fopen(path, "rb");
    int64_t bytes;
    void *data;
    if (!file) {
        report_error(EXIT_INPUT, "cannot read '%s': %s", path,
                     platform_is_directory(path) ? "is a directory" : strerror(errno));
        return NULL;
    }
    bytes = platform_file_size(file);
    data = bytes > 0 && bytes < (int64_t)1 << 31 ? malloc((size_t)bytes) : NULL;
    *size = data ? fread(data, 1, (size_t)bytes, file) : 0;
    fclose(file);
    if (data && *size == (size_t)bytes)
        return data;
    report_error(EXIT_INPUT, "cannot read '%s': %s", path,
                 bytes == 0  ? "the file is empty"
                 : bytes < 0 ? "not a regular file"
                             : "not a weights file");
    free(data);
    return NULL;
}

OIDNFormat device_format(const image *img)
{
    static const OIDNFormat formats[2][3] = {
        {OIDN_FORMAT_FLOAT, OIDN_FORMAT_FLOAT2, OIDN_FORMAT_FLOAT3},
        {OIDN_FORMAT_HALF, OIDN_FORMAT_HALF2, OIDN_FORMAT_HALF3},
    };
    return formats[img->type == IMAGE_HALF][img->channels - 1];
}

int device_image_init(device_image *out, OIDNDevice device, image *img, device_storage storage)
{
    static const OIDNStorage kinds[] = {OIDN_STORAGE_UNDEFINED, OIDN_STORAGE_HOST,
                                        OIDN_STORAGE_DEVICE, OIDN_STORAGE_MANAGED};
    memset(out, 0, sizeof *out);
    out->img = img;
    out->format = device_format(img);
    if (storage == STORAGE_SHARED && oidnGetDeviceBool(device, "systemMemorySupported"))
        return 0;
    out->buffer = oidnNewBufferWithStorage(device, image_bytes(img), kinds[storage]);
    return out->buffer ? 0 : -1;
}

void device_image_upload(const device_image *view)
{
    if (view->buffer)
        oidnWriteBuffer(view->buffer, 0, image_bytes(view->img), view->img->pixels);
}

void device_image_download(const device_image *view)
{
    if (view->buffer)
        oidnReadBuffer(view->buffer, 0, image_bytes(view->img), view->img->pixels);
}

void device_image_set(const device_image *view, OIDNFilter filter, const char *name)
{
    const image *img = view->img;
    if (view->buffer)
        oidnSetFilterImage(filter, name, view->buffer, view->format, img->width, img->height, 0, 0,
                           0);
    else
        oidnSetSharedFilterImage(filter, name, img->pixels, view->format, img->width, img->height,
                                 0, 0, 0);
}

void device_image_free(device_image *view)
{
    if (view->buffer)
        oidnReleaseBuffer(view->buffer);
    memset(view, 0, sizeof *view);
}
