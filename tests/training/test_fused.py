"""The fused operations of training/csrc against the chains of PyTorch's that they replace."""
from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.cpp_extension import is_ninja_available

from training import color, fused, kernel_filter, kernel_net, loss, nets, pointwise, trunk


@pytest.fixture(autouse=True, scope="module")
def compiled():
    if not (shutil.which("c++") or shutil.which("g++")):
        pytest.skip("optional: no C++ compiler for the fused operations")
    if fused.module() is None:
        header = Path(sysconfig.get_path("include")) / "Python.h"
        missing = [what for what, is_there in (("Python.h", header.exists()),
                                               ("ninja", is_ninja_available())) if not is_there]
        assert missing, "the fused operations do not build"
        pytest.skip(f"no {' and no '.join(missing)} for the fused operations")


@pytest.fixture
def both(monkeypatch):
    """f -> (what it returns with the fused operations, what without)."""
    def run(f):
        ours = f()
        with monkeypatch.context() as m:
            m.setattr(fused, "module", lambda: None)
            return ours, f()
    return run


def close(a: torch.Tensor, b: torch.Tensor, share: float) -> None:
    """Different by at most a share of the largest value."""
    assert a.shape == b.shape and a.dtype == b.dtype
    largest = b.abs().max()
    assert largest > 0 and (a - b).abs().max() <= share * largest


def test_compiled_operations_are_shared_by_checkouts(tmp_path, monkeypatch):
    """A copy of the sources elsewhere finds what this one compiled; a changed one does not."""
    folder = fused._cache_folder()
    copy = tmp_path / "csrc"
    shutil.copytree(fused.SOURCES, copy)
    monkeypatch.setattr(fused, "SOURCES", copy)
    assert fused._cache_folder() == folder
    monkeypatch.setattr("torch.utils.cpp_extension.load", None)  # not called
    assert callable(fused._load(folder).filter)
    assert {p.name for p in folder.iterdir()} == {"lock", "lull_fused.so"}
    (copy / "trunk.h").write_bytes(b"// " + (copy / "trunk.h").read_bytes())
    assert fused._cache_folder() != folder


def random_filter(n: int, h: int, w: int, kind: torch.dtype = torch.float, inside: bool = False):
    """(radiance, albedo, has_albedo), heads with codes on both sides of 0 and 255, or between."""
    torch.manual_seed(h * w)
    heads = [torch.randn(n, c, -(-h >> s), -(-w >> s), dtype=kind) * 4 + 8
             for s, c in enumerate(kernel_net.HEAD_WIDTHS)]
    heads = [(q.clamp(0.1, 15.8) if inside else q).requires_grad_() for q in heads]
    kind = torch.double if kind == torch.double else torch.float
    images = [torch.rand(n, 3, h, w, dtype=kind) * 3 - 0.1, torch.rand(n, 3, h, w, dtype=kind),
              (torch.rand(n, 1, h, w, dtype=kind) > 0.4).to(kind)]
    return images, heads


def test_gradient_of_the_filter(monkeypatch):
    monkeypatch.setattr(kernel_filter, "CONSTANTS", [*kernel_filter.CONSTANTS[:-1], 0.0])
    images, heads = random_filter(1, 6, 9, torch.double, inside=True)
    assert torch.autograd.gradcheck(
        lambda *q: kernel_filter.Fused.apply(*images, False, *q)[0], heads)


@pytest.mark.parametrize("filtered", [kernel_filter.plain, kernel_filter.Fused.apply],
                         ids=["plain", "fused"])
def test_closed_blend_weights_keep_a_gradient(filtered):
    images, heads = random_filter(1, 16, 16, torch.double, inside=True)
    heads = [q.detach() for q in heads]

    def run(blend: torch.Tensor) -> torch.Tensor:
        first = torch.cat((heads[0][:, :26], blend, heads[0][:, 27:]), 1)
        q = [first, *heads[1:]]
        return (filtered(*images, True, *q) if filtered is not kernel_filter.plain else filtered(
            q, *images))[0]

    closed = torch.zeros_like(heads[0][:, :1], requires_grad=True)
    change = (run(closed + 1e3) - run(closed)).sum(1)  # what the coarser level would bring
    gradient, = torch.autograd.grad(run(closed).sum(), closed)
    assert change.abs().max() > 0.01
    assert torch.allclose(gradient[:, 0], kernel_filter.LEAST_SLOPE * change, rtol=0.01, atol=1e-6)


