/* OpenCL: the library, the choice of a device, the program. */
#include "opencl.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define LIBRARY "OpenCL.dll"
#elif defined(__APPLE__)
#define LIBRARY "/System/Library/Frameworks/OpenCL.framework/OpenCL"
#else
#define LIBRARY "libOpenCL.so.1"
#endif

#define MOST_PLATFORMS 16u
#define MOST_DEVICES 64u /* of all platforms */

/* The sources of ports/opencl, one after the other; made by the build. */
extern const char lull_opencl_source[];

bool lull_cl_check(lull_fault *fault, int32_t error, const char *what)
{
    const bool is_memory = error == CL_MEM_OBJECT_ALLOCATION_FAILURE ||
                           error == CL_OUT_OF_RESOURCES || error == CL_OUT_OF_HOST_MEMORY;

    if (error == CL_SUCCESS)
        return true;
    return lull_fail(fault, is_memory ? OIDN_ERROR_OUT_OF_MEMORY : OIDN_ERROR_UNKNOWN,
                     "OpenCL: %s failed (error %d)", what, (int)error);
}

bool lull_cl_check_process(const lull_opencl *cl, lull_fault *fault)
{
    return cl->process == lull_process_id() ||
           lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                     "an OpenCL device does not outlive a fork");
}

/* ---- The library ----------------------------------------------------------------------------- */

/* The process that first asked for a device: drivers start threads then, which a forked child does
 * not have and would wait for. */
static lull_atomic first_process;

static bool load_library(lull_cl_api *api, lull_fault *fault)
{
    const uint32_t process = (uint32_t)lull_process_id();
    const char *asked = getenv("LULL_OPENCL_LIBRARY");
    const char *name = asked && *asked ? asked : LIBRARY;
    const uint32_t first = lull_atomic_load(&first_process);
    void *library;

    if (first && first != process)
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                         "no OpenCL device: its driver was loaded before a fork, which it does not "
                         "outlive");
    library = lull_library_open(name);
    if (!library)
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                         "no OpenCL device: the library %s cannot be loaded", name);
#define FIND(result, function, parameters)                                                         \
    if (!lull_library_find(library, #function, &api->function, sizeof api->function))              \
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,                                   \
                         "no OpenCL device: the library %s has no function %s", name, #function);
    LULL_CL_FUNCTIONS(FIND)
#undef FIND
    lull_atomic_store(&first_process, process);
    return true;
}

/* ---- The device ------------------------------------------------------------------------------ */

static uint64_t info_number(const lull_cl_api *api, cl_device device, uint32_t what, size_t bytes)
{
    uint64_t wide = 0;
    uint32_t narrow = 0;
    void *to = bytes == sizeof wide ? (void *)&wide : (void *)&narrow;

    if (api->clGetDeviceInfo(device, what, bytes, to, NULL) != CL_SUCCESS)
        return 0;
    return bytes == sizeof wide ? wide : narrow;
}

static void info_text(char *text, size_t room, const lull_cl_api *api, cl_device device,
                      uint32_t what)
{
    memset(text, 0, room);
    if (api->clGetDeviceInfo(device, what, room - 1, text, NULL) != CL_SUCCESS)
        text[0] = 0;
}

/* What the device lacks to give the same bytes as every other, or NULL. */
static const char *lacks(const lull_cl_api *api, cl_device device)
{
    const uint64_t fp = info_number(api, device, CL_DEVICE_SINGLE_FP_CONFIG, 8);
    char version[256], profile[64];
    int major = 0, minor = 0;

    info_text(version, sizeof version, api, device, CL_DEVICE_VERSION);
    info_text(profile, sizeof profile, api, device, CL_DEVICE_PROFILE);
    if (sscanf(version, "OpenCL %d.%d", &major, &minor) != 2 || 10 * major + minor < 12 ||
        strcmp(profile, "FULL_PROFILE") != 0)
        return "OpenCL 1.2 (full profile)";
    if (!info_number(api, device, CL_DEVICE_AVAILABLE, 4) ||
        !info_number(api, device, CL_DEVICE_COMPILER_AVAILABLE, 4))
        return "a compiler, or is in use";
    if (!(fp & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT))
        return "correctly rounded division";
    if (!(fp & CL_FP_DENORM) || !(fp & CL_FP_INF_NAN) || !(fp & CL_FP_ROUND_TO_NEAREST))
        return "IEEE 754 arithmetic with subnormal numbers";
    if (info_number(api, device, CL_DEVICE_ENDIAN_LITTLE, 4) == LULL_BIG_ENDIAN)
        return "the host's byte order";
    if (info_number(api, device, CL_DEVICE_MAX_WORK_GROUP_SIZE, sizeof(size_t)) <
        LULL_CL_LOCAL_X * LULL_CL_LOCAL_Y)
        return "work groups of 64 items";
    return NULL;
}

/* The devices of all platforms, at most MOST_DEVICES. */
static unsigned list_devices(const lull_cl_api *api, cl_device *devices)
{
    cl_platform platforms[MOST_PLATFORMS];
    uint32_t count = 0, found = 0, i;

    if (api->clGetPlatformIDs(MOST_PLATFORMS, platforms, &count) != CL_SUCCESS)
        return 0;
    for (i = 0; i < count && i < MOST_PLATFORMS && found < MOST_DEVICES; i++) {
        const uint32_t room = MOST_DEVICES - found;
        uint32_t more = 0;

        if (api->clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_ALL, room, devices + found, &more) ==
            CL_SUCCESS)
            found += more < room ? more : room;
    }
    return found;
}

