/* The contract of devices, row by row: physical devices, creation, parameters, states, NULL
 * handles, errors. */
#include "api.h"

#include <limits.h>

/* Declared for C++ only, and exported with C linkage. */
bool oidnIsSYCLDeviceSupported(const void *device);
OIDNDevice oidnNewSYCLDevice(const void *queues, int count);
void oidnExecuteSYCLFilterAsync(OIDNFilter filter, const void *events, int count, void *done);

/* ---- Physical devices ------------------------------------------------------------------------ */

static void physical_devices(void)
{
    static const struct {
        const char *name;
        char kind; /* i: integer, s: string, d: data */
        int value; /* of integers; -1: an error */
    } rows[] = {
        {"type", 'i', OIDN_DEVICE_TYPE_CPU},
        {"name", 's', 0},
        {"uuidSupported", 'i', 0},
        {"luidSupported", 'i', 0},
        {"pciAddressSupported", 'i', 0},
        {"uuid", 'd', -1},
        {"luid", 'd', -1},
        {"nodeMask", 'i', -1},
        {"pciDomain", 'i', -1},
        {"pciBus", 'i', -1},
        {"pciDevice", 'i', -1},
        {"pciFunction", 'i', -1},
        {"nonsense", 'x', 0},
        {"", 'x', 0},
        {"Type", 'x', 0},
        {NULL, 'x', 0},
    };
    const int count = oidnGetNumPhysicalDevices();
    size_t bytes = 5, i;

    CHECK_EQ(count, 1);
    ERROR(NULL, NONE);
    for (i = 0; i < COUNT(rows); i++) {
        const int good = rows[i].kind == 'i' && rows[i].value >= 0;
        size_t size = 77;
        const char *text;

        CHECK_EQ(oidnGetPhysicalDeviceInt(0, rows[i].name), good ? rows[i].value : 0);
        ERROR(NULL, good ? NONE : ARGUMENT);
        CHECK_EQ(oidnGetPhysicalDeviceBool(0, rows[i].name), good && rows[i].value);
        ERROR(NULL, good ? NONE : ARGUMENT);
        CHECK_EQ(oidnGetPhysicalDeviceUInt(0, rows[i].name), good ? (unsigned)rows[i].value : 0);
        ERROR(NULL, good ? NONE : ARGUMENT);
        text = oidnGetPhysicalDeviceString(0, rows[i].name);
        CHECK((text && *text) == (rows[i].kind == 's'));
        ERROR(NULL, rows[i].kind == 's' ? NONE : ARGUMENT);
        CHECK(!oidnGetPhysicalDeviceData(0, rows[i].name, &size));
        CHECK_EQ(size, 77);
        ERROR(NULL, ARGUMENT);
    }
    for (i = 0; i < 4; i++) {
        const int ids[] = {-1, 1, INT_MAX, INT_MIN};

        CHECK_EQ(oidnGetPhysicalDeviceInt(ids[i], "type"), 0);
        ERROR(NULL, ARGUMENT);
        CHECK(!oidnGetPhysicalDeviceBool(ids[i], "type"));
        ERROR(NULL, ARGUMENT);
        CHECK(!oidnGetPhysicalDeviceString(ids[i], "name"));
        ERROR(NULL, ARGUMENT);
        CHECK(!oidnGetPhysicalDeviceData(ids[i], "uuid", &bytes));
        CHECK_EQ(bytes, 5);
        ERROR(NULL, ARGUMENT);
        CHECK(!oidnNewDeviceByID(ids[i]));
        ERROR(NULL, ARGUMENT);
    }
    CHECK(oidnIsCPUDeviceSupported());
    CHECK(!oidnIsCUDADeviceSupported(0));
    CHECK(!oidnIsHIPDeviceSupported(0));
    CHECK(!oidnIsMetalDeviceSupported(NULL));
    CHECK(!oidnIsSYCLDeviceSupported(NULL));
    ERROR(NULL, NONE);
}

