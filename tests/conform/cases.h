/* Random convolutions for the conformance tests: logical weights and descriptors, laid out for
 * a block size in guarded memory. */
#ifndef LULL_TESTS_CASES_H
#define LULL_TESTS_CASES_H

#include "kernels.h"

/* What the values look like. */
typedef enum cases_pattern {
    CASES_RANDOM,
    CASES_MIN,         /* every value the smallest */
    CASES_MAX,         /* every value the largest */
    CASES_ALTERNATING, /* largest and smallest in turn */
    CASES_PAIRS,       /* integers: pair sums at their bounds; floats: of very different size */
    CASES_PATTERNS
} cases_pattern;

extern const char *const cases_names[CASES_PATTERNS];

/* What convolutions look like. */
typedef enum cases_kind {
    CASES_ANY,
    CASES_LAYER, /* integers: narrow, small sums of runs of 2 or 3 columns, as most layers are */
    CASES_WORDS, /* the same of 1 to 4 columns, whose runs fit words; if not random, weights are at
                  * the bounds and codes 255: min and max on one pair of taps, alternating of one
                  * sign first and then of the other, pairs spread over all */
    CASES_HEAD   /* the same of one run of 2 to LULL_HEAD_RUN dwords, outputs of bytes */
} cases_kind;

#define CASES_MAX_OUTPUTS 200u
#define CASES_MAX_ELEMENTS 256u

typedef struct cases_conv {
    lull_conv conv;                           /* rows and sizes; weights are not set */
    unsigned elements[LULL_MAX_SEGMENTS];     /* of a run; beyond them weights are zero */
    int is_integer, at_end;
    int has_start; /* may be set after cases_make: the bias differs from pixel to pixel */
} cases_conv;

/* Makes a case: sizes as given, the rest at random; fills its rows. */
void cases_make(cases_conv *c, int is_integer, cases_pattern pattern, unsigned outputs,
                unsigned pixels, cases_kind kind);

/* Sets weights, bias and multiplier in the layout for blocks of `block` outputs; is_split: as for a
 * table with splits_wide. */
void cases_pack(cases_conv *c, unsigned block, int is_split);

/* Weight of output o on element e of segment s. */
float cases_weight(unsigned s, unsigned o, unsigned e);

/* Bytes that the outputs of the case span: from the first to the last element written. */
size_t cases_out_bytes(const cases_conv *c);

/* The definition in kernels.h, computed the plain way. Float results go to value[p * outputs +
 * o] and the sums of |products| to size[...]; integer results to value alone. */
void cases_define(const cases_conv *c, double *value, double *size);

#endif
