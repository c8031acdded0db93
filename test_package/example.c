/* Denoises a small frame with the built-in weights. */
#include <OpenImageDenoise/oidn.h>
#include <lull.h>
#include <stdio.h>

enum { WIDTH = 32, HEIGHT = 24 };

static float color[HEIGHT * WIDTH * 3];

int main(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    OIDNFilter filter;
    const char *text = "";
    OIDNError error;

    for (int i = 0; i < HEIGHT * WIDTH * 3; i++)
        color[i] = (float)(i * 7919 % 256) / 256;
    oidnCommitDevice(device);
    filter = oidnNewFilter(device, "RT");
    oidnSetSharedFilterImage(filter, "color", color, OIDN_FORMAT_FLOAT3, WIDTH, HEIGHT, 0, 0, 0);
    oidnSetSharedFilterImage(filter, "output", color, OIDN_FORMAT_FLOAT3, WIDTH, HEIGHT, 0, 0, 0);
    oidnCommitFilter(filter);
    oidnExecuteFilter(filter);
    error = oidnGetDeviceError(device, &text);
    printf("lull %d.%d.%d: %s, %.3f\n", LULL_VERSION_MAJOR, LULL_VERSION_MINOR, LULL_VERSION_PATCH,
           error ? text : "denoised", color[0]);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(device);
    return error != OIDN_ERROR_NONE;
}