/* ---- Creation of devices --------------------------------------------------------------------- */

static void device_creation(void)
{
    static const struct {
        int type;
        OIDNError error;
    } rows[] = {
        {OIDN_DEVICE_TYPE_DEFAULT, NONE},
        {OIDN_DEVICE_TYPE_CPU, NONE},
        {OIDN_DEVICE_TYPE_SYCL, HARDWARE},
        {OIDN_DEVICE_TYPE_CUDA, HARDWARE},
        {OIDN_DEVICE_TYPE_HIP, HARDWARE},
        {OIDN_DEVICE_TYPE_METAL, HARDWARE},
        {6, UNKNOWN},
        {-1, UNKNOWN},
        {INT_MAX, UNKNOWN},
    };
    static const unsigned char id[16] = {1};
    const int numbers[1] = {0};
    const cudaStream_t streams[1] = {NULL};
    const hipStream_t hip_streams[1] = {NULL};
    const MTLCommandQueue_id queues[1] = {NULL};
    OIDNDevice device;
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        device = oidnNewDevice((OIDNDeviceType)rows[i].type);
        CHECK_EQ(device != NULL, rows[i].error == NONE);
        ERROR(NULL, rows[i].error);
        if (device)
            oidnReleaseDevice(device);
    }
    device = oidnNewDeviceByID(0);
    CHECK(device != NULL);
    oidnReleaseDevice(device);
    ERROR(NULL, NONE);
    CHECK(!oidnNewDeviceByUUID(NULL));
    ERROR(NULL, ARGUMENT);
    CHECK(!oidnNewDeviceByUUID(id));
    ERROR(NULL, ARGUMENT);
    CHECK(!oidnNewDeviceByLUID(NULL));
    ERROR(NULL, ARGUMENT);
    CHECK(!oidnNewDeviceByLUID(id));
    ERROR(NULL, ARGUMENT);
    CHECK(!oidnNewDeviceByPCIAddress(0, 0, 0, 0));
    ERROR(NULL, ARGUMENT);
    CHECK(!oidnNewCUDADevice(numbers, streams, 1));
    ERROR(NULL, HARDWARE);
    CHECK(!oidnNewHIPDevice(numbers, hip_streams, 1));
    ERROR(NULL, HARDWARE);
    CHECK(!oidnNewMetalDevice(queues, 1));
    ERROR(NULL, HARDWARE);
    CHECK(!oidnNewSYCLDevice(&id, 1));
    ERROR(NULL, HARDWARE);
}

/* ---- Device parameters ----------------------------------------------------------------------- */