/* The device that LULL_OPENCL_DEVICE numbers, else the first graphics processor that will do, else
 * the first device that will. */
static bool choose_device(lull_opencl *cl, lull_fault *fault)
{
    cl_device devices[MOST_DEVICES];
    const unsigned count = list_devices(&cl->api, devices);
    const char *why, *number = getenv("LULL_OPENCL_DEVICE");
    char *end;
    long asked = -1;
    unsigned i;

    if (!count)
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                         "no OpenCL device: no driver of one is installed");
    if (number && *number) {
        asked = strtol(number, &end, 10);
        if (*end || asked < 0 || asked >= (long)count)
            return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                             "no OpenCL device has the number %s (LULL_OPENCL_DEVICE): there "
                             "are %u", number, count);
    }
    for (i = 0; i < count && asked < 0; i++) {
        const bool is_gpu = info_number(&cl->api, devices[i], CL_DEVICE_TYPE, 8) &
                            CL_DEVICE_TYPE_GPU;

        if (lacks(&cl->api, devices[i]) || (cl->device && !is_gpu))
            continue;
        cl->device = devices[i];
        if (is_gpu)
            break;
    }
    if (!cl->device)
        cl->device = devices[asked < 0 ? 0 : asked];
    info_text(cl->name, sizeof cl->name, &cl->api, cl->device, CL_DEVICE_NAME);
    why = lacks(&cl->api, cl->device);
    if (why)
        return lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE, "the OpenCL device %s lacks %s",
                         cl->name, why);
    cl->most_bytes = info_number(&cl->api, cl->device, CL_DEVICE_MAX_MEM_ALLOC_SIZE, 8);
    return true;
}

/* ---- The program ----------------------------------------------------------------------------- */

/* Says what the compiler says, as far as there is room. It gives that as a whole or not at all. */
static bool fail_build(lull_opencl *cl, int32_t error, lull_fault *fault)
{
    size_t bytes = 0;
    char *log;

    cl->api.clGetProgramBuildInfo(cl->program, cl->device, CL_PROGRAM_BUILD_LOG, 0, NULL, &bytes);
    log = lull_os_alloc_zero(bytes + 1);
    if (log)
        cl->api.clGetProgramBuildInfo(cl->program, cl->device, CL_PROGRAM_BUILD_LOG, bytes, log,
                                      NULL);
    lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
              "the OpenCL device %s cannot compile the kernels (error %d): %s", cl->name,
              (int)error, log ? log : "");
    lull_os_free(log);
    return false;
}

