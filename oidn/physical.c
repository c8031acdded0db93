/* Physical devices: there is one, the processor, unless OIDN_DEVICE_CPU=0 hides it. */
#include "internal.h"

#include <string.h>

enum kind { KIND_INT, KIND_STRING, KIND_DATA };

/* Parameters of the processor. `missing`: exists only where the interface says that it is
 * supported, so never here. */
static const struct {
    const char *name;
    enum kind kind;
    int value;
    bool missing;
} parameters[] = {
    {"type", KIND_INT, OIDN_DEVICE_TYPE_CPU, false},
    {"name", KIND_STRING, 0, false},
    {"uuidSupported", KIND_INT, 0, false},
    {"uuid", KIND_DATA, 0, true},
    {"luidSupported", KIND_INT, 0, false},
    {"luid", KIND_DATA, 0, true},
    {"nodeMask", KIND_INT, 0, true},
    {"pciAddressSupported", KIND_INT, 0, false},
    {"pciDomain", KIND_INT, 0, true},
    {"pciBus", KIND_INT, 0, true},
    {"pciDevice", KIND_INT, 0, true},
    {"pciFunction", KIND_INT, 0, true},
};
#define PARAMETERS (sizeof parameters / sizeof *parameters)

OIDN_API bool oidnIsCPUDeviceSupported(void) { return lull_env_int("OIDN_DEVICE_CPU", 1) != 0; }

OIDN_API int oidnGetNumPhysicalDevices(void) { return oidnIsCPUDeviceSupported() ? 1 : 0; }

/* Index of a parameter that the device has, or PARAMETERS after reporting an error. */
static size_t find(int id, const char *name, enum kind kind)
{
    size_t i;

    if (!name) {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "string is null");
        return PARAMETERS;
    }
    if (id < 0 || id >= oidnGetNumPhysicalDevices()) {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "invalid physical device ID: %d", id);
        return PARAMETERS;
    }
    for (i = 0; i < PARAMETERS; i++)
        if (parameters[i].kind == kind && !parameters[i].missing &&
            !strcmp(parameters[i].name, name))
            return i;
    lull_global_error(OIDN_ERROR_INVALID_ARGUMENT,
                      "unknown physical device parameter or type mismatch: '%.80s'", name);
    return PARAMETERS;
}

OIDN_API int oidnGetPhysicalDeviceInt(int physicalDeviceID, const char *name)
{
    const size_t i = find(physicalDeviceID, name, KIND_INT);

    return i < PARAMETERS ? parameters[i].value : 0;
}

OIDN_API bool oidnGetPhysicalDeviceBool(int physicalDeviceID, const char *name)
{
    return oidnGetPhysicalDeviceInt(physicalDeviceID, name) != 0;
}

/* The brand, asked of the processor once. Threads that come at the same time write the same bytes,
 * but that would still be a race, so there is a lock. */
static const char *brand(void)
{
    static char text[64];
    static lull_atomic state; /* 0: not asked; 1: being asked; 2: known */

    while (lull_atomic_load(&state) != 2) {
        if (lull_atomic_swap(&state, 0, 1)) {
            lull_cpu_brand(text, sizeof text);
            lull_atomic_store(&state, 2);
        }
        lull_cpu_relax();
    }
    return text;
}

OIDN_API const char *oidnGetPhysicalDeviceString(int physicalDeviceID, const char *name)
{
    return find(physicalDeviceID, name, KIND_STRING) < PARAMETERS ? brand() : NULL;
}

/* The processor has no parameter of this kind, so this only tells which error it is. */
OIDN_API const void *oidnGetPhysicalDeviceData(int physicalDeviceID, const char *name,
                                               size_t *byteSize)
{
    (void)byteSize;
    (void)find(physicalDeviceID, name, KIND_DATA);
    return NULL;
}

/* ---- Other devices --------------------------------------------------------------------------- */

OIDN_API bool oidnIsSYCLDeviceSupported(const void *device)
{
    (void)device;
    return false;
}
OIDN_API bool oidnIsCUDADeviceSupported(int deviceID)
{
    (void)deviceID;
    return false;
}
OIDN_API bool oidnIsHIPDeviceSupported(int deviceID)
{
    (void)deviceID;
    return false;
}
OIDN_API bool oidnIsMetalDeviceSupported(MTLDevice_id device)
{
    (void)device;
    return false;
}

OIDN_API OIDNDevice oidnNewSYCLDevice(const void *queues, int numQueues)
{
    (void)queues;
    (void)numQueues;
    return oidnNewDevice(OIDN_DEVICE_TYPE_SYCL);
}

OIDN_API OIDNDevice oidnNewCUDADevice(const int *deviceIDs, const cudaStream_t *streams,
                                      int numPairs)
{
    (void)deviceIDs;
    (void)streams;
    (void)numPairs;
    return oidnNewDevice(OIDN_DEVICE_TYPE_CUDA);
}

OIDN_API OIDNDevice oidnNewHIPDevice(const int *deviceIDs, const hipStream_t *streams, int numPairs)
{
    (void)deviceIDs;
    (void)streams;
    (void)numPairs;
    return oidnNewDevice(OIDN_DEVICE_TYPE_HIP);
}

OIDN_API OIDNDevice oidnNewMetalDevice(const MTLCommandQueue_id *commandQueues, int numQueues)
{
    (void)commandQueues;
    (void)numQueues;
    return oidnNewDevice(OIDN_DEVICE_TYPE_METAL);
}

/* The processor has no identifier, so nothing matches. */
static OIDNDevice no_match(const char *what, bool is_null)
{
    lull_global_error(OIDN_ERROR_INVALID_ARGUMENT,
                      is_null ? "%s is null" : "no physical device has this %s", what);
    return NULL;
}

OIDN_API OIDNDevice oidnNewDeviceByUUID(const void *uuid) { return no_match("UUID", !uuid); }
OIDN_API OIDNDevice oidnNewDeviceByLUID(const void *luid) { return no_match("LUID", !luid); }

OIDN_API OIDNDevice oidnNewDeviceByPCIAddress(int pciDomain, int pciBus, int pciDevice,
                                              int pciFunction)
{
    (void)pciDomain;
    (void)pciBus;
    (void)pciDevice;
    (void)pciFunction;
    return no_match("PCI address", false);
}
