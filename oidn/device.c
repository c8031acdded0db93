/* Devices: creation, parameters, commit, synchronisation, lifetime. */
#include "internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Environment ----------------------------------------------------------------------------- */

/* Parameters that an environment variable overrides. */
static const struct {
    const char *variable, *parameter;
} overrides[] = {
    {"OIDN_VERBOSE", "verbose"},
    {"OIDN_NUM_THREADS", "numThreads"},
    {"OIDN_SET_AFFINITY", "setAffinity"},
};
#define OVERRIDES (sizeof overrides / sizeof *overrides)

static void store_parameter(OIDNDevice device, const char *name, int value, int verbose,
                            lull_fault *fault)
{
    lull_param_set_int(device->values, LULL_DEVICE, name, value, verbose, fault);
    if (!strcmp(name, "setAffinity"))
        device->affinity_asked = true;
}

static void apply_environment(OIDNDevice device)
{
    lull_fault none = {0};
    size_t i;

    for (i = 0; i < OVERRIDES; i++)
        if (lull_env_is_set(overrides[i].variable))
            store_parameter(device, overrides[i].parameter, lull_env_int(overrides[i].variable, 0),
                            0, &none);
}

/* The variable that fixes this parameter, or NULL. */
static const char *overriding_variable(const char *name)
{
    size_t i;

    for (i = 0; i < OVERRIDES; i++)
        if (!strcmp(overrides[i].parameter, name) && lull_env_is_set(overrides[i].variable))
            return overrides[i].variable;
    return NULL;
}

/* ---- Creation -------------------------------------------------------------------------------- */

static OIDNDevice new_cpu_device(void)
{
    OIDNDevice device = lull_os_alloc_zero(sizeof *device);

    if (!device) {
        lull_global_error(OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
        return NULL;
    }
    device->refs = 1;
    device->users = 1;
    lull_mutex_init(&device->lock);
    lull_errors_init(&device->errors);
    lull_params_reset(device->values);
    apply_environment(device);
    return device;
}

/* A device whose filters OpenCL executes; the processor loads and stores pixels for it. */
static OIDNDevice new_opencl_device(void)
{
#if LULL_WITH_OPENCL
    lull_fault fault = {OIDN_ERROR_NONE, ""};
    lull_engine *engine = lull_opencl_open(&fault);
    OIDNDevice device = engine ? new_cpu_device() : NULL;

    if (device) {
        device->engine = engine;
        device->values[lull_value_type].i = LULL_DEVICE_TYPE_OPENCL;
    } else if (engine) {
        engine->close(engine);
    } else {
        lull_errors_report(NULL, &fault, NULL);
    }
    return device;
#else
    lull_global_error(OIDN_ERROR_UNSUPPORTED_HARDWARE,
                      "unsupported device type: this build is without OpenCL");
    return NULL;
#endif
}

OIDN_API OIDNDevice oidnNewDeviceByID(int physicalDeviceID)
{
    if (physicalDeviceID >= 0 && physicalDeviceID < oidnGetNumPhysicalDevices())
        return new_cpu_device();
    lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "invalid physical device ID: %d",
                      physicalDeviceID);
    return NULL;
}

OIDN_API OIDNDevice oidnNewDevice(OIDNDeviceType type)
{
    static const char *const names[] = {"default", "CPU", "SYCL", "CUDA", "HIP", "Metal"};

    if ((int)type == LULL_DEVICE_TYPE_OPENCL)
        return new_opencl_device();
    if ((int)type < 0 || (size_t)type >= sizeof names / sizeof *names)
        lull_global_error(OIDN_ERROR_UNKNOWN, "unknown device type: %d", (int)type);
    else if (type > OIDN_DEVICE_TYPE_CPU || oidnGetNumPhysicalDevices() == 0)
        lull_global_error(OIDN_ERROR_UNSUPPORTED_HARDWARE, "unsupported device type: %s",
                          names[type]);
    else
        return new_cpu_device();
    return NULL;
}

void lull_device_hold(OIDNDevice device) { lull_atomic_add(&device->refs, 1); }

void lull_device_drop(OIDNDevice device)
{
    if (lull_atomic_add(&device->refs, (uint32_t)-1) == 1)
        lull_device_destroy(device);
}

void lull_device_destroy(OIDNDevice device)
{
    unsigned i;

    if (device->committed) {
        if (lull_queue_is_self(&device->queue) && !device->queue.abandoned) {
            device->queue.abandoned = true; /* destroyed when the job is over */
            return;
        }
        lull_queue_stop(device);
        lull_pool_free(device->pool);
    }
    if (device->engine)
        device->engine->close(device->engine);
    for (i = 0; i < LULL_MAX_BUILTIN; i++)
        lull_weights_free(&device->builtin[i]);
    lull_errors_free(&device->errors);
    lull_mutex_destroy(&device->lock);
    lull_os_free(device);
}

OIDN_API const char *lull_device_name(OIDNDevice device)
{
    if (!device)
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    else
        return device->engine ? device->engine->name : oidnGetPhysicalDeviceString(0, "name");
    return NULL;
}

OIDN_API void oidnRetainDevice(OIDNDevice device)
{
    if (device) {
        lull_atomic_add(&device->users, 1);
        lull_device_hold(device);
    } else {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    }
}

/* After the last handle: the caller may then unload the library. There is work still where others
 * went inside a progress function. */
static void finish_work(OIDNDevice device)
{
    lull_call call;

    if (lull_call_begin(&call, device))
        lull_queue_finish(device);
    lull_call_end(&call);
}

