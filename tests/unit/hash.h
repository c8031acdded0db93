/* Fingerprints of results, equal on every CPU: FNV-1a over the bit patterns, low byte first. */
#ifndef LULL_TESTS_HASH_H
#define LULL_TESTS_HASH_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define HASH_START UINT64_C(0xcbf29ce484222325)

static inline uint64_t hash_floats(uint64_t hash, const float *values, size_t n)
{
    size_t i;
    for (i = 0; i < n; ++i) {
        uint32_t bits, byte;
        memcpy(&bits, values + i, sizeof bits);
        for (byte = 0; byte < 4; ++byte)
            hash = (hash ^ (bits >> 8 * byte & 0xffu)) * UINT64_C(0x100000001b3);
    }
    return hash;
}

/* Reproducible random numbers (xorshift32): 32 bits, and floats in [0, 1). */
static inline uint32_t random_bits(uint32_t *state)
{
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state;
}

static inline float random_float(uint32_t *state)
{
    return (float)(random_bits(state) >> 8) * (1.0f / 16777216.0f);
}

#endif
