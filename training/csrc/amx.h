// Convolutions 3x3 (padded by 1) and 1x1 of channels-last bf16 images, with their derivatives, on
// the tiles of AMX. A kernel row of a pixel is one run of 3 * channels values in memory, so the
// runs of 16 pixels are a tile as they stand. (Where a tile is longer than the run, weights of 0
// meet the next pixel: a NaN reaches one pixel more than it should.)
#pragma once

#if defined(__AMX_BF16__) && defined(__AVX512BF16__) && defined(__linux__)
#define LULL_AMX 1

#include <algorithm>
#include <array>
#include <cstdlib>
#include <immintrin.h>
#include <memory>
#include <new>
#include <sys/syscall.h>
#include <unistd.h>

#include "vectors.h"

namespace amx
{

typedef uint16_t Half;               // bf16
constexpr int kSide = 16, kRun = 32; // of a tile: rows, and values in a row
constexpr int kTile = kSide * kRun;

inline int64_t up(int64_t n, int64_t to) { return (n + to - 1) / to * to; }

// Whether the kernel lets this process use tiles.
inline bool usable()
{
    static const bool allowed = syscall(SYS_arch_prctl, 0x1023, 18) == 0; // ARCH_REQ_XCOMP_PERM
    return allowed;
}

// Zeros on the boundary of a cache line: tiles load several times as fast where their rows cross
// none.
template <typename T> struct Memory {
    std::unique_ptr<T, decltype(&std::free)> base;

    explicit Memory(int64_t count)
        : base((T *)std::aligned_alloc(64, up(count * sizeof(T), 64)), &std::free)
    {
        if (!base)
            throw std::bad_alloc();
        std::memset((void *)base.get(), 0, count * sizeof(T));
    }
    T *data() const { return base.get(); }
};

// Eight tiles of 16 rows of 64 bytes while it lives.
struct Tiles {
    struct alignas(64) Config {
        uint8_t palette, row, reserved[14];
        uint16_t bytes[16];
        uint8_t rows[16];
    } before{};