static void device_parameters(void)
{
    static const struct {
        const char *name;
        int initial;
        int settable;
    } rows[] = {
        {"type", OIDN_DEVICE_TYPE_CPU, 0},
        {"version", 20501, 0},
        {"versionMajor", 2, 0},
        {"versionMinor", 5, 0},
        {"versionPatch", 1, 0},
        {"systemMemorySupported", 1, 0},
        {"managedMemorySupported", 1, 0},
        {"externalMemoryTypes", 0, 0},
        {"externalSemaphoreTypes", 0, 0},
        {"verbose", 0, 1},
        {"numThreads", 0, 1},
        {"setAffinity", 1, 1},
    };
    OIDNDevice device;
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        const char *name = rows[i].name;

        device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
        CHECK_EQ(oidnGetDeviceInt(device, name), rows[i].initial);
        CHECK_EQ(oidnGetDeviceBool(device, name), rows[i].initial != 0);
        CHECK_EQ(oidnGetDeviceUInt(device, name), (unsigned)rows[i].initial);
        ERROR(device, NONE);
        oidnSetDeviceInt(device, name, 0);
        ERROR(device, NONE);
        CHECK_EQ(oidnGetDeviceInt(device, name), rows[i].settable ? 0 : rows[i].initial);
        oidnSetDeviceBool(device, name, true);
        ERROR(device, NONE);
        CHECK_EQ(oidnGetDeviceInt(device, name), rows[i].settable ? 1 : rows[i].initial);
        oidnSetDeviceInt(device, "verbose", 0);
        ERROR(device, NONE);
        oidnReleaseDevice(device);
    }
    device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    oidnSetDeviceInt(device, "numThreads", 1);
    CHECK_EQ(oidnGetDeviceInt(device, "numThreads"), 1);
    oidnCommitDevice(device);
    CHECK_EQ(oidnGetDeviceInt(device, "numThreads"), 1);
    oidnReleaseDevice(device);
    device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    oidnSetDeviceInt(device, "numThreads", 100000);
    oidnSetDeviceBool(device, "setAffinity", false);
    CHECK_EQ(oidnGetDeviceInt(device, "numThreads"), 100000);
    oidnCommitDevice(device);
    ERROR(device, NONE);
    CHECK(oidnGetDeviceInt(device, "numThreads") >= 1);
    CHECK(oidnGetDeviceInt(device, "numThreads") < 100000);
    CHECK(!oidnGetDeviceBool(device, "setAffinity"));
    oidnReleaseDevice(device);
}

/* Unknown names: getting is an error, setting is not; NULL is one always. */
static void device_parameter_names(void)
{
    static const char *const unknown[] = {"nonsense", "", "Verbose", "numThreads "};
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);
    size_t i;

    for (i = 0; i < COUNT(unknown); i++) {
        CHECK_EQ(oidnGetDeviceInt(device, unknown[i]), 0);
        ERROR(device, ARGUMENT);
        CHECK_EQ(oidnGetDeviceBool(device, unknown[i]), 0);
        ERROR(device, ARGUMENT);
        oidnSetDeviceInt(device, unknown[i], 1);
        ERROR(device, NONE);
        oidnSetDeviceBool(device, unknown[i], true);
        ERROR(device, NONE);
    }
    CHECK_EQ(oidnGetDeviceInt(device, NULL), 0);
    ERROR(device, ARGUMENT);
    CHECK_EQ(oidnGetDeviceBool(device, NULL), 0);
    ERROR(device, ARGUMENT);
    oidnSetDeviceInt(device, NULL, 1);
    ERROR(device, ARGUMENT);
    oidnSetDeviceBool(device, NULL, true);
    ERROR(device, ARGUMENT);
    oidnCommitDevice(device); /* setting unknown names before the commit does no harm */
    ERROR(device, NONE);
    oidnSyncDevice(device);
    ERROR(device, NONE);
    oidnReleaseDevice(device);
}

/* ---- States of a device ---------------------------------------------------------------------- */

