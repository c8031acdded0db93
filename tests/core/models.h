/* What the tests of the native API begin with: memory, and models of weights files. Paths are from
 * the top of the tree. The including file defines _POSIX_C_SOURCE. */
#ifndef LULL_TESTS_CORE_MODELS_H
#define LULL_TESTS_CORE_MODELS_H

#include <stdlib.h>

#include "check.h"
#include "lull.h"

/* NULL if there is none; to be freed. */
static inline void *aligned(size_t bytes)
{
    void *p = NULL;
    return posix_memalign(&p, LULL_ALIGN, bytes ? bytes : 1) ? NULL : p;
}

/* The model of a file of up to a MiB; to be freed. */
static inline lull_model *load_model(const char *path)
{
    FILE *file = fopen(path, "rb");
    lull_model *model = NULL;
    size_t bytes, model_bytes;
    void *data = malloc(1 << 20), *memory;
    if (!CHECK(file != NULL))
        exit(1);
    bytes = fread(data, 1, 1 << 20, file);
    fclose(file);
    model_bytes = lull_model_size(data, bytes, LULL_PORTS_ALL);
    memory = aligned(model_bytes);
    CHECK_EQ(lull_model_init(&model, memory, model_bytes, data, bytes, LULL_PORTS_ALL), LULL_OK);
    free(data);
    return model;
}

#endif
