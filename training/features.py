"""From files to features: reading, ranges, network codes.

After `load`: hdr >= 0; ldr in [0,1]; alb in [0,64], lamps above 1; nrm, sh1 in [-1,1]; z >= 0;
all finite float32.
"""
from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from export.albedo import ALBEDO_MOST
from training import color
from training.errors import DATA, USAGE, ToolError
from training.exr_channels import Channels, Origin
from training.imageio import read_exr_channels, read_image, read_placed, stack
from training.layers import find_channels, find_images
from training.scan import ALIASES, CHANNELS, FEATURES, MAIN_FEATURES, Version

FLT_MAX = float(np.finfo(np.float32).max)
SIGNED = ("nrm", "sh1")


class Images(dict[str, np.ndarray]):
    """Features by name; origin: where the data window of their EXR files begins, None without."""

    origin: Origin | None = None


def clean(image: np.ndarray, feature: str) -> np.ndarray:
    """Finite values in the range of the feature: NaN -> 0, infinities to the ends of the range."""
    low, high = {"hdr": (0.0, FLT_MAX), "z": (0.0, FLT_MAX), "alb": (0.0, ALBEDO_MOST)}.get(
        feature, (-1.0, 1.0) if feature in SIGNED else (0.0, 1.0))
    return np.clip(np.nan_to_num(image, nan=0.0, posinf=FLT_MAX, neginf=-FLT_MAX), low, high,
                   dtype=np.float32)


def _fit(image: np.ndarray, channels: int) -> np.ndarray:
    """First `channels` channels; missing ones repeat the last."""
    have = image.shape[-1]
    if have < channels:
        image = np.concatenate([image] + [image[..., -1:]] * (channels - have), -1)
    return image[..., :channels]


def load_raw(version: Version, feature: str, layers: dict[str, str] | None = None,
             opened: dict[Path, Channels] | None = None) -> tuple[np.ndarray, Origin | None]:
    """(the stored values of one feature, [H,W,C] float32, before any cleaning; where the data
    window of its EXR begins).

    opened: channels of multichannel files by path; filled here, so that each is read once.
    """
    if "*" in version.files and feature not in version.files and feature != "sh1":
        path = version.files["*"]
        channels = _channels_of(path, opened)
        names = find_images(feature, channels, layers)
        if names is None:
            light = find_channels(feature, channels, (layers or {}).get(feature))
            why = f"{', '.join(light)} is light; has" if light else "has"
            raise ToolError(f"{path}: no channels for '{feature}' ({why}: {', '.join(channels)}; "
                            f"choose with --layers {feature}=PREFIX)", DATA)
        return (_fit(stack(path, channels, names), CHANNELS[feature]),
                channels.origins[names[0]])
    if feature == "sh1":
        parts = [_fit(read_image(version.files[f"sh1{a}"]), 3) for a in "xyz"]
        if len({p.shape for p in parts}) > 1:
            raise ToolError(f"{version.name}: sh1x, sh1y and sh1z differ in size", DATA)
        return np.concatenate(parts, -1), None
    path = version.files[feature]
    if path.suffix.lower() == ".exr":
        image, origin = read_placed(path, feature)
        return _fit(image, CHANNELS[feature]), origin
    image = _fit(read_image(path), CHANNELS[feature])
    if feature == "hdr" and path.suffix.lower() == ".png":
        raise ToolError(f"{path}: 8 or 16 bit pictures cannot hold 'hdr', name it .ldr.png", DATA)
    return decoded(image, feature, path), None


def decoded(image: np.ndarray, feature: str, path: Path) -> np.ndarray:
    """Values of a feature from what a file of it holds: PNG has sRGB codes, of normals
    n*0.5+0.5."""
    if feature in ("ldr", "alb") and path.suffix.lower() == ".png":
        return color.srgb_inverse(image)
    if feature == "nrm" and path.suffix.lower() == ".png":
        return image * 2.0 - 1.0
    return image


def _channels_of(path: Path, opened: dict[Path, Channels] | None) -> Channels:
    """Channels of a multichannel file, read unless they are in `opened`."""
    opened = {} if opened is None else opened
    if path not in opened:
        opened[path] = read_exr_channels(path)
    return opened[path]


def holds(version: Version, features: list[str], layers: dict[str, str] | None = None,
          opened: dict[Path, Channels] | None = None) -> bool:
    """Whether a version has all these features; multichannel files are looked into.

    opened: as in load_raw.
    """
    alone = [f for f in features if f in version.files or f == "sh1"]
    rest = [f for f in features if f not in alone]
    if "*" not in version.files or not rest:
        return not version.missing(features)
    channels = _channels_of(version.files["*"], opened)
    return all(find_images(f, channels, layers) for f in rest)


