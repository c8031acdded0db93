/* Random sequences of valid and invalid calls from two threads that share their objects.
 *
 *     test_fuzz_api                 the seeds that `make check` replays
 *     test_fuzz_api --seconds 600   new seeds for that long
 *     test_fuzz_api --seed N        one of them
 *
 * Finds crashes, hangs, impossible error codes; under sanitizers also leaks, races and bad
 * accesses. All pixels of a device lie in memory of its own, which only its queue touches, so a
 * reported race is ours. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE
#endif
#include "api.h"
#include "threads.h"

#include <stdint.h>
#include <time.h>

enum { DEVICES = 3, BUFFERS = 6, FILTERS = 6, ARENA = 1 << 18, CALLS = 250, SEEDS = 40 };

/* Sanitizers: failing to allocate is no error. */
#if defined(__GNUC__)
#define VISIBLE __attribute__((visibility("default")))
#else
#define VISIBLE
#endif
VISIBLE const char *__asan_default_options(void);
VISIBLE const char *__msan_default_options(void);
VISIBLE const char *__tsan_default_options(void);
const char *__asan_default_options(void) { return "allocator_may_return_null=1"; }
const char *__msan_default_options(void) { return "allocator_may_return_null=1"; }
const char *__tsan_default_options(void) { return "allocator_may_return_null=1"; }

/* ---- Randomness ------------------------------------------------------------------------------ */

typedef struct dice {
    uint64_t state;
} dice;

static uint32_t roll(dice *d)
{
    d->state = d->state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(d->state >> 33);
}

static uint32_t below(dice *d, uint32_t n) { return roll(d) % n; }
static int chance(dice *d, unsigned percent) { return below(d, 100) < percent; }

/* Mostly small numbers, sometimes ones at the edges. */
static size_t size_value(dice *d)
{
    static const size_t edges[] = {0,         1,          16,           65536,   65537,
                                   INT32_MAX, UINT32_MAX, SIZE_MAX / 2, SIZE_MAX};

    return chance(d, 6) ? edges[below(d, COUNT(edges))] : below(d, 40);
}

static int int_value(dice *d)
{
    static const int edges[] = {-1, 0, 1, 4, 5, 6, INT32_MAX, INT32_MIN};

    return chance(d, 80) ? edges[below(d, COUNT(edges))] : (int)roll(d);
}

static const char *name_value(dice *d)
{
    static const char *const names[] = {
        "color",       "color",
        "albedo",      "normal",
        "output",      "output",
        "hdr",         "srgb",
        "cleanAux",    "directional",
        "inputScale",  "quality",
        "maxMemoryMB", "weights",
        "tileOverlap", "hdrScale",
        "verbos",      "",
        NULL,          "a name that is far longer than any parameter could ever have been called",
    };

    return names[below(d, COUNT(names))];
}

static OIDNFormat format_value(dice *d)
{
    static const int formats[] = {1, 2, 3, 3, 3, 3, 3, 4, 257, 258, 259, 259, 260, 0, 5, -1};

    return (OIDNFormat)formats[below(d, COUNT(formats))];
}

/* ---- Shared objects -------------------------------------------------------------------------- */

static unsigned char arenas[DEVICES][ARENA];

static struct {
    OIDNDevice device[DEVICES];
    OIDNBuffer buffer[BUFFERS];
    int buffer_device[BUFFERS];
    OIDNFilter filter[FILTERS];
    int filter_device[FILTERS];
} shared;

#if LULL_WITH_THREADS
static pthread_mutex_t table = PTHREAD_MUTEX_INITIALIZER;
static void lock(void) { pthread_mutex_lock(&table); }
static void unlock(void) { pthread_mutex_unlock(&table); }
#else
static void lock(void) {}
static void unlock(void) {}
#endif

/* A reference of the caller's own to one of the objects, or NULL. *arena: that of its device. */
static OIDNDevice get_device(dice *d, int *arena)
{
    OIDNDevice device;

    *arena = (int)below(d, DEVICES);
    if (chance(d, 1))
        return NULL;
    lock();
    device = shared.device[*arena];
    if (device)
        oidnRetainDevice(device);
    unlock();
    return device;
}

static OIDNBuffer get_buffer(dice *d, int *arena)
{
    const int i = (int)below(d, BUFFERS);
    OIDNBuffer buffer;

    if (chance(d, 1))
        return NULL;
    lock();
    buffer = shared.buffer[i];
    *arena = shared.buffer_device[i];
    if (buffer)
        oidnRetainBuffer(buffer);
    unlock();
    return buffer;
}

