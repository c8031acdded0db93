/* Threads of lull-threads.wasm. See pool.h, and oidn/threads.c, whose way of sharing loops this is:
 * each thread has a range of the indices, end << 16 | next, of which one fetch-and-add takes the
 * next; when it has done with its own it helps with the others'. So the caller waits only for
 * indices that were taken, never for a worker that is slow to wake.
 *
 * Threads look for work a number of times before they sleep; a clock would have to be asked in
 * JavaScript. The main thread of a browser must not sleep at all. */
#include "pool.h"

#include <stddef.h>
#include <stdint.h>

#define THREADS_MAX 64u
#define LOOP_MAX 0x7fffu      /* indices published at once; longer loops run in pieces */
#define SECOND_NS 1000000000  /* longest sleep of the caller's */
#define PATIENCE 10u          /* such sleeps without any progress before workers are given up */
#define APART 128u            /* bytes between words that different threads write often */

/* Milliseconds since some time. */
__attribute__((import_module("lull"), import_name("clock"))) double clock_ms(void);

static struct {
    uint32_t loop;     /* number of the last loop that was published; workers sleep on it */
    uint32_t sleepers; /* workers asleep */
    uint32_t waiting;  /* the caller sleeps on `done` */
    uint32_t failed;

    void (*body)(void *context, unsigned index, unsigned worker);
    void *context;
    unsigned base;  /* added to indices: start of the piece */
    unsigned count; /* indices of the piece */

    unsigned threads, spins;
    int may_sleep; /* the caller may */
    char why[256]; /* it failed: text that lull-worker.mjs writes */

    char apart[APART];
    uint32_t done; /* finished indices of the loop */
    char apart_too[APART];
} pool;

static struct {
    uint32_t range;
    char apart[APART - sizeof(uint32_t)];
} places[THREADS_MAX];

static uint32_t load(const uint32_t *word) { return __atomic_load_n(word, __ATOMIC_SEQ_CST); }
static void store(uint32_t *word, uint32_t value)
{
    __atomic_store_n(word, value, __ATOMIC_SEQ_CST);
}
static uint32_t add(uint32_t *word, uint32_t value)
{
    return __atomic_fetch_add(word, value, __ATOMIC_SEQ_CST);
}

unsigned pool_threads(void) { return pool.threads ? pool.threads : 1; }

int pool_failed(void) { return (int)load(&pool.failed); }

/* Before workers call `work`; at most THREADS_MAX. `spins`: how often a thread looks for work
 * before it sleeps; `may_sleep`: 0 on the main thread of a browser. */
EXPORT(void, start, (unsigned threads, unsigned spins, int may_sleep))
{
    pool.threads = threads;
    pool.spins = spins;
    pool.may_sleep = may_sleep;
}

/* For workers: this one failed. `why` is where it says so first, in fewer bytes than there are. */
EXPORT(void, fail, (void))
{
    store(&pool.failed, 1);
    __builtin_wasm_memory_atomic_notify((int *)&pool.done, 1);
}
EXPORT(char *, why, (void)) { return pool.why; }

EXPORT(int, failed, (void)) { return pool_failed(); }

/* Takes indices of a thread's range until there are none; returns how many it took. Others' ranges
 * are looked at first: taking from them costs their owners time. */
static unsigned run_range(unsigned owner, unsigned thread)
{
    uint32_t *range = &places[owner].range;
    unsigned taken = 0;
    for (;; taken++) {
        uint32_t r = owner == thread ? 1u << 16 : load(range);
        if ((r & 0xffffu) < r >> 16)
            r = add(range, 1);
        if ((r & 0xffffu) >= r >> 16)
            return taken;
        pool.body(pool.context, pool.base + (r & 0xffffu), thread);
    }
}

/* The thread's own range, then what is left of the others'. */
static void run_indices(unsigned thread)
{
    unsigned i, taken = 0, count;
    for (i = 0; i < pool.threads; i++)
        taken += run_range((thread + i) % pool.threads, thread);
    if (!taken)
        return;
    count = pool.count; /* of the loop that waits for these */
    if (add(&pool.done, taken) + taken == count && load(&pool.waiting))
        __builtin_wasm_memory_atomic_notify((int *)&pool.done, 1);
}

/* What a worker does, for good: it is ended from outside. */
EXPORT(void, work, (unsigned thread))
{
    for (;;) {
        const uint32_t seen = load(&pool.loop);
        unsigned spins = pool.spins;
        run_indices(thread);
        while (load(&pool.loop) == seen && spins)
            spins--;
        if (spins)
            continue;
        add(&pool.sleepers, 1);
        __builtin_wasm_memory_atomic_wait32((int *)&pool.loop, (int)seen, -1);
        add(&pool.sleepers, (uint32_t)-1);
    }
}

/* Shares `count` indices among the threads, and wakes as many as there are indices for. */
static void publish(unsigned count)
{
    uint32_t i, first = 0;
    pool.count = count;
    store(&pool.done, 0);
    for (i = 0; i < pool.threads; i++) {
        const uint32_t end =
            count / pool.threads * (i + 1) + count % pool.threads * (i + 1) / pool.threads;
        store(&places[i].range, end << 16 | first);
        first = end;
    }
    add(&pool.loop, 1);
    if (load(&pool.sleepers))
        __builtin_wasm_memory_atomic_notify((int *)&pool.loop, count - 1);
}

/* Waits until the taken indices are finished: awake first, then asleep. A worker that is no more
 * (ended by its browser, say) finishes none. */
static void wait_finished(unsigned count)
{
    unsigned spins = pool.spins, seconds = 0;
    uint32_t done = 0, before = 0;
    double since;

    for (;; spins--)
        if (load(&pool.done) == count)
            return;
        else if (!spins)
            break;
    since = clock_ms();
    store(&pool.waiting, 1);
    while ((done = load(&pool.done)) != count && !load(&pool.failed)) {
        if (pool.may_sleep)
            __builtin_wasm_memory_atomic_wait32((int *)&pool.done, (int)done, SECOND_NS);
        if (done != before) {
            before = done;
            seconds = 0;
            since = clock_ms();
        } else if (clock_ms() - since > SECOND_NS / 1e6 - 1) { /* as one if all were stopped */
            since = clock_ms();
            if (++seconds == PATIENCE)
                store(&pool.failed, 1);
        }
    }
    store(&pool.waiting, 0);
}

void pool_for(void *user, unsigned count,
              void (*body)(void *context, unsigned index, unsigned worker), void *context)
{
    unsigned i;
    (void)user;
    if (pool_threads() == 1 || count == 1) {
        for (i = 0; i < count; i++)
            body(context, i, 0);
        return;
    }
    for (pool.base = 0; count && !pool_failed(); pool.base += i, count -= i) {
        i = count < LOOP_MAX ? count : LOOP_MAX;
        pool.body = body;
        pool.context = context;
        publish(i);
        run_indices(0);
        wait_finished(i);
    }
}
