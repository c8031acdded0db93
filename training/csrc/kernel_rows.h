// Rows of images as the filter of family K takes them: planes, codes of a head, sums over 5x5 taps,
// upsampling, each with its derivative.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "vectors.h"

namespace
{

constexpr int kSide = 5, kRadius = 2, kTaps = kSide * kSide, kLevels = 5;
constexpr int kConfidence = kTaps, kBlend = kTaps + 1, kAlbedo = kTaps + 2; // channels of a head
constexpr int kPlanes = 4; // of what a kernel filters: a weight and three weighted colours

// Planes of one image, rows of whole vectors, at least kRadius pixels around them; the left border
// of a row is the right one of the row above.
template <typename T> struct Planes {
    T *base = nullptr;
    int64_t w = 0, h = 0, stride = 0, size = 0, count = 0;

    Planes() = default;
    Planes(int64_t count, int64_t h, int64_t w) : w(w), h(h), count(count)
    {
        constexpr int64_t lanes = kLanes<T>;
        stride = (w + lanes - 1) / lanes * lanes + lanes;
        size = stride * (h + 2 * kRadius) + lanes;
    }
    T *row(int64_t c, int64_t y) const
    {
        return base + c * size + (y + kRadius) * stride + kLanes<T>;
    }
    void clear() const { std::fill_n(base, count * size, T(0)); }
};

// The logits of a head: whole codes of 0..255, divided by `step`.
template <typename T> struct Codes {
    T step;
    bool whole;          // false: not rounded (for tests)
    Vector<T> digits[2]; // exp of the logits of a code's two digits to base 16

    Codes(double step, bool whole) : step(T(step)), whole(whole)
    {
        for (int i = 0; i < kLanes<T>; i++) {
            digits[0][i] = std::exp(T(16 * i / step));
            digits[1][i] = std::exp(T(i / step));
        }
    }
    // V: a number or a vector of them. Comparisons let NaN through.
    template <typename V> V code(V q) const
    {
        V v = q * step;
        v = v < 0 ? V() : v;
        return v > 255 ? V() + 255 : v;
    }
    T logit(T q) const
    {
        const T v = code(q);
        return (whole ? std::floor(v + T(0.5)) : v) / step;
    }
    Vector<T> weight(Vector<T> q) const
    { // exp of the logit
        auto v = code(q);
        if (whole) {
            const auto n = __builtin_convertvector(v + T(0.5), Vector<Index<T>>);
            const auto none = n >> (8 * sizeof(T) - 1); // all ones, a NaN, where NaN became
                                                        // negative
#ifdef __AVX512F__
            if constexpr (std::is_same_v<T, float>) {
                const auto high = _mm512_permutexvar_ps((__m512i)(n >> 4), (__m512)digits[0]);
                const auto low = _mm512_permutexvar_ps((__m512i)n, (__m512)digits[1]);
                return (Vector<T>)((Vector<Index<T>>)(high * low) | none);
            }
#endif
            v = (Vector<T>)((Vector<Index<T>>)__builtin_convertvector(n, Vector<T>) | none);
        }
        return fast_exp(v / step);
    }
    // The gradient g of a channel passes where its code was not clamped, or where following it
    // brings the code back.
    template <typename V> V passed(V q, V g) const
    {
        const V v = q * step, none = V();
        return v < 0 ? (g < 0 ? g : none) : v > 255 ? (g > 0 ? g : none) : g;
    }

    // Kernel weights of a row of w pixels, from the first of their logits to planar rows.
    template <typename Q>
    void weights(const Q *q, int64_t c, int64_t w, T *to, int64_t stride) const
    {
        constexpr int lanes = kLanes<T>;
        Vector<T> m[lanes];
        for (int64_t x = 0; x < w; x += lanes)
            for (int k = 0; k < kTaps; k += lanes) {
                const int first = std::min(k, kTaps - lanes);
#pragma GCC unroll 16
                for (int i = 0; i < lanes; i++)
                    m[i] = weight(read<T>(q + std::min(x + i, w - 1) * c + first));
                transpose<T>(m);
#pragma GCC unroll 16
                for (int i = 0; i < lanes; i++)
                    store(to + (first + i) * stride + x, m[i]);
            }
    }

    // The way of `weights` backwards.
    template <typename Q>
    void gradients(const Q *q, int64_t c, int64_t w, const T *from, int64_t stride, Q *gq) const
    {
        constexpr int lanes = kLanes<T>;
        Vector<T> m[lanes];
        for (int64_t x = 0; x < w; x += lanes)
            for (int k = 0; k < kTaps; k += lanes) {
                const int first = std::min(k, kTaps - lanes);
#pragma GCC unroll 16
                for (int i = 0; i < lanes; i++)
                    m[i] = load(from + (first + i) * stride + x);
                transpose<T>(m);
#pragma GCC unroll 16
                for (int i = 0; i < lanes; i++)
                    if (x + i < w) {
                        const int64_t at = (x + i) * c + first;
                        write<T>(gq + at, passed(read<T>(q + at), m[i]));
                    }
            }
    }
};

// One row of the filter: s[c](x) = sum over taps of e[k](x) v[c](x + tap).
template <typename T>
void filter_row(const T *e, int64_t stride, const Planes<T> &v, const Planes<T> &s, int64_t y)
{
    for (int64_t x = 0; x < v.w; x += kLanes<T>) {
        Vector<T> sum[kPlanes] = {};
        for (int dy = 0; dy < kSide; dy++)
            for (int dx = 0; dx < kSide; dx++) {
                const Vector<T> weight = load(e + (dy * kSide + dx) * stride + x);
                for (int c = 0; c < kPlanes; c++)
                    sum[c] += weight * load(v.row(c, y + dy - kRadius) + x + dx - kRadius);
            }
        for (int c = 0; c < kPlanes; c++)
            store(s.row(c, y) + x, sum[c]);
    }
}

// Its derivative by the logits, l[k] = e[k] * sum of gs[c](x) v[c](x + tap).
template <typename T>
void logits_row(const T *e, int64_t stride, const Planes<T> &v, const Planes<T> &gs, int64_t y,
                T *l)
{
    for (int64_t x = 0; x < v.w; x += kLanes<T>) {
        Vector<T> g[kPlanes];
        for (int c = 0; c < kPlanes; c++)
            g[c] = load(gs.row(c, y) + x);
        for (int dy = 0; dy < kSide; dy++)
            for (int dx = 0; dx < kSide; dx++) {
                Vector<T> sum = {};
                for (int c = 0; c < kPlanes; c++)
                    sum += g[c] * load(v.row(c, y + dy - kRadius) + x + dx - kRadius);
                const int64_t at = (dy * kSide + dx) * stride + x;
                store(l + at, sum * load(e + at));
            }
    }
}

// Its derivative by v, a row: gv[c](x) = sum over taps of e[k](x - tap) gs[c](x - tap); rows: those
// of e around y, from y + kRadius upwards in the order of the taps.
template <typename T>
void values_row(const std::array<const T *, kSide> &rows, int64_t stride, const Planes<T> &gs,
                const Planes<T> &gv, int64_t y)
{
    for (int64_t x = 0; x < gv.w; x += kLanes<T>) {
        Vector<T> sum[kPlanes] = {};
        for (int dy = 0; dy < kSide; dy++)
            for (int dx = 0; dx < kSide; dx++) {
                const int64_t at = x - dx + kRadius;
                const Vector<T> weight = load(rows[dy] + (dy * kSide + dx) * stride + at);
                for (int c = 0; c < kPlanes; c++)
                    sum[c] += weight * load(gs.row(c, y - dy + kRadius) + at);
            }
        for (int c = 0; c < kPlanes; c++)
            store(gv.row(c, y) + x, sum[c]);
    }
}

// Bilinear by 2 with repeated edges, and its adjoint; rows y of the large image, `coarse` the small
// one.
template <typename T> struct Upsampler {
    const Planes<T> &coarse;
    std::vector<T> small, large;

    explicit Upsampler(const Planes<T> &coarse)
        : coarse(coarse), small(coarse.w + 2), large(2 * coarse.w + 2)
    {
    }

    std::array<T *, 2> rows(int c, int64_t y) const
    { // weights 3/4 and 1/4
        const int64_t near = y / 2, far = near + (y % 2 ? 1 : -1);
        return {coarse.row(c, near), coarse.row(c, std::clamp<int64_t>(far, 0, coarse.h - 1))};
    }
    const T *up(int c, int64_t y)
    {
        const auto [near, far] = rows(c, y);
        T *m = small.data() + 1, *out = large.data();
        for (int64_t x = 0; x < coarse.w; x++)
            m[x] = T(0.75) * near[x] + T(0.25) * far[x];
        m[-1] = m[0];
        m[coarse.w] = m[coarse.w - 1];
        for (int64_t x = 0; x < coarse.w; x++) {
            out[2 * x] = T(0.75) * m[x] + T(0.25) * m[x - 1];
            out[2 * x + 1] = T(0.75) * m[x] + T(0.25) * m[x + 1];
        }
        return out;
    }
    T *gradient() { return large.data() + 1; } // to be filled for `down`
    void down(int c, int64_t y, int64_t w)
    {
        const auto [near, far] = rows(c, y);
        T *g = gradient();
        std::fill(g + w, g + 2 * coarse.w, T(0));
        g[-1] = g[0];
        g[2 * coarse.w] = g[2 * coarse.w - 1];
        for (int64_t x = 0; x < coarse.w; x++) {
            const T v =
                T(0.75) * (g[2 * x] + g[2 * x + 1]) + T(0.25) * (g[2 * x - 1] + g[2 * x + 2]);
            small[x] = v;
        }
        for (int64_t x = 0; x < coarse.w; x++)
            near[x] += T(0.75) * small[x];
        for (int64_t x = 0; x < coarse.w; x++)
            far[x] += T(0.25) * small[x];
    }
};

} // namespace
