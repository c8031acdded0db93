// PyTorch's view of the operations in the headers beside it. CPU only; tensors of images are
// contiguous, those of the trunk and heads channels-last.
#include <memory>
#include <torch/extension.h>

#include "amx.h"
#include "kernel_filter.h"
#include "pointwise.h"
#include "trunk.h"

namespace
{

using torch::Tensor;
using FilterConstants = std::array<double, 8>;
constexpr auto kLast = at::MemoryFormat::ChannelsLast;

#define FOR_FLOATS(TENSOR, ...)                                                                    \
    AT_DISPATCH_FLOATING_TYPES((TENSOR).scalar_type(), "fused", __VA_ARGS__)
#define FOR_MAPS(TENSOR, ...)                                                                      \
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, (TENSOR).scalar_type(), "fused", __VA_ARGS__)

template <typename T> const T *planes(const Tensor &t, int64_t &batch)
{
    TORCH_CHECK(t.dim() == 4 && t.stride(3) == 1 && t.stride(2) == t.size(3) &&
                    t.stride(1) == t.size(2) * t.size(3),
                "images are planar");
    batch = t.stride(0);
    return t.data_ptr<T>();
}

template <typename Q>
auto batch(const std::vector<Tensor> &heads, const Tensor &radiance, const Tensor &albedo,
           const Tensor &has)
{
    using T = Arithmetic<Q>;
    Batch<Q, T> b{};
    int64_t h = radiance.size(2), w = radiance.size(3);
    TORCH_CHECK(heads.size() == kLevels, "five heads");
    for (int i = 0; i < kLevels; i++, h = (h + 1) / 2, w = (w + 1) / 2) {
        const Tensor &q = heads[i];
        TORCH_CHECK(q.is_contiguous(kLast) && q.size(0) == radiance.size(0) && q.size(2) == h &&
                        q.size(3) == w && q.size(1) == (i ? kAlbedo : kAlbedo + kTaps),
                    "head ", i, " does not fit");
        b.heads[i] = q.data_ptr<Q>();
        b.channels[i] = q.size(1);
    }
    b.radiance.base = planes<T>(radiance, b.radiance.batch);
    b.albedo.base = planes<T>(albedo, b.albedo.batch);
    b.has.base = planes<T>(has, b.has.batch);
    return b;
}

template <typename Q, typename F>
void for_images(const Batch<Q, Arithmetic<Q>> &b, const FilterConstants &c, bool whole,
                const Tensor &radiance, Tensor kept, F f)
{
    using T = Arithmetic<Q>;
    const Constants<T> k{{c[0], whole}, c[1], c[2], c[3], c[4], c[5], c[6], c[7]};
    at::parallel_for(0, radiance.size(0), 1, [&](int64_t begin, int64_t end) {
        Tape<T> tape(radiance.size(2), radiance.size(3));
        std::vector<T> work(tape.size);
        for (int64_t n = begin; n < end; n++) {
            tape.place(kept.data_ptr<T>() + n * tape.kept, work.data());
            f(Image<Q, T>(b, k, tape, n));
        }
    });
}

// {result, tape, [N,4,H,W]: what multiplied the result, and the noise codes}
std::vector<Tensor> filter(std::vector<Tensor> heads, Tensor radiance, Tensor albedo, Tensor has,
                           FilterConstants constants, bool whole)
{
    Tensor out = torch::empty_like(radiance, at::MemoryFormat::Contiguous), kept;
    Tensor last = torch::empty({out.size(0), 4, out.size(2), out.size(3)}, out.options());
    FOR_MAPS(heads[0], [&] {
        using T = Arithmetic<scalar_t>;
        auto b = batch<scalar_t>(heads, radiance, albedo, has);
        b.out = out.data_ptr<T>();
        b.last = last.data_ptr<T>();
        kept = torch::empty({out.size(0), Tape<T>(out.size(2), out.size(3)).kept}, out.options());
        for_images<scalar_t>(b, constants, whole, radiance, kept,
                             [](auto image) { image.forward(); });
    });
    return {out, kept, last};
}

