// The C++ wrapper: every class and function of oidn.hpp, used as programs use them. Also compiled
// with OIDN_API_NAMESPACE, against a library built so.
#include "OpenImageDenoise/oidn.hpp"

#include "identity.h"

#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <vector>

OIDN_NAMESPACE_USING

struct Handle {}; // a name of the program's own, which the namespace must not have, too
static Handle own;

static unsigned passed, failed;

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (condition)                                                                             \
            passed++;                                                                              \
        else {                                                                                     \
            failed++;                                                                              \
            std::printf("FAIL %s:%d: %s\n", __FILE__, __LINE__, #condition);                       \
        }                                                                                          \
    } while (0)

static void physicalDevices()
{
    CHECK(getNumPhysicalDevices() == 1);
    PhysicalDeviceRef none, first(0);
    CHECK(!none && none.getID() == -1);
    none = 0;
    CHECK(none && none.getID() == 0);
    CHECK(first.get<DeviceType>("type") == DeviceType::CPU);
    CHECK(first.get<int>("type") == 1 && first.get<unsigned int>("type") == 1);
    CHECK(!first.get<std::string>("name").empty());
    CHECK(first.get<const char *>("name") != nullptr);
    CHECK(!first.get<bool>("uuidSupported") && !first.get<bool>("luidSupported"));
    CHECK(getError() == Error::None);
    CHECK(first.get<UUID>("uuid").bytes[3] == 0);
    CHECK(getError() == Error::InvalidArgument);
    CHECK(first.get<LUID>("luid").low == 0);
    CHECK(getError() == Error::InvalidArgument);
    CHECK(first.get<std::string>("nonsense").empty());
    const char *message = nullptr;
    CHECK(getError(message) == Error::InvalidArgument && message && *message);
    CHECK(first.getData("uuid").first == nullptr);
    getError();
    CHECK(isCPUDeviceSupported() && !isCUDADeviceSupported(0) && !isHIPDeviceSupported(0));
    CHECK(!isMetalDeviceSupported(nullptr));
    CHECK(bool(first.newDevice()));
}

static void creation()
{
    CHECK(bool(newDevice()));
    CHECK(bool(newDevice(DeviceType::CPU)));
    CHECK(bool(newDevice(0)));
    CHECK(getError() == Error::None);
    CHECK(!newDevice(DeviceType::SYCL) && getError() == Error::UnsupportedHardware);
    CHECK(!newDevice(UUID()) && getError() == Error::InvalidArgument);
    CHECK(!newDevice(LUID()) && getError() == Error::InvalidArgument);
    CHECK(!newDevice(0, 0, 0, 0) && getError() == Error::InvalidArgument);
    CHECK(!newCUDADevice(0, nullptr) && getError() == Error::UnsupportedHardware);
    CHECK(!newHIPDevice(0, nullptr) && getError() == Error::UnsupportedHardware);
    CHECK(!newMetalDevice(nullptr) && getError() == Error::UnsupportedHardware);
    CHECK(!newCUDADevice(std::vector<int>{0}, std::vector<cudaStream_t>{nullptr}));
    CHECK(getError() == Error::UnsupportedHardware);
    CHECK(!newHIPDevice(std::vector<int>{0}, std::vector<hipStream_t>{nullptr}));
    CHECK(getError() == Error::UnsupportedHardware);
    CHECK(!newMetalDevice(std::vector<MTLCommandQueue_id>{nullptr}));
    CHECK(getError() == Error::UnsupportedHardware);
}

static void handles()
{
    (void)own;
    DeviceRef device = newDevice();
    device.commit();
    BufferRef none, a = device.newBuffer(16), b(a), c(std::move(b)), d;
    CHECK(!none && a && !b && c && !d);
    CHECK(a.getHandle() == c.getHandle());
    d = a;
    CHECK(d.getHandle() == a.getHandle());
    d = device.newBuffer(8);
    CHECK(d.getSize() == 8);
    d = a.getHandle(); // adds a reference
    const DeviceRef &same = device;
    device = same;
    CHECK(bool(device));
    a.release();
    c.release();
    CHECK(!a && d.getSize() == 16);
    d = nullptr;
    CHECK(!d);
    FilterRef filter = device.newFilter("RT"), other;
    other = std::move(filter);
    CHECK(other && !filter);
    CHECK(device.getError() == Error::None);
}

// Programs get these from oidn.hpp, as from the original's.
static void standardHeaders()
{
    std::array<int, 3> numbers{{3, 1, 2}};
    std::sort(numbers.begin(), numbers.end());
    CHECK(numbers[0] == 1 && numbers[2] == 3);
}

static void flags()
{
    const ExternalMemoryTypeFlags both =
        ExternalMemoryTypeFlag::OpaqueFD | ExternalMemoryTypeFlag::Dedicated;
    ExternalMemoryTypeFlags some;
    CHECK(!some);
    some |= ExternalMemoryTypeFlag::OpaqueFD;
    CHECK(some == ExternalMemoryTypeFlag::OpaqueFD && some != both);
    CHECK((both & ExternalMemoryTypeFlag::Dedicated) == ExternalMemoryTypeFlag::Dedicated);
    CHECK((ExternalMemoryTypeFlag::Dedicated ^ both) == ExternalMemoryTypeFlag::OpaqueFD);
    CHECK((ExternalMemoryTypeFlag::OpaqueFD & ExternalMemoryTypeFlag::DMABuf) ==
          ExternalMemoryTypeFlag::None);
    some &= ExternalMemoryTypeFlag::DMABuf;
    some ^= both;
    CHECK(static_cast<unsigned int>(some) == (1u | 1u << 30));
    CHECK(
        bool(ExternalSemaphoreTypeFlag::OpaqueFD | ExternalSemaphoreTypeFlag::TimelineSemaphoreFD));
}

