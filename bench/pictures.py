"""Pictures for the comparisons: real renders with albedo and normal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.oidn import ROOT
from training.imageio import read_exr_channels, write_pfm

SHARED = ROOT.parent / "shared" / "images"  # renders beside the checkout, where there are any
# (file, left, top, width, height): three sizes, two of them odd
CROPS = (
    ("house/house_0004spp.exr", 0, 0, 320, 208),
    ("staircase/staircase_0016spp.exr", 3, 40, 203, 257),
    ("spheres-4spp/noisy.exr", 101, 77, 345, 131),
)


@dataclass(frozen=True)
class Picture:
    """A noisy render: three images [H,W,3] float32, linear."""

    name: str
    color: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray

    def crop(self, x: int, y: int, width: int, height: int) -> Picture:
        window = (slice(y, y + height), slice(x, x + width))
        images = [np.ascontiguousarray(i[window]) for i in (self.color, self.albedo, self.normal)]
        return Picture(f"{self.name} {width}x{height}", *images)


def load(path: Path) -> Picture:
    """A multichannel EXR with R,G,B, albedo.R/G/B and normal.X/Y/Z."""
    channels = read_exr_channels(path)

    def stack(*names: str) -> np.ndarray:
        return np.stack([channels[n] for n in names], -1).astype(np.float32)

    name = path.stem if path.stem != "noisy" else path.parent.name
    return Picture(name, stack("R", "G", "B"), stack("albedo.R", "albedo.G", "albedo.B"),
                   stack("normal.X", "normal.Y", "normal.Z"))


def sizes() -> list[Picture]:
    """Pictures of three sizes, from the shared renders or, without them, from the demo's."""
    if SHARED.is_dir():
        return [load(SHARED / name).crop(*box) for name, *box in CROPS]
    whole = load(demo())
    height, width = whole.color.shape[:2]
    return [whole, whole.crop(3, 5, width * 2 // 3 | 1, height // 2 | 1),
            whole.crop(10, 2, width // 3 | 1, height * 2 // 3)]


def demo() -> Path:
    found = sorted((ROOT / "demo").glob("*.exr"))
    if not found:
        raise FileNotFoundError("demo/ holds no EXR")
    return found[0]


def mirrored(picture: Picture, width: int, height: int) -> Picture:
    """The picture repeated, every second copy mirrored, up to this size."""
    def fill(image: np.ndarray) -> np.ndarray:
        pad_y, pad_x = max(0, height - image.shape[0]), max(0, width - image.shape[1])
        grown = np.pad(image, ((0, pad_y), (0, pad_x), (0, 0)), "symmetric")
        return np.ascontiguousarray(grown[:height, :width])
    return Picture(f"{picture.name} mirrored to {width}x{height}", fill(picture.color),
                   fill(picture.albedo), fill(picture.normal))


def write_inputs(folder: Path, images: dict[str, np.ndarray], suffix: str = "") -> list[str | Path]:
    """Writes images as PFM files; returns the options of oidnDenoise that name them."""
    options: list[str | Path] = []
    for name, image in images.items():
        path = folder / f"{name}{suffix}.pfm"
        write_pfm(path, image)
        options += [f"--{name}", path]
    return options
