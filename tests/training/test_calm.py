"""How calm a frame is."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from export import calm
from tests.training.test_kernel import tensor
from training.calm import calm_share, details_of


def picture(height: int, width: int, noise: float, part: float = 1.0) -> np.ndarray:
    """A slope of light with so much noise, relative to it, in this part of its rows from the top,
    ten times as much in the others."""
    rng = np.random.default_rng(3)
    light = np.linspace(0.3, 1.5, width)[None, :, None] * np.array([1, 0.8, 0.5])
    std = np.where(np.arange(height) < part * height, noise, 10 * noise)[:, None, None]
    return (light * np.exp(std * rng.normal(size=(height, width, 3)))).astype(np.float32)


@pytest.mark.parametrize("height, width, step", [
    (1, 1, 4), (5, 5, 4), (144, 144, 4), (208, 320, 8), (512, 512, 16), (1080, 1920, 32),
    (5, 65536, 64), (65536, 65536, 2048)])
def test_cells_are_a_few_thousand(height, width, step):
    assert calm.spacing(height, width) == step


@pytest.mark.parametrize("noise, part, share", [
    (0.01, 1.0, 1.0), (0.2, 1.0, 0.0), (0.0, 1.0, 0.0), (0.01, 0.5, 0.0)])
@pytest.mark.parametrize("size", [(160, 200), (300, 500)])
def test_share_is_that_of_cells_with_little_noise(size, noise, part, share):
    """Cells without any say nothing; where others are full of noise, none is calm."""
    assert calm.calm_share(picture(*size, noise, part)) == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("pixels, least, most", [(1, 0.0, 0.0), (2, 0.3, 0.45)])
def test_texture_in_some_places_leaves_a_frame_calm(pixels, least, most):
    """That of two pixels, that is; what differs from pixel to pixel is noise by its looks."""
    image = picture(160, 200, 0.01)
    texture = np.random.default_rng(4).uniform(0.7, 1.3, (160, 160, 1))
    image[:, 40:] *= texture.repeat(pixels, 0).repeat(pixels, 1)[:160, :160].astype(np.float32)
    assert least <= calm.calm_share(image) <= most


def test_texture_of_the_albedo_is_no_detail():
    """Even light on a texture that differs from pixel to pixel: noise by its looks, without the
    albedo that tells."""
    light = picture(160, 200, 0.01)
    albedo = np.random.default_rng(4).uniform(0.1, 1, (160, 200, 3)).astype(np.float32)
    assert calm.frame_calm(light * albedo, None) < 0.01
    assert calm.frame_calm(light * (albedo + 0.02), albedo) > 0.97
    assert calm.frame_calm(light, albedo) < 0.01


@pytest.mark.parametrize("size", [(4, 80), (80, 4), (1, 1)])
def test_frames_too_small_for_a_cell_are_not_calm(size):
    image = picture(*size, 0.01)
    assert calm.calm_share(image) == 0 and calm_share(details_of(tensor(image))).item() == 0


@pytest.mark.parametrize("size", [(5, 5), (37, 45), (144, 144), (300, 401)])
@pytest.mark.parametrize("noise", [0.01, 0.025, 0.04])
def test_torch_equals_the_reference(size, noise):
    """Tile by tile, but for cells at the limit."""
    images = [picture(*size, noise), picture(*size, noise, 0.3), np.full((*size, 3), 0.4)]
    got = calm_share(details_of(torch.cat([tensor(v.astype(np.float32)) for v in images])))
    expected = [calm.calm_share(v.astype(np.float32)) for v in images]
    assert got.shape == (3, 1, 1, 1)
    np.testing.assert_allclose(got.ravel().numpy(), expected, atol=0.002)