OIDN_API void oidnReleaseDevice(OIDNDevice device)
{
    if (device) {
        if (lull_atomic_add(&device->users, (uint32_t)-1) == 1)
            finish_work(device);
        lull_device_drop(device);
    } else {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    }
}

/* ---- Parameters ------------------------------------------------------------------------------ */

static void set_parameter(OIDNDevice device, const char *name, int value, lull_fault *fault)
{
    const int verbose = device->values[lull_value_verbose].i;
    const char *variable;

    if (!name) {
        lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "string is null");
        return;
    }
    variable = overriding_variable(name);
    if (variable)
        lull_warn(verbose, "device parameter '%s' is overridden by the environment variable %s",
                  name, variable);
    else
        store_parameter(device, name, value, verbose, fault);
    device->dirty = true;
}

OIDN_API void oidnSetDeviceInt(OIDNDevice device, const char *name, int value)
{
    lull_call call;

    if (lull_call_begin(&call, device))
        set_parameter(device, name, value, &call.fault);
    lull_call_end(&call);
}

OIDN_API void oidnSetDeviceBool(OIDNDevice device, const char *name, bool value)
{
    oidnSetDeviceInt(device, name, value);
}

OIDN_API int oidnGetDeviceInt(OIDNDevice device, const char *name)
{
    lull_value value = {0};
    lull_call call;

    if (lull_call_begin(&call, device)) {
        if (name)
            lull_param_get(device->values, LULL_DEVICE, name, false, &value, &call.fault);
        else
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "string is null");
    }
    lull_call_end(&call);
    return value.i;
}

OIDN_API bool oidnGetDeviceBool(OIDNDevice device, const char *name)
{
    return oidnGetDeviceInt(device, name) != 0;
}

/* ---- Commit ---------------------------------------------------------------------------------- */

/* Ports that LULL_PORTS allows: it names the strongest. */
static uint32_t allowed_ports(int verbose)
{
    const char *name = getenv("LULL_PORTS");
    uint32_t ports;

    if (!name || !*name)
        return LULL_PORTS_ALL;
    ports = lull_ports_up_to(name, strlen(name));
    if (ports)
        return ports;
    lull_warn(verbose, "LULL_PORTS: no port is called '%s'", name);
    return LULL_PORTS_ALL;
}

/* Name of the strongest port that will be used. */
static const char *strongest_port(uint32_t ports)
{
    const char *name = lull_port_name(0);
    unsigned i;

    ports &= lull_ports_available();
    for (i = 0; lull_port_name(i); i++)
        if (ports >> i & 1)
            name = lull_port_name(i);
    return name;
}

static void print_banner(OIDNDevice device)
{
    char brand[64];

    lull_cpu_brand(brand, sizeof brand);
    printf("lull %d.%d.%d, interface of Open Image Denoise " OIDN_VERSION_STRING "\n",
           LULL_VERSION_MAJOR, LULL_VERSION_MINOR, LULL_VERSION_PATCH);
#if defined(__VERSION__)
    printf("  Compiler: " __VERSION__ "\n");
#endif
    printf("  Device  : %s\n", device->engine ? device->engine->name : brand);
    printf("    Type  : %s\n", device->engine ? "OpenCL" : "CPU");
    printf("    ISA   : %s\n", strongest_port(device->ports));
    printf("  Threads : %d (%s)\n", device->values[lull_value_num_threads].i,
           device->values[lull_value_set_affinity].i ? "pinned" : "not pinned");
    fflush(stdout);
}

/* Threads are pinned only if that was asked for: two devices pinned to the same cores would share
 * them while others idle. */
static bool commit(OIDNDevice device, lull_fault *fault)
{
    lull_value *values = device->values;
    unsigned threads;
    lull_cpus *cpus;
    bool pin;

    if (device->committed)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION, "device can be committed only once");
    if (device->engine && !device->engine->build(device->engine, fault))
        return false;
    cpus = lull_os_alloc(sizeof *cpus);
    if (!cpus)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
    lull_cpus_detect(cpus);
    threads = cpus->count;
    if (values[lull_value_num_threads].i > 0)
        threads = (unsigned)values[lull_value_num_threads].i;
    threads = threads > cpus->available ? cpus->available : threads;
    if (!LULL_WITH_THREADS)
        threads = 1;
    pin = device->affinity_asked && values[lull_value_set_affinity].i && threads <= cpus->listed;
    device->pool = lull_pool_new(threads, pin, cpus);
    lull_os_free(cpus);
    if (!device->pool)
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
    if (!lull_queue_start(device)) {
        lull_pool_free(device->pool);
        return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "cannot start a thread");
    }
    values[lull_value_num_threads].i = (int)lull_pool_size(device->pool);
    values[lull_value_set_affinity].i = pin;
    lull_ports_request();
    device->ports = allowed_ports(values[lull_value_verbose].i);
    device->committed = true;
    device->dirty = false;
    if (values[lull_value_verbose].i >= 1)
        print_banner(device);
    return true;
}

OIDN_API void oidnCommitDevice(OIDNDevice device)
{
    lull_call call;

    if (lull_call_begin(&call, device))
        commit(device, &call.fault);
    lull_call_end(&call);
}

bool lull_device_ready(OIDNDevice device, lull_fault *fault)
{
    if (!device->committed)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION, "the device is not committed");
    if (device->dirty)
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "device parameters were changed after the commit");
    return true;
}

OIDN_API void oidnSyncDevice(OIDNDevice device)
{
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault))
        lull_queue_sync(device, &call.fault);
    lull_call_end(&call);
}