/* Context, queue, program and kernels. */
static bool make_kernels(lull_opencl *cl, lull_fault *fault)
{
    static const char *const names[] = {
#define NAME(name) #name,
        LULL_CL_KERNELS(NAME)
#undef NAME
    };
    const char *source = lull_opencl_source;
    int32_t error;
    unsigned i;

    cl->context = cl->api.clCreateContext(NULL, 1, &cl->device, NULL, NULL, &error);
    if (!lull_cl_check(fault, error, "clCreateContext"))
        return false;
    cl->queue = cl->api.clCreateCommandQueue(cl->context, cl->device, 0, &error);
    if (!lull_cl_check(fault, error, "clCreateCommandQueue"))
        return false;
    cl->program = cl->api.clCreateProgramWithSource(cl->context, 1, &source, NULL, &error);
    if (!lull_cl_check(fault, error, "clCreateProgramWithSource"))
        return false;
    /* -w: pocl's compiler counts warnings on stderr, those of how vectors are handed over on x86
     * processors without AVX-512 */
    error = cl->api.clBuildProgram(cl->program, 1, &cl->device,
                                   "-w -cl-std=CL1.2 -cl-fp32-correctly-rounded-divide-sqrt", NULL,
                                   NULL);
    if (error != CL_SUCCESS)
        return fail_build(cl, error, fault);
    for (i = 0; i < LULL_CL_KERNEL_COUNT; i++) {
        cl->kernel[i] = cl->api.clCreateKernel(cl->program, names[i], &error);
        if (!lull_cl_check(fault, error, names[i]))
            return false;
    }
    return true;
}

/* What make_kernels has made. In a forked child nothing is released: the driver's threads are the
 * parent's. */
static void release(lull_opencl *cl)
{
    unsigned i;

    if (cl->process != lull_process_id())
        return;
    for (i = 0; i < LULL_CL_KERNEL_COUNT; i++)
        if (cl->kernel[i])
            cl->api.clReleaseKernel(cl->kernel[i]);
    if (cl->program)
        cl->api.clReleaseProgram(cl->program);
    if (cl->queue)
        cl->api.clReleaseCommandQueue(cl->queue);
    if (cl->context)
        cl->api.clReleaseContext(cl->context);
    memset(cl->kernel, 0, sizeof cl->kernel);
    cl->program = NULL;
    cl->queue = NULL;
    cl->context = NULL;
}

static bool build(lull_engine *engine, lull_fault *fault)
{
    lull_opencl *cl = (lull_opencl *)engine;

    if (!lull_cl_check_process(cl, fault))
        return false;
    release(cl); /* of a commit that failed */
    return make_kernels(cl, fault) && lull_cl_probe_device(cl, fault);
}

static void close_engine(lull_engine *engine)
{
    release((lull_opencl *)engine);
    lull_os_free(engine);
}

/* ---- Engine ---------------------------------------------------------------------------------- */

lull_engine *lull_opencl_open(lull_fault *fault)
{
    lull_opencl *cl = lull_os_alloc_zero(sizeof *cl);

    if (!cl) {
        lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
        return NULL;
    }
    cl->process = lull_process_id();
    cl->engine.name = cl->name;
    cl->engine.build = build;
    cl->engine.close = close_engine;
    cl->engine.minimum = lull_cl_plan_minimum;
    cl->engine.new_plan = lull_cl_plan_new;
    cl->engine.free_plan = lull_cl_plan_free;
    cl->engine.get_info = lull_cl_plan_get_info;
    cl->engine.run = lull_cl_run;
    if (load_library(&cl->api, fault) && choose_device(cl, fault))
        return &cl->engine;
    lull_os_free(cl);
    return NULL;
}
