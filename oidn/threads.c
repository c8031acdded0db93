/* The team of threads. See threads.h.
 *
 * Each thread has a range of a loop's indices, so that loops over the same things in the same order
 * find them in its caches; when it has done with its own it helps with the others'. A range is
 * published as one atomic word, end << 16 | next. Taking an index is one fetch-and-add on it: the
 * word that comes back says whether the index is one of a running loop, and as long as that index
 * is not finished the owner cannot go on, so body and context are stable. */
#include "threads.h"

#define SPIN_NS 500000u  /* how long to look for work before sleeping: some tasks of a layer */
#define LOOP_MAX 0x7fffu /* indices published at once; longer loops run in pieces */
#define WORKER_STACK ((size_t)256 << 10)
#define APART 128u /* bytes between words that different threads write often */

typedef struct worker {
    lull_atomic range; /* end << 16 | next */
    struct lull_pool *pool;
    unsigned index;
    int cpu; /* to pin to, or -1 */
    lull_thread thread;
    char apart[APART];
} worker;

struct lull_pool {
    lull_atomic loop;     /* number of the last loop that was published */
    lull_atomic active;   /* between enter and leave */
    lull_atomic sleepers; /* threads waiting for `work` */
    lull_atomic waiting;  /* the owner waits for `finished` */
    lull_atomic stop;

    void (*body)(void *context, unsigned index, unsigned worker);
    void *context;
    unsigned base;  /* added to indices: start of the piece */
    unsigned count; /* indices of the piece */

    lull_mutex mutex;
    lull_cond work, finished;
    unsigned spin_ns;
    int owner_cpu;            /* to pin the owner to, or -1 */
    unsigned wanted, started; /* threads besides the owner */
    worker *workers;          /* the owner is the first */

    char apart[APART];
    lull_atomic done; /* finished indices of the loop */
};

/* Takes indices of a worker's range until there are none; returns how many it took. Others' ranges
 * are looked at first: taking from them costs their owners time. */
static unsigned run_range(lull_pool *pool, unsigned owner, unsigned worker_index)
{
    lull_atomic *range = &pool->workers[owner].range;
    unsigned taken = 0;

    for (;; taken++) {
        uint32_t r = owner == worker_index ? 1u << 16 : lull_atomic_load(range);

        if ((r & 0xffffu) < r >> 16)
            r = lull_atomic_add(range, 1);
        if ((r & 0xffffu) >= r >> 16)
            return taken;
        pool->body(pool->context, pool->base + (r & 0xffffu), worker_index);
    }
}

/* The worker's own range, then what is left of the others'. */
static void run_indices(lull_pool *pool, unsigned worker_index)
{
    const unsigned ranges = pool->wanted + 1;
    unsigned i, taken = 0, count;

    for (i = 0; i < ranges; i++)
        taken += run_range(pool, (worker_index + i) % ranges, worker_index);
    if (!taken)
        return;
    count = pool->count; /* of the loop that waits for these */
    if (lull_atomic_add(&pool->done, taken) + taken == count && lull_atomic_load(&pool->waiting)) {
        lull_mutex_lock(&pool->mutex);
        lull_cond_signal(&pool->finished);
        lull_mutex_unlock(&pool->mutex);
    }
}

/* Waits for a loop after number `seen` a little while. */
static void spin_for_work(const lull_pool *pool, uint32_t seen)
{
    const uint64_t end = lull_clock_ns() + pool->spin_ns;
    int i;

    while (lull_atomic_load(&pool->active) && lull_clock_ns() < end)
        for (i = 0; i < 32; i++) {
            if (lull_atomic_load(&pool->loop) != seen)
                return;
            lull_cpu_relax();
        }
}

static void worker_main(void *arg)
{
    worker *w = arg;
    lull_pool *pool = w->pool;

    if (w->cpu >= 0)
        lull_thread_pin(w->cpu);
    while (!lull_atomic_load(&pool->stop)) {
        const uint32_t seen = lull_atomic_load(&pool->loop);

        run_indices(pool, w->index);
        if (pool->spin_ns)
            spin_for_work(pool, seen);
        if (lull_atomic_load(&pool->loop) != seen)
            continue;
        lull_mutex_lock(&pool->mutex);
        lull_atomic_add(&pool->sleepers, 1);
        while (lull_atomic_load(&pool->loop) == seen && !lull_atomic_load(&pool->stop))
            lull_cond_wait(&pool->work, &pool->mutex);
        lull_atomic_add(&pool->sleepers, (uint32_t)-1);
        lull_mutex_unlock(&pool->mutex);
    }
}

static void start_workers(lull_pool *pool)
{
    lull_mutex_init(&pool->mutex);
    lull_cond_init(&pool->work);
    lull_cond_init(&pool->finished);
    for (pool->started = 0; pool->started < pool->wanted; pool->started++) {
        worker *w = &pool->workers[pool->started + 1];

        if (!lull_thread_start(&w->thread, WORKER_STACK, worker_main, w))
            break;
    }
}