static unsigned errors;

static void countErrors(void *user, Error code, const char *message)
{
    *static_cast<unsigned *>(user) += code == Error::InvalidArgument && message;
}

static void devices()
{
    DeviceRef device = newDevice(DeviceType::CPU);
    device.setErrorFunction(countErrors, &errors);
    device.set("verbose", 0);
    device.set("numThreads", 2u);
    device.set("setAffinity", false);
    device.commit();
    CHECK(device.get<int>("version") == OIDN_VERSION);
    CHECK(device.get<unsigned int>("versionMajor") == OIDN_VERSION_MAJOR);
    CHECK(device.get<DeviceType>("type") == DeviceType::CPU);
    CHECK(device.get<bool>("systemMemorySupported"));
    CHECK(!device.get<ExternalMemoryTypeFlags>("externalMemoryTypes"));
    CHECK(!device.get<ExternalSemaphoreTypeFlags>("externalSemaphoreTypes"));
    CHECK(errors == 0);
    device.get<int>("nonsense");
    const char *message = nullptr;
    CHECK(errors == 1 && device.getError(message) == Error::InvalidArgument && message);
    CHECK(!device.newBuffer(ExternalMemoryTypeFlag::OpaqueFD, 0, 16));
    CHECK(!device.newBuffer(ExternalMemoryTypeFlag::OpaqueWin32, &device, nullptr, 16));
    CHECK(!device.newSemaphore(ExternalSemaphoreTypeFlag::OpaqueFD, 0));
    CHECK(!device.newSemaphore(ExternalSemaphoreTypeFlag::OpaqueWin32, &device, nullptr));
    CHECK(errors == 5 && device.getError() == Error::InvalidArgument);
    device.sync();
    CHECK(device.getError() == Error::None);
}

static bool progress(void *user, double n)
{
    *static_cast<double *>(user) = n;
    return true;
}

#if defined(__linux__)
static int countThreads()
{
    char line[256];
    int threads = 0;
    std::FILE *file = std::fopen("/proc/self/status", "r");
    while (file && std::fgets(line, sizeof line, file))
        std::sscanf(line, "Threads: %d", &threads);
    if (file)
        std::fclose(file);
    return threads;
}
#else
static int countThreads() { return 0; }
#endif

static void throwMessage(void *, Error, const char *message) { throw std::runtime_error(message); }

// The programs of Open Image Denoise turn errors into exceptions so. The device ends all the same.
static void exceptions()
{
    const int threads = countThreads();
    int caught = 0;
    for (int i = 0; i < 3; i++) {
        DeviceRef device = newDevice(DeviceType::CPU);
        device.setErrorFunction(throwMessage);
        device.commit();
        try {
            device.newFilter("nonsense");
        } catch (const std::runtime_error &) {
            caught++;
        }
        CHECK(device.getError() == Error::InvalidArgument);
    }
    CHECK(caught == 3);
    CHECK(countThreads() == threads);
}

static void filters()
{
    const size_t width = 30, height = 20, floats = 3 * width * height;
    std::vector<float> in(floats, 0.5f), out(floats, 0.0f);
    size_t bytes = 0;
    void *weights = identity_weights(3, 8, 0, &bytes);
    double last = -1;
    DeviceRef device = newDevice();
    device.commit();
    BufferRef buffer = device.newBuffer(floats * sizeof(float), Storage::Device);
    BufferRef shared = device.newBuffer(out.data(), floats * sizeof(float));
    CHECK(buffer.getStorage() == Storage::Device && shared.getStorage() == Storage::Host);
    CHECK(shared.getData() == out.data());
    buffer.write(0, floats * sizeof(float), in.data());
    FilterRef filter = device.newFilter("RT");
    filter.setImage("color", buffer, Format::Float3, width, height);
    filter.setImage("albedo", nullptr, Format::Float3, 0, 0);
    filter.setImage("output", out.data(), Format::Float3, width, height, 0, 12, 12 * width);
    filter.unsetImage("normal");
    filter.setData("weights", weights, bytes);
    filter.updateData("weights");
    filter.set("srgb", true);
    filter.set("quality", Quality::Balanced);
    filter.set("maxMemoryMB", 100);
    filter.set("inputScale", 1.0f);
    filter.setProgressMonitorFunction(progress, &last);
    filter.commit();
    CHECK(device.getError() == Error::None);
    CHECK(filter.get<bool>("srgb") && filter.get<Quality>("quality") == Quality::Balanced);
    CHECK(filter.get<int>("maxMemoryMB") == 100 && filter.get<float>("inputScale") == 1.0f);
    filter.execute();
    CHECK(last == 1 && out[1] > 0.499f && out[1] < 0.501f);
    last = -1;
    filter.executeAsync();
    shared.readAsync(0, 12, in.data());
    buffer.writeAsync(0, 12, out.data());
    device.sync();
    CHECK(last == 1 && in[0] == out[0]);
    buffer.read(0, 12, in.data());
    CHECK(in[2] == out[2]);
    filter.unsetData("weights");
    CHECK(device.getError() == Error::None);
    std::free(weights);
}

int main()
{
    physicalDevices();
    creation();
    handles();
    standardHeaders();
    flags();
    devices();
    exceptions();
    filters();
    std::printf("%u passed, %u failed, 0 skipped\n", passed, failed);
    return failed != 0;
}
