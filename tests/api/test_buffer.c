/* The contract of buffers, row by row: creation, sharing, copies, mapping. */
#include "api.h"

#include <limits.h>

/* ---- Buffers --------------------------------------------------------------------------------- */

static void buffer_creation(void)
{
    static const struct {
        size_t bytes;
        int storage; /* -100: oidnNewBuffer */
        OIDNError error;
        int reads_back;
    } rows[] = {
        {100, -100, NONE, OIDN_STORAGE_MANAGED},
        {100, OIDN_STORAGE_UNDEFINED, NONE, OIDN_STORAGE_MANAGED},
        {100, OIDN_STORAGE_HOST, NONE, OIDN_STORAGE_HOST},
        {100, OIDN_STORAGE_DEVICE, NONE, OIDN_STORAGE_DEVICE},
        {100, OIDN_STORAGE_MANAGED, NONE, OIDN_STORAGE_MANAGED},
        {100, 4, ARGUMENT, 0},
        {100, -42, ARGUMENT, 0},
        {0, -42, ARGUMENT, 0},
        {0, -100, NONE, OIDN_STORAGE_MANAGED},
        {0, OIDN_STORAGE_HOST, NONE, OIDN_STORAGE_HOST},
        {0, OIDN_STORAGE_DEVICE, NONE, OIDN_STORAGE_DEVICE},
        {INTPTR_MAX, -100, MEMORY, 0},
        {INTPTR_MAX, OIDN_STORAGE_DEVICE, MEMORY, 0},
        {SIZE_MAX - 8, OIDN_STORAGE_HOST, MEMORY, 0},
    };
    OIDNDevice device = new_device();
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        OIDNBuffer buffer =
            rows[i].storage == -100
                ? oidnNewBuffer(device, rows[i].bytes)
                : oidnNewBufferWithStorage(device, rows[i].bytes, (OIDNStorage)rows[i].storage);

        CHECK_EQ(buffer != NULL, rows[i].error == NONE);
        ERROR(device, rows[i].error);
        if (!buffer)
            continue;
        CHECK_EQ(oidnGetBufferSize(buffer), rows[i].bytes);
        CHECK_EQ(oidnGetBufferStorage(buffer), rows[i].reads_back);
        CHECK_EQ(oidnGetBufferData(buffer) != NULL, rows[i].bytes > 0);
        ERROR(device, NONE);
        oidnReleaseBuffer(buffer);
    }
    oidnReleaseDevice(device);
}

static void shared_buffers(void)
{
    OIDNDevice device = new_device();
    char memory[64];
    OIDNBuffer buffer = oidnNewSharedBuffer(device, memory, sizeof memory);

    CHECK(oidnGetBufferData(buffer) == memory);
    CHECK_EQ(oidnGetBufferSize(buffer), 64);
    CHECK_EQ(oidnGetBufferStorage(buffer), OIDN_STORAGE_HOST);
    oidnRetainBuffer(buffer);
    oidnReleaseBuffer(buffer);
    CHECK_EQ(oidnGetBufferSize(buffer), 64);
    oidnReleaseBuffer(buffer);
    buffer = oidnNewSharedBuffer(device, memory, 0);
    CHECK(buffer != NULL);
    ERROR(device, NONE);
    oidnReleaseBuffer(buffer);
    CHECK(!oidnNewSharedBuffer(device, NULL, 0));
    ERROR(device, ARGUMENT);
    CHECK(!oidnNewSharedBuffer(device, NULL, 8));
    ERROR(device, ARGUMENT);
    CHECK(!oidnNewSharedBufferFromFD(
        device, OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DMA_BUF | OIDN_EXTERNAL_MEMORY_TYPE_FLAG_DEDICATED,
        0, 16));
    ERROR(device, ARGUMENT);
    CHECK(!oidnNewSharedBufferFromWin32Handle(device, 4, memory, memory, 16));
    ERROR(device, ARGUMENT);
    CHECK(!oidnNewSharedBufferFromWin32Handle(device, 4, NULL, NULL, 16));
    ERROR(device, ARGUMENT);
    /* No type: the import is what the device cannot do. */
    CHECK(!oidnNewSharedBufferFromFD(device, OIDN_EXTERNAL_MEMORY_TYPE_FLAG_NONE, 0, 16));
    ERROR(device, OPERATION);
    CHECK(!oidnNewSharedSemaphoreFromFD(device, OIDN_EXTERNAL_SEMAPHORE_TYPE_FLAG_NONE, 0));
    ERROR(device, OPERATION);
    for (int i = 0; i < 4; i++) {
        void *handle = i & 1 ? memory : NULL, *name = i & 2 ? memory : NULL;

        CHECK(!oidnNewSharedBufferFromWin32Handle(device, 0, handle, name, 16));
        ERROR(device, !handle == !name ? ARGUMENT : OPERATION);
        CHECK(!oidnNewSharedSemaphoreFromWin32Handle(device, 0, handle, name));
        ERROR(device, !handle == !name ? ARGUMENT : OPERATION);
    }
    for (int n = -1; n <= 1; n++) {
        oidnSignalSemaphoresAsync(device, NULL, NULL, n);
        ERROR(device, OPERATION);
        oidnWaitSemaphoresAsync(device, NULL, NULL, NULL, n);
        ERROR(device, OPERATION);
    }
    oidnReleaseDevice(device);
}

