/* The thread that does asynchronous work, one per device. Filters run here, as worker 0 of the
 * pool. */
#include "internal.h"

static void drop_references(lull_job *job)
{
    unsigned i;

    for (i = 0; i < sizeof job->buffers / sizeof *job->buffers; i++)
        lull_buffer_drop(job->buffers[i]);
    if (job->filter)
        lull_filter_drop(job->filter);
}

/* Runs the job at the head of the queue. The mutex is held before and after. */
static void run_one(lull_queue *queue)
{
    lull_job *job = &queue->jobs[queue->head % LULL_QUEUE_SIZE];
    lull_fault fault;

    queue->running = true;
    lull_mutex_unlock(&queue->mutex);
    fault.code = OIDN_ERROR_NONE;
    job->run(job, &fault);
    drop_references(job);
    lull_mutex_lock(&queue->mutex);
    queue->running = false;
    if (fault.code != OIDN_ERROR_NONE && queue->fault.code == OIDN_ERROR_NONE)
        queue->fault = fault;
    queue->head++;
    lull_cond_broadcast(&queue->finished);
}

static void queue_main(void *arg)
{
    OIDNDevice device = arg;
    lull_queue *queue = &device->queue;
    bool abandoned;

    lull_mutex_lock(&queue->mutex);
    for (;;) {
        while (queue->head == queue->tail && !queue->stop && !queue->abandoned)
            lull_cond_wait(&queue->submitted, &queue->mutex);
        if (queue->head == queue->tail)
            break;
        run_one(queue);
    }
    abandoned = queue->abandoned;
    lull_mutex_unlock(&queue->mutex);
    if (abandoned)
        lull_device_destroy(device);
}

bool lull_queue_start(OIDNDevice device)
{
    lull_queue *queue = &device->queue;

    lull_mutex_init(&queue->mutex);
    lull_cond_init(&queue->submitted);
    lull_cond_init(&queue->finished);
    queue->process = lull_process_id();
    queue->started = lull_thread_start(&queue->thread, 0, queue_main, device) != 0;
    return queue->started || !LULL_WITH_THREADS;
}

bool lull_queue_is_self(const lull_queue *queue)
{
#if LULL_WITH_THREADS
    return queue->started && lull_thread_is_self(&queue->thread);
#else
    return queue->running;
#endif
}

void lull_queue_stop(OIDNDevice device)
{
    lull_queue *queue = &device->queue;

    if (queue->process != lull_process_id()) { /* a forked child: there is no thread to stop */
        lull_pool_restart(device->pool, 0);
        return;
    }
    if (lull_queue_is_self(queue)) {
        lull_thread_detach(&queue->thread);
    } else if (queue->started) {
        lull_mutex_lock(&queue->mutex);
        queue->stop = true;
        lull_cond_signal(&queue->submitted);
        lull_mutex_unlock(&queue->mutex);
        lull_thread_join(&queue->thread);
    }
    lull_cond_destroy(&queue->finished);
    lull_cond_destroy(&queue->submitted);
    lull_mutex_destroy(&queue->mutex);
}

/* Waits until `number` jobs are done. */
static void wait_for(lull_queue *queue, uint64_t number)
{
    lull_mutex_lock(&queue->mutex);
    while (queue->head < number)
        lull_cond_wait(&queue->finished, &queue->mutex);
    lull_mutex_unlock(&queue->mutex);
}

static uint64_t finished_jobs(lull_queue *queue)
{
    uint64_t n;

    lull_mutex_lock(&queue->mutex);
    n = queue->head;
    lull_mutex_unlock(&queue->mutex);
    return n;
}

/* What was queued before a fork is the parent's: its child never does it, and may have the mutex
 * locked. */
bool lull_queue_is_done(OIDNDevice device, uint64_t number)
{
    lull_queue *queue = &device->queue;

    return !device->committed || queue->process != lull_process_id() ||
           number <= finished_jobs(queue);
}

bool lull_queue_wait(OIDNDevice device, uint64_t number, lull_fault *fault)
{
    if (lull_queue_is_done(device, number))
        return true;
    if (lull_queue_is_self(&device->queue))
        return lull_fail(fault, OIDN_ERROR_INVALID_OPERATION,
                         "a progress function cannot wait for the work that it belongs to");
    lull_mutex_unlock(&device->lock);
    wait_for(&device->queue, number);
    lull_mutex_lock(&device->lock);
    return true;
}

bool lull_queue_reserve(OIDNDevice device, lull_fault *fault)
{
    lull_queue *queue = &device->queue;

    if (!device->committed)
        return true;
    if (queue->process != lull_process_id()) {
        lull_pool_restart(device->pool, 1);
        queue->head = queue->tail;
        if (!lull_queue_start(device))
            return lull_fail(fault, OIDN_ERROR_OUT_OF_MEMORY, "cannot start a thread");
    }
    while (queue->tail - finished_jobs(queue) >= LULL_QUEUE_SIZE)
        if (!lull_queue_wait(device, queue->tail + 1 - LULL_QUEUE_SIZE, fault))
            return false;
    return true;
}

uint64_t lull_queue_submit(OIDNDevice device, const lull_job *job)
{
    lull_queue *queue = &device->queue;
    uint64_t number;

    lull_mutex_lock(&queue->mutex);
    queue->jobs[queue->tail % LULL_QUEUE_SIZE] = *job;
    number = ++queue->tail;
    if (queue->started)
        lull_cond_signal(&queue->submitted);
    else if (!queue->running)
        while (queue->head != queue->tail)
            run_one(queue);
    lull_mutex_unlock(&queue->mutex);
    return number;
}

bool lull_queue_sync(OIDNDevice device, lull_fault *fault)
{
    return lull_queue_wait(device, device->queue.tail, fault) &&
           lull_queue_take_fault(device, fault);
}

void lull_queue_finish(OIDNDevice device)
{
    lull_fault ignored = {OIDN_ERROR_NONE, ""};

    lull_queue_wait(device, device->queue.tail, &ignored);
}

bool lull_queue_take_fault(OIDNDevice device, lull_fault *fault)
{
    lull_queue *queue = &device->queue;

    lull_mutex_lock(&queue->mutex);
    if (queue->fault.code != OIDN_ERROR_NONE)
        lull_fail(fault, queue->fault.code, "%s", queue->fault.text);
    queue->fault.code = OIDN_ERROR_NONE;
    lull_mutex_unlock(&queue->mutex);
    return fault->code == OIDN_ERROR_NONE;
}
