/* C++11 wrapper of oidn.h: reference-counting handles, no exceptions, header only.
 * Behaviour of every function is that of the C function it forwards to. */
#ifndef OIDN_HPP
#define OIDN_HPP

#include "oidn.h"

/* Also what only programs use that include nothing but this: as much as in Open Image Denoise. */
#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

OIDN_NAMESPACE_BEGIN

/* ---- Enumerations and flags --------------------------------------------------------------- */

enum class Format {
    Undefined = OIDN_FORMAT_UNDEFINED,
    Float = OIDN_FORMAT_FLOAT,
    Float2 = OIDN_FORMAT_FLOAT2,
    Float3 = OIDN_FORMAT_FLOAT3,
    Float4 = OIDN_FORMAT_FLOAT4,
    Half = OIDN_FORMAT_HALF,
    Half2 = OIDN_FORMAT_HALF2,
    Half3 = OIDN_FORMAT_HALF3,
    Half4 = OIDN_FORMAT_HALF4
};

enum class Storage {
    Undefined = OIDN_STORAGE_UNDEFINED,
    Host = OIDN_STORAGE_HOST,
    Device = OIDN_STORAGE_DEVICE,
    Managed = OIDN_STORAGE_MANAGED
};

enum class Quality {
    Default = OIDN_QUALITY_DEFAULT,
    Fast = OIDN_QUALITY_FAST,
    Balanced = OIDN_QUALITY_BALANCED,
    High = OIDN_QUALITY_HIGH
};

enum class DeviceType {
    Default = OIDN_DEVICE_TYPE_DEFAULT,
    CPU = OIDN_DEVICE_TYPE_CPU,
    SYCL = OIDN_DEVICE_TYPE_SYCL,
    CUDA = OIDN_DEVICE_TYPE_CUDA,
    HIP = OIDN_DEVICE_TYPE_HIP,
    Metal = OIDN_DEVICE_TYPE_METAL
};

enum class Error {
    None = OIDN_ERROR_NONE,
    Unknown = OIDN_ERROR_UNKNOWN,
    InvalidArgument = OIDN_ERROR_INVALID_ARGUMENT,
    InvalidOperation = OIDN_ERROR_INVALID_OPERATION,
    OutOfMemory = OIDN_ERROR_OUT_OF_MEMORY,
    UnsupportedHardware = OIDN_ERROR_UNSUPPORTED_HARDWARE,
    Cancelled = OIDN_ERROR_CANCELLED
};

enum class ExternalMemoryTypeFlag : OIDNFlags {
    None = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_NONE,
    OpaqueFD = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_FD,
    DMABuf = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DMA_BUF,
    OpaqueWin32 = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_WIN32,
    OpaqueWin32KMT = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_WIN32_KMT,
    D3D11Texture = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_TEXTURE,
    D3D11TextureKMT = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_TEXTURE_KMT,
    D3D11Resource = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_RESOURCE,
    D3D11ResourceKMT = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D11_RESOURCE_KMT,
    D3D12Heap = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D12_HEAP,
    D3D12Resource = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_D3D12_RESOURCE,
    Dedicated = OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DEDICATED
};

enum class ExternalSemaphoreTypeFlag : OIDNFlags {
    None = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_NONE,
    OpaqueFD = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_FD,
    OpaqueWin32 = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_WIN32,
    OpaqueWin32KMT = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_WIN32_KMT,
    D3D11Fence = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_D3D11_FENCE,
    D3D12Fence = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_D3D12_FENCE,
    KeyedMutex = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_KEYED_MUTEX,
    KeyedMutexKMT = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_KEYED_MUTEX_KMT,
    TimelineSemaphoreFD = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_TIMELINE_SEMAPHORE_FD,
    TimelineSemaphoreWin32 = OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_TIMELINE_SEMAPHORE_WIN32
};

/* True for the enumerations whose values combine with | into Flags. */
template <typename T> struct IsFlag { static constexpr bool value = false; };
template <> struct IsFlag<ExternalMemoryTypeFlag> { static constexpr bool value = true; };
template <> struct IsFlag<ExternalSemaphoreTypeFlag> { static constexpr bool value = true; };

