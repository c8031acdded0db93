#include "port_scalar.h"

void lull_filter5_scalar(float *out, const float *const *rows, const uint8_t *codes,
                         size_t code_step, const float *table, unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++, out += 4, codes += code_step) {
        float a = 0, b = 0, c = 0, d = 0;
        const uint8_t *q = codes;
        for (unsigned y = 0; y < 5; y++) {
            const float *v = rows[y] + 4 * (ptrdiff_t)p - 8;
            for (unsigned x = 0; x < 5; x++, v += 4) {
                float w = table[*q++];
                a += w * v[0];
                b += w * v[1];
                c += w * v[2];
                d += w * v[3];
            }
        }
        out[0] = a > 0.0f ? b / a : 0.0f;
        out[1] = a > 0.0f ? c / a : 0.0f;
        out[2] = a > 0.0f ? d / a : 0.0f;
        out[3] = a;
    }
}
