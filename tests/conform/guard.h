/* Buffers with inaccessible pages on both sides, and random numbers. */
#ifndef LULL_TESTS_GUARD_H
#define LULL_TESTS_GUARD_H

#include "kernels.h"

/* Which buffer: a segment's row or weights (add the segment's number), or another part of a
 * call. */
enum {
    GUARD_ROW = 0,
    GUARD_WEIGHTS = GUARD_ROW + LULL_MAX_SEGMENTS,
    GUARD_BIAS = GUARD_WEIGHTS + LULL_MAX_SEGMENTS,
    GUARD_MULTIPLIER,
    GUARD_START,
    GUARD_ROOM,
    GUARD_OUT,
    GUARD_COUNT
};

/* 1 if stray accesses really fault (POSIX), 0 if buffers are ordinary memory. Exits if out of
 * memory. */
int guard_init(void);

/* A buffer of exactly `bytes` (1 MiB at most): its end (at_end) or its start is next to a page
 * that no one may touch. Valid until the buffer is placed again. */
void *guard_place(unsigned buffer, size_t bytes, int at_end);

/* What a stray access is reported as, before the program ends with status 1. */
extern char guard_case[160];

/* Deterministic random numbers: below n (> 0), and in [low, high]. */
void guard_seed(uint64_t seed);
uint32_t guard_below(uint32_t n);
int32_t guard_between(int32_t low, int32_t high);

#endif