/* A set of flags of one enumeration. */
template <typename T> class Flags {
public:
    static_assert(IsFlag<T>::value, "not a flag type");
    using MaskType = typename std::underlying_type<T>::type;

    constexpr Flags() noexcept : mask_(0) {}
    constexpr Flags(T flag) noexcept : mask_(static_cast<MaskType>(flag)) {}
    constexpr explicit Flags(MaskType mask) noexcept : mask_(mask) {}

    constexpr bool operator!() const noexcept { return mask_ == 0; }
    constexpr explicit operator bool() const noexcept { return mask_ != 0; }
    constexpr explicit operator MaskType() const noexcept { return mask_; }
    constexpr bool operator==(const Flags &b) const noexcept { return mask_ == b.mask_; }
    constexpr bool operator!=(const Flags &b) const noexcept { return mask_ != b.mask_; }
    constexpr Flags operator&(const Flags &b) const noexcept { return Flags(mask_ & b.mask_); }
    constexpr Flags operator|(const Flags &b) const noexcept { return Flags(mask_ | b.mask_); }
    constexpr Flags operator^(const Flags &b) const noexcept { return Flags(mask_ ^ b.mask_); }
    Flags &operator&=(const Flags &b) noexcept { return *this = *this & b; }
    Flags &operator|=(const Flags &b) noexcept { return *this = *this | b; }
    Flags &operator^=(const Flags &b) noexcept { return *this = *this ^ b; }

private:
    MaskType mask_;
};

template <typename T, typename std::enable_if<IsFlag<T>::value, bool>::type = true>
constexpr Flags<T> operator&(T a, T b) noexcept { return Flags<T>(a) & Flags<T>(b); }
template <typename T, typename std::enable_if<IsFlag<T>::value, bool>::type = true>
constexpr Flags<T> operator|(T a, T b) noexcept { return Flags<T>(a) | Flags<T>(b); }
template <typename T, typename std::enable_if<IsFlag<T>::value, bool>::type = true>
constexpr Flags<T> operator^(T a, T b) noexcept { return Flags<T>(a) ^ Flags<T>(b); }
template <typename T> constexpr Flags<T> operator&(T a, const Flags<T> &b) noexcept
{
    return b & a;
}
template <typename T> constexpr Flags<T> operator|(T a, const Flags<T> &b) noexcept
{
    return b | a;
}
template <typename T> constexpr Flags<T> operator^(T a, const Flags<T> &b) noexcept
{
    return b ^ a;
}

using ExternalMemoryTypeFlags = Flags<ExternalMemoryTypeFlag>;
using ExternalSemaphoreTypeFlags = Flags<ExternalSemaphoreTypeFlag>;

/* Identifiers of physical devices. */
struct UUID {
    uint8_t bytes[OIDN_UUID_SIZE];
};

#if defined(__GNUC__)
__extension__ /* the unnamed struct */
#endif
struct LUID {
    union {
        struct {
            uint32_t low;
            int32_t high;
        };
        uint8_t bytes[OIDN_LUID_SIZE];
    };
};

using ProgressMonitorFunction = OIDNProgressMonitorFunction;
typedef void (*ErrorFunction)(void *userPtr, Error code, const char *message);

/* ---- Handles ------------------------------------------------------------------------------ */

/* Owner of one reference to an object of the C interface. Constructing from a C handle takes over
 * the caller's reference; assigning one adds a reference. */
