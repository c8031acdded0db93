// Vectors of the CPU's size, by the extensions of GCC and Clang.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

namespace
{

#if defined(__AVX512F__)
constexpr int kBytes = 64;
#elif defined(__AVX__)
constexpr int kBytes = 32;
#else
constexpr int kBytes = 16;
#endif
template <typename T> constexpr int kLanes = kBytes / int(sizeof(T));
template <typename T, int lanes = kLanes<T>> struct Wide {
    typedef T Type __attribute__((vector_size(lanes * sizeof(T)), aligned(alignof(T)), may_alias));
};
template <typename T> using Vector = typename Wide<T>::Type;
template <typename T> using Index = std::conditional_t<sizeof(T) == 4, int32_t, int64_t>;

template <typename T> inline Vector<T> load(const T *p)
{
    return *reinterpret_cast<const Vector<T> *>(p);
}
template <typename T> inline void store(T *p, Vector<T> v)
{
    *reinterpret_cast<Vector<T> *>(p) = v;
}

// The same from and to an array of bfloat16 (any class of 16 bits), or of T itself.
template <typename T, typename Q> inline Vector<T> read(const Q *q)
{
    if constexpr (std::is_same_v<Q, T>) {
        return load(q);
    } else {
        static_assert(sizeof(Q) == 2 && sizeof(T) == 4);
#ifdef __AVX512F__ // in one instruction instead of four
        const __m256i bits = _mm256_loadu_si256(reinterpret_cast<const __m256i *>(q));
        return (Vector<T>)_mm512_slli_epi32(_mm512_cvtepu16_epi32(bits), 16);
#else
        const auto bits = *reinterpret_cast<const typename Wide<uint16_t, kLanes<T>>::Type *>(q);
        return (Vector<T>)(__builtin_convertvector(bits, Vector<uint32_t>) << 16);
#endif
    }
}
template <typename T, typename Q> inline void write(Q *q, Vector<T> v)
{ // rounded to nearest even
    if constexpr (std::is_same_v<Q, T>) {
        store(q, v);
    } else {
        static_assert(sizeof(Q) == 2 && sizeof(T) == 4);
        auto bits = (Vector<uint32_t>)v;
        bits = (bits + 0x7fff + (bits >> 16 & 1)) >> 16;
#ifdef __AVX512F__
        _mm256_storeu_si256(reinterpret_cast<__m256i *>(q), _mm512_cvtepi32_epi16((__m512i)bits));
#else
        typedef typename Wide<uint16_t, kLanes<T>>::Type Half;
        *reinterpret_cast<Half *>(q) = __builtin_convertvector(bits, Half);
#endif
    }
}

// exp of |x| < 80 to about 1e-6.
inline float fast_exp(float x)
{
    const float y = x * 1.44269504f, n = std::floor(y + 0.5f), f = (y - n) * 0.693147181f;
    const float p =
        1 +
        f * (1 + f * (0.5f + f * (0.166666667f + f * (0.0416666667f +
                                                      f * (0.00833333333f + f * 0.00138888889f)))));
    const int32_t bits = (int32_t(n) + 127) << 23;
    float scale;
    std::memcpy(&scale, &bits, 4);
    return p * scale;
}
inline double fast_exp(double x) { return std::exp(x); }
inline Vector<float> fast_exp(Vector<float> x)
{
    const Vector<float> y = x * 1.44269504f;
    const Vector<int32_t> n = __builtin_convertvector(y + 128.5f, Vector<int32_t>) - 128;
    const Vector<float> f = (y - __builtin_convertvector(n, Vector<float>)) * 0.693147181f;
    const Vector<float> p =
        1 +
        f * (1 + f * (0.5f + f * (0.166666667f + f * (0.0416666667f +
                                                      f * (0.00833333333f + f * 0.00138888889f)))));
    return p * (Vector<float>)((n + 127) << 23);
}
inline Vector<double> fast_exp(Vector<double> x)
{
    for (int i = 0; i < kLanes<double>; i++)
        x[i] = std::exp(x[i]);
    return x;
}

// Natural logarithm of normal numbers above 0, to about 1e-7 of the larger of it and 1.
inline Vector<float> fast_log(Vector<float> x)
{
    const Vector<int32_t> bits = (Vector<int32_t>)x - 0x3f3504f3; // from the root of 1/2
    const Vector<float> m = (Vector<float>)((bits & 0x7fffff) + 0x3f3504f3);
    const Vector<float> s = (m - 1) / (m + 1), z = s * s;
    const Vector<float> series =
        1 + z * (0.333333333f + z * (0.2f + z * (0.142857143f + z * 0.111111111f)));
    const Vector<float> e = __builtin_convertvector(bits >> 23, Vector<float>);
    return x != x ? x : e * 0.693147181f + 2 * s * series;
}
inline Vector<double> fast_log(Vector<double> x)
{
    for (int i = 0; i < kLanes<double>; i++)
        x[i] = std::log(x[i]);
    return x;
}

// NaN stays.
template <typename T> inline Vector<T> clamp(Vector<T> v, T low, T high)
{
    v = v < low ? Vector<T>() + low : v;
    return v > high ? Vector<T>() + high : v;
}

// out[i] = f(in[i], ...) on vectors; the last, incomplete one by way of a copy.
template <typename T, typename F, typename... In>
inline void map(int64_t count, T *out, F f, const In *...in)
{
    int64_t i = 0;
    for (; i + kLanes<T> <= count; i += kLanes<T>)
        store(out + i, f(load(in + i)...));
    if (i == count)
        return;
    T rest[kLanes<T>] = {};
    const auto last = [&](const T *p) {
        std::memcpy(rest, p + i, (count - i) * sizeof(T));
        return load(rest);
    };
    store(rest, f(last(in)...));
    std::memcpy(out + i, rest, (count - i) * sizeof(T));
}

// a and b with the halves of every run of 2 * step lanes exchanged between them.
template <typename T, int step, int... i>
inline void exchange(Vector<T> &a, Vector<T> &b, std::integer_sequence<int, i...>)
{
    constexpr int lanes = kLanes<T>;
    const Vector<T> from = a;
#ifdef __clang__
    a = __builtin_shufflevector(from, b, (i & step ? lanes + (i ^ step) : i)...);
    b = __builtin_shufflevector(from, b, (i & step ? lanes + i : i | step)...);
#else
    a = __builtin_shuffle(from, b, Vector<Index<T>>{(i & step ? lanes + (i ^ step) : i)...});
    b = __builtin_shuffle(from, b, Vector<Index<T>>{(i & step ? lanes + i : i | step)...});
#endif
}

// As many vectors as they have lanes: rows become columns.
template <typename T, int step = 1> inline void transpose(Vector<T> *m)
{
    if constexpr (step < kLanes<T>) {
#pragma GCC unroll 16
        for (int i = 0; i < kLanes<T>; i++)
            if (!(i & step))
                exchange<T, step>(m[i], m[i | step], std::make_integer_sequence<int, kLanes<T>>());
        transpose<T, 2 * step>(m);
    }
}

} // namespace
