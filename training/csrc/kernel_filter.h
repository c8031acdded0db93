// The filter of family K (docs/kernel-prediction.md, section Filter) with its derivatives by the
// heads, one image after the other, row by row: no tensor of weights is ever written.
//
// Images are kept as planes in fp32 (or fp64, for tests) with a border of zeros; heads are read,
// and their gradients written, as the convolutions have them: [N,H,W,C] in memory, bf16, fp32 or
// fp64.
#pragma once

#include "kernel_rows.h"

namespace
{

template <typename T> struct Level {
    Planes<T> v, s, out, beta;      // confidence and weighted radiance, their sums, blended result,
                                    // weight
    Planes<T> gs, gv, gout, gblend; // gradients
};

// What forward leaves for backward, and the gradients' work space, of one image.
template <typename T> struct Tape {
    std::array<Level<T>, kLevels> levels;
    Planes<T> albedo, sums, smooth; // (1, albedo), filtered; what multiplies the result
    Planes<T> gsums, gsmooth;
    int64_t kept = 0, size = 0;

    Tape(int64_t h, int64_t w)
    {
        for (Level<T> &l : levels) {
            l.v = l.s = l.gs = l.gv = Planes<T>(kPlanes, h, w);
            l.out = l.gout = Planes<T>(3, h, w);
            l.beta = l.gblend = Planes<T>(1, h, w);
            h = (h + 1) / 2;
            w = (w + 1) / 2;
        }
        albedo = sums = gsums = levels[0].v;
        smooth = gsmooth = levels[0].out;
        place(nullptr, nullptr);
    }
    void place(T *kept_memory, T *work)
    {
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
            for (Planes<T> *p : {&l.gs, &l.gv, &l.gout, &l.gblend})
                take(*p, work, size);
        }
    }
};

template <typename T> struct Constants {
    Codes<T> codes;
    double eps, radiance_max, confidence, blend; // the last two are added to the logits
    double noise_gain, noise_eps;                // of the noise codes
    double least_slope;                          // of a blend weight by its logit, in gradients
};

// Planar images, so many elements apart.
template <typename T> struct Pictures {
    const T *base;
    int64_t batch;
};

// The batch as it comes.
template <typename Q, typename T> struct Batch {
    std::array<const Q *, kLevels> heads;
    std::array<Q *, kLevels> gradients;
    std::array<int64_t, kLevels> channels;
    Pictures<T> radiance, albedo, has, gout;
    T *out, *last; // the result; what multiplied it, and the noise codes, in one more plane
};

