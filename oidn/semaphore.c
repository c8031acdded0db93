/* Semaphores of graphics interfaces: the processor can import none, so no handle ever exists. */
#include "internal.h"

static OIDNSemaphore refuse(OIDNDevice device, bool is_argument)
{
    const OIDNError code = is_argument ? OIDN_ERROR_INVALID_ARGUMENT : OIDN_ERROR_INVALID_OPERATION;
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault))
        lull_fail(&call.fault, code, "the device supports no external semaphore of this type");
    lull_call_end(&call);
    return NULL;
}

OIDN_API OIDNSemaphore oidnNewSharedSemaphoreFromFD(OIDNDevice device,
                                                    OIDNExternalSemaphoreTypeFlags fdType, int fd)
{
    (void)fd;
    return refuse(device, fdType != OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_NONE);
}

OIDN_API OIDNSemaphore oidnNewSharedSemaphoreFromWin32Handle(
    OIDNDevice device, OIDNExternalSemaphoreTypeFlags handleType, void *handle, const void *name)
{
    return refuse(device,
                  handleType != OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_NONE || !handle == !name);
}

/* Signalling or waiting, for whatever semaphores. */
static void use(OIDNDevice device)
{
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault))
        lull_fail(&call.fault, OIDN_ERROR_INVALID_OPERATION, "the device supports no semaphores");
    lull_call_end(&call);
}

OIDN_API void oidnSignalSemaphoresAsync(OIDNDevice device, const OIDNSemaphore *semaphores,
                                        const uint64_t *values, int numSemaphores)
{
    (void)semaphores;
    (void)values;
    (void)numSemaphores;
    use(device);
}

OIDN_API void oidnWaitSemaphoresAsync(OIDNDevice device, const OIDNSemaphore *semaphores,
                                      const uint64_t *values, const uint32_t *timeoutsMs,
                                      int numSemaphores)
{
    (void)semaphores;
    (void)values;
    (void)timeoutsMs;
    (void)numSemaphores;
    use(device);
}

static void count_reference(OIDNSemaphore semaphore)
{
    if (!semaphore)
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
}

OIDN_API void oidnRetainSemaphore(OIDNSemaphore semaphore) { count_reference(semaphore); }
OIDN_API void oidnReleaseSemaphore(OIDNSemaphore semaphore) { count_reference(semaphore); }
