/* What integer convolutions to three outputs share: for conv_int3_256.h and conv_int3_512.h. */

typedef __m128i four; /* the sums of a pixel's outputs, and 0 */

/* Adds the products of a pixel's vector at `at` with the three outputs' weights v0, v1, v2. */
#define INT3_DOTS(DOT, i, at)  \
    value = load(at);          \
    DOT(a##i, value, v0);      \
    DOT(b##i, value, v1);      \
    DOT(c##i, value, v2);
#define INT3_NARROW(i, base, offset) INT3_DOTS(DOT_NARROW, i, (base) + (offset))
#define INT3_WIDE(i, base, offset) INT3_DOTS(DOT_WIDE, i, (base) + (offset))

/* The last dwords of a run, those that do not fill a vector. */
static four int3_rest(const lull_segment *segment, unsigned size, unsigned p)
{
    unsigned first = segment->length / LANES * LANES;
    const uint8_t *x = (const uint8_t *)segment->row + size * (size_t)p * segment->step;
    const uint8_t *w = (const uint8_t *)segment->weights;
    int32_t sum[3] = {0, 0, 0};
    for (unsigned k = 4 * first; k < 4 * segment->length; k += size)
        for (unsigned o = 0; o < 3; o++) {
            const uint8_t *weight = w + o * (size_t)4 * segment->length + k;
            uint16_t element = x[k];
            int16_t wide;
            if (size == 2) {
                memcpy(&element, x + k, sizeof element);
                memcpy(&wide, weight, sizeof wide);
            } else {
                wide = (int8_t)*weight;
            }
            sum[o] += element * wide;
        }
    return _mm_setr_epi32(sum[0], sum[1], sum[2], 0);
}