template <typename Q, typename T> struct Image {
    const Batch<Q, T> &b;
    const Constants<T> &k;
    Tape<T> &t;
    const int64_t n, h, w;
    // Rows of kTaps channels: those of a filter's weights, and two for anything else.
    static constexpr int kScratch = kSide, kSlots = kSide + 2;
    std::vector<T> buffer;

    Image(const Batch<Q, T> &b, const Constants<T> &k, Tape<T> &t, int64_t n)
        : b(b), k(k), t(t), n(n), h(t.albedo.h), w(t.albedo.w),
          buffer(kTaps * t.albedo.stride * kSlots + 2 * kLanes<T>)
    {
    }

    T *row(int slot) { return buffer.data() + kLanes<T> + slot * kTaps * t.albedo.stride; }
    int64_t stride(int level) const { return t.levels[level].v.stride; }
    int64_t at(int level, int64_t y) const
    {
        const Planes<T> &p = t.levels[level].v;
        return (n * p.h + y) * p.w * b.channels[level];
    }
    void weights(int level, int64_t y, int first, T *to) const
    {
        k.codes.weights(b.heads[level] + at(level, y) + first, b.channels[level],
                        t.levels[level].v.w, to, stride(level));
    }
    void weights_backward(int level, int64_t y, int first, const T *from) const
    {
        const int64_t q = at(level, y) + first;
        k.codes.gradients(b.heads[level] + q, b.channels[level], t.levels[level].v.w, from,
                          stride(level), b.gradients[level] + q);
    }
    // One channel.
    void logits(int level, int64_t y, int channel, T *to) const
    {
        const Q *q = b.heads[level] + at(level, y) + channel;
#pragma GCC ivdep
        for (int64_t x = 0; x < t.levels[level].v.w; x++)
            to[x] = k.codes.logit(T(q[x * b.channels[level]]));
    }
    void logits_backward(int level, int64_t y, int channel, const T *from) const
    {
        const int64_t q = at(level, y) + channel, c = b.channels[level];
#pragma GCC ivdep
        for (int64_t x = 0; x < t.levels[level].v.w; x++)
            b.gradients[level][q + x * c] =
                Q(k.codes.passed(T(b.heads[level][q + x * c]), from[x]));
    }
    const T *plane(const Pictures<T> &images, int c, int64_t y) const
    {
        return images.base + n * images.batch + (c * h + y) * w;
    }

    // v of level 0, a row: the radiance over the smoothed albedo.
    void demodulate(int64_t y)
    {
        weights(0, y, kAlbedo, row(0));
        filter_row(row(0), stride(0), t.albedo, t.sums, y);
        const T *has = plane(b.has, 0, y), *sum = t.sums.row(0, y);
        for (int c = 0; c < 3; c++) {
            const T *s = t.sums.row(c + 1, y), *r = plane(b.radiance, c, y);
            T *smooth = t.smooth.row(c, y), *i = t.levels[0].v.row(c + 1, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < w; x++) {
                smooth[x] = has[x] * s[x] / sum[x] + T(1 - k.eps) * (1 - has[x]) + T(k.eps);
                i[x] = std::min(std::max(r[x], T(0)), T(k.radiance_max)) / smooth[x];
            }
        }
    }

    // v of another level: sums over 2x2 pixels of the finer one's, divided by that of the
    // confidences. Zeros outside stand for pixels that are not there.
    void pool(int level, int64_t y)
    {
        const Planes<T> &fine = t.levels[level - 1].v, &v = t.levels[level].v;
        for (int j = 0; j < kPlanes; j++) {
            const T *p = fine.row(j, 2 * y), *q = fine.row(j, 2 * y + 1), *sum = v.row(0, y);
            T *to = v.row(j, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < v.w; x++)
                to[x] = p[2 * x] + p[2 * x + 1] + q[2 * x] + q[2 * x + 1];
#pragma GCC ivdep
            for (int64_t x = 0; j && x < v.w; x++)
                to[x] /= sum[x];
        }
    }

    // Makes of the radiance in the last planes of v what is filtered; beta.
    void confidence(int level, int64_t y)
    {
        const Level<T> &l = t.levels[level];
        T *c = l.v.row(0, y), *beta = l.beta.row(0, y);
        logits(level, y, kConfidence, c);
        logits(level, y, kBlend, beta);
#pragma GCC ivdep
        for (int64_t x = 0; x < l.v.w; x++) {
            c[x] = fast_exp(c[x] + T(k.confidence));
            beta[x] = 1 / (1 + fast_exp(-(beta[x] + T(k.blend))));
        }
        for (int j = 1; j < kPlanes; j++) {
            T *i = l.v.row(j, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < l.v.w; x++)
                i[x] *= c[x];
        }
    }

    void blend(int level)
    {
        Level<T> &l = t.levels[level];
        const bool last = level == kLevels - 1;
        Upsampler<T> u(last ? l.out : t.levels[level + 1].out);
        for (int64_t y = 0; y < l.v.h; y++)
            for (int c = 0; c < 3; c++) {
                const T *low = last ? l.s.row(c + 1, y) : u.up(c, y), *beta = l.beta.row(0, y);
                const T *s = l.s.row(c + 1, y), *sum = l.s.row(0, y);
                T *out = l.out.row(c, y);
#pragma GCC ivdep
                for (int64_t x = 0; x < l.v.w; x++) {
                    const T f = s[x] / sum[x];
                    out[x] = f + (last ? T(0) : beta[x] * (low[x] - f));
                }
            }
    }

    void forward()
    {
        t.albedo.clear();
        for (int64_t y = 0; y < h; y++) {
            std::fill_n(t.albedo.row(0, y), w, T(1));
            for (int c = 0; c < 3; c++)
                std::copy_n(plane(b.albedo, c, y), w, t.albedo.row(c + 1, y));
        }
        for (int level = 0; level < kLevels; level++) {
            const Level<T> &l = t.levels[level];
            l.v.clear();
            for (int64_t y = 0; y < l.v.h + kRadius; y++) {
                if (y < l.v.h) {
                    if (level)
                        pool(level, y);
                    else
                        demodulate(y);
                    confidence(level, y);
                }
                if (y >= kRadius) {
                    weights(level, y - kRadius, 0, row(0));
                    filter_row(row(0), stride(level), l.v, l.s, y - kRadius);
                }
            }
        }
        for (int level = kLevels - 1; level >= 0; level--)
            blend(level);
        for (int c = 0; c < 3; c++)
            for (int64_t y = 0; y < h; y++) {
                const T *out = t.levels[0].out.row(c, y), *smooth = t.smooth.row(c, y);
                T *to = b.out + ((n * 3 + c) * h + y) * w;
#pragma GCC ivdep
                for (int64_t x = 0; x < w; x++)
                    to[x] = out[x] * smooth[x];
                std::copy_n(smooth, w, b.last + ((n * 4 + c) * h + y) * w);
            }
        for (int64_t y = 0; y < h; y++)
            noise(y, b.last + ((n * 4 + 3) * h + y) * w);
    }

    // How far the demodulated input is from its 5x5 means, relative to them.
    void noise(int64_t y, T *to)
    {
        const Level<T> &l = t.levels[0];
        const T *c = l.v.row(0, y), *sum = l.s.row(0, y), *v[3], *s[3];
        for (int j = 0; j < 3; j++) {
            v[j] = l.v.row(j + 1, y);
            s[j] = l.s.row(j + 1, y);
        }
#pragma GCC ivdep
        for (int64_t x = 0; x < w; x++) {
            T apart = 0, mean = 0;
            for (int j = 0; j < 3; j++) {
                apart += std::abs(v[j][x] / c[x] - s[j][x] / sum[x]);
                mean += s[j][x] / sum[x];
            }
            const T code = std::floor(T(k.noise_gain) * (apart / (mean + T(k.noise_eps))) + T(0.5));
            to[x] = std::min(code, T(255));
        }
    }

    // gs of a level from its gout, the gradient of its blend logits, and gout of the next level.
    void blend_backward(int level)
    {
        Level<T> &l = t.levels[level];
        const bool last = level == kLevels - 1;
        Upsampler<T> u(last ? l.gout : t.levels[level + 1].gout);
        l.gs.clear();
        for (int64_t y = 0; y < l.v.h; y++) {
            const T *sum = l.s.row(0, y), *beta = l.beta.row(0, y);
            T *gsum = l.gs.row(0, y), *logit = l.gblend.row(0, y), *slope = row(kScratch);
            std::fill_n(logit, l.v.w, T(0));
#pragma GCC ivdep
            for (int64_t x = 0; x < l.v.w; x++) // of beta, over beta
                slope[x] = std::max(1 - beta[x], T(k.least_slope) / beta[x]);
            for (int c = 0; c < 3; c++) {
                const T *s = l.s.row(c + 1, y), *out = l.out.row(c, y), *g = l.gout.row(c, y);
                T *gs = l.gs.row(c + 1, y), *gu = u.gradient();
#pragma GCC ivdep
                for (int64_t x = 0; x < l.v.w; x++) {
                    const T keep = last ? T(1) : 1 - beta[x], inverse = 1 / sum[x];
                    const T f = s[x] * inverse;
                    gs[x] = g[x] * keep * inverse;
                    gsum[x] -= gs[x] * f;
                    logit[x] += g[x] * slope[x] * (out[x] - f);
                }
                if (last)
                    continue;
#pragma GCC ivdep
                for (int64_t x = 0; x < l.v.w; x++)
                    gu[x] = g[x] * beta[x];
                u.down(c, y, l.v.w);
            }
        }
    }

    // What reaches v by way of the next level, whose gradient by the radiance is in the last planes
    // of gv.
    void pool_backward(int level, int64_t y)
    {
        const Level<T> &fine = t.levels[level], &l = t.levels[level + 1];
        const T *p = fine.v.row(0, y & ~1), *q = fine.v.row(0, y | 1), *c = l.v.row(0, y / 2);
        T *inverse = row(kScratch), *g = inverse + t.albedo.stride, *gsum = g + t.albedo.stride;
#pragma GCC ivdep
        for (int64_t x = 0; x < l.v.w; x++) {
            inverse[x] = 1 / (p[2 * x] + p[2 * x + 1] + q[2 * x] + q[2 * x + 1]);
            gsum[x] = 0;
        }
        const auto spread = [&](int plane, const T *values) {
            T *to = fine.gv.row(plane, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < l.v.w; x++) { // past an odd width lies the border
                to[2 * x] += values[x];
                to[2 * x + 1] += values[x];
            }
        };
        for (int j = 1; j < kPlanes; j++) {
            const T *gi = l.gv.row(j, y / 2), *ci = l.v.row(j, y / 2);
#pragma GCC ivdep
            for (int64_t x = 0; x < l.v.w; x++) {
                g[x] = gi[x] * inverse[x];
                gsum[x] -= g[x] * ci[x] / c[x];
            }
            spread(j, g);
        }
        spread(0, gsum);
    }

    // From gv to the gradients of the confidence's logits and (in place) of the radiance.
    void confidence_backward(int level, int64_t y)
    {
        const Level<T> &l = t.levels[level];
        const T *c = l.v.row(0, y), *gc = l.gv.row(0, y);
        T *logit = row(kScratch);
#pragma GCC ivdep
        for (int64_t x = 0; x < l.v.w; x++)
            logit[x] = gc[x] * c[x];
        for (int j = 1; j < kPlanes; j++) {
            const T *ci = l.v.row(j, y);
            T *g = l.gv.row(j, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < l.v.w; x++) {
                logit[x] += g[x] * ci[x];
                g[x] *= c[x];
            }
        }
        logits_backward(level, y, kConfidence, logit);
        logits_backward(level, y, kBlend, l.gblend.row(0, y));
    }

    // The albedo's kernel, from the gradient of the result and of the radiance of level 0.
    void demodulate_backward(int64_t y)
    {
        const Level<T> &l = t.levels[0];
        const T *has = plane(b.has, 0, y), *sum = t.sums.row(0, y), *cc = l.v.row(0, y);
        T *gsum = t.gsums.row(0, y), *e = row(kScratch), *logits = row(kScratch + 1);
        std::fill_n(gsum, w, T(0));
        for (int c = 0; c < 3; c++) {
            const T *s = t.sums.row(c + 1, y), *smooth = t.smooth.row(c, y);
            const T *ci = l.v.row(c + 1, y), *gi = l.gv.row(c + 1, y), *g = t.gsmooth.row(c, y);
            T *gs = t.gsums.row(c + 1, y);
#pragma GCC ivdep
            for (int64_t x = 0; x < w; x++) {
                const T total = g[x] - gi[x] * ci[x] / (cc[x] * smooth[x]);
                gs[x] = has[x] * total / sum[x];
                gsum[x] -= gs[x] * s[x] / sum[x];
            }
        }
        weights(0, y, kAlbedo, e);
        logits_row(e, stride(0), t.albedo, t.gsums, y, logits);
        weights_backward(0, y, kAlbedo, logits);
    }

    // Gradients of a level's head, and gv.
    void level_backward(int level)
    {
        const Level<T> &l = t.levels[level];
        for (int64_t y = 0; y < l.v.h + kRadius; y++) {
            if (y < l.v.h) {
                T *e = row(y % kSide);
                weights(level, y, 0, e);
                logits_row(e, stride(level), l.v, l.gs, y, row(kScratch));
                weights_backward(level, y, 0, row(kScratch));
            }
            if (y < kRadius)
                continue;
            std::array<const T *, kSide> rows; // gs is 0 in those outside
            for (int64_t dy = 0; dy < kSide; dy++)
                rows[dy] = row((y + kSide - dy) % kSide);
            values_row(rows, stride(level), l.gs, l.gv, y - kRadius);
            if (level + 1 < kLevels)
                pool_backward(level, y - kRadius);
            confidence_backward(level, y - kRadius);
            if (!level)
                demodulate_backward(y - kRadius);
        }
    }

    void backward()
    {
        for (int level = 1; level < kLevels; level++)
            t.levels[level].gout.clear();
        for (int c = 0; c < 3; c++)
            for (int64_t y = 0; y < h; y++) {
                const T *g = plane(b.gout, c, y), *smooth = t.smooth.row(c, y);
                const T *out = t.levels[0].out.row(c, y);
                T *gout = t.levels[0].gout.row(c, y), *gsmooth = t.gsmooth.row(c, y);
#pragma GCC ivdep
                for (int64_t x = 0; x < w; x++) {
                    gout[x] = g[x] * smooth[x];
                    gsmooth[x] = g[x] * out[x];
                }
            }
        for (int level = 0; level < kLevels; level++)
            blend_backward(level);
        for (int level = kLevels - 1; level >= 0; level--)
            level_backward(level);
    }
};

} // namespace
