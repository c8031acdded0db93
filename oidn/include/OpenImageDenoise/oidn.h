/* Open Image Denoise 2.5.1 interface, as implemented by lull.
 *
 * Programs written for Open Image Denoise compile against this header and run with either library.
 * Order of use: create a device, set its parameters, commit it; create a filter, set images and
 * parameters, commit it, execute it as often as wanted; ask the device for errors; release
 * everything in any order. Handles are reference counted and start at one.
 *
 * Errors: a function that fails does nothing, returns 0, false or NULL, and leaves an error to be
 * read with oidnGetDeviceError by the same thread. Without a device (NULL handle, failed creation,
 * physical devices) the error is read with oidnGetDeviceError(NULL, ...).
 *
 * Threads: every function may be called by any thread. Calls on objects of one device are
 * serialised.
 */
#ifndef OIDN_H
#define OIDN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "config.h"

#if defined(__cplusplus)
#if defined(SYCL_LANGUAGE_VERSION)
#include <sycl/sycl.hpp>
#define OIDN_SYCL_HPP
#elif defined(SYCL_FEATURE_SET_FULL) || defined(SYCL_FEATURE_SET_REDUCED)
#define OIDN_SYCL_HPP
#else
namespace sycl
{
class device;
class queue;
class event;
} // namespace sycl
#endif
#endif

/* Handles of other vendors' interfaces. */
typedef struct CUstream_st *cudaStream_t;
typedef struct ihipStream_t *hipStream_t;
#if defined(__OBJC__)
@protocol MTLDevice;
@protocol MTLCommandQueue;
@protocol MTLBuffer;
typedef id<MTLDevice> MTLDevice_id;
typedef id<MTLCommandQueue> MTLCommandQueue_id;
typedef id<MTLBuffer> MTLBuffer_id;
#else
typedef void *MTLDevice_id;
typedef void *MTLCommandQueue_id;
typedef void *MTLBuffer_id;
#endif

OIDN_API_NAMESPACE_BEGIN

/* ---- Types ----------------------------------------------------------------------------------- */

typedef struct OIDNDeviceImpl *OIDNDevice;
typedef struct OIDNBufferImpl *OIDNBuffer;
typedef struct OIDNSemaphoreImpl *OIDNSemaphore;
typedef struct OIDNFilterImpl *OIDNFilter;

/* A combination of flag values. */
typedef unsigned int OIDNFlags;

/* lull has the CPU device; asking for another gives OIDN_ERROR_UNSUPPORTED_HARDWARE. Its OpenCL
 * device is of a type of its own (lull_device.h). */
typedef enum {
    OIDN_DEVICE_TYPE_DEFAULT = 0,
    OIDN_DEVICE_TYPE_CPU = 1,
    OIDN_DEVICE_TYPE_SYCL = 2,
    OIDN_DEVICE_TYPE_CUDA = 3,
    OIDN_DEVICE_TYPE_HIP = 4,
    OIDN_DEVICE_TYPE_METAL = 5
} OIDNDeviceType;

typedef enum {
    OIDN_ERROR_NONE = 0,
    OIDN_ERROR_UNKNOWN = 1,
    OIDN_ERROR_INVALID_ARGUMENT = 2,
    OIDN_ERROR_INVALID_OPERATION = 3,
    OIDN_ERROR_OUT_OF_MEMORY = 4,
    OIDN_ERROR_UNSUPPORTED_HARDWARE = 5,
    OIDN_ERROR_CANCELLED = 6
} OIDNError;

/* Pixel formats: 1 to 4 channels of 32-bit or 16-bit floats. Filters take up to 3 channels. */
typedef enum {
    OIDN_FORMAT_UNDEFINED = 0,
    OIDN_FORMAT_FLOAT = 1,
    OIDN_FORMAT_FLOAT2 = 2,
    OIDN_FORMAT_FLOAT3 = 3,
    OIDN_FORMAT_FLOAT4 = 4,
    OIDN_FORMAT_HALF = 257,
    OIDN_FORMAT_HALF2 = 258,
    OIDN_FORMAT_HALF3 = 259,
    OIDN_FORMAT_HALF4 = 260
} OIDNFormat;

/* Where a buffer lives. On the CPU device all kinds are ordinary memory. */
typedef enum {
    OIDN_STORAGE_UNDEFINED = 0,
    OIDN_STORAGE_HOST = 1,
    OIDN_STORAGE_DEVICE = 2,
    OIDN_STORAGE_MANAGED = 3
} OIDNStorage;

