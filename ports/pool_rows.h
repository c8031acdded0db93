/* 2x2 maximum: the two pixels of a pair are neighbours, so a vector of channels is the maximum of
 * four loads. What is left of them is done in plain C. Included once by the file of a port, which
 * defines POOL_F32 and POOL_U8 (the functions' names) and
 *
 *   floats, LANES, load_floats(p), store_floats(p, v), most_floats(a, b)
 *                                   a vector of LANES floats; most: a > b ? a : b
 *   codes, load_16(p), store_16(p, v), load_8(p), store_8(p, v), most_codes(a, b)
 *                                   a vector of 16 bytes, and the first half of it
 */
void POOL_F32(float *out, const float *above, const float *below, unsigned channels,
              unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + LANES <= channels; c += LANES) {
            floats a = most_floats(load_floats(above + c), load_floats(above + channels + c));
            floats b = most_floats(load_floats(below + c), load_floats(below + channels + c));
            store_floats(out + c, most_floats(a, b));
        }
        for (; c < channels; c++) {
            float a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            float b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}

LULL_INLINE codes most_of_4(codes a, codes b, codes c, codes d)
{
    return most_codes(most_codes(a, b), most_codes(c, d));
}

void POOL_U8(uint8_t *out, const uint8_t *above, const uint8_t *below, unsigned channels,
             unsigned pixels)
{
    for (unsigned p = 0; p < pixels; p++) {
        unsigned c = 0;
        for (; c + 16 <= channels; c += 16)
            store_16(out + c, most_of_4(load_16(above + c), load_16(above + channels + c),
                                        load_16(below + c), load_16(below + channels + c)));
        for (; c + 8 <= channels; c += 8)
            store_8(out + c, most_of_4(load_8(above + c), load_8(above + channels + c),
                                       load_8(below + c), load_8(below + channels + c)));
        for (; c < channels; c++) {
            uint8_t a = above[c] > above[channels + c] ? above[c] : above[channels + c];
            uint8_t b = below[c] > below[channels + c] ? below[c] : below[channels + c];
            out[c] = a > b ? a : b;
        }
        out += channels, above += 2 * (size_t)channels, below += 2 * (size_t)channels;
    }
}