template <typename T, void (*retainFn)(T), void (*releaseFn)(T)> class CountedRef {
public:
    CountedRef() noexcept : handle_(nullptr) {}
    CountedRef(T handle) noexcept : handle_(handle) {}
    CountedRef(const CountedRef &other) : handle_(other.handle_) { retain(handle_); }
    CountedRef(CountedRef &&other) noexcept : handle_(other.handle_) { other.handle_ = nullptr; }
    ~CountedRef() { release(); }

    CountedRef &operator=(const CountedRef &other) { return *this = other.handle_; }
    CountedRef &operator=(CountedRef &&other) noexcept
    {
        std::swap(handle_, other.handle_);
        return *this;
    }
    CountedRef &operator=(T other)
    {
        retain(other);
        release();
        handle_ = other;
        return *this;
    }

    T getHandle() const { return handle_; }
    operator bool() const { return handle_ != nullptr; }
    void release()
    {
        if (handle_)
            releaseFn(handle_);
        handle_ = nullptr;
    }

protected:
    T handle_;

private:
    static void retain(T handle)
    {
        if (handle)
            retainFn(handle);
    }
};

class BufferRef : public CountedRef<OIDNBuffer, oidnRetainBuffer, oidnReleaseBuffer> {
public:
    using CountedRef::CountedRef;
    using CountedRef::operator=;
    BufferRef() = default;

    size_t getSize() const { return oidnGetBufferSize(handle_); }
    Storage getStorage() const { return static_cast<Storage>(oidnGetBufferStorage(handle_)); }
    void *getData() const { return oidnGetBufferData(handle_); }

    void read(size_t byteOffset, size_t byteSize, void *dstHostPtr) const
    {
        oidnReadBuffer(handle_, byteOffset, byteSize, dstHostPtr);
    }
    void readAsync(size_t byteOffset, size_t byteSize, void *dstHostPtr) const
    {
        oidnReadBufferAsync(handle_, byteOffset, byteSize, dstHostPtr);
    }
    void write(size_t byteOffset, size_t byteSize, const void *srcHostPtr)
    {
        oidnWriteBuffer(handle_, byteOffset, byteSize, srcHostPtr);
    }
    void writeAsync(size_t byteOffset, size_t byteSize, const void *srcHostPtr)
    {
        oidnWriteBufferAsync(handle_, byteOffset, byteSize, srcHostPtr);
    }
};

class SemaphoreRef : public CountedRef<OIDNSemaphore, oidnRetainSemaphore, oidnReleaseSemaphore> {
public:
    using CountedRef::CountedRef;
    using CountedRef::operator=;
    SemaphoreRef() = default;
};

class FilterRef : public CountedRef<OIDNFilter, oidnRetainFilter, oidnReleaseFilter> {
public:
    using CountedRef::CountedRef;
    using CountedRef::operator=;
    FilterRef() = default;

    void setImage(const char *name, const BufferRef &buffer, Format format, size_t width,
                  size_t height, size_t byteOffset = 0, size_t pixelByteStride = 0,
                  size_t rowByteStride = 0)
    {
        oidnSetFilterImage(handle_, name, buffer.getHandle(), static_cast<OIDNFormat>(format),
                           width, height, byteOffset, pixelByteStride, rowByteStride);
    }
    void setImage(const char *name, void *devPtr, Format format, size_t width, size_t height,
                  size_t byteOffset = 0, size_t pixelByteStride = 0, size_t rowByteStride = 0)
    {
        oidnSetSharedFilterImage(handle_, name, devPtr, static_cast<OIDNFormat>(format), width,
                                 height, byteOffset, pixelByteStride, rowByteStride);
    }
    void unsetImage(const char *name) { oidnUnsetFilterImage(handle_, name); }
    OIDN_DEPRECATED("use unsetImage") void removeImage(const char *name) { unsetImage(name); }

    void setData(const char *name, void *hostPtr, size_t byteSize)
    {
        oidnSetSharedFilterData(handle_, name, hostPtr, byteSize);
    }
    void updateData(const char *name) { oidnUpdateFilterData(handle_, name); }
    void unsetData(const char *name) { oidnUnsetFilterData(handle_, name); }
    OIDN_DEPRECATED("use unsetData") void removeData(const char *name) { unsetData(name); }

    void set(const char *name, bool value) { oidnSetFilterBool(handle_, name, value); }
    void set(const char *name, int value) { oidnSetFilterInt(handle_, name, value); }
    void set(const char *name, Quality value) { set(name, static_cast<int>(value)); }
    void set(const char *name, float value) { oidnSetFilterFloat(handle_, name, value); }

