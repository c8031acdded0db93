"""The built-in models use all of their network: no layer has mostly dead channels, which cost time
and size and leave the filter's coarse levels the same everywhere."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from export import kernel, synthetic
from export.prune import active_channels
from tests.apps import tools
from training.imageio import read_exr_channels

BUILT_IN = tools.built_in(Path(__file__).parents[2])
SIDE = 128


@pytest.fixture(scope="module")
def pictures(root) -> list[list[np.ndarray]]:
    """Colour, albedo and normals of parts of the demo's picture and of synthetic ones of 1 to 32
    samples."""
    planes = read_exr_channels(root / "demo" / "house_0004spp.exr")
    house = [np.stack([planes[name] for name in names], -1).astype(np.float32)
             for names in ("RGB", [f"albedo.{c}" for c in "RGB"], [f"normal.{c}" for c in "XYZ"])]
    pictures = [[image[y:y + SIDE, x:x + SIDE] for image in house]
                for y, x in ((0, 0), (house[0].shape[0] - SIDE, house[0].shape[1] - SIDE))]
    for samples in (1, 4, 32):
        made = synthetic.noisy(SIDE, samples, samples)
        pictures.append([made["color"], made["albedo"], made["normal"]])
    return pictures


def codes_of(pictures: list[list[np.ndarray]], is_alone: bool) -> list[np.ndarray]:
    """As the network sees them; alone: albedo and normals instead, as models for these do."""
    if is_alone:
        return [kernel.encode(v, None, v * 2 - 1, True)
                for _, albedo, normal in pictures for v in (albedo, normal / 2 + np.float32(0.5))]
    return [kernel.encode(light * np.float32(scale), *features, False)
            for light, albedo, normal in pictures for scale in (0.3, 3.0)
            for features in ((albedo, normal), (None, None))]


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_layer_is_dead(root, pictures, name):
    """With and without features, at two exposures."""
    model = kernel.load(root / "weights" / name)
    alive = active_channels(model, codes_of(pictures, model.is_alone))
    most = 0.8 if model.is_alone else 0.5  # noise of features hardly reaches the coarsest levels
    dead = {k: f"{(~v).sum()} of {v.size}" for k, v in alive.items() if (~v).mean() > most}
    assert not dead


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_level_looks_at_the_picture(root, pictures, name):
    """The kernels of each level differ from place to place."""
    model = kernel.load(root / "weights" / name)
    maps = model.maps(codes_of(pictures, model.is_alone)[0])
    for head in model.net.heads:
        taps = maps[head][..., :25].astype(float)
        assert taps.std((0, 1)).max() > 1, head