static OIDNFilter get_filter(dice *d, int *arena)
{
    const int i = (int)below(d, FILTERS);
    OIDNFilter filter;

    if (chance(d, 1))
        return NULL;
    lock();
    filter = shared.filter[i];
    *arena = shared.filter_device[i];
    if (filter)
        oidnRetainFilter(filter);
    unlock();
    return filter;
}

/* Gives an object's place to a new one (or NULL) and releases the old one. */
static void put_device(int i, OIDNDevice device)
{
    OIDNDevice old;

    lock();
    old = shared.device[i];
    shared.device[i] = device;
    unlock();
    if (old)
        oidnReleaseDevice(old);
}

static void put_buffer(int i, OIDNBuffer buffer, int arena)
{
    OIDNBuffer old;

    lock();
    old = shared.buffer[i];
    shared.buffer[i] = buffer;
    shared.buffer_device[i] = arena;
    unlock();
    if (old)
        oidnReleaseBuffer(old);
}

static void put_filter(int i, OIDNFilter filter, int arena)
{
    OIDNFilter old;

    lock();
    old = shared.filter[i];
    shared.filter[i] = filter;
    shared.filter_device[i] = arena;
    unlock();
    if (old)
        oidnReleaseFilter(old);
}

/* ---- Operations ------------------------------------------------------------------------------ */

static void make_device(dice *d)
{
    const int i = (int)below(d, DEVICES);
    OIDNDevice device;

    lock();
    device = shared.device[i];
    unlock();
    if (device) /* an arena belongs to one device for good: an old one may still be working */
        return;
    device = oidnNewDevice(chance(d, 90) ? OIDN_DEVICE_TYPE_CPU : (OIDNDeviceType)int_value(d));
    if (!device)
        return;
    oidnSetDeviceInt(device, "numThreads", (int)below(d, 4));
    if (chance(d, 95))
        oidnCommitDevice(device);
    lock();
    if (!shared.device[i]) {
        shared.device[i] = device;
        device = NULL;
    }
    unlock();
    if (device)
        oidnReleaseDevice(device);
}

static void device_call(dice *d)
{
    int arena;
    OIDNDevice device = get_device(d, &arena);
    const char *text;

    switch (below(d, 8)) {
    case 0:
        oidnSyncDevice(device);
        break;
    case 1:
        oidnGetDeviceInt(device, chance(d, 50) ? "numThreads" : name_value(d));
        break;
    case 2:
        oidnGetDeviceBool(device, name_value(d));
        break;
    case 3:
        if (chance(d, 3)) /* closes the device */
            oidnSetDeviceInt(device, name_value(d), 0);
        break;
    case 4:
        oidnCommitDevice(device);
        break;
    case 5:
        oidnSetDeviceErrorFunction(device, NULL, NULL);
        break;
    case 6:
        oidnNewSharedSemaphoreFromFD(device, roll(d), int_value(d));
        break;
    default:
        break;
    }
    if (oidnGetDeviceError(device, &text) > OIDN_ERROR_CANCELLED)
        abort();
    if (device)
        oidnReleaseDevice(device);
}

static void make_buffer(dice *d)
{
    int arena;
    OIDNDevice device = get_device(d, &arena);
    OIDNBuffer buffer;
    const size_t size = size_value(d) * 100;
    const unsigned kind = below(d, 4), own = kind < 2;

    switch (kind) {
    case 0:
        buffer = oidnNewBuffer(device, size);
        break;
    case 1:
        buffer = oidnNewBufferWithStorage(device, size, (OIDNStorage)int_value(d));
        break;
    case 2:
        buffer = oidnNewSharedBuffer(device, chance(d, 95) ? arenas[arena] : NULL, ARENA);
        break;
    default:
        buffer = oidnNewSharedBufferFromFD(device, roll(d), 0, size);
        break;
    }
    if (buffer && own && size && size < 1 << 24) /* pixels without a value are the host's error */
        memset(oidnGetBufferData(buffer), 0, size);
    if (buffer)
        put_buffer((int)below(d, BUFFERS), buffer, arena);
    if (device)
        oidnReleaseDevice(device);
}