def load(version: Version, features: list[str], layers: dict[str, str] | None = None,
         opened: dict[Path, Channels] | None = None) -> Images:
    """Features of a version by name, cleaned; all of one size, at one place. opened: as in
    load_raw."""
    opened = {} if opened is None else opened
    images, origins = {}, {}
    for feature in features:
        image, origin = load_raw(version, feature, layers, opened)
        images[feature] = clean(image, feature)
        if origin:
            origins[feature] = origin
    return placed(version.name, images, origins)


def placed(name: str, images: Mapping[str, np.ndarray],
           origins: Mapping[str, Origin]) -> Images:
    """The features of the picture `name`; ToolError unless all are of one size, at one place."""
    if len({i.shape[:2] for i in images.values()}) > 1:
        text = ", ".join(f"{f} {i.shape[1]}x{i.shape[0]}" for f, i in images.items())
        raise ToolError(f"{name}: features differ in size ({text})", DATA)
    if len(set(origins.values())) > 1:
        text = ", ".join(f"{f} at {x},{y}" for f, (x, y) in origins.items())
        raise ToolError(f"{name}: data windows begin at different pixels ({text})", DATA)
    together = Images(images)
    together.origin = next(iter(origins.values()), None)
    return together


def check_beside(version: Version, images: Images, target: Images,
                 called: str = "its reference") -> None:
    """ToolError unless the reference of a version, or what else is `called` so, is of its size, at
    its place."""
    (h, w), (height, width) = (next(iter(i.values())).shape[:2] for i in (images, target))
    if (h, w) != (height, width):
        raise ToolError(f"{version.name}: {w}x{h} pixels, {called} has {width}x{height}", DATA)
    if images.origin and target.origin and images.origin != target.origin:
        (x, y), (left, top) = images.origin, target.origin
        raise ToolError(f"{version.name}: the data window begins at {x},{y}, that of {called} "
                        f"at {left},{top}", DATA)


def encode(images: dict[str, np.ndarray], main: str, transfer: str,
           exposure: float = 1.0, most: float = 1.0) -> np.ndarray:
    """Network codes, [H,W,C] float32: main feature through the transfer function, aux in [0,1], but
    for an albedo up to `most`."""
    parts = []
    for feature, image in images.items():
        if feature in SIGNED:
            image = image * 0.5 + 0.5
        if feature == "alb":
            image = np.minimum(image, 1.0 if feature == main else most)
        if feature == main:
            with np.errstate(over="ignore"):
                image = np.minimum(image * np.float32(exposure), FLT_MAX)
            image = color.TRANSFERS[transfer].forward(image)
        elif feature == "z":
            image = color.log_forward(image)
        parts.append(image)
    return np.concatenate(parts, -1).astype(np.float32)


def short_names(names: Sequence[str]) -> list[str]:
    """Features by their short names, without repeats, in the order in which networks get them."""
    short = [ALIASES.get(n.lower(), n.lower()) for n in names]
    wrong = [n for n in short if n not in FEATURES]
    if wrong:
        raise ToolError(f"unknown feature '{wrong[0]}' (known: {' '.join(FEATURES)})", USAGE)
    return [f for f in FEATURES if f in short]


def parse_layers(rows: Sequence[str]) -> dict[str, str]:
    """The rows feature=prefix of --layers."""
    layers = {}
    for row in rows:
        feature, equals, prefix = row.partition("=")
        if not equals:
            raise ToolError(f"--layers {row}: not feature=prefix", USAGE)
        layers[short_names([feature])[0]] = prefix
    return layers


def add_layers(parser: argparse.ArgumentParser) -> None:
    """The option of parsers of their own, for parse_layers."""
    parser.add_argument("--layers", nargs="*", default=[], metavar="FEATURE=PREFIX",
                        help="layers of multichannel EXR files")


def main_feature(features: list[str]) -> str:
    """The feature that is denoised; the others are auxiliary."""
    mains = [f for f in features if f in MAIN_FEATURES]
    if len(mains) > 1:
        raise ToolError("multiple main features specified (one of hdr, ldr, sh1)", 2)
    if mains:
        return mains[0]
    if len(features) == 1:
        return features[0]
    raise ToolError("no main feature specified (one of hdr, ldr, sh1)", 2)
