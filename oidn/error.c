/* Errors: what went wrong, and for whom. */
#include "internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Slots of one device; beyond that the thread that reported nothing for longest loses its own. */
#define MAX_SLOTS 256u

/* ---- Faults ---------------------------------------------------------------------------------- */

bool lull_fail(lull_fault *fault, OIDNError code, const char *format, ...)
{
    va_list args;

    if (fault->code != OIDN_ERROR_NONE)
        return false;
    fault->code = code;
    va_start(args, format);
    vsnprintf(fault->text, sizeof fault->text, format, args);
    va_end(args);
    return false;
}

bool lull_fail_status(lull_fault *fault, lull_status status, const char *what)
{
    static const unsigned char codes[LULL_STATUS_COUNT] = {
        [LULL_CANCELLED] = OIDN_ERROR_CANCELLED,
        [LULL_ERROR_ARGUMENT] = OIDN_ERROR_UNKNOWN,
        [LULL_ERROR_MEMORY] = OIDN_ERROR_OUT_OF_MEMORY,
        [LULL_ERROR_WEIGHTS] = OIDN_ERROR_INVALID_OPERATION,
        [LULL_ERROR_VERSION] = OIDN_ERROR_INVALID_OPERATION,
        [LULL_ERROR_NETWORK] = OIDN_ERROR_INVALID_OPERATION,
        [LULL_ERROR_FEATURES] = OIDN_ERROR_UNKNOWN, /* as Open Image Denoise */
        [LULL_ERROR_IMAGE] = OIDN_ERROR_INVALID_OPERATION,
        [LULL_ERROR_UNSUPPORTED] = OIDN_ERROR_INVALID_OPERATION,
    };

    if (status == LULL_OK)
        return true;
    return lull_fail(fault,
                     status < LULL_STATUS_COUNT ? (OIDNError)codes[status] : OIDN_ERROR_UNKNOWN,
                     "%s: %s", what, lull_status_text(status));
}

bool lull_check_plan(lull_fault *fault, lull_status status, const lull_frame *frame,
                     const lull_model *model)
{
    lull_model_info info;
    unsigned images = 0;
    char what[96];

    if (status != LULL_ERROR_FEATURES)
        return lull_fail_status(fault, status, "the weights cannot be used with these images");
    for (unsigned i = 0; i < LULL_OUTPUT; i++)
        images += frame->features >> i & 1;
    lull_model_get_info(model, &info);
    if (info.is_alone)
        snprintf(what, sizeof what, "the weights are for an albedo or normals alone");
    else
        snprintf(what, sizeof what, "the weights take %u channels, the images have %u",
                 info.inputs, 3 * images);
    return lull_fail_status(fault, status, what);
}

/* ---- Slots ----------------------------------------------------------------------------------- */

#if !LULL_WITH_THREADS
static lull_fault global_fault;
#elif defined(_MSC_VER)
static __declspec(thread) lull_fault global_fault;
#else
static __thread lull_fault global_fault;
#endif

void lull_errors_init(lull_errors *errors) { lull_mutex_init(&errors->mutex); }

void lull_errors_free(lull_errors *errors)
{
    while (errors->slots) {
        lull_error_slot *slot = errors->slots;

        errors->slots = slot->next;
        lull_os_free(slot);
    }
    lull_mutex_destroy(&errors->mutex);
}

/* This thread's slot, moved to the front of the list; made or taken from another thread if
 * `create`; NULL if there is none. */
static lull_error_slot *find_slot(lull_errors *errors, bool create)
{
    const size_t thread = lull_thread_number();
    lull_error_slot **link, **last = NULL, *slot;

    for (link = &errors->slots; *link && (*link)->thread != thread; link = &(*link)->next)
        last = link;
    slot = *link;
    if (!slot && !create)
        return NULL;
    if (!slot && errors->count < MAX_SLOTS) {
        slot = lull_os_alloc_zero(sizeof *slot);
        if (!slot)
            return NULL;
        errors->count++;
    } else {
        if (!slot) {
            link = last;
            slot = *link;
            slot->fault.code = OIDN_ERROR_NONE;
        }
        *link = slot->next;
    }
    slot->thread = thread;
    slot->next = errors->slots;
    errors->slots = slot;
    return slot;
}

OIDNErrorFunction lull_errors_report(lull_errors *errors, const lull_fault *fault, void **user)
{
    OIDNErrorFunction function;
    lull_error_slot *slot;
    lull_fault *kept;

    if (!errors) {
        if (global_fault.code == OIDN_ERROR_NONE)
            global_fault = *fault;
        return NULL;
    }
    lull_mutex_lock(&errors->mutex);
    slot = find_slot(errors, true);
    kept = slot ? &slot->fault : &errors->spare;
    if (kept->code == OIDN_ERROR_NONE)
        *kept = *fault;
    function = errors->function;
    *user = errors->user;
    lull_mutex_unlock(&errors->mutex);
    return function;
}

/* Reads and clears one fault. */
static OIDNError take(lull_fault *fault, const char **text)
{
    const OIDNError code = fault->code;

    if (text)
        *text = code == OIDN_ERROR_NONE ? NULL : fault->text;
    fault->code = OIDN_ERROR_NONE;
    return code;
}

OIDNError lull_errors_take(lull_errors *errors, const char **text)
{
    lull_error_slot *slot;
    OIDNError code;

    if (!errors)
        return take(&global_fault, text);
    lull_mutex_lock(&errors->mutex);
    slot = find_slot(errors, false);
    code = take(slot && slot->fault.code != OIDN_ERROR_NONE ? &slot->fault : &errors->spare, text);
    lull_mutex_unlock(&errors->mutex);
    return code;
}

void lull_global_error(OIDNError code, const char *format, ...)
{
    lull_fault fault = {OIDN_ERROR_NONE, ""};
    va_list args;

    fault.code = code;
    va_start(args, format);
    vsnprintf(fault.text, sizeof fault.text, format, args);
    va_end(args);
    lull_errors_report(NULL, &fault, NULL);
}

OIDN_API OIDNError oidnGetDeviceError(OIDNDevice device, const char **outMessage)
{
    return lull_errors_take(device ? &device->errors : NULL, outMessage);
}

OIDN_API void oidnSetDeviceErrorFunction(OIDNDevice device, OIDNErrorFunction func, void *userPtr)
{
    lull_call call;

    if (lull_call_begin(&call, device)) {
        lull_mutex_lock(&device->errors.mutex);
        device->errors.function = func;
        device->errors.user = userPtr;
        lull_mutex_unlock(&device->errors.mutex);
    }
    lull_call_end(&call);
}

/* ---- Calls ----------------------------------------------------------------------------------- */

bool lull_call_begin(lull_call *call, OIDNDevice device)
{
    call->device = device;
    call->fault.code = OIDN_ERROR_NONE;
    call->floats = lull_floats_default();
    if (!device)
        return lull_fail(&call->fault, OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    lull_device_hold(device);
    lull_mutex_lock(&device->lock);
    return true;
}

bool lull_call_end(lull_call *call)
{
    const bool ok = call->fault.code == OIDN_ERROR_NONE;
    OIDNErrorFunction function = NULL;
    void *user = NULL;

    if (call->device)
        lull_mutex_unlock(&call->device->lock);
    if (!ok)
        function = lull_errors_report(call->device ? &call->device->errors : NULL, &call->fault,
                                      &user);
    if (call->device)
        lull_device_drop(call->device);
    lull_floats_restore(call->floats);
    if (function)
        function(user, call->fault.code, call->fault.text);
    return ok;
}
