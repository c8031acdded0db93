/* Shared by the tests of OpenCL devices, which compare them with the CPU's: the bytes must be the
 * same. Include it first. */
#ifndef LULL_TESTS_OPENCL_H
#define LULL_TESTS_OPENCL_H

#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* setenv, fork */
#endif
#include "tests/api/api.h"

#if !defined(_WIN32)
#include <sys/wait.h>
#include <unistd.h>
#endif

#include "OpenImageDenoise/lull_device.h"
#include "OpenImageDenoise/lull_quality.h"

/* pocl keeps compiled kernels in files: in the build folder, where there is one. */
static inline void keep_kernels_in_build(void)
{
#if !defined(_WIN32)
    const char *build = getenv("LULL_BUILD");
    char path[1024];

    if (build && !getenv("POCL_CACHE_DIR")) {
        snprintf(path, sizeof path, "%s/opencl", build);
        setenv("POCL_CACHE_DIR", path, 1);
    }
#endif
}

/* The signal that ends a program that asks for a device, or 0: some drivers abort where they do not
 * like the machine (pocl without /sys). */
static inline int deadly_signal(void)
{
#if !defined(_WIN32)
    int status = 0;
    pid_t child = fork();

    if (child == 0) {
        fclose(stderr);
        oidnReleaseDevice(oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL));
        _exit(0);
    }
    if (child > 0 && waitpid(child, &status, 0) == child && WIFSIGNALED(status))
        return WTERMSIG(status);
#endif
    return 0;
}

/* Why there is no OpenCL device, or NULL. */
static inline const char *why_no_opencl(void)
{
    static char why[256];
    static int is_safe;
    const char *text = NULL;
    OIDNDevice device;

    if (!is_safe && deadly_signal()) {
        snprintf(why, sizeof why, "optional: the driver of OpenCL ends programs here");
        return why;
    }
    is_safe = 1;
    device = oidnNewDevice((OIDNDeviceType)LULL_DEVICE_TYPE_OPENCL);
    if (device) {
        oidnReleaseDevice(device);
        return NULL;
    }
    CHECK_EQ(oidnGetDeviceError(NULL, &text), HARDWARE);
    snprintf(why, sizeof why, "%s", text ? text : "");
    return why;
}

/* Ends the test as skipped where there is none. A build without OpenCL is somebody's choice. */
#define NEED_OPENCL()                                                                              \
    do {                                                                                           \
        const char *why_ = why_no_opencl();                                                        \
        char reason_[300];                                                                         \
        if (why_) {                                                                                \
            snprintf(reason_, sizeof reason_, "%s%s",                                              \
                     strstr(why_, "build is without") ? "optional: " : "", why_);                  \
            SKIP(reason_);                                                                         \
        }                                                                                          \
    } while (0)

/* A committed device of a type. */
static inline OIDNDevice open_device(int type)
{
    OIDNDevice device = oidnNewDevice((OIDNDeviceType)type);

    oidnSetDeviceInt(device, "numThreads", 2);
    oidnCommitDevice(device);
    ERROR(device, NONE);
    return device;
}

/* The device to test, and the one that says what is right. */
static inline OIDNDevice open_opencl(void) { return open_device(LULL_DEVICE_TYPE_OPENCL); }
static inline OIDNDevice open_cpu(void) { return open_device(OIDN_DEVICE_TYPE_CPU); }

/* A noisy picture: values to about 6, some fireflies. */
static inline float *picture(size_t floats, unsigned seed)
{
    float *image = noise_image(floats, seed);
    size_t i;

    for (i = 0; i < floats; i++)
        image[i] = i % 97 == 5 ? 400.0f * image[i] : 6.0f * image[i] * image[i] * image[i];
    return image;
}

/* A committed filter from a tight colour image to a tight output, hdr. */
static inline OIDNFilter new_hdr(OIDNDevice device, float *in, float *out, size_t width,
                                 size_t height)
{
    OIDNFilter filter = oidnNewFilter(device, "RT");

    oidnSetFilterBool(filter, "hdr", true);
    commit_tight(device, filter, in, out, width, height);
    return filter;
}

#endif