/* All calls that need a committed, clean device fail with `error`, or all work. */
static void check_device_calls(OIDNDevice device, OIDNError error)
{
    char memory[16];
    OIDNBuffer buffer;
    OIDNFilter filter;

    oidnSyncDevice(device);
    ERROR(device, error);
    filter = oidnNewFilter(device, "RT");
    CHECK_EQ(filter != NULL, error == NONE);
    ERROR(device, error);
    if (filter)
        oidnReleaseFilter(filter);
    CHECK(!oidnNewFilter(device, NULL));
    ERROR(device, error == NONE ? ARGUMENT : error); /* the state of the device is checked first */
    CHECK(!oidnNewFilter(device, "*"));
    ERROR(device, error == NONE ? ARGUMENT : error);
    buffer = oidnNewBuffer(device, 16);
    CHECK_EQ(buffer != NULL, error == NONE);
    ERROR(device, error);
    if (buffer)
        oidnReleaseBuffer(buffer);
    buffer = oidnNewBufferWithStorage(device, 16, OIDN_STORAGE_HOST);
    CHECK_EQ(buffer != NULL, error == NONE);
    ERROR(device, error);
    if (buffer)
        oidnReleaseBuffer(buffer);
    buffer = oidnNewSharedBuffer(device, memory, sizeof memory);
    CHECK_EQ(buffer != NULL, error == NONE);
    ERROR(device, error);
    if (buffer)
        oidnReleaseBuffer(buffer);
    CHECK(!oidnNewSharedBufferFromFD(device, OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_FD, 0, 16));
    ERROR(device, error == NONE ? ARGUMENT : error);
    CHECK(!oidnNewSharedBufferFromWin32Handle(device, OIDN_EXTERNAL_MEMORY_TYPE_FLAG_OPAQUE_WIN32,
                                              memory, NULL, 16));
    ERROR(device, error == NONE ? ARGUMENT : error);
    CHECK(!oidnNewSharedBufferFromMetal(device, memory));
    ERROR(device, OPERATION);
    CHECK(!oidnNewSharedSemaphoreFromFD(device, OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_FD, 0));
    ERROR(device, error == NONE ? ARGUMENT : error);
    CHECK(!oidnNewSharedSemaphoreFromWin32Handle(
        device, OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_OPAQUE_WIN32, memory, NULL));
    ERROR(device, error == NONE ? ARGUMENT : error);
}

static void device_states(void)
{
    OIDNDevice device = oidnNewDevice(OIDN_DEVICE_TYPE_CPU);

    check_device_calls(device, OPERATION);
    oidnCommitDevice(device);
    ERROR(device, NONE);
    check_device_calls(device, NONE);
    oidnCommitDevice(device);
    ERROR(device, OPERATION);
    check_device_calls(device, NONE);
    oidnReleaseDevice(device);
}

/* Any parameter set after the commit, even an unknown one, closes the device to new objects; those
 * that exist go on working. */
static void device_set_after_commit(void)
{
    static const char *const names[] = {"verbose", "numThreads", "nonsense", "version"};
    float in[3] = {0.25f, 0.5f, 0.75f}, out[3];
    size_t i;

    for (i = 0; i < COUNT(names); i++) {
        OIDNDevice device = new_device();
        OIDNFilter filter = new_identity(device, in, out, 1, 1);

        oidnSetDeviceInt(device, names[i], 0);
        ERROR(device, NONE);
        check_device_calls(device, OPERATION);
        oidnCommitDevice(device);
        ERROR(device, OPERATION);
        memset(out, 0, sizeof out);
        oidnExecuteFilter(filter);
        ERROR(device, NONE);
        CHECK(fabsf(out[1] - 0.5f) < 1e-3f);
        oidnReleaseFilter(filter);
        oidnReleaseDevice(device);
    }
}

/* ---- NULL handles ---------------------------------------------------------------------------- */