    Tiles()
    {
        _tile_storeconfig(&before);
        Config mine{};
        mine.palette = 1;
        for (int i = 0; i < 8; i++) {
            mine.bytes[i] = 64;
            mine.rows[i] = kSide;
        }
        _tile_loadconfig(&mine);
    }
    ~Tiles()
    {
        if (before.palette)
            _tile_loadconfig(&before);
        else
            _tile_release();
    }
    Tiles(const Tiles &) = delete;
};

// bf16 of 16 floats.
inline __m256i halves(__m512 v) { return (__m256i)_mm512_cvtneps_pbh(v); }
inline __mmask16 first(int64_t n) { return n >= 16 ? 0xffff : n <= 0 ? 0 : (1 << n) - 1; }

// Pairs of values, one of `low` and one of `high`, of 16 columns.
inline __m512i paired(__m256i low, __m256i high)
{
    return _mm512_or_si512(_mm512_cvtepu16_epi32(low),
                           _mm512_slli_epi32(_mm512_cvtepu16_epi32(high), 16));
}

// A layer's shape: k x k taps.
struct Shape {
    int64_t h, w, in, out, k;
    int64_t channels() const { return up(in, kSide); }               // of the input, with zeros
    int64_t runs() const { return up(k * channels(), kRun) / kRun; } // tiles of a run
    int64_t blocks() const { return up(out, kSide) / kSide; }
};

// Weights [out][k][k][in] as tiles: by block of 16 outputs, row of the kernel, part of its run.
inline Memory<Half> pack(const float *weight, const Shape &s)
{
    Memory<Half> tiles(s.blocks() * s.k * s.runs() * kTile);
    Half *to = tiles.data();
    for (int64_t b = 0; b < s.blocks(); b++)
        for (int64_t dy = 0; dy < s.k; dy++)
            for (int64_t r = 0; r < s.runs(); r++, to += kTile) {
                Vector<float> m[kSide] = {};
                for (int64_t o = 0; o < std::min<int64_t>(kSide, s.out - b * kSide); o++) {
                    __m256i v[2];
                    for (int i = 0; i < 2; i++) {
                        const int64_t at = r * kRun + i * kSide, dx = at / s.channels();
                        const int64_t c = at % s.channels(), row = (b * kSide + o) * s.k + dy;
                        v[i] = halves(_mm512_maskz_loadu_ps(dx < s.k ? first(s.in - c) : 0,
                                                            weight + (row * s.k + dx) * s.in + c));
                    }
                    m[o] = (Vector<float>)_mm512_inserti64x4(_mm512_castsi256_si512(v[0]), v[1], 1);
                }
                transpose<float>(m);
                for (int i = 0; i < kSide; i++)
                    _mm512_store_si512(to + i * kRun, (__m512i)m[i]);
            }
    return tiles;
}

// The same of the convolution that leads gradients back: s is the shape of that one.
inline Memory<Half> pack_backward(const float *weight, const Shape &s)
{
    Memory<Half> tiles(s.blocks() * s.k * s.runs() * kTile);
    Half *to = tiles.data();
    for (int64_t b = 0; b < s.blocks(); b++)
        for (int64_t dy = 0; dy < s.k; dy++)
            for (int64_t pair = 0; pair < s.runs() * kSide; pair++, to += kRun) {
                __m256i v[2];
                for (int i = 0; i < 2; i++) {
                    const int64_t at = 2 * pair + i, dx = at / s.channels(), o = at % s.channels();
                    const int64_t tap = (o * s.k + s.k - 1 - dy) * s.k + s.k - 1 - dx;
                    const bool there = dx < s.k && o < s.in;
                    v[i] = halves(_mm512_maskz_loadu_ps(there ? first(s.out - b * kSide) : 0,
                                                        weight + tap * s.out + b * kSide));
                }
                _mm512_store_si512(to, paired(v[0], v[1]));
            }
    return tiles;
}

// M x N tiles of output: 16 pixels each of a row, by 16 channels.
template <int M, int N>
inline void multiply(const Half *const *rows, const Half *weights, const Shape &s, float *sums)
{
    constexpr int size = kSide * kSide;
    const int64_t parts = s.runs(), block = s.k * parts * kTile, bytes = s.channels() * 2;
    const int64_t next = kSide * s.channels();
    _tile_zero(0);
    _tile_zero(1);
    _tile_zero(2);
    _tile_zero(3);
    for (int64_t dy = 0; dy < s.k; dy++)
        for (int64_t r = 0; r < parts; r++) {
            const Half *w = weights + (dy * parts + r) * kTile, *x = rows[dy] + r * kRun;
            _tile_loadd(6, w, 64);
            _tile_loadd(4, x, bytes);
            _tile_dpbf16ps(0, 4, 6);
            if constexpr (N > 1) {
                _tile_loadd(7, w + block, 64);
                _tile_dpbf16ps(1, 4, 7);
            }
            if constexpr (M > 1) {
                _tile_loadd(5, x + next, bytes);
                _tile_dpbf16ps(2, 5, 6);
            }
            if constexpr (M > 1 && N > 1)
                _tile_dpbf16ps(3, 5, 7);
            if constexpr (M > 2) {
                _tile_loadd(4, x + 2 * next, bytes);
                _tile_dpbf16ps(1, 4, 6);
                _tile_loadd(5, x + 3 * next, bytes);
                _tile_dpbf16ps(3, 5, 6);
            }
        }
    // By pixels, then channels.
    _tile_stored(0, sums, 64);
    if constexpr (N > 1)
        _tile_stored(1, sums + size, 64);
    if constexpr (M > 1)
        _tile_stored(2, sums + N * size, 64);
    if constexpr (M > 1 && N > 1)
        _tile_stored(3, sums + 3 * size, 64);
    if constexpr (M > 2) {
        _tile_stored(1, sums + 2 * size, 64);
        _tile_stored(3, sums + 3 * size, 64);
    }
}

// What `multiply` left in sums: `width` pixels from x of row y by n blocks of channels from c.
struct Sums {
    alignas(64) float sums[4 * kSide * kSide];
    int64_t y, x, width, c;
    int n;

