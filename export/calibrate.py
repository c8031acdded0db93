"""Pictures for the quantiser: from files, or synthetic ones; as frames and as network inputs."""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from export import synthetic
from export.graph import ALIGN
from export.pixels import Frame, srgb_forward
from export.reference import padded
from training.errors import DATA, USAGE, ToolError
from training.features import clean, decoded, placed
from training.imageio import read_exr_channels, read_image, read_placed, stack
from training.layers import find_images

PIXELS = 1 << 18   # of all calibration pictures together, taken from their middles
LARGEST = 1 << 16  # of one, of those of training data
LEAST = 64         # side of a cut-out
SHORT = {"color": "hdr", "albedo": "alb", "normal": "nrm"}
SYNTHETIC = ((10001, 1), (20000, 4), (30001, 16), (40000, 2))  # (seed, samples per pixel)
SYNTHETIC_SIZE = 208


@dataclass(frozen=True)
class Kind:
    """What a model denoises: the features of its input, and the content of the first one."""

    features: tuple[str, ...]
    content: str

    @staticmethod
    def of(channels: int, content: str, main: str) -> Kind:
        """From the number of input channels; `main` is what a lone feature is."""
        if main != "color":
            features: tuple[str, ...] = (main,)
        else:
            features = ("color", "albedo", "normal")[:channels // 3]
        if channels != 3 * len(features):
            raise ToolError(f"the model has {channels} input channels, "
                            f"not the {3 * len(features)} of {'+'.join(features)}", USAGE)
        return Kind(features, content if main == "color" else "ldr")


def add_kind(parser: argparse.ArgumentParser) -> None:
    """Options that say what a model denoises: `content` and `main`."""
    group = parser.add_mutually_exclusive_group()
    for name, text in (("hdr", "linear radiance (default)"), ("ldr", "linear color in [0,1]"),
                       ("srgb", "color in [0,1], encoded"), ("lightmap-hdr", "lightmaps"),
                       ("lightmap-dir", "directional lightmaps, in [-1,1]")):
        group.add_argument(f"--{name}", dest="content", action="store_const", const=name,
                           help=f"the model denoises {text}")
    for name, text in (("albedo", "albedo"), ("normal", "normals")):
        group.add_argument(f"--{name}", dest="main", action="store_const", const=name,
                           help=f"the model denoises {text} alone")
    parser.set_defaults(content="hdr", main="color")


def read_picture(path: Path, kind: Kind, optional: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """The features of one picture: a file of layers, or x.hdr.exr with .alb and .nrm beside it.

    optional: further features, which are left out where there are none."""
    path = Path(path)
    if not path.is_file():
        raise ToolError(f"{path}: no such file", DATA)
    parts = path.name.split(".")
    triple = len(parts) > 2 and parts[-2] in ("hdr", "ldr", "alb", "nrm")
    images: dict[str, np.ndarray] = {}
    origins = {}
    for feature in (*kind.features, *optional):
        image = None
        short = SHORT[feature]
        if triple:
            letters = parts[-2] if short == "hdr" and parts[-2] == "ldr" else short
            file = path.with_name(".".join([*parts[:-2], letters, parts[-1]]))
            if file.is_file() and file.suffix.lower() == ".exr":
                image, origin = read_placed(file, short)
                origins[feature] = origin
            elif file.is_file():
                image = decoded(read_image(file), _coded(feature, kind), file)
        elif path.suffix.lower() == ".exr":
            channels = read_exr_channels(path)
            if names := find_images(short, channels):
                image = stack(path, channels, names)
                origins[feature] = channels.origins[names[0]]
        elif feature == kind.features[0]:
            image = decoded(read_image(path), _coded(feature, kind), path)
        if image is not None:
            images[feature] = image
        elif feature in kind.features:
            raise ToolError(f"{path}: the model needs {'+'.join(kind.features)}, "
                            f"there is no {feature}", DATA)
    return placed(str(path), images, origins)


def _coded(feature: str, kind: Kind) -> str:
    """The feature whose codes a PNG of this one has; hdr: the values as they are."""
    if feature != "color":
        return SHORT[feature]
    return {"srgb": "hdr", "lightmap-dir": "nrm"}.get(kind.content, "ldr")


def frame_of(images: dict[str, np.ndarray], kind: Kind, scale: float | None = None) -> Frame:
    return Frame(images, kind.content, scale)


def synthetic_frames(kind: Kind) -> list[Frame]:
    """The built-in pictures as the model's content wants them."""
    frames = []
    for seed, samples in SYNTHETIC:
        images = synthetic.noisy(SYNTHETIC_SIZE, seed, samples)
        if kind.content in ("ldr", "srgb"):
            images["color"] = np.clip(images["color"], 0, 1)
        if kind.content == "srgb":
            images["color"] = srgb_forward(images["color"])
        if kind.content == "lightmap-dir":
            images["color"] = images["normal"] * clean(images["color"], "ldr")
        frames.append(frame_of({f: images[f] for f in kind.features}, kind))
    return frames


def middle(x: np.ndarray, pixels: int = LARGEST) -> np.ndarray:
    """A cut-out of about that many pixels from the middle; all of smaller pictures."""
    h, w = x.shape[:2]
    side = max(int(np.sqrt(pixels)) // ALIGN * ALIGN, LEAST)
    height = min(h, max(side, pixels // w // ALIGN * ALIGN))
    width = min(w, max(side, pixels // h // ALIGN * ALIGN))
    y, x0 = (h - height) // 2, (w - width) // 2
    return x[y:y + height, x0:x0 + width]


def network_inputs(frames: Sequence[Frame]) -> list[np.ndarray]:
    """Padded network inputs [H,W,C]; large pictures are exposed as a whole, then cut."""
    share = PIXELS // max(len(frames), 1)
    return [padded(middle(f.network_input(), share)) for f in frames]
