/* 2x2 maximum: the two pixels of a pair are neighbours, so a vector of channels is the maximum
 * of four loads. What is left of them is done in plain C. */
#include <arm_neon.h>

#include "port_neon.h"

void lull_pool_f32_neon(float *out, const float *above, const float *below, unsigned channels,
                        unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 4 <= channels; c += 4) {
            float32x4_t a = vmaxq_f32(vld1q_f32(above + c), vld1q_f32(above + channels + c));
            float32x4_t b = vmaxq_f32(vld1q_f32(below + c), vld1q_f32(below + channels + c));
            vst1q_f32(out + c, vmaxq_f32(a, b));
        }
        for (; c < channels; c++) {
            float a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            float b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}

void lull_pool_u8_neon(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
                       unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 16 <= channels; c += 16) {
            uint8x16_t a = vmaxq_u8(vld1q_u8(above + c), vld1q_u8(above + channels + c));
            uint8x16_t b = vmaxq_u8(vld1q_u8(below + c), vld1q_u8(below + channels + c));
            vst1q_u8(out + c, vmaxq_u8(a, b));
        }
        for (; c + 8 <= channels; c += 8) {
            uint8x8_t a = vmax_u8(vld1_u8(above + c), vld1_u8(above + channels + c));
            uint8x8_t b = vmax_u8(vld1_u8(below + c), vld1_u8(below + channels + c));
            vst1_u8(out + c, vmax_u8(a, b));
        }
        for (; c < channels; c++) {
            uint8_t a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            uint8_t b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}
