/* Filters: creation, parameters, execution, lifetime. Commit is in commit.c. */
#include "internal.h"

#include <string.h>

static OIDNDevice device_of(OIDNFilter filter) { return filter ? filter->device : NULL; }

static bool check_name(const char *name, lull_fault *fault)
{
    return name || lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "string is null");
}

/* ---- Creation and lifetime ------------------------------------------------------------------- */

static OIDNFilter new_filter(OIDNDevice device, const char *type, lull_fault *fault)
{
    enum lull_owner owner = LULL_RT;
    OIDNFilter filter;

    if (!strcmp(type, "RTLightmap")) {
        owner = LULL_LIGHTMAP;
    } else if (strcmp(type, "RT") != 0) {
        lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "unknown filter type: '%.80s'", type);
        return NULL;
    }
    filter = lull_os_alloc_zero(sizeof *filter);
    if (!filter) {
        lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
        return NULL;
    }
    filter->refs = 1;
    filter->users = 1;
    lull_atomic_add(&device->users, 1);
    filter->device = device;
    filter->type = owner;
    filter->dirty = true;
    lull_params_reset(filter->values);
    lull_device_hold(device);
    return filter;
}

OIDN_API OIDNFilter oidnNewFilter(OIDNDevice device, const char *type)
{
    OIDNFilter filter = NULL;
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault) &&
        check_name(type, &call.fault))
        filter = new_filter(device, type, &call.fault);
    lull_call_end(&call);
    return filter;
}

void lull_filter_drop(OIDNFilter filter)
{
    OIDNDevice device = filter->device;
    unsigned i;

    if (lull_atomic_add(&filter->refs, (uint32_t)-1) != 1)
        return;
    lull_filter_free_plan(filter);
    lull_weights_free(&filter->weights);
    for (i = 0; i < LULL_IMAGES; i++) {
        lull_buffer_detach(filter->images[i].buffer);
        lull_buffer_detach(filter->committed_buffers[i]);
    }
    lull_os_free(filter);
    lull_device_drop(device);
}

OIDN_API void oidnRetainFilter(OIDNFilter filter)
{
    if (filter) {
        lull_atomic_add(&filter->users, 1);
        lull_atomic_add(&filter->refs, 1);
    } else {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    }
}

/* The last handle waits for all work: the caller may then free the images, and what copies of them
 * come from and go to. A progress function cannot wait; its filter lives until the work is over. */
OIDN_API void oidnReleaseFilter(OIDNFilter filter)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) &&
        lull_atomic_add(&filter->users, (uint32_t)-1) == 1) {
        lull_atomic_add(&filter->device->users, (uint32_t)-1);
        lull_queue_finish(filter->device);
    }
    if (lull_call_end(&call))
        lull_filter_drop(filter);
}

/* ---- Images ---------------------------------------------------------------------------------- */

/* Stores an image, or unsets it if image->set is false. Takes over nothing. */
static void set_image(OIDNFilter filter, const char *name, const lull_image_param *image)
{
    const lull_param *param = lull_param_find(filter->type, name);
    lull_image_param *to;

    filter->dirty = true;
    if (!param || param->kind != LULL_IMAGE) {
        lull_warn(filter->device->values[lull_value_verbose].i,
                  "ignoring unknown or mistyped filter parameter '%s'", name);
        return;
    }
    to = &filter->images[param->slot - lull_value_color];
    if (image->set)
        lull_buffer_attach(image->buffer);
    lull_buffer_detach(to->buffer);
    memset(to, 0, sizeof *to);
    if (image->set)
        *to = *image;
}

OIDN_API void oidnSetFilterImage(OIDNFilter filter, const char *name, OIDNBuffer buffer,
                                 OIDNFormat format, size_t width, size_t height, size_t byteOffset,
                                 size_t pixelByteStride, size_t rowByteStride)
{
    lull_image_param image;
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault)) {
        if (!buffer)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
        else if (buffer->device != filter->device)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT,
                      "buffer and filter are of different devices");
        else if (lull_image_param_make(&image, buffer, NULL, format, width, height, byteOffset,
                                       pixelByteStride, rowByteStride, &call.fault))
            set_image(filter, name, &image);
    }
    lull_call_end(&call);
}

OIDN_API void oidnSetSharedFilterImage(OIDNFilter filter, const char *name, void *devPtr,
                                       OIDNFormat format, size_t width, size_t height,
                                       size_t byteOffset, size_t pixelByteStride,
                                       size_t rowByteStride)
{
    lull_image_param image;
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault) &&
        lull_image_param_make(&image, NULL, devPtr, format, width, height, byteOffset,
                              pixelByteStride, rowByteStride, &call.fault))
        set_image(filter, name, &image);
    lull_call_end(&call);
}

OIDN_API void oidnUnsetFilterImage(OIDNFilter filter, const char *name)
{
    lull_image_param unset = {0};
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault))
        set_image(filter, name, &unset);
    lull_call_end(&call);
}

/* ---- Data ------------------------------------------------------------------------------------ */