typedef enum {
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_NONE = 0,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_FD = 1 << 0,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DMA_BUF = 1 << 1,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_WIN32 = 1 << 2,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_WIN32_KMT = 1 << 3,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_TEXTURE = 1 << 4,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_TEXTURE_KMT = 1 << 5,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_RESOURCE = 1 << 6,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_RESOURCE_KMT = 1 << 7,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D12_HEAP = 1 << 8,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D12_RESOURCE = 1 << 9,
    OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DEDICATED = 1 << 30 /* a modifier of the others */
} OIDNExternalMemoryTypeFlag;
typedef OIDNFlags OIDNExternalMemoryTypeFlags;

typedef enum {
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_NONE = 0,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_FD = 1 << 0,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_WIN32 = 1 << 1,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_WIN32_KMT = 1 << 2,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_D3D11_FENCE = 1 << 3,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_D3D12_FENCE = 1 << 4,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_KEYED_MUTEX = 1 << 5,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_KEYED_MUTEX_KMT = 1 << 6,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_TIMELINE_SEMAPHORE_FD = 1 << 7,
    OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_TIMELINE_SEMAPHORE_WIN32 = 1 << 8
} OIDNExternalSemaphoreTypeFlag;
typedef OIDNFlags OIDNExternalSemaphoreTypeFlags;

/* Speed against quality. 0 selects, and reads back as, HIGH. */
typedef enum {
    OIDN_QUALITY_DEFAULT = 0,
    OIDN_QUALITY_FAST = 4,
    OIDN_QUALITY_BALANCED = 5,
    OIDN_QUALITY_HIGH = 6
} OIDNQuality;

/* Told of every error of a device, on the thread that caused it, after the call's lock is released.
 */
typedef void (*OIDNErrorFunction)(void *userPtr, OIDNError code, const char *message);

/* Told the fraction done, n in [0, 1]: 0 first, never decreasing, 1 last. Returns false to cancel;
 * it is not called again then. Runs on a thread of the device. It may set and get parameters, but
 * calls that would wait for the work it belongs to (commit, execute, sync) fail with
 * INVALID_OPERATION. */
typedef bool (*OIDNProgressMonitorFunction)(void *userPtr, double n);

/* ---- Physical devices ------------------------------------------------------------------------ */

#define OIDN_UUID_SIZE 16u
#define OIDN_LUID_SIZE 8u

/* Physical devices are numbered 0 to count-1. Errors are those of no device (see above). */
OIDN_API int oidnGetNumPhysicalDevices(void);

/* Parameters: type, name, uuidSupported, uuid, luidSupported, luid, nodeMask, pciAddressSupported,
 * pciDomain, pciBus, pciDevice, pciFunction. Strings and data are valid for ever. */
OIDN_API bool oidnGetPhysicalDeviceBool(int physicalDeviceID, const char *name);
OIDN_API int oidnGetPhysicalDeviceInt(int physicalDeviceID, const char *name);
OIDN_INLINE unsigned int oidnGetPhysicalDeviceUInt(int physicalDeviceID, const char *name)
    OIDN_INLINE_BODY(return (unsigned int)oidnGetPhysicalDeviceInt(physicalDeviceID, name);)
OIDN_API const char *oidnGetPhysicalDeviceString(int physicalDeviceID, const char *name);
OIDN_API const void *oidnGetPhysicalDeviceData(int physicalDeviceID, const char *name,
                                               size_t *byteSize);

/* ---- Devices --------------------------------------------------------------------------------- */

OIDN_API bool oidnIsCPUDeviceSupported(void);
#if defined(__cplusplus)
OIDN_API bool oidnIsSYCLDeviceSupported(const sycl::device *device);
#endif
OIDN_API bool oidnIsCUDADeviceSupported(int deviceID);
OIDN_API bool oidnIsHIPDeviceSupported(int deviceID);
OIDN_API bool oidnIsMetalDeviceSupported(MTLDevice_id device);

OIDN_API OIDNDevice oidnNewDevice(OIDNDeviceType type);
OIDN_API OIDNDevice oidnNewDeviceByID(int physicalDeviceID);
OIDN_API OIDNDevice oidnNewDeviceByUUID(const void *uuid);
OIDN_API OIDNDevice oidnNewDeviceByLUID(const void *luid);
OIDN_API OIDNDevice oidnNewDeviceByPCIAddress(int pciDomain, int pciBus, int pciDevice,
                                              int pciFunction);
