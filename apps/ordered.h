/* Work whose pieces come and go in order, one at a time, and are done by several threads in
 * between: chunks of a file. */
#ifndef LULL_APPS_ORDERED_H
#define LULL_APPS_ORDERED_H

#include <stddef.h>

#include "platform.h"

#define ORDERED_MAX_THREADS 64
#define ORDERED_FEW_THREADS 8 /* unless more are asked for: each takes the memory of two pieces */

/* A slot holds a piece, and what working on it needs; it is used for one piece after the other. */
typedef struct ordered_work {
    void *user;
    int (*take)(void *user, void *slot);  /* fetches the next piece; 0: there is none */
    void (*work)(void *user, void *slot); /* at the same time as others, in any order */
    int (*put)(void *user, void *slot);   /* in the order of take; 0: go no further */
} ordered_work;

/* Threads for so many pieces: `wanted` (0: as many as there are processors, but few), with two
 * pieces each at least. */
unsigned ordered_threads(int wanted, int pieces);

/* Slots for so many threads: one, or two for each. */
unsigned ordered_slots(unsigned threads);

/* Does all pieces, up to the one whose `put` returns 0; later ones may have been worked on by then.
 * The calling thread is one of the threads; if others cannot be had, fewer do it. take and put are
 * called with the lock held, which is for a `work` that must be alone, too; NULL: one thread. */
void ordered_run(const ordered_work *work, void *slots, size_t slot_size, unsigned threads,
                 platform_lock *lock);

#endif
