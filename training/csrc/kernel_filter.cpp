// The filter of family K (docs/kernel-prediction.md, section Filter) with its derivatives by the heads, one
// image after the other, row by row: no tensor of weights is ever written.
//
// Images are kept as planes in fp32 (or fp64, for tests) with a border of zeros; heads are read, and their
// gradients written, as the convolutions have them: [N,H,W,C] in memory, bf16, fp32 or fp64.
#include <torch/extension.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

constexpr int kSide = 5, kRadius = 2, kTaps = kSide * kSide, kLevels = 5;
constexpr int kConfidence = kTaps, kBlend = kTaps + 1, kAlbedo = kTaps + 2;  // channels of a head
constexpr int kPlanes = 4;  // of what a kernel filters: a weight and three weighted colours

template <typename T> constexpr int kLanes = 64 / int(sizeof(T));
template <typename T> struct Wide {
    typedef T Vector __attribute__((vector_size(64), aligned(sizeof(T)), may_alias));
};
template <typename T> using Vector = typename Wide<T>::Vector;
template <typename T> Vector<T> load(const T *p) { return *reinterpret_cast<const Vector<T> *>(p); }
template <typename T> void store(T *p, Vector<T> v) { *reinterpret_cast<Vector<T> *>(p) = v; }

// Planes of one image, rows of whole vectors, at least kRadius pixels around them; the left border of a
// row is the right one of the row above.
template <typename T> struct Planes {
    T *base = nullptr;
    int64_t w = 0, h = 0, stride = 0, size = 0, count = 0;

    Planes() = default;
    Planes(int64_t count, int64_t h, int64_t w) : w(w), h(h), count(count) {
        constexpr int64_t lanes = kLanes<T>;
        stride = (w + lanes - 1) / lanes * lanes + lanes;
        size = stride * (h + 2 * kRadius) + lanes;
    }
    T *row(int64_t c, int64_t y) const {
        return base + c * size + (y + kRadius) * stride + kLanes<T>;
    }
    void clear() const { std::fill_n(base, count * size, T(0)); }
};

// exp in vectorisable form, of |x| < 80, to about 1e-6.
inline float fast_exp(float x) {
    const float y = x * 1.44269504f, n = std::floor(y + 0.5f), f = (y - n) * 0.693147181f;
    const float p = 1 + f * (1 + f * (0.5f + f * (0.166666667f + f * (0.0416666667f + f * (
        0.00833333333f + f * 0.00138888889f)))));
    const int32_t bits = (int32_t(n) + 127) << 23;
    float scale;
    std::memcpy(&scale, &bits, 4);
    return p * scale;
}
inline double fast_exp(double x) { return std::exp(x); }

// Logits of channels k0 .. k1-1 from a row of a head: whole codes of 0..255, divided by `step`.
struct Codes {
    double step;
    bool whole;  // false: not rounded (for tests)

    template <typename Q, typename T>
    void decode(const Q *q, int64_t c, int k0, int k1, int64_t w, T *to, int64_t stride) const {
        const T gain = T(step), top = 255, inverse = T(1 / step);
        for (int k = k0; k < k1; k++, to += stride) {
            for (int64_t x = 0; x < w; x++)
                to[x] = T(q[x * c + k]);
            for (int64_t x = 0; x < w; x++) {
                const T v = std::min(std::max(to[x] * gain, T(0)), top);
                to[x] = (whole ? std::floor(v + T(0.5)) : v) * inverse;
            }
        }
    }

    // Gradients of the channels; they pass where the code was not clamped.
    template <typename Q, typename T>
    void encode(const Q *q, int64_t c, int k0, int k1, int64_t w, const T *from, int64_t stride,
                Q *gq) const {
        for (int k = k0; k < k1; k++, from += stride)
            for (int64_t x = 0; x < w; x++) {
                const T v = T(q[x * c + k]) * T(step);
                gq[x * c + k] = Q(v >= 0 && v <= 255 ? from[x] : T(0));
            }
    }
};

