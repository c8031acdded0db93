// The operations of family K that are slow as chains of PyTorch's, with their derivatives.
//
// forward, backward: sums of a 5x5 kernel per pixel, out[c](p) = sum_k exp(l[k](p)) v[c](p + k), zeros
// outside. Planar rows, one tap at a time, so that the inner loops run over x and vectorise.
//
// split, join: the channels of a head, [N,H,W,C] as a convolution leaves them, rounded to whole codes
// and taken apart into planar tensors.
#include <torch/extension.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace {

constexpr int kSide = 5, kRadius = 2, kTaps = kSide * kSide;

struct Shape {
    int64_t n, c, h, w;
};

Shape check(const torch::Tensor &l, const torch::Tensor &v) {
    TORCH_CHECK(l.dim() == 4 && v.dim() == 4 && l.size(1) == kTaps, "l is [N,25,H,W], v [N,C,H,W]");
    TORCH_CHECK(l.size(0) == v.size(0) && l.size(2) == v.size(2) && l.size(3) == v.size(3),
                "l and v differ in size");
    TORCH_CHECK(l.is_contiguous() && v.is_contiguous() && l.scalar_type() == v.scalar_type(),
                "l and v are contiguous and of one type");
    return {v.size(0), v.size(1), v.size(2), v.size(3)};
}

// Calls f(tap, y of the source, first x, last x + 1, dx) for the taps of row y that lie inside.
template <typename F> void for_taps(const Shape &s, int64_t y, F f) {
    for (int k = 0; k < kTaps; k++) {
        const int64_t dy = k / kSide - kRadius, dx = k % kSide - kRadius;
        if (y + dy < 0 || y + dy >= s.h)
            continue;
        f(k, y + dy, std::max<int64_t>(0, -dx), std::min<int64_t>(s.w, s.w - dx), dx);
    }
}

template <typename T> void forward_rows(const Shape &s, const T *l, const T *v, T *out, int64_t row) {
    const int64_t n = row / s.h, y = row % s.h, plane = s.h * s.w;
    std::vector<T> e(s.w);
    for_taps(s, y, [&](int k, int64_t ys, int64_t x0, int64_t x1, int64_t dx) {
        const T *lk = l + (n * kTaps + k) * plane + y * s.w;
        for (int64_t x = x0; x < x1; x++)
            e[x] = std::exp(lk[x]);
        for (int64_t c = 0; c < s.c; c++) {
            const T *vs = v + (n * s.c + c) * plane + ys * s.w + dx;
            T *o = out + (n * s.c + c) * plane + y * s.w;
            for (int64_t x = x0; x < x1; x++)
                o[x] += e[x] * vs[x];
        }
    });
}

// One image: rows scatter into their neighbours' gradients, so images, not rows, run in parallel.
template <typename T>
void backward_image(const Shape &s, const T *l, const T *v, const T *g, T *gl, T *gv, int64_t n) {
    const int64_t plane = s.h * s.w;
    std::vector<T> e(s.w), d(s.w);
    for (int64_t y = 0; y < s.h; y++)
        for_taps(s, y, [&](int k, int64_t ys, int64_t x0, int64_t x1, int64_t dx) {
            const T *lk = l + (n * kTaps + k) * plane + y * s.w;
            T *glk = gl + (n * kTaps + k) * plane + y * s.w;
            for (int64_t x = x0; x < x1; x++) {
                e[x] = std::exp(lk[x]);
                d[x] = 0;
            }
            for (int64_t c = 0; c < s.c; c++) {
                const T *vs = v + (n * s.c + c) * plane + ys * s.w + dx;
                T *gs = gv + (n * s.c + c) * plane + ys * s.w + dx;
                const T *go = g + (n * s.c + c) * plane + y * s.w;
                for (int64_t x = x0; x < x1; x++) {
                    d[x] += go[x] * vs[x];
                    gs[x] += e[x] * go[x];
                }
            }
            for (int64_t x = 0; x < x0; x++)
                glk[x] = 0;
            for (int64_t x = x0; x < x1; x++)
                glk[x] = e[x] * d[x];
            for (int64_t x = x1; x < s.w; x++)
                glk[x] = 0;
        });
    for (int64_t k = 0; k < kTaps; k++)  // rows whose tap lies outside
        for (int64_t y = 0; y < s.h; y++) {
            const int64_t ys = y + k / kSide - kRadius;
            if (ys < 0 || ys >= s.h)
                std::fill_n(gl + (n * kTaps + k) * plane + y * s.w, s.w, T(0));
        }
}

// Channels-last rows and planar ones meet in blocks of pixels small enough for the first-level cache:
// arithmetic runs over whole blocks, and only the exchange of the two orders goes with a stride.
constexpr int64_t kBlock = 32;

// A head's q [N,C,H,W] in channels-last memory to codes floor(clamp(q * step, 0, 255) + 0.5) / step, of
// which each part takes its channels; parts: row pointers and channel counts of planar tensors.
template <typename Q>
void split_row(const Q *q, const std::vector<float *> &parts, const std::vector<int64_t> &counts,
               int64_t w, int64_t c, int64_t plane, float step, float *block) {
    for (int64_t x0 = 0; x0 < w; x0 += kBlock) {
        const int64_t size = std::min(kBlock, w - x0);
        for (int64_t i = 0; i < size * c; i++) {
            const float v = std::min(std::max(float(q[x0 * c + i]) * step, 0.0f), 255.0f);
            block[i] = std::floor(v + 0.5f) / step;
        }
        const float *from = block;
        for (size_t part = 0; part < counts.size(); part++)
            for (int64_t k = 0; k < counts[part]; k++, from++) {
                float *to = parts[part] + k * plane + x0;
                for (int64_t x = 0; x < size; x++)
                    to[x] = from[x * c];
            }
    }
}

