"""The regression of family K's filter: what normals and albedo explain of what a result lacks."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from export import regression as exact
from export.cells import cell_sums
from tests.training.test_kernel import picture, tensor
from training import regression

F = np.float32


def scene(height: int, width: int, noise: float) -> list[np.ndarray]:
    """Demodulated result without shading, divisor, features, and noisy radiance that is shaded by
    the normals and, where the albedo is dark, brighter."""
    rng = np.random.default_rng(7)
    normal = rng.normal(size=(height, width, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    smooth = rng.uniform(0.1, 1, (height, width, 1)) * [1, 0.8, 0.6]
    out = np.full((height, width, 3), [0.7, 1, 3])
    shading = 1 + 0.4 * normal[..., :1] - 0.2 * normal[..., 2:] - 0.1 * (smooth[..., :1] - 0.5)
    radiance = out * smooth * shading * np.exp(noise * rng.normal(size=out.shape))
    out, smooth, normal, radiance = (v.astype(F) for v in (out, smooth, normal, radiance))
    return [out, smooth, exact.features_of(normal, smooth), radiance]


def error(result: np.ndarray, images: list[np.ndarray]) -> float:
    """Root mean square of the difference from the radiance, relative to the result."""
    out, smooth, _, radiance = images
    return float(np.sqrt(np.mean((radiance / (out * smooth) - result / out) ** 2)))


@pytest.mark.parametrize("height, width", [(32, 48), (5, 3), (1, 1), (17, 9)])
def test_torch_equals_the_reference(height, width):
    images = scene(height, width, 0.5)
    expected = exact.regressed(*images)
    got = picture(regression.regressed(*(tensor(v) for v in images)))
    assert expected.dtype == F
    np.testing.assert_allclose(got, expected, rtol=2e-4)


def test_finds_shading_that_the_result_lost():
    images = scene(64, 64, 0.0)
    assert error(images[0], images) > 0.2
    assert error(exact.regressed(*images), images) < 0.05


def test_finds_it_in_noise():
    noisy, clean = scene(64, 64, 0.6), scene(64, 64, 0.0)
    assert error(exact.regressed(*noisy), clean) < 0.6 * error(noisy[0], clean)


def test_believes_less_where_there_is_more_noise():
    """Of the slope along normals that vary little: the ridge is then as large as their variance."""
    slopes = []
    for noise in (0.0, 1.5):
        out, smooth, features, radiance = scene(64, 64, noise)
        sums = exact.products(out, smooth, features * F(0.1), radiance)
        slopes.append(exact.coefficients(exact.windows(cell_sums(sums, exact.SIDE)))[0].mean())
    assert slopes[0] > 2 and 0 < slopes[1] < 0.5 * slopes[0]


def test_without_features_nothing_happens():
    out, _, _, radiance = scene(24, 24, 1.0)
    ones = np.ones_like(out)
    features = exact.features_of(np.zeros_like(out), ones)
    np.testing.assert_allclose(exact.regressed(out, ones, features, radiance), out, rtol=2e-5)


@pytest.mark.parametrize("level", [0.0, 1e-30, 65504.0])
def test_extremes_stay_finite_and_in_range(level):
    """Sparks of 65504 in the dark, and black: no result is negative, none more than 1.5 times."""
    out, smooth, features, radiance = scene(24, 24, 3.0)
    out = np.full_like(out, 1e-6)
    radiance = np.where(radiance > np.quantile(radiance, 0.95), F(level), F(0))
    got = exact.regressed(out, smooth, features, radiance)
    assert (got >= 0.499 * out).all() and (got <= 1.501 * out).all()


def test_gradients():
    torch.manual_seed(2)
    images = [tensor(v).double() for v in scene(12, 9, 0.1)]
    for v in images[:3]:
        v.requires_grad_()
    assert torch.autograd.gradcheck(
        lambda *v: regression.regressed(*v)[..., ::5, ::5], images, atol=1e-5)