    void store(const float *bias, bool relu, const Shape &s, Half *to) const
    {
        const __m512 floor = _mm512_set1_ps(relu ? 0 : -INFINITY);
        for (int j = 0; j < n; j++) {
            const int64_t at = c + j * kSide;
            const __mmask16 mask = first(s.out - at);
            const __m512 add = bias ? _mm512_maskz_loadu_ps(mask, bias + at) : _mm512_setzero_ps();
            const auto value = [&](int64_t i) { // NaN stays: max takes its second operand then
                const int64_t tile = i / kSide * n + j;
                return _mm512_max_ps(
                    floor,
                    _mm512_add_ps(_mm512_load_ps(sums + (tile * kSide + i % kSide) * kSide), add));
            };
            Half *out = to + (y * s.w + x) * s.out + at;
            int64_t i = 0;
            for (; s.out == kSide && i + 1 < width; i += 2)
                _mm512_storeu_si512(out + i * kSide,
                                    (__m512i)_mm512_cvtne2ps_pbh(value(i + 1), value(i)));
            for (; mask == 0xffff && i < width; i++)
                _mm256_storeu_si256((__m256i *)(out + i * s.out), halves(value(i)));
            for (; i < width; i++)
                _mm256_mask_storeu_epi16(out + i * s.out, mask, halves(value(i)));
        }
    }
};

// Rows [begin, end) of an image: to [h][w][out]. bias may be null.
inline void convolve(const Half *from, const Memory<Half> &weights, const float *bias, bool relu,
                     const Shape &s, int64_t begin, int64_t end, Half *to)
{
    const int64_t border = s.k / 2, c = s.channels();
    const int64_t size = up((up(s.w, 4 * kSide) + 2) * c + s.runs() * kRun, kRun);
    const Memory<Half> memory(size * (s.k + 1));
    const auto row = [&](int64_t y) {
        return memory.data() + (y < 0 || y >= s.h ? s.k : y % s.k) * size;
    };
    const auto fetch = [&](int64_t y) {
        if (y < 0 || y >= s.h)
            return;
        Half *to = row(y) + border * c;
        const Half *x = from + y * s.w * s.in;
        if (c == s.in)
            std::memcpy(to, x, s.w * c * sizeof(Half));
        for (int64_t i = 0; c > s.in && i < s.w; i++)
            for (int64_t j = 0; j < c; j += kSide)
                _mm256_storeu_si256((__m256i *)(to + i * c + j),
                                    _mm256_maskz_loadu_epi16(first(s.in - j), x + i * s.in + j));
    };
    Sums units[2]; // one is computed while the other one is stored
    Sums *now = units, *last = nullptr;
    for (int64_t y = begin - border; y < begin + border; y++)
        fetch(y);
    for (int64_t y = begin; y < end; y++) {
        fetch(y + border);
        for (int64_t b = 0; b < s.blocks(); b += 2) {
            const int n = b + 1 == s.blocks() ? 1 : 2;
            const Half *w = weights.data() + b * s.k * s.runs() * kTile;
            for (int64_t x = 0; x < s.w; x += now->width) {
                const Half *rows[3];
                for (int64_t dy = 0; dy < s.k; dy++)
                    rows[dy] = row(y + dy - border) + x * c;
                now = last == units ? units + 1 : units;
                const int64_t left = s.w - x, most = (n == 1 ? 4 : 2) * kSide;
                now->y = y;
                now->x = x;
                now->width = std::min(left, most);
                now->c = b * kSide;
                now->n = n;
                const bool one = left <= kSide, two = left <= 2 * kSide;
                const auto work = n == 1 ? one   ? multiply<1, 1>
                                           : two ? multiply<2, 1>
                                                 : multiply<4, 1>
                                  : one ? multiply<1, 2>
                                         : multiply<2, 2>;
                work(rows, w, s, now->sums);
                if (last)
                    last->store(bias, relu, s, to);
                last = now;
            }
        }
    }
    if (last)
        last->store(bias, relu, s, to);
}

// Derivatives by the weights and biases, summed over images.
struct Gradients {
    const Shape s;
    const int64_t border = s.k / 2, ins = s.channels(), outs = up(s.out, kSide);
    const int64_t width = up(s.w, kRun), rows = std::max<int64_t>(1, 128 / width); // done together
    const int64_t block = rows * kSide * width; // of the planes of 16 inputs
    // Inputs [columns of the kernel][ins / 16][rows][16][width], shifted so that each is aligned;
    // gradients [rows and their neighbours][width / 2][outs][2]; sums: tiles by tap, inputs,
    // outputs.
    Memory<Half> planes, pairs;
    Memory<float> sums, biases;

    explicit Gradients(const Shape &s)
        : s(s), planes(s.k * ins / kSide * block), pairs((rows + 2) * width * outs),
          sums(s.k * s.k * ins * outs), biases(outs)
    {
    }

