/* Weights of a network that returns its main image unchanged: a U-Net whose only nonzero weights
 * carry the raw input through the last skip. Exact up to transfer functions, so tests can tell what
 * an execution did without trained weights. */
#ifndef LULL_TESTS_IDENTITY_H
#define LULL_TESTS_IDENTITY_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A TZA file (fp16) for `inputs` (3, 6 or 9) input channels and `width` (3 to 64) channels
 * everywhere else; `large` is the topology with an overlap of 112. malloc'ed, or NULL. */
void *identity_weights(unsigned inputs, unsigned width, int large, size_t *bytes);

#ifdef __cplusplus
}
#endif

#endif
