/* Buffers: memory with a handle. */
#include "internal.h"

#include <string.h>

/* ---- Creation -------------------------------------------------------------------------------- */

static OIDNBuffer new_buffer(OIDNDevice device, void *data, size_t bytes, OIDNStorage storage,
                             bool owned, lull_fault *fault)
{
    OIDNBuffer buffer = lull_os_alloc_zero(sizeof *buffer);

    if (!buffer) {
        lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory");
        return NULL;
    }
    if (owned && bytes) {
        data = lull_os_alloc(bytes);
        if (!data) {
            lull_os_free(buffer);
            lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "out of memory: buffer of %llu bytes",
                      (unsigned long long)bytes);
            return NULL;
        }
    }
    buffer->refs = 1;
    buffer->users = 1;
    lull_atomic_add(&device->users, 1);
    buffer->device = device;
    buffer->data = data;
    buffer->bytes = bytes;
    buffer->storage = storage;
    buffer->owned = owned;
    lull_device_hold(device);
    return buffer;
}

OIDN_API OIDNBuffer oidnNewBufferWithStorage(OIDNDevice device, size_t byteSize,
                                             OIDNStorage storage)
{
    OIDNBuffer buffer = NULL;
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault)) {
        if ((int)storage < OIDN_STORAGE_UNDEFINED || storage > OIDN_STORAGE_MANAGED)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "invalid storage: %d",
                      (int)storage);
        else
            buffer = new_buffer(device, NULL, byteSize,
                                storage == OIDN_STORAGE_UNDEFINED ? OIDN_STORAGE_MANAGED : storage,
                                true, &call.fault);
    }
    lull_call_end(&call);
    return buffer;
}

OIDN_API OIDNBuffer oidnNewBuffer(OIDNDevice device, size_t byteSize)
{
    return oidnNewBufferWithStorage(device, byteSize, OIDN_STORAGE_UNDEFINED);
}

OIDN_API OIDNBuffer oidnNewSharedBuffer(OIDNDevice device, void *devPtr, size_t byteSize)
{
    OIDNBuffer buffer = NULL;
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault)) {
        if (!devPtr)
            lull_fail(&call.fault, OIDN_ERROR_INVALID_ARGUMENT, "buffer pointer is null");
        else
            buffer = new_buffer(device, devPtr, byteSize, OIDN_STORAGE_HOST, false, &call.fault);
    }
    lull_call_end(&call);
    return buffer;
}

/* Imports of foreign memory, which no processor needs. No type is one that every device supports:
 * then it is the import that it does not. */
static OIDNBuffer refuse(OIDNDevice device, bool is_argument, const char *why)
{
    const OIDNError code = is_argument ? OIDN_ERROR_INVALID_ARGUMENT : OIDN_ERROR_INVALID_OPERATION;
    lull_call call;

    if (lull_call_begin(&call, device) && lull_device_ready(device, &call.fault))
        lull_fail(&call.fault, code, "%s", why);
    lull_call_end(&call);
    return NULL;
}

OIDN_API OIDNBuffer oidnNewSharedBufferFromFD(OIDNDevice device, OIDNExternalMemoryTypeFlags fdType,
                                              int fd, size_t byteSize)
{
    (void)fd;
    (void)byteSize;
    return refuse(device, fdType != OIDN_EXTERNAL_MEMORY_TYPE_FLAG_NONE,
                  "the device supports no external memory of this type");
}

OIDN_API OIDNBuffer oidnNewSharedBufferFromWin32Handle(OIDNDevice device,
                                                       OIDNExternalMemoryTypeFlags handleType,
                                                       void *handle, const void *name,
                                                       size_t byteSize)
{
    (void)byteSize;
    return refuse(device, handleType != OIDN_EXTERNAL_MEMORY_TYPE_FLAG_NONE || !handle == !name,
                  "the device supports no external memory of this type");
}

OIDN_API OIDNBuffer oidnNewSharedBufferFromMetal(OIDNDevice device, MTLBuffer_id metal)
{
    (void)metal;
    return refuse(device, false, "the device supports no Metal buffers");
}

/* ---- Lifetime -------------------------------------------------------------------------------- */

void lull_buffer_hold(OIDNBuffer buffer)
{
    if (buffer)
        lull_atomic_add(&buffer->refs, 1);
}

void lull_buffer_drop(OIDNBuffer buffer)
{
    OIDNDevice device;

    if (!buffer || lull_atomic_add(&buffer->refs, (uint32_t)-1) != 1)
        return;
    device = buffer->device;
    if (buffer->owned)
        lull_os_free(buffer->data);
    lull_os_free(buffer);
    lull_device_drop(device);
}

void lull_buffer_attach(OIDNBuffer buffer)
{
    if (buffer)
        lull_atomic_add(&buffer->attached, 1);
    lull_buffer_hold(buffer);
}

