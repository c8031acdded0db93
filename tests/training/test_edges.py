"""Averages along edges."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from export import edges
from tests.training.test_kernel import picture, tensor
from training.calm import details_of
from training.edges import averaged, ragged

RAGGED = np.array([0.2, 0.5, 1], np.float32)


def jagged(height: int, width: int) -> np.ndarray:
    """A dark and a bright half, whose edge each row has at another place."""
    rng = np.random.default_rng(6)
    edge = width / 2 + np.linspace(-3, 3, height) + rng.uniform(-0.7, 0.7, height)
    image = np.where(np.arange(width) < edge[:, None], 0.2, 1.5)[..., None] * [1, 0.8, 0.6]
    return (image * rng.uniform(0.98, 1.02, image.shape)).astype(np.float32)


def seen(samples: int, noise: float = 1.0, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Radiance and albedo of slanted stripes, of so many samples a pixel that each see one stripe,
    light of the same mean in all of them, of exponential or less noise."""
    rng = np.random.default_rng(7)
    shape = 96, 128
    y, x = np.indices(shape)
    hits = [np.sin((x + rng.random(shape) + 0.1 * (y + rng.random(shape))) * count / 64) > 0
            for _ in range(samples)]
    albedo = 0.2 + 0.5 * np.mean(hits, 0)[..., None]
    light = 1 + noise * (rng.exponential(1, (samples, *shape)).mean(0) - 1)[..., None]
    albedo = np.broadcast_to(albedo, (*shape, 3)).astype(np.float32)
    return (albedo * light).astype(np.float32), albedo


@pytest.mark.parametrize("samples, least, most", [(1, 0.95, 1), (16, 0, 0.05), (64, 0, 0)])
def test_edges_of_one_sample_are_ragged(samples, least, most):
    assert least <= edges.ragged(*seen(samples, 4 if samples > 1 else 1, 10)) <= most


def test_edges_of_calm_light_are_not():
    """Clean features may be aliased: their light tells."""
    assert edges.ragged(*seen(1, 0.1)) == 0


def test_without_edges_light_decides_and_without_albedo_nothing():
    radiance, albedo = seen(1)
    assert edges.ragged(radiance, np.full_like(albedo, 0.5)) == 1
    assert edges.ragged(radiance, None) == 0


def test_it_is_its_definition():
    """Pixel by pixel."""
    image, raggedness = np.random.default_rng(7).gamma(2, 0.3, (9, 14, 3)).astype(np.float32), 0.6
    expected = image.astype(np.float64)
    light = expected.sum(-1)
    for y in range(1, 8):
        for x in range(1, 13):
            ends = [((y, x - 1), (y, x + 1)), ((y - 1, x), (y + 1, x)),
                    ((y - 1, x - 1), (y + 1, x + 1)), ((y - 1, x + 1), (y + 1, x - 1))]
            changes = [abs(light[a] - light[y, x]) + abs(light[b] - light[y, x]) for a, b in ends]
            a, b = ends[int(np.argmin(changes))]
            least, most = min(changes), max(changes)
            contrast = np.clip((most / (light[y, x] + 0.18) - 0.2) * 5, 0, 1)
            evenness = np.clip((most - least) / most / 0.3, 0, 1)
            mean = (image[a].astype(np.float64) + image[b] + image[y, x]) / 3
            expected[y, x] += 0.5 * contrast * evenness * raggedness * (mean - expected[y, x])
    got = edges.averaged(image, np.float32(raggedness))
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, expected, rtol=2e-6)


def test_frames_that_are_not_ragged_stay():
    image = jagged(20, 30)
    assert edges.averaged(image, np.float32(0)) is image
    assert averaged(tensor(image), torch.zeros(1, 1, 1, 1)).equal(tensor(image))


def test_edges_become_smoother_and_flat_places_stay():
    image = jagged(64, 64)
    got = edges.averaged(image, np.float32(1))
    smooth = np.clip(np.arange(64) - (32 + np.linspace(-3, 3, 64))[:, None] + 0.5, 0, 1)
    truth = (0.2 + 1.3 * smooth[..., None]) * [1, 0.8, 0.6]
    assert np.square(got - truth).mean() < 0.9 * np.square(image - truth).mean()
    np.testing.assert_array_equal(got[:, :20], image[:, :20])
    np.testing.assert_array_equal(got[[0, -1]], image[[0, -1]])


@pytest.mark.parametrize("size", [(1, 1), (2, 9), (3, 3), (24, 31)])
@pytest.mark.parametrize("raggedness", RAGGED)
def test_averages_of_torch_equal_the_reference(size, raggedness):
    images = [jagged(*size), np.random.default_rng(9).gamma(1, 1, (*size, 3)).astype(np.float32)]
    got = averaged(torch.cat([tensor(v) for v in images]),
                   torch.tensor([raggedness, 0.0]).view(2, 1, 1, 1))
    np.testing.assert_allclose(picture(got[:1]), edges.averaged(images[0], raggedness), rtol=2e-6)
    np.testing.assert_array_equal(picture(got[1:]), images[1])


def test_raggedness_of_torch_equals_the_reference():
    """Tile by tile."""
    frames = [seen(1), seen(6, 4, 10), seen(16, 4), seen(1, 0.3), seen(1, 0.5), seen(1, 1, 3)]
    radiance, albedo = (torch.cat([tensor(v[i]) for v in frames]) for i in (0, 1))
    has_albedo = torch.ones(len(frames), 1, 1, 1)
    expected = [edges.ragged(*v) for v in frames]
    assert len(set(expected)) > 3
    got = ragged(details_of(radiance), albedo, has_albedo)
    assert got.shape == has_albedo.shape
    np.testing.assert_allclose(got.ravel(), expected, atol=0.01)
    assert not ragged(details_of(radiance), albedo, 0 * has_albedo).any()
    assert not ragged(details_of(radiance[..., :4]), albedo[..., :4], has_albedo).any()


def test_gradients_pass():
    """To pixels and the ends of their lines; what chooses the lines has none."""
    image = tensor(jagged(12, 16)).requires_grad_()
    averaged(image, torch.ones(1, 1, 1, 1)).sum().backward()
    assert image.grad.isfinite().all() and image.grad.sum().item() == pytest.approx(3 * 12 * 16)
    assert image.grad.std() > 0.01
