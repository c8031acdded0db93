/* A team of threads that runs loops. One thread at a time, the owner, gives it work and takes part
 * as worker 0; the others sleep while there is none.
 *
 * The owner never waits for a thread that is slow to wake: threads join a loop when they come, and
 * the owner waits only for indices that have been taken. */
#ifndef LULL_OIDN_THREADS_H
#define LULL_OIDN_THREADS_H

#include "os.h"

typedef struct lull_pool lull_pool;

/* Starts `threads - 1` threads; `pin`: binds each to one of cpus->cpu (the owner binds itself with
 * lull_pool_enter). Fewer threads than asked for may start. NULL if memory is short. */
lull_pool *lull_pool_new(unsigned threads, int pin, const lull_cpus *cpus);

/* Stops the threads and frees the pool. NULL is allowed. */
void lull_pool_free(lull_pool *pool);

/* Workers, the owner included: indices below this go to the bodies of loops. */
unsigned lull_pool_size(const lull_pool *pool);

/* Brackets a run of loops: between enter and leave, idle threads spin for some tens of microseconds
 * before they sleep, so that the next loop finds them awake. */
void lull_pool_enter(lull_pool *pool);
void lull_pool_leave(lull_pool *pool);

/* Runs body(context, index, worker) once for each index below count; has the signature of
 * lull_host.parallel_for, `pool` being a lull_pool. Returns when all are done. */
void lull_pool_for(void *pool, unsigned count,
                   void (*body)(void *context, unsigned index, unsigned worker), void *context);

/* In a forked child, where the threads of the parent do not exist: starts as many anew, or none. */
void lull_pool_restart(lull_pool *pool, int start);

#endif