#if defined(__cplusplus)
OIDN_API OIDNDevice oidnNewSYCLDevice(const sycl::queue *queues, int numQueues);
#endif
OIDN_API OIDNDevice oidnNewCUDADevice(const int *deviceIDs, const cudaStream_t *streams,
                                      int numPairs);
OIDN_API OIDNDevice oidnNewHIPDevice(const int *deviceIDs, const hipStream_t *streams,
                                     int numPairs);
OIDN_API OIDNDevice oidnNewMetalDevice(const MTLCommandQueue_id *commandQueues, int numQueues);

OIDN_API void oidnRetainDevice(OIDNDevice device);
OIDN_API void oidnReleaseDevice(OIDNDevice device);

/* Parameters to set before the commit: verbose (0 to 4), numThreads (0: one per core), setAffinity.
 * To get: these, type, version, versionMajor, versionMinor, versionPatch, systemMemorySupported,
 * managedMemorySupported, externalMemoryTypes, externalSemaphoreTypes. Setting after the commit
 * makes the device unusable for new objects. */
OIDN_API void oidnSetDeviceBool(OIDNDevice device, const char *name, bool value);
OIDN_API void oidnSetDeviceInt(OIDNDevice device, const char *name, int value);
OIDN_INLINE void oidnSetDeviceUInt(OIDNDevice device, const char *name, unsigned int value)
    OIDN_INLINE_BODY(oidnSetDeviceInt(device, name, (int)value);)
OIDN_API bool oidnGetDeviceBool(OIDNDevice device, const char *name);
OIDN_API int oidnGetDeviceInt(OIDNDevice device, const char *name);
OIDN_INLINE unsigned int oidnGetDeviceUInt(OIDNDevice device, const char *name)
    OIDN_INLINE_BODY(return (unsigned int)oidnGetDeviceInt(device, name);)

OIDN_API void oidnSetDeviceErrorFunction(OIDNDevice device, OIDNErrorFunction func, void *userPtr);

/* Returns and clears the first error since the last call, of this thread on this device (NULL: of
 * no device). *outMessage becomes NULL, or a text valid until this thread's next error there. */
OIDN_API OIDNError oidnGetDeviceError(OIDNDevice device, const char **outMessage);

/* Applies the parameters and starts the threads. Once per device. */
OIDN_API void oidnCommitDevice(OIDNDevice device);

/* Waits for all asynchronous work and reports its error. */
OIDN_API void oidnSyncDevice(OIDNDevice device);

/* ---- Buffers --------------------------------------------------------------------------------- */

OIDN_API OIDNBuffer oidnNewBuffer(OIDNDevice device, size_t byteSize);
OIDN_API OIDNBuffer oidnNewBufferWithStorage(OIDNDevice device, size_t byteSize,
                                             OIDNStorage storage);

/* A buffer over memory of the caller, who keeps it alive. */
OIDN_API OIDNBuffer oidnNewSharedBuffer(OIDNDevice device, void *devPtr, size_t byteSize);
OIDN_API OIDNBuffer oidnNewSharedBufferFromFD(OIDNDevice device, OIDNExternalMemoryTypeFlags fdType,
                                              int fd, size_t byteSize);
OIDN_API OIDNBuffer oidnNewSharedBufferFromWin32Handle(OIDNDevice device,
                                                       OIDNExternalMemoryTypeFlags handleType,
                                                       void *handle, const void *name,
                                                       size_t byteSize);
OIDN_API OIDNBuffer oidnNewSharedBufferFromMetal(OIDNDevice device, MTLBuffer_id buffer);

OIDN_API size_t oidnGetBufferSize(OIDNBuffer buffer);
OIDN_API OIDNStorage oidnGetBufferStorage(OIDNBuffer buffer);
OIDN_API void *oidnGetBufferData(OIDNBuffer buffer); /* NULL for an empty buffer */

/* Copies between a buffer and other memory, after all earlier work of the device. The Async
 * variants return at once; both memories must stay valid until oidnSyncDevice. */
