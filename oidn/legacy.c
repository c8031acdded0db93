/* Convenience and deprecated names as exported functions, and the mapping functions of 1.x. */
#include "internal.h"

OIDN_API unsigned int oidnGetPhysicalDeviceUInt(int physicalDeviceID, const char *name)
{
    return (unsigned int)oidnGetPhysicalDeviceInt(physicalDeviceID, name);
}

OIDN_API void oidnSetDeviceUInt(OIDNDevice device, const char *name, unsigned int value)
{
    oidnSetDeviceInt(device, name, (int)value);
}

OIDN_API unsigned int oidnGetDeviceUInt(OIDNDevice device, const char *name)
{
    return (unsigned int)oidnGetDeviceInt(device, name);
}

OIDN_API void oidnSetDevice1b(OIDNDevice device, const char *name, bool value)
{
    oidnSetDeviceBool(device, name, value);
}

OIDN_API void oidnSetDevice1i(OIDNDevice device, const char *name, int value)
{
    oidnSetDeviceInt(device, name, value);
}

OIDN_API bool oidnGetDevice1b(OIDNDevice device, const char *name)
{
    return oidnGetDeviceBool(device, name);
}

OIDN_API int oidnGetDevice1i(OIDNDevice device, const char *name)
{
    return oidnGetDeviceInt(device, name);
}

OIDN_API void oidnSetFilter1b(OIDNFilter filter, const char *name, bool value)
{
    oidnSetFilterBool(filter, name, value);
}

OIDN_API bool oidnGetFilter1b(OIDNFilter filter, const char *name)
{
    return oidnGetFilterBool(filter, name);
}

OIDN_API void oidnSetFilter1i(OIDNFilter filter, const char *name, int value)
{
    oidnSetFilterInt(filter, name, value);
}

OIDN_API int oidnGetFilter1i(OIDNFilter filter, const char *name)
{
    return oidnGetFilterInt(filter, name);
}

OIDN_API void oidnSetFilter1f(OIDNFilter filter, const char *name, float value)
{
    oidnSetFilterFloat(filter, name, value);
}

OIDN_API float oidnGetFilter1f(OIDNFilter filter, const char *name)
{
    return oidnGetFilterFloat(filter, name);
}

OIDN_API void oidnRemoveFilterImage(OIDNFilter filter, const char *name)
{
    oidnUnsetFilterImage(filter, name);
}

OIDN_API void oidnRemoveFilterData(OIDNFilter filter, const char *name)
{
    oidnUnsetFilterData(filter, name);
}

OIDN_API void *oidnMapBuffer(OIDNBuffer buffer, OIDNAccess access, size_t byteOffset,
                             size_t byteSize)
{
    void *data = NULL;
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL)) {
        if ((int)access < OIDN_ACCESS_READ || access > OIDN_ACCESS_WRITE_DISCARD)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "invalid access: %d", (int)access);
        else if (byteOffset > buffer->bytes || byteSize > buffer->bytes - byteOffset)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "buffer region is out of range");
        else if (buffer->data &&
                 lull_queue_wait(buffer->device, buffer->device->queue.tail, &call.fault))
            data = buffer->data + byteOffset;
    }
    lull_call_end(&call);
    return data;
}

OIDN_API void oidnUnmapBuffer(OIDNBuffer buffer, void *mappedPtr)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL)) {
        const char *p = mappedPtr;

        if (p && (p < buffer->data || p > buffer->data + buffer->bytes))
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "the pointer was not mapped");
    }
    lull_call_end(&call);
}