    /* T: bool, int, Quality, float */
    template <typename T> T get(const char *name) const;

    void setProgressMonitorFunction(ProgressMonitorFunction func, void *userPtr = nullptr)
    {
        oidnSetFilterProgressMonitorFunction(handle_, func, userPtr);
    }
    void commit() { oidnCommitFilter(handle_); }
    void execute() { oidnExecuteFilter(handle_); }
    void executeAsync() { oidnExecuteFilterAsync(handle_); }
#if defined(OIDN_SYCL_HPP)
    sycl::event executeAsync(const std::vector<sycl::event> &depEvents)
    {
        sycl::event done;
        oidnExecuteSYCLFilterAsync(handle_, depEvents.data(), static_cast<int>(depEvents.size()),
                                   &done);
        return done;
    }
#endif
};

template <> inline bool FilterRef::get(const char *name) const
{
    return oidnGetFilterBool(handle_, name);
}
template <> inline int FilterRef::get(const char *name) const
{
    return oidnGetFilterInt(handle_, name);
}
template <> inline Quality FilterRef::get(const char *name) const
{
    return static_cast<Quality>(oidnGetFilterInt(handle_, name));
}
template <> inline float FilterRef::get(const char *name) const
{
    return oidnGetFilterFloat(handle_, name);
}

class DeviceRef : public CountedRef<OIDNDevice, oidnRetainDevice, oidnReleaseDevice> {
public:
    using CountedRef::CountedRef;
    using CountedRef::operator=;
    DeviceRef() = default;

    void set(const char *name, bool value) { oidnSetDeviceBool(handle_, name, value); }
    void set(const char *name, int value) { oidnSetDeviceInt(handle_, name, value); }
    void set(const char *name, unsigned int value) { oidnSetDeviceUInt(handle_, name, value); }

    /* T: bool, int, unsigned int, DeviceType, External{Memory,Semaphore}TypeFlags */
    template <typename T> T get(const char *name) const;

    void setErrorFunction(ErrorFunction func, void *userPtr = nullptr)
    {
        oidnSetDeviceErrorFunction(handle_, reinterpret_cast<OIDNErrorFunction>(func), userPtr);
    }
    Error getError() { return static_cast<Error>(oidnGetDeviceError(handle_, nullptr)); }
    Error getError(const char *&outMessage)
    {
        return static_cast<Error>(oidnGetDeviceError(handle_, &outMessage));
    }

    void commit() { oidnCommitDevice(handle_); }
    void sync() { oidnSyncDevice(handle_); }

    BufferRef newBuffer(size_t byteSize) const { return oidnNewBuffer(handle_, byteSize); }
    BufferRef newBuffer(size_t byteSize, Storage storage) const
    {
        return oidnNewBufferWithStorage(handle_, byteSize, static_cast<OIDNStorage>(storage));
    }
    BufferRef newBuffer(void *ptr, size_t byteSize) const
    {
        return oidnNewSharedBuffer(handle_, ptr, byteSize);
    }
    BufferRef newBuffer(ExternalMemoryTypeFlags fdType, int fd, size_t byteSize) const
    {
        return oidnNewSharedBufferFromFD(handle_, static_cast<OIDNFlags>(fdType), fd, byteSize);
    }
    BufferRef newBuffer(ExternalMemoryTypeFlags handleType, void *handle, const void *name,
                        size_t byteSize) const
    {
        return oidnNewSharedBufferFromWin32Handle(handle_, static_cast<OIDNFlags>(handleType),
                                                  handle, name, byteSize);
    }
#if defined(__OBJC__)
    BufferRef newBuffer(id<MTLBuffer> buffer) const
    {
        return oidnNewSharedBufferFromMetal(handle_, buffer);
    }
#endif