OIDN_API void oidnReadBuffer(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                             void *dstHostPtr);
OIDN_API void oidnReadBufferAsync(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                                  void *dstHostPtr);
OIDN_API void oidnWriteBuffer(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                              const void *srcHostPtr);
OIDN_API void oidnWriteBufferAsync(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                                   const void *srcHostPtr);

OIDN_API void oidnRetainBuffer(OIDNBuffer buffer);
OIDN_API void oidnReleaseBuffer(OIDNBuffer buffer);

/* ---- Semaphores ------------------------------------------------------------------------------ */

/* Imported from graphics interfaces by GPU devices. The CPU device supports no type of them
 * (parameter externalSemaphoreTypes is 0), so every import of some type fails with
 * INVALID_ARGUMENT. */
OIDN_API OIDNSemaphore oidnNewSharedSemaphoreFromFD(OIDNDevice device,
                                                    OIDNExternalSemaphoreTypeFlags fdType, int fd);
OIDN_API OIDNSemaphore oidnNewSharedSemaphoreFromWin32Handle(
    OIDNDevice device, OIDNExternalSemaphoreTypeFlags handleType, void *handle, const void *name);
OIDN_API void oidnSignalSemaphoresAsync(OIDNDevice device, const OIDNSemaphore *semaphores,
                                        const uint64_t *values, int numSemaphores);
OIDN_API void oidnWaitSemaphoresAsync(OIDNDevice device, const OIDNSemaphore *semaphores,
                                      const uint64_t *values, const uint32_t *timeoutsMs,
                                      int numSemaphores);
OIDN_API void oidnRetainSemaphore(OIDNSemaphore semaphore);
OIDN_API void oidnReleaseSemaphore(OIDNSemaphore semaphore);

/* ---- Filters --------------------------------------------------------------------------------- */

/* Types: "RT" (renders) and "RTLightmap" (light maps). */
OIDN_API OIDNFilter oidnNewFilter(OIDNDevice device, const char *type);
OIDN_API void oidnRetainFilter(OIDNFilter filter);
OIDN_API void oidnReleaseFilter(OIDNFilter filter); /* waits for the filter's asynchronous work */

/* Images: color, output; RT also albedo, normal. Strides in bytes, 0 is tight. */
OIDN_API void oidnSetFilterImage(OIDNFilter filter, const char *name, OIDNBuffer buffer,
                                 OIDNFormat format, size_t width, size_t height, size_t byteOffset,
                                 size_t pixelByteStride, size_t rowByteStride);
OIDN_API void oidnSetSharedFilterImage(OIDNFilter filter, const char *name, void *devPtr,
                                       OIDNFormat format, size_t width, size_t height,
                                       size_t byteOffset, size_t pixelByteStride,
                                       size_t rowByteStride);
OIDN_API void oidnUnsetFilterImage(OIDNFilter filter, const char *name);

/* Data: weights (a TZA file). Read only inside oidnCommitFilter; oidnUpdateFilterData says that the
 * bytes have changed. */
OIDN_API void oidnSetSharedFilterData(OIDNFilter filter, const char *name, void *hostPtr,
                                      size_t byteSize);
OIDN_API void oidnUpdateFilterData(OIDNFilter filter, const char *name);
OIDN_API void oidnUnsetFilterData(OIDNFilter filter, const char *name);

/* RT: hdr, srgb, cleanAux. RTLightmap: directional. Both: inputScale, quality, maxMemoryMB; to get
 * only: tileAlignment, tileOverlap. */
OIDN_API void oidnSetFilterBool(OIDNFilter filter, const char *name, bool value);
OIDN_API bool oidnGetFilterBool(OIDNFilter filter, const char *name);
OIDN_API void oidnSetFilterInt(OIDNFilter filter, const char *name, int value);
OIDN_API int oidnGetFilterInt(OIDNFilter filter, const char *name);
OIDN_API void oidnSetFilterFloat(OIDNFilter filter, const char *name, float value);
OIDN_API float oidnGetFilterFloat(OIDNFilter filter, const char *name);

OIDN_API void oidnSetFilterProgressMonitorFunction(OIDNFilter filter,
                                                   OIDNProgressMonitorFunction func, void *userPtr);

