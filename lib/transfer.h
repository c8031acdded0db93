/* Transfer functions between radiance and network values, and the elementary functions below
 * them. All are sequences of IEEE 754 single operations in a fixed order, without contraction,
 * so every conforming CPU gives the same bits, also when the caller's thread flushes subnormals
 * to zero: arguments below FLT_MIN are read as 0 and results up to FLT_MIN are 0. Relative error
 * of every curve over its whole domain below 1e-6 (measured: 4.6e-7). Formulas and constants:
 * Open Image Denoise's curves; method: docs/arithmetic.md. Stateless; from any thread. */
#ifndef LULL_TRANSFER_H
#define LULL_TRANSFER_H

#include "base.h"

typedef enum lull_transfer {
    LULL_TRANSFER_LINEAR,
    LULL_TRANSFER_SRGB,
    LULL_TRANSFER_PU,  /* perceptually uniform (Aydin 2008 fit), normalised to f(65504) = 1 */
    LULL_TRANSFER_LOG, /* ln(y + 1), normalised to f(65504) = 1 */
    LULL_TRANSFER_COUNT
} lull_transfer;

/* values[0..n) in place: y in [0, FLT_MAX] to network values in [0, f(FLT_MAX)]; any address. */
void lull_transfer_forward(lull_transfer transfer, float *values, size_t n);

/* values[0..n) in place: x in [0, FLT_MAX] to radiance; overflows to +infinity. */
void lull_transfer_inverse(lull_transfer transfer, float *values, size_t n);

/* Base-2 logarithm of a finite x; x < FLT_MIN is read as FLT_MIN. Absolute error < 2e-7 + 2 ulp. */
float lull_log2(float x);
/* 2^x for any finite x; 0 below -126, +infinity from 128; relative error < 3e-7. */
float lull_exp2(float x);

#endif
