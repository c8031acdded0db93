/* Shared by the tests that let work run in the background. Define _GNU_SOURCE (usleep) before the
 * first header. */
#ifndef LULL_TESTS_THREADS_H
#define LULL_TESTS_THREADS_H

#include <stdbool.h>
#include <unistd.h>

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 1
#endif

/* A progress function: work that is not over soon. */
static inline bool take_time(void *user, double n)
{
    (void)user;
    if (n == 0)
        usleep(50000);
    return true;
}

#if LULL_WITH_THREADS

#include <pthread.h>

/* What one thread opens and others wait for: GATE_CLOSED at first. */
typedef struct gate {
    pthread_mutex_t mutex;
    bool open;
} gate;

#define GATE_CLOSED {PTHREAD_MUTEX_INITIALIZER, false}

static inline void open_gate(gate *g)
{
    pthread_mutex_lock(&g->mutex);
    g->open = true;
    pthread_mutex_unlock(&g->mutex);
}

static inline bool is_open(gate *g)
{
    bool open;

    pthread_mutex_lock(&g->mutex);
    open = g->open;
    pthread_mutex_unlock(&g->mutex);
    return open;
}

#endif
#endif
