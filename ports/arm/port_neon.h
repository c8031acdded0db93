#ifndef LULL_PORT_NEON_H
#define LULL_PORT_NEON_H

#include "kernels.h"

#if !defined(__ARM_NEON)
#error "this file is compiled with NEON: -mfpu=neon on 32-bit ARM"
#endif

void lull_conv_f32_neon(const lull_conv *conv);
void lull_conv_int_neon(const lull_conv *conv);
void lull_pool_f32_neon(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels);
void lull_pool_u8_neon(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels);
void lull_filter5_neon(const lull_window *window);

#endif
