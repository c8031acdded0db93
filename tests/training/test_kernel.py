"""Family K: the filter operation, and the network against the numpy reference."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.training.tools import input_codes
from export import calm, kernel, pixels
from export.smooth import guide_of
from training import cells, kernel_filter, kernel_net, nets, regression


def test_sums_of_the_filter_are_their_definition():
    rng = np.random.default_rng(1)
    logits, v = rng.normal(size=(1, 25, 5, 6)), rng.random((1, 2, 5, 6))
    around = torch.from_numpy(np.pad(v, ((0, 0), (0, 0), (2, 2), (2, 2))))
    out = kernel_filter.kernel_filter(torch.from_numpy(logits), around).numpy()
    expected = np.zeros_like(v)
    for y in range(5):
        for x in range(6):
            for k in range(25):
                sy, sx = y + k // 5 - 2, x + k % 5 - 2
                if 0 <= sy < 5 and 0 <= sx < 6:
                    expected[0, :, y, x] += np.exp(logits[0, k, y, x]) * v[0, :, sy, sx]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def test_bands_of_rows_give_what_whole_pictures_do():
    """Without gradients: a picture of 8 megapixels took 15 GB with all last steps."""
    torch.manual_seed(3)
    h, w = 2 * cells.BAND + 37, 24
    q, v = torch.rand(1, 25, h, w), torch.rand(1, 4, h, w)
    out, smooth, radiance = (torch.rand(1, 3, h, w) + 0.1 for _ in range(3))
    features = regression.features_of(torch.rand(1, 3, h, w), smooth)
    whole = (kernel_filter.weighted_sums(q, v, True),
             regression.regressed(out, smooth, features, radiance))
    with torch.no_grad():
        bands = (kernel_filter.weighted_sums(q, v, True),
                 regression.regressed(out, smooth, features, radiance))
    for a, b in zip(whole, bands, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("has_normal", [False, True])
@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("bilateral", sorted(kernel.LAST_STEPS))
@pytest.mark.parametrize("has_albedo", [False, True])
def test_filter_of_torch_equals_the_reference(bilateral, clipped, has_normal, has_albedo):
    """Same heads, same picture: PyTorch's filter and the bit-exact one differ by rounding only."""
    rng = np.random.default_rng(2)
    codes = [rng.integers(100, 256, (32 >> s, 48 >> s, w)).astype(np.uint8)
             for s, w in enumerate(kernel_net.HEAD_WIDTHS)]
    radiance = rng.random((32, 48, 3), np.float32) * 5
    radiance[:, 16:] = 2 + 0.1 * radiance[:, 16:]  # little noise
    albedo = rng.random((32, 48, 3), np.float32)
    normal = rng.random((32, 48, 3), np.float32) * 2 - 1
    inputs = rng.integers(0, 256, (32, 48, 12)).astype(np.uint8)
    inputs[..., 9:] = 255 * np.array([has_albedo, has_normal, clipped])
    seen = albedo if has_albedo else None
    expected = kernel.apply_filter(codes, radiance, seen, normal if has_normal else None,
                                   guide_of(inputs), bilateral, clipped,
                                   calm=calm.frame_calm(radiance, seen))
    heads = [torch.from_numpy(c.transpose(2, 0, 1)[None].astype(np.float32) / 16) for c in codes]
    batch = [*(tensor(a) for a in (radiance, albedo)),
             torch.full((1, 1, 32, 48), float(has_albedo))]
    filtered = kernel_filter.apply_filter(heads, *batch)
    got = kernel_filter.smooth_result(*filtered, batch[0], tensor(inputs.astype(np.float32)),
                                      batch[1], tensor(normal * has_normal), heads[0], bilateral)
    np.testing.assert_allclose(picture(got), expected, rtol=2e-4)


def tensor(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(image.transpose(2, 0, 1)[None].copy())


def picture(t: torch.Tensor) -> np.ndarray:
    return t[0].numpy().transpose(1, 2, 0)


def test_only_evaluation_smooths():
    torch.manual_seed(1)
    model = nets.build("k8", 0)
    model.bilateral = kernel.SMOOTH
    x = torch.rand(1, 12, 32, 48)
    x[:, 9:12] = 1
    with torch.no_grad():
        trained, evaluated = model(x), model.eval()(x)
        assert not torch.equal(trained, evaluated)
        assert torch.equal(model.train()(x), trained)


def test_input_codes_equal_the_reference():
    rng = np.random.default_rng(3)
    radiance = np.exp(rng.normal(size=(16, 16, 3)) * 3).astype(np.float32)
    albedo = rng.random((16, 16, 3), np.float32)
    normal = rng.random((16, 16, 3), np.float32) * 2 - 1
    expected = kernel.encode(radiance, albedo, normal, False)
    got = input_codes(radiance, albedo, normal)
    assert np.abs(got - expected).max() <= 1.001  # rounding of single codes
    assert (np.rint(got) == expected).mean() > 0.999


def test_constant_image_comes_back():
    """All weights sum to one, whatever the heads say."""
    rng = np.random.default_rng(4)
    codes = [rng.integers(0, 256, (-(-21 >> s), -(-19 >> s), w)).astype(np.uint8)
             for s, w in enumerate(kernel_net.HEAD_WIDTHS)]
    constant = np.full((21, 19, 3), 0.37, np.float32)
    guide, normal = rng.integers(0, 128, (21, 19, 2)), rng.random((21, 19, 3), np.float32)
    albedo = np.full_like(constant, 0.5)
    for steps, rtol in ((kernel.SMOOTH_AND_CORRECT, 2e-6), (kernel.ALL_STEPS, 4e-6)):
        out = kernel.apply_filter(codes, constant, albedo, normal, guide, steps)
        np.testing.assert_allclose(out, constant, rtol=rtol)


def test_exposure_of_reference_frames_is_used():
    color = np.full((16, 16, 3), 4.0, np.float32)
    assert pixels.Frame({"color": color}).input_scale() == pytest.approx(0.18 / 4, rel=1e-5)


def test_widths_of_the_models():
    """The cost of k16 is that of docs/model-history.md."""
    costs = [nets.build(m, 0).macs_per_pixel() / 1000 for m in ("k8", "k12", "k16", "k24")]
    assert costs == sorted(costs) and costs[2] == pytest.approx(20.0, abs=0.1)
    assert nets.find_model("k16")[0].name == "kernel5"
    with pytest.raises(ValueError, match="needs 14 widths"):
        nets.build("kernel5:4,4", 0)
    with pytest.raises(ValueError, match="whole numbers"):
        nets.build("kernel5:4,x", 0)
