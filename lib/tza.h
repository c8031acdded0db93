/* Reader of TZA weight files (little endian; layout in docs/design.md and docs/arithmetic.md).
 * Works on the caller's bytes in place, copies and allocates nothing, and never reads outside
 * them. */
#ifndef LULL_TZA_H
#define LULL_TZA_H

#include "base.h"

typedef struct lull_tza {
    const uint8_t *bytes;
    size_t size;
    size_t table; /* offset of the first table entry */
    unsigned count;
} lull_tza;

typedef struct lull_tza_tensor {
    const char *name; /* not NUL-terminated; inside the file */
    size_t name_length;
    const uint8_t *data; /* row-major in layout order, little endian, any alignment */
    size_t bytes;
    unsigned rank;
    uint32_t dims[4];
    char layout[4]; /* "oihw" or "x" */
    char dtype;     /* 'f' fp32, 'h' fp16, 'b' int8, 'B' uint8, 'i' int32 */
} lull_tza_tensor;

/* Opens a file and validates all of its table: magic, version, entries inside the file, payloads
 * inside the file, no overflow, no zero dimension, rank 1..4, known layouts and types, no
 * duplicate names. Errors: WEIGHTS, VERSION. On error *tza is unusable. */
lull_status lull_tza_open(lull_tza *tza, const void *bytes, size_t size);

/* The tensor called `prefix` followed by `suffix` (e.g. "enc_conv0", ".weight"; NUL-terminated
 * both). Returns 1 and fills *tensor, or returns 0. */
int lull_tza_find(const lull_tza *tza, const char *prefix, const char *suffix,
                  lull_tza_tensor *tensor);

/* Element `index` of a tensor as float (types f, h, b, B, i). The index must be inside. */
float lull_tza_float(const lull_tza_tensor *tensor, size_t index);

/* Element `index` of a tensor of type i. */
int32_t lull_tza_int(const lull_tza_tensor *tensor, size_t index);

#endif