// One row of the filter: s[c](x) = sum over taps of e[k](x) v[c](x + tap).
template <typename T>
void filter_row(const T *e, int64_t stride, const Planes<T> &v, const Planes<T> &s, int64_t y) {
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
                T *l) {
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

// Its derivative by v, a row: gv[c](x) = sum over taps of e[k](x - tap) gs[c](x - tap); rows: those of
// e around y, from y + kRadius upwards in the order of the taps.
template <typename T>
void values_row(const std::array<const T *, kSide> &rows, int64_t stride, const Planes<T> &gs,
                const Planes<T> &gv, int64_t y) {
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

// Bilinear by 2 with repeated edges, and its adjoint; rows y of the large image, `coarse` the small one.
template <typename T> struct Upsampler {
    const Planes<T> &coarse;
    std::vector<T> small, large;

    explicit Upsampler(const Planes<T> &coarse)
        : coarse(coarse), small(coarse.w + 2), large(2 * coarse.w + 2) {}

    std::array<T *, 2> rows(int c, int64_t y) const {  // weights 3/4 and 1/4
        const int64_t near = y / 2, far = near + (y % 2 ? 1 : -1);
        return {coarse.row(c, near), coarse.row(c, std::clamp<int64_t>(far, 0, coarse.h - 1))};
    }
    const T *up(int c, int64_t y) {
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
    T *gradient() { return large.data() + 1; }  // to be filled for `down`
    void down(int c, int64_t y, int64_t w) {
        const auto [near, far] = rows(c, y);
        T *g = gradient();
        std::fill(g + w, g + 2 * coarse.w, T(0));
        g[-1] = g[0];
        g[2 * coarse.w] = g[2 * coarse.w - 1];
        for (int64_t x = 0; x < coarse.w; x++) {
            const T v = T(0.75) * (g[2 * x] + g[2 * x + 1]) + T(0.25) * (g[2 * x - 1] + g[2 * x + 2]);
            small[x] = v;
        }
        for (int64_t x = 0; x < coarse.w; x++)
            near[x] += T(0.75) * small[x];
        for (int64_t x = 0; x < coarse.w; x++)
            far[x] += T(0.25) * small[x];
    }
};

template <typename T> struct Level {
    Planes<T> v, s, out, beta;  // confidence and weighted radiance, their sums, blended result, weight
    Planes<T> gs, gv, gout;     // gradients
};

// What forward leaves for backward, and the gradients' work space, of one image.
template <typename T> struct Tape {
    std::array<Level<T>, kLevels> levels;
    Planes<T> albedo, sums, smooth;  // (1, albedo), filtered; what multiplies the result
    Planes<T> gsums, gsmooth;
    int64_t kept = 0, size = 0;

    Tape(int64_t h, int64_t w) {
        for (Level<T> &l : levels) {
            l.v = l.s = l.gs = l.gv = Planes<T>(kPlanes, h, w);
            l.out = l.gout = Planes<T>(3, h, w);
            l.beta = Planes<T>(1, h, w);
            h = (h + 1) / 2;
            w = (w + 1) / 2;
        }
        albedo = sums = gsums = levels[0].v;
        smooth = gsmooth = levels[0].out;
        place(nullptr, nullptr);
    }
    void place(T *kept_memory, T *work) {
        kept = size = 0;
        const auto take = [](Planes<T> &p, T *memory, int64_t &at) {
            p.base = memory + at;
            at += p.count * p.size;
        };
        for (Planes<T> *p : {&albedo, &sums, &smooth})
            take(*p, kept_memory, kept);
        for (Planes<T> *p : {&gsums, &gsmooth})
            take(*p, work, size);
        for (Level<T> &l : levels) {
            for (Planes<T> *p : {&l.v, &l.s, &l.out, &l.beta})
                take(*p, kept_memory, kept);
            for (Planes<T> *p : {&l.gs, &l.gv, &l.gout})
                take(*p, work, size);
        }
    }
};

struct Constants {
    Codes codes;
    double eps, radiance_max, confidence, blend;  // the last two are added to the logits
};

// The batch as it comes: heads and their gradients, and images by their first element.
template <typename Q, typename T> struct Batch {
    std::array<const Q *, kLevels> heads;
    std::array<Q *, kLevels> gradients;
    std::array<int64_t, kLevels> channels;
    const T *radiance, *has;
    const T *albedo;
    T *out;
    const T *gout;
};

template <typename Q, typename T> struct Image {
    const Batch<Q, T> &b;
    const Constants &k;
    Tape<T> &t;
    const int64_t n, h, w;
    std::vector<T> buffer;  // rows of kTaps channels

    Image(const Batch<Q, T> &b, const Constants &k, Tape<T> &t, int64_t n)
        : b(b), k(k), t(t), n(n), h(t.albedo.h), w(t.albedo.w),
          buffer(kTaps * t.albedo.stride * (kSide + 1) + 2 * kLanes<T>) {}

    T *row(int slot) { return buffer.data() + kLanes<T> + slot * kTaps * t.albedo.stride; }
    int64_t stride(int level) const { return t.levels[level].v.stride; }
    int64_t at(int level, int64_t y) const {
        const Planes<T> &p = t.levels[level].v;
        return (n * p.h + y) * p.w * b.channels[level];
    }
    void decode(int level, int64_t y, int first, int count, T *to) const {
        k.codes.decode(b.heads[level] + at(level, y), b.channels[level], first, first + count,
                       t.levels[level].v.w, to, stride(level));
    }
    void encode(int level, int64_t y, int first, int count, const T *from) const {
        k.codes.encode(b.heads[level] + at(level, y), b.channels[level], first, first + count,
                       t.levels[level].v.w, from, stride(level), b.gradients[level] + at(level, y));
    }
    void weights(int level, int64_t y, int first, T *to) const {
        decode(level, y, first, kTaps, to);
        for (int i = 0; i < kTaps; i++, to += stride(level))
            for (int64_t x = 0; x < t.levels[level].v.w; x++)
                to[x] = fast_exp(to[x]);
    }
    const T *plane(const T *images, int channels, int c, int64_t y) const {
        return images + ((n * channels + c) * h + y) * w;
    }

    // v of level 0: the radiance over the smoothed albedo.
    void demodulate() {
        t.albedo.clear();
        for (int64_t y = 0; y < h; y++) {
            std::fill_n(t.albedo.row(0, y), w, T(1));
            for (int c = 0; c < 3; c++)
                std::copy_n(plane(b.albedo, 3, c, y), w, t.albedo.row(c + 1, y));
        }
        for (int64_t y = 0; y < h; y++) {
            weights(0, y, kAlbedo, row(0));
            filter_row(row(0), stride(0), t.albedo, t.sums, y);
            const T *has = plane(b.has, 1, 0, y), *sum = t.sums.row(0, y);
            for (int c = 0; c < 3; c++) {
                const T *s = t.sums.row(c + 1, y), *r = plane(b.radiance, 3, c, y);
                T *smooth = t.smooth.row(c, y), *i = t.levels[0].v.row(c + 1, y);
                for (int64_t x = 0; x < w; x++) {
                    smooth[x] = has[x] * s[x] / sum[x] + T(1 - k.eps) * (1 - has[x]) + T(k.eps);
                    i[x] = std::min(std::max(r[x], T(0)), T(k.radiance_max)) / smooth[x];
                }
            }
        }
    }

    // v, from the radiance in its last three planes; beta; s.
    void filter(int level) {
        Level<T> &l = t.levels[level];
        for (int64_t y = 0; y < l.v.h; y++) {
            T *logits = row(0), *c = l.v.row(0, y), *beta = l.beta.row(0, y);
            decode(level, y, kConfidence, 2, logits);
            for (int64_t x = 0; x < l.v.w; x++) {
                c[x] = fast_exp(logits[x] + T(k.confidence));
                beta[x] = 1 / (1 + fast_exp(-(logits[stride(level) + x] + T(k.blend))));
            }
            for (int j = 1; j < kPlanes; j++) {
                T *i = l.v.row(j, y);
                for (int64_t x = 0; x < l.v.w; x++)
                    i[x] *= c[x];
            }
        }
        for (int64_t y = 0; y < l.v.h; y++) {
            weights(level, y, 0, row(0));
            filter_row(row(0), stride(level), l.v, l.s, y);
        }
    }

    // The radiance of level + 1: v's sums over 2x2 pixels, divided by that of the confidences. Zeros
    // outside stand for pixels that are not there.
    void pool(int level) {
        const Planes<T> &v = t.levels[level].v, &small = t.levels[level + 1].v;
        for (int64_t y = 0; y < small.h; y++) {
            for (int j = 0; j < kPlanes; j++) {
                const T *a = v.row(j, 2 * y), *b = v.row(j, 2 * y + 1), *sum = small.row(0, y);
                T *to = small.row(j, y);
                for (int64_t x = 0; x < small.w; x++)
                    to[x] = a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1];
                for (int64_t x = 0; j && x < small.w; x++)
                    to[x] /= sum[x];
            }
        }
    }

    void blend(int level) {
        Level<T> &l = t.levels[level];
        if (level == kLevels - 1) {
            for (int c = 0; c < 3; c++)
                for (int64_t y = 0; y < l.v.h; y++)
                    for (int64_t x = 0; x < l.v.w; x++)
                        l.out.row(c, y)[x] = l.s.row(c + 1, y)[x] / l.s.row(0, y)[x];
            return;
        }
        Upsampler<T> u(t.levels[level + 1].out);
        for (int64_t y = 0; y < l.v.h; y++)
            for (int c = 0; c < 3; c++) {
                const T *low = u.up(c, y), *s = l.s.row(c + 1, y), *sum = l.s.row(0, y);
                const T *beta = l.beta.row(0, y);
                T *out = l.out.row(c, y);
                for (int64_t x = 0; x < l.v.w; x++) {
                    const T f = s[x] / sum[x];
                    out[x] = f + beta[x] * (low[x] - f);
                }
            }
    }

    void forward() {
        for (Level<T> &l : t.levels)
            l.v.clear();
        demodulate();
        for (int level = 0; level < kLevels; level++) {
            filter(level);
            if (level + 1 < kLevels)
                pool(level);
        }
        for (int level = kLevels - 1; level >= 0; level--)
            blend(level);
        for (int c = 0; c < 3; c++)
            for (int64_t y = 0; y < h; y++) {
                const T *out = t.levels[0].out.row(c, y), *smooth = t.smooth.row(c, y);
                T *to = b.out + ((n * 3 + c) * h + y) * w;
                for (int64_t x = 0; x < w; x++)
                    to[x] = out[x] * smooth[x];
            }
    }

    // gs of a level from its gout, the gradient of its blend logits, and gout of the next level.
    void blend_backward(int level) {
        Level<T> &l = t.levels[level];
        const bool last = level == kLevels - 1;
        Upsampler<T> u(last ? l.gout : t.levels[level + 1].gout);
        l.gs.clear();
        for (int64_t y = 0; y < l.v.h; y++) {
            const T *sum = l.s.row(0, y), *beta = l.beta.row(0, y);
            T *gsum = l.gs.row(0, y), *logit = row(0);
            std::fill_n(logit, l.v.w, T(0));
            for (int c = 0; c < 3; c++) {
                const T *s = l.s.row(c + 1, y), *out = l.out.row(c, y), *g = l.gout.row(c, y);
                T *gs = l.gs.row(c + 1, y), *gu = u.gradient();
                for (int64_t x = 0; x < l.v.w; x++) {
                    const T keep = last ? T(1) : 1 - beta[x], inverse = 1 / sum[x];
                    const T f = s[x] * inverse;
                    gs[x] = g[x] * keep * inverse;
                    gsum[x] -= gs[x] * f;
                    logit[x] += g[x] * keep * (out[x] - f);
                }
                if (last)
                    continue;
                for (int64_t x = 0; x < l.v.w; x++)
                    gu[x] = g[x] * beta[x];
                u.down(c, y, l.v.w);
            }
            encode(level, y, kBlend, 1, logit);
        }
    }

    // Gradients of the kernel's logits, and gv.
    void filter_backward(int level) {
        const Level<T> &l = t.levels[level];
        for (int64_t y = 0; y < l.v.h + kRadius; y++) {
            T *e = row(y % kSide);
            if (y < l.v.h) {
                weights(level, y, 0, e);
                logits_row(e, stride(level), l.v, l.gs, y, row(kSide));
                encode(level, y, 0, kTaps, row(kSide));
            }
            if (y < kRadius)
                continue;
            std::array<const T *, kSide> rows;  // gs is 0 in those outside
            for (int64_t dy = 0; dy < kSide; dy++)
                rows[dy] = row((y + kSide - dy) % kSide);
            values_row(rows, stride(level), l.gs, l.gv, y - kRadius);
        }
    }

    // The radiance of level + 1, whose gradient is in the last planes of its gv, came from v.
    void pool_backward(int level) {
        const Level<T> &fine = t.levels[level], &l = t.levels[level + 1];
        std::vector<T> g(l.v.w), gsum(l.v.w), inverse(l.v.w);
        for (int64_t y = 0; y < l.v.h; y++) {
            const T *a = fine.v.row(0, 2 * y), *b = fine.v.row(0, 2 * y + 1), *c = l.v.row(0, y);
            for (int64_t x = 0; x < l.v.w; x++) {
                inverse[x] = 1 / (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
                gsum[x] = 0;
            }
            const auto spread = [&](int plane, const T *values) {
                for (int64_t yy = 2 * y; yy < std::min(2 * y + 2, fine.v.h); yy++) {
                    T *to = fine.gv.row(plane, yy);
                    for (int64_t x = 0; x < l.v.w; x++) {  // past an odd width lies the border
                        to[2 * x] += values[x];
                        to[2 * x + 1] += values[x];
                    }
                }
            };
            for (int j = 1; j < kPlanes; j++) {
                const T *gi = l.gv.row(j, y), *ci = l.v.row(j, y);
                for (int64_t x = 0; x < l.v.w; x++) {
                    g[x] = gi[x] * inverse[x];
                    gsum[x] -= g[x] * ci[x] / c[x];
                }
                spread(j, g.data());
            }
            spread(0, gsum.data());
        }
    }

    // From gv to the gradients of the confidence's logits and (in place) of the radiance.
    void confidence_backward(int level) {
        const Level<T> &l = t.levels[level];
        for (int64_t y = 0; y < l.v.h; y++) {
            const T *c = l.v.row(0, y), *gc = l.gv.row(0, y);
            T *logit = row(0);
            for (int64_t x = 0; x < l.v.w; x++)
                logit[x] = gc[x] * c[x];
            for (int j = 1; j < kPlanes; j++) {
                const T *ci = l.v.row(j, y);
                T *g = l.gv.row(j, y);
                for (int64_t x = 0; x < l.v.w; x++) {
                    logit[x] += g[x] * ci[x];
                    g[x] *= c[x];
                }
            }
            encode(level, y, kConfidence, 1, logit);
        }
    }

    // The albedo's kernel, from the gradient of the result and of the radiance of level 0.
    void demodulate_backward() {
        const Level<T> &l = t.levels[0];
        t.gsums.clear();
        for (int64_t y = 0; y < h; y++) {
            const T *has = plane(b.has, 1, 0, y), *sum = t.sums.row(0, y), *cc = l.v.row(0, y);
            T *gsum = t.gsums.row(0, y);
            for (int c = 0; c < 3; c++) {
                const T *s = t.sums.row(c + 1, y), *smooth = t.smooth.row(c, y);
                const T *ci = l.v.row(c + 1, y), *gi = l.gv.row(c + 1, y), *g = t.gsmooth.row(c, y);
                T *gs = t.gsums.row(c + 1, y);
                for (int64_t x = 0; x < w; x++) {
                    const T total = g[x] - gi[x] * ci[x] / (cc[x] * smooth[x]);
                    gs[x] = has[x] * total / sum[x];
                    gsum[x] -= gs[x] * s[x] / sum[x];
                }
            }
            weights(0, y, kAlbedo, row(0));
            logits_row(row(0), stride(0), t.albedo, t.gsums, y, row(1));
            encode(0, y, kAlbedo, kTaps, row(1));
        }
    }

    void backward() {
        for (int level = 1; level < kLevels; level++)
            t.levels[level].gout.clear();
        for (int c = 0; c < 3; c++)
            for (int64_t y = 0; y < h; y++) {
                const T *g = plane(b.gout, 3, c, y), *smooth = t.smooth.row(c, y);
                const T *out = t.levels[0].out.row(c, y);
                T *gout = t.levels[0].gout.row(c, y), *gsmooth = t.gsmooth.row(c, y);
                for (int64_t x = 0; x < w; x++) {
                    gout[x] = g[x] * smooth[x];
                    gsmooth[x] = g[x] * out[x];
                }
            }
        for (int level = 0; level < kLevels; level++)
            blend_backward(level);
        for (int level = kLevels - 1; level >= 0; level--) {
            filter_backward(level);
            if (level + 1 < kLevels)
                pool_backward(level);
            confidence_backward(level);
        }
        demodulate_backward();
    }
};

// Heads of any type; images and the tape in the type of the arithmetic.
template <typename Q> using Arithmetic = std::conditional_t<std::is_same_v<Q, double>, double, float>;

template <typename Q>
auto batch(const std::vector<torch::Tensor> &heads, const torch::Tensor &radiance,
           const torch::Tensor &albedo, const torch::Tensor &has) {
    using T = Arithmetic<Q>;
    Batch<Q, T> b{};
    int64_t h = radiance.size(2), w = radiance.size(3);
    TORCH_CHECK(heads.size() == kLevels, "five heads");
    for (int i = 0; i < kLevels; i++, h = (h + 1) / 2, w = (w + 1) / 2) {
        const torch::Tensor &q = heads[i];
        TORCH_CHECK(q.is_contiguous(at::MemoryFormat::ChannelsLast) && q.size(2) == h && q.size(3) == w &&
                        q.size(0) == radiance.size(0) && q.size(1) == (i ? kAlbedo : kAlbedo + kTaps),
                    "head ", i, " does not fit");
        b.heads[i] = q.data_ptr<Q>();
        b.channels[i] = q.size(1);
    }
    for (const torch::Tensor *image : {&radiance, &albedo, &has})
        TORCH_CHECK(image->is_contiguous(), "images are contiguous");
    b.radiance = radiance.data_ptr<T>();
    b.albedo = albedo.data_ptr<T>();
    b.has = has.data_ptr<T>();
    return b;
}

template <typename Q, typename F>
void for_images(const Batch<Q, Arithmetic<Q>> &b, const Constants &k, const torch::Tensor &radiance,
                torch::Tensor kept, F f) {
    using T = Arithmetic<Q>;
    at::parallel_for(0, radiance.size(0), 1, [&](int64_t begin, int64_t end) {
        Tape<T> tape(radiance.size(2), radiance.size(3));
        std::vector<T> work(tape.size);
        for (int64_t n = begin; n < end; n++) {
            tape.place(kept.data_ptr<T>() + n * tape.kept, work.data());
            f(Image<Q, T>(b, k, tape, n));
        }
    });
}

}  // namespace

// {result, tape}
std::vector<torch::Tensor> filter(std::vector<torch::Tensor> heads, torch::Tensor radiance,
                                   torch::Tensor albedo, torch::Tensor has,
                                   std::array<double, 5> constants, bool whole) {
    const Constants k{{constants[0], whole}, constants[1], constants[2], constants[3], constants[4]};
    torch::Tensor out = torch::empty_like(radiance), kept;
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, heads[0].scalar_type(), "filter", [&] {
        using T = Arithmetic<scalar_t>;
        auto b = batch<scalar_t>(heads, radiance, albedo, has);
        b.out = out.data_ptr<T>();
        kept = torch::empty({out.size(0), Tape<T>(out.size(2), out.size(3)).kept}, out.options());
        for_images<scalar_t>(b, k, radiance, kept, [](auto image) { image.forward(); });
    });
    return {out, kept};
}

// Gradients of the heads.
std::vector<torch::Tensor> filter_backward(std::vector<torch::Tensor> heads, torch::Tensor radiance,
                                    torch::Tensor albedo, torch::Tensor has, torch::Tensor kept,
                                    torch::Tensor gout, std::array<double, 5> constants, bool whole) {
    const Constants k{{constants[0], whole}, constants[1], constants[2], constants[3], constants[4]};
    std::vector<torch::Tensor> gradients;
    for (const torch::Tensor &q : heads)
        gradients.push_back(torch::empty_like(q));
    gout = gout.contiguous();
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, heads[0].scalar_type(), "filter_backward", [&] {
        auto b = batch<scalar_t>(heads, radiance, albedo, has);
        b.gout = gout.data_ptr<Arithmetic<scalar_t>>();
        for (int i = 0; i < kLevels; i++)
            b.gradients[i] = gradients[i].data_ptr<scalar_t>();
        for_images<scalar_t>(b, k, radiance, kept, [](auto image) { image.backward(); });
    });
    return gradients;
}

PYBIND11_MODULE(TORCH_EXTENSION_NAME, m) {
    m.def("filter", &filter);
    m.def("filter_backward", &filter_backward);
}