static void null_handles(void)
{
    char byte = 0;

#define NULL_CALL(call)                                                                            \
    do {                                                                                           \
        call;                                                                                      \
        ERROR(NULL, ARGUMENT);                                                                     \
    } while (0)
    NULL_CALL(oidnRetainDevice(NULL));
    NULL_CALL(oidnReleaseDevice(NULL));
    NULL_CALL(oidnSetDeviceBool(NULL, "verbose", true));
    NULL_CALL(oidnSetDeviceInt(NULL, "verbose", 1));
    NULL_CALL(oidnSetDeviceUInt(NULL, NULL, 1));
    NULL_CALL(CHECK(!oidnGetDeviceBool(NULL, "verbose")));
    NULL_CALL(CHECK(!oidnGetDeviceInt(NULL, "version")));
    NULL_CALL(oidnSetDeviceErrorFunction(NULL, NULL, NULL));
    NULL_CALL(oidnCommitDevice(NULL));
    NULL_CALL(oidnSyncDevice(NULL));
    NULL_CALL(CHECK(!oidnNewBuffer(NULL, 1)));
    NULL_CALL(CHECK(!oidnNewBufferWithStorage(NULL, 1, OIDN_STORAGE_HOST)));
    NULL_CALL(CHECK(!oidnNewSharedBuffer(NULL, &byte, 1)));
    NULL_CALL(CHECK(!oidnNewSharedBufferFromFD(NULL, 1, 0, 1)));
    NULL_CALL(CHECK(!oidnNewSharedBufferFromWin32Handle(NULL, 4, &byte, NULL, 1)));
    NULL_CALL(CHECK(!oidnNewSharedBufferFromMetal(NULL, NULL)));
    NULL_CALL(CHECK(!oidnGetBufferSize(NULL)));
    NULL_CALL(CHECK(!oidnGetBufferStorage(NULL)));
    NULL_CALL(CHECK(!oidnGetBufferData(NULL)));
    NULL_CALL(oidnReadBuffer(NULL, 0, 0, &byte));
    NULL_CALL(oidnReadBufferAsync(NULL, 0, 0, &byte));
    NULL_CALL(oidnWriteBuffer(NULL, 0, 0, &byte));
    NULL_CALL(oidnWriteBufferAsync(NULL, 0, 0, &byte));
    NULL_CALL(oidnRetainBuffer(NULL));
    NULL_CALL(oidnReleaseBuffer(NULL));
    NULL_CALL(CHECK(!oidnNewSharedSemaphoreFromFD(NULL, 1, 0)));
    NULL_CALL(CHECK(!oidnNewSharedSemaphoreFromWin32Handle(NULL, 2, &byte, NULL)));
    NULL_CALL(oidnSignalSemaphoresAsync(NULL, NULL, NULL, 0));
    NULL_CALL(oidnWaitSemaphoresAsync(NULL, NULL, NULL, NULL, 0));
    NULL_CALL(oidnRetainSemaphore(NULL));
    NULL_CALL(oidnReleaseSemaphore(NULL));
    NULL_CALL(CHECK(!oidnNewFilter(NULL, "RT")));
    NULL_CALL(oidnRetainFilter(NULL));
    NULL_CALL(oidnReleaseFilter(NULL));
    NULL_CALL(oidnSetFilterImage(NULL, "color", NULL, OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0));
    NULL_CALL(oidnSetSharedFilterImage(NULL, NULL, NULL, OIDN_FORMAT_FLOAT3, 1, 1, 0, 0, 0));
    NULL_CALL(oidnUnsetFilterImage(NULL, "color"));
    NULL_CALL(oidnSetSharedFilterData(NULL, "weights", &byte, 1));
    NULL_CALL(oidnUpdateFilterData(NULL, "weights"));
    NULL_CALL(oidnUnsetFilterData(NULL, "weights"));
    NULL_CALL(oidnSetFilterBool(NULL, "hdr", true));
    NULL_CALL(CHECK(!oidnGetFilterBool(NULL, "hdr")));
    NULL_CALL(oidnSetFilterInt(NULL, "quality", 4));
    NULL_CALL(CHECK(!oidnGetFilterInt(NULL, "quality")));
    NULL_CALL(oidnSetFilterFloat(NULL, "inputScale", 1));
    NULL_CALL(CHECK(oidnGetFilterFloat(NULL, "inputScale") == 0));
    NULL_CALL(oidnSetFilterProgressMonitorFunction(NULL, NULL, NULL));
    NULL_CALL(oidnCommitFilter(NULL));
    NULL_CALL(oidnExecuteFilter(NULL));
    NULL_CALL(oidnExecuteFilterAsync(NULL));
    NULL_CALL(oidnExecuteSYCLFilterAsync(NULL, NULL, 0, NULL));
    if (!is_peer()) {
        NULL_CALL(CHECK(!oidnMapBuffer(NULL, OIDN_ACCESS_READ, 0, 0)));
        NULL_CALL(oidnUnmapBuffer(NULL, NULL));
    }
}