// Gradients of the heads.
std::vector<Tensor> filter_backward(std::vector<Tensor> heads, Tensor radiance, Tensor albedo,
                                    Tensor has, Tensor kept, Tensor gout, FilterConstants constants,
                                    bool whole)
{
    std::vector<Tensor> gradients;
    for (const Tensor &q : heads)
        gradients.push_back(torch::empty_like(q));
    FOR_MAPS(heads[0], [&] {
        auto b = batch<scalar_t>(heads, radiance, albedo, has);
        b.gout.base = planes<Arithmetic<scalar_t>>(gout, b.gout.batch);
        for (int i = 0; i < kLevels; i++)
            b.gradients[i] = gradients[i].data_ptr<scalar_t>();
        for_images<scalar_t>(b, constants, whole, radiance, kept,
                             [](auto image) { image.backward(); });
    });
    return gradients;
}

// f(Pu, inputs) of every value of tensors of one size.
template <typename F, typename... In> Tensor pu(double top, F f, const Tensor &t, const In &...more)
{
    Tensor out = torch::empty_like(t);
    FOR_FLOATS(t, [&] {
        const Pu<scalar_t> curve{scalar_t(top)};
        map(
            t.numel(), out.data_ptr<scalar_t>(), [&](auto... v) { return f(curve, v...); },
            t.data_ptr<scalar_t>(), more.template data_ptr<scalar_t>()...);
    });
    return out;
}

Tensor pu_inverse(Tensor code, double top)
{
    return pu(
        top, [](auto &curve, auto v) { return curve.inverse(v); }, code.contiguous());
}

// Of y between two bounds, outside which it has no gradient.
Tensor pu_forward(Tensor y, double top, double low, double high)
{
    return pu(
        top,
        [=](auto &curve, auto v) {
            using T = std::decay_t<decltype(v[0])>;
            return curve.forward(clamp<T>(v, low, high));
        },
        y.contiguous());
}

Tensor pu_backward(Tensor y, Tensor g, double top, double low, double high)
{
    return pu(
        top,
        [=](auto &curve, auto v, auto g) {
            using T = std::decay_t<decltype(v[0])>;
            return v < T(low) ? decltype(v)() : v > T(high) ? decltype(v)() : g * curve.slope(v);
        },
        y.contiguous(), g.contiguous());
}

// The network's input, bf16 or as x; constants: those of Encoder.
Tensor encode(Tensor radiance, Tensor x, std::array<double, 4> constants, bool bf16)
{
    const Encoder e{constants[0], constants[1], constants[2], constants[3]};
    const int64_t h = x.size(2), w = x.size(3);
    Tensor out =
        torch::empty(x.sizes(), bf16 ? x.options().dtype(at::kBFloat16) : x.options(), kLast);
    TORCH_CHECK(x.size(1) == 12 && radiance.size(1) == 3, "12 planes, 3 of radiance");
    TORCH_CHECK(!bf16 || x.scalar_type() == at::kFloat, "bf16 of fp32");
    FOR_FLOATS(x, [&] {
        int64_t batch, colours;
        const scalar_t *in = planes<scalar_t>(x, batch), *r = planes<scalar_t>(radiance, colours);
        at::parallel_for(0, x.size(0) * h, 64, [&](int64_t begin, int64_t end) {
            for (int64_t i = begin; i < end; i++) {
                const int64_t n = i / h, at = i % h * w;
                const scalar_t *from = in + n * batch + at, *rad = r + n * colours + at;
                if constexpr (std::is_same_v<scalar_t, float>)
                    if (bf16) {
                        e.row(rad, from, h * w, w, out.data_ptr<at::BFloat16>() + i * w * 12);
                        continue;
                    }
                e.row(rad, from, h * w, w, out.data_ptr<scalar_t>() + i * w * 12);
            }
        });
    });
    return out;
}