    SemaphoreRef newSemaphore(ExternalSemaphoreTypeFlags fdType, int fd) const
    {
        return oidnNewSharedSemaphoreFromFD(handle_, static_cast<OIDNFlags>(fdType), fd);
    }
    SemaphoreRef newSemaphore(ExternalSemaphoreTypeFlags handleType, void *handle,
                              const void *name) const
    {
        return oidnNewSharedSemaphoreFromWin32Handle(handle_, static_cast<OIDNFlags>(handleType),
                                                     handle, name);
    }
    void signalAsync(const SemaphoreRef &semaphore, uint64_t value)
    {
        OIDNSemaphore s = semaphore.getHandle();
        oidnSignalSemaphoresAsync(handle_, &s, &value, 1);
    }
    void waitAsync(const SemaphoreRef &semaphore, uint64_t value, uint32_t timeoutMs = UINT32_MAX)
    {
        OIDNSemaphore s = semaphore.getHandle();
        oidnWaitSemaphoresAsync(handle_, &s, &value, &timeoutMs, 1);
    }

    FilterRef newFilter(const char *type) const { return oidnNewFilter(handle_, type); }
};

template <> inline bool DeviceRef::get(const char *name) const
{
    return oidnGetDeviceBool(handle_, name);
}
template <> inline int DeviceRef::get(const char *name) const
{
    return oidnGetDeviceInt(handle_, name);
}
template <> inline unsigned int DeviceRef::get(const char *name) const
{
    return oidnGetDeviceUInt(handle_, name);
}
template <> inline DeviceType DeviceRef::get(const char *name) const
{
    return static_cast<DeviceType>(oidnGetDeviceInt(handle_, name));
}
template <> inline ExternalMemoryTypeFlags DeviceRef::get(const char *name) const
{
    return ExternalMemoryTypeFlags(oidnGetDeviceUInt(handle_, name));
}
template <> inline ExternalSemaphoreTypeFlags DeviceRef::get(const char *name) const
{
    return ExternalSemaphoreTypeFlags(oidnGetDeviceUInt(handle_, name));
}

/* ---- Functions without an object ---------------------------------------------------------- */

/* Errors of this thread that belong to no device. */
inline Error getError() { return static_cast<Error>(oidnGetDeviceError(nullptr, nullptr)); }
inline Error getError(const char *&outMessage)
{
    return static_cast<Error>(oidnGetDeviceError(nullptr, &outMessage));
}

inline bool isCPUDeviceSupported() { return oidnIsCPUDeviceSupported(); }
inline bool isCUDADeviceSupported(int deviceID) { return oidnIsCUDADeviceSupported(deviceID); }
inline bool isHIPDeviceSupported(int deviceID) { return oidnIsHIPDeviceSupported(deviceID); }
inline bool isMetalDeviceSupported(MTLDevice_id device)
{
    return oidnIsMetalDeviceSupported(device);
}

inline DeviceRef newDevice(DeviceType type = DeviceType::Default)
{
    return DeviceRef(oidnNewDevice(static_cast<OIDNDeviceType>(type)));
}
inline DeviceRef newDevice(int physicalDeviceID)
{
    return DeviceRef(oidnNewDeviceByID(physicalDeviceID));
}
inline DeviceRef newDevice(const UUID &uuid) { return DeviceRef(oidnNewDeviceByUUID(uuid.bytes)); }
inline DeviceRef newDevice(const LUID &luid) { return DeviceRef(oidnNewDeviceByLUID(luid.bytes)); }
inline DeviceRef newDevice(int pciDomain, int pciBus, int pciDevice, int pciFunction)
{
    return DeviceRef(oidnNewDeviceByPCIAddress(pciDomain, pciBus, pciDevice, pciFunction));
}

#if defined(OIDN_SYCL_HPP)
inline bool isSYCLDeviceSupported(const sycl::device &device)
{
    return oidnIsSYCLDeviceSupported(&device);
}
inline DeviceRef newSYCLDevice(const sycl::queue &queue)
{
    return DeviceRef(oidnNewSYCLDevice(&queue, 1));
}
inline DeviceRef newSYCLDevice(const std::vector<sycl::queue> &queues)
{
    return DeviceRef(oidnNewSYCLDevice(queues.data(), static_cast<int>(queues.size())));
}
#endif