lull_pool *lull_pool_new(unsigned threads, int pin, const lull_cpus *cpus)
{
    lull_pool *pool = lull_os_alloc_zero(sizeof *pool);
    unsigned i;

    if (!pool)
        return NULL;
    pool->owner_cpu = pin ? cpus->cpu[0] : -1;
    pool->spin_ns = threads <= cpus->available ? SPIN_NS : 0;
    pool->wanted = threads - 1;
    pool->workers = lull_os_alloc_zero(threads * sizeof *pool->workers);
    if (!pool->workers) {
        lull_os_free(pool);
        return NULL;
    }
    for (i = 0; i < threads; i++) {
        pool->workers[i].pool = pool;
        pool->workers[i].index = i;
        pool->workers[i].cpu = pin ? cpus->cpu[i] : -1;
    }
    start_workers(pool);
    return pool;
}

void lull_pool_free(lull_pool *pool)
{
    unsigned i;

    if (!pool)
        return;
    lull_mutex_lock(&pool->mutex);
    lull_atomic_store(&pool->stop, 1);
    lull_cond_broadcast(&pool->work);
    lull_mutex_unlock(&pool->mutex);
    for (i = 1; i <= pool->started; i++)
        lull_thread_join(&pool->workers[i].thread);
    lull_cond_destroy(&pool->finished);
    lull_cond_destroy(&pool->work);
    lull_mutex_destroy(&pool->mutex);
    lull_os_free(pool->workers);
    lull_os_free(pool);
}

unsigned lull_pool_size(const lull_pool *pool) { return pool->started + 1; }

void lull_pool_enter(lull_pool *pool)
{
    if (pool->owner_cpu >= 0) {
        lull_thread_pin(pool->owner_cpu);
        pool->owner_cpu = -1;
    }
    lull_atomic_store(&pool->active, 1);
}

void lull_pool_leave(lull_pool *pool) { lull_atomic_store(&pool->active, 0); }

/* Wakes as many sleepers as there are indices for them. */
static void wake(lull_pool *pool, unsigned count)
{
    const unsigned sleepers = lull_atomic_load(&pool->sleepers);
    unsigned i;

    if (!sleepers)
        return;
    lull_mutex_lock(&pool->mutex);
    if (count - 1 >= sleepers)
        lull_cond_broadcast(&pool->work);
    else
        for (i = 1; i < count; i++)
            lull_cond_signal(&pool->work);
    lull_mutex_unlock(&pool->mutex);
}

/* Waits until the taken indices are finished: awake first, then asleep. */
static void wait_finished(lull_pool *pool, unsigned count)
{
    const uint64_t end = lull_clock_ns() + pool->spin_ns;

    do {
        if (lull_atomic_load(&pool->done) == count)
            return;
        lull_cpu_relax();
    } while (lull_clock_ns() < end);

    lull_mutex_lock(&pool->mutex);
    lull_atomic_store(&pool->waiting, 1);
    while (lull_atomic_load(&pool->done) != count)
        lull_cond_wait(&pool->finished, &pool->mutex);
    lull_atomic_store(&pool->waiting, 0);
    lull_mutex_unlock(&pool->mutex);
}

/* Shares `count` indices among the threads. */
static void publish(lull_pool *pool, unsigned count)
{
    const uint32_t ranges = pool->wanted + 1;
    uint32_t i, first = 0;

    pool->count = count;
    lull_atomic_release(&pool->done, 0);
    for (i = 0; i < ranges; i++) {
        const uint32_t end = count / ranges * (i + 1) + count % ranges * (i + 1) / ranges;

        lull_atomic_release(&pool->workers[i].range, end << 16 | first);
        first = end;
    }
    lull_atomic_add(&pool->loop, 1);
}

void lull_pool_for(void *opaque, unsigned count,
                   void (*body)(void *context, unsigned index, unsigned worker), void *context)
{
    lull_pool *pool = opaque;
    unsigned i;

    if (!pool->started || count == 1) {
        for (i = 0; i < count; i++)
            body(context, i, 0);
        return;
    }
    for (pool->base = 0; count; pool->base += i, count -= i) {
        i = count < LOOP_MAX ? count : LOOP_MAX;
        pool->body = body;
        pool->context = context;
        publish(pool, i);
        wake(pool, i);
        run_indices(pool, 0);
        wait_finished(pool, i);
    }
}

void lull_pool_restart(lull_pool *pool, int start)
{
    unsigned i;

    if (!start)
        pool->wanted = 0;
    for (i = 0; i <= pool->wanted; i++)
        lull_atomic_store(&pool->workers[i].range, 0);
    lull_atomic_store(&pool->sleepers, 0);
    lull_atomic_store(&pool->waiting, 0);
    lull_atomic_store(&pool->active, 0);
    start_workers(pool);
}
