// Operations on single pixels around the network of family K, and its loss.
#pragma once

#include <algorithm>
#include <vector>

#include "vectors.h"

namespace
{

// The PU curve of training/color.py.
template <typename T> struct Pu {
    using V = Vector<T>;
    static constexpr T A = 1.41283765e03, B = 1.64593172, C = 4.31384981e-01, D = -2.94139609e-03;
    static constexpr T E = 1.92653254e-01, F = 6.26026094e-03, G = 9.98620152e-01;
    static constexpr T kLow = 1.57945760e-06, kHigh = 3.22087631e-02;         // of the radiance,
    static constexpr T kLowCode = 2.23151711e-03, kHighCode = 3.70974749e-01; // of the code
    T top; // the code of the largest half float

    V forward(V y) const
    {
        const V log = fast_log(y <= kHigh ? clamp<T>(y, kLow, kHigh) : y + F);
        const V mid = B * fast_exp(C * log) + D;
        return (y <= kLow ? A * y : y <= kHigh ? mid : E * log + G) / top;
    }
    V slope(V y) const
    {
        const V log = fast_log(clamp<T>(y, kLow, kHigh));
        const V mid = B * C * fast_exp((C - 1) * log);
        return (y <= kLow ? V() + A : y <= kHigh ? mid : E / (y + F)) / top;
    }
    V inverse(V code) const
    {
        const V x = code * top;
        const V log = fast_log(clamp<T>((x - D) / B, T(1e-12), T(1))) / C;
        const V e = fast_exp(x <= kHighCode ? log : (x - G) / E);
        return x <= kLowCode ? x / A : x <= kHighCode ? e : e - F;
    }
};

// Input of the network: codes of 0..255 over 255, a pixel's 12 beside one another; x: the planes of
// kernel_model.planes, radiance decoded.
struct Encoder {
    double eps, top;    // added to the albedo; of the radiance,
    double gain, scale; // whose code is log(1 + gain i) * scale

    template <typename Q, typename T>
    void row(const T *radiance, const T *x, int64_t plane, int64_t w, Q *to) const
    {
        using V = Vector<T>;
        constexpr int lanes = kLanes<T>, planes = 12;
        T in[lanes] = {};
        V code[planes + lanes] = {};
        for (int64_t at = 0; at < w; at += lanes) {
            const int64_t count = std::min<int64_t>(lanes, w - at);
            const auto take = [&](const T *p) {
                if (count == lanes)
                    return load(p + at);
                std::copy_n(p + at, count, in);
                return load(in);
            };
            const V has_albedo = take(x + 9 * plane), has_normal = take(x + 10 * plane);
            const auto put = [&](int c, V v) {
                const V whole = clamp<T>(v, 0, 1) * T(255) + T(0.5);
                const V floor =
                    __builtin_convertvector(__builtin_convertvector(whole, Vector<Index<T>>), V);
                code[c] = (v != v ? v : floor) / T(255);
            };
            for (int c = 0; c < 3; c++) {
                const V albedo = take(x + (3 + c) * plane) * has_albedo;
                const V divisor = albedo + T(1 - eps) * (1 - has_albedo) + T(eps);
                const V i = clamp<T>(take(radiance + c * plane), 0, T(top)) / divisor;
                put(c, fast_log(1 + T(gain) * i) * T(scale));
                put(3 + c, albedo);
                put(6 + c,
                    take(x + (6 + c) * plane) * has_normal + T(128 / 255.0) * (1 - has_normal));
                put(9 + c, take(x + (9 + c) * plane));
            }
            for (int first = 0; first < planes; first += lanes) {
                V m[lanes];
                std::copy_n(code + first, lanes, m);
                transpose<T>(m);
                for (int i = 0; i < lanes; i++) {
                    Q pixel[lanes];
                    write<T>(pixel, m[i]);
                    if (i < count)
                        std::memcpy(to + i * planes + first, pixel,
                                    std::min(lanes, planes - first) * sizeof(Q));
                }
            }
            to += count * planes;
        }
    }
};

// Half the mean absolute difference of a and b and half that of their gradients, of `count` planes,
// and the derivative by a.
template <typename T>
T l1_and_gradient(const T *a, const T *b, int64_t count, int64_t h, int64_t w, T *da)
{
    using V = Vector<T>;
    const double pairs = double(count) * (h * (w - 1) + (h - 1) * w);
    const T one = T(0.5 / (double(count) * h * w)), two = T(0.5 / pairs);
    double sum = 0, differences = 0;
    const auto sign = [](V v) { return v > 0 ? V() + 1 : v < 0 ? V() - 1 : v; };
    const auto total = [](V v) {
        T s = 0;
        for (int i = 0; i < kLanes<T>; i++)
            s += v[i];
        return s;
    };
    // Rows with a column beyond each end, and a row beyond, where the difference is the same.
    const int64_t stride = w + 2 * kLanes<T>;
    std::vector<T> rows(3 * stride);
    for (int64_t p = 0; p < count; p++) {
        const auto difference = [&](int64_t y) {
            T *d = rows.data() + (y + 3) % 3 * stride + kLanes<T>;
            const int64_t at = (p * h + std::clamp<int64_t>(y, 0, h - 1)) * w;
            map(
                w, d, [](V u, V v) { return u - v; }, a + at, b + at);
            d[-1] = d[0];
            std::fill_n(d + w, kLanes<T>, d[w - 1]);
            return d;
        };
        const T *above = difference(-1), *d = difference(0);
        for (int64_t y = 0; y < h; y++) {
            const T *below = difference(y + 1);
            V l1 = {}, l2 = {};
            T *out = da + (p * h + y) * w;
            const auto at = [&](int64_t x, V inside) {
                const V v = load(d + x), right = load(d + x + 1) - v, down = load(below + x) - v;
                l1 += inside * (v < 0 ? -v : v);
                l2 += inside * ((right < 0 ? -right : right) + (down < 0 ? -down : down));
                return sign(v) * one + (sign(v - load(d + x - 1)) - sign(right) +
                                        sign(v - load(above + x)) - sign(down)) *
                                           two;
            };
            int64_t x = 0;
            for (; x + kLanes<T> <= w; x += kLanes<T>)
                store(out + x, at(x, V() + 1));
            if (x < w) {
                T rest[kLanes<T>] = {};
                std::fill_n(rest, w - x, T(1));
                store(rest, at(x, load(rest)));
                std::copy_n(rest, w - x, out + x);
            }
            sum += total(l1);
            differences += total(l2);
            above = d;
            d = below;
        }
    }
    return T(0.5 * sum / (double(count) * h * w) + 0.5 * differences / pairs);
}

} // namespace