void lull_buffer_detach(OIDNBuffer buffer)
{
    if (buffer)
        lull_atomic_add(&buffer->attached, (uint32_t)-1);
    lull_buffer_drop(buffer);
}

OIDN_API void oidnRetainBuffer(OIDNBuffer buffer)
{
    if (buffer) {
        lull_atomic_add(&buffer->users, 1);
        lull_buffer_hold(buffer);
    } else {
        lull_global_error(OIDN_ERROR_INVALID_ARGUMENT, "handle is null");
    }
}

/* Waits after the last handle: the caller may then free what copies come from and go to, and the
 * memory behind a shared buffer. A buffer that filters have lives on, and releasing those waits for
 * the copies: only the memory of a shared one may go before. */
static void finish_work(OIDNBuffer buffer)
{
    lull_fault ignored = {OIDN_ERROR_NONE, ""};
    const bool is_last = lull_atomic_add(&buffer->device->users, (uint32_t)-1) == 1;

    if (is_last || !lull_atomic_load(&buffer->attached))
        lull_queue_finish(buffer->device);
    else if (!buffer->owned)
        lull_queue_wait(buffer->device, buffer->last_job, &ignored);
}

OIDN_API void oidnReleaseBuffer(OIDNBuffer buffer)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL) &&
        lull_atomic_add(&buffer->users, (uint32_t)-1) == 1)
        finish_work(buffer);
    if (lull_call_end(&call))
        lull_buffer_drop(buffer);
}

/* ---- Queries --------------------------------------------------------------------------------- */

OIDN_API size_t oidnGetBufferSize(OIDNBuffer buffer)
{
    lull_call call;
    size_t bytes = 0;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        bytes = buffer->bytes;
    lull_call_end(&call);
    return bytes;
}

OIDN_API OIDNStorage oidnGetBufferStorage(OIDNBuffer buffer)
{
    lull_call call;
    OIDNStorage storage = OIDN_STORAGE_UNDEFINED;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        storage = buffer->storage;
    lull_call_end(&call);
    return storage;
}

OIDN_API void *oidnGetBufferData(OIDNBuffer buffer)
{
    lull_call call;
    void *data = NULL;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        data = buffer->data;
    lull_call_end(&call);
    return data;
}

/* ---- Copies ---------------------------------------------------------------------------------- */

static void run_copy(const lull_job *job, lull_fault *fault)
{
    (void)fault;
    memmove(job->target, job->source, job->bytes); /* a shared buffer may lie in the same memory */
}

/* Copies [offset, offset+bytes) of a buffer to `to`, or `from` to it; exactly one of them
 * is meant. */
static bool copy(OIDNBuffer buffer, size_t offset, size_t bytes, void *to, const void *from,
                 bool is_read, bool async, lull_fault *fault)
{
    OIDNDevice device = buffer->device;
    lull_job job = {0};

    if (!lull_queue_reserve(device, fault))
        return false;
    if (!async && lull_queue_is_self(&device->queue))
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "a progress function cannot wait for the work that it belongs to");
    if (offset > buffer->bytes || bytes > buffer->bytes - offset)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT,
                         "buffer region is out of range: %llu bytes at offset %llu of %llu",
                         (unsigned long long)bytes, (unsigned long long)offset,
                         (unsigned long long)buffer->bytes);
    if (!bytes)
        return true;
    if (is_read ? !to : !from)
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "host pointer is null");
    job.run = run_copy;
    job.target = is_read ? to : buffer->data + offset;
    job.source = is_read ? buffer->data + offset : from;
    job.bytes = bytes;
    job.buffers[0] = buffer;
    lull_buffer_hold(buffer);
    buffer->last_job = lull_queue_submit(device, &job);
    /* Earlier work that failed is told of by a sync or an execution, not by this copy. */
    return async || lull_queue_wait(device, buffer->last_job, fault);
}

OIDN_API void oidnReadBuffer(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                             void *dstHostPtr)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        copy(buffer, byteOffset, byteSize, dstHostPtr, NULL, true, false, &call.fault);
    lull_call_end(&call);
}

OIDN_API void oidnReadBufferAsync(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                                  void *dstHostPtr)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        copy(buffer, byteOffset, byteSize, dstHostPtr, NULL, true, true, &call.fault);
    lull_call_end(&call);
}

OIDN_API void oidnWriteBuffer(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                              const void *srcHostPtr)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        copy(buffer, byteOffset, byteSize, NULL, srcHostPtr, false, false, &call.fault);
    lull_call_end(&call);
}

OIDN_API void oidnWriteBufferAsync(OIDNBuffer buffer, size_t byteOffset, size_t byteSize,
                                   const void *srcHostPtr)
{
    lull_call call;

    if (lull_call_begin(&call, buffer ? buffer->device : NULL))
        copy(buffer, byteOffset, byteSize, NULL, srcHostPtr, false, true, &call.fault);
    lull_call_end(&call);
}