// {loss, derivative by a}
std::vector<Tensor> l1_grad(Tensor a, Tensor b)
{
    TORCH_CHECK(a.is_contiguous() && b.is_contiguous() && a.sizes() == b.sizes() && a.dim() >= 2,
                "images are alike and contiguous");
    Tensor loss = torch::empty({}, a.options()), da = torch::empty_like(a);
    const int64_t h = a.size(-2), w = a.size(-1);
    FOR_FLOATS(a, [&] {
        *loss.data_ptr<scalar_t>() =
            l1_and_gradient(a.data_ptr<scalar_t>(), b.data_ptr<scalar_t>(), a.numel() / (h * w), h,
                            w, da.data_ptr<scalar_t>());
    });
    return {loss, da};
}

// Image n of a channels-last tensor.
template <typename Q> Map<Q> image(const Tensor &t, int64_t n)
{
    TORCH_CHECK(t.is_contiguous(kLast), "channels-last");
    const int64_t h = t.size(2), w = t.size(3), c = t.size(1);
    return {t.data_ptr<std::remove_const_t<Q>>() + n * h * w * c, h, w, c};
}

template <typename F> void for_batch(int64_t count, F f)
{
    at::parallel_for(0, count, 1, [&](int64_t begin, int64_t end) {
        for (int64_t n = begin; n < end; n++)
            f(n);
    });
}

Tensor pool(Tensor y)
{
    Tensor out =
        torch::empty({y.size(0), y.size(1), y.size(2) / 2, y.size(3) / 2}, y.options(), kLast);
    FOR_MAPS(y, [&] {
        for_batch(y.size(0), [&](int64_t n) {
            max_pool(image<const scalar_t>(y, n), image<scalar_t>(out, n));
        });
    });
    return out;
}

Tensor join(Tensor a, Tensor skip)
{
    Tensor out = torch::empty({skip.size(0), a.size(1) + skip.size(1), skip.size(2), skip.size(3)},
                              skip.options(), kLast);
    FOR_MAPS(skip, [&] {
        for_batch(skip.size(0), [&](int64_t n) {
            concatenate(image<const scalar_t>(a, n), image<const scalar_t>(skip, n),
                        image<scalar_t>(out, n));
        });
    });
    return out;
}

// Parameters in another type.
std::vector<Tensor> cast(std::vector<Tensor> from, at::ScalarType kind)
{
    std::vector<Tensor> result;
    for (const Tensor &t : from) {
        if (t.scalar_type() == kind) {
            result.push_back(t);
            continue;
        }
        result.push_back(torch::empty_like(t, t.options().dtype(kind)));
        TORCH_CHECK(t.is_non_overlapping_and_dense() && result.back().strides() == t.strides(),
                    "dense");
        FOR_MAPS(t, [&] {
            const scalar_t *p = t.data_ptr<scalar_t>();
            FOR_MAPS(result.back(),
                     [&] { std::copy_n(p, t.numel(), result.back().data_ptr<scalar_t>()); });
        });
    }
    return result;
}

// first: of each gradient, the channel where that of y begins.
Tensor relu_backward(Tensor y, bool pooled, std::vector<Tensor> gradients,
                     std::vector<int64_t> first)
{
    TORCH_CHECK(!pooled || (y.size(2) % 2 == 0 && y.size(3) % 2 == 0), "even sizes are pooled");
    Tensor out = torch::empty_like(y);
    FOR_MAPS(y, [&] {
        for_batch(y.size(0), [&](int64_t n) {
            std::vector<Use<scalar_t>> uses;
            for (size_t i = 0; i < gradients.size(); i++)
                uses.push_back({image<const scalar_t>(gradients[i], n), first[i]});
            activation_backward(image<const scalar_t>(y, n), pooled, uses, image<scalar_t>(out, n));
        });
    });
    return out;
}

// Convolutions of bf16 images on tiles; weights and biases in fp32.
bool has_tiles()
{
#ifdef LULL_AMX
    return amx::usable();
#else
    return false;
#endif
}