    void load_inputs(const Half *x, int64_t y0)
    {
        for (int64_t i = 0; i < std::min(rows, s.h - y0); i++)
            for (int64_t c = 0; c < ins; c += kSide)
                for (int64_t p = 0; p < s.w; p += kSide) {
                    Vector<float> m[kSide] = {};
                    const __mmask16 mask = first(s.in - c);
                    const Half *from = x + ((y0 + i) * s.w + p) * s.in + c;
                    for (int64_t j = 0; j < std::min<int64_t>(kSide, s.w - p); j++)
                        m[j] = (Vector<float>)_mm512_cvtepu16_epi32(
                            _mm256_maskz_loadu_epi16(mask, from + j * s.in));
                    transpose<float>(m);
                    Half *to = planes.data() + (c / kSide * rows + i) * kSide * width + p;
                    for (int j = 0; j < kSide; j++, to += width)
                        spread(to, p, _mm512_cvtepi32_epi16((__m512i)m[j]));
                }
    }
    // 16 pixels of a plane from pixel p, to each of the shifted ones.
    void spread(Half *to, int64_t p, __m256i v)
    {
        if (s.k == 1)
            return _mm256_store_si256((__m256i *)to, v);
        const int64_t next = ins / kSide * block;
        _mm256_mask_storeu_epi16(to + 1, p + kSide == width ? 0x7fff : 0xffff, v);
        _mm256_store_si256((__m256i *)(to + next), v);
        _mm256_mask_storeu_epi16(to + 2 * next - 1, p ? 0xffff : 0xfffe, v);
    }
    Half *pairs_of(int64_t y) const { return pairs.data() + y % (rows + 2) * width * outs; }
    void load_gradients(const Half *g, int64_t y)
    {
        if (y < 0 || y >= s.h)
            return;
        Half *to = pairs_of(y);
        for (int64_t c = 0; c < outs; c += kSide) {
            const __mmask16 mask = first(s.out - c);
            __m512 total = _mm512_load_ps(biases.data() + c);
            const Half *from = g + y * s.w * s.out + c;
            for (int64_t p = 0; p < s.w; p += 2) {
                const __mmask16 second = p + 1 < s.w ? mask : 0;
                const __m512i v = paired(_mm256_maskz_loadu_epi16(mask, from + p * s.out),
                                         _mm256_maskz_loadu_epi16(second, from + (p + 1) * s.out));
                total = _mm512_add_ps(total, (__m512)_mm512_slli_epi32(v, 16));
                total = _mm512_add_ps(total,
                                      (__m512)_mm512_and_si512(v, _mm512_set1_epi32(0xffff0000)));
                _mm512_store_si512(to + p * outs + 2 * c, v);
            }
            _mm512_store_ps(biases.data() + c, total);
        }
    }
    // One row of the kernel for 16 inputs and 16 outputs, of the rows from y0.
    template <int taps> void add(int64_t y0, int64_t dy, int64_t c, int64_t o)
    {
        const int64_t next = ins * outs, shift = ins / kSide * block;
        float *sum = sums.data() + dy * s.k * next + (c * outs + o * kSide);
        _tile_loadd(0, sum, 64);
        if constexpr (taps > 1) {
            _tile_loadd(1, sum + next, 64);
            _tile_loadd(2, sum + 2 * next, 64);
        }
        for (int64_t i = 0; i < std::min(rows, s.h - y0); i++) {
            const int64_t y = y0 + i - dy + border;
            if (y < 0 || y >= s.h)
                continue;
            const Half *x = planes.data() + (c / kSide * rows + i) * kSide * width;
            const Half *g = pairs_of(y) + 2 * o;
            for (int64_t p = 0; p < width; p += kRun, x += kRun, g += kRun * outs) {
                _tile_loadd(7, g, outs * 4);
                _tile_loadd(3, x, width * 2);
                _tile_dpbf16ps(0, 3, 7);
                if constexpr (taps > 1) {
                    _tile_loadd(4, x + shift, width * 2);
                    _tile_dpbf16ps(1, 4, 7);
                    _tile_loadd(5, x + 2 * shift, width * 2);
                    _tile_dpbf16ps(2, 5, 7);
                }
            }
        }
        _tile_stored(0, sum, 64);
        if constexpr (taps > 1) {
            _tile_stored(1, sum + next, 64);
            _tile_stored(2, sum + 2 * next, 64);
        }
    }
    void run(const Half *x, const Half *g)
    {
        for (int64_t y = 0; y < border; y++)
            load_gradients(g, y);
        for (int64_t y = 0; y < s.h; y += rows) {
            load_inputs(x, y);
            for (int64_t i = 0; i < rows; i++)
                load_gradients(g, y + i + border);
            for (int64_t c = 0; c < ins; c += kSide)
                for (int64_t o = 0; o < outs; o += kSide)
                    for (int64_t dy = 0; dy < s.k; dy++)
                        s.k > 1 ? add<3>(y, dy, c, o) : add<1>(y, dy, c, o);
        }
    }
    // Adds them to [out][k][k][in] and [out].
    void give(float *weight, float *bias) const
    {
        for (int64_t o = 0; o < s.out; o++) {
            bias[o] += biases.data()[o];
            for (int64_t tap = 0; tap < s.k * s.k; tap++)
                for (int64_t c = 0; c < s.in; c++)
                    weight[(o * s.k * s.k + tap) * s.in + c] +=
                        sums.data()[tap * ins * outs + c / kSide * kSide * outs +
                                    o / kSide * kSide * kSide + c % kSide * kSide + o % kSide];
        }
    }
};

} // namespace amx

#endif
