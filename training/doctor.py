#!/usr/bin/env python3
"""Look for what is wrong with a raw data set before time is spent on it.

    python -m training.doctor hdr alb nrm -D data -i train

Prints the summary of the data set and one line per finding; the status is 3 if anything was found.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.doctor", run_name="__main__", alter_sys=True))

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from training import color, errors, metrics
from training.errors import DATA, ToolError
from training.features import FLT_MAX, check_beside, clean, holds, load_raw, placed
from training.scan import Group, Version, scan
from training.settings import parse

FAR = 1e-3
LAMPS = 0.25     # of the pixels may have more albedo than 1: emitters, as Cycles has them
BLANK = 1 / 127  # 8 bits have no code for a normal of 0, where nothing is hit


def check_values(version: Version, raw: dict[str, np.ndarray]) -> Iterator[str]:
    """Findings about the values of one render, by feature."""
    for feature, image in raw.items():
        bad = ~np.isfinite(image)
        if bad.any():
            yield f"{feature}: {bad.any(-1).sum()} pixels with NaN or infinity"
        image = np.where(bad, 0, image)
        if feature in ("hdr", "ldr", "alb", "z") and (image < -FAR).any():
            yield f"{feature}: negative values (down to {image.min():.3g})"
        if feature in ("ldr", "alb"):
            share = (image > 1 + FAR).any(-1).mean()
            if share > (LAMPS if feature == "alb" else 0):
                yield f"{feature}: above 1 (up to {image.max():.3g}, {share:.1%} of the pixels)"
        if feature in ("nrm", "sh1") and np.abs(image).max() > 1 + 0.05:
            yield f"{feature}: outside [-1,1] (up to {np.abs(image).max():.3g})"
        if feature == "nrm":
            yield from check_normals(image)
        if image.size and not image.any():
            yield f"{feature}: all black"


def check_normals(image: np.ndarray) -> Iterator[str]:
    """Normals stored as n*0.5+0.5 look positive and have unit length only once decoded."""
    lit = (np.abs(image) > BLANK).any(-1)
    if not lit.any():
        return
    n = image[lit]
    plain = np.abs(np.linalg.norm(n, axis=-1) - 1).mean()
    decoded = np.abs(np.linalg.norm(n * 2 - 1, axis=-1) - 1).mean()
    if n.min() >= -FAR and decoded < plain:
        yield "nrm: looks encoded as n*0.5+0.5 (nothing negative); store signed normals"
    elif plain > 0.3:
        yield f"nrm: far from unit length (by {plain:.2f} on average)"


def blocks(image: np.ndarray, main: str, exposure: float) -> np.ndarray:
    """Display values of the light [H,W,C] of blocks of 8x8 pixels, of small pictures 4x4, less the
    mean: noise goes, even where most samples are black, the picture stays."""
    n = 8 if min(image.shape[:2]) >= 32 else 4
    h, w = image.shape[0] // n, image.shape[1] // n
    light = image[:h * n, :w * n].reshape(h, n, w, n, -1).mean((1, 3))
    shown = metrics.to_display(light, main, exposure)
    return shown - shown.mean((0, 1))


def roughness(image: np.ndarray) -> float:
    """Mean absolute second difference in that of the values: an estimate of the noise of display
    values, of pictures that are mostly black, too."""
    if image.shape[1] < 3:
        return 0.0
    second = np.abs(image[:, 2:] - 2 * image[:, 1:-1] + image[:, :-2]).mean()
    return float(second / (np.abs(image).mean() + FAR))


def mean_light(image: np.ndarray) -> float:
    """Mean of cleaned values but for those that were infinite, never 0."""
    return float(np.where(image < FLT_MAX, image, 0.0).mean(dtype=np.float64)) + 1e-6


def check_pair(main: str, source: np.ndarray, target: np.ndarray) -> Iterator[str]:
    """Findings about an input beside its reference; both cleaned, of one size."""
    if np.array_equal(source, target):
        yield "identical with its reference"
        return
    exposure = color.autoexposure(target) if main == "hdr" else 1.0
    a, b = (metrics.to_display(i, main, exposure) for i in (source, target))
    if roughness(b) > 1.1 * roughness(a):
        yield "less noisy than its reference"
    if min(a.shape[:2]) >= 16:
        level = mean_light(source) / mean_light(target)
        if not 0.5 < level < 2 and main in ("hdr", "ldr"):
            yield f"{level:.2f} times as bright as its reference"
        fa, fb = (blocks(i, main, exposure) for i in (source, target))
        norm = np.sqrt((fa**2).sum() * (fb**2).sum())
        if norm > 0 and (fa * fb).sum() / norm < 0.3:
            yield "does not look like its reference (another view?)"


def check_group(group: Group, features: list[str], layers: dict[str, str]) -> Iterator[str]:
    """Findings about the renders of a group; features: the main one first."""
    main = features[0]
    target, first = None, None
    for version in [v for v in (group.target, *group.inputs) if v]:
        opened: dict = {}
        try:
            poor = version is group.target and not holds(version, features, layers, opened)
            wanted = [main] if poor else features  # of references the light is enough
            found = {f: load_raw(version, f, layers, opened) for f in wanted}
        except ToolError as e:
            yield str(e)
            continue
        raw = {f: image for f, (image, _) in found.items()}
        yield from (f"{version.name}: {text}" for text in check_values(version, raw))
        places = {f: origin for f, (_, origin) in found.items() if origin}
        try:
            images = placed(version.name, raw, places)
            first = first or (version.name, images)
            check_beside(version, images, first[1], first[0])
        except ToolError as e:
            yield str(e)
            continue
        picture = clean(raw[main], main)
        if version is group.target:
            target = picture
        elif target is not None:
            yield from (f"{version.name}: {text}" for text in check_pair(main, picture, target))


def main(argv: list[str]) -> None:
    settings = parse("doctor", argv, __doc__)
    features = [settings.main_feature, *settings.aux_features]
    found = scan(Path(settings.data_dir) / settings.input_data, features, need_target=False)
    print("\n".join(found.summary()))
    if not found.groups:
        raise ToolError(f"{found.root}: no group for {' '.join(features)}", DATA)
    count = 0
    for group in found.groups:
        if group.target is None:
            print(f"{group.name}: no reference")
        for text in check_group(group, features, settings.layers):
            print(text)
            count += 1
    count += len(found.left_out)
    for name, reason in found.left_out:
        print(f"{name}: {reason}")
    if count:
        raise ToolError(f"{count} findings in {len(found.groups)} groups", DATA)
    print(f"{len(found.groups)} groups: nothing found")


if __name__ == "__main__":
    errors.run(main)