#ifdef LULL_AMX
amx::Shape shape(const Tensor &x, const Tensor &weight)
{
    TORCH_CHECK(x.is_contiguous(kLast) && x.scalar_type() == at::kBFloat16 &&
                    x.size(1) == weight.size(1) && weight.scalar_type() == at::kFloat &&
                    weight.size(2) == weight.size(3) &&
                    (weight.size(2) == 1 || weight.size(2) == 3),
                "bf16 images, kernels of 1x1 or 3x3");
    return {x.size(2), x.size(3), x.size(1), weight.size(0), weight.size(2)};
}
amx::Half *halves(const Tensor &t, int64_t image)
{
    return (amx::Half *)t.data_ptr<at::BFloat16>() + image * t.stride(0);
}
const float *floats(const Tensor &t) { return t.data_ptr<float>(); }

// Of a layer, or of gradients on their way back, for which weights are packed in another way.
Tensor tiled(const Tensor &x, const amx::Memory<amx::Half> &packed, const float *bias, bool relu,
             const amx::Shape &s)
{
    constexpr int64_t kRows = 32; // of a piece of work
    const int64_t pieces = (s.h + kRows - 1) / kRows;
    Tensor out = torch::empty({x.size(0), s.out, s.h, s.w}, x.options(), kLast);
    at::parallel_for(0, x.size(0) * pieces, 1, [&](int64_t begin, int64_t end) {
        const amx::Tiles tiles;
        for (int64_t i = begin; i < end; i++) {
            const int64_t n = i / pieces, y = i % pieces * kRows;
            amx::convolve(halves(x, n), packed, bias, relu, s, y, std::min(y + kRows, s.h),
                          halves(out, n));
        }
    });
    return out;
}
#endif

Tensor convolve(Tensor x, Tensor weight, Tensor bias, bool relu)
{
#ifdef LULL_AMX
    const amx::Shape s = shape(x, weight);
    weight = weight.contiguous(kLast);
    return tiled(x, amx::pack(floats(weight), s), floats(bias), relu, s);
#else
    TORCH_CHECK(false, "no tiles");
#endif
}

// Gradients of x (if wanted), weight and bias.
std::vector<Tensor> convolve_backward(Tensor g, Tensor x, Tensor weight, bool wanted)
{
#ifdef LULL_AMX
    const amx::Shape s = shape(x, weight), back{s.h, s.w, s.out, s.in, s.k};
    weight = weight.contiguous(kLast);
    TORCH_CHECK(g.is_contiguous(kLast) && g.scalar_type() == at::kBFloat16, "bf16 gradients");
    Tensor gx;
    if (wanted)
        gx = tiled(g, amx::pack_backward(floats(weight), back), nullptr, false, back);
    const int64_t count = x.size(0), threads = at::get_num_threads();
    std::vector<std::unique_ptr<amx::Gradients>> parts(count); // by the first image of each
    at::parallel_for(0, count, (count + threads - 1) / threads, [&](int64_t begin, int64_t end) {
        const amx::Tiles tiles;
        parts[begin] = std::make_unique<amx::Gradients>(s);
        for (int64_t n = begin; n < end; n++)
            parts[begin]->run(halves(x, n), halves(g, n));
    });
    Tensor gw = torch::zeros_like(weight), gb = torch::zeros({s.out}, weight.options());
    for (const auto &part : parts)
        if (part)
            part->give(gw.data_ptr<float>(), gb.data_ptr<float>());
    return {gx, gw, gb};
#else
    TORCH_CHECK(false, "no tiles");
#endif
}

} // namespace

PYBIND11_MODULE(TORCH_EXTENSION_NAME, m)
{
    m.def("filter", &filter);
    m.def("filter_backward", &filter_backward);
    m.def("pu_inverse", &pu_inverse);
    m.def("pu_forward", &pu_forward);
    m.def("pu_backward", &pu_backward);
    m.def("encode", &encode);
    m.def("l1_grad", &l1_grad);
    m.def("pool", &pool);
    m.def("join", &join);
    m.def("cast", &cast);
    m.def("relu_backward", &relu_backward);
    m.def("has_tiles", &has_tiles);
    m.def("convolve", &convolve);
    m.def("convolve_backward", &convolve_backward);
}