// The gradient passes where the code was not clamped.
template <typename Q>
void join_row(const Q *q, const std::vector<const float *> &grads, const std::vector<int64_t> &counts,
              Q *gq, int64_t w, int64_t c, int64_t plane, float step, float *block) {
    for (int64_t x0 = 0; x0 < w; x0 += kBlock) {
        const int64_t size = std::min(kBlock, w - x0);
        float *to = block;
        for (size_t part = 0; part < counts.size(); part++)
            for (int64_t k = 0; k < counts[part]; k++, to++) {
                const float *from = grads[part] + k * plane + x0;
                for (int64_t x = 0; x < size; x++)
                    to[x * c] = from[x];
            }
        for (int64_t i = 0; i < size * c; i++) {
            const float v = float(q[x0 * c + i]) * step;
            gq[x0 * c + i] = Q(v >= 0.0f && v <= 255.0f ? block[i] : 0.0f);
        }
    }
}

}  // namespace

torch::Tensor forward(torch::Tensor l, torch::Tensor v) {
    const Shape s = check(l, v);
    torch::Tensor out = torch::zeros_like(v);
    AT_DISPATCH_FLOATING_TYPES(v.scalar_type(), "kernel_filter", [&] {
        at::parallel_for(0, s.n * s.h, 16, [&](int64_t begin, int64_t end) {
            for (int64_t row = begin; row < end; row++)
                forward_rows<scalar_t>(s, l.data_ptr<scalar_t>(), v.data_ptr<scalar_t>(),
                                       out.data_ptr<scalar_t>(), row);
        });
    });
    return out;
}

std::vector<torch::Tensor> backward(torch::Tensor l, torch::Tensor v, torch::Tensor g) {
    const Shape s = check(l, v);
    torch::Tensor gl = torch::empty_like(l), gv = torch::zeros_like(v);
    g = g.contiguous();
    AT_DISPATCH_FLOATING_TYPES(v.scalar_type(), "kernel_filter_backward", [&] {
        at::parallel_for(0, s.n, 1, [&](int64_t begin, int64_t end) {
            for (int64_t n = begin; n < end; n++)
                backward_image<scalar_t>(s, l.data_ptr<scalar_t>(), v.data_ptr<scalar_t>(),
                                         g.data_ptr<scalar_t>(), gl.data_ptr<scalar_t>(),
                                         gv.data_ptr<scalar_t>(), n);
        });
    });
    return {gl, gv};
}

std::vector<torch::Tensor> split(torch::Tensor q, std::vector<int64_t> counts, double step) {
    TORCH_CHECK(q.dim() == 4 && q.is_contiguous(at::MemoryFormat::ChannelsLast), "q is channels-last");
    const int64_t n = q.size(0), c = q.size(1), h = q.size(2), w = q.size(3);
    TORCH_CHECK(std::accumulate(counts.begin(), counts.end(), int64_t(0)) == c, "counts add up to C");
    std::vector<torch::Tensor> parts;
    for (int64_t count : counts)
        parts.push_back(torch::empty({n, count, h, w}, q.options().dtype(torch::kFloat)));
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, q.scalar_type(), "split_head", [&] {
        const scalar_t *in = q.data_ptr<scalar_t>();
        at::parallel_for(0, n * h, 8, [&](int64_t begin, int64_t end) {
            std::vector<float> block(kBlock * c);
            std::vector<float *> rows(counts.size());
            for (int64_t row = begin; row < end; row++) {
                for (size_t i = 0; i < counts.size(); i++)
                    rows[i] = parts[i].data_ptr<float>() + (row / h * counts[i] * h + row % h) * w;
                split_row(in + row * w * c, rows, counts, w, c, h * w, float(step), block.data());
            }
        });
    });
    return parts;
}

torch::Tensor join(torch::Tensor q, std::vector<torch::Tensor> grads, double step) {
    const int64_t n = q.size(0), c = q.size(1), h = q.size(2), w = q.size(3);
    torch::Tensor gq = torch::empty_like(q);
    std::vector<int64_t> counts;
    for (torch::Tensor &g : grads) {
        g = g.contiguous();
        counts.push_back(g.size(1));
    }
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, q.scalar_type(), "join_head", [&] {
        const scalar_t *in = q.data_ptr<scalar_t>();
        scalar_t *out = gq.data_ptr<scalar_t>();
        at::parallel_for(0, n * h, 8, [&](int64_t begin, int64_t end) {
            std::vector<float> block(kBlock * c);
            std::vector<const float *> rows(grads.size());
            for (int64_t row = begin; row < end; row++) {
                for (size_t i = 0; i < grads.size(); i++)
                    rows[i] = grads[i].data_ptr<float>() + (row / h * counts[i] * h + row % h) * w;
                join_row(in + row * w * c, rows, counts, out + row * w * c, w, c, h * w, float(step),
                         block.data());
            }
        });
    });
    return gq;
}

PYBIND11_MODULE(TORCH_EXTENSION_NAME, m) {
    m.def("forward", &forward);
    m.def("backward", &backward);
    m.def("split", &split);
    m.def("join", &join);
}
