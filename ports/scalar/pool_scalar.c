#include "port_scalar.h"

#define DEFINE_POOL(name, type)                                                                \
    void name(type *out, const type *above, const type *below, unsigned channels,              \
              unsigned pixels)                                                                 \
    {                                                                                          \
        for (unsigned p = 0; p < pixels; p++) {                                                \
            for (unsigned c = 0; c < channels; c++) {                                          \
                type a = above[c] > above[channels + c] ? above[c] : above[channels + c];      \
                type b = below[c] > below[channels + c] ? below[c] : below[channels + c];      \
                out[c] = a > b ? a : b;                                                        \
            }                                                                                  \
            out += channels, above += 2 * channels, below += 2 * channels;                     \
        }                                                                                      \
    }

DEFINE_POOL(lull_pool_f32_scalar, float)
DEFINE_POOL(lull_pool_u8_scalar, uint8_t)