/* Marks the weights as changed; returns whether `name` means them. */
static bool touch_data(OIDNFilter filter, const char *name)
{
    const lull_param *param = lull_param_find(filter->type, name);
    const bool known = param && param->kind == LULL_DATA;

    filter->dirty = true;
    if (known)
        filter->weights_dirty = true;
    else
        lull_warn(filter->device->values[lull_value_verbose].i,
                  "ignoring unknown or mistyped filter parameter '%s'", name);
    return known;
}

OIDN_API void oidnSetSharedFilterData(OIDNFilter filter, const char *name, void *hostPtr,
                                      size_t byteSize)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault)) {
        if (!hostPtr && byteSize)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "data pointer is null");
        else if (touch_data(filter, name)) {
            filter->weights_data = hostPtr;
            filter->weights_bytes = byteSize;
        }
    }
    lull_call_end(&call);
}

OIDN_API void oidnUpdateFilterData(OIDNFilter filter, const char *name)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault))
        touch_data(filter, name);
    lull_call_end(&call);
}

OIDN_API void oidnUnsetFilterData(OIDNFilter filter, const char *name)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault) &&
        touch_data(filter, name)) {
        filter->weights_data = NULL;
        filter->weights_bytes = 0;
    }
    lull_call_end(&call);
}

/* ---- Values ---------------------------------------------------------------------------------- */

OIDN_API void oidnSetFilterInt(OIDNFilter filter, const char *name, int value)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault) &&
        lull_param_set_int(filter->values, filter->type, name, value,
                           filter->device->values[lull_value_verbose].i, &call.fault))
        filter->dirty = true;
    lull_call_end(&call);
}

OIDN_API void oidnSetFilterBool(OIDNFilter filter, const char *name, bool value)
{
    oidnSetFilterInt(filter, name, value);
}

OIDN_API void oidnSetFilterFloat(OIDNFilter filter, const char *name, float value)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault)) {
        lull_param_set_float(filter->values, filter->type, name, value,
                             filter->device->values[lull_value_verbose].i);
        filter->dirty = true;
    }
    lull_call_end(&call);
}

OIDN_API int oidnGetFilterInt(OIDNFilter filter, const char *name)
{
    lull_value value = {0};
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault)) {
        filter->values[lull_value_used_quality].i = (int)lull_atomic_load(&filter->used);
        lull_param_get(filter->values, filter->type, name, false, &value, &call.fault);
    }
    lull_call_end(&call);
    return value.i;
}

OIDN_API bool oidnGetFilterBool(OIDNFilter filter, const char *name)
{
    return oidnGetFilterInt(filter, name) != 0;
}

OIDN_API float oidnGetFilterFloat(OIDNFilter filter, const char *name)
{
    lull_value value;
    lull_call call;

    value.f = 0;
    if (lull_call_begin(&call, device_of(filter)) && check_name(name, &call.fault))
        lull_param_get(filter->values, filter->type, name, true, &value, &call.fault);
    lull_call_end(&call);
    return value.f;
}

OIDN_API void oidnSetFilterProgressMonitorFunction(OIDNFilter filter,
                                                   OIDNProgressMonitorFunction func, void *userPtr)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter))) {
        filter->progress = func;
        filter->progress_user = userPtr;
    }
    lull_call_end(&call);
}

/* ---- Commit and execution -------------------------------------------------------------------- */

OIDN_API void oidnCommitFilter(OIDNFilter filter)
{
    lull_call call;

    if (lull_call_begin(&call, device_of(filter)))
        lull_filter_commit(filter, &call.fault);
    lull_call_end(&call);
}

static void execute(OIDNFilter filter, bool async)
{
    lull_call call;
    lull_job job;

    if (lull_call_begin(&call, device_of(filter)) &&
        lull_queue_reserve(filter->device, &call.fault)) {
        if (!async && lull_queue_is_self(&filter->device->queue))
            lull_fail(&call.fault, OIDN_ERROR_INVALID_OPERATION,
                      "a progress function cannot execute filters");
        else if (lull_filter_make_job(filter, &job, &call.fault))
            filter->last_job = lull_queue_submit(filter->device, &job);
        if (!async && call.fault.code == OIDN_ERROR_NONE)
            lull_queue_sync(filter->device, &call.fault);
    }
    lull_call_end(&call);
}

OIDN_API void oidnExecuteFilter(OIDNFilter filter) { execute(filter, false); }
OIDN_API void oidnExecuteFilterAsync(OIDNFilter filter) { execute(filter, true); }

OIDN_API void oidnExecuteSYCLFilterAsync(OIDNFilter filter, const void *depEvents, int numDepEvents,
                                         void *doneEvent)
{
    lull_call call;

    (void)depEvents;
    (void)numDepEvents;
    (void)doneEvent;
    if (lull_call_begin(&call, device_of(filter)))
        lull_fail(&call.fault, OIDN_ERROR_INVALID_OPERATION, "the filter is not of a SYCL device");
    lull_call_end(&call);
}