/* ---- Errors ---------------------------------------------------------------------------------- */

typedef struct record {
    int count;
    OIDNError last;
    char text[200];
} record;

static void on_error(void *user, OIDNError code, const char *message)
{
    record *r = user;

    r->count++;
    r->last = code;
    strncpy(r->text, message, sizeof r->text - 1);
}

/* Only the first error is kept until it is read; the callback hears all. */
static void error_slots(void)
{
    OIDNDevice device = new_device(), other = new_device();
    record r = {0, NONE, ""};
    const char *text;

    oidnSetDeviceErrorFunction(device, on_error, &r);
    oidnSetDeviceErrorFunction(device, on_error, &r);
    CHECK_EQ(r.count, 0);
    oidnNewFilter(device, "*");
    CHECK_EQ(r.count, 1);
    CHECK_EQ(r.last, ARGUMENT);
    CHECK(r.text[0] != 0);
    oidnCommitDevice(device);
    CHECK_EQ(r.count, 2);
    CHECK_EQ(r.last, OPERATION);
    CHECK_EQ(oidnGetDeviceError(other, NULL), NONE);
    CHECK_EQ(oidnGetDeviceError(NULL, NULL), NONE);
    CHECK_EQ(oidnGetDeviceError(device, &text), ARGUMENT);
    CHECK(text && *text);
    CHECK_EQ(oidnGetDeviceError(device, &text), NONE);
    CHECK(text == NULL);
    oidnGetDeviceInt(device, "version");
    CHECK_EQ(r.count, 2);
    oidnSetDeviceErrorFunction(device, NULL, NULL);
    oidnNewFilter(device, "*");
    CHECK_EQ(r.count, 2);
    CHECK_EQ(oidnGetDeviceError(device, NULL), ARGUMENT);
    oidnReleaseDevice(NULL);
    oidnNewDeviceByID(-1);
    CHECK_EQ(oidnGetDeviceError(NULL, &text), ARGUMENT);
    CHECK_EQ(oidnGetDeviceError(NULL, NULL), NONE);
    oidnReleaseDevice(device);
    oidnReleaseDevice(other);
}

/* The callback runs on the thread of the failed call, while nothing is locked: it may call back. */
typedef struct inquirer {
    OIDNDevice device;
    int calls, version, made;
    OIDNError error;
} inquirer;

static void ask_back(void *user, OIDNError code, const char *message)
{
    inquirer *q = user;
    OIDNBuffer buffer;

    (void)message;
    if (q->calls++)
        return;
    q->version = oidnGetDeviceInt(q->device, "version");
    buffer = oidnNewBuffer(q->device, 4);
    q->made = buffer != NULL;
    oidnReleaseBuffer(buffer);
    oidnSyncDevice(q->device);
    q->error = code == oidnGetDeviceError(q->device, NULL) ? code : NONE;
    oidnNewFilter(q->device, "*"); /* an error of the callback's own */
}

static void error_callback_calls_back(void)
{
    inquirer q = {0};
    OIDNFilter filter;

    q.device = new_device();
    oidnSetDeviceErrorFunction(q.device, ask_back, &q);
    filter = oidnNewFilter(q.device, "RT");
    oidnCommitFilter(filter);
    CHECK_EQ(q.calls, 2);
    CHECK_EQ(q.version, 20501);
    CHECK_EQ(q.made, 1);
    CHECK_EQ(q.error, OPERATION);
    ERROR(q.device, ARGUMENT);
    oidnReleaseFilter(filter);
    oidnReleaseDevice(q.device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(physical_devices);
    RUN(device_creation);
    RUN(device_parameters);
    RUN(device_parameter_names);
    RUN(device_states);
    RUN(device_set_after_commit);
    RUN(null_handles);
    RUN(error_slots);
    RUN(error_callback_calls_back);
    free_identity();
    return check_report();
}