inline DeviceRef newCUDADevice(int deviceID, cudaStream_t stream)
{
    return DeviceRef(oidnNewCUDADevice(&deviceID, &stream, 1));
}
inline DeviceRef newCUDADevice(const std::vector<int> &deviceIDs,
                               const std::vector<cudaStream_t> &streams)
{
    assert(deviceIDs.size() == streams.size());
    return DeviceRef(oidnNewCUDADevice(deviceIDs.data(), streams.data(),
                                       static_cast<int>(streams.size())));
}
inline DeviceRef newHIPDevice(int deviceID, hipStream_t stream)
{
    return DeviceRef(oidnNewHIPDevice(&deviceID, &stream, 1));
}
inline DeviceRef newHIPDevice(const std::vector<int> &deviceIDs,
                              const std::vector<hipStream_t> &streams)
{
    assert(deviceIDs.size() == streams.size());
    return DeviceRef(oidnNewHIPDevice(deviceIDs.data(), streams.data(),
                                      static_cast<int>(streams.size())));
}
inline DeviceRef newMetalDevice(MTLCommandQueue_id commandQueue)
{
    return DeviceRef(oidnNewMetalDevice(&commandQueue, 1));
}
inline DeviceRef newMetalDevice(const std::vector<MTLCommandQueue_id> &commandQueues)
{
    return DeviceRef(
        oidnNewMetalDevice(commandQueues.data(), static_cast<int>(commandQueues.size())));
}

/* ---- Physical devices --------------------------------------------------------------------- */

inline int getNumPhysicalDevices() { return oidnGetNumPhysicalDevices(); }

class PhysicalDeviceRef {
public:
    PhysicalDeviceRef() : id_(-1) {}
    PhysicalDeviceRef(int id) : id_(id) {}
    PhysicalDeviceRef &operator=(int other)
    {
        id_ = other;
        return *this;
    }

    int getID() const { return id_; }
    operator bool() const { return id_ >= 0; }

    /* T: bool, int, unsigned int, DeviceType, const char*, std::string, UUID, LUID */
    template <typename T> T get(const char *name) const;

    std::pair<const void *, size_t> getData(const char *name) const
    {
        size_t size = 0;
        const void *data = oidnGetPhysicalDeviceData(id_, name, &size);
        return {data, size};
    }
    DeviceRef newDevice() { return DeviceRef(oidnNewDeviceByID(id_)); }

private:
    /* Fills `bytes` from a data parameter, which must be of just that size. */
    template <size_t N> void getBytes(const char *name, uint8_t (&bytes)[N]) const
    {
        const std::pair<const void *, size_t> data = getData(name);
        if (data.first && data.second == N)
            std::memcpy(bytes, data.first, N);
        else if (data.first)
            getData(""); /* reports InvalidArgument */
    }

    int id_;
};

template <> inline bool PhysicalDeviceRef::get(const char *name) const
{
    return oidnGetPhysicalDeviceBool(id_, name);
}
template <> inline int PhysicalDeviceRef::get(const char *name) const
{
    return oidnGetPhysicalDeviceInt(id_, name);
}
template <> inline unsigned int PhysicalDeviceRef::get(const char *name) const
{
    return oidnGetPhysicalDeviceUInt(id_, name);
}
template <> inline DeviceType PhysicalDeviceRef::get(const char *name) const
{
    return static_cast<DeviceType>(oidnGetPhysicalDeviceInt(id_, name));
}
template <> inline const char *PhysicalDeviceRef::get(const char *name) const
{
    return oidnGetPhysicalDeviceString(id_, name);
}
template <> inline std::string PhysicalDeviceRef::get(const char *name) const
{
    const char *text = oidnGetPhysicalDeviceString(id_, name);
    return text ? text : "";
}
template <> inline UUID PhysicalDeviceRef::get(const char *name) const
{
    UUID uuid{};
    getBytes(name, uuid.bytes);
    return uuid;
}
template <> inline LUID PhysicalDeviceRef::get(const char *name) const
{
    LUID luid{};
    getBytes(name, luid.bytes);
    return luid;
}

OIDN_NAMESPACE_END

#endif
