"""Family K: the filter operation, the network against the numpy reference, training."""
from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from export import kernel, pixels
from training import kernel_filter, kernel_net, train_kernel
from training.errors import ToolError

CONFIG = train_kernel.Config("kernel5", [4, 4, 4, 4, 8, 8, 8, 8, 8, 8, 8, 8, 4, 4], batch_size=2,
                             tile_size=32)


def random_batch(seed: int = 0, size: int = 32) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    x = torch.from_numpy(rng.random((2, 9, size, size), np.float32) * 0.5)
    return x, x[:, :3] * 0.9 + 0.05


def test_plain_filter_is_its_definition():
    rng = np.random.default_rng(1)
    logits, v = rng.normal(size=(1, 25, 5, 6)), rng.random((1, 2, 5, 6))
    out = kernel_filter.plain(torch.from_numpy(logits), torch.from_numpy(v)).numpy()
    expected = np.zeros_like(v)
    for y in range(5):
        for x in range(6):
            for k in range(25):
                sy, sx = y + k // 5 - 2, x + k % 5 - 2
                if 0 <= sy < 5 and 0 <= sx < 6:
                    expected[0, :, y, x] += np.exp(logits[0, k, y, x]) * v[0, :, sy, sx]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def test_fused_filter_equals_the_plain_one_and_its_gradient():
    if kernel_filter.fused_module() is None:
        pytest.skip("optional: no C++ compiler for the fused operation")
    torch.manual_seed(0)
    logits = torch.randn(2, 25, 5, 7, dtype=torch.double, requires_grad=True)
    v = torch.rand(2, 4, 5, 7, dtype=torch.double, requires_grad=True)
    torch.testing.assert_close(kernel_filter.kernel_filter(logits, v),
                               kernel_filter.plain(logits, v))
    assert torch.autograd.gradcheck(kernel_filter._Fused.apply, (logits, v))


def test_fused_split_equals_the_plain_one_and_its_gradient(monkeypatch):
    if kernel_filter.fused_module() is None:
        pytest.skip("optional: no C++ compiler for the fused operation")
    torch.manual_seed(0)
    q = torch.randn(2, 7, 5, 6) * 12 + 8
    weights = [torch.randn(2, n, 5, 6) for n in (4, 1, 2)]
    results = []
    for fused in (True, False):
        if not fused:
            monkeypatch.setattr(kernel_filter, "fused_module", lambda: None)
        x = q.clone().requires_grad_()
        parts = kernel_filter.split_codes(x, [4, 1, 2], 16.0)
        sum((p * w).sum() for p, w in zip(parts, weights, strict=True)).backward()
        results.append((torch.cat(parts, 1).detach(), x.grad))
    assert torch.equal(results[0][0], results[1][0])
    torch.testing.assert_close(results[0][1], results[1][1])
    assert (results[0][1] == 0).any() and (results[0][1] != 0).any()


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
    got = kernel_net.apply_filter(heads, *batch, torch.ones(1, 1, 32, 48))
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


def test_training_lowers_the_loss_and_is_deterministic():
    config = replace(CONFIG, drop_features=0.0, clip=0.0)
    losses = []
    for _ in range(2):
        torch.manual_seed(1)
        net = train_kernel.make_net(config)
        optimizer = torch.optim.Adam(net.parameters(), 3e-3)
        row = []
        for _ in range(15):
            tiles = train_kernel.mutate(*random_batch(), config, np.random.default_rng(0))
            loss = train_kernel.loss_of(train_kernel.run(net, tiles), tiles.target)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            row.append(loss.item())
        losses.append(row)
    assert losses[0] == losses[1]
    assert losses[0][-1] < losses[0][0]


def test_learning_rate_rises_and_falls():
    rates = [train_kernel.rate(CONFIG, f) for f in np.linspace(0, 1, 101)]
    top = int(np.argmax(rates))
    assert 3 <= top <= 7 and rates[top] == pytest.approx(CONFIG.learning_rate)
    assert rates == sorted(rates[:top + 1]) + sorted(rates[top + 1:], reverse=True)


@pytest.mark.parametrize("text", ["{", '{"net": "kernel5"}',
                                  '{"net": "kernel5", "widths": [1], "x": 1}'])
def test_bad_configurations_are_named(tmp_path, text):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(ToolError, match="c.json"):
        train_kernel.read_config(path)


def test_config_of_the_shipped_model_is_valid():
    path = train_kernel.nets.ROOT / "training" / "configs" / "kernel5_16.json"
    config = train_kernel.read_config(path)
    assert json.loads(path.read_text())["widths"] == config.widths
    assert 15e3 < train_kernel.make_net(config).macs_per_pixel() < 25e3


def test_exposure_of_reference_frames_is_used():
    color = np.full((16, 16, 3), 4.0, np.float32)
    assert pixels.Frame({"color": color}).input_scale() == pytest.approx(0.18 / 4, rel=1e-5)