/* Checks the parameters, and allocates and prepares everything for execution. */
OIDN_API void oidnCommitFilter(OIDNFilter filter);
OIDN_API void oidnExecuteFilter(OIDNFilter filter);
OIDN_API void oidnExecuteFilterAsync(OIDNFilter filter); /* images must stay valid until a sync */
#if defined(__cplusplus)
OIDN_API void oidnExecuteSYCLFilterAsync(OIDNFilter filter, const sycl::event *depEvents,
                                         int numDepEvents, sycl::event *doneEvent);
#endif

/* ---- Deprecated names ------------------------------------------------------------------------ */

OIDN_DEPRECATED("use oidnSetDeviceBool")
OIDN_INLINE void oidnSetDevice1b(OIDNDevice device, const char *name, bool value)
    OIDN_INLINE_BODY(oidnSetDeviceBool(device, name, value);)
OIDN_DEPRECATED("use oidnSetDeviceInt")
OIDN_INLINE void oidnSetDevice1i(OIDNDevice device, const char *name, int value)
    OIDN_INLINE_BODY(oidnSetDeviceInt(device, name, value);)
OIDN_DEPRECATED("use oidnGetDeviceBool")
OIDN_INLINE bool oidnGetDevice1b(OIDNDevice device, const char *name)
    OIDN_INLINE_BODY(return oidnGetDeviceBool(device, name);)
OIDN_DEPRECATED("use oidnGetDeviceInt")
OIDN_INLINE int oidnGetDevice1i(OIDNDevice device, const char *name)
    OIDN_INLINE_BODY(return oidnGetDeviceInt(device, name);)
OIDN_DEPRECATED("use oidnSetFilterBool")
OIDN_INLINE void oidnSetFilter1b(OIDNFilter filter, const char *name, bool value)
    OIDN_INLINE_BODY(oidnSetFilterBool(filter, name, value);)
OIDN_DEPRECATED("use oidnGetFilterBool")
OIDN_INLINE bool oidnGetFilter1b(OIDNFilter filter, const char *name)
    OIDN_INLINE_BODY(return oidnGetFilterBool(filter, name);)
OIDN_DEPRECATED("use oidnSetFilterInt")
OIDN_INLINE void oidnSetFilter1i(OIDNFilter filter, const char *name, int value)
    OIDN_INLINE_BODY(oidnSetFilterInt(filter, name, value);)
OIDN_DEPRECATED("use oidnGetFilterInt")
OIDN_INLINE int oidnGetFilter1i(OIDNFilter filter, const char *name)
    OIDN_INLINE_BODY(return oidnGetFilterInt(filter, name);)
OIDN_DEPRECATED("use oidnSetFilterFloat")
OIDN_INLINE void oidnSetFilter1f(OIDNFilter filter, const char *name, float value)
    OIDN_INLINE_BODY(oidnSetFilterFloat(filter, name, value);)
OIDN_DEPRECATED("use oidnGetFilterFloat")
OIDN_INLINE float oidnGetFilter1f(OIDNFilter filter, const char *name)
    OIDN_INLINE_BODY(return oidnGetFilterFloat(filter, name);)
OIDN_DEPRECATED("use oidnUnsetFilterImage")
OIDN_INLINE void oidnRemoveFilterImage(OIDNFilter filter, const char *name)
    OIDN_INLINE_BODY(oidnUnsetFilterImage(filter, name);)
OIDN_DEPRECATED("use oidnUnsetFilterData")
OIDN_INLINE void oidnRemoveFilterData(OIDNFilter filter, const char *name)
    OIDN_INLINE_BODY(oidnUnsetFilterData(filter, name);)

/* The mapping functions of the 0.8 and 1.x interface, which 2.x removed. lull always exports them;
 * they are declared if OIDN_LEGACY_1X is defined before this file is included. */
#if defined(OIDN_LEGACY_1X)
typedef enum {
    OIDN_ACCESS_READ = 0,
    OIDN_ACCESS_WRITE = 1,
    OIDN_ACCESS_READ_WRITE = 2,
    OIDN_ACCESS_WRITE_DISCARD = 3
} OIDNAccess;

/* Waits for the device and returns the address of byteOffset, good for byteSize bytes (0: to the
 * end of the buffer). Unmapping checks the address and does nothing else. */
OIDN_API void *oidnMapBuffer(OIDNBuffer buffer, OIDNAccess access, size_t byteOffset,
                             size_t byteSize);
OIDN_API void oidnUnmapBuffer(OIDNBuffer buffer, void *mappedPtr);
#endif

OIDN_API_NAMESPACE_END

#endif