static void buffer_call(dice *d)
{
    int arena = 0;
    OIDNBuffer buffer = get_buffer(d, &arena);
    const size_t offset = size_value(d), size = size_value(d) * 10;
    unsigned char *host =
        chance(d, 95) && size < ARENA / 2 ? arenas[arena] + below(d, ARENA / 2) : NULL;

    switch (below(d, 7)) {
    case 0:
        oidnReadBuffer(buffer, offset, size, host);
        break;
    case 1:
        oidnReadBufferAsync(buffer, offset, size, host);
        break;
    case 2:
        oidnGetBufferSize(buffer);
        break;
    case 3:
        oidnGetBufferData(buffer);
        break;
    case 4:
        oidnGetBufferStorage(buffer);
        break;
    case 5:
        put_buffer((int)below(d, BUFFERS), NULL, 0);
        break;
    default:
        oidnMapBuffer(buffer, (OIDNAccess)int_value(d), offset, size);
        break;
    }
    if (buffer)
        oidnReleaseBuffer(buffer);
}

static void make_filter(dice *d)
{
    static const char *const types[] = {"RT",         "RT", "RT", "RT", "RTLightmap",
                                        "RTLightmap", "",   "rt", NULL};
    int arena;
    OIDNDevice device = get_device(d, &arena);
    OIDNFilter filter = oidnNewFilter(device, types[below(d, COUNT(types))]);

    if (filter)
        put_filter((int)below(d, FILTERS), filter, arena);
    if (device)
        oidnReleaseDevice(device);
}

/* An image somewhere in the arena; with wild values only through a buffer, which checks them. */
static void set_image(dice *d, OIDNFilter filter, int arena)
{
    const size_t width = chance(d, 80) ? 24 : size_value(d),
                 height = chance(d, 80) ? 20 : size_value(d);
    const size_t pixel = chance(d, 70) ? 0 : size_value(d),
                 row = chance(d, 80) ? 0 : size_value(d) * 60;
    const size_t offset = chance(d, 80) ? below(d, 20) * 1000 : size_value(d);
    int other = arena;
    OIDNBuffer buffer;

    if (width < 50 && height < 50 && pixel < 50 && row < 3000 && offset < 20000 && chance(d, 60)) {
        oidnSetSharedFilterImage(filter, name_value(d), chance(d, 97) ? arenas[arena] : NULL,
                                 format_value(d), width, height, offset, pixel, row);
        return;
    }
    buffer = get_buffer(d, &other);
    oidnSetFilterImage(filter, name_value(d), buffer, format_value(d), width, height, offset, pixel,
                       row);
    if (buffer)
        oidnReleaseBuffer(buffer);
}

/* What makes most commits succeed. */
static void set_usual(dice *d, OIDNFilter filter, int arena)
{
    static const char *const names[] = {"color", "albedo", "normal", "output"};
    const unsigned inputs = 1 + below(d, 3), height = 1 + below(d, 30);
    unsigned i;

    for (i = 0; i < 4; i++)
        if (i < inputs || i == 3)
            oidnSetSharedFilterImage(filter, names[i], arenas[arena], OIDN_FORMAT_FLOAT3, 20,
                                     height, below(d, 20) * 1200, 0, 0);
        else
            oidnUnsetFilterImage(filter, names[i]);
    oidnSetFilterBool(filter, "srgb", false);
    oidnSetFilterInt(filter, "maxMemoryMB", chance(d, 60) ? -1 : (int)below(d, 4));
    if (chance(d, 80))
        use_identity(filter, 3 * inputs);
    else
        oidnUnsetFilterData(filter, "weights"); /* built-in ones, as far as there are */
}

static bool progress(void *user, double n)
{
    if (!(n >= 0 && n <= 1))
        abort();
    return n < (double)(uintptr_t)user / 100;
}

static void set_value(dice *d, OIDNFilter filter)
{
    static unsigned char garbage[900];
    const char *name = name_value(d);
    weights w;

    switch (below(d, 9)) {
    case 0:
        oidnSetFilterBool(filter, name, chance(d, 50));
        break;
    case 1:
        oidnSetFilterInt(filter, name, int_value(d));
        break;
    case 2:
        oidnSetFilterFloat(filter, name, (float)int_value(d));
        break;
    case 3:
        oidnUnsetFilterImage(filter, name);
        break;
    case 4:
        oidnUnsetFilterData(filter, name);
        break;
    case 5:
        oidnUpdateFilterData(filter, name);
        break;
    case 6:
        oidnSetSharedFilterData(filter, name, garbage, sizeof garbage);
        break;
    case 7:
        w = identity(3 * (1 + below(d, 3)));
        oidnSetSharedFilterData(filter, "weights", w.data,
                                chance(d, 80) ? w.bytes : below(d, 5000));
        break;
    default:
        oidnSetFilterProgressMonitorFunction(filter, chance(d, 30) ? NULL : progress,
                                             (void *)(uintptr_t)below(d, 200));
        break;
    }
}

