"""Losses and metrics against direct definitions."""

import numpy as np
import pytest
import torch

from training import color, loss, metrics
from training.loss import (LEAST_MSE, LOSSES, STANDARD_WEIGHTS, balance, l1_grad, make_loss,
                           msssim_scales, msssim_value, ssim_value)


def pair(size=64, seed=0):
    rng = np.random.default_rng(seed)
    b = rng.random((2, 3, size, size)).astype(np.float32)
    a = np.clip(b + rng.normal(0, 0.1, b.shape), 0, 1).astype(np.float32)
    return torch.from_numpy(a), torch.from_numpy(b)


@pytest.mark.parametrize("name,want", [
    ("l1", lambda a, b: np.abs(a - b).mean()),
    ("l2", lambda a, b: ((a - b) ** 2).mean()),
    ("mape", lambda a, b: (np.abs(a - b) / (np.abs(b) + 0.01)).mean()),
    ("smape", lambda a, b: (np.abs(a - b) / (np.abs(a) + np.abs(b) + 0.01)).mean()),
])
def test_pointwise_losses(name, want):
    a, b = pair()
    assert float(make_loss(name)(a, b)) == pytest.approx(want(a.numpy(), b.numpy()), rel=1e-5)


def test_l1_grad():
    a, b = pair()
    d = (a - b).numpy()
    dx, dy = np.diff(d, axis=3), np.diff(d, axis=2)
    grad = (np.abs(dx).sum() + np.abs(dy).sum()) / (dx.size + dy.size)
    want = 0.5 * np.abs(d).mean() + 0.5 * grad
    assert float(make_loss("l1_grad")(a, b)) == pytest.approx(want, rel=1e-5)


def slow_ssim(a, b):
    """Mean SSIM of two [H,W] arrays, window by window."""
    x = np.arange(11) - 5
    g = np.exp(-(x**2) / 4.5)
    w = np.outer(g, g) / np.outer(g, g).sum()
    values = []
    for i in range(a.shape[0] - 10):
        for j in range(a.shape[1] - 10):
            p, q = a[i:i + 11, j:j + 11], b[i:i + 11, j:j + 11]
            mp, mq = (w * p).sum(), (w * q).sum()
            vp, vq = (w * p * p).sum() - mp**2, (w * q * q).sum() - mq**2
            c = (w * p * q).sum() - mp * mq
            values.append((2 * mp * mq + 1e-4) * (2 * c + 9e-4)
                          / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4)))
    return np.mean(values)


def test_ssim_is_its_definition():
    a, b = pair(20)
    want = np.mean([slow_ssim(a[n, c].double().numpy(), b[n, c].double().numpy())
                    for n in range(2) for c in range(3)])
    assert float(ssim_value(a, b)) == pytest.approx(want, abs=1e-4)
    assert float(ssim_value(b, b)) == pytest.approx(1, abs=1e-6)


