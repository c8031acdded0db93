/* Conformance of ports: each slot that a port fills, against the scalar port; the scalar port
 * against the definition in kernels.h. Slots come from kernels.def. */
#ifndef LULL_TESTS_CONFORM_H
#define LULL_TESTS_CONFORM_H

#include "kernels.h"

typedef struct conform_slot {
    const char *name;
    float tolerance;
    int (*fills)(const lull_kernels *a, const lull_kernels *b); /* 1 if the slot differs */
    /* One counted test per pattern; is_scalar: `port` is the scalar port. */
    void (*test)(const char *port_name, const lull_kernels *port, int is_scalar, float tolerance);
} conform_slot;

extern const conform_slot conform_slots[];
extern const unsigned conform_slot_count;

/* Tests all slots that `fill` sets beyond those of the scalar port, whether or not halves of
 * vectors pay (lull_cpu_halves_pay); fails if there is none. Prints a line for each slot and
 * pattern. */
void conform_port(const char *name, void (*fill)(lull_kernels *));

/* One row of the table in docs/ports.md: the port, its slots, where and when it ran, that machine's
 * flags. `where`: NULL for this CPU itself. */
void conform_row(const char *name, void (*fill)(lull_kernels *), const char *where);

/* Counts a port that cannot run here as a skipped test. */
void conform_skip(const char *name, const char *reason);

int conform_report(void);

#endif