static void filter_call(dice *d)
{
    int arena = 0;
    OIDNFilter filter = get_filter(d, &arena);

    switch (below(d, 12)) {
    case 0:
        set_image(d, filter, arena);
        break;
    case 1:
        set_image(d, filter, arena);
        break;
    case 2:
        set_usual(d, filter, arena);
        break;
    case 3:
        set_usual(d, filter, arena);
        break;
    case 4:
        set_value(d, filter);
        break;
    case 5:
        set_value(d, filter);
        break;
    case 6:
        oidnGetFilterInt(filter, name_value(d));
        break;
    case 7:
        oidnGetFilterFloat(filter, name_value(d));
        break;
    case 8:
        oidnExecuteFilter(filter);
        break;
    case 9:
        oidnExecuteFilterAsync(filter);
        break;
    case 10:
        if (chance(d, 20))
            put_filter((int)below(d, FILTERS), NULL, 0);
        break;
    default:
        break;
    }
    if (chance(d, 50))
        oidnCommitFilter(filter);
    if (chance(d, 30))
        oidnExecuteFilterAsync(filter);
    if (filter)
        oidnReleaseFilter(filter);
}

typedef struct player {
    dice d;
    unsigned calls;
} player;

static void *play(void *user)
{
    static void (*const calls[])(dice *) = {
        make_device, make_buffer, make_filter, make_filter, device_call,
        buffer_call, buffer_call, filter_call, filter_call, filter_call,
    };
    player *p = user;

    for (; p->calls; p->calls--) {
        const unsigned i = below(&p->d, 2 * COUNT(calls));

        (i < COUNT(calls) ? calls[i] : filter_call)(&p->d);
    }
    return NULL;
}

/* One session: two threads, then everything released. */
static void play_seed(uint64_t seed)
{
    player players[2] = {{{seed}, CALLS}, {{~seed}, CALLS}};
    int i;

    for (i = 0; i < DEVICES; i++)
        make_device(&players[0].d);
#if LULL_WITH_THREADS
    {
        pthread_t second;

        pthread_create(&second, NULL, play, &players[1]);
        play(&players[0]);
        pthread_join(second, NULL);
    }
#else
    play(&players[0]);
    play(&players[1]);
#endif
    for (i = 0; i < FILTERS; i++)
        put_filter(i, NULL, 0);
    for (i = 0; i < BUFFERS; i++)
        put_buffer(i, NULL, 0);
    for (i = 0; i < DEVICES; i++) {
        if (shared.device[i])
            oidnSyncDevice(shared.device[i]);
        put_device(i, NULL);
    }
    oidnGetDeviceError(NULL, NULL);
}

static void fill_arenas(void)
{
    unsigned seed = 1;
    size_t i;

    for (i = 0; i < sizeof arenas / 4; i++) {
        const float v = noise(&seed);
        memcpy((unsigned char *)arenas + 4 * i, &v, 4);
    }
}

static void seeds(void)
{
    uint64_t seed;

    for (seed = 1; seed <= SEEDS; seed++) {
        alarm(600); /* a hang ends the program */
        play_seed(seed);
        CHECK(1);
    }
    alarm(0);
}

int main(int argc, char **argv)
{
    identity(3);
    identity(6);
    identity(9);
    fill_arenas();
    if (argc == 3 && !strcmp(argv[1], "--seed")) {
        play_seed(strtoull(argv[2], NULL, 10));
    } else if (argc == 3 && !strcmp(argv[1], "--seconds")) {
        const time_t end = time(NULL) + atoi(argv[2]);
        uint64_t seed = (uint64_t)time(NULL) << 16, first = seed;

        while (time(NULL) < end) {
            FILE *last = fopen("fuzz_api.seed", "w"); /* for when it does not come back */

            if (last) {
                fprintf(last, "%llu\n", (unsigned long long)seed);
                fclose(last);
            }
            alarm(600);
            play_seed(seed++);
        }
        printf("%llu sessions\n", (unsigned long long)(seed - first));
        remove("fuzz_api.seed");
    } else {
        CHECK_MAIN(argc, argv);
        RUN(seeds);
        free_identity();
        return check_report();
    }
    free_identity();
    return 0;
}
