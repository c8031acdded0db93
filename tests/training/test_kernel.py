"""Family K: the filter operation, and the network against the numpy reference."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from export import kernel, pixels
from training import fused, kernel_filter, kernel_net, nets


def test_sums_of_the_filter_are_their_definition():
    rng = np.random.default_rng(1)
    logits, v = rng.normal(size=(1, 25, 5, 6)), rng.random((1, 2, 5, 6))
    out = kernel_filter.kernel_filter(torch.from_numpy(logits), torch.from_numpy(v)).numpy()
    expected = np.zeros_like(v)
    for y in range(5):
        for x in range(6):
            for k in range(25):
                sy, sx = y + k // 5 - 2, x + k % 5 - 2
                if 0 <= sy < 5 and 0 <= sx < 6:
                    expected[0, :, y, x] += np.exp(logits[0, k, y, x]) * v[0, :, sy, sx]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


@pytest.fixture
def compiled():
    if fused.module() is None:
        pytest.skip("optional: no C++ compiler for the fused operations")


def random_filter(n: int, h: int, w: int, kind: torch.dtype = torch.float):
    """(radiance, albedo, has_albedo), heads with codes on both sides of 0 and 255."""
    torch.manual_seed(h * w)
    heads = [(torch.randn(n, c, -(-h >> s), -(-w >> s), dtype=kind) * 4 + 8).requires_grad_()
             for s, c in enumerate(kernel_net.HEAD_WIDTHS)]
    kind = torch.double if kind == torch.double else torch.float
    images = [torch.rand(n, 3, h, w, dtype=kind) * 3 - 0.1, torch.rand(n, 3, h, w, dtype=kind),
              (torch.rand(n, 1, h, w, dtype=kind) > 0.4).to(kind)]
    return images, heads


def test_gradient_of_the_fused_filter(compiled):
    images, heads = random_filter(1, 6, 9, torch.double)
    assert torch.autograd.gradcheck(
        lambda *q: kernel_filter.Fused.apply(*images, False, *q), heads)


@pytest.mark.parametrize("kind", [torch.float, torch.bfloat16], ids=str)
@pytest.mark.parametrize("n, h, w", [(2, 32, 48), (1, 19, 21), (1, 17, 130), (1, 18, 32)])
def test_fused_filter_equals_the_plain_one(compiled, n, h, w, kind):
    images, heads = random_filter(n, h, w, kind)
    g = torch.randn(n, 3, h, w)
    out, plain = kernel_filter.apply_filter(heads, *images), kernel_filter.plain(heads, *images)
    torch.testing.assert_close(out, plain, rtol=1e-5, atol=1e-5)
    assert type(out.grad_fn).__name__ == "FusedBackward"
    for level, (a, b) in enumerate(zip(torch.autograd.grad((out * g).sum(), heads),
                                       torch.autograd.grad((plain * g).sum(), heads))):
        largest = b.float().abs().max()
        assert largest > 0 and a.dtype == kind
        bound = largest * (2e-5 if kind == torch.float else 0.02)
        assert (a.float() - b.float()).abs().max() < bound
        clamped = (heads[level] < 0) | (heads[level] * 16 > 255)
        assert clamped.any() and (a[clamped] == 0).all()


def test_numbers_that_are_none_come_through(compiled):
    """So that a training that diverges is seen to do so."""
    images, heads = random_filter(1, 16, 16)
    heads[0].data[0, 3, 8, 8] = torch.nan
    out = kernel_filter.apply_filter(heads, *images)
    assert torch.equal(out.isnan(), kernel_filter.plain(heads, *images).isnan())
    assert out.isnan().any()


def test_compiled_operations_are_shared_by_checkouts(compiled, tmp_path, monkeypatch):
    """A copy of the source elsewhere finds what this one compiled; a changed one does not."""
    folder = fused._cache_folder()
    copy = tmp_path / "kernel_filter.cpp"
    copy.write_bytes(fused.SOURCE.read_bytes())
    monkeypatch.setattr(fused, "SOURCE", copy)
    assert fused._cache_folder() == folder
    monkeypatch.setattr("torch.utils.cpp_extension.load", None)  # not called
    assert callable(fused._load(folder).filter)
    assert {p.name for p in folder.iterdir()} == {"lock", "lull_fused.so"}
    copy.write_bytes(b"// " + copy.read_bytes())
    assert fused._cache_folder() != folder


def test_filter_of_torch_equals_the_reference():
    """Same heads, same picture: PyTorch's filter and the bit-exact one differ by rounding only."""
    rng = np.random.default_rng(2)
    codes = [rng.integers(100, 256, (32 >> s, 48 >> s, w)).astype(np.uint8)
             for s, w in enumerate(kernel_net.HEAD_WIDTHS)]
    radiance = rng.random((32, 48, 3), np.float32) * 5
    albedo = rng.random((32, 48, 3), np.float32)
    expected = kernel.apply_filter(codes, radiance, albedo)
    heads = [torch.from_numpy(c.transpose(2, 0, 1)[None].astype(np.float32) / 16) for c in codes]
    batch = [torch.from_numpy(a.transpose(2, 0, 1)[None].copy()) for a in (radiance, albedo)]
    got = kernel_filter.apply_filter(heads, *batch, torch.ones(1, 1, 32, 48))
    np.testing.assert_allclose(got[0].numpy().transpose(1, 2, 0), expected, rtol=2e-4)


def test_input_codes_equal_the_reference():
    rng = np.random.default_rng(3)
    radiance = np.exp(rng.normal(size=(16, 16, 3)) * 3).astype(np.float32)
    albedo = rng.random((16, 16, 3), np.float32)
    normal = rng.random((16, 16, 3), np.float32) * 2 - 1
    expected = kernel.encode(radiance, albedo, normal, False)
    t = [torch.from_numpy(a.transpose(2, 0, 1)[None].copy()) for a in (radiance, albedo, normal)]
    got = kernel_net.make_input(*t, False)[0].numpy().transpose(1, 2, 0) * 255
    assert np.abs(got - expected).max() <= 1.001  # rounding of single codes
    assert (np.rint(got) == expected).mean() > 0.999


def test_constant_image_comes_back():
    """All weights sum to one, whatever the heads say."""
    rng = np.random.default_rng(4)
    codes = [rng.integers(0, 256, (-(-21 >> s), -(-19 >> s), w)).astype(np.uint8)
             for s, w in enumerate(kernel_net.HEAD_WIDTHS)]
    constant = np.full((21, 19, 3), 0.37, np.float32)
    out = kernel.apply_filter(codes, constant, np.full_like(constant, 0.5))
    np.testing.assert_allclose(out, constant, rtol=2e-6)


def test_exposure_of_reference_frames_is_used():
    color = np.full((16, 16, 3), 4.0, np.float32)
    assert pixels.Frame({"color": color}).input_scale() == pytest.approx(0.18 / 4, rel=1e-5)


def test_widths_of_the_models():
    """k16 is the shipped size; the costs are those of docs/models.md."""
    costs = [nets.build(m, 0).macs_per_pixel() / 1000 for m in ("k8", "k12", "k16", "k24")]
    assert costs == sorted(costs) and costs[2] == pytest.approx(20.0, abs=0.1)
    assert nets.find_model("k16")[0].name == "kernel5"
    with pytest.raises(ValueError, match="needs 14 widths"):
        nets.build("kernel5:4,4", 0)
    with pytest.raises(ValueError, match="whole numbers"):
        nets.build("kernel5:4,x", 0)