@pytest.mark.parametrize("kind", [torch.float, torch.bfloat16], ids=str)
@pytest.mark.parametrize("n, h, w", [(2, 32, 48), (1, 19, 21), (1, 17, 130), (1, 18, 32)])
def test_filter(both, n, h, w, kind):
    images, heads = random_filter(n, h, w, kind)
    g = torch.randn(n, 3, h, w)

    def run():
        out, *last = kernel_filter.apply_filter(heads, *images)
        assert not any(t.requires_grad for t in last)
        return out, last, torch.autograd.grad((out * g).sum(), heads)

    (out, last, grads), (plain, plain_last, plain_grads) = both(run)
    assert type(out.grad_fn).__name__ == "FusedBackward"
    torch.testing.assert_close(out, plain, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(last[0], plain_last[0], rtol=1e-5, atol=1e-5)
    apart = (last[1] - plain_last[1]).abs()
    assert apart.max() <= 1 and apart.mean() < 0.01
    for a, b in zip(grads, plain_grads):
        close(a, b, 2e-5 if kind == torch.float else 0.02)
    q, a = (torch.cat([t.flatten() for t in ts]) for ts in (heads, grads))
    low, high = a[q < 0], a[q * 16 > 255]  # from there the gradient only leads back
    assert (low <= 0).all() and (high >= 0).all()
    assert (low < 0).any() and (high > 0).any() and (low == 0).any() and (high == 0).any()


def test_a_blend_that_left_its_range_comes_back():
    """Codes below 0 blend in no coarser level; where that is wrong they must be able to learn so. A
    network of 32000 steps had lost its two coarsest levels that way."""
    images, heads = random_filter(1, 16, 16)
    target = kernel_filter.apply_filter(heads, *images)[0].detach()
    with torch.no_grad():
        heads[2][:, 26] = -3.0
    for _ in range(200):
        loss = (kernel_filter.apply_filter(heads, *images)[0] - target).abs().mean()
        g, = torch.autograd.grad(loss, heads[2])
        with torch.no_grad():
            heads[2][:, 26] -= 0.1 * g[:, 26].sign()
    assert (heads[2][:, 26] > 0).any()


def test_numbers_that_are_none_come_through(both):
    """So that a training that diverges is seen to do so."""
    images, heads = random_filter(1, 16, 16)
    heads[0].data[0, 3, 8, 8] = torch.nan
    out, plain = both(lambda: kernel_filter.apply_filter(heads, *images)[0])
    assert out.isnan().any() and torch.equal(out.isnan(), plain.isnan())
    a, b = torch.zeros(1, 3, 8, 9), torch.zeros(1, 3, 8, 9)
    a[0, 1, 2, 3] = torch.nan
    assert loss.l1_grad(a, b).isnan()
    assert pointwise.to_codes("pu", a, 1e-6, 65504.0).isnan().sum() == 1


@pytest.mark.parametrize("kind, tiles", [(torch.float, False), (torch.double, False),
                                         (torch.bfloat16, False), (torch.bfloat16, True)], ids=str)
@pytest.mark.parametrize("model", ["k8", "k12", "k16"])  # widths on both sides of a vector's lanes
def test_trunk(both, monkeypatch, model, kind, tiles):
    if tiles and not fused.module().has_tiles():
        pytest.skip("optional: no AMX")
    if not tiles:
        monkeypatch.setattr(trunk, "on_tiles", lambda kind, parameters: False)
    torch.manual_seed(1)
    low = kind == torch.bfloat16
    net = nets.build(model, 0).to(torch.float if low else kind)
    x = torch.rand(2, 12, 32, 48, dtype=torch.float if low else kind, requires_grad=True)
    to = [torch.randn(2, c, 32 >> s, 48 >> s) for s, c in enumerate(kernel_net.HEAD_WIDTHS)]

    def run(low=low):
        with torch.autocast("cpu", torch.bfloat16, enabled=low):
            heads = net.trunk(x)
        total = sum((q * t).sum() for q, t in zip(heads, to))
        return heads, torch.autograd.grad(total, [x, *net.parameters()])

    (heads, grads), (plain, plain_grads) = both(run)
    assert type(heads[0].grad_fn).__name__ == "TrunkBackward"
    emulated = low and not trunk.relu_comes_along(kind)  # by PyTorch, which rounds elsewhere then
    if tiles or emulated:  # (tiles: biases are not rounded) as near to fp32 as PyTorch's in bf16
        exact, exact_grads = run(low=False)
        for a, b, c in zip((*heads, *grads), (*plain, *plain_grads), (*exact, *exact_grads)):
            assert a.dtype == b.dtype and a.shape == b.shape
            assert (a - c).norm() <= 1.5 * (b - c).norm() + 1e-3 * c.norm()
    if tiles:
        return
    share = {torch.double: 1e-12, torch.float: 1e-5, torch.bfloat16: 0.03}[kind]
    share = 0.1 if emulated else share
    for a, b in zip((*heads, *grads), (*plain, *plain_grads), strict=True):
        close(a, b, share)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("n, c, h, w, o, k", [
    (4, 12, 16, 48, 16, 3), (2, 40, 9, 70, 16, 3), (3, 16, 40, 33, 52, 1), (2, 5, 9, 37, 7, 3),
    (1, 3, 4, 4, 1, 3), (2, 24, 35, 16, 56, 3), (3, 33, 5, 17, 18, 1), (1, 64, 8, 8, 27, 1)])
def test_convolutions_on_tiles(n, c, h, w, o, k, threads):
    """Of any size: bf16 results to their last bit but one, sums of gradients to fp32's."""
    ops, last = fused.module(), {"memory_format": torch.channels_last}
    if not ops.has_tiles():
        pytest.skip("optional: no AMX")
    torch.manual_seed(h)
    x, g = (torch.randn(n, i, h, w).bfloat16().contiguous(**last) for i in (c, o))
    weight = (torch.randn(o, c, k, k) / (c * k * k) ** 0.5).bfloat16().float()
    bias = torch.randn(o)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(threads)
        got = [ops.convolve(x, weight, bias, relu) for relu in (False, True)]
        got += ops.convolve_backward(g, x, weight.contiguous(**last), True)
    finally:
        torch.set_num_threads(before)
    plain = torch.nn.functional.conv2d(x.double(), weight.double(), bias.double(), padding=k // 2)
    wanted = [plain, plain.relu(), *torch.ops.aten.convolution_backward(
        g.double(), x.double(), weight.double(), [o], [1, 1], [k // 2] * 2, [1, 1], False, [0, 0],
        1, [True, True, True])]
    for a, b, share in zip(got, wanted, [2**-8] * 3 + [1e-5] * 2, strict=True):
        close(a.double(), b, share)
    assert ops.convolve_backward(g, x, weight, False)[0] is None


def test_numbers_that_are_none_come_through_tiles():
    ops, x = fused.module(), torch.zeros(1, 16, 8, 40).bfloat16()
    if not ops.has_tiles():
        pytest.skip("optional: no AMX")
    x[0, 3, 4, 33] = torch.nan
    x = x.contiguous(memory_format=torch.channels_last)
    out = ops.convolve(x, torch.ones(2, 16, 3, 3), torch.zeros(2), True)
    assert out[0, :, 3:6, 32:35].isnan().all() and not out[0, :, :3].isnan().any()


def test_pooling_gives_its_gradient_to_the_first_of_equal_pixels():
    ops, kind = fused.module(), {"memory_format": torch.channels_last}
    y = torch.randint(0, 3, (2, 20, 8, 12)).float().contiguous(**kind).requires_grad_()
    g = torch.randn(2, 20, 4, 6).contiguous(**kind)
    pooled = torch.nn.functional.max_pool2d(y, 2)
    expected, = torch.autograd.grad(pooled, y, g)
    y = y.detach()
    assert torch.equal(ops.pool(y), pooled)
    assert torch.equal(ops.relu_backward(y, True, [g], [0]), torch.where(y > 0, expected, 0.0))


def test_pu(both):
    edges = [0.0, 1e-7, 1e-6, 65504.0, 1e5, color.PU_Y0, color.PU_Y1]
    torch.manual_seed(2)
    y = torch.cat([torch.exp(torch.randn(5003) * 4), torch.tensor(edges)]).requires_grad_()

    def run():
        out = pointwise.to_codes("pu", y, 1e-6, 65504.0)
        return out, torch.autograd.grad(out.sum(), y)[0]

    (out, slope), (plain, plain_slope) = both(run)
    torch.testing.assert_close(out, plain, rtol=1e-5, atol=1e-6)
    inside = ~torch.isin(y.detach(), torch.tensor(edges))
    torch.testing.assert_close(slope[inside], plain_slope[inside], rtol=1e-5, atol=0)
    assert (slope[y < 1e-6] == 0).all() and (slope[y > 65504] == 0).all()
    codes = torch.linspace(-0.1, 1.1, 7001)
    torch.testing.assert_close(*both(lambda: pointwise.from_codes("pu", codes)), rtol=1e-5, atol=0)
    y = (torch.rand(3, 7, dtype=torch.double) * 0.05 + 0.001).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: pointwise.PuForward.apply(v, 1e-6, 65504.0), y)


@pytest.mark.parametrize("shape", [(2, 3, 16, 32), (2, 3, 7, 21), (1, 3, 1, 5), (1, 1, 5, 1)])
def test_l1_grad(both, shape):
    torch.manual_seed(3)
    a, b = torch.randn(shape).requires_grad_(), torch.randn(shape)
    b[..., 0] = a.detach()[..., 0]

    def run():
        value = loss.l1_grad(a, b)
        return value, torch.autograd.grad(3 * value, a)[0]

    ours, plain = both(run)
    torch.testing.assert_close(ours[0], plain[0], rtol=1e-6, atol=0)
    torch.testing.assert_close(ours[1], plain[1], rtol=1e-5, atol=1e-9)
    a, b = a.detach().double().requires_grad_(), torch.randn(shape, dtype=torch.double)
    assert torch.autograd.gradcheck(lambda v: pointwise.L1Grad.apply(v, b), a)


@pytest.mark.parametrize("kind", [torch.float, torch.bfloat16], ids=str)
def test_codes_of_the_input(both, kind):
    torch.manual_seed(4)
    x = torch.rand(2, 12, 33, 21) * 1.2
    x[:, 9:] = (x[:, 9:] > 0.5).float()
    radiance = torch.exp(torch.randn(2, 3, 33, 21) * 4)
    ours, plain = both(lambda: kernel_net.encode(radiance, x, kind).float().numpy() * 255)
    assert np.abs(ours - plain).max() <= 1.001  # rounding of single codes
    assert (np.abs(ours - plain) < 1e-4).mean() > 0.999


TRITON = """
import torch
from training import kernel_filter
from training.kernel_triton import Smoothed, WeightedSums
torch.manual_seed(2)
fp32, bf16 = torch.float32, torch.bfloat16
for (n, h, w), whole, kind in (((2, 9, 13), True, fp32), ((1, 16, 16), False, fp32),
                               ((2, 16, 8), True, bf16)):
    head = (torch.rand(n, 52, h, w) * 20 - 2).to(kind)  # of codes within their range and beyond
    head = head.to(memory_format=torch.channels_last).requires_grad_()
    v, g = torch.rand(n, 4, h, w).requires_grad_(), torch.randn(n, 4, h, w)
    def run(sums):
        out = sums(head[:, 27:], v, whole)
        return out, *torch.autograd.grad((out * g).sum(), (head, v))
    for a, b, share in zip(run(WeightedSums.apply), run(kernel_filter.weighted_sums),
                           (1e-6, 1e-6 if kind == fp32 else 2**-7, 1e-6)):
        assert a.dtype == b.dtype and (a - b).abs().max() <= share * b.abs().max()
k = kernel_filter
for n, h, w, is_far in ((2, 9, 13, True), (1, 32, 40, False), (2, 5, 40, True)):
    v = (torch.rand(n, 1, h, w) * 2 + torch.rand(n, 3, h, w) * 0.05).requires_grad_()
    noise, guide = (torch.randint(0, top, (n, c, h, w)).float() for top, c in ((255, 1), (3, 2)))
    g = torch.randn(n, 3, h, w)
    offsets, own, widest = k.FAR if is_far else k.NEAR
    constants = k.WIDTH_PER_CODE, k.WIDTH_MIN, widest, k.RESULT_GAIN, k.GUIDE_GAIN, k.EPS, own
    ours = Smoothed.apply(v, noise, guide, offsets, *map(float, constants))
    theirs = k.smoothed(v, noise, guide, is_far)
    assert (theirs - v).abs().mean() > 0.02
    gradients = [torch.autograd.grad((x * g).sum(), v)[0] for x in (ours, theirs)]
    for a, b in ((ours, theirs), gradients):
        assert (a - b).abs().max() <= 1e-6 * b.abs().max()
print("alike")
"""


def test_kernels_for_gpus():
    """Triton's interpreter runs them without a GPU; it has to be asked before it is imported."""
    if importlib.util.find_spec("triton") is None:
        pytest.skip("optional: no Triton")
    run = subprocess.run([sys.executable, "-c", TRITON], capture_output=True, text=True,
                         env={**os.environ, "TRITON_INTERPRET": "1"})
    assert run.stdout == "alike\n", run.stderr