static void buffer_copies(void)
{
    static const struct {
        size_t offset, size;
        int has_pointer;
        OIDNError error;
    } rows[] = {
        {0, 256, 1, NONE},
        {0, 0, 1, NONE},
        {0, 0, 0, NONE},
        {256, 0, 0, NONE},
        {64, 64, 1, NONE},
        {0, 256, 0, ARGUMENT},
        {0, 1, 0, ARGUMENT},
        {0, 257, 1, ARGUMENT},
        {256, 256, 1, ARGUMENT},
        {257, 0, 1, ARGUMENT},
        {SIZE_MAX, 1, 1, ARGUMENT},
        {SIZE_MAX, 0, 1, ARGUMENT},
        {1, SIZE_MAX, 1, ARGUMENT},
        {SIZE_MAX - 255, 256, 1, ARGUMENT},
        {SIZE_MAX, SIZE_MAX, 1, ARGUMENT},
    };
    OIDNDevice device = new_device();
    OIDNBuffer buffer = oidnNewBufferWithStorage(device, 256, OIDN_STORAGE_DEVICE);
    unsigned char in[256], out[256];
    size_t i, k;

    for (i = 0; i < COUNT(rows); i++) {
        void *to = rows[i].has_pointer ? out : NULL;
        const void *from = rows[i].has_pointer ? in : NULL;

        oidnWriteBuffer(buffer, rows[i].offset, rows[i].size, from);
        ERROR(device, rows[i].error);
        oidnReadBuffer(buffer, rows[i].offset, rows[i].size, to);
        ERROR(device, rows[i].error);
        oidnWriteBufferAsync(buffer, rows[i].offset, rows[i].size, from);
        ERROR(device, rows[i].error);
        oidnReadBufferAsync(buffer, rows[i].offset, rows[i].size, to);
        ERROR(device, rows[i].error);
        oidnSyncDevice(device);
        ERROR(device, NONE);
    }
    for (k = 0; k < 256; k++)
        in[k] = (unsigned char)(k * 7 + 1);
    for (i = 0; i < 2; i++) {
        memset(out, 0, sizeof out);
        (i ? oidnWriteBufferAsync : oidnWriteBuffer)(buffer, 0, 256, in);
        (i ? oidnWriteBufferAsync : oidnWriteBuffer)(buffer, 10, 5, in);
        (i ? oidnReadBufferAsync : oidnReadBuffer)(buffer, 0, 256, out);
        oidnSyncDevice(device);
        CHECK(!memcmp(out, in, 10) && !memcmp(out + 10, in, 5) && !memcmp(out + 15, in + 15, 241));
        memset(out, 0, sizeof out);
        (i ? oidnReadBufferAsync : oidnReadBuffer)(buffer, 100, 9, out + 3);
        oidnSyncDevice(device);
        CHECK(!out[2] && !memcmp(out + 3, in + 100, 9) && !out[12]);
    }
    ERROR(device, NONE);
    oidnReleaseDevice(device);
    oidnReleaseBuffer(buffer);
}

/* Host memory that a copy comes from or goes to may be the shared buffer's own, shifted. */
static void overlapping_copies(void)
{
    enum { N = 1000, SHIFT = 100 };
    static unsigned char memory[N];
    OIDNDevice device = new_device();
    OIDNBuffer buffer = oidnNewSharedBuffer(device, memory, N);
    int way, i, wrong;

    for (way = 0; way < 4; way++) {
        for (i = 0; i < N; i++)
            memory[i] = (unsigned char)(i * 7 % 251);
        if (way == 0)
            oidnReadBuffer(buffer, 0, N - SHIFT, memory + SHIFT);
        else if (way == 1)
            oidnReadBuffer(buffer, SHIFT, N - SHIFT, memory);
        else if (way == 2)
            oidnWriteBuffer(buffer, SHIFT, N - SHIFT, memory);
        else
            oidnWriteBuffer(buffer, 0, N - SHIFT, memory + SHIFT);
        ERROR(device, NONE);
        wrong = 0;
        for (i = 0; i < N; i++) {
            const int from =
                way % 2 == 0 ? (i < SHIFT ? i : i - SHIFT) : (i < N - SHIFT ? i + SHIFT : i);

            wrong += memory[i] != (unsigned char)(from * 7 % 251);
        }
        CHECK_EQ(wrong, 0);
    }
    oidnReleaseBuffer(buffer);
    oidnReleaseDevice(device);
}

static void legacy_mapping(void)
{
    OIDNDevice device;
    OIDNBuffer buffer;
    char *data;

    OURS_ALONE("2 has no oidnMapBuffer");
    device = new_device();
    buffer = oidnNewBuffer(device, 64);
    data = oidnGetBufferData(buffer);
    CHECK(oidnMapBuffer(buffer, OIDN_ACCESS_WRITE, 0, 0) == data);
    oidnUnmapBuffer(buffer, data);
    ERROR(device, NONE);
    CHECK(oidnMapBuffer(buffer, OIDN_ACCESS_READ_WRITE, 16, 48) == data + 16);
    oidnUnmapBuffer(buffer, data + 16);
    ERROR(device, NONE);
    CHECK(!oidnMapBuffer(buffer, OIDN_ACCESS_READ, 16, 49));
    ERROR(device, ARGUMENT);
    CHECK(!oidnMapBuffer(buffer, OIDN_ACCESS_READ, 65, 0));
    ERROR(device, ARGUMENT);
    CHECK(!oidnMapBuffer(buffer, (OIDNAccess)4, 0, 0));
    ERROR(device, ARGUMENT);
    oidnUnmapBuffer(buffer, data + 65);
    ERROR(device, ARGUMENT);
    oidnReleaseBuffer(buffer);
    oidnReleaseDevice(device);
}

int main(int argc, char **argv)
{
    CHECK_MAIN(argc, argv);
    RUN(buffer_creation);
    RUN(shared_buffers);
    RUN(buffer_copies);
    RUN(overlapping_copies);
    RUN(legacy_mapping);
    free_identity();
    return check_report();
}
