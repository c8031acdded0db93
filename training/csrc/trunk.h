// What lies between the convolutions of a network: pooling, upsampling, concatenation, and the
// gradients on their way back. Everything is in channels-last order.
#pragma once

#include <algorithm>
#include <vector>

#include "vectors.h"

namespace
{

template <typename Q>
using Arithmetic = std::conditional_t<std::is_same_v<Q, double>, double, float>;

// Calls f(first, count) for chunks of at most a vector that cover `channels`; the last may overlap.
template <typename T, typename F> inline void chunks(int64_t channels, F f)
{
    constexpr int64_t lanes = kLanes<T>;
    if (channels < lanes)
        f(0, channels);
    else
        for (int64_t c = 0; c < channels; c += lanes)
            f(std::min(c, channels - lanes), std::integral_constant<int64_t, lanes>());
}

template <typename T, typename Q> inline Vector<T> read(const Q *q, int64_t count)
{
    if (count == kLanes<T>)
        return read<T>(q);
    T values[kLanes<T>] = {};
    for (int64_t i = 0; i < count; i++)
        values[i] = T(q[i]);
    return load(values);
}
template <typename T, typename Q> inline void write(Q *q, Vector<T> v, int64_t count)
{
    if (count == kLanes<T>)
        return write<T>(q, v);
    for (int64_t i = 0; i < count; i++)
        q[i] = Q(T(v[i]));
}

// An image in channels-last order.
template <typename Q> struct Map {
    Q *base;
    int64_t h, w, c;

    Q *at(int64_t y, int64_t x) const { return base + (y * w + x) * c; }
};

// The largest of 2x2 pixels; rows of `to`.
template <typename Q> void max_pool(const Map<const Q> &from, const Map<Q> &to)
{
    using T = Arithmetic<Q>;
    for (int64_t y = 0; y < to.h; y++)
        for (int64_t x = 0; x < to.w; x++)
            chunks<T>(to.c, [&](int64_t c, auto count) {
                Vector<T> top = read<T>(from.at(2 * y, 2 * x) + c, count);
                for (int i = 1; i < 4; i++) {
                    const auto v = read<T>(from.at(2 * y + i / 2, 2 * x + i % 2) + c, count);
                    top = v <= top ? top : v;
                }
                write<T>(to.at(y, x) + c, top, count);
            });
}

// Channels of `a`, of half the size or the same, then those of `b`.
template <typename Q>
void concatenate(const Map<const Q> &a, const Map<const Q> &b, const Map<Q> &to)
{
    const int64_t shift = to.h != a.h;
    const auto copy = [](const Q *from, int64_t channels, Q *to) {
        chunks<Arithmetic<Q>>(channels, [=](int64_t c, auto count) {
            std::memcpy(to + c, from + c, count * sizeof(Q));
        });
    };
    for (int64_t y = 0; y < to.h; y++)
        for (int64_t x = 0; x < to.w; x++) {
            copy(a.at(y >> shift, x >> shift), a.c, to.at(y, x));
            copy(b.at(y, x), b.c, to.at(y, x) + a.c);
        }
}

// A gradient, or channels of one, that reached the value of a layer by one of its uses; twice as
// large as the value where that was upsampled.
template <typename Q> struct Use {
    Map<const Q> gradient;
    int64_t first;
};

// Their sum, through pooling (if `pool`) and ReLU, to the gradient of the convolution. y: after
// ReLU.
template <typename Q>
void activation_backward(const Map<const Q> &y, bool pool, const std::vector<Use<Q>> &uses,
                         const Map<Q> &to)
{
    using T = Arithmetic<Q>;
    using V = Vector<T>;
    const int64_t h = pool ? y.h / 2 : y.h, w = pool ? y.w / 2 : y.w;
    const Map<const Q> &only = uses[0].gradient;
    if (!pool && uses.size() == 1 && only.h == h && only.c == y.c) // value by value
        return chunks<T>(h * w * y.c, [&](int64_t i, auto count) {
            const V v = read<T>(y.base + i, count), g = read<T>(only.base + i, count);
            write<T>(to.base + i, v <= 0 ? V() : g, count);
        });
    for (int64_t row = 0; row < h; row++)
        for (int64_t x = 0; x < w; x++)
            chunks<T>(y.c, [&](int64_t c, auto count) {
                V g = {};
                for (const Use<Q> &use : uses) {
                    const int64_t up = use.gradient.h != h, next = use.gradient.c;
                    const Q *p = use.gradient.at(row << up, x << up) + use.first + c;
                    g += read<T>(p, count);
                    if (up) {
                        const Q *below = p + use.gradient.w * next;
                        g += read<T>(p + next, count) + read<T>(below, count) +
                             read<T>(below + next, count);
                    }
                }
                if (!pool) {
                    const V v = read<T>(y.at(row, x) + c, count);
                    return write<T>(to.at(row, x) + c, v <= 0 ? V() : g, count);
                }
                V v[4], top = {};
                for (int i = 0; i < 4; i++) {
                    v[i] = read<T>(y.at(2 * row + i / 2, 2 * x + i % 2) + c, count);
                    top = v[i] <= top ? top : v[i];
                }
                for (int i = 0; i < 4; i++) { // to the first of equal ones
                    const V mine = v[i] < top ? V() : g;
                    g -= mine;
                    write<T>(to.at(2 * row + i / 2, 2 * x + i % 2) + c, top <= 0 ? V() : mine,
                             count);
                }
            });
}

} // namespace