def test_ssim_is_the_same_for_tiles_as_for_pictures(monkeypatch):
    """Products of matrices and convolutions, values and gradients."""
    a, b = pair(31)
    a = a[..., :20].clone().requires_grad_()
    b = b[..., :20]
    results = []
    for limit in (loss.BLUR_BY_MATRIX, 0):
        monkeypatch.setattr(loss, "BLUR_BY_MATRIX", limit)
        value = ssim_value(a, b)
        results.append((value.item(), torch.autograd.grad(value, a)[0]))
    assert results[0][0] == pytest.approx(results[1][0], abs=1e-6)
    assert torch.allclose(results[0][1], results[1][1], rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize("size", [128, 272])
def test_ssim_is_exact_in_mixed_precision(size):
    """Variances are small differences of means: in bf16 0.9975 was 0.9961."""
    _, b = pair(size)
    a = b + 0.02 * torch.randn(b.shape, generator=torch.Generator().manual_seed(1))
    want = float(ssim_value(a, b))
    with torch.autocast("cpu", torch.bfloat16):
        assert float(ssim_value(a, b)) == pytest.approx(want, abs=1e-6)


def test_msssim_scales_fit_the_picture():
    assert msssim_scales(161, 161) == 5
    assert msssim_scales(160, 300) == 4  # five scales would need more than 160
    assert msssim_scales(64, 64) == 3
    assert msssim_scales(12, 12) == 1


def test_msssim_of_one_scale_is_ssim():
    a, b = pair(16)
    value = torch.stack([ssim_value(a[n:n + 1, c:c + 1], b[n:n + 1, c:c + 1])
                         for n in range(2) for c in range(3)])
    assert float(msssim_value(a, b)) == pytest.approx(
        float((value ** sum(STANDARD_WEIGHTS)).mean()), abs=1e-5)


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("size", [32, 176])
def test_every_loss_is_zero_for_equals_and_has_finite_gradients(name, size):
    a, b = pair(size)
    loss = make_loss(name)
    assert float(loss(b, b)) == pytest.approx(0, abs=1e-5)
    a.requires_grad_()
    value = loss(a, b)
    value.backward()
    assert value.item() > 0 and torch.isfinite(a.grad).all() and a.grad.abs().max() > 0
    opposite = (1 - b).requires_grad_()  # SSIM terms below zero
    loss(opposite, b).backward()
    assert torch.isfinite(opposite.grad).all()


def test_log_mse_is_what_psnr_measures():
    """Where codes and what is shown are the same: the mean PSNR but for a factor and the two parts;
    with a transfer function, the mean of squares of both."""
    a, b = pair()
    loss = float(make_loss("log_mse", transfer="srgb")(a, b))
    mean = np.mean([metrics.psnr(x, y) for x, y in zip(a.numpy(), b.numpy())])
    assert loss == pytest.approx(
        0.5 * np.log(2 / LEAST_MSE) - mean * np.log(10) / 20, rel=1e-3)
    shown = [color.display(color.pu_inverse(x.numpy())) for x in (a, b)]
    mse = [metrics.mse(s, t) + metrics.mse(x, y)
           for s, t, x, y in zip(*shown, a.numpy(), b.numpy())]
    assert float(make_loss("log_mse")(a, b)) == pytest.approx(
        np.mean(np.log1p(np.array(mse) / LEAST_MSE)) / 2, rel=1e-4)


def test_log_mse_ssim_adds_what_ssim_lacks():
    """Of what is shown, whatever codes the loss is given."""
    a, b = pair()
    for transfer, inverse in (("srgb", None), ("pu", color.pu_inverse)):
        shown = [torch.from_numpy(color.display(inverse(x.numpy()))) if inverse else x
                 for x in (a, b)]
        lacks = 1 - float(ssim_value(*shown))
        for weight in (1.0, 3.0):
            both = make_loss("log_mse_ssim", transfer=transfer, ssim_weight=weight)(a, b)
            want = float(make_loss("log_mse", transfer=transfer)(a, b)) + weight * lacks
            assert float(both) == pytest.approx(want, rel=1e-5)


def test_weights_of_msssim_matter():
    a, b = pair(176)
    assert float(make_loss("msssim", [0.2] * 5)(a, b)) != float(make_loss("msssim")(a, b))


def test_metrics():
    a, b = (np.full((16, 16, 3), v, np.float32) for v in (0.5, 0.6))
    assert metrics.mse(a, b) == pytest.approx(0.01, rel=1e-4)
    assert metrics.psnr(a, b) == pytest.approx(20, abs=1e-3)
    assert metrics.psnr(a, a) == np.inf
    assert metrics.ssim(a, a) == pytest.approx(1) and metrics.msssim(a, a) == pytest.approx(1)
    # normals are shown from [-1,1]: 0 is grey to the sixth power
    shown = metrics.to_display(np.zeros((1, 1, 3)), "nrm")[0, 0, 0]
    assert shown == pytest.approx(1.055 * (0.5**6) ** (1 / 2.4) - 0.055, rel=1e-5)


def test_balance_makes_tiles_of_little_noise_count():
    """With power 1 each tile counts by the share of its noise that is left."""
    torch.manual_seed(1)
    y = torch.rand(3, 3, 16, 16)
    noise = 0.05 * torch.rand(1, 3, 16, 16).expand(3, -1, -1, -1)  # 0.025 on average
    level = torch.tensor([4.0, 1.0, 0.25]).view(3, 1, 1, 1)
    x = torch.cat((y + level * noise, torch.rand(3, 6, 16, 16)), 1)
    out = y + 0.1 * level * noise  # a tenth is left of each
    for power in (0.0, 0.5, 1.0):
        f = balance(x, y, power)
        assert f.shape == (3, 1, 1, 1) and (power > 0 or (f == 1).all())
        each = [l1_grad(f[i] * out[i:i + 1], f[i] * y[i:i + 1]).item() for i in range(3)]
        least = (0.1 + 0.005) / (0.1 / 16 + 0.005)  # what the smallest noise does to a ratio of 16
        assert each[0] / each[2] == pytest.approx(16 / least**power, rel=0.04)
    assert torch.allclose(balance(y, y, 1.0), torch.tensor(10.0))  # bounded
