#include "ordered.h"

#include <string.h>

/* The slots are a ring: piece i is in slot i % count, and may be taken when piece i - count was
 * put. Whoever has done a piece puts all that are done and whose turn it is, so that nobody waits
 * for a turn but where all slots are full. */
typedef struct runner {
    const ordered_work *work;
    char *slots;
    size_t slot_size;
    platform_lock *lock;
    size_t count, taken, put; /* slots; pieces so far */
    int is_ended;             /* nothing more is to be taken */
    int is_stopped;           /* nor put */
    char is_done[2 * ORDERED_MAX_THREADS];
} runner;

unsigned ordered_threads(int wanted, int pieces)
{
    int threads = wanted > 0 ? wanted : platform_processors();
    int most = wanted > 0 ? ORDERED_MAX_THREADS : ORDERED_FEW_THREADS;
    if (threads > most)
        threads = most;
    if (threads > pieces / 2)
        threads = pieces / 2;
    return threads > 1 ? (unsigned)threads : 1;
}

unsigned ordered_slots(unsigned threads) { return threads > 1 ? 2 * threads : 1; }

static void *slot_of(const runner *r, size_t piece)
{
    return r->slots + piece % r->count * r->slot_size;
}

static void put_done(runner *r)
{
    while (r->put < r->taken && r->is_done[r->put % r->count]) {
        if (!r->is_stopped && !r->work->put(r->work->user, slot_of(r, r->put)))
            r->is_ended = r->is_stopped = 1;
        r->is_done[r->put++ % r->count] = 0;
        platform_lock_wake(r->lock);
    }
}

static void run(void *arg)
{
    runner *r = arg;
    platform_lock_enter(r->lock);
    while (!r->is_ended) {
        size_t piece = r->taken;
        if (piece - r->put == r->count) {
            platform_lock_wait(r->lock);
            continue;
        }
        if (!r->work->take(r->work->user, slot_of(r, piece))) {
            r->is_ended = 1;
            platform_lock_wake(r->lock);
            break;
        }
        r->taken++;
        platform_lock_leave(r->lock);
        r->work->work(r->work->user, slot_of(r, piece));
        platform_lock_enter(r->lock);
        r->is_done[piece % r->count] = 1;
        put_done(r);
    }
    platform_lock_leave(r->lock);
}

void ordered_run(const ordered_work *work, void *slots, size_t slot_size, unsigned threads,
                 platform_lock *lock)
{
    platform_thread *others[ORDERED_MAX_THREADS];
    unsigned started = 0;
    runner r;
    memset(&r, 0, sizeof r);
    r.work = work;
    r.slots = slots;
    r.slot_size = slot_size;
    r.lock = lock;
    r.count = ordered_slots(lock ? threads : 1);
    while (lock && started + 1 < threads &&
           (others[started] = platform_thread_start(run, &r)) != NULL)
        started++;
    run(&r);
    while (started)
        platform_thread_join(others[--started]);
}
